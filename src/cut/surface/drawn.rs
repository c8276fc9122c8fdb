//! A cut surface as renderers and tools take it, and what a cut changes of that.
//!
//! One list of triangles: those of the outer surface, places for more of them, and then the walls. Walls have vertices of their own where they share them with the outer surface: a lip
//! is an edge, with a normal and texture coordinates on either side. Vertices and triangles keep their numbers as long as they are there; where something has gone it leaves a hole, a vertex that
//! nothing names or a triangle `[0, 0, 0]`, for the next that comes.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use super::store::NONE;
use super::{CutSurface, SurfaceChange};
use crate::error::{Error, Result};
use crate::model::fans::is_there;
use crate::model::mesh::TriangleMesh;
use crate::model::surface::{ROW, Row, Surface, grow};

/// A triangle that is not there.
const GONE: [u32; 3] = [0; 3];
/// Places for triangles that the outer surface may get: a share of those that it has, and no fewer than this.
const SPARE: usize = 16;
const LEAST_SPARE: usize = 256;

/// The two lists of a cut surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum List {
    Outer,
    Walls,
}

/// What a surface is drawn by.
#[derive(Clone, Copy, Debug)]
pub struct Drawing<'a> {
    /// Edge length of a cell in m.
    pub cell_m: f64,
    /// Nodes without tissue: what hangs on one is not drawn.
    pub vacant: &'a HashSet<u32>,
    /// Most vertices and triangles.
    pub room: [usize; 2],
}

impl Drawing<'_> {
    /// Whether what hangs on these nodes is not drawn.
    pub fn is_lost(&self, row: &Row) -> bool {
        !self.vacant.is_empty()
            && (0..ROW).any(|n| row.weights[n] != 0.0 && self.vacant.contains(&row.nodes[n]))
    }

    /// Refuses more than there is room for.
    fn check(&self, vertices: usize, triangles: usize) -> Result<()> {
        let [most_vertices, most_triangles] = self.room;
        if vertices > most_vertices || triangles > most_triangles {
            return Err(Error::Limit(format!(
                "the cut surface has {vertices} vertices and {triangles} triangles, and there is room for {most_vertices} and {most_triangles}"
            )));
        }
        Ok(())
    }
}

/// What has changed of a surface as it is drawn: numbers, ascending. All that is new is among them, but for holes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Redrawn {
    /// Vertices that are new, or hang on other nodes, or lie elsewhere.
    pub vertices: Vec<u32>,
    /// Triangles with other corners.
    pub triangles: Vec<u32>,
    /// Vertices with other triangles around them.
    pub fans: Vec<u32>,
    /// Whether the lists of triangles around vertices have all been moved.
    pub is_tidied: bool,
    /// Whether all may be other than before; nothing else is said then.
    pub is_all: bool,
}

impl Redrawn {
    /// All may be other than before.
    pub fn all() -> Self {
        Self { is_all: true, ..Self::default() }
    }

    /// Whether nothing has changed.
    pub fn is_empty(&self) -> bool {
        !self.is_all && self.vertices.is_empty() && self.triangles.is_empty()
    }

    /// Has a copy of the surface as it was before become one of it as it is now.
    pub fn copy(&self, now: &Surface, copy: &mut Surface) {
        if self.is_all {
            copy.clone_from(now);
            return;
        }
        let count = now.positions.len();
        copy.positions.resize_with(count, Default::default);
        copy.uvs.resize(count, [0.0; 2]);
        copy.materials.resize(count, 0);
        copy.rows.resize(count, now.rows[0]);
        copy.fans.resize(count);
        copy.triangles.resize(now.triangles.len(), GONE);
        copy.first_wall = now.first_wall;
        for v in self.vertices.iter().map(|&v| v as usize) {
            copy.positions[v] = now.positions[v];
            (copy.uvs[v], copy.materials[v], copy.rows[v]) = (now.uvs[v], now.materials[v], now.rows[v]);
        }
        for t in self.triangles.iter().map(|&t| t as usize) {
            copy.triangles[t] = now.triangles[t];
        }
        for v in self.fans.iter().map(|&v| v as usize) {
            copy.fans.set(v, now.fans.at(v));
        }
        copy.fans.tidy();
    }

    /// The triangles that have other corners, or corners that may lie elsewhere, ascending.
    pub fn moved(&self, now: &Surface) -> Vec<u32> {
        let around = self.vertices.iter().flat_map(|&v| now.triangles_at(v as usize));
        let mut moved: Vec<u32> = self.triangles.iter().chain(around).copied().collect();
        moved.sort_unstable();
        moved.dedup();
        moved
    }
}

