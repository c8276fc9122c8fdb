//! What lies on the device.

use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use super::Number;
use super::rows::Rows;
use crate::cuda::body::Body;
use crate::cuda::layout::{self, EfgLaw, EfgStep, GRID_NUMBERS, Law, MAX_POINTS, MAX_ROW, MAX_SITES};
use crate::cuda::layout::{PRESS_FIELDS, Pass, numbers, share};
use crate::cuda::memory::{Buffer, Stream};
use crate::error::Result;
use crate::math::Vec3;
use crate::model::Model;
use crate::model::efg::rows::RowTable;
use crate::model::lattice::{BRICK_SLOTS, Lattice};
use crate::model::law::CellLaw;

/// The system's fields of three numbers for each node, in the order of the kernels' structure: x, b, r, z, p, w, s and A x.
const SYSTEM: usize = 8;

/// A simulation's state, and the system of its steps.
#[derive(Debug)]
pub struct State<R> {
    bricks: u32,
    cell_m: f64,
    pub step: Buffer<u32>,
    /// Moduli, and masses for the list of sites.
    laws: Buffer<EfgLaw>,
    masses: Buffer<Law>,
    neighbours: Buffer<[u32; 27]>,
    flags: Buffer<u8>,
    cells: Buffer<u8>,
    shown: Buffer<[f32; 4]>,
    mass: Buffer<R>,
    heavy: Buffer<R>,
    inverse: Buffer<R>,
    rotations: Buffer<R>,
    frames: Buffer<R>,
    pub u: Buffer<R>,
    pub v: Buffer<R>,
    system: [Buffer<R>; SYSTEM],
    touched: Buffer<R>,
    shares: Buffer<R>,
    press: Buffer<R>,
    meetings: Buffer<u32>,
    arrived: Buffer<u32>,
    partials: Buffer<f64>,
    seen: Buffer<[f32; 4]>,
    is_settled: Buffer<u32>,
    rows: Rows<R>,
    started: Buffer<u64>,
}

/// Numbers of all bricks, each of which has `numbers` for each of its nodes: 1 where `is_one` says so.
fn units<R: Number>(bricks: usize, numbers: usize, is_one: fn(usize) -> bool) -> Vec<R> {
    let brick = (0..numbers * BRICK_SLOTS).map(|at| f64::from(u8::from(is_one(at / BRICK_SLOTS))));
    brick.cycle().take(bricks * numbers * BRICK_SLOTS).map(R::splat).collect()
}

impl<R: Number> State<R> {
    /// At rest, for a kernel of so many blocks. Cells that have one of `rows` are none of the bricks' own: either all cells have, or none has.
    pub fn new(
        model: &Model,
        body: &Body,
        rows: RowTable,
        blocks: u32,
        stream: &Arc<Stream>,
    ) -> Result<Self> {
        let lattice = model.lattice();
        let bricks = lattice.bricks().len();
        let fields = |numbers: usize| Buffer::zeros(stream, (bricks + 1) * numbers * BRICK_SLOTS);
        let neighbours: Vec<[u32; 27]> = lattice.surroundings().collect();
        // The cell whose lowest corner a node is. Behind the last brick lies the empty one.
        let are_own = rows.is_empty();
        let words = lattice.words().iter().copied().chain([0; BRICK_SLOTS]);
        let (cells, shown): (Vec<u8>, Vec<[f32; 4]>) = words
            .map(|word| (if are_own { (word >> 28) as u8 } else { 0 }, shown(Vec3::zeros(), word)))
            .unzip();
        let carriers = MAX_ROW * MAX_SITES;
        let [x, b, r, z] = [(); 4].map(|()| fields(numbers::VECTOR));
        let [p, w, s, ax] = [(); 4].map(|()| fields(numbers::VECTOR));
        let state = Self {
            bricks: bricks as u32,
            cell_m: lattice.cell_m(),
            step: Buffer::zeros(stream, size_of::<EfgStep>().div_ceil(4))?,
            laws: Buffer::zeros(stream, 16)?,
            masses: Buffer::zeros(stream, 16)?,
            neighbours: Buffer::of(stream, &neighbours)?,
            flags: Buffer::of(stream, &body.flags)?,
            cells: Buffer::of(stream, &cells)?,
            shown: Buffer::of(stream, &shown)?,
            mass: fields(1)?,
            heavy: fields(1)?,
            inverse: fields(numbers::BLOCK)?,
            rotations: fields(numbers::ROTATION)?,
            frames: fields(numbers::FRAME)?,
            u: fields(numbers::VECTOR)?,
            v: fields(numbers::VECTOR)?,
            system: [x?, b?, r?, z?, p?, w?, s?, ax?],
            touched: Buffer::zeros(stream, 3 * carriers)?,
            shares: Buffer::zeros(stream, carriers)?,
            press: Buffer::zeros(stream, PRESS_FIELDS * MAX_POINTS)?,
            meetings: Buffer::zeros(stream, 1)?,
            arrived: Buffer::zeros(stream, 1)?,
            partials: Buffer::zeros(stream, 2 * GRID_NUMBERS * blocks as usize)?,
            seen: Buffer::zeros(stream, blocks as usize)?,
            is_settled: Buffer::zeros(stream, 1)?,
            rows: Rows::new(rows, lattice, stream)?,
            started: Buffer::zeros(stream, 1)?,
        };
        state.set_masses(lattice, &body.laws)?;
        state.turn_back()?;
        Ok(state)
    }

    /// Cells that are not turned.
    pub fn turn_back(&self) -> Result<()> {
        let bricks = self.bricks as usize;
        self.rotations.write(0, &units(bricks, numbers::ROTATION, |n| n == 3))?;
        self.frames.write(0, &units(bricks, numbers::FRAME, |n| n % 4 == 0))?;
        self.rows.turn_back()
    }

