//! The surface of a body that has been cut: split along the cut, and closed by walls on both of its sides.
//!
//! Walls run through the divided cells, and through empty cells beside them as far as the surface bulges (see [`grid`]). Where they meet the original
//! closed surface its triangles are split; what of them is inside of it becomes two sheets, one for each side, which share their vertices with the surface on that side and, at the front of a
//! cut that goes on, with each other. The result is closed again: every edge of a triangle lies against one of another. All that is decided exactly,
//! on points that are moved by up to 10⁻⁷ of a cell so that there are no ties, and vertices are told apart by what they are, not by where they are.
//!
//! What a triangle is divided into depends only on what meets it, and what is joined at an edge or a point only on the parts there. So a cut that goes on is
//! followed where it is: [`CutSurface::update`] looks at the cells whose walls are new, at the triangles that touch them and at the points and edges of their parts. Made anew, the
//! surface is the same but for its numbers.

use std::collections::HashMap;
use std::sync::Arc;

use crate::cut::topology::{Change, Topology};
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::lattice::Lattice;
use crate::model::surface::{Row, Surface, grow};

use arrange::{Scene, arrange};
use glue::{Joint, Mesh, Part};
use grid::{Grid, GridEdge, Touched};
use hash::Map;
use index::Index;
use inside::inside;
use jitter::Tie;
use points::Points;
pub use reach::reach;
use unroll::unroll;
use walls::{Replaced, Walls};

mod arrange;
mod divide;
pub mod drawn;
mod glue;
pub mod grid;
mod groups;
mod hang;
mod hash;
mod index;
mod inside;
mod jitter;
mod numbers;
mod parents;
mod points;
mod reach;
mod show;
mod store;
mod unroll;
mod walls;
mod wholes;

/// Vertices of walls for each copy of a node: a cut through the middle of cells has nine for each cell, and two copies.
const WALL_VERTICES: usize = 8;
/// How many ways of breaking ties are tried.
const ATTEMPTS: u64 = 8;

/// A surface along which cuts have been made.
///
/// Vertices and triangles keep their numbers as long as they are there. A number that is free is given again to what is new; until then a vertex keeps what it had and no
/// triangle names it, and a triangle is `[0, 0, 0]`.
#[derive(Clone, Debug)]
pub struct CutSurface {
    /// Rest positions `[vertex_count]`, model frame, metres: those of the original, and then the new ones.
    pub positions: Vec<Vec3>,
    /// Vertex indices of the outer surface's triangles, counter-clockwise seen from outside. A triangle that no wall meets has its number in the original; of the parts of another one at most
    /// one has that number.
    pub triangles: Vec<[u32; 3]>,
    /// Vertex indices of the walls' triangles, counter-clockwise seen from the cut.
    pub walls: Vec<[u32; 3]>,
    /// Texture coordinates of the outer surface `[vertex_count]`: between those of the original; 0 where only walls are.
    pub uvs: Vec<[f32; 2]>,
    /// Texture coordinates of walls `[vertex_count]`, in cells: lengths along the wall, from where the cut began. 0 where there is no wall.
    pub wall_uvs: Vec<[f32; 2]>,
    /// Material index of the tissue under each vertex `[vertex_count]`, 1 to 15.
    pub materials: Vec<u8>,
    /// The nodes that move each vertex `[vertex_count]`, each on the pieces of its side.
    pub rows: Vec<Row>,
    state: State,
}

/// Numbers of what an update has changed, ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SurfaceChange {
    /// Vertices that are new, or of which anything has changed.
    pub vertices: Vec<u32>,
    /// Triangles of the outer surface that are new, gone or have other vertices.
    pub triangles: Vec<u32>,
    /// Triangles of walls that are new, gone or have other vertices.
    pub walls: Vec<u32>,
    /// How many cells, triangles, points and vertices were looked at, and nodes that belong to others now: what the update took, but for the search of a way around the cut.
    pub looked_at: usize,
}

