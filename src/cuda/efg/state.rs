//! What lies on the device.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use super::Number;
use super::rows::{Rows, SavedRows};
use crate::cuda::body::Body;
use crate::cuda::cut::{Cutter, Fields};
use crate::cuda::kept::Kept;
use crate::cuda::kernels::Kernel;
use crate::cuda::layout::{self, EfgLaw, EfgStep, GRID_NUMBERS, Law, MAX_POINTS, MAX_ROW, MAX_SITES};
use crate::cuda::layout::{PRESS_FIELDS, Pass, numbers, share};
use crate::cuda::memory::{Buffer, Stream};
use crate::cuda::pieces::Pieces;
use crate::cuda::sides::Sides;
use crate::cut::topology::{Change, Topology};
use crate::error::Result;
use crate::math::Vec3;
use crate::model::lattice::BRICK_SLOTS;
use crate::model::law::CellLaw;
use crate::solver::method;

/// The system's fields of three numbers for each node, in the order of the kernels' structure: x, b, r, z, p, w, s and A x.
const SYSTEM: usize = 8;

/// A simulation's state, and the system of its steps.
#[derive(Debug)]
pub struct State<R> {
    /// Bricks that hold nodes, and how many there are with the loose ones.
    bricks: u32,
    count: usize,
    cell_m: f64,
    pub step: Buffer<u32>,
    /// Moduli, and masses for the list of sites.
    laws: Buffer<EfgLaw>,
    masses: Buffer<Law>,
    neighbours: Buffer<[u32; 27]>,
    flags: Kept<u8>,
    cells: Kept<u8>,
    shown: Buffer<[f32; 4]>,
    mass: Kept<R>,
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
    pieces: Pieces,
    sides: Sides,
    cutter: Cutter,
    started: Buffer<u64>,
}

/// What steps have written that later ones read.
#[derive(Debug)]
pub struct SavedState<R> {
    u: Vec<R>,
    v: Vec<R>,
    shown: Vec<[f32; 4]>,
    rotations: Vec<R>,
    rows: SavedRows<R>,
}

/// Numbers of all bricks, each of which has `numbers` for each of its nodes: 1 where `is_one` says so.
fn units<R: Number>(bricks: usize, numbers: usize, is_one: fn(usize) -> bool) -> Vec<R> {
    let brick = (0..numbers * BRICK_SLOTS).map(|at| f64::from(u8::from(is_one(at / BRICK_SLOTS))));
    brick.cycle().take(bricks * numbers * BRICK_SLOTS).map(R::splat).collect()
}

impl<R: Number> State<R> {
    /// At rest, for a kernel of so many blocks.
    pub fn new(body: &mut Body, rows: method::Rows, blocks: u32, stream: &Arc<Stream>) -> Result<Self> {
        // Cells that have rows are none of the bricks' own.
        let rows = Rows::new(&mut body.bricks, rows, stream)?;
        let count = body.bricks.count();
        // Behind the last brick lies the empty one.
        let fields = |numbers: usize| Buffer::zeros(stream, (count + 1) * numbers * BRICK_SLOTS);
        let shown: Vec<[f32; 4]> = body.words().map(|word| shown(Vec3::zeros(), word)).collect();
        let carriers = MAX_ROW * MAX_SITES;
        let [x, b, r, z] = [(); 4].map(|()| fields(numbers::VECTOR));
        let [p, w, s, ax] = [(); 4].map(|()| fields(numbers::VECTOR));
        let mut state = Self {
            bricks: body.bricks_for(0),
            count,
            cell_m: body.bricks.model.lattice().cell_m(),
            step: Buffer::zeros(stream, size_of::<EfgStep>().div_ceil(4))?,
            laws: Buffer::zeros(stream, 16)?,
            masses: Buffer::zeros(stream, 16)?,
            neighbours: Buffer::of(stream, &body.bricks.neighbours)?,
            flags: Kept::of(stream, body.flags.clone(), 0)?,
            cells: Kept::of(stream, body.bricks.cells.clone(), 0)?,
            shown: Buffer::of(stream, &shown)?,
            mass: Kept::of(stream, Vec::new(), (count + 1) * BRICK_SLOTS)?,
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
            rows,
            pieces: Pieces::new(body, false, stream)?,
            sides: Sides::new(body.slot_count() - body.own_slots(), stream)?,
            cutter: Cutter::new(body.slot_count() - body.own_slots(), stream)?,
            started: Buffer::zeros(stream, 1)?,
        };
        state.set_masses(body)?;
        state.turn_back()?;
        Ok(state)
    }

    /// Cells that are not turned.
    pub fn turn_back(&self) -> Result<()> {
        self.rotations.write(0, &units(self.count, numbers::ROTATION, |n| n == 3))?;
        self.frames.write(0, &units(self.count, numbers::FRAME, |n| n % 4 == 0))?;
        self.rows.turn_back()
    }

    /// Back to rest.
    pub fn rest(&self, body: &Body) -> Result<()> {
        let shown: Vec<_> = body.words().map(|word| shown(Vec3::zeros(), word)).collect();
        self.shown.write(0, &shown)?;
        self.u.clear()?;
        self.v.clear()?;
        self.turn_back()
    }

    /// Other materials.
    pub fn set_laws(&mut self, body: &Body) -> Result<()> {
        self.pieces.weigh(body)?;
        self.set_masses(body)?;
        let mass = &self.mass;
        self.sides.weigh(|slot| mass.host()[slot as usize].to_f64())
    }

    fn set_masses(&mut self, body: &Body) -> Result<()> {
        let kg = self.masses_of(body);
        self.mass.set(kg)?;
        self.masses.write(0, &body.laws.map(|law| Law::of(&law)))
    }

