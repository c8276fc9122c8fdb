//! What acts on the tissue besides contact: loads, rigid regions that are driven, tools that hold nodes, and the damping by which it settles.

mod drive;
mod hold;
mod push;
mod stick;

use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use super::body::Body;
use super::kernels::Kernels;
use super::layout::{self, Pass};
use super::memory::Stream;
use super::pointer;
use crate::error::Result;
use crate::model::Model;
use crate::model::lattice::BRICK_SLOTS;
use crate::solver::StepPlan;
use drive::Drives;
use hold::Holds;
use push::Pushes;
use stick::Sticks;

/// Threads of a block with a thread for each node, of the one block that takes along what tools hold, and of the one that judges.
const THREADS: u32 = 128;
const HOLD_THREADS: u32 = 256;
const JUDGE_THREADS: u32 = 1024;

/// What is done after each substep: equal plans are recorded once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Plan {
    pub push: layout::Push,
    pub drive: layout::Drive,
    pub hold: layout::Hold,
    pub sticks: layout::Sticks,
    /// Whether velocities are cleared whenever Σ m v² falls.
    pub settles: bool,
}

/// A step with loads, regions and what tools hold.
#[derive(Debug)]
pub struct Prepared {
    pub plan: Plan,
    /// How much loads alone accelerate any node at most, in m/s².
    pub acceleration: f64,
    /// How far regions and what tools hold go at most, in m.
    pub way: f64,
}

/// Loads, regions and what tools hold, on the device.
#[derive(Debug)]
pub struct Outside {
    pushes: Pushes,
    drives: Drives,
    holds: Holds,
    sticks: Sticks,
}

impl Outside {
    /// Nothing acts on the model yet; `slots` is how many there are for nodes where steps are implicit.
    pub fn new(model: &Arc<Model>, slots: Option<usize>, stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            pushes: Pushes::new(model, stream)?,
            drives: Drives::new(model, stream)?,
            holds: Holds::new(model, stream)?,
            sticks: Sticks::new(slots, stream)?,
        })
    }

    /// Brings to the device what a step needs and it does not have. The last step must have been reported. `sums` are the tools'.
    pub fn prepare(
        &mut self,
        plan: &StepPlan,
        body: &Body,
        kg: impl Fn(u32) -> f64,
        sums: CUdeviceptr,
    ) -> Result<Prepared> {
        let (push, acceleration) = self.pushes.prepare(plan.loads, body)?;
        let (drive, driven) = self.drives.prepare(plan)?;
        let (hold, held) = self.holds.prepare(plan, body, sums)?;
        let sticks = self.sticks.prepare(plan, kg, sums, hold.count > 0)?;
        let plan = Plan { push, drive, hold, sticks, settles: plan.kinetic_damping };
        Ok(Prepared { plan, acceleration, way: driven.max(held) })
    }

    /// Loads have changed.
    pub fn forget_loads(&mut self) {
        self.pushes.forget();
    }

    /// Materials have changed, or what is held.
    pub fn forget_masses(&mut self) {
        self.pushes.forget();
        self.holds.forget();
    }
}

impl Plan {
    /// Whether nothing acts but contact.
    pub fn is_idle(self) -> bool {
        self.push.count == 0 && self.drive.count == 0 && !self.holds() && !self.sticks() && !self.settles
    }

    /// Whether tools hold nodes: their sums begin with that.
    pub fn holds(self) -> bool {
        self.hold.count > 0
    }

    /// Whether tissue sticks to blades: else sums begin with that.
    pub fn sticks(self) -> bool {
        self.sticks.all != 0
    }

    /// Asks the stream to push, drive and carry nodes after they have moved by themselves.
    ///
    /// # Safety
    /// The stream's context is current. `pass` is that of the substep; it and the lists of the plan outlive the work.
    pub unsafe fn act(mut self, kernels: &Kernels, stream: &Stream, pass: &mut Pass) -> Result<()> {
        let launch = [
            (kernels.push, self.push.count.div_ceil(THREADS), THREADS, pointer(&mut self.push)),
            (kernels.drive, self.drive.count.div_ceil(THREADS), THREADS, pointer(&mut self.drive)),
            (kernels.hold, self.hold.count.min(1), HOLD_THREADS, pointer(&mut self.hold)),
        ];
        for (kernel, blocks, threads, list) in launch.into_iter().filter(|(_, blocks, ..)| *blocks > 0) {
            let arguments = &mut [pointer(pass), list];
            // SAFETY: the kernels' arguments, as declared.
            unsafe { kernel.launch(&stream.device, stream.handle, blocks, threads, arguments)? };
        }
        Ok(())
    }

    /// Asks the stream to clear velocities at the end of a substep where Σ m v² has fallen.
    ///
    /// # Safety
    /// As [`Self::act`]; the pass marks its `bricks` bricks and `step` is its record.
    pub unsafe fn settle(
        self,
        kernels: &Kernels,
        stream: &Stream,
        pass: &mut Pass,
        mut bricks: u32,
        mut step: CUdeviceptr,
    ) -> Result<()> {
        if !self.settles {
            return Ok(());
        }
        let launch = [(kernels.judge, 1, JUDGE_THREADS), (kernels.halt, bricks, BRICK_SLOTS as u32)];
        let arguments = &mut [pointer(pass), pointer(&mut bricks), pointer(&mut step)];
        for (kernel, blocks, threads) in launch {
            // SAFETY: one takes the arguments as declared, the other the first alone.
            unsafe { kernel.launch(&stream.device, stream.handle, blocks, threads, arguments)? };
        }
        Ok(())
    }
}
