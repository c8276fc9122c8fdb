//! Rows: what each cell sees that does not see its own eight corners alone, or is to be computed as if it did not.
//!
//! Arrays of two dimensions with [`ROW`] places for every cell and a vector of row lengths, so that a row can be replaced where it lies. Rows form
//! batches of [`BATCH`]; a batch that changed is dirty until it was copied to where it is computed.

use std::ops::Range;

use super::mls::{Shape, shape_of_nearest};
use crate::error::{Error, Result};
use crate::math::{Mat3, Vec3};
use crate::model::lattice::Lattice;
use crate::model::law::CellLaw;

/// Nodes that a row has room for. Cells that random planes cut three times need 18 at most.
pub const ROW: usize = 20;
/// Rows that are copied together.
pub const BATCH: usize = 256;
/// Fewest nodes of a row.
const LEAST: usize = 8;
/// How well rows reproduce linear fields: what rounding leaves at the distances of a large model.
const EXACT: f64 = 1e-9;

/// An integration cell with a row of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Its integration point in m, model frame.
    pub point: Vec3,
    /// Its volume in cells of the grid.
    pub volume: f64,
    /// Its material, 1 to 15.
    pub material: u8,
}

/// Rows of cells, in double precision.
#[derive(Clone, Debug, Default)]
pub struct RowTable {
    cells: Vec<Cell>,
    lengths: Vec<u8>,
    nodes: Vec<u32>,
    phi: Vec<f64>,
    gradients: Vec<Vec3>,
    shares: Vec<f64>,
    arms: Vec<Vec3>,
    /// One for each batch.
    is_dirty: Vec<bool>,
}

/// A node's part in a row; see [`Row`].
struct Entry {
    node: u32,
    phi: f64,
    gradient: Vec3,
    share: f64,
    arm: Vec3,
}

/// One row.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    /// Whose row it is.
    pub cell: &'a Cell,
    /// Slots of the nodes that the cell sees `[row length]`.
    pub nodes: &'a [u32],
    /// φ of each at the integration point.
    pub phi: &'a [f64],
    /// ∇φ of each in 1/m.
    pub gradients: &'a [Vec3],
    /// w / Σ w of each.
    pub shares: &'a [f64],
    /// Where each lies from the weighted mean of all, in units in which their weighted second moment is the identity: what is left of displacements when
    /// their best affine fit is taken away is u − Σ w u − (Σ w u aᵀ) a.
    pub arms: &'a [Vec3],
}

impl RowTable {
    /// A row for every cell of a lattice, by the rule that cells of any shape follow.
    pub fn of_all(lattice: &Lattice) -> Result<Self> {
        let mut table = Self::default();
        let h = lattice.cell_m();
        for (cell, material) in lattice.occupied() {
            let point = Vec3::from(cell.map(|i| i as f64 + 0.5)) * h;
            let near = nodes_around(lattice, cell, point);
            table.push(Cell { point, volume: 1.0, material }, &near, h)?;
        }
        Ok(table)
    }

    /// Adds the row of a cell that sees `near`, slots and places sorted from the nearest: as many of them as span space, eight at least.
    ///
    /// A cell whose nodes span no space, or that needs more than a row has room for, is an error, and nothing is written.
    pub fn push(&mut self, cell: Cell, near: &[(u32, Vec3)], cell_m: f64) -> Result<()> {
        let places: Vec<Vec3> = near.iter().map(|&(_, place)| place).collect();
        let shape = shape_of_nearest(cell.point, &places, LEAST).ok_or_else(|| {
            Error::argument(format!(
                "the {} nodes that a cell at {:?} sees span no space",
                near.len(),
                cell.point
            ))
        })?;
        let length = shape.phi.len();
        if length > ROW {
            return Err(Error::Limit(format!(
                "a cell at {:?} needs {length} nodes, and a row has room for {ROW}",
                cell.point
            )));
        }
        check(&shape, cell.point, &places[..length], cell_m)?;

        let spread: Mat3 = (0..length)
            .map(|n| (places[n] - shape.mean) * (places[n] - shape.mean).transpose() * shape.share[n])
            .sum();
        let spread = spread.cholesky().ok_or_else(|| {
            Error::Defect(format!("the nodes that a cell at {:?} sees span no space", cell.point))
        })?;
        let arm = |n: usize| spread.l().solve_lower_triangular(&(places[n] - shape.mean)).unwrap_or_default();
        let row = self.len();
        self.write(row, cell, length, |n| Entry {
            node: near[n].0,
            phi: shape.phi[n],
            gradient: shape.gradient[n],
            share: shape.share[n],
            arm: arm(n),
        });
        Ok(())
    }

