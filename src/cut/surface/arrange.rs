//! Where a surface and walls meet, and what they divide each other into.

use std::collections::{BTreeMap, HashMap};

use super::divide::Divided;
use super::jitter::{Passage, Tie, above, jitter, passage};
use super::walls::Walls;
use crate::math::Vec3;

/// A point where the surface and a wall meet.
pub struct Meeting {
    /// Where it is at rest, m.
    pub at: Vec3,
    /// The vertices of the surface between which it lies; a vertex stands there twice where it lies on an edge.
    pub between: [u32; 3],
    /// Their weights.
    pub weights: [f64; 3],
}

/// A surface and walls, divided where they meet. Points are named by numbers: first the surface's vertices, then the walls' points, then the meetings.
pub struct Arrangement {
    /// The points where they meet.
    pub meetings: Vec<Meeting>,
    /// The triangles of the surface that walls meet, and what they are divided into, ascending.
    pub outer: Vec<(u32, Vec<[u32; 3]>)>,
    /// What is inside of the surface of each wall's triangle: the triangle, and a part of it.
    pub inner: Vec<(u32, [u32; 3])>,
    /// The segments in which a wall's triangle meets the surface, as seen on the surface: the wall faces what is left of them.
    pub segments: HashMap<[u32; 2], u32>,
}

/// What names a point where they meet.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Name {
    /// An edge of the surface through a wall's triangle.
    OuterEdge([u32; 2], u32),
    /// A wall's edge through a triangle of the surface.
    WallEdge([u32; 2], u32),
}

/// A closed surface.
pub struct Outer<'a> {
    /// Where its vertices are, m.
    pub positions: &'a [Vec3],
    /// Its triangles, counter-clockwise seen from outside.
    pub triangles: &'a [[u32; 3]],
}

struct Meeter<'a> {
    outer: &'a Outer<'a>,
    walls: &'a Walls,
    beside: Vec<Vec3>,
    names: HashMap<Name, u32>,
    meetings: Vec<Meeting>,
    on_outer_edges: HashMap<[u32; 2], Vec<(f64, u32)>>,
    on_wall_edges: HashMap<[u32; 2], Vec<(f64, u32)>>,
    outer_divided: BTreeMap<u32, Divided>,
    walls_divided: BTreeMap<u32, Divided>,
    segments: HashMap<[u32; 2], u32>,
}

fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    if a < b { [a, b] } else { [b, a] }
}

/// A triangle's edges, in its sense of rotation.
pub fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// Lowest and highest coordinates of a triangle.
fn bounds([a, b, c]: [Vec3; 3]) -> (Vec3, Vec3) {
    (a.inf(&b).inf(&c), a.sup(&b).sup(&c))
}

/// Divides a closed surface and walls by each other.
pub fn arrange(outer: &Outer<'_>, walls: &Walls, cell_m: f64, seed: u64) -> Result<Arrangement, Tie> {
    let beside = outer.positions.iter().enumerate();
    let beside = beside.map(|(v, at)| at + jitter([v as i64, 0, 0, -1], seed) * cell_m).collect();
    let mut meeter = Meeter {
        outer,
        walls,
        beside,
        names: HashMap::new(),
        meetings: Vec::new(),
        on_outer_edges: HashMap::new(),
        on_wall_edges: HashMap::new(),
        outer_divided: BTreeMap::new(),
        walls_divided: BTreeMap::new(),
        segments: HashMap::new(),
    };
    meeter.meet_all(cell_m)?;
    meeter.finish()
}

