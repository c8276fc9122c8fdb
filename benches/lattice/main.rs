//! How fast the lattice steps, on scenes with a tool in contact, against the serial algorithm that it replaces.
//!
//! `cargo bench --bench lattice` prints a table, `cargo bench --bench lattice -- --json` one object per line. All options:
//! `cargo bench --bench lattice -- --help`. The scenes of real anatomy need the folder that `PALPATE_DATA` names.
//!
//! A *step* below is one call of [`palpate::sim::Sim::step`], which consists of substeps:
//!
//! | key | what |
//! |---|---|
//! | `us_per_step` | median over steps of wall time by substeps: what one pass over all nodes costs |
//! | `least_us_per_step`, `baseline_least_us` | the fastest of them, for machines that are busy with something else |
//! | `p50_us`, `p99_us`, `p999_us` | wall time of whole steps: what a servo loop waits |
//! | `rtf` | simulated by wall time of all measured steps |
//! | `dt_s`, `substep_s`, `substeps` | simulated length of a step, of a substep, and how many of these the last step had |
//! | `awake_nodes` | mean over the measured steps |
//! | `allocations` | heap allocations by any thread while steps were measured |
//! | `bytes_per_node` | resident for state and topology, without surfaces |
//! | `baseline_us_per_step`, `ratio` | median of [`baseline::Serial`]'s steps, taken before and after; that over `us_per_step` |
//!
//! Gravity is on and the rest shape is in balance with it, as in any simulation that does not ask otherwise; so is background drag.

use std::process::ExitCode;

use clap::Parser;

mod allocations;
mod baseline;
mod ellipsoid;
mod measure;
mod options;
mod press;
mod report;
mod thorax;

use self::options::{Backend, Options, SceneName};
use self::report::Report;

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;

fn main() -> ExitCode {
    let options = Options::parse();
    if options.backend == Backend::Cuda {
        eprintln!("lattice: the backend 'cuda' is not in this build");
        return ExitCode::from(2);
    }
    let mut report = Report::new(options.json);
    for scene in options.scenes() {
        match scene {
            SceneName::Ellipsoid => ellipsoid::run(&options, &mut report),
            SceneName::Thorax45 | SceneName::Thorax3 | SceneName::Lung45 => {
                thorax::run(scene, &options, &mut report);
            }
        }
    }
    report.finish()
}
