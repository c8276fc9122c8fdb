//! What the lattice is compared with, in the same process and on the same nodes: the algorithms of Etheredge 2011, with the arrays that are
//! printed there.
//!
//! In both, as printed, forces are halved, the Verlet step has a factor ½, masses are 1 and all springs of a material have one stiffness. Neither
//! controls Poisson's ratio or knows friction, other tools than a sphere, or sleep.

use std::time::{Duration, Instant};

use palpate::error::Result;

pub mod masses;
pub mod parallel;
pub mod serial;

/// Least number of advances, and least time, that one round of measuring takes.
const ADVANCES: usize = 5;
const ROUND: Duration = Duration::from_millis(200);

/// A mass–spring system that runs.
pub trait Baseline {
    /// How figures name it.
    fn name(&self) -> &'static str;

    /// Takes some steps and waits for them; gives how many.
    fn advance(&mut self) -> Result<u32>;

    /// Refuses a state that no figure should come from.
    fn check(&self) -> Result<()>;
}

/// Adds the wall times of some steps, in microseconds.
pub fn measure(baseline: &mut dyn Baseline, times_us: &mut Vec<f64>) -> Result<()> {
    baseline.advance()?;
    let start = Instant::now();
    for advance in 0.. {
        if advance >= ADVANCES && start.elapsed() >= ROUND {
            break;
        }
        let started = Instant::now();
        let steps = baseline.advance()?;
        times_us.push(started.elapsed().as_secs_f64() * 1e6 / f64::from(steps));
    }
    baseline.check()
}
