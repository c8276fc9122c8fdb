//! Which bricks sleep: the rules are those of `src/cpu/sleep.rs`, applied every few substeps. In steps in which a region is driven nothing sleeps.

use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use super::body::Body;
use super::kernels::Kernels;
use super::layout::{self, Pass, sleepers};
use super::memory::{Buffer, Stream};
use super::pointer;
use crate::cpu::sleep::{Thresholds, WAKE_FACTOR};
use crate::error::Result;
use crate::model::lattice::BRICK_SLOTS;

/// Threads of a block of both kernels, and of a brick in the first.
const THREADS: u32 = 128;
const WARP: u32 = 32;
/// Substeps between two looks at who sleeps, where some do; a step's end is looked at always.
const LOOK_EVERY: u32 = 8;
/// Fewest blocks for what is awake.
const FEWEST_BLOCKS: u32 = 128;

/// What stands for every brick that is not there sleeps.
const NOT_THERE: u8 = 1;

/// How a step goes about sleep: equal plans are recorded once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Plan {
    /// Nothing sleeps, and nothing may.
    #[default]
    Never,
    /// Nothing sleeps; at the end bricks may fall asleep.
    AtEnd,
    /// Some sleep, or all. So many blocks share those that are awake.
    Listed {
        blocks: u32,
        /// Whether all sleep and nothing in the step can wake any: it is looked at its end alone.
        is_still: bool,
    },
}

/// Who sleeps, as a snapshot has it.
#[derive(Debug)]
pub struct Sleepers {
    acted_on: Vec<u8>,
    asleep: Vec<u8>,
    quiet: Vec<u8>,
    awake: Vec<u32>,
    watched: Vec<u32>,
    counts: Vec<u32>,
    could_sleep: bool,
    counted: Option<[u32; sleepers::COUNTS]>,
}

/// Which bricks sleep, on the device.
#[derive(Debug)]
pub struct Sleep {
    /// Bricks that hold nodes, and how many there are with the loose ones.
    bricks: u32,
    count: usize,
    nodes: u32,
    thresholds: Thresholds,
    acted_on: Buffer<u8>,
    asleep: Buffer<u8>,
    quiet: Buffer<u8>,
    nodes_in: Buffer<u8>,
    awake: Buffer<u32>,
    watched: Buffer<u32>,
    counts: Buffer<u32>,
    /// Whether bricks were allowed to sleep in the last step.
    could_sleep: bool,
    /// What the last step counted; nothing where all are awake.
    counted: Option<[u32; sleepers::COUNTS]>,
}

impl Sleep {
    /// Everything awake, and quiet never: see [`Self::set_thresholds`].
    pub fn new(body: &Body, stream: &Arc<Stream>) -> Result<Self> {
        let (lattice, count) = (body.bricks.model.lattice(), body.bricks.count());
        let held = |words: &[u32]| words.iter().filter(|word| **word != 0).count() as u8;
        // Copies are not counted.
        let mut nodes_in: Vec<u8> = lattice.words().chunks_exact(BRICK_SLOTS).map(held).collect();
        nodes_in.resize(count, 0);
        let sleep = Self {
            bricks: body.bricks_for(0),
            count,
            nodes: lattice.node_count() as u32,
            thresholds: Thresholds { speed: 0.0, acceleration: 0.0 },
            acted_on: Buffer::zeros(stream, count + 1)?,
            asleep: Buffer::zeros(stream, count + 1)?,
            quiet: Buffer::zeros(stream, count)?,
            nodes_in: Buffer::of(stream, &nodes_in)?,
            awake: Buffer::zeros(stream, count)?,
            watched: Buffer::zeros(stream, count)?,
            counts: Buffer::zeros(stream, sleepers::COUNTS)?,
            could_sleep: false,
            counted: None,
        };
        sleep.asleep.write(count, &[NOT_THERE])?;
        Ok(sleep)
    }

    /// So many bricks hold nodes from now on. All wake.
    pub fn set_bricks(&mut self, bricks: u32) -> Result<()> {
        self.bricks = bricks;
        self.wake_all()
    }

    /// What counts as quiet in cells of this edge, in m, by the model's highest angular frequency in rad/s. Recorded steps name it.
    pub fn set_thresholds(&mut self, cell_m: f64, omega: f64) {
        self.thresholds = Thresholds::new(cell_m, omega, f64::from(f32::EPSILON));
    }

    /// What a step does in which bricks may sleep or may not. Where `lists`, sites are listed and may wake some.
    pub fn prepare(&mut self, may_sleep: bool, lists: bool) -> Result<Plan> {
        if !may_sleep {
            if std::mem::take(&mut self.could_sleep) {
                self.wake_all()?;
            }
            return Ok(Plan::Never);
        }
        self.could_sleep = true;
        Ok(match self.counted {
            None => Plan::AtEnd,
            Some(counted) => {
                // More may wake: blocks then take several bricks.
                let busy = counted[sleepers::AWAKE] + counted[sleepers::WATCHED];
                let blocks = busy.next_power_of_two().max(FEWEST_BLOCKS);
                Plan::Listed { blocks: blocks.min(self.bricks), is_still: busy == 0 && !lists }
            }
        })
    }

