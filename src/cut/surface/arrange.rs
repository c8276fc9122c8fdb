//! Where a surface and walls meet, and what they divide each other into.

use std::collections::BTreeMap;

use super::divide::Divided;
use super::hash::{Map, Set};
use super::jitter::{Passage, Tie, above, jitter, passage};
use super::points::{Name, Points};
use super::walls::Walls;
use crate::math::Vec3;
use crate::model::surface::Surface;

/// A part of a triangle of the surface: its corners, and which of its edges lie along what is left of a segment in which a wall meets the surface. The wall faces those.
pub type OuterPart = ([u32; 3], [bool; 3]);

/// What triangles of a surface and of walls have been divided into. Points have numbers of [`Points`].
#[derive(Debug)]
pub struct Arrangement {
    /// The parts of the triangles of the surface that walls meet.
    pub outer: BTreeMap<u32, Vec<OuterPart>>,
    /// The parts of walls' triangles, inside of the surface and outside: the triangle, and the part.
    pub walls: Vec<(u32, [u32; 3])>,
    /// The segments in which they meet, as seen on the surface with the wall's front on the left.
    pub segments: Set<[u32; 2]>,
}

/// The surface, the walls and what decisions go by.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// The surface.
    pub surface: &'a Surface,
    /// The walls.
    pub walls: &'a Walls,
    /// Edge length of a cell, m.
    pub cell_m: f64,
    /// The way in which ties are broken.
    pub seed: u64,
}

impl Scene<'_> {
    /// Where decisions take the corners of a triangle of the surface to be.
    pub fn beside(&self, t: u32) -> [Vec3; 3] {
        self.surface.triangles[t as usize].map(|v| self.vertex_beside(v))
    }

    /// Where decisions take a vertex of the surface to be.
    pub fn vertex_beside(&self, v: u32) -> Vec3 {
        let name = [i64::from(v), 0, 0, -1];
        self.surface.positions[v as usize] + jitter(name, self.seed) * self.cell_m
    }
}

/// A triangle's edges, in its sense of rotation.
pub fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// Lowest and highest coordinates of a triangle.
pub fn bounds([a, b, c]: [Vec3; 3]) -> (Vec3, Vec3) {
    (a.inf(&b).inf(&c), a.sup(&b).sup(&c))
}

/// An edge of a triangle as each triangle that has it sees it.
#[derive(Clone, Copy)]
struct Directed {
    ends: [u32; 2],
    /// Whether it runs in the triangle's sense of rotation.
    is_forward: bool,
}

impl Directed {
    /// What is at the ends of the triangle's edge, in the edge's direction.
    fn of<T>(self, [a, b]: [T; 2]) -> [T; 2] {
        if self.is_forward { [a, b] } else { [b, a] }
    }
}

/// The edges of a triangle of the surface: each runs to its higher vertex.
fn outer_edges(corners: [u32; 3]) -> [Directed; 3] {
    edges(corners).map(|[a, b]| Directed { ends: [a.min(b), a.max(b)], is_forward: a < b })
}

/// The edges of a wall's triangle: they run from crossings to points on faces, and from both to points inside. The numbers of these hang on what was cut before, and how far along an edge
/// something is rounds otherwise from its other end.
fn wall_edges([crossing, on_face, inside]: [u32; 3]) -> [Directed; 3] {
    [([crossing, on_face], true), ([on_face, inside], true), ([crossing, inside], false)]
        .map(|(ends, is_forward)| Directed { ends, is_forward })
}

/// Divides some triangles of a surface, ascending, and some of the walls, which no others meet, by each other.
pub fn arrange(
    scene: Scene<'_>,
    points: &mut Points,
    outer: &[u32],
    new: &[u32],
) -> Result<Arrangement, Tie> {
    let mut meeter = Meeter {
        scene,
        points,
        met: Set::default(),
        on_outer_edges: Map::default(),
        on_wall_edges: Map::default(),
        outer: BTreeMap::new(),
        walls: new.iter().map(|&w| (w, Divided::default())).collect(),
        segments: Set::default(),
    };
    for &t in outer {
        meeter.meet_walls(t)?;
    }
    meeter.finish(new)
}

struct Meeter<'a> {
    scene: Scene<'a>,
    points: &'a mut Points,
    met: Set<u32>,
    on_outer_edges: Map<[u32; 2], Vec<(f64, u32)>>,
    on_wall_edges: Map<[u32; 2], Vec<(f64, u32)>>,
    outer: BTreeMap<u32, Divided>,
    walls: Map<u32, Divided>,
    segments: Set<[u32; 2]>,
}

