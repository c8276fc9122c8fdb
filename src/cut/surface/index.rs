//! Where the original surface is in the grid.

use super::arrange::bounds;
use super::grid::GridNode;
use crate::math::Vec3;
use crate::model::surface::Surface;

/// Farther than a cell's walls reach beyond it for the jitter, in cells.
pub const MARGIN: f64 = 1e-6;

/// The lowest and highest cells that a box (m) touches, by next to nothing too.
pub fn cells_in(low: &Vec3, high: &Vec3, cell_m: f64) -> [GridNode; 2] {
    [low.map(|x| (x / cell_m - MARGIN).floor() as i32), high.map(|x| (x / cell_m + MARGIN).floor() as i32)]
        .map(Into::into)
}

/// All cells from the lowest to the highest.
pub fn cells_between([low, high]: [GridNode; 2]) -> impl Iterator<Item = GridNode> {
    (low[2]..=high[2])
        .flat_map(move |k| (low[1]..=high[1]).flat_map(move |j| (low[0]..=high[0]).map(move |i| [i, j, k])))
}

/// Numbers by the cells that they are in.
#[derive(Debug)]
struct ByCell(Vec<(u64, u32)>);

/// A cell as a number by which cells of a row along x follow each other: lattices have less than 2¹⁹ cells along an axis, and surfaces end a few cells beside them.
fn key(cell: GridNode) -> u64 {
    cell.iter().rev().fold(0, |key, &x| key << 21 | (i64::from(x) + (1 << 20)) as u64)
}

impl ByCell {
    fn new(boxes: impl Iterator<Item = (Vec3, Vec3)>, cell_m: f64) -> Self {
        let mut all = Vec::new();
        for (n, (low, high)) in boxes.enumerate() {
            all.extend(cells_between(cells_in(&low, &high, cell_m)).map(|cell| (key(cell), n as u32)));
        }
        all.sort_unstable();
        Self(all)
    }

    /// What is in a row of cells along x.
    fn between(&self, first: GridNode, last: GridNode) -> impl Iterator<Item = u32> + '_ {
        let (first, last) = (key(first), key(last));
        let start = self.0.partition_point(|&(key, _)| key < first);
        self.0[start..].iter().take_while(move |&&(key, _)| key <= last).map(|&(_, n)| n)
    }
}

/// A surface's triangles and vertices by the cells that they are in, and its vertices by what they hang on.
#[derive(Debug)]
pub struct Index {
    triangles: ByCell,
    vertices: ByCell,
    by_host: Vec<(u32, u32)>,
    last_x: i32,
}

impl Index {
    /// Of a surface in a grid of cells of a size.
    pub fn new(surface: &Surface, cell_m: f64) -> Self {
        let place = |v: u32| surface.positions[v as usize];
        let mut by_host: Vec<(u32, u32)> =
            surface.rows.iter().enumerate().map(|(v, row)| (row.nodes[0], v as u32)).collect();
        by_host.sort_unstable();
        let farthest = surface.positions.iter().map(|at| at.x).fold(0.0, f64::max);
        Self {
            triangles: ByCell::new(surface.triangles.iter().map(|t| bounds(t.map(place))), cell_m),
            vertices: ByCell::new(surface.positions.iter().map(|at| (*at, *at)), cell_m),
            by_host,
            last_x: (farthest / cell_m) as i32 + 1,
        }
    }

    /// The triangles that touch any of some cells, ascending.
    pub fn triangles_at(&self, cells: &[GridNode]) -> Vec<u32> {
        sorted(cells.iter().flat_map(|&cell| self.triangles.between(cell, cell)).collect())
    }

    /// The triangles that a ray from a cell along x may meet, ascending.
    pub fn triangles_along(&self, cell: GridNode) -> Vec<u32> {
        let last = [self.last_x.max(cell[0]), cell[1], cell[2]];
        sorted(self.triangles.between(cell, last).collect())
    }

    /// The vertices in a cell.
    pub fn vertices_in(&self, cell: GridNode) -> impl Iterator<Item = u32> + '_ {
        self.vertices.between(cell, cell)
    }

    /// The vertices that hang on an undivided cell, by the slot of its lowest corner.
    pub fn vertices_on(&self, host: u32) -> impl Iterator<Item = u32> + '_ {
        let start = self.by_host.partition_point(|&(slot, _)| slot < host);
        self.by_host[start..].iter().take_while(move |&&(slot, _)| slot == host).map(|&(_, v)| v)
    }
}

fn sorted(mut numbers: Vec<u32>) -> Vec<u32> {
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}
