//! Binding: which nodes carry a surface vertex, and with which weights.
//!
//! A vertex belongs to one *host* cell, the one that contains it or else the nearest one, and hangs on the
//! eight corners of that cell with trilinear weights. Outside the cell the same formula extrapolates: weights
//! may then be negative, but they still sum to one and still reproduce the vertex's position, so a rigid or
//! linear motion of the tissue moves the vertex exactly. Nothing is clamped.

use nalgebra as na;

use super::lattice::Lattice;
use super::surface::{ROW, Row};
use crate::error::{Error, Result};
use crate::math::Vec3;

/// How far a vertex may lie from the tissue that carries it, in cells. Extrapolation over more than a few
/// cells would swing the vertex about, and a mesh so far away was rarely meant for this tissue.
pub const HOST_REACH_CELLS: i64 = 3;

/// What binding needs to know of a lattice.
pub(crate) trait CellSpace {
    /// Edge length of a cell in metres.
    fn cell_m(&self) -> f64;
    /// Cells of the bounding grid along x, y, z.
    fn cells(&self) -> [usize; 3];
    /// Material of a cell, 0 where it is empty.
    fn cell_material(&self, cell: [usize; 3]) -> u8;
    /// The slot of a node, if it exists.
    fn slot(&self, node: [usize; 3]) -> Option<u32>;
}

impl CellSpace for Lattice {
    fn cell_m(&self) -> f64 {
        self.cell_m()
    }

    fn cells(&self) -> [usize; 3] {
        self.cells()
    }

    fn cell_material(&self, cell: [usize; 3]) -> u8 {
        self.cell_material(cell)
    }

    fn slot(&self, node: [usize; 3]) -> Option<u32> {
        self.slot(node)
    }
}

/// Rows and material indices `[vertex_count]` for vertices at `positions` (model frame, metres).
///
/// Cells for which `is_preferred` holds are taken as hosts before others, wherever one lies within reach.
/// Fails when a vertex lies more than [`HOST_REACH_CELLS`] cells from all tissue.
pub(crate) fn bind<S: CellSpace>(
    positions: &[Vec3],
    space: &S,
    is_preferred: impl Fn([usize; 3]) -> bool,
) -> Result<(Vec<Row>, Vec<u8>)> {
    let mut rows = Vec::with_capacity(positions.len());
    let mut materials = Vec::with_capacity(positions.len());

    for (vertex, position) in positions.iter().enumerate() {
        let point = position / space.cell_m();
        let host = nearest_cell(space, &point, &is_preferred)
            .or_else(|| nearest_cell(space, &point, &|_| true))
            .ok_or_else(|| too_far(space, vertex, position))?;
        rows.push(trilinear_row(space, host, &point)?);
        materials.push(space.cell_material(host));
    }
    Ok((rows, materials))
}

/// The occupied cell nearest to a point (given in cells), none beyond [`HOST_REACH_CELLS`]. Of equally near
/// ones it is the one in the innermost ring around the point, there the lowest.
fn nearest_cell<S: CellSpace>(
    space: &S,
    point: &Vec3,
    is_allowed: &impl Fn([usize; 3]) -> bool,
) -> Option<[usize; 3]> {
    let reach = HOST_REACH_CELLS as f64;
    let dims = space.cells();
    if (0..3).any(|a| point[a] < -reach || point[a] > dims[a] as f64 + reach) {
        return None;
    }

    // Rings of cells around the home cell, until no farther ring can hold a nearer cell.
    let home = point.map(|x| x.floor() as i64);
    let mut best: Option<(f64, [usize; 3])> = None;
    for ring in 0..=HOST_REACH_CELLS + 1 {
        if best.is_some_and(|(distance, _)| distance <= (ring - 1) as f64) {
            break;
        }
        for cell in ring_cells(home, ring) {
            let Some(cell) = inside_grid(cell, dims) else { continue };
            if space.cell_material(cell) == 0 || !is_allowed(cell) {
                continue;
            }
            let distance = distance_to_cell(cell, point);
            if distance <= reach && best.is_none_or(|(nearest, _)| distance < nearest) {
                best = Some((distance, cell));
            }
        }
    }
    best.map(|(_, cell)| cell)
}

/// The cells whose largest offset from `home` along an axis is `ring`, x fastest.
fn ring_cells(home: na::Vector3<i64>, ring: i64) -> impl Iterator<Item = [i64; 3]> {
    let side = move || -ring..=ring;
    side().flat_map(move |k| side().flat_map(move |j| side().map(move |i| [i, j, k]))).filter_map(
        move |offset| {
            let on_ring = offset.iter().any(|x| x.abs() == ring);
            on_ring.then(|| [home.x + offset[0], home.y + offset[1], home.z + offset[2]])
        },
    )
}