impl Meeter<'_> {
    fn outer_triangle(&self, t: u32) -> [Vec3; 3] {
        self.outer.triangles[t as usize].map(|v| self.beside[v as usize])
    }

    fn wall_triangle(&self, w: u32) -> [Vec3; 3] {
        self.walls.triangles[w as usize].corners.map(|p| self.walls.beside[p as usize])
    }

    fn meet_all(&mut self, cell_m: f64) -> Result<(), Tie> {
        let (walls, outer) = (self.walls, self.outer);
        for t in 0..outer.triangles.len() as u32 {
            let (low, high) = bounds(outer.triangles[t as usize].map(|v| outer.positions[v as usize]));
            for w in walls.near(&low, &high, cell_m) {
                self.meet(t, w as u32)?;
            }
        }
        Ok(())
    }

    /// Finds the segment in which a triangle of the surface and one of a wall meet.
    fn meet(&mut self, t: u32, w: u32) -> Result<(), Tie> {
        let (outer, wall) = (self.outer_triangle(t), self.wall_triangle(w));
        let ((a, b), (c, d)) = (bounds(outer), bounds(wall));
        if (0..3).any(|axis| a[axis] > d[axis] || c[axis] > b[axis]) {
            return Ok(());
        }
        let is_apart = |triangle, points: [Vec3; 3]| {
            let sides = points.map(|p| above(triangle, p) > 0.0);
            sides[0] == sides[1] && sides[1] == sides[2]
        };
        if is_apart(wall, outer) || is_apart(outer, wall) {
            return Ok(());
        }
        // The segment runs along the cross product of the wall's normal and the surface's: it ends where an edge of the surface passes the wall upward, and starts where a wall's edge passes the
        // surface so.
        let (mut start, mut end) = (Vec::new(), Vec::new());
        for edge in edges(self.outer.triangles[t as usize]) {
            let canonical = sorted(edge);
            let [a, b] = canonical.map(|v| self.beside[v as usize]);
            let Some(found) = passage(wall, a, b)? else { continue };
            let is_upward = found.is_upward == (canonical == edge);
            let name = self.on_outer_edge(canonical, w, &found);
            if is_upward { end.push(name) } else { start.push(name) }
        }
        for edge in edges(self.walls.triangles[w as usize].corners) {
            let canonical = sorted(edge);
            let [a, b] = canonical.map(|p| self.walls.beside[p as usize]);
            let Some(found) = passage(outer, a, b)? else { continue };
            let is_upward = found.is_upward == (canonical == edge);
            let name = self.on_wall_edge(canonical, t, &found);
            if is_upward { start.push(name) } else { end.push(name) }
        }
        match (start[..].first(), end[..].first(), start.len() + end.len()) {
            (None, None, _) => Ok(()),
            (Some(&start), Some(&end), 2) => {
                self.add_segment(t, w, [start, end]);
                Ok(())
            }
            _ => Err(Tie),
        }
    }

    fn name(&mut self, name: Name, meeting: impl FnOnce() -> Meeting) -> (u32, bool) {
        let first = self.outer.positions.len() + self.walls.points.len();
        let next = (first + self.meetings.len()) as u32;
        let found = *self.names.entry(name).or_insert(next);
        if found == next {
            self.meetings.push(meeting());
        }
        (found, found == next)
    }

    fn on_outer_edge(&mut self, edge: [u32; 2], w: u32, found: &Passage) -> u32 {
        let [a, b] = edge.map(|v| self.outer.positions[v as usize]);
        let (name, is_new) = self.name(Name::OuterEdge(edge, w), || Meeting {
            at: a + (b - a) * found.share,
            between: [edge[0], edge[1], edge[1]],
            weights: [1.0 - found.share, found.share, 0.0],
        });
        if is_new {
            self.on_outer_edges.entry(edge).or_default().push((found.share, name));
            self.walls_divided.entry(w).or_default().inside.push((found.weights, name));
        }
        name
    }

    fn on_wall_edge(&mut self, edge: [u32; 2], t: u32, found: &Passage) -> u32 {
        let between = self.outer.triangles[t as usize];
        let corners = between.map(|v| self.outer.positions[v as usize]);
        let (name, is_new) = self.name(Name::WallEdge(edge, t), || Meeting {
            at: corners[0]
                + (corners[1] - corners[0]) * found.weights[1]
                + (corners[2] - corners[0]) * found.weights[2],
            between,
            weights: found.weights,
        });
        if is_new {
            self.on_wall_edges.entry(edge).or_default().push((found.share, name));
            self.outer_divided.entry(t).or_default().inside.push((found.weights, name));
        }
        name
    }

    fn add_segment(&mut self, t: u32, w: u32, segment: [u32; 2]) {
        self.outer_divided.entry(t).or_default().segments.push(segment);
        self.walls_divided.entry(w).or_default().segments.push(segment);
        self.segments.insert(segment, w);
    }

    fn finish(mut self) -> Result<Arrangement, Tie> {
        for points in self.on_outer_edges.values_mut().chain(self.on_wall_edges.values_mut()) {
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            if points.windows(2).any(|pair| pair[0].0 == pair[1].0) {
                return Err(Tie);
            }
        }
        let along = |points: &HashMap<[u32; 2], Vec<(f64, u32)>>, edge: [u32; 2]| -> Vec<(f64, u32)> {
            let Some(points) = points.get(&sorted(edge)) else { return Vec::new() };
            if sorted(edge) == edge {
                points.clone()
            } else {
                points.iter().rev().map(|&(share, name)| (1.0 - share, name)).collect()
            }
        };
        let mut outer = Vec::new();
        for (t, mut divided) in std::mem::take(&mut self.outer_divided) {
            let corners = self.outer.triangles[t as usize];
            divided.on_edges = edges(corners).map(|edge| along(&self.on_outer_edges, edge));
            outer.push((t, divided.triangles(corners)?));
        }
        let first = self.outer.positions.len() as u32;
        let mut parts = Vec::new();
        for w in 0..self.walls.triangles.len() as u32 {
            let corners = self.walls.triangles[w as usize].corners;
            let names = corners.map(|p| p + first);
            match self.walls_divided.remove(&w) {
                None => parts.push((w, names)),
                Some(mut divided) => {
                    divided.on_edges = edges(corners).map(|edge| along(&self.on_wall_edges, edge));
                    parts.extend(divided.triangles(names)?.into_iter().map(|part| (w, part)));
                }
            }
        }
        let inner = self.inner(parts)?;
        Ok(Arrangement { meetings: self.meetings, outer, inner, segments: self.segments })
    }

    /// The parts of walls that are inside of the surface: on a wall, what is left of a segment is inside.
    fn inner(&self, parts: Vec<(u32, [u32; 3])>) -> Result<Vec<(u32, [u32; 3])>, Tie> {
        let mut at_edge: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
        let mut is_inside: Vec<Option<bool>> = vec![None; parts.len()];
        let mut stack = Vec::new();
        let is_meeting = |edge: [u32; 2]| {
            self.segments.contains_key(&edge) || self.segments.contains_key(&[edge[1], edge[0]])
        };
        for (n, (_, part)) in parts.iter().enumerate() {
            for edge in edges(*part) {
                let seen = if self.segments.contains_key(&edge) {
                    true
                } else if self.segments.contains_key(&[edge[1], edge[0]]) {
                    false
                } else {
                    at_edge.entry(sorted(edge)).or_default().push(n as u32);
                    continue;
                };
                if is_inside[n].replace(seen).is_some_and(|before| before != seen) {
                    return Err(Tie);
                }
                stack.push(n as u32);
            }
        }
        for n in 0..=parts.len() {
            while let Some(at) = stack.pop() {
                for edge in edges(parts[at as usize].1) {
                    if is_meeting(edge) {
                        continue;
                    }
                    for &next in &at_edge[&sorted(edge)] {
                        match is_inside[next as usize] {
                            None => {
                                is_inside[next as usize] = is_inside[at as usize];
                                stack.push(next);
                            }
                            seen if seen != is_inside[at as usize] => return Err(Tie),
                            Some(_) => {}
                        }
                    }
                }
            }
            // Walls that the surface does not meet are all inside, or all outside.
            if n < parts.len() && is_inside[n].is_none() {
                let w = parts[n].0;
                let point = self.walls.triangles[w as usize].corners[2];
                is_inside[n] = Some(self.encloses(self.walls.beside[point as usize])?);
                stack.push(n as u32);
            }
        }
        Ok(parts
            .into_iter()
            .zip(is_inside)
            .filter(|(_, inside)| *inside == Some(true))
            .map(|(part, _)| part)
            .collect())
    }

    /// Whether a point is inside of the surface: how often a ray along x leaves it.
    fn encloses(&self, point: Vec3) -> Result<bool, Tie> {
        let farthest = self.beside.iter().fold(point.x, |x, p| x.max(p.x));
        let mut beyond = point;
        beyond.x = farthest + 1.0;
        let mut leaves = 0;
        for t in 0..self.outer.triangles.len() as u32 {
            let triangle = self.outer_triangle(t);
            let (low, high) = bounds(triangle);
            if high.x < point.x || (1..3).any(|axis| low[axis] > point[axis] || high[axis] < point[axis]) {
                continue;
            }
            if let Some(found) = passage(triangle, point, beyond)? {
                leaves += if found.is_upward { 1 } else { -1 };
            }
        }
        Ok(leaves > 0)
    }
}
