//! A simulation's nodes on the device.

use std::sync::Arc;

use super::layout::{Law, MARK_BYTES, Pass, SOUND, Step, share};
use super::memory::{Buffer, Stream};
use crate::error::Result;
use crate::model::Model;
use crate::model::lattice::BRICK_SLOTS;

/// What lies on the device.
#[derive(Debug)]
pub struct State {
    pub bricks: u32,
    /// Displacements and words, twice; `current` says which is which.
    pub u: [Buffer<[f32; 4]>; 2],
    pub current: usize,
    /// Velocities; twice where springs are damped.
    pub v: Vec<Buffer<f32>>,
    neighbours: Buffer<[u32; 27]>,
    pub flags: Buffer<u8>,
    pub laws: Buffer<Law>,
    pub step: Buffer<u32>,
    pub marks: Buffer<u8>,
    pub diverged_at: Buffer<u32>,
    /// When the last step began, by the device's clock, in ns.
    pub started: Buffer<u64>,
    cell: f32,
}

impl State {
    /// A model at rest.
    pub fn new(model: &Model, stream: &Arc<Stream>) -> Result<Self> {
        let lattice = model.lattice();
        let bricks = lattice.bricks().len();
        let damped = model.laws().iter().any(|law| law.damping_s > 0.0);
        let neighbours: Vec<[u32; 27]> = lattice.surroundings().collect();
        // The words travel with the displacements; behind them lies the empty brick.
        let words = lattice.words().iter().copied().chain([0; BRICK_SLOTS]);
        let u: Vec<[f32; 4]> = words.map(|word| [0.0, 0.0, 0.0, f32::from_bits(word)]).collect();
        let velocities = || Buffer::zeros(stream, (bricks + 1) * 3 * BRICK_SLOTS);
        Ok(Self {
            bricks: bricks as u32,
            u: [Buffer::of(stream, &u)?, Buffer::of(stream, &u)?],
            current: 0,
            v: (0..1 + usize::from(damped)).map(|_| velocities()).collect::<Result<_>>()?,
            neighbours: Buffer::of(stream, &neighbours)?,
            flags: Buffer::of(stream, lattice.flags())?,
            laws: Buffer::of(stream, &model.laws().map(|law| Law::of(&law)))?,
            step: Buffer::zeros(stream, size_of::<Step>().div_ceil(4))?,
            // The report reads them four by four.
            marks: Buffer::zeros(stream, bricks.next_multiple_of(4) * MARK_BYTES)?,
            diverged_at: {
                let flag = Buffer::zeros(stream, 1)?;
                flag.write(0, &[SOUND])?;
                flag
            },
            started: Buffer::zeros(stream, 1)?,
            cell: lattice.cell_m() as f32,
        })
    }

    /// What substep number `substep` of a step reads and writes, when the step starts at copy `start` of `u`.
    pub fn pass(&self, start: usize, substep: u32, mark: bool) -> Pass {
        let from = (start + substep as usize + 1) % 2;
        let v = |copy: usize| self.v[copy % self.v.len()].at();
        Pass {
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
        }
    }

    /// Where springs are damped, velocities of the last substep are kept while new ones are written. Both are the current ones.
    pub fn keep_velocities(&mut self, damped: bool, stream: &Arc<Stream>) -> Result<()> {
        if damped && self.v.len() == 1 {
            let mut all = vec![0.0; (self.bricks as usize + 1) * 3 * BRICK_SLOTS];
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
        fields + self.neighbours.bytes() + self.flags.bytes() + self.marks.bytes()
    }
}