    /// As at creation.
    pub fn reset(&mut self) -> Result<()> {
        self.acted_on.clear()?;
        self.wake_all()
    }

    /// Wakes everything.
    pub fn wake_all(&mut self) -> Result<()> {
        self.quiet.clear()?;
        if self.counted.take().is_none() {
            return Ok(());
        }
        self.asleep.clear()?;
        self.asleep.write(self.count, &[NOT_THERE])
    }

    /// Who sleeps now.
    pub fn sleepers(&self) -> Result<Sleepers> {
        Ok(Sleepers {
            acted_on: self.acted_on.all()?,
            asleep: self.asleep.all()?,
            quiet: self.quiet.all()?,
            awake: self.awake.all()?,
            watched: self.watched.all()?,
            counts: self.counts.all()?,
            could_sleep: self.could_sleep,
            counted: self.counted,
        })
    }

    /// Lets those sleep who slept then.
    pub fn set_sleepers(&mut self, then: &Sleepers) -> Result<()> {
        self.acted_on.write(0, &then.acted_on)?;
        self.asleep.write(0, &then.asleep)?;
        self.quiet.write(0, &then.quiet)?;
        self.awake.write(0, &then.awake)?;
        self.watched.write(0, &then.watched)?;
        self.counts.write(0, &then.counts)?;
        (self.could_sleep, self.counted) = (then.could_sleep, then.counted);
        Ok(())
    }

    /// What a step counted. Gives how many bricks and nodes are awake.
    pub fn tell(&mut self, plan: Plan, counted: [u32; sleepers::COUNTS]) -> [u64; 2] {
        let all = plan == Plan::Never || counted[sleepers::AWAKE] == self.bricks;
        self.counted = (!all).then_some(counted);
        if all {
            return [self.bricks, self.nodes].map(u64::from);
        }
        [counted[sleepers::AWAKE], counted[sleepers::AWAKE_NODES]].map(u64::from)
    }

    /// Where bricks are noted that may not sleep, for something else than tools acts on them.
    pub fn acted_on(&self) -> CUdeviceptr {
        self.acted_on.at()
    }

    /// What kernels know.
    pub fn on_device(&self) -> layout::Sleep {
        let Thresholds { speed, acceleration } = self.thresholds;
        layout::Sleep {
            bricks: self.bricks,
            speed2: speed.powi(2),
            acceleration2: acceleration.powi(2),
            wake2: (WAKE_FACTOR * acceleration).powi(2),
            asleep: self.asleep.at(),
            quiet: self.quiet.at(),
            nodes_in: self.nodes_in.at(),
            awake: self.awake.at(),
            watched: self.watched.at(),
            counts: self.counts.at(),
        }
    }

    /// Asks the stream to decide who sleeps at the end of a substep that left marks, `substeps` after the last time; where those are none, to wake those
    /// near tools.
    ///
    /// # Safety
    /// `pass` is that of the substep, and outlives the work.
    pub unsafe fn decide(
        &self,
        kernels: &Kernels,
        stream: &Stream,
        pass: &mut Pass,
        mut substeps: u32,
    ) -> Result<()> {
        // What was seen once says nothing of a long time before.
        substeps = substeps.min(LOOK_EVERY);
        let mut sleep = self.on_device();
        let launch = [
            (kernels.doze, (self.bricks * WARP).div_ceil(THREADS)),
            (kernels.muster, self.bricks.div_ceil(THREADS)),
        ];
        let arguments = &mut [pointer(pass), pointer(&mut sleep), pointer(&mut substeps)];
        for (kernel, blocks) in launch {
            // SAFETY: one takes the arguments as declared, the other the first two.
            unsafe { kernel.launch(&stream.device, stream.handle, blocks, THREADS, arguments)? };
        }
        Ok(())
    }
}

impl Plan {
    /// How many substeps have passed since the last look at who sleeps, where there is one at the end of this substep.
    pub fn look(self, substep: u32, substeps: u32) -> Option<u32> {
        let since = (substep - 1) % LOOK_EVERY + 1;
        match self {
            Self::Never => None,
            Self::AtEnd | Self::Listed { is_still: true, .. } => (substep == substeps).then_some(substeps),
            Self::Listed { .. } => (substep == substeps || since == LOOK_EVERY).then_some(since),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_at_who_sleeps_count_every_substep_once() {
        let listed = |is_still| Plan::Listed { blocks: 1, is_still };
        for substeps in [1, 7, 8, 9, 100] {
            let looks = |plan: Plan| (1..=substeps).map(move |substep| plan.look(substep, substeps));
            for plan in [Plan::AtEnd, listed(true), listed(false)] {
                assert_eq!(looks(plan).flatten().sum::<u32>(), substeps);
                assert!(plan.look(substeps, substeps).is_some(), "the end is always looked at");
            }
            assert_eq!(looks(listed(true)).flatten().count(), 1);
            assert!(looks(listed(false)).flatten().all(|since| since <= LOOK_EVERY));
            assert!(looks(Plan::Never).all(|look| look.is_none()));
        }
    }
}
