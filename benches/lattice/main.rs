//! How fast the lattice steps, on scenes with a tool in contact, against the algorithms that it replaces.
//!
//! `cargo bench --bench lattice` prints a table, `cargo bench --bench lattice -- --json` one object per line, `-- --backend cuda` runs all of it
//! on a GPU. All options: `cargo bench --bench lattice -- --help`. The scenes of real anatomy need the folder that `PALPATE_DATA` names.
//!
//! A *step* below is one call of [`palpate::sim::Sim::step`], which consists of substeps: on the processor, of a millisecond with as many as
//! the model needs; on a GPU, of a hundred that are stable (see [`pace`]).
//!
//! | key | what |
//! |---|---|
//! | `us_per_step` | median over steps of wall time by substeps: what one pass over all nodes costs |
//! | `least_us_per_step`, `baseline_least_us` | the fastest of them, for machines that are busy with something else |
//! | `device_us_per_step` | on a GPU, median over steps of the time that it was at work by substeps, by its own clock |
//! | `p50_us`, `p99_us`, `p999_us` | wall time of whole steps: what a servo loop waits |
//! | `rtf` | simulated by wall time of all measured steps |
//! | `dt_s`, `substep_s`, `substeps` | simulated length of a step, of a substep, and how many of these the last step had |
//! | `awake_nodes` | mean over the measured steps |
//! | `allocations` | heap allocations by any thread while steps were measured |
//! | `bytes_uploaded` | copied to the GPU in all measured steps |
//! | `bytes_per_node` | resident for state and topology, without surfaces |
//! | `max_force_n`, `contact_points`, `dropped_points` | largest force and most points in contact while steps were measured; points without room, ever |
//! | `baseline_us_per_step`, `ratio` | median of the [`baseline`]'s steps, taken before and after; that over `us_per_step` |
//!
//! With `--latency`, a step has one substep, and a *tick* is what a servo loop does: the host writes a pose, steps, and reads the force. `p50_us` to
//! `max_us` are then wall times of ticks, `step_p50_us` to `step_p999_us` those of the steps in them as the simulation itself counts them
//! (up to 19 % too long, see [`palpate::sim::Latency`]), `min_force_n` and `max_force_n` the bounds of the force while they were taken.
//!
//! With `--still`, no tool is there, and `us_per_step` is what a substep takes of tissue that is all awake, and then of tissue that all sleeps.
//!
//! Gravity is on and the rest shape is in balance with it, as in any simulation that does not ask otherwise; so is background drag. Steps
//! without any contact are an error, and so is a missing GPU.

use std::process::ExitCode;

use clap::Parser;

pub(crate) mod baseline;
#[path = "../common/mod.rs"]
#[allow(dead_code, reason = "each bench uses a part")]
pub(crate) mod common;
pub(crate) mod ellipsoid;
mod latency;
mod measure;
pub(crate) mod options;
pub(crate) mod pace;
mod press;
mod report;
mod still;
mod thorax;

use self::common::allocations;
use self::common::place::Place;
use self::options::{Options, SceneName};
use self::report::Report;

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;

fn main() -> ExitCode {
    let options = Options::parse();
    match Place::of(&options.machine) {
        Ok(place) => run(&options, place),
        Err(error) => {
            eprintln!("lattice: {error}");
            ExitCode::from(2)
        }
    }
}

/// Runs all that the options ask for.
fn run(options: &Options, place: Place) -> ExitCode {
    let mut report = Report::new(options.json, place);
    if options.latency {
        latency::run(options, &mut report);
        return report.finish();
    }
    if options.still {
        still::run(options, &mut report);
        return report.finish();
    }
    for scene in options.scenes() {
        match scene {
            SceneName::Ellipsoid => ellipsoid::run(options, &mut report),
            SceneName::Thorax45 | SceneName::Thorax3 | SceneName::Thorax15 | SceneName::Lung45 => {
                thorax::run(scene, options, &mut report);
            }
        }
    }
    report.finish()
}
