//! Joins the parts of a surface and both sheets of its walls to closed surfaces.
//!
//! Which parts meet at an edge is known from what they are, not from where they are. Corners of parts that meet become one vertex: so a point gets as many vertices as
//! there are sides around it, and only those at the front of a cut belong to both. What two edges and a point are joined to depends on the parts there alone: where none comes or goes all stays.

use super::arrange::edges;
use super::grid::GridNode;
use super::hash::{Map, Set};
use super::jitter::Tie;
use super::points::{Name, Points};
use super::store::{NONE, Store};
use super::walls::Walls;

/// One side of a wall's triangle: its number, and 0 for the sheet of the piece that it faces, 1 for that of the piece behind it.
pub type Sheet = (u32, usize);

/// What a triangle is a part of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Part {
    /// A triangle of the surface.
    Outer(u32),
    /// A sheet of a wall.
    Wall(Sheet),
}

/// Where a new vertex is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// At a point.
    Point(u32),
    /// In the middle between two vertices.
    Edge([u32; 2]),
    /// In the middle of three.
    Face([u32; 3]),
}

/// A piece of a cell that something hangs on: the cell, and the corners of the piece, a bit for each.
pub type Anchor = (GridNode, u8);

/// A vertex that the original surface does not have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vertex {
    /// Where it is.
    pub place: Place,
    /// What it hangs on.
    pub anchor: Anchor,
}

/// A part that has been joined to others. Its half edges have the numbers from three times its own: each starts from a corner.
#[derive(Clone, Debug)]
pub struct Face {
    /// Its corners.
    pub points: [u32; 3],
    /// What it is a part of.
    pub part: Part,
    /// Which of its edges a wall meets, seen from the wall's front.
    along: [bool; 3],
    /// The half edges of others that its own are glued to; [`NONE`] where there is a triangle that no wall meets.
    twins: [u32; 3],
    /// The vertices at its corners.
    vertices: [u32; 3],
    /// Vertices that halve its edges.
    middles: [u32; 3],
    /// A vertex inside.
    centre: u32,
    /// The numbers that its triangles have outside.
    pub slots: Vec<u32>,
}

impl Face {
    /// All its vertices.
    pub fn all_vertices(&self) -> impl Iterator<Item = u32> {
        let all = [self.vertices, self.middles, [self.centre, NONE, NONE]];
        all.into_iter().flatten().filter(|&v| v != NONE)
    }

    /// The triangles that it consists of.
    pub fn triangles(&self) -> Vec<[u32; 3]> {
        let (v, m) = (self.vertices, self.middles);
        if self.centre != NONE {
            let around: Vec<u32> = (0..3).flat_map(|i| [v[i], m[i]]).filter(|&v| v != NONE).collect();
            let next = around.iter().cycle().skip(1);
            return around.iter().zip(next).map(|(&a, &b)| [self.centre, a, b]).collect();
        }
        let halved: Vec<usize> = (0..3).filter(|&i| m[i] != NONE).collect();
        match halved[..] {
            [] => vec![v],
            [i] => {
                let [a, b, c] = [v[i], v[(i + 1) % 3], v[(i + 2) % 3]];
                vec![[a, m[i], c], [m[i], b, c]]
            }
            [i, j] => {
                // From the edge that is whole.
                let k = 3 - i - j;
                let [a, b, c] = [v[k], v[(k + 1) % 3], v[(k + 2) % 3]];
                let [p, q] = [m[(k + 1) % 3], m[(k + 2) % 3]];
                vec![[a, b, p], [a, p, q], [p, c, q]]
            }
            _ => vec![[v[0], m[0], m[2]], [v[1], m[1], m[0]], [v[2], m[2], m[1]], m],
        }
    }
}

/// All faces and what they are joined to.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// The parts.
    pub faces: Store<Face>,
    /// The new vertices; their numbers follow those of the surface's.
    vertices: Store<Vertex>,
    outer_vertices: u32,
    of_part: Map<Part, Vec<u32>>,
}