fn inside_grid(cell: [i64; 3], dims: [usize; 3]) -> Option<[usize; 3]> {
    let [i, j, k] = cell.map(|x| usize::try_from(x).ok());
    let cell = [i?, j?, k?];
    (0..3).all(|a| cell[a] < dims[a]).then_some(cell)
}

/// Distance from a point to the nearest point of a cell, all in cells.
fn distance_to_cell(cell: [usize; 3], point: &Vec3) -> f64 {
    let outside = |a: usize| {
        let low = cell[a] as f64;
        (low - point[a]).max(point[a] - (low + 1.0)).max(0.0)
    };
    Vec3::new(outside(0), outside(1), outside(2)).norm()
}

/// A point's row on the corners of a cell.
fn trilinear_row<S: CellSpace>(space: &S, cell: [usize; 3], point: &Vec3) -> Result<Row> {
    let mut nodes = [0; ROW];
    for (corner, slot) in nodes.iter_mut().enumerate() {
        let offset = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
        let node = [0, 1, 2].map(|a| cell[a] + offset[a]);
        *slot = space.slot(node).ok_or_else(|| {
            Error::argument(format!("cell {cell:?} is occupied but its corner {node:?} is missing"))
        })?;
    }
    Ok(trilinear(nodes, &(point - Vec3::from(cell.map(|x| x as f64)))))
}

/// Trilinear weights of a cell's corners at a point in it, from 0 to 1 along each axis.
pub(crate) fn shares(local: &Vec3) -> [f64; ROW] {
    std::array::from_fn(|corner| {
        let along = |a: usize| if corner >> a & 1 == 1 { local[a] } else { 1.0 - local[a] };
        along(0) * along(1) * along(2)
    })
}

/// The row on a cell's eight nodes of a point in it, from 0 to 1 along each axis: weights are rounded so that their sum stays one.
pub(crate) fn trilinear(nodes: [u32; ROW], local: &Vec3) -> Row {
    let mut weights = shares(local).map(|share| share as f32);
    // What rounding lost goes to the largest weight, where it changes the relative error least.
    let sum: f64 = weights.iter().map(|&w| f64::from(w)).sum();
    let largest = (1..ROW).fold(0, |best, n| if weights[n] > weights[best] { n } else { best });
    weights[largest] = (f64::from(weights[largest]) + 1.0 - sum) as f32;
    Row { nodes, weights }
}

