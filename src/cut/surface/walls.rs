//! The walls of all divided cells as one complex: triangles that share points and edges.

use super::arrange::bounds;
use super::grid::{GridCell, GridNode, corner_node};
use super::hash::{Map, Set};
use super::index::{cells_between, cells_in};
use super::jitter::jitter;
use super::store::Store;
use super::unroll::Chart;
use crate::cut::cell::{EDGES, Place};
use crate::math::Vec3;

/// A triangle of a wall: its corners are the crossing of an edge, a point on a face and one inside, counter-clockwise seen from the first of the pieces that it parts.
#[derive(Clone, Debug)]
pub struct WallTriangle {
    /// Its cell.
    pub cell: GridNode,
    /// Numbers of its corners.
    pub corners: [u32; 3],
    /// The corners of its cell that the pieces on its front and behind it have, a bit for each.
    pub pieces: [u8; 2],
    /// Where in its cell it is.
    pub place: Place,
    /// The node of the grid, at the edge that it crosses, which it faces.
    pub faces: GridNode,
    /// Lowest and highest coordinates where decisions take it to be, m.
    pub bounds: (Vec3, Vec3),
}

/// A point of walls.
#[derive(Clone, Debug)]
pub struct WallPoint {
    /// Where it is at rest, m.
    pub at: Vec3,
    /// Where decisions take it to be: beside that by next to nothing.
    pub beside: Vec3,
    /// Its texture coordinates, where it has them.
    pub chart: Option<Chart>,
    feature: Feature,
    uses: u32,
}

impl WallPoint {
    /// Its texture coordinates.
    pub fn uv(&self) -> [f32; 2] {
        self.chart.map_or([0.0; 2], |chart| chart.uv())
    }
}

/// The walls of a grid.
#[derive(Clone, Debug, Default)]
pub struct Walls {
    /// Their points.
    pub points: Store<WallPoint>,
    /// Their triangles.
    pub triangles: Store<WallTriangle>,
    cells: Map<GridNode, (GridCell, Vec<u32>)>,
    index: Map<Feature, u32>,
}

/// What has become of walls.
#[derive(Debug, Default)]
pub struct Replaced {
    /// The cells whose walls are others now, ascending.
    pub cells: Vec<GridNode>,
    /// Triangles that were removed; no others have their numbers as yet.
    pub removed: Vec<u32>,
    /// Triangles that were added.
    pub added: Vec<u32>,
    /// Points that no wall has now.
    pub lost: Vec<u32>,
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
    /// Puts walls in the place of those of some cells, of size `cell_m`.
    pub fn replace(&mut self, cells: Vec<(GridNode, Option<GridCell>)>, cell_m: f64, seed: u64) -> Replaced {
        let mut replaced = Replaced::default();
        let mut released: Set<u32> = Set::default();
        let is_new = |(at, cell): &(GridNode, Option<GridCell>)| {
            self.cells.get(at).map(|(before, _)| before) != cell.as_ref()
        };
        let cells: Vec<_> = cells.into_iter().filter(is_new).collect();
        for (at, _) in &cells {
            replaced.cells.push(*at);
            let Some((_, triangles)) = self.cells.remove(at) else { continue };
            for w in triangles {
                for point in self.triangles.remove(w).corners {
                    self.points[point].uses -= 1;
                    released.insert(point);
                }
                replaced.removed.push(w);
            }
        }
        for (at, cell) in cells {
            let Some(cell) = cell else { continue };
            let first = replaced.added.len();
            for wall in &cell.walls {
                let of = features(at, &wall.place);
                let low = Vec3::from(at.map(f64::from));
                let corners: [u32; 3] = std::array::from_fn(|c| {
                    self.point(of[c], (low + wall.corners[c]) * cell_m, cell_m, seed)
                });
                let bounds = bounds(corners.map(|point| self.points[point].beside));
                let pieces = wall.pieces.map(|piece| cell.pieces[piece]);
                let (place, faces) = (wall.place, corner_node(at, wall.place.corner));
                let triangle = WallTriangle { cell: at, corners, pieces, place, faces, bounds };
                replaced.added.push(self.triangles.insert(triangle));
            }
            let added = replaced.added[first..].to_vec();
            self.cells.insert(at, (cell, added));
        }
        replaced.lost = released.into_iter().filter(|&point| self.points[point].uses == 0).collect();
        for &point in &replaced.lost {
            let feature = self.points.remove(point).feature;
            if self.index.get(&feature) == Some(&point) {
                self.index.remove(&feature);
            }
        }
        replaced
    }

    /// One more use of the point on a feature. Where it is elsewhere now it is another point: nothing is left then that has the old one.
    fn point(&mut self, feature: Feature, at: Vec3, cell_m: f64, seed: u64) -> u32 {
        let known = self.index.get(&feature).copied().filter(|&point| self.points[point].at == at);
        let point = known.unwrap_or_else(|| {
            let [x, y, z] = feature.0.map(i64::from);
            let beside = at + jitter([x, y, z, feature.1 as i64], seed) * cell_m;
            let new = self.points.insert(WallPoint { at, beside, chart: None, feature, uses: 0 });
            self.index.insert(feature, new);
            new
        });
        self.points[point].uses += 1;
        point
    }

    /// The triangles in a cell.
    pub fn in_cell(&self, cell: GridNode) -> &[u32] {
        self.cells.get(&cell).map_or(&[], |(_, triangles)| triangles)
    }

    /// Where decisions take a triangle's corners to be.
    pub fn beside(&self, w: u32) -> [Vec3; 3] {
        self.triangles[w].corners.map(|point| self.points[point].beside)
    }

    /// The triangles in the cells that a box (m) touches, among them all that reach into it.
    pub fn near(&self, low: &Vec3, high: &Vec3, cell_m: f64) -> impl Iterator<Item = u32> + '_ {
        cells_between(cells_in(low, high, cell_m)).flat_map(|cell| self.in_cell(cell)).copied()
    }

    /// Lets numbers of what has been removed be given again.
    pub fn settle(&mut self) {
        self.points.settle();
        self.triangles.settle();
    }
}
