//! How far from the tissue a surface is.

use super::arrange::bounds;
use super::grid::{GridNode, material, near};
use super::index::{MARGIN, cells_between, cells_in};
use crate::math::Vec3;
use crate::model::binding::HOST_REACH_CELLS;
use crate::model::lattice::Lattice;
use crate::model::surface::Surface;

/// How many cells beside the tissue a surface may reach into. Between its vertices it may be farther away than at any of them. What is farther than a vertex may be
/// does not count.
pub fn reach(surface: &Surface, lattice: &Lattice) -> usize {
    let cell_m = lattice.cell_m();
    let mut farthest = 0;
    for &corners in &surface.triangles {
        let triangle = corners.map(|v| surface.positions[v as usize]);
        let (low, high) = bounds(triangle);
        let triangle = triangle.map(|at| at / cell_m);
        for cell in cells_between(cells_in(&low, &high, cell_m)) {
            let is_farther = |far| !near(cell, far).any(|cell| material(lattice, cell) != 0);
            while i64::from(farthest) < HOST_REACH_CELLS && is_farther(farthest) && touches(triangle, cell) {
                farthest += 1;
            }
        }
    }
    1 + farthest as usize
}

/// Whether a triangle, in cells, touches a cell in the box around it, by next to nothing too.
fn touches(triangle: [Vec3; 3], cell: GridNode) -> bool {
    let middle = Vec3::from(cell.map(|x| f64::from(x) + 0.5));
    let corners = triangle.map(|at| at - middle);
    let [a, b, c] = corners;
    let across = [b - a, c - b, a - c]
        .into_iter()
        .flat_map(|edge| [0, 1, 2].map(|axis| Vec3::ith(axis, 1.0).cross(&edge)));
    // What is apart is so along the normal of a face, or across an edge of both.
    std::iter::once((b - a).cross(&(c - a))).chain(across).all(|axis| {
        let half = (0.5 + MARGIN) * axis.abs().sum();
        let along = corners.map(|at| axis.dot(&at));
        along.iter().any(|&x| x >= -half) && along.iter().any(|&x| x <= half)
    })
}