    /// What all nodes weigh.
    fn masses_of(&self, body: &Body) -> Vec<R> {
        let mut kg = vec![0.0; body.slot_count()];
        for slot in body.bricks.model.lattice().slots() {
            kg[slot as usize] = self.whole_mass(body, slot);
        }
        self.rows.add_masses(&body.laws, &mut kg);
        kg.into_iter().map(R::splat).collect()
    }

    /// What cells of a brick's own weigh at a node.
    fn whole_mass(&self, body: &Body, slot: u32) -> f64 {
        if self.rows.are_all() { 0.0 } else { body.bricks.whole_mass(slot, body.corner_kg()) }
    }

    /// Some nodes weigh otherwise.
    fn weigh(&mut self, body: &Body, nodes: &[u32]) -> Result<()> {
        let kg = |slot: u32| self.rows.add_mass(&body.laws, slot, self.whole_mass(body, slot));
        let new: HashMap<u32, R> = nodes.iter().map(|&slot| (slot, R::splat(kg(slot)))).collect();
        self.mass.edit(body.slot_count(), nodes, |slot| new[&(slot as u32)])?;
        debug_assert!(self.mass.host() == self.masses_of(body), "no other node weighs otherwise");
        Ok(())
    }

    /// Mass of the node in a slot, in kg.
    pub fn mass(&self, slot: u32) -> f64 {
        self.mass.host()[slot as usize].to_f64()
    }

    /// Takes over what a cut has made of the tissue.
    pub fn cut(
        &mut self,
        kernel: Kernel,
        topology: &Topology,
        change: &Change,
        body: &mut Body,
    ) -> Result<()> {
        body.bricks.divide(topology, change);
        let turned = self.rows.divide(&body.bricks, topology, change)?;
        self.pieces.take(topology, body)?;
        let cells: BTreeSet<u32> = change.reshaped().collect();
        let cells: Vec<u32> = cells.into_iter().collect();
        self.cells.edit(body.bricks.cells.len(), &cells, |cell| body.bricks.cells[cell])?;
        self.weigh(body, &topology.nodes_of(body.bricks.model.lattice(), change))?;
        let mass = &self.mass;
        self.sides.take(topology, change, |slot| mass.host()[slot as usize].to_f64())?;
        self.bricks = body.bricks_for(topology.copy_count());
        let fields = Fields {
            u: [self.shown.at(), 0],
            vectors: [self.u.at(), self.v.at()],
            rotations: self.rotations.at(),
            row_rotations: self.rows.rotations.at(),
        };
        self.cutter.take(kernel, change, body, &turned, fields)
    }

    /// All cells are whole again; [`Self::rest`] follows.
    pub fn heal(&mut self, body: &mut Body) -> Result<()> {
        body.heal();
        self.rows.heal(&mut body.bricks)?;
        self.pieces.heal();
        self.sides.heal();
        self.cells.set(body.bricks.cells.clone())?;
        self.flags.set(body.flags.clone())?;
        self.set_masses(body)?;
        self.bricks = body.bricks_for(0);
        Ok(())
    }

    /// Copies what later steps read.
    pub fn save(&self) -> Result<SavedState<R>> {
        Ok(SavedState {
            u: self.u.all()?,
            v: self.v.all()?,
            shown: self.shown.all()?,
            rotations: self.rotations.all()?,
            rows: self.rows.save()?,
        })
    }

    /// Goes on from there: the cuts and the laws of then are in force.
    pub fn restore(&mut self, saved: &SavedState<R>, body: &Body) -> Result<()> {
        self.u.write(0, &saved.u)?;
        self.v.write(0, &saved.v)?;
        self.shown.write(0, &saved.shown)?;
        self.rotations.write(0, &saved.rotations)?;
        self.rows.restore(&saved.rows, &body.bricks)?;
        // Masses add up in the order of the rows.
        self.set_laws(body)
    }

    /// Moduli, and what a step makes of each material's.
    pub fn set_moduli(&self, laws: &[CellLaw; 16], factor: impl Fn(&CellLaw) -> f64) -> Result<()> {
        self.laws.write(0, &laws.map(|law| EfgLaw::of(&law, self.cell_m, factor(&law))))
    }

    /// Other nodes are held.
    pub fn set_flags(&mut self, flags: &[u8]) -> Result<()> {
        self.flags.set(flags.to_vec())
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
        let mut pass = Pass {
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
            piece_bricks: 0,
            pieces: 0,
        };
        self.pieces.note_in(&mut pass);
        pass
    }

    /// The sides of cuts.
    pub fn sides(&self) -> layout::Sides {
        self.sides.on_device()
    }

    /// What the kernel of a step works on; `pass` is what the kernels before it had.
    pub fn on_device(&self, pass: &Pass, report: CUdeviceptr) -> layout::Efg {
        let [x, b, r, z, p, w, s, ax] = self.system.each_ref().map(Buffer::at);
        layout::Efg {
            bricks: self.bricks,
            starts: u32::from(pass.started != 0),
            row_count: self.rows.count() as u32,
            is_followed: 0,
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
            row_bricks: self.rows.bricks.at(),
            row_starts: self.rows.starts.at(),
            row_places: self.rows.places.at(),
            row_rotations: self.rows.rotations.at(),
            row_frames: self.rows.frames.at(),
            row_given: self.rows.given.at(),
            report,
        }
    }

    /// Bytes of state, system and topology.
    pub fn bytes(&self) -> u64 {
        let fields = [&self.heavy, &self.inverse, &self.rotations, &self.frames, &self.u, &self.v];
        let numbers = fields.into_iter().chain(&self.system).map(Buffer::bytes).sum::<u64>();
        numbers
            + self.mass.bytes()
            + self.pieces.bytes()
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
