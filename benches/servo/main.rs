//! How fast, how true and how stable the servo loop of a haptic device is, with real tissue behind it.
//!
//! `cargo bench --bench servo` prints tables, `cargo bench --bench servo -- --json` one object per line; `-- --figure NAME` takes one of them. All
//! options: `cargo bench --bench servo -- --help`. The closed loop and the chest need the folder that `PALPATE_DATA` names.
//!
//! | figure | what |
//! |---|---|
//! | `exchange` | what a tick costs its thread: [`palpate::sim::ToolPort::exchange`], or the C function around it, in contact, the simulation on its own thread |
//! | `closed-loop` | a simulated device and hand at 1 kHz of real time on the lungs, the simulation on its own thread |
//! | `prediction` | the newest contact model at a tick's motion against the wrench that a solve gives there; simulated time |
//! | `stability` | the least energy of the loop over stiffness and damping of the coupling, with the chain and without; simulated time |
//! | `chest` | the least energy of the loop on a whole chest in coarse cells, at life's pace and slower; simulated time |
//!
//! `exchange`: `p50_us` is the median of batches of 64 calls, by call. The other quantiles are of single calls, with the timer's own median, `timer_us`, taken off.
//! `timer_p999_us` is what the machine does to the timer itself. Calls follow each other without a pause, so that the loop's own memory is
//! warm; `tick_p50_us` and `tick_p999_us` of `closed-loop` are calls that come every millisecond.
//!
//! `prediction`: `rms_percent` and `max_percent` are by the largest force of the motion, over all ticks but the first second. `held_…`: of a loop that
//! repeats the newest force.

use std::process::ExitCode;

use clap::Parser;

#[path = "../../tests/support/bare_loop.rs"]
mod bare_loop;
mod block;
mod chest;
mod closed_loop;
#[path = "../common/mod.rs"]
#[allow(dead_code, reason = "each bench uses a part")]
mod common;
mod exchange;
#[path = "../../tests/support/haptic_device.rs"]
#[allow(dead_code, reason = "one hand serves here")]
mod haptic_device;
mod options;
mod prediction;
#[path = "../../tests/support/block.rs"]
mod pressed_block;
mod stability;
mod stability_plot;
mod through_c;
mod timer;

use self::common::allocations;
use self::common::place::Place;
use self::common::report::{self, Report};
use self::options::{FigureName, Options};

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;

fn main() -> ExitCode {
    let options = Options::parse();
    let place = match Place::of(&options.machine()) {
        Ok(place) => place,
        Err(error) => {
            eprintln!("servo: {error}");
            return ExitCode::from(2);
        }
    };
    let mut report = Report::new(options.json, place);
    for figure in options.figures() {
        match figure {
            FigureName::Exchange => exchange::run(&options, &mut report),
            FigureName::ClosedLoop => closed_loop::run(&options, &mut report),
            FigureName::Prediction => prediction::run(&options, &mut report),
            FigureName::Stability => stability::run(&options, &mut report),
            FigureName::Chest => chest::run(&options, &mut report),
        }
    }
    report.finish()
}