    /// Writes the row of a piece of a divided cell, which hangs on eight nodes, at the cell's corners: trilinear shape functions at its integration point. Rows up
    /// to the one behind the last can be written.
    pub fn put_piece(&mut self, row: usize, cell: Cell, nodes: [u32; 8], lowest_corner: Vec3, cell_m: f64) {
        let at = (cell.point - lowest_corner) / cell_m;
        self.write(row, cell, nodes.len(), |corner| {
            let sign = Vec3::from_fn(|axis, _| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 });
            let along = at.zip_map(&sign, |x, sign| if sign > 0.0 { x } else { 1.0 - x });
            let beside = Vec3::new(along.y * along.z, along.x * along.z, along.x * along.y);
            Entry {
                node: nodes[corner],
                phi: along.product(),
                gradient: beside.component_mul(&sign) / cell_m,
                share: 0.125,
                arm: sign,
            }
        });
    }

    /// Empties the row of a cell that is gone: it has no volume and sees no node.
    pub fn clear(&mut self, row: usize) {
        self.cells[row].volume = 0.0;
        self.lengths[row] = 0;
        self.is_dirty[row / BATCH] = true;
    }

    /// Writes a row of `length` nodes.
    fn write(&mut self, row: usize, cell: Cell, length: usize, entry: impl Fn(usize) -> Entry) {
        if row == self.len() {
            let places = (row + 1) * ROW;
            self.nodes.resize(places, 0);
            self.phi.resize(places, 0.0);
            self.gradients.resize(places, Vec3::zeros());
            self.shares.resize(places, 0.0);
            self.arms.resize(places, Vec3::zeros());
            self.is_dirty.resize(row / BATCH + 1, true);
            self.cells.push(cell);
            self.lengths.push(0);
        }
        for n in 0..length {
            let (at, entry) = (row * ROW + n, entry(n));
            self.nodes[at] = entry.node;
            self.phi[at] = entry.phi;
            self.gradients[at] = entry.gradient;
            self.shares[at] = entry.share;
            self.arms[at] = entry.arm;
        }
        self.is_dirty[row / BATCH] = true;
        self.cells[row] = cell;
        self.lengths[row] = length as u8;
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// A row.
    pub fn row(&self, row: usize) -> Row<'_> {
        let places = row * ROW..row * ROW + usize::from(self.lengths[row]);
        Row {
            cell: &self.cells[row],
            nodes: &self.nodes[places.clone()],
            phi: &self.phi[places.clone()],
            gradients: &self.gradients[places.clone()],
            shares: &self.shares[places.clone()],
            arms: &self.arms[places],
        }
    }

    /// Adds to `masses` what the cells' materials give to the nodes that they see, by their slots, in kg.
    pub fn add_masses(&self, laws: &[CellLaw; 16], masses: &mut [f64]) {
        for row in 0..self.len() {
            for (entry, &slot) in self.row(row).nodes.iter().enumerate() {
                masses[slot as usize] += self.mass(laws, row, entry);
            }
        }
    }

    /// What the cell of a row gives to the node of one of its entries, in kg.
    pub fn mass(&self, laws: &[CellLaw; 16], row: usize, entry: usize) -> f64 {
        let row = self.row(row);
        8.0 * laws[usize::from(row.cell.material)].corner_kg * row.cell.volume * row.phi[entry]
    }

    /// All rows count as changed: none has been copied to where this table is needed.
    pub fn touch_all(&mut self) {
        self.is_dirty.fill(true);
    }

    /// The rows of batches that changed since the last call, batch by batch.
    pub fn take_changed(&mut self) -> Vec<Range<usize>> {
        let rows = self.len();
        let mut changed = Vec::new();
        for (batch, is_dirty) in self.is_dirty.iter_mut().enumerate() {
            if std::mem::take(is_dirty) {
                changed.push(batch * BATCH..rows.min((batch + 1) * BATCH));
            }
        }
        changed
    }
}

/// The nodes within a cell of a cell, sorted from the one nearest to a point.
fn nodes_around(lattice: &Lattice, cell: [usize; 3], point: Vec3) -> Vec<(u32, Vec3)> {
    let reach = |axis: usize| cell[axis].saturating_sub(1)..=cell[axis] + 2;
    let mut near = Vec::new();
    for k in reach(2) {
        for j in reach(1) {
            for i in reach(0) {
                near.extend(lattice.slot([i, j, k]).map(|slot| (slot, lattice.rest_position(slot))));
            }
        }
    }
    let distance = |place: &Vec3| (place - point).norm_squared();
    near.sort_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)));
    near
}

