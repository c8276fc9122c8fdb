//! Cells with rows of their own: what they give to the nodes that they see, one node at a time.
//!
//! A node gathers from all rows that it stands in, in their order, after what it receives from regular cells. Each of these is evaluated for it anew, so
//! that no thread waits for another. That suits few cells, such as those beside a cut.

use std::mem::take;
use std::ops::Range;

use super::super::lanes::{Lanes, Real};
use super::super::nodes::{BRICK_OCTETS, BRICK_ROWS};
use super::gather::{Law, Source};
use super::turn::{Deformed, frame_of};
use crate::model::efg::law::{Elasticity, Matrix, Rotation, transform};
use crate::model::efg::rows::{BATCH, ROW, RowTable};
use crate::model::lattice::BRICK_SLOTS;
use crate::model::law::volume_change;

/// A node in a row.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Place {
    pub row: u32,
    pub entry: u32,
}

/// A node's part in a row.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Entry<R> {
    /// ∇φ in 1/m.
    pub gradient: [R; 3],
    /// w / Σ w.
    pub share: R,
    /// Where it lies from the weighted mean of the row: see [`crate::model::efg::rows::Row`].
    pub arm: [R; 3],
    pub slot: u32,
}

/// A cell's constants.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Cell<R> {
    /// V in m³.
    pub volume: R,
    /// 8 V / h³: a regular cell has eight shares of ⅛.
    pub fill: R,
    length: u32,
    pub material: u32,
}

/// Rows as they are computed with.
#[derive(Debug, Default)]
pub struct Table<R> {
    pub cells: Vec<Cell<R>>,
    /// `[row][ROW]`.
    pub entries: Vec<Entry<R>>,
    /// Where each slot's part of `places` begins, and one more.
    pub starts: Vec<u32>,
    pub places: Vec<Place>,
    /// Bit `row` is set where a node in that row of a brick stands in a row of a cell. Empty where there are no rows.
    touched: Vec<u16>,
    /// Where each slot's part ends, while it is listed.
    ends: Vec<u32>,
}

/// How the nodes of a row move: the displacement gradient at its cell, and the affine motion that fits theirs best.
#[derive(Clone, Copy, Debug)]
pub struct Motion<R> {
    pub gradient: Matrix<R>,
    mean: [R; 3],
    /// By the arms of the row.
    fit: Matrix<R>,
}

impl<R: Real> Table<R> {
    /// Copies the batches of `rows` that changed, and says which.
    pub fn upload(&mut self, rows: &mut RowTable, slots: usize, cell_m: f64) -> Vec<Range<usize>> {
        let changed = rows.take_changed();
        self.cells.resize(rows.len(), Cell::default());
        self.entries.resize(rows.len() * ROW, Entry::default());
        for row in changed.iter().cloned().flatten() {
            let from = rows.row(row);
            self.cells[row] = Cell {
                volume: R::splat(from.cell.volume * cell_m.powi(3)),
                fill: R::splat(8.0 * from.cell.volume),
                length: from.nodes.len() as u32,
                material: from.cell.material.into(),
            };
            for n in 0..from.nodes.len() {
                self.entries[row * ROW + n] = Entry {
                    slot: from.nodes[n],
                    gradient: from.gradients[n].map(R::splat).into(),
                    share: R::splat(from.shares[n]),
                    arm: from.arms[n].map(R::splat).into(),
                };
            }
        }
        if !changed.is_empty() {
            self.list_places(slots);
        }
        changed
    }

    /// Bytes of batches of rows.
    pub fn bytes_of(batches: &[Range<usize>]) -> u64 {
        let rows: usize = batches.iter().map(ExactSizeIterator::len).sum();
        (rows * (size_of::<Cell<R>>() + ROW * size_of::<Entry<R>>())) as u64
    }

