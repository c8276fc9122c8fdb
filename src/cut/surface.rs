//! The surface of a body that has been cut: split along the cut, and closed by walls on both of its sides.
//!
//! Walls run through the divided cells, and through empty cells beside them as far as the surface bulges (see [`grid`]). Where they meet the original
//! closed surface its triangles are split; what of them is inside of it becomes two sheets, one for each side, which share their vertices with the surface on that side and, at the front of a
//! cut that goes on, with each other. The result is closed again: every edge of a triangle lies against one of another. All that is decided exactly,
//! on points that are moved by up to 10⁻⁷ of a cell so that there are no ties, and vertices are told apart by what they are, not by where they are.
//!
//! Everything is made anew from the original surface after each cut. What no wall meets keeps its numbers.

use std::collections::HashMap;

use crate::cut::topology::Topology;
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::lattice::Lattice;
use crate::model::surface::{Row, Surface};

use arrange::{Outer, arrange};
use glue::{Glued, Part, Place, glue};
use grid::{Grid, GridEdge};
use hang::Hanger;
use jitter::Tie;
use walls::Walls;

mod arrange;
mod divide;
mod glue;
pub mod grid;
mod groups;
mod hang;
mod jitter;
mod unroll;
mod walls;

/// How many ways of breaking ties are tried.
const ATTEMPTS: u64 = 8;

/// A surface along which cuts have been made.
#[derive(Clone, Debug)]
pub struct CutSurface {
    /// Rest positions `[vertex_count]`, model frame, metres: those of the original, and then the new ones.
    pub positions: Vec<Vec3>,
    /// Vertex indices of the outer surface's triangles, counter-clockwise seen from outside. A triangle that no wall meets keeps its number; a part of each other one has the number of what it is a part of.
    pub triangles: Vec<[u32; 3]>,
    /// Vertex indices of the walls' triangles, counter-clockwise seen from the cut.
    pub walls: Vec<[u32; 3]>,
    /// Texture coordinates of the outer surface `[vertex_count]`: between those of the original; 0 where only walls are.
    pub uvs: Vec<[f32; 2]>,
    /// Texture coordinates of walls `[vertex_count]`, in cells: lengths in the plane that a connected wall lies closest to. 0 where there is no wall.
    pub wall_uvs: Vec<[f32; 2]>,
    /// Material index of the tissue under each vertex `[vertex_count]`, 1 to 15.
    pub materials: Vec<u8>,
    /// The nodes that move each vertex `[vertex_count]`, each on the pieces of its side.
    pub rows: Vec<Row>,
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
        let grid = Grid::new(lattice, topology, beyond, reach(surface, lattice));
        for seed in 0..ATTEMPTS {
            if let Ok(cut) = cut(surface, lattice, topology, &grid, seed) {
                return Ok(cut);
            }
        }
        Err(Error::argument("the surface is not closed where it is cut, or passes through itself there"))
    }
}

/// How many cells beside the tissue a surface may reach into.
fn reach(surface: &Surface, lattice: &Lattice) -> usize {
    let farthest = surface.positions.iter().zip(&surface.rows).map(|(at, row)| {
        let local = (at - lattice.rest_position(row.nodes[0])) / lattice.cell_m();
        local.iter().map(|x| (x - 1.0).max(-x)).fold(0.0, f64::max)
    });
    1 + farthest.fold(0.0, f64::max).ceil() as usize
}

fn cut(
    surface: &Surface,
    lattice: &Lattice,
    topology: &Topology,
    grid: &Grid<'_>,
    seed: u64,
) -> Result<CutSurface, Tie> {
    let walls = Walls::new(grid.divided(), lattice.cell_m(), seed);
    let outer = Outer { positions: &surface.positions, triangles: &surface.triangles };
    let arrangement = arrange(&outer, &walls, lattice.cell_m(), seed)?;
    let old = surface.positions.len();
    let Glued { faces, vertices } = glue(&arrangement, &walls, old as u32)?;
    let hanger = Hanger { lattice, topology, grid, walls: &walls };

    let mut cut = CutSurface {
        positions: surface.positions.clone(),
        triangles: surface.triangles.clone(),
        walls: Vec::new(),
        uvs: surface.uvs.clone(),
        wall_uvs: Vec::new(),
        materials: surface.materials.clone(),
        rows: surface.rows.clone(),
    };
    for v in 0..old {
        if let Some((row, material)) = hanger.rehung(&surface.rows[v], surface.positions[v])? {
            (cut.rows[v], cut.materials[v]) = (row, material);
        }
    }
    for (place, (w, side)) in vertices {
        let (at, uv) = match place {
            Place::Middle(ends) => {
                let [a, b] = ends.map(|v| v as usize);
                let uv = [0, 1].map(|i| 0.5 * (cut.uvs[a][i] + cut.uvs[b][i]));
                (0.5 * (cut.positions[a] + cut.positions[b]), uv)
            }
            Place::Point(name) => match (name as usize).checked_sub(old + walls.points.len()) {
                None => (walls.points[name as usize - old], [0.0; 2]),
                Some(n) => {
                    let meeting = &arrangement.meetings[n];
                    let uv = [0, 1].map(|i| {
                        let parts = meeting.between.iter().zip(meeting.weights);
                        parts.map(|(&v, weight)| weight * f64::from(surface.uvs[v as usize][i])).sum::<f64>()
                            as f32
                    });
                    (meeting.at, uv)
                }
            },
        };
        let wall = &walls.triangles[w as usize];
        let (row, material) = hanger.on_piece(wall.cell, wall.pieces[side], at).ok_or(Tie)?;
        cut.positions.push(at);
        cut.uvs.push(uv);
        cut.rows.push(row);
        cut.materials.push(material);
    }
    let mut last = None;
    for (corners, part) in &faces {
        let Part::Outer(t) = part else { continue };
        // The first part of each triangle takes its place; one that was split afterwards may follow anywhere.
        if last < Some(*t) {
            last = Some(*t);
            cut.triangles[*t as usize] = *corners;
        } else {
            cut.triangles.push(*corners);
        }
    }
    cut.walls =
        faces.iter().filter(|(_, part)| matches!(part, Part::Wall(_))).map(|(corners, _)| *corners).collect();
    cut.wall_uvs = unroll::wall_uvs(&cut.positions, &cut.walls, lattice.cell_m());
    Ok(cut)
}

#[cfg(test)]
mod tests;