/// The refusal of a vertex, with its distance from the nearest tissue.
fn too_far<S: CellSpace>(space: &S, vertex: usize, position: &Vec3) -> Error {
    let [nx, ny, nz] = space.cells();
    let (h, point) = (space.cell_m(), position / space.cell_m());
    let mut nearest = f64::INFINITY;
    for k in 0..nz {
        for j in 0..ny {
            for i in (0..nx).filter(|&i| space.cell_material([i, j, k]) != 0) {
                nearest = nearest.min(distance_to_cell([i, j, k], &point));
            }
        }
    }
    if nearest.is_infinite() {
        return Error::argument("a surface needs tissue to hang on, but every cell is empty");
    }
    Error::argument(format!(
        "vertex {vertex} of the mesh lies {:.4} m from the nearest tissue, more than {HOST_REACH_CELLS} \
         cells of {h} m: is the mesh in the same place and in metres?",
        nearest * h
    ))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A dense lattice: every node has a slot, its index.
    pub(crate) struct Dense {
        pub cells: [usize; 3],
        pub materials: Vec<u8>,
    }

    pub(crate) const H: f64 = 0.003;

    impl Dense {
        pub(crate) fn new(cells: [usize; 3], material: impl Fn([usize; 3]) -> u8) -> Self {
            let mut materials = Vec::new();
            for n in 0..cells.iter().product() {
                materials.push(material([n % cells[0], n / cells[0] % cells[1], n / (cells[0] * cells[1])]));
            }
            Self { cells, materials }
        }

        fn node_position(&self, slot: u32) -> Vec3 {
            let (n, nx, ny) = (slot as usize, self.cells[0] + 1, self.cells[1] + 1);
            Vec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / (nx * ny)) as f64) * H
        }
    }

    impl CellSpace for Dense {
        fn cell_m(&self) -> f64 {
            H
        }

        fn cells(&self) -> [usize; 3] {
            self.cells
        }

        fn cell_material(&self, cell: [usize; 3]) -> u8 {
            self.materials[cell[0] + self.cells[0] * (cell[1] + self.cells[1] * cell[2])]
        }

        fn slot(&self, node: [usize; 3]) -> Option<u32> {
            Some((node[0] + (self.cells[0] + 1) * (node[1] + (self.cells[1] + 1) * node[2])) as u32)
        }
    }

    /// Points spread evenly over a box, in cells.
    fn points(low: f64, high: f64, count: usize) -> Vec<Vec3> {
        let share = |n: usize, step: f64| low + (high - low) * (n as f64 * step).fract();
        (1..=count)
            .map(|n| Vec3::new(share(n, 0.754_877), share(n, 0.569_840), share(n, 0.430_160)) * H)
            .collect()
    }

    #[test]
    fn rows_sum_to_one_and_reproduce_positions_inside_and_outside_tissue() {
        let space = Dense::new([6, 7, 8], |_| 1);
        let positions = points(-1.5, 8.0, 2000);
        let (rows, _) = bind(&positions, &space, |_| true).unwrap();

        for (row, x) in rows.iter().zip(&positions) {
            let sum: f64 = row.weights.iter().map(|&w| f64::from(w)).sum();
            let largest = row.weights.iter().fold(0.0_f64, |m, &w| m.max(f64::from(w).abs()));
            // The corrected weight is rounded once: half an ulp, 2^-24 of itself.
            assert!((sum - 1.0).abs() <= largest * 2.0_f64.powi(-24), "sum {sum}");

            let moved: Vec3 =
                row.nodes.iter().zip(row.weights).map(|(&n, w)| space.node_position(n) * f64::from(w)).sum();
            // Eight rounded weights act over at most √3 cells, the corrected one once more.
            let bound = 9.0 * largest * 2.0_f64.powi(-24) * 1.733 * H + 0.03 * largest * 2.0_f64.powi(-24);
            assert!((moved - x).norm() <= bound, "off by {:e} m", (moved - x).norm());
        }
    }

    #[test]
    fn a_vertex_in_an_occupied_cell_takes_that_cell_and_its_material() {
        let space = Dense::new([4, 4, 4], |[i, j, k]| (1 + i + j + k) as u8);
        let positions = points(0.01, 3.99, 300);
        let (rows, materials) = bind(&positions, &space, |_| true).unwrap();
        for ((row, &material), x) in rows.iter().zip(&materials).zip(&positions) {
            let cell = (x / H).map(f64::floor);
            assert_eq!(f64::from(material), 1.0 + cell.sum());
            assert_eq!(space.node_position(row.nodes[0]), cell * H);
            assert!(row.weights.iter().all(|w| (0.0..=1.0).contains(w)));
        }
    }

    #[test]
    fn a_vertex_outside_takes_the_nearest_cell_also_across_a_diagonal() {
        // Two cells: one three steps along x, one a step along each of y and z, which is nearer.
        let space = Dense::new([6, 6, 6], |cell| match cell {
            [4, 1, 1] => 1,
            [1, 2, 2] => 2,
            _ => 0,
        });
        let (_, materials) = bind(&[Vec3::new(1.5, 1.5, 1.5) * H], &space, |_| true).unwrap();
        assert_eq!(materials, [2]);
    }

    #[test]
    fn brute_force_finds_no_nearer_cell() {
        let space = Dense::new([7, 7, 7], |[i, j, k]| u8::from((i * 31 + j * 17 + k * 7) % 23 == 0));
        let cells: Vec<[usize; 3]> = (0..343)
            .map(|n| [n % 7, n / 7 % 7, n / 49])
            .filter(|&cell| space.cell_material(cell) != 0)
            .collect();
        for point in points(-1.0, 8.0, 500).iter().map(|x| x / H) {
            let found = nearest_cell(&space, &point, &|_| true).map(|cell| distance_to_cell(cell, &point));
            let nearest =
                cells.iter().map(|&cell| distance_to_cell(cell, &point)).fold(f64::INFINITY, f64::min);
            assert_eq!(found, Some(nearest).filter(|&d| d <= HOST_REACH_CELLS as f64));
        }
    }

    #[test]
    fn preferred_cells_win_within_reach_and_others_serve_beyond_it() {
        let space = Dense::new([12, 1, 1], |[i, ..]| if i == 0 { 1 } else { 2 });
        let at = |x: f64| Vec3::new(x, 0.5, 0.5) * H;
        let (_, materials) = bind(&[at(1.4), at(9.5)], &space, |cell| cell[0] == 0).unwrap();
        assert_eq!(materials, [1, 2]);
    }

    #[test]
    fn a_vertex_far_from_tissue_is_refused_with_its_number_and_distance() {
        let space = Dense::new([20, 4, 4], |[i, ..]| u8::from(i < 4));
        let near = Vec3::new(2.0, 2.0, 2.0) * H;
        let far = Vec3::new(14.0, 2.0, 2.0) * H;
        let message = bind(&[near, far], &space, |_| true).unwrap_err().to_string();
        // Tissue ends at cell 4, ten cells of 3 mm away.
        assert!(message.contains("vertex 1 ") && message.contains("0.0300 m"), "{message}");

        let at_reach = Vec3::new(7.0, 2.0, 2.0) * H;
        assert!(bind(&[at_reach], &space, |_| true).is_ok());
        assert!(bind(&[Vec3::repeat(1e300)], &space, |_| true).is_err());
        assert!(bind(&[near], &Dense::new([2; 3], |_| 0), |_| true).is_err());
    }
}