impl Meeter<'_> {
    fn meet_walls(&mut self, t: u32) -> Result<(), Tie> {
        let Scene { surface, walls, cell_m, .. } = self.scene;
        let (low, high) = bounds(surface.triangles[t as usize].map(|v| surface.positions[v as usize]));
        let outer = self.scene.beside(t);
        let (a, b) = bounds(outer);
        for w in walls.near(&low, &high, cell_m) {
            let (c, d) = walls.triangles[w].bounds;
            if (0..3).all(|axis| a[axis] <= d[axis] && c[axis] <= b[axis]) {
                self.meet(t, outer, w)?;
            }
        }
        Ok(())
    }

    /// Finds the segment in which a triangle of the surface and one of a wall meet.
    fn meet(&mut self, t: u32, outer: [Vec3; 3], w: u32) -> Result<(), Tie> {
        let wall = self.scene.walls.beside(w);
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
        for (i, edge) in outer_edges(self.scene.surface.triangles[t as usize]).into_iter().enumerate() {
            let [a, b] = edge.of([outer[i], outer[(i + 1) % 3]]);
            let Some(found) = passage(wall, a, b)? else { continue };
            let is_upward = found.is_upward == edge.is_forward;
            let point = self.on_outer_edge(edge.ends, w, &found);
            if is_upward { end.push(point) } else { start.push(point) }
        }
        for (i, edge) in wall_edges(self.scene.walls.triangles[w].corners).into_iter().enumerate() {
            let [a, b] = edge.of([wall[i], wall[(i + 1) % 3]]);
            let Some(found) = passage(outer, a, b)? else { continue };
            let is_upward = found.is_upward == edge.is_forward;
            let point = self.on_wall_edge(edge.ends, t, &found);
            if is_upward { start.push(point) } else { end.push(point) }
        }
        match (start[..].first(), end[..].first(), start.len() + end.len()) {
            (None, None, _) => Ok(()),
            (Some(&start), Some(&end), 2) => {
                self.outer.entry(t).or_default().segments.push([start, end]);
                if let Some(divided) = self.walls.get_mut(&w) {
                    divided.segments.push([start, end]);
                }
                self.segments.insert([start, end]);
                Ok(())
            }
            _ => Err(Tie),
        }
    }

    fn on_outer_edge(&mut self, edge: [u32; 2], w: u32, found: &Passage) -> u32 {
        let Scene { surface, walls, .. } = self.scene;
        let point = self.points.number(Name::OuterEdge(edge, w), || {
            let [a, b] = edge.map(|v| surface.positions[v as usize]);
            let uvs = edge.map(|v| surface.uvs[v as usize]);
            let wall_uvs = walls.triangles[w].corners.map(|p| walls.points[p].uv());
            let shares = [1.0 - found.share, found.share];
            (a + (b - a) * found.share, mix(&uvs, &shares), mix(&wall_uvs, &found.weights))
        });
        if self.met.insert(point) {
            self.on_outer_edges.entry(edge).or_default().push((found.share, point));
            if let Some(divided) = self.walls.get_mut(&w) {
                divided.inside.push((found.weights, point));
            }
        }
        point
    }

    fn on_wall_edge(&mut self, edge: [u32; 2], t: u32, found: &Passage) -> u32 {
        let Scene { surface, walls, .. } = self.scene;
        let point = self.points.number(Name::WallEdge(edge, t), || {
            let between = surface.triangles[t as usize];
            let [a, b, c] = between.map(|v| surface.positions[v as usize]);
            let uvs = between.map(|v| surface.uvs[v as usize]);
            let wall_uvs = edge.map(|p| walls.points[p].uv());
            let at = a + (b - a) * found.weights[1] + (c - a) * found.weights[2];
            let shares = [1.0 - found.share, found.share];
            (at, mix(&uvs, &found.weights), mix(&wall_uvs, &shares))
        });
        if self.met.insert(point) {
            self.on_wall_edges.entry(edge).or_default().push((found.share, point));
            self.outer.entry(t).or_default().inside.push((found.weights, point));
        }
        point
    }

    fn finish(mut self, new: &[u32]) -> Result<Arrangement, Tie> {
        for points in self.on_outer_edges.values_mut().chain(self.on_wall_edges.values_mut()) {
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            if points.windows(2).any(|pair| pair[0].0 == pair[1].0) {
                return Err(Tie);
            }
        }
        let along = |points: &Map<[u32; 2], Vec<(f64, u32)>>, edge: Directed| -> Vec<(f64, u32)> {
            let Some(points) = points.get(&edge.ends) else { return Vec::new() };
            if edge.is_forward {
                points.clone()
            } else {
                points.iter().rev().map(|&(share, point)| (1.0 - share, point)).collect()
            }
        };
        let surface = self.scene.surface;
        let mut outer = BTreeMap::new();
        for (t, mut divided) in self.outer {
            let corners = surface.triangles[t as usize];
            divided.on_edges = outer_edges(corners).map(|edge| along(&self.on_outer_edges, edge));
            let corners = corners.map(|v| {
                let at = || (surface.positions[v as usize], surface.uvs[v as usize], [0.0; 2]);
                self.points.number(Name::Outer(v), at)
            });
            let parts = divided.triangles(corners)?.into_iter();
            let with_edges = |part| (part, edges(part).map(|edge| self.segments.contains(&edge)));
            outer.insert(t, parts.map(with_edges).collect());
        }
        let mut parts = Vec::new();
        for &w in new {
            let corners = self.scene.walls.triangles[w].corners;
            let mut divided = self.walls.remove(&w).expect("each is there once");
            divided.on_edges = wall_edges(corners).map(|edge| along(&self.on_wall_edges, edge));
            let corners = corners.map(|p| {
                let point = &self.scene.walls.points[p];
                self.points.number(Name::Wall(p), || (point.at, [0.0; 2], point.uv()))
            });
            if divided.is_whole() {
                parts.push((w, corners));
            } else {
                parts.extend(divided.triangles(corners)?.into_iter().map(|part| (w, part)));
            }
        }
        Ok(Arrangement { outer, walls: parts, segments: self.segments })
    }
}

/// The mean of texture coordinates by weights.
fn mix(uvs: &[[f32; 2]], weights: &[f64]) -> [f32; 2] {
    [0, 1].map(|i| uvs.iter().zip(weights).map(|(uv, weight)| weight * f64::from(uv[i])).sum::<f64>() as f32)
}
