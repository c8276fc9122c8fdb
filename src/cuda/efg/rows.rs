//! Cells with rows of their own, on the device.

use std::sync::Arc;

use super::Number;
use crate::cpu::efg::rows::{Cell, Entry, Place, Table};
use crate::cuda::memory::{Buffer, Stream};
use crate::error::Result;
use crate::model::efg::rows::{ROW, RowTable};
use crate::model::lattice::Lattice;
use crate::model::law::CellLaw;

/// Rows as steps read them, and what their cells know of their own frame.
#[derive(Debug)]
pub struct Rows<R> {
    rows: RowTable,
    table: Table<R>,
    pub cells: Buffer<Cell<R>>,
    pub entries: Buffer<Entry<R>>,
    pub starts: Buffer<u32>,
    pub places: Buffer<Place>,
    pub rotations: Buffer<R>,
    pub frames: Buffer<R>,
}

impl<R: Number> Rows<R> {
    /// All rows, their cells at rest.
    pub fn new(rows: RowTable, lattice: &Lattice, stream: &Arc<Stream>) -> Result<Self> {
        let count = rows.len();
        let mut all = Self {
            rows,
            table: Table::default(),
            cells: Buffer::zeros(stream, count)?,
            entries: Buffer::zeros(stream, count * ROW)?,
            starts: Buffer::zeros(stream, 0)?,
            places: Buffer::zeros(stream, 0)?,
            rotations: Buffer::zeros(stream, count * 4)?,
            frames: Buffer::zeros(stream, count * 9)?,
        };
        all.upload(lattice)?;
        all.turn_back()?;
        Ok(all)
    }

    /// Copies the batches of rows that changed, of which there are as many as before.
    fn upload(&mut self, lattice: &Lattice) -> Result<()> {
        let changed = self.table.upload(&mut self.rows, lattice.slot_count(), lattice.cell_m());
        for rows in &changed {
            self.cells.write(rows.start, &self.table.cells[rows.clone()])?;
            let entries = rows.start * ROW..rows.end * ROW;
            self.entries.write(entries.start, &self.table.entries[entries])?;
        }
        if !changed.is_empty() {
            self.starts.replace(&self.table.starts)?;
            self.places.replace(&self.table.places)?;
        }
        Ok(())
    }

    /// Cells that are not turned.
    pub fn turn_back(&self) -> Result<()> {
        let units = |numbers: usize, is_one: fn(usize) -> bool| -> Vec<R> {
            let one = (0..numbers).map(move |n| R::splat(f64::from(u8::from(is_one(n)))));
            one.cycle().take(self.count() * numbers).collect()
        };
        self.rotations.write(0, &units(4, |n| n == 3))?;
        self.frames.write(0, &units(9, |n| n % 4 == 0))
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.rows.len()
    }

    /// Adds the masses that the cells give to nodes, by their slots.
    pub fn add_masses(&self, laws: &[CellLaw; 16], masses: &mut [f64]) {
        self.rows.add_masses(laws, masses);
    }

    /// Bytes of all this.
    pub fn bytes(&self) -> u64 {
        self.cells.bytes()
            + self.entries.bytes()
            + self.starts.bytes()
            + self.places.bytes()
            + self.rotations.bytes()
            + self.frames.bytes()
    }
}