/// The numbers that things of a cut surface have as they are drawn.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// Of vertices on the outer surface and on walls; [`NONE`] where they are not there.
    numbers: [Vec<u32>; 2],
    /// The vertex that each number is of, and the list that it is there in.
    vertices: Vec<(u32, List)>,
    /// Numbers that are free.
    free: Vec<u32>,
    /// Vertices of the original surface, whose numbers are theirs for ever.
    own: usize,
    /// Whether a vertex hangs on a node without tissue.
    is_lost: Vec<bool>,
    /// Where walls begin once something has changed.
    first_wall: usize,
}

impl Drawn {
    /// A surface of which nothing is cut, drawn as it is. `room` is for so many vertices and triangles.
    pub fn uncut(surface: &Surface, room: [usize; 2]) -> Self {
        let own = surface.positions.len();
        let mut drawn = Self {
            numbers: [(0..own as u32).collect(), vec![NONE; own]],
            vertices: (0..own as u32).map(|v| (v, List::Outer)).collect(),
            free: Vec::new(),
            own,
            is_lost: vec![false; own],
            first_wall: first_wall(surface.triangles.len(), 0, room[1]),
        };
        drawn.numbers.iter_mut().for_each(|numbers| grow(numbers, room[0]));
        grow(&mut drawn.vertices, room[0]);
        grow(&mut drawn.is_lost, room[0]);
        drawn
    }

    /// Draws all of a cut surface, of which the first `own` vertices are the original's. Fails where there is no room.
    pub fn new(cut: &CutSurface, own: usize, drawing: Drawing<'_>) -> Result<(Self, Surface)> {
        let is_lost = cut.rows.iter().map(|row| drawing.is_lost(row)).collect();
        let mut drawn = Self {
            numbers: [(0..own as u32).collect(), vec![NONE; own]],
            vertices: (0..own as u32).map(|v| (v, List::Outer)).collect(),
            free: Vec::new(),
            own,
            is_lost,
            first_wall: first_wall(cut.triangles.len(), cut.walls.len(), drawing.room[1]),
        };
        let first_wall = drawn.first_wall;
        let mut triangles = Vec::with_capacity(first_wall + cut.walls.len());
        triangles.extend(cut.triangles.iter().map(|corners| drawn.number(List::Outer, corners)));
        triangles.resize(first_wall, GONE);
        triangles.extend(cut.walls.iter().map(|corners| drawn.number(List::Walls, corners)));
        drawing.check(drawn.vertices.len(), triangles.len())?;
        let all = || drawn.vertices.iter().map(|&(v, list)| (v as usize, list));
        let mesh = TriangleMesh {
            positions: all().map(|(v, _)| cut.positions[v]).collect(),
            uvs: all().map(|(v, list)| uv(cut, v, list, drawing.cell_m)).collect(),
            triangles,
        };
        let rows = all().map(|(v, _)| cut.rows[v]).collect();
        let materials = all().map(|(v, _)| cut.materials[v]).collect();
        let surface = Surface::bound(mesh, rows, materials)?;
        Ok((drawn, Surface { first_wall, ..surface }))
    }

