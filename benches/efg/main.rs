//! How fast the meshless model takes implicit steps.
//!
//! `cargo bench --bench efg` prints a table, `cargo bench --bench efg -- --json` one object per line. A block of cubic cells of 2 mm, 5 kPa, ν = 0.45, held at its base, hangs
//! under gravity and is pressed by a ball of a sixth of its width.
//!
//! `us_per_step` is the median of a whole update: frames, forces, contact, solution, motion; `device_us_per_step` that of what the device was at work;
//! `us_per_iteration` the least over steps of a whole update by its iterations. `bytes_uploaded` go to a GPU in a step.
//! `baseline_us_per_step` is the median of the paper's flow of data on the same block, pressed along the same way; `ratio` is that over `us_per_step`.
//! `lattice_us_per_step` is that of the lattice on the same block, whose steps are as many substeps as are stable; `lattice_rtf` its tissue time by time.
//! `error` and `lattice_error` are the root mean squares of what their forces differ by from those of the same block in finer cells and steps, over the largest of these, which
//! are the mean of both models' there; `reference_doubt` is how far each of the two is from that mean. `least_us` and `lattice_least_us` are the least of a step.
//! `cg_iterations` is the mean of those, over all solutions of a step; `true_residual` the largest share of a step's first residual that was left.

use std::process::ExitCode;

use clap::Parser;

mod baseline;
mod beside;
#[path = "../common/mod.rs"]
#[allow(dead_code, reason = "each bench uses a part")]
mod common;
mod options;
mod press;
mod report;

use self::common::allocations;
use self::common::place::Place;
use self::options::Options;
use self::report::Report;

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;

fn main() -> ExitCode {
    let options = Options::parse();
    let place = match Place::of(&options.machine) {
        Ok(place) => place,
        Err(error) => {
            eprintln!("efg: {error}");
            return ExitCode::from(2);
        }
    };
    let mut report = Report::new(options.json, place);
    for cells in options.cells() {
        for dt in options.dt() {
            match press::run(&options, cells, dt) {
                Ok(figure) => report.add(&figure),
                Err(error) => report.fail(cells, &error.to_string()),
            }
        }
    }
    report.finish()
}