    /// Which rows every node stands in.
    fn list_places(&mut self, slots: usize) {
        // Memory is kept: that of new lists costs more than what is done here.
        let (mut ends, mut touched) = (take(&mut self.ends), take(&mut self.touched));
        let mut places = take(&mut self.places);
        ends.clear();
        ends.resize(slots + 1, 0_u32);
        touched.clear();
        touched.resize(slots / BRICK_SLOTS, 0);
        for slot in (0..self.len()).flat_map(|row| self.row(row)).map(|seen| seen.slot as usize) {
            ends[slot] += 1;
            touched[slot / BRICK_SLOTS] |= 1 << (slot % BRICK_SLOTS / 8);
        }
        // Where each node's places begin, which becomes where they end.
        let mut count = 0;
        for end in &mut ends {
            count += std::mem::replace(end, count);
        }
        self.starts.clone_from(&ends);
        places.resize(count as usize, Place { row: 0, entry: 0 });
        // A node gathers from rows in their order.
        for row in 0..self.len() {
            for (entry, seen) in self.row(row).iter().enumerate() {
                let end = &mut ends[seen.slot as usize];
                places[*end as usize] = Place { row: row as u32, entry: entry as u32 };
                *end += 1;
            }
        }
        (self.ends, self.touched, self.places) = (ends, touched, places);
    }

    /// The places of a node in rows, in the order of these.
    pub fn places_of(&self, slot: u32) -> &[Place] {
        let slot = slot as usize;
        &self.places[self.starts[slot] as usize..self.starts[slot + 1] as usize]
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Bytes of all this.
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.cells[..])
            + size_of_val(&self.entries[..])
            + size_of_val(&self.starts[..])
            + size_of_val(&self.places[..])
            + size_of_val(&self.touched[..])) as u64
    }

    fn row(&self, row: usize) -> &[Entry<R>] {
        &self.entries[row * ROW..row * ROW + self.cells[row].length as usize]
    }

    /// The cell of a row.
    pub fn cell(&self, row: u32) -> &Cell<R> {
        &self.cells[row as usize]
    }

    /// A node's part in a row.
    pub fn entry(&self, place: Place) -> &Entry<R> {
        &self.row(place.row as usize)[place.entry as usize]
    }

    /// Whether nodes in a row of a brick stand in any row.
    #[inline(always)]
    pub fn touches(&self, brick: usize, row: usize) -> bool {
        self.touched.get(brick).is_some_and(|rows| rows >> row & 1 != 0)
    }

    /// What eight nodes, a row of a brick, receive.
    ///
    /// # Safety
    /// Nobody writes what `source` reads, nor what is known of cells.
    pub unsafe fn gather<L: Lanes<Real = R>, const N: usize>(
        &self,
        brick: usize,
        row: usize,
        source: &impl Source<L>,
        law: &impl Law<L, N>,
    ) -> [[R; 8]; N] {
        let mut sum = [[R::default(); 8]; N];
        for lane in 0..8 {
            let slot = brick * BRICK_SLOTS + row * 8 + lane;
            for &place in self.places_of(slot as u32) {
                // SAFETY: as the caller promises.
                let given = unsafe { law.give_one(self, place, source) };
                for n in 0..N {
                    sum[n][lane] = sum[n][lane].add(given[n]);
                }
            }
        }
        sum
    }

    /// How the nodes of a row move.
    ///
    /// # Safety
    /// Nobody writes what `source` reads.
    pub unsafe fn motion<L: Lanes<Real = R>>(&self, row: u32, source: &impl Source<L>) -> Motion<R> {
        let zero = R::default();
        let mut motion = Motion { gradient: [[zero; 3]; 3], mean: [zero; 3], fit: [[zero; 3]; 3] };
        for entry in self.row(row as usize) {
            // SAFETY: as the caller promises; slots exist.
            let u = unsafe { vector::<L>(source, entry.slot) };
            for c in 0..3 {
                let shared = u[c].mul(entry.share);
                motion.mean[c] = motion.mean[c].add(shared);
                for axis in 0..3 {
                    motion.fit[c][axis] = shared.fma(entry.arm[axis], motion.fit[c][axis]);
                    motion.gradient[c][axis] = u[c].fma(entry.gradient[axis], motion.gradient[c][axis]);
                }
            }
        }
        motion
    }

    /// The force on a node by stress and by what affine motion leaves of its displacement: see [`crate::model::efg::law`].
    ///
    /// # Safety
    /// As [`Self::motion`].
    pub unsafe fn force<L: Lanes<Real = R>>(
        &self,
        place: Place,
        source: &impl Source<L>,
        motion: &Motion<R>,
        stress: &Matrix<R>,
        hourglass: R,
    ) -> [R; 3] {
        let (cell, entry) = (self.cell(place.row), self.entry(place));
        // SAFETY: as the caller promises.
        let u = unsafe { vector::<L>(source, entry.slot) };
        let hold = hourglass.mul(cell.fill).mul(entry.share);
        let affine = transform(&motion.fit, entry.arm);
        let pull = transform(stress, entry.gradient);
        let mut force = [R::default(); 3];
        for c in 0..3 {
            let unseen = u[c].sub(motion.mean[c]).sub(affine[c]);
            force[c] = R::default().sub(cell.volume.mul(pull[c])).sub(hold.mul(unseen));
        }
        force
    }
}