    /// Has `surface`, as this has drawn it, follow a change of the cut surface. Nothing is done, and `None` is the answer, where all has to be drawn anew. Fails where there is no room; nothing
    /// is done then either.
    pub fn follow(
        &mut self,
        cut: &CutSurface,
        change: &SurfaceChange,
        drawing: Drawing<'_>,
        surface: &mut Surface,
    ) -> Result<Option<Redrawn>> {
        let is_within = |all: &[u32], count: usize| all.last().is_none_or(|&n| (n as usize) < count);
        if cut.triangles.len() > self.first_wall
            || !is_within(&change.vertices, cut.positions.len())
            || !is_within(&change.triangles, cut.triangles.len())
            || !is_within(&change.walls, cut.walls.len())
        {
            return Ok(None);
        }
        let before = self.is_lost.len();
        let is_lost = |v: u32| drawing.is_lost(&cut.rows[v as usize]);
        if change.vertices.iter().any(|&v| (v as usize) < before && self.is_lost[v as usize] != is_lost(v)) {
            return Ok(None);
        }
        let changed = || {
            let outer = change.triangles.iter().map(|&t| (List::Outer, t, cut.triangles[t as usize]));
            outer.chain(change.walls.iter().map(|&w| (List::Walls, w, cut.walls[w as usize])))
        };
        let corners = changed().filter(|(.., corners)| is_there(corners));
        let corners = corners.flat_map(|(list, _, corners)| corners.map(|v| (v, list)));
        let new: BTreeSet<(u32, List)> =
            corners.filter(|&(v, list)| self.number_of(v, list) == NONE && !is_lost(v)).collect();
        let vertices = self.vertices.len() + new.len().saturating_sub(self.free.len());
        drawing.check(vertices, self.first_wall + cut.walls.len())?;

        self.is_lost.resize(cut.rows.len(), false);
        for &v in &change.vertices {
            self.is_lost[v as usize] = is_lost(v);
        }
        let mut redrawn = Redrawn::default();
        let mut fans: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        surface.first_wall = self.first_wall;
        surface.triangles.resize(self.first_wall + cut.walls.len(), GONE);
        for (list, n, corners) in changed() {
            let t = n + if list == List::Walls { surface.first_wall as u32 } else { 0 };
            let now = self.number(list, &corners);
            let then = std::mem::replace(&mut surface.triangles[t as usize], now);
            for v in [then, now].into_iter().filter(is_there).flatten() {
                fans.entry(v).or_default().insert(t);
            }
            if then != now {
                redrawn.triangles.push(t);
            }
        }
        self.make_room(surface);
        let numbers_of = |&v: &u32| [List::Outer, List::Walls].map(|list| self.number_of(v, list));
        let numbers = change.vertices.iter().flat_map(numbers_of);
        let numbers = numbers.chain(new.iter().map(|&(v, list)| self.number_of(v, list)));
        redrawn.vertices = numbers.filter(|&n| n != NONE).collect();
        redrawn.vertices.sort_unstable();
        redrawn.vertices.dedup();
        for n in redrawn.vertices.iter().map(|&n| n as usize) {
            let (v, list) = self.vertices[n];
            let v = v as usize;
            surface.positions[n] = cut.positions[v];
            surface.uvs[n] = uv(cut, v, list, drawing.cell_m);
            (surface.materials[n], surface.rows[n]) = (cut.materials[v], cut.rows[v]);
        }
        for (&v, touched) in &fans {
            let names = |t: u32| surface.triangles[t as usize].iter().filter(|&&corner| corner == v).count();
            let kept = surface.triangles_at(v as usize).iter().filter(|t| !touched.contains(t));
            let come = touched.iter().flat_map(|&t| std::iter::repeat_n(t, names(t)));
            let mut all: Vec<u32> = kept.copied().chain(come).collect();
            all.sort_unstable();
            surface.fans.set(v as usize, &all);
            if all.is_empty() {
                self.release(v);
            }
        }
        redrawn.fans = fans.into_keys().collect();
        redrawn.is_tidied = surface.fans.tidy();
        Ok(Some(redrawn))
    }

    /// The number of a vertex of a list; [`NONE`] where it has none.
    fn number_of(&self, v: u32, list: List) -> u32 {
        self.numbers[list as usize].get(v as usize).copied().unwrap_or(NONE)
    }

    /// A triangle of a list as it is drawn; vertices that are new there get their numbers.
    fn number(&mut self, list: List, corners: &[u32; 3]) -> [u32; 3] {
        if !is_there(corners) || corners.iter().any(|&v| self.is_lost[v as usize]) {
            return GONE;
        }
        corners.map(|v| {
            let numbers = &mut self.numbers[list as usize];
            if numbers.len() <= v as usize {
                numbers.resize(v as usize + 1, NONE);
            }
            let number = &mut numbers[v as usize];
            if *number == NONE {
                *number = self.free.pop().unwrap_or(self.vertices.len() as u32);
                if *number as usize == self.vertices.len() {
                    self.vertices.push((v, list));
                }
                self.vertices[*number as usize] = (v, list);
            }
            *number
        })
    }

    /// Lets the number of a vertex that no triangle names be given again.
    fn release(&mut self, number: u32) {
        let (v, list) = self.vertices[number as usize];
        if number as usize >= self.own {
            self.numbers[list as usize][v as usize] = NONE;
            self.free.push(number);
        }
    }

    /// Room for all vertices.
    fn make_room(&self, surface: &mut Surface) {
        let count = self.vertices.len();
        surface.positions.resize_with(count, Default::default);
        surface.uvs.resize(count, [0.0; 2]);
        surface.materials.resize(count, 0);
        surface.rows.resize(count, surface.rows[0]);
        surface.fans.resize(count);
    }
}

/// Where walls begin behind so many triangles of the outer surface, where there is room for `most` triangles together.
fn first_wall(outer: usize, walls: usize, most: usize) -> usize {
    let spare = (outer / SPARE).max(LEAST_SPARE);
    outer + spare.min(most.saturating_sub(outer + walls))
}

/// Texture coordinates of a vertex in a list; on walls in m.
fn uv(cut: &CutSurface, v: usize, list: List, cell_m: f64) -> [f32; 2] {
    match list {
        List::Outer => cut.uvs[v],
        List::Walls => cut.wall_uvs[v].map(|x| (f64::from(x) * cell_m) as f32),
    }
}