    /// Back to rest.
    pub fn rest(&self, lattice: &Lattice) -> Result<()> {
        let shown: Vec<_> = lattice.words().iter().map(|&word| shown(Vec3::zeros(), word)).collect();
        self.shown.write(0, &shown)?;
        self.u.clear()?;
        self.v.clear()?;
        self.turn_back()
    }

    /// Other materials.
    pub fn set_masses(&self, lattice: &Lattice, laws: &[CellLaw; 16]) -> Result<()> {
        let mut kg = vec![0.0; self.bricks as usize * BRICK_SLOTS];
        if self.rows.count() == 0 {
            for slot in lattice.slots() {
                kg[slot as usize] = lattice.node_mass(slot, |material| laws[usize::from(material)].corner_kg);
            }
        }
        self.rows.add_masses(laws, &mut kg);
        self.mass.write(0, &kg.into_iter().map(R::splat).collect::<Vec<_>>())?;
        self.masses.write(0, &laws.map(|law| Law::of(&law)))
    }

    /// Moduli, and what a step makes of each material's.
    pub fn set_moduli(&self, laws: &[CellLaw; 16], factor: impl Fn(&CellLaw) -> f64) -> Result<()> {
        self.laws.write(0, &laws.map(|law| EfgLaw::of(&law, self.cell_m, factor(&law))))
    }

    /// Other nodes are held.
    pub fn set_flags(&self, flags: &[u8]) -> Result<()> {
        self.flags.write(0, flags)
    }

    /// Replaces displacement and velocity of a slot whose node has this word.
    pub fn set_node(&self, slot: u32, word: u32, displacement: Vec3, velocity: Vec3) -> Result<()> {
        for axis in 0..3 {
            let at = number(slot as usize, axis);
            self.u.write(at, &[R::splat(displacement[axis])])?;
            self.v.write(at, &[R::splat(velocity[axis])])?;
        }
        self.shown.write(slot as usize, &[shown(displacement, word)])
    }

    /// The inner forces that the last step found: b.
    pub fn impulses(&self, all: &mut [R]) -> Result<()> {
        self.system[1].read(0, all)
    }

    /// What kernels that know no model see of the state.
    pub fn pass(&self) -> Pass {
        Pass {
            u: self.shown.at(),
            u_next: self.shown.at(),
            v: 0,
            v_next: 0,
            neighbours: self.neighbours.at(),
            flags: self.flags.at(),
            laws: self.masses.at(),
            step: self.step.at() + std::mem::offset_of!(EfgStep, step) as u64,
            marks: 0,
            diverged_at: 0,
            started: self.started.at(),
            cell: self.cell_m as f32,
            substep: 1,
            mark: 0,
            share: share::WHOLE,
            near_tools: 0,
            acted_on: 0,
            near_bricks: 0,
            near_counts: 0,
        }
    }

    /// What the kernel of a step works on; `pass` is what the kernels before it had.
    pub fn on_device(&self, pass: &Pass, report: CUdeviceptr) -> layout::Efg {
        let [x, b, r, z, p, w, s, ax] = self.system.each_ref().map(Buffer::at);
        layout::Efg {
            bricks: self.bricks,
            starts: u32::from(pass.started != 0),
            row_count: self.rows.count() as u32,
            cell: self.cell_m,
            step: self.step.at(),
            laws: self.laws.at(),
            neighbours: self.neighbours.at(),
            flags: self.flags.at(),
            cells: self.cells.at(),
            shown: self.shown.at(),
            mass: self.mass.at(),
            heavy: self.heavy.at(),
            inverse: self.inverse.at(),
            rotations: self.rotations.at(),
            frames: self.frames.at(),
            u: self.u.at(),
            v: self.v.at(),
            x,
            b,
            r,
            z,
            p,
            w,
            s,
            ax,
            touched: self.touched.at(),
            shares: self.shares.at(),
            press: self.press.at(),
            meetings: self.meetings.at(),
            arrived: self.arrived.at(),
            partials: self.partials.at(),
            seen: self.seen.at(),
            is_settled: self.is_settled.at(),
            near_tools: pass.near_tools,
            started: self.started.at(),
            row_cells: self.rows.cells.at(),
            row_entries: self.rows.entries.at(),
            row_starts: self.rows.starts.at(),
            row_places: self.rows.places.at(),
            row_rotations: self.rows.rotations.at(),
            row_frames: self.rows.frames.at(),
            report,
        }
    }

    /// Bytes of state, system and topology.
    pub fn bytes(&self) -> u64 {
        let fields =
            [&self.mass, &self.heavy, &self.inverse, &self.rotations, &self.frames, &self.u, &self.v];
        let numbers = fields.into_iter().chain(&self.system).map(Buffer::bytes).sum::<u64>();
        numbers
            + self.rows.bytes()
            + self.neighbours.bytes()
            + self.flags.bytes()
            + self.cells.bytes()
            + self.shown.bytes()
    }
}

/// A node for what knows no model: its displacement and its word.
fn shown(displacement: Vec3, word: u32) -> [f32; 4] {
    let [x, y, z] = [0, 1, 2].map(|axis| displacement[axis] as f32);
    [x, y, z, f32::from_bits(word)]
}

/// Place of a component of a slot's vector in a field.
pub fn number(slot: usize, axis: usize) -> usize {
    slot / BRICK_SLOTS * numbers::VECTOR * BRICK_SLOTS + axis * BRICK_SLOTS + slot % BRICK_SLOTS
}