/// What has changed since faces were last joined.
#[derive(Debug, Default)]
pub struct Joint {
    /// Points whose faces are others.
    pub points: Vec<u32>,
    edges: Vec<[u32; 2]>,
    /// Faces that are new or have other vertices.
    pub faces: Set<u32>,
    /// Vertices that are new, or elsewhere, or hang on another piece; some may be gone again.
    pub vertices: Set<u32>,
    /// Numbers that the triangles of faces had which are gone.
    pub slots: Vec<(Part, u32)>,
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    if a < b { [a, b] } else { [b, a] }
}

/// Sorts edges by their ends, and leaves each once.
fn unique(edges: impl IntoIterator<Item = [u32; 2]>) -> impl Iterator<Item = [u32; 2]> {
    // As one number each they are compared sooner.
    let joined = edges.into_iter().map(sorted).map(|[a, b]| u64::from(a) << 32 | u64::from(b));
    let mut joined: Vec<u64> = joined.collect();
    joined.sort_unstable();
    joined.dedup();
    joined.into_iter().map(|edge| [(edge >> 32) as u32, edge as u32])
}

impl Mesh {
    /// Without a face. The original surface has so many vertices.
    pub fn new(outer_vertices: u32) -> Self {
        let (faces, vertices) = (Store::default(), Store::default());
        Self { faces, vertices, outer_vertices, of_part: Map::default() }
    }

    /// The faces of a part.
    pub fn faces_of(&self, part: Part) -> &[u32] {
        self.of_part.get(&part).map_or(&[], Vec::as_slice)
    }

    /// A vertex, if it is a new one that is there.
    pub fn vertex(&self, v: u32) -> Option<Vertex> {
        let n = v.checked_sub(self.outer_vertices)?;
        self.vertices.has(n).then(|| self.vertices[n])
    }

    /// How many vertices the original surface has.
    pub fn outer_vertex_count(&self) -> usize {
        self.outer_vertices as usize
    }

    /// How many numbers of vertices have been given.
    pub fn vertex_count(&self) -> usize {
        self.outer_vertices as usize + self.vertices.len()
    }

    /// Lets numbers of what has been removed be given again.
    pub fn settle(&mut self) {
        self.faces.settle();
        self.vertices.settle();
    }

    /// Whether a sheet of a wall has an edge between two points.
    pub fn has_sheet_at(&self, points: &Points, edge: [u32; 2]) -> bool {
        self.halves_at(points, edge).any(|half| matches!(self.part(half), Part::Wall(_)))
    }

    fn part(&self, half: u32) -> Part {
        self.faces[half / 3].part
    }

    fn ends(&self, half: u32) -> [u32; 2] {
        edges(self.faces[half / 3].points)[half as usize % 3]
    }

    fn twin(&self, half: u32) -> u32 {
        self.faces[half / 3].twins[half as usize % 3]
    }

    /// The half edges between two points, in both directions.
    fn halves_at<'a>(&'a self, points: &'a Points, [a, b]: [u32; 2]) -> impl Iterator<Item = u32> + 'a {
        let from = |p: u32| &points.get(p).corners;
        let (a, b) = if from(a).len() <= from(b).len() { (a, b) } else { (b, a) };
        from(a).iter().flat_map(move |&half| {
            let (face, i) = (half / 3, half % 3);
            let corners = self.faces[face].points;
            let [next, last] = [(i + 1) % 3, (i + 2) % 3];
            let leaves = (corners[next as usize] == b).then_some(half);
            let comes = (corners[last as usize] == b).then_some(3 * face + last);
            leaves.into_iter().chain(comes)
        })
    }

    /// Removes all faces of a part.
    pub fn remove_part(&mut self, points: &mut Points, part: Part, joint: &mut Joint) {
        for face in self.faces_of(part).to_vec() {
            self.remove(points, face, joint);
        }
    }