/// Refuses shape functions that do not reproduce linear fields.
fn check(shape: &Shape, point: Vec3, places: &[Vec3], cell_m: f64) -> Result<()> {
    let one: f64 = shape.phi.iter().sum();
    let there: Vec3 = places.iter().zip(&shape.phi).map(|(place, phi)| (place - point) * *phi).sum();
    let slope: Mat3 =
        places.iter().zip(&shape.gradient).map(|(place, g)| (place - point) * g.transpose()).sum();
    let constant: Vec3 = shape.gradient.iter().sum();
    let off = [
        (one - 1.0).abs(),
        there.norm() / cell_m,
        (slope - Mat3::identity()).norm(),
        constant.norm() * cell_m,
    ];
    if off.iter().all(|off| *off <= EXACT) {
        return Ok(());
    }
    Err(Error::Defect(format!("the shape functions at {point:?} miss linear fields by {off:?}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Noise;

    const H: f64 = 2e-3;

    /// A lattice in which about a third of the cells is missing.
    fn ragged() -> Lattice {
        let mut noise = Noise(7);
        let materials: Vec<u8> = (0..420).map(|_| if noise.next() > -0.3 { 3 } else { 0 }).collect();
        Lattice::new([10, 7, 6], H, &materials).unwrap()
    }

    #[test]
    fn whole_cells_see_their_corners_with_an_eighth_each_whatever_is_around_them() {
        let lattice = ragged();
        let table = RowTable::of_all(&lattice).unwrap();
        assert_eq!(table.len(), lattice.cell_count());
        for (index, (cell, material)) in lattice.occupied().enumerate() {
            let row = table.row(index);
            let mut seen = row.nodes.to_vec();
            seen.sort_unstable();
            let mut corners = lattice.corners(cell);
            corners.sort_unstable();
            assert_eq!(seen, corners);
            assert_eq!((row.cell.material, row.cell.volume), (material, 1.0));
            for n in 0..8 {
                let sign = (lattice.rest_position(row.nodes[n]) - row.cell.point) / (0.5 * H);
                assert!((row.phi[n] - 0.125).abs() < 1e-12 && (row.shares[n] - 0.125).abs() < 1e-12);
                assert!((row.gradients[n] * 4.0 * H - sign).norm() < 1e-11);
                assert!((row.arms[n] - sign).norm() < 1e-11);
            }
        }
    }

    /// So many nodes in a plane, and then one that is not.
    fn flat_and_one(flat: usize) -> Vec<(u32, Vec3)> {
        let mut noise = Noise(11);
        let mut near: Vec<(u32, Vec3)> =
            (0..flat as u32).map(|n| (n, Vec3::new(noise.next(), noise.next(), 0.0) * H)).collect();
        near.push((90, Vec3::z() * (1.5 * H)));
        near
    }

    #[test]
    fn a_row_that_overflows_is_refused_and_nothing_is_written() {
        let cell = Cell { point: Vec3::zeros(), volume: 0.4, material: 1 };
        let mut table = RowTable::default();
        table.push(cell, &flat_and_one(ROW - 1), H).unwrap();
        assert_eq!(table.row(0).nodes.len(), ROW);
        table.take_changed();

        let before = format!("{table:?}");
        let error = table.push(cell, &flat_and_one(ROW), H).unwrap_err();
        assert!(matches!(&error, Error::Limit(why) if why.contains("room for 20")), "{error}");
        let plane = &flat_and_one(12)[..12];
        assert!(matches!(table.push(cell, plane, H), Err(Error::Argument(_))));
        assert_eq!(format!("{table:?}"), before);
    }

    #[test]
    fn batches_are_handed_over_once_for_each_change() {
        let cell = Cell { point: Vec3::zeros(), volume: 1.0, material: 1 };
        let mut table = RowTable::default();
        for _ in 0..BATCH + 44 {
            table.push(cell, &flat_and_one(10), H).unwrap();
        }
        assert_eq!(table.take_changed(), [0..BATCH, BATCH..BATCH + 44]);
        assert!(table.take_changed().is_empty());
        table.push(cell, &flat_and_one(10), H).unwrap();
        assert_eq!(table.take_changed(), vec![BATCH..BATCH + 45]);
    }
}