impl SurfaceChange {
    /// Whether nothing has changed.
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty() && self.triangles.is_empty() && self.walls.is_empty()
    }
}

/// What is known of a surface besides what is shown of it.
#[derive(Clone, Debug)]
struct State {
    index: Arc<Index>,
    grid: Grid,
    walls: Walls,
    points: Points,
    mesh: Mesh,
    /// The cell that each vertex hangs on, by the slot of its lowest corner; [`store::NONE`] where it hangs as it did on the original.
    hosts: Vec<u32>,
    hosted: Map<u32, Vec<u32>>,
    /// Numbers of triangles that are free: of the outer surface and of walls.
    free: [Vec<u32>; 2],
    /// The way in which ties are broken.
    seed: u64,
    /// Whether a cut could not be followed.
    is_behind: bool,
}

/// A body: a surface, its lattice and what cuts have made of that.
#[derive(Clone, Copy, Debug)]
struct Body<'a> {
    surface: &'a Surface,
    lattice: &'a Lattice,
    topology: &'a Topology,
}

impl CutSurface {
    /// Of a closed surface, along all cuts of a lattice. `beyond` are the edges outside of all tissue that a blade has crossed, and where, as shares of their lengths.
    ///
    /// Fails when the surface is not closed where it is cut, or passes through itself there.
    pub fn new(
        surface: &Surface,
        lattice: &Lattice,
        topology: &Topology,
        beyond: &HashMap<GridEdge, f64>,
    ) -> Result<Self> {
        let beyond = beyond.iter().map(|(&edge, &at)| (edge, at)).collect();
        Self::anew(Body { surface, lattice, topology }, beyond)
    }

    /// Follows a cut: `change` is what it did to the topology, and `beyond` which edges outside of all tissue a blade has crossed by then, and where; those that were known stay as they were. A change is to be told also where it divides no cell.
    /// Surface and lattice are those that the surface was made of.
    ///
    /// Takes time by what is new. All is made anew where that is the only way to break a tie.
    ///
    /// Fails when the surface is not closed where it is cut, or passes through itself there. It stays as it was then, and the next update tries again.
    pub fn update(
        &mut self,
        surface: &Surface,
        lattice: &Lattice,
        topology: &Topology,
        change: &Change,
        beyond: impl IntoIterator<Item = (GridEdge, f64)>,
    ) -> Result<SurfaceChange> {
        let body = Body { surface, lattice, topology };
        let crossed = self.state.grid.cross(beyond);
        if !self.state.is_behind
            && let Ok(changed) = self.follow(body, change, &crossed)
        {
            return Ok(changed);
        }
        self.state.is_behind = true;
        let before = [self.positions.len(), self.triangles.len(), self.walls.len()];
        *self = Self::anew(body, self.state.grid.beyond().collect())?;
        let now = [self.positions.len(), self.triangles.len(), self.walls.len()];
        let [vertices, triangles, walls] =
            [0, 1, 2].map(|n| (0..before[n].max(now[n]) as u32).collect::<Vec<u32>>());
        let looked_at = now.iter().sum();
        Ok(SurfaceChange { vertices, triangles, walls, looked_at })
    }

    /// Makes room for so many vertices and triangles, so that what is added moves nothing.
    pub fn reserve(&mut self, [vertices, triangles]: [usize; 2]) {
        grow(&mut self.positions, vertices);
        grow(&mut self.uvs, vertices);
        grow(&mut self.wall_uvs, vertices);
        grow(&mut self.materials, vertices);
        grow(&mut self.rows, vertices);
        grow(&mut self.state.hosts, vertices);
        grow(&mut self.triangles, triangles);
        grow(&mut self.walls, triangles.saturating_sub(self.triangles.len()));
    }