    /// Removes a face.
    pub fn remove(&mut self, points: &mut Points, face: u32, joint: &mut Joint) {
        for i in 0..3 {
            self.set_middle(3 * face + i, NONE, joint);
        }
        let gone = self.faces.remove(face);
        if gone.centre != NONE {
            self.vertices.remove(gone.centre - self.outer_vertices);
        }
        for i in 0..3 {
            let half = 3 * face + i as u32;
            points.get_mut(gone.points[i]).corners.retain(|&corner| corner != half);
            if gone.twins[i] != NONE && self.faces.has(gone.twins[i] / 3) {
                self.faces[gone.twins[i] / 3].twins[gone.twins[i] as usize % 3] = NONE;
            }
        }
        joint.points.extend(gone.points);
        joint.edges.extend(edges(gone.points));
        joint.slots.extend(gone.slots.iter().map(|&slot| (gone.part, slot)));
        joint.faces.remove(&face);
        let faces = self.of_part.get_mut(&gone.part).expect("it has had a face");
        faces.retain(|&other| other != face);
        if faces.is_empty() {
            self.of_part.remove(&gone.part);
        }
    }

    /// Adds a face.
    pub fn add(
        &mut self,
        points: &mut Points,
        corners: [u32; 3],
        part: Part,
        along: [bool; 3],
        joint: &mut Joint,
    ) {
        let vertices = corners.map(|p| match points.get(p).name {
            Name::Outer(v) => v,
            _ => NONE,
        });
        let face = self.faces.insert(Face {
            points: corners,
            part,
            along,
            twins: [NONE; 3],
            vertices,
            middles: [NONE; 3],
            centre: NONE,
            slots: Vec::new(),
        });
        for (i, point) in corners.into_iter().enumerate() {
            points.get_mut(point).corners.push(3 * face + i as u32);
        }
        joint.points.extend(corners);
        joint.edges.extend(edges(corners));
        joint.faces.insert(face);
        self.of_part.entry(part).or_default().push(face);
    }

    /// Makes the faces of a triangle of the surface those that it is divided into now. Parts that have been there before stay.
    pub fn divide(
        &mut self,
        points: &mut Points,
        t: u32,
        parts: &[([u32; 3], [bool; 3])],
        joint: &mut Joint,
    ) {
        let part = Part::Outer(t);
        let before = self.faces_of(part).to_vec();
        let is = |mesh: &Self, face: u32| (mesh.faces[face].points, mesh.faces[face].along);
        let new: Vec<_> =
            parts.iter().filter(|&&new| !before.iter().any(|&face| is(self, face) == new)).copied().collect();
        for face in before {
            if !parts.contains(&is(self, face)) {
                self.remove(points, face, joint);
            }
        }
        for (corners, along) in new {
            self.add(points, corners, part, along, joint);
        }
    }

    /// Joins what has come and gone to what is there.
    pub fn join(&mut self, points: &mut Points, walls: &Walls, joint: &mut Joint) -> Result<(), Tie> {
        joint.points.sort_unstable();
        joint.points.dedup();
        for edge in unique(std::mem::take(&mut joint.edges)) {
            self.pair(points, walls, edge, joint)?;
        }
        for n in 0..joint.points.len() {
            self.share(points, walls, joint.points[n], joint)?;
        }
        // Only edges that end at such a point may have ends that another has as well.
        let mut beside = Vec::new();
        for &point in &joint.points {
            for &half in &points.get(point).corners {
                let last = half - half % 3 + (half + 2) % 3;
                beside.extend([self.ends(half), self.ends(last)]);
            }
        }
        for edge in unique(beside) {
            self.halve(points, walls, edge, joint)?;
        }
        let mut faces: Vec<u32> = joint.faces.iter().copied().collect();
        faces.sort_unstable();
        for face in faces {
            self.centre(walls, face, joint);
        }
        Ok(())
    }

