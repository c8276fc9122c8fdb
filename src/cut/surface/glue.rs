//! Joins the parts of a surface and both sheets of its walls to closed surfaces.
//!
//! Which parts meet at an edge is known from what they are, not from where they are. Corners of parts that meet become one vertex: so a point gets as many vertices as
//! there are sides around it, and only those at the front of a cut belong to both.

use std::collections::{HashMap, HashSet};

use super::arrange::{Arrangement, edges};
use super::groups::Groups;
use super::jitter::Tie;
use super::walls::Walls;

/// One side of a wall's triangle: its index, and 0 for the sheet of the piece that it faces, 1 for that of the piece behind it.
pub type Sheet = (u32, usize);

/// What a triangle is a part of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// A triangle of the surface.
    Outer(u32),
    /// A sheet of a wall.
    Wall(Sheet),
}

/// Where a new vertex is.
#[derive(Clone, Copy, Debug)]
pub enum Place {
    /// At a point of the arrangement, by its name.
    Point(u32),
    /// In the middle between two vertices.
    Middle([u32; 2]),
}

/// Triangles that are joined.
pub struct Glued {
    /// Their corners, and what they are parts of. Vertices are named by numbers: first the surface's, then the new ones.
    pub faces: Vec<([u32; 3], Part)>,
    /// The new vertices: where they are, and a sheet that they belong to.
    pub vertices: Vec<(Place, Sheet)>,
}

/// No other half of an edge: it lies on a triangle that no wall meets.
const NONE: u32 = u32::MAX;

/// Joins what a surface of `outer_vertices` vertices and walls have been divided into.
pub fn glue(arrangement: &Arrangement, walls: &Walls, outer_vertices: u32) -> Result<Glued, Tie> {
    let mut faces = Vec::new();
    for (t, parts) in &arrangement.outer {
        faces.extend(parts.iter().map(|&part| (part, Part::Outer(*t))));
    }
    for &(w, [a, b, c]) in &arrangement.inner {
        faces.push(([a, c, b], Part::Wall((w, 0))));
        faces.push(([a, b, c], Part::Wall((w, 1))));
    }
    let twins = twins(&faces, arrangement, walls)?;
    let mut glued = join(faces, &twins, outer_vertices)?;
    split_twice_used(&mut glued, twins, outer_vertices)?;
    Ok(glued)
}

/// The half edges, numbered by three times the face and the corner that they start from, that each is glued to.
fn twins(faces: &[([u32; 3], Part)], arrangement: &Arrangement, walls: &Walls) -> Result<Vec<u32>, Tie> {
    let mut at_edge: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
    for (n, (points, _)) in faces.iter().enumerate() {
        for (i, [a, b]) in edges(*points).into_iter().enumerate() {
            at_edge.entry([a.min(b), a.max(b)]).or_default().push((3 * n + i) as u32);
        }
    }
    let mut twins = vec![NONE; 3 * faces.len()];
    let part = |half: u32| faces[half as usize / 3].1;
    let ends = |half: u32| edges(faces[half as usize / 3].0)[half as usize % 3];
    for halves in at_edge.values() {
        let (mut outer, mut sheets) = (Vec::new(), Vec::new());
        for &half in halves {
            match part(half) {
                Part::Outer(t) => outer.push((half, t)),
                Part::Wall(sheet) => sheets.push((half, sheet)),
            }
        }
        let pairs = match (outer.is_empty(), sheets.is_empty()) {
            (false, false) => {
                at_meeting(&outer, &sheets, |half| arrangement.segments.get(&ends(half)).copied())
            }
            (false, true) => on_outer(&outer),
            _ => between_sheets(&sheets, walls),
        };
        for [a, b] in pairs.ok_or(Tie)? {
            let [p, q] = ends(a);
            if ends(b) != [q, p] {
                return Err(Tie);
            }
            (twins[a as usize], twins[b as usize]) = (b, a);
        }
    }
    Ok(twins)
}

type Pairs = Option<Vec<[u32; 2]>>;

