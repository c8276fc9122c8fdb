//! The walls of all divided cells as one complex: triangles that share points and edges.

use std::collections::HashMap;
use std::ops::Range;

use super::grid::{GridCell, GridNode, corner_node};
use super::jitter::jitter;
use crate::cut::cell::{EDGES, Place};
use crate::math::Vec3;

/// Farther than a cell's walls reach beyond it for the jitter, in cells.
const MARGIN: f64 = 1e-6;

/// A triangle of a wall: its corners are the crossing of an edge, a point on a face and one inside, counter-clockwise seen from the first of the pieces that it parts.
pub struct WallTriangle {
    /// Index of its cell in [`Walls::cells`].
    pub cell: u32,
    /// Indices of its corners.
    pub corners: [u32; 3],
    /// The pieces of its cell on its front and behind it.
    pub pieces: [usize; 2],
    /// Where in its cell it is.
    pub place: Place,
    /// The node of the grid, at the edge that it crosses, which it faces.
    pub faces: GridNode,
}

/// The walls of a grid.
pub struct Walls {
    /// The divided cells.
    pub cells: Vec<GridCell>,
    /// Where points are at rest, m.
    pub points: Vec<Vec3>,
    /// Where decisions take them to be: beside that by next to nothing.
    pub beside: Vec<Vec3>,
    /// The triangles, those of a cell together.
    pub triangles: Vec<WallTriangle>,
    /// The triangles of each divided cell, by its lowest node.
    pub of_cell: HashMap<GridNode, Range<usize>>,
}

/// What a point lies on, as twice its coordinates in the grid if it were in the middle of that, and which of the points in a cell it is.
type Feature = ([i32; 3], usize);

fn features(cell: GridNode, place: &Place) -> [Feature; 3] {
    let middle = cell.map(|x| 2 * x + 1);
    let axis = EDGES[place.edge].axis;
    let mut edge = corner_node(cell, EDGES[place.edge].low).map(|x| 2 * x);
    edge[axis] += 1;
    let mut face = middle;
    face[place.face / 2] += 2 * (place.face % 2) as i32 - 1;
    [(edge, 0), (face, 0), (middle, 1 + place.sheet)]
}

impl Walls {
    /// Of divided cells of size `cell_m`.
    pub fn new(cells: Vec<GridCell>, cell_m: f64, seed: u64) -> Self {
        let mut walls = Self {
            cells: Vec::new(),
            points: Vec::new(),
            beside: Vec::new(),
            triangles: Vec::new(),
            of_cell: HashMap::new(),
        };
        let mut index: HashMap<Feature, u32> = HashMap::new();
        for (n, cell) in cells.iter().enumerate() {
            let first = walls.triangles.len();
            let low = Vec3::from(cell.at.map(f64::from));
            for wall in &cell.walls {
                let of = features(cell.at, &wall.place);
                let corners = std::array::from_fn(|c| {
                    *index.entry(of[c]).or_insert_with(|| {
                        let at = (low + wall.corners[c]) * cell_m;
                        let [x, y, z] = of[c].0.map(i64::from);
                        walls.points.push(at);
                        walls.beside.push(at + jitter([x, y, z, of[c].1 as i64], seed) * cell_m);
                        walls.points.len() as u32 - 1
                    })
                });
                let faces = corner_node(cell.at, wall.place.corner);
                let (pieces, place) = (wall.pieces, wall.place);
                walls.triangles.push(WallTriangle { cell: n as u32, corners, pieces, place, faces });
            }
            walls.of_cell.insert(cell.at, first..walls.triangles.len());
        }
        walls.cells = cells;
        walls
    }

    /// The triangles in the cells that a box (m) touches, among them all that reach into it.
    pub fn near(&self, low: &Vec3, high: &Vec3, cell_m: f64) -> impl Iterator<Item = usize> + '_ {
        let first = low.map(|x| (x / cell_m - MARGIN).floor() as i32);
        let last = high.map(|x| (x / cell_m + MARGIN).floor() as i32);
        let cells = (first.z..=last.z).flat_map(move |k| {
            (first.y..=last.y).flat_map(move |j| (first.x..=last.x).map(move |i| [i, j, k]))
        });
        cells.filter_map(|cell| self.of_cell.get(&cell)).cloned().flatten()
    }
}