    /// Glues the half edges between two points to each other.
    fn pair(&mut self, points: &Points, walls: &Walls, edge: [u32; 2], joint: &mut Joint) -> Result<(), Tie> {
        let mut halves: Vec<u32> = self.halves_at(points, edge).collect();
        halves.sort_unstable();
        let (mut outer, mut sheets) = (Vec::new(), Vec::new());
        for &half in &halves {
            match self.part(half) {
                Part::Outer(t) => outer.push((half, t)),
                Part::Wall(sheet) => sheets.push((half, sheet)),
            }
        }
        let pairs = match (outer.is_empty(), sheets.is_empty()) {
            (true, true) => return Ok(()),
            (false, false) => {
                at_meeting(&outer, &sheets, |half| self.faces[half / 3].along[half as usize % 3])
            }
            (false, true) => on_outer(&outer),
            (true, false) => between_sheets(&sheets, walls),
        };
        let pairs = pairs.ok_or(Tie)?;
        for half in halves {
            let stays = pairs.contains(&[half, self.twin(half)]) || pairs.contains(&[self.twin(half), half]);
            if !stays {
                self.set_middle(half, NONE, joint);
                self.faces[half / 3].twins[half as usize % 3] = NONE;
            }
        }
        for [a, b] in pairs {
            let [p, q] = self.ends(a);
            if self.ends(b) != [q, p] {
                return Err(Tie);
            }
            self.faces[a / 3].twins[a as usize % 3] = b;
            self.faces[b / 3].twins[b as usize % 3] = a;
        }
        Ok(())
    }

    /// What a sheet hangs on.
    fn anchor(walls: &Walls, (w, side): Sheet) -> Anchor {
        let wall = &walls.triangles[w];
        (wall.cell, wall.pieces[side])
    }

    /// What an edge of a sheet hangs on.
    fn anchor_at(&self, walls: &Walls, half: u32) -> Option<Anchor> {
        let both = [half, self.twin(half)].into_iter().filter(|&half| half != NONE);
        both.filter_map(|half| match self.part(half) {
            Part::Wall(sheet) => Some(Self::anchor(walls, sheet)),
            Part::Outer(_) => None,
        })
        .min()
    }

    /// Gives the corners at a point that are glued a vertex: one that was theirs, where there is one.
    fn share(
        &mut self,
        points: &mut Points,
        walls: &Walls,
        point: u32,
        joint: &mut Joint,
    ) -> Result<(), Tie> {
        if matches!(points.get(point).name, Name::Outer(_)) {
            return Ok(());
        }
        let corners = &points.get(point).corners;
        let mut free = points.get(point).vertices.clone();
        let after = |half: u32| half - half % 3 + (half + 1) % 3;
        // All corners, fan by fan, and for each fan where it ends.
        let mut around: Vec<u32> = Vec::with_capacity(corners.len());
        let mut fans: Vec<(usize, Anchor)> = Vec::with_capacity(2);
        for &corner in corners {
            if around.contains(&corner) {
                continue;
            }
            let (first, mut anchor, mut half) = (around.len(), None, corner);
            while !around[first..].contains(&half) {
                around.push(half);
                if let Part::Wall(sheet) = self.part(half) {
                    let there = Self::anchor(walls, sheet);
                    anchor = Some(anchor.map_or(there, |lowest: Anchor| lowest.min(there)));
                }
                let twin = self.twin(half);
                if twin == NONE {
                    return Err(Tie);
                }
                half = after(twin);
            }
            fans.push((around.len(), anchor.ok_or(Tie)?));
        }
        let starts: Vec<usize> = std::iter::once(0).chain(fans.iter().map(|&(end, _)| end)).collect();
        let given: Vec<Option<u32>> = (0..fans.len())
            .map(|n| {
                let fan = around[starts[n]..starts[n + 1]].iter();
                let mut old = fan.map(|half| self.faces[half / 3].vertices[*half as usize % 3]);
                let known = old.find_map(|v| free.iter().position(|&other| other == v));
                known.map(|n| free.swap_remove(n))
            })
            .collect();
        let mut vertices = Vec::with_capacity(fans.len());
        for (n, (_, anchor)) in fans.into_iter().enumerate() {
            let vertex = Vertex { place: Place::Point(point), anchor };
            let v = match given[n].or_else(|| free.pop()) {
                Some(v) => v,
                None => self.new_vertex(vertex, joint),
            };
            let known = &mut self.vertices[v - self.outer_vertices];
            if *known != vertex {
                *known = vertex;
                joint.vertices.insert(v);
            }
            for &half in &around[starts[n]..starts[n + 1]] {
                let corner = &mut self.faces[half / 3].vertices[half as usize % 3];
                if *corner != v {
                    *corner = v;
                    joint.faces.insert(half / 3);
                }
            }
            vertices.push(v);
        }
        for v in free {
            self.vertices.remove(v - self.outer_vertices);
        }
        points.get_mut(point).vertices = vertices;
        Ok(())
    }

