//! A simulation's nodes on the device.

use std::sync::Arc;

use super::body::Body;
use super::cut::{Cutter, Fields};
use super::kept::Kept;
use super::kernels::Kernel;
use super::layout::{Law, MARK_BYTES, Pass, SOUND, Step, share};
use super::memory::{Buffer, Stream};
use super::pieces::Pieces;
use super::sides::Sides;
use crate::cut::topology::{Change, Topology};
use crate::error::Result;
use crate::model::lattice::BRICK_SLOTS;

/// What lies on the device.
#[derive(Debug)]
pub struct State {
    /// Bricks that hold nodes.
    pub bricks: u32,
    /// Displacements and words, twice; `current` says which is which.
    pub u: [Buffer<[f32; 4]>; 2],
    pub current: usize,
    /// Velocities; twice where springs are damped.
    pub v: Vec<Buffer<f32>>,
    neighbours: Buffer<[u32; 27]>,
    pub flags: Kept<u8>,
    pub laws: Buffer<Law>,
    pub step: Buffer<u32>,
    pub marks: Buffer<u8>,
    pub diverged_at: Buffer<u32>,
    pub pieces: Pieces,
    pub sides: Sides,
    cutter: Cutter,
    /// When the last step began, by the device's clock, in ns.
    pub started: Buffer<u64>,
    cell: f32,
}

impl State {
    /// A model at rest.
    pub fn new(body: &Body, stream: &Arc<Stream>) -> Result<Self> {
        let count = body.bricks.count();
        let (_, damped) = body.asks_for();
        let u = at_rest(body);
        let velocities = || Buffer::zeros(stream, (count + 1) * 3 * BRICK_SLOTS);
        Ok(Self {
            bricks: body.bricks_for(0),
            u: [Buffer::of(stream, &u)?, Buffer::of(stream, &u)?],
            current: 0,
            v: (0..1 + usize::from(damped)).map(|_| velocities()).collect::<Result<_>>()?,
            neighbours: Buffer::of(stream, &body.bricks.neighbours)?,
            flags: Kept::of(stream, body.flags.clone(), 0)?,
            laws: Buffer::of(stream, &body.laws.map(|law| Law::of(&law)))?,
            step: Buffer::zeros(stream, size_of::<Step>().div_ceil(4))?,
            // The report reads them four by four.
            marks: Buffer::zeros(stream, count.next_multiple_of(4) * MARK_BYTES)?,
            diverged_at: {
                let flag = Buffer::zeros(stream, 1)?;
                flag.write(0, &[SOUND])?;
                flag
            },
            started: Buffer::zeros(stream, 1)?,
            pieces: Pieces::new(body, true, stream)?,
            sides: Sides::new(body.slot_count() - body.own_slots(), stream)?,
            cutter: Cutter::new(body.slot_count() - body.own_slots(), stream)?,
            cell: body.bricks.model.lattice().cell_m() as f32,
        })
    }

    /// What substep number `substep` of a step reads and writes, when the step starts at copy `start` of `u`.
    pub fn pass(&self, start: usize, substep: u32, mark: bool) -> Pass {
        let from = (start + substep as usize + 1) % 2;
        let v = |copy: usize| self.v[copy % self.v.len()].at();
        let mut pass = Pass {
            u: self.u[from].at(),
            u_next: self.u[1 - from].at(),
            v: v(from),
            v_next: v(1 - from),
            neighbours: self.neighbours.at(),
            flags: self.flags.at(),
            laws: self.laws.at(),
            step: self.step.at(),
            marks: self.marks.at(),
            diverged_at: self.diverged_at.at(),
            started: if substep == 1 { self.started.at() } else { 0 },
            cell: self.cell,
            substep,
            mark: u32::from(mark),
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

    /// Takes over what a cut has made of the tissue.
    pub fn cut(
        &mut self,
        kernel: Kernel,
        topology: &Topology,
        change: &Change,
        body: &mut Body,
    ) -> Result<()> {
        body.bricks.divide(topology, change);
        self.pieces.take(topology, body)?;
        self.sides.take(topology, change, |slot| body.node_mass(slot))?;
        self.bricks = body.bricks_for(topology.copy_count());
        let fields = Fields {
            u: self.u.each_ref().map(Buffer::at),
            vectors: [0, 1].map(|copy| self.v.get(copy).map_or(0, Buffer::at)),
            rotations: 0,
            row_rotations: 0,
        };
        self.cutter.take(kernel, change, body, &[], fields)
    }

    /// All cells are whole again; a return to rest follows.
    pub fn heal(&mut self, body: &mut Body) -> Result<()> {
        body.heal();
        self.pieces.heal();
        self.sides.heal();
        self.bricks = body.bricks_for(0);
        self.marks.clear()?;
        self.flags.set(body.flags.clone())
    }

    /// Back to rest.
    pub fn rest(&self, body: &Body) -> Result<()> {
        let u = at_rest(body);
        self.u.iter().try_for_each(|copy| copy.write(0, &u))?;
        self.v.iter().try_for_each(Buffer::clear)
    }

    /// Where springs are damped, velocities of the last substep are kept while new ones are written. Both are the current ones.
    pub fn keep_velocities(&mut self, damped: bool, stream: &Arc<Stream>) -> Result<()> {
        if damped && self.v.len() == 1 {
            let mut all = vec![0.0; self.v[0].room()];
            self.v[0].read(0, &mut all)?;
            self.v.push(Buffer::of(stream, &all)?);
        }
        Ok(())
    }

    /// The current velocities.
    pub fn velocities(&self) -> &Buffer<f32> {
        &self.v[self.current % self.v.len()]
    }

    /// Bytes of all that.
    pub fn bytes(&self) -> u64 {
        let fields = self.u.iter().map(Buffer::bytes).chain(self.v.iter().map(Buffer::bytes)).sum::<u64>();
        fields + self.neighbours.bytes() + self.flags.bytes() + self.marks.bytes() + self.pieces.bytes()
    }
}

/// Displacements and words of all slots at rest, and of the empty brick behind them.
fn at_rest(body: &Body) -> Vec<[f32; 4]> {
    body.words().map(|word| [0.0, 0.0, 0.0, f32::from_bits(word)]).collect()
}