/// The vector of a slot.
unsafe fn vector<L: Lanes>(source: &impl Source<L>, slot: u32) -> [L::Real; 3] {
    let (brick, local) = (slot as usize / BRICK_SLOTS, slot as usize % BRICK_SLOTS);
    let octet = brick * BRICK_OCTETS + local / 8;
    // SAFETY: the caller's slot exists and nobody writes it.
    let number = |c: usize| unsafe { source.number(octet + c * BRICK_ROWS, local % 8) };
    [number(0), number(1), number(2)]
}

/// What the cells of rows know of their own frame, and how far they are deformed.
#[derive(Debug)]
pub struct Turned<R> {
    pub rotations: Vec<Rotation<R>>,
    pub frames: Vec<Matrix<R>>,
    /// By batch.
    pub deformed: Vec<Deformed>,
}

impl<R: Real> Turned<R> {
    /// At rest.
    pub fn at_rest(rows: usize) -> Self {
        let (zero, one) = (R::splat(0.0), R::splat(1.0));
        Self {
            rotations: vec![[zero, zero, zero, one]; rows],
            frames: vec![[[one, zero, zero], [zero, one, zero], [zero, zero, one]]; rows],
            deformed: vec![Deformed::default(); rows.div_ceil(BATCH)],
        }
    }

    /// Turns the cell of a row; rows up to the one behind the last can be turned.
    pub fn turn_to(&mut self, row: usize, rotation: Rotation<R>) {
        if row == self.rotations.len() {
            self.rotations.push(rotation);
            self.frames.push(Matrix::default());
            self.deformed.resize(self.rotations.len().div_ceil(BATCH), Deformed::default());
        }
        self.rotations[row] = rotation;
    }

    /// Where other threads find it.
    pub fn parts(&mut self) -> TurnedParts<R> {
        TurnedParts {
            rotations: self.rotations.as_mut_ptr(),
            frames: self.frames.as_mut_ptr(),
            deformed: self.deformed.as_mut_ptr(),
        }
    }
}

/// [`Turned`], shared by threads that take batches of their own.
#[derive(Clone, Copy, Debug)]
pub struct TurnedParts<R> {
    rotations: *mut Rotation<R>,
    pub frames: *mut Matrix<R>,
    deformed: *mut Deformed,
}

impl<R: Real> TurnedParts<R> {
    /// Finds the frames of a batch's cells under displacements `u`.
    ///
    /// # Safety
    /// The batch exists and is this thread's, and nobody writes what `u` reads.
    pub unsafe fn turn<L: Lanes<Real = R>>(
        &self,
        table: &Table<R>,
        batch: usize,
        elasticity: Elasticity,
        u: &impl Source<L>,
    ) {
        let mut deformed = Deformed::default();
        for row in batch * BATCH..table.len().min((batch + 1) * BATCH) {
            // SAFETY: as the caller promises, here and below.
            let g = unsafe { table.motion::<L>(row as u32, u) }.gradient;
            // SAFETY: as above.
            let stretch = unsafe {
                let (q, frame, stretch) = frame_of(elasticity, *self.rotations.add(row), &g);
                *self.rotations.add(row) = q;
                *self.frames.add(row) = frame;
                stretch
            };
            let strain = (0..3).map(|axis| stretch[axis][axis].to_f64().abs() as f32).fold(0.0, f32::max);
            let change = volume_change(g).1.to_f64() as f32;
            deformed =
                deformed.max(&Deformed { strain, swelling: change.max(0.0), shrinking: (-change).max(0.0) });
        }
        // SAFETY: as above.
        unsafe { *self.deformed.add(batch) = deformed };
    }
}