    fn new_vertex(&mut self, vertex: Vertex, joint: &mut Joint) -> u32 {
        let v = self.outer_vertices + self.vertices.insert(vertex);
        joint.vertices.insert(v);
        v
    }

    /// Halves the edges between two points whose ends another edge has as well, as where a wall has both of its ends on the front of a cut: each edge then has ends of its own.
    fn halve(
        &mut self,
        points: &Points,
        walls: &Walls,
        edge: [u32; 2],
        joint: &mut Joint,
    ) -> Result<(), Tie> {
        let ends = |mesh: &Self, half: u32| {
            let vertices = mesh.faces[half / 3].vertices;
            sorted([vertices[half as usize % 3], vertices[(half as usize + 1) % 3]])
        };
        let is_first = |half: &u32| self.twin(*half) == NONE || *half < self.twin(*half);
        let firsts = || self.halves_at(points, edge).filter(is_first);
        let is_alone = |half: u32| {
            let mut others = firsts().filter(|&other| other != half);
            others.all(|other| ends(self, other) != ends(self, half))
        };
        let is_whole = |half: u32| self.faces[half / 3].middles[half as usize % 3] == NONE;
        if firsts().all(|half| is_whole(half) && is_alone(half)) {
            return Ok(());
        }
        let mut halves: Vec<u32> = firsts().collect();
        halves.sort_unstable();
        let all: Vec<[u32; 2]> = halves.iter().map(|&half| ends(self, half)).collect();
        for (n, &half) in halves.iter().enumerate() {
            let middle = self.faces[half / 3].middles[half as usize % 3];
            if all.iter().filter(|&&other| other == all[n]).count() < 2 {
                self.set_middle(half, NONE, joint);
                continue;
            }
            // One between parts of the surface stays whole.
            let Some(anchor) = self.anchor_at(walls, half) else {
                let mut others = (0..all.len()).filter(|&other| other != n && all[other] == all[n]);
                if others.any(|other| self.anchor_at(walls, halves[other]).is_none()) {
                    return Err(Tie);
                }
                continue;
            };
            let vertex = Vertex { place: Place::Edge(all[n]), anchor };
            if self.vertex(middle) != Some(vertex) {
                let new = self.new_vertex(vertex, joint);
                self.set_middle(half, new, joint);
            }
        }
        Ok(())
    }

    /// Makes a vertex the middle of an edge, in the place of the one that was.
    fn set_middle(&mut self, half: u32, middle: u32, joint: &mut Joint) {
        let before = self.faces[half / 3].middles[half as usize % 3];
        if before == middle {
            return;
        }
        for half in [half, self.twin(half)].into_iter().filter(|&half| half != NONE) {
            self.faces[half / 3].middles[half as usize % 3] = middle;
            joint.faces.insert(half / 3);
        }
        if before != NONE {
            self.vertices.remove(before - self.outer_vertices);
        }
    }