    fn anew(body: Body<'_>, mut beyond: Vec<(GridEdge, f64)>) -> Result<Self> {
        beyond.sort_by_key(|&(edge, _)| edge);
        let change = body.topology.everything();
        let index = Arc::new(Index::new(body.surface, body.lattice.cell_m()));
        let reach = reach(body.surface, body.lattice);
        for seed in 0..ATTEMPTS {
            let grid = Grid::new(body.lattice, &change.edges, reach);
            let mut cut = Self::uncut(body.surface, grid, index.clone(), seed);
            let crossed = cut.state.grid.cross(beyond.iter().copied());
            if cut.follow(body, &change, &crossed).is_ok() {
                return Ok(cut);
            }
        }
        Err(Error::argument("the surface is not closed where it is cut, or passes through itself there"))
    }

    /// What shows no cut as yet; those that the grid has are to come.
    fn uncut(surface: &Surface, grid: Grid, index: Arc<Index>, seed: u64) -> Self {
        let count = surface.positions.len();
        Self {
            positions: surface.positions.clone(),
            triangles: surface.triangles.clone(),
            walls: Vec::new(),
            uvs: surface.uvs.clone(),
            wall_uvs: vec![[0.0; 2]; count],
            materials: surface.materials.clone(),
            rows: surface.rows.clone(),
            state: State {
                index,
                grid,
                walls: Walls::default(),
                points: Points::default(),
                mesh: Mesh::new(count as u32),
                hosts: vec![store::NONE; count],
                hosted: Map::default(),
                free: [Vec::new(), Vec::new()],
                seed,
                is_behind: false,
            },
        }
    }

    fn follow(
        &mut self,
        body: Body<'_>,
        change: &Change,
        crossed: &[GridEdge],
    ) -> Result<SurfaceChange, Tie> {
        let Body { surface, lattice, topology } = body;
        let cell_m = lattice.cell_m();
        let State { index, grid, walls, points, mesh, seed, .. } = &mut self.state;
        let touched = grid.update(lattice, topology, change, crossed);
        let cells = touched.cells.iter().map(|&at| (at, grid.divided(lattice, topology, at))).collect();
        let replaced = walls.replace(cells, cell_m, *seed);
        unroll(walls, &replaced.added, cell_m);

        let mut joint = Joint::default();
        for &w in &replaced.removed {
            for side in 0..2 {
                mesh.remove_part(points, Part::Wall((w, side)), &mut joint);
            }
        }
        let outer = index.triangles_at(&replaced.cells);
        let scene = Scene { surface, walls, cell_m, seed: *seed };
        let arrangement = arrange(scene, points, &outer, &replaced.added)?;
        let is_inside = inside(scene, index, &arrangement, |edge| mesh.has_sheet_at(points, edge))?;
        for &t in &outer {
            let parts = arrangement.outer.get(&t).map_or(&[][..], Vec::as_slice);
            mesh.divide(points, t, parts, &mut joint);
        }
        for (&(w, [a, b, c]), _) in arrangement.walls.iter().zip(is_inside).filter(|(_, inside)| *inside) {
            mesh.add(points, [a, c, b], Part::Wall((w, 0)), [false; 3], &mut joint);
            mesh.add(points, [a, b, c], Part::Wall((w, 1)), [false; 3], &mut joint);
        }
        mesh.join(points, walls, &mut joint)?;
        let mut changed = self.show(body, change, &touched, &replaced, &joint, &outer)?;
        changed.looked_at +=
            touched.cells.len() + touched.nodes.len() + outer.len() + joint.faces.len() + joint.points.len();
        self.state.settle(&joint);
        Ok(changed)
    }
}

impl State {
    /// Lets numbers of what is gone be given again.
    fn settle(&mut self, joint: &Joint) {
        self.points.drop_unused(&joint.points);
        self.mesh.settle();
        self.walls.settle();
    }
}

/// Most vertices and triangles of a surface that cuts make, where there is room for so many copies of nodes: twice its own, for each of its vertices may come to lie on either side of
/// one, and what walls take besides.
pub fn room(surface: &Surface, copies: usize) -> [usize; 2] {
    let vertices = 2 * surface.positions.len() + WALL_VERTICES * copies;
    [vertices, 2 * surface.triangles.len() + 2 * WALL_VERTICES * copies]
}

#[cfg(test)]
mod tests;
