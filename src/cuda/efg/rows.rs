//! Cells with rows of their own, on the device.

use std::sync::Arc;

use super::Number;
use crate::cpu::efg::cell_rows::{CellRows, Like};
use crate::cpu::efg::rows::{Cell, Entry, Place, Table};
use crate::cpu::nodes::Bricks;
use crate::cuda::kept::Kept;
use crate::cuda::layout::{NO_PLACE, Turned};
use crate::cuda::memory::{Buffer, Stream};
use crate::cut::topology::{Change, Topology};
use crate::error::Result;
use crate::model::efg::rows::{ROW, RowTable};
use crate::model::lattice::BRICK_SLOTS;
use crate::model::law::CellLaw;
use crate::solver::method;

/// Rows as steps read them, and what their cells know of their own frame.
#[derive(Debug)]
pub struct Rows<R> {
    which: method::Rows,
    rows: RowTable,
    of_cells: CellRows,
    table: Table<R>,
    pub cells: Buffer<Cell<R>>,
    pub entries: Buffer<Entry<R>>,
    /// Places of bricks among those with nodes in rows, and where such nodes' places in rows begin, and one more.
    pub bricks: Kept<u32>,
    pub starts: Kept<u32>,
    pub places: Kept<Place>,
    pub rotations: Buffer<R>,
    pub frames: Buffer<R>,
    pub given: Buffer<[R; 3]>,
}

/// Rows in the order that cuts have given them, by which nodes gather, and how their cells are turned.
#[derive(Debug)]
pub struct SavedRows<R> {
    rows: RowTable,
    of_cells: CellRows,
    rotations: Vec<R>,
}

impl<R: Number> Rows<R> {
    /// All rows before any cut, their cells at rest, and room for as many more as there is for copies of nodes. Cells that have one are none of the bricks' own any more.
    pub fn new(bricks: &mut Bricks, which: method::Rows, stream: &Arc<Stream>) -> Result<Self> {
        let (rows, of_cells) = CellRows::uncut(bricks, which)?;
        let own_slots = bricks.model.lattice().slot_count();
        let room = rows.len() + bricks.slot_count() - own_slots;
        // Without rows, and room for any, nothing is looked up.
        let slots = if room > 0 { bricks.slot_count() } else { 0 };
        let mut all = Self {
            which,
            rows,
            of_cells,
            table: Table::default(),
            cells: Buffer::zeros(stream, room)?,
            entries: Buffer::zeros(stream, room * ROW)?,
            bricks: Kept::of(stream, vec![NO_PLACE; slots / BRICK_SLOTS], 0)?,
            starts: Kept::of(stream, Vec::new(), slots + 1)?,
            places: Kept::of(stream, Vec::new(), room * 8)?,
            rotations: Buffer::zeros(stream, room * 4)?,
            frames: Buffer::zeros(stream, room * 9)?,
            given: Buffer::zeros(stream, room * ROW)?,
        };
        all.upload(bricks)?;
        all.turn_back()?;
        Ok(all)
    }

    /// Copies the batches of rows that changed, and what changed of where nodes stand in them.
    fn upload(&mut self, bricks: &Bricks) -> Result<()> {
        let cell_m = bricks.model.lattice().cell_m();
        let changed = self.table.upload(&mut self.rows, bricks.slot_count(), cell_m);
        for rows in &changed {
            self.cells.write(rows.start, &self.table.cells[rows.clone()])?;
            let entries = rows.start * ROW..rows.end * ROW;
            self.entries.write(entries.start, &self.table.entries[entries])?;
        }
        if changed.is_empty() {
            return Ok(());
        }
        let (mut of_brick, mut starts, mut count) = (vec![NO_PLACE; bricks.count()], Vec::new(), 0);
        for (brick, of_brick) in of_brick.iter_mut().enumerate() {
            let [first, end] = [brick, brick + 1].map(|brick| brick * BRICK_SLOTS);
            if self.table.starts[first] < self.table.starts[end] {
                *of_brick = count;
                count += 1;
                starts.extend_from_slice(&self.table.starts[first..end]);
            }
        }
        // No places lie between those of two listed bricks.
        starts.push(self.table.places.len() as u32);
        self.bricks.set(of_brick)?;
        self.starts.set(starts)?;
        self.places.set(self.table.places.clone())
    }

    /// Gives the pieces that a cut has left rows; says how those are turned that are new.
    pub fn divide(&mut self, bricks: &Bricks, topology: &Topology, change: &Change) -> Result<Vec<Turned>> {
        let new = self.of_cells.divide(&mut self.rows, bricks.model.lattice(), topology, change);
        self.upload(bricks)?;
        let turned = |(row, like)| match like {
            Like::Row(from) => Turned { row, from: from as u32, is_row: 1 },
            Like::Cell(slot) => Turned { row, from: slot, is_row: 0 },
        };
        Ok(new.into_iter().map(|(row, like)| turned((row as u32, like))).collect())
    }

    /// As before any cut.
    pub fn heal(&mut self, bricks: &mut Bricks) -> Result<()> {
        (self.rows, self.of_cells) = CellRows::uncut(bricks, self.which)?;
        self.table = Table::default();
        self.upload(bricks)
    }

    /// Copies what later steps read.
    pub fn save(&self) -> Result<SavedRows<R>> {
        Ok(SavedRows {
            rows: self.rows.clone(),
            of_cells: self.of_cells.clone(),
            rotations: self.rotations.all()?,
        })
    }

    /// Goes on from there.
    pub fn restore(&mut self, saved: &SavedRows<R>, bricks: &Bricks) -> Result<()> {
        self.rows.clone_from(&saved.rows);
        self.rows.touch_all();
        self.of_cells.clone_from(&saved.of_cells);
        self.table = Table::default();
        self.rotations.write(0, &saved.rotations)?;
        self.upload(bricks)
    }

    /// Whether all cells have rows, so that none is a brick's own.
    pub fn are_all(&self) -> bool {
        self.which == method::Rows::All
    }

    /// Cells that are not turned.
    pub fn turn_back(&self) -> Result<()> {
        let units = |numbers: usize, is_one: fn(usize) -> bool| -> Vec<R> {
            let one = (0..numbers).map(move |n| R::splat(f64::from(u8::from(is_one(n)))));
            one.cycle().take(self.cells.room() * numbers).collect()
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

    /// Adds what they give to one of them.
    pub fn add_mass(&self, laws: &[CellLaw; 16], slot: u32, mass: f64) -> f64 {
        // Where there has never been a row there are no places.
        let places = if self.rows.is_empty() { &[] } else { self.table.places_of(slot) };
        let given = |place: &Place| self.rows.mass(laws, place.row as usize, place.entry as usize);
        places.iter().fold(mass, |mass, place| mass + given(place))
    }

    /// Bytes of all this.
    pub fn bytes(&self) -> u64 {
        self.cells.bytes()
            + self.entries.bytes()
            + self.bricks.bytes()
            + self.starts.bytes()
            + self.places.bytes()
            + self.rotations.bytes()
            + self.frames.bytes()
            + self.given.bytes()
    }
}