    /// Gives a wall's face with halved edges a vertex inside: triangles around that share no edge with those of another.
    fn centre(&mut self, walls: &Walls, face: u32, joint: &mut Joint) {
        let Face { part, vertices, middles, centre, .. } = self.faces[face];
        let now = match part {
            Part::Wall(sheet) if middles != [NONE; 3] => {
                Some(Vertex { place: Place::Face(vertices), anchor: Self::anchor(walls, sheet) })
            }
            _ => None,
        };
        if self.vertex(centre) == now {
            return;
        }
        if centre != NONE {
            self.vertices.remove(centre - self.outer_vertices);
        }
        self.faces[face].centre = now.map_or(NONE, |vertex| self.new_vertex(vertex, joint));
    }
}

type Pairs = Option<Vec<[u32; 2]>>;

/// Where the surface and a wall meet: what is left of the segment, where the wall faces, is glued to the front.
fn at_meeting(outer: &[(u32, u32)], sheets: &[(u32, Sheet)], is_left: impl Fn(u32) -> bool) -> Pairs {
    if outer.len() != 2 || sheets.len() != 2 {
        return None;
    }
    let glued = |&(half, _): &(u32, u32)| {
        let side = usize::from(!is_left(half));
        let &(other, _) = sheets.iter().find(|(_, sheet)| sheet.1 == side)?;
        Some([half, other])
    };
    outer.iter().map(glued).collect()
}

/// Between parts of the surface.
fn on_outer(outer: &[(u32, u32)]) -> Pairs {
    let (mut pairs, mut left) = (Vec::new(), Vec::<(u32, u32)>::new());
    for &(half, t) in outer {
        match left.iter().position(|&(_, other)| other == t) {
            Some(n) => pairs.push([left.swap_remove(n).0, half]),
            None => left.push((half, t)),
        }
    }
    match left[..] {
        [] | [_] => {}
        [a, b] => pairs.push([a.0, b.0]),
        _ => return None,
    }
    Some(pairs)
}

/// Inside of the surface.
fn between_sheets(halves: &[(u32, Sheet)], walls: &Walls) -> Pairs {
    let of = |w: u32, side: usize| {
        halves.iter().filter(move |(_, sheet)| *sheet == (w, side)).map(|&(half, _)| half)
    };
    let only = |w: u32, side: usize| {
        let mut all = of(w, side);
        all.next().filter(|_| all.next().is_none())
    };
    let mut there: Vec<u32> = halves.iter().map(|(_, sheet)| sheet.0).collect();
    there.sort_unstable();
    there.dedup();
    if let [w] = there[..] {
        // At the front of a cut both sheets meet, inside of a triangle each its own parts.
        if let (Some(a), Some(b)) = (only(w, 0), only(w, 1)) {
            return Some(vec![[a, b]]);
        }
        let within = |side| {
            let mut all = of(w, side);
            let pair = [all.next()?, all.next()?];
            all.next().is_none().then_some(pair)
        };
        return Some(vec![within(0)?, within(1)?]);
    }
    let wall = |w: u32| &walls.triangles[w];
    if let [v, w] = there[..]
        && wall(v).corners[0] == wall(w).corners[0]
    {
        // They run on from one to the other, and face the same node or opposite ones.
        let turned = usize::from(wall(v).faces != wall(w).faces);
        let pair = |side: usize| Some([only(v, side)?, only(w, side ^ turned)?]);
        return Some(vec![pair(0)?, pair(1)?]);
    }
    // They stand around an edge between a face and the inside of a cell: the back of each sees the front of the next.
    there.sort_by_key(|&w| wall(w).place.turn);
    let next = there.iter().cycle().skip(1);
    there.iter().zip(next).map(|(&v, &w)| Some([only(v, 1)?, only(w, 0)?])).collect()
}