/// Where the surface and a wall meet: what is left of the segment, where the wall faces, is glued to the front.
fn at_meeting(outer: &[(u32, u32)], sheets: &[(u32, Sheet)], wall: impl Fn(u32) -> Option<u32>) -> Pairs {
    if outer.len() != 2 || sheets.len() != 2 {
        return None;
    }
    let glued = |&(half, _): &(u32, u32)| {
        let side = usize::from(wall(half).is_none());
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
    let wall = |w: u32| &walls.triangles[w as usize];
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

/// Gives corners that are glued a vertex.
fn join(mut faces: Vec<([u32; 3], Part)>, twins: &[u32], outer_vertices: u32) -> Result<Glued, Tie> {
    let mut groups = Groups::new(twins.len());
    let after = |half: u32| half - half % 3 + (half + 1) % 3;
    for half in 0..twins.len() as u32 {
        let twin = twins[half as usize];
        if twin != NONE {
            // The corner that a half edge starts from has its number.
            groups.join(half, after(twin));
        }
    }
    let mut sheet_of: HashMap<u32, Sheet> = HashMap::new();
    for half in 0..twins.len() as u32 {
        if let Part::Wall(sheet) = faces[half as usize / 3].1 {
            let lowest = sheet_of.entry(groups.of(half)).or_insert(sheet);
            *lowest = (*lowest).min(sheet);
        }
    }
    let mut vertices = Vec::new();
    let mut vertex_of: HashMap<u32, u32> = HashMap::new();
    for (n, (points, _)) in faces.iter_mut().enumerate() {
        for (i, point) in points.iter_mut().enumerate() {
            if *point < outer_vertices {
                continue;
            }
            let group = groups.of((3 * n + i) as u32);
            let next = outer_vertices + vertices.len() as u32;
            let vertex = *vertex_of.entry(group).or_insert(next);
            if vertex == next {
                vertices.push((Place::Point(*point), *sheet_of.get(&group).ok_or(Tie)?));
            }
            *point = vertex;
        }
    }
    Ok(Glued { faces, vertices })
}

/// Halves edges whose ends another edge has as well, as where a wall has both of its ends on the front of a cut: each edge then has ends of its own.
fn split_twice_used(glued: &mut Glued, mut twins: Vec<u32>, outer_vertices: u32) -> Result<(), Tie> {
    // Where both triangles at an edge have the same third corner it takes another round.
    for _ in 0..8 {
        let mut used = HashSet::new();
        let mut twice = Vec::new();
        for half in 0..twins.len() as u32 {
            let [a, b] = edges(glued.faces[half as usize / 3].0)[half as usize % 3];
            let is_first = a < b || twins[half as usize] == NONE;
            if is_first && !used.insert([a, b]) {
                twice.push(half);
            }
        }
        if twice.is_empty() {
            return Ok(());
        }
        for half in twice {
            split(glued, &mut twins, half, outer_vertices).ok_or(Tie)?;
        }
    }
    Err(Tie)
}

/// Halves an edge and both triangles at it.
fn split(glued: &mut Glued, twins: &mut Vec<u32>, half: u32, outer_vertices: u32) -> Option<()> {
    let twin = Some(twins[half as usize]).filter(|&twin| twin != NONE)?;
    let ends = edges(glued.faces[half as usize / 3].0)[half as usize % 3];
    let sheet = [half, twin].into_iter().find_map(|half| match glued.faces[half as usize / 3].1 {
        Part::Wall(sheet) => Some(sheet),
        Part::Outer(_) => None,
    })?;
    let middle = outer_vertices + glued.vertices.len() as u32;
    glued.vertices.push((Place::Middle(ends), sheet));
    // From a, b, c with the edge a to b: a, m, c stays in its place, and m, b, c is new.
    let new = [half, twin].map(|half| {
        let (face, i) = (half as usize / 3, half as usize % 3);
        let (next, last) = ((i + 1) % 3, (i + 2) % 3);
        let (corners, part) = glued.faces[face];
        glued.faces[face].0[next] = middle;
        let added = glued.faces.len() as u32;
        glued.faces.push(([middle, corners[next], corners[last]], part));
        let moved = twins[3 * face + next];
        twins.extend([NONE, moved, (3 * face + next) as u32]);
        if moved != NONE {
            twins[moved as usize] = 3 * added + 1;
        }
        twins[3 * face + next] = 3 * added + 2;
        3 * added
    });
    // a to m lies against m to a of the other.
    twins[half as usize] = new[1];
    twins[new[1] as usize] = half;
    twins[twin as usize] = new[0];
    twins[new[0] as usize] = twin;
    Some(())
}
