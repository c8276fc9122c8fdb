//! How fast tissue is cut, and what that does to steps, pictures and forces.
//!
//! `cargo bench --bench cutting` prints tables, `cargo bench --bench cutting -- --json` one object per line; `-- --figure NAME` takes one of them, `-- --backend cuda`
//! on a GPU. All options: `cargo bench --bench cutting -- --help`. The torus is that of `examples/cutting`, with its blade; the thorax needs the folder that
//! `PALPATE_DATA` names.
//!
//! | figure | what |
//! |---|---|
//! | `torus` | steps before the torus is cut, while a blade goes through it, and after: a line each |
//! | `servo` | the age of forces on a device, before and while the torus is cut, the simulation on its own thread; see [`servo`] |
//! | `largest` | steps while cut, for twice as many cells each time, until half of them take longer than what they simulate |
//! | `thorax` | as `torus`, for the lattice of a whole chest |
//! | `anew` | what a step that cuts takes, against all of the simulation made anew and uploaded; see [`anew`] |
//!
//! Lines of `torus`, `largest` and `thorax`; of three numbers the first is the median, the second the 99th percentile, the third the most:
//!
//! | key | what |
//! |---|---|
//! | `step_ms` | wall time of whole steps, the cut in them, but not the picture |
//! | `map_ms` | the surface taken by a renderer: after every step, or 60 times a simulated second where steps are shorter |
//! | `cut_ms`, `dividing_cut_ms` | the cut's own part of all steps, and of the `dividing_steps`: those that divided a cell, or one further |
//! | `device_ms` | that the device was at work, by its own clock; on the processor from the first substep to the last |
//! | `iterations`, `true_residual` | of the meshless model's solutions: on average, and the worst |
//! | `awake_nodes` | on average: those that sleep cost little |
//! | `rtf` | simulated by wall time of all steps and pictures |
//! | `keeps_up` | whether the median of steps is no longer than `dt_s` |
//! | `divided_cells`, `copies`, `drawn_vertices`, `drawn_triangles` | at the end of the phase |
//! | `full_bytes` | what creating the simulation and its surface copied to the GPU: state, masses, words and rows of nodes, lists of contact, surface |
//! | `bytes_per_step`, `most_bytes` | copied to the GPU in a step and the picture after it, on average and at most; `share_of_full`, `most_share_of_full` of that |
//! | `step_ms_along_the_way` | medians of `step_ms` in each fifth of the blade's way |

use std::process::ExitCode;

use clap::Parser;

pub(crate) mod anew;
#[path = "../common/mod.rs"]
#[allow(dead_code, reason = "each bench uses a part")]
pub(crate) mod common;
pub(crate) mod hanging;
#[path = "../../tests/support/haptic_device.rs"]
#[allow(dead_code, reason = "one hand serves here")]
mod haptic_device;
pub(crate) mod options;
pub(crate) mod phases;
#[path = "../../examples/cutting/scene.rs"]
#[allow(dead_code, reason = "nothing is drawn here")]
pub(crate) mod scene;
pub(crate) mod servo;
#[path = "../../examples/cutting/stage.rs"]
mod stage;
pub(crate) mod take;
mod thorax;
#[path = "../../examples/cutting/torus.rs"]
#[allow(dead_code, reason = "nothing is drawn here")]
pub(crate) mod torus;

use self::common::place::Place;
use self::common::report::Report;
use self::options::{FigureName, Options};

fn main() -> ExitCode {
    let options = Options::parse();
    let place = match Place::of(&options.machine) {
        Ok(place) => place,
        Err(error) => {
            eprintln!("cutting: {error}");
            return ExitCode::from(2);
        }
    };
    let mut report = Report::new(options.json, place);
    for figure in options.figures() {
        match figure {
            FigureName::Torus => hanging::run(&options, &mut report),
            FigureName::Servo => servo::run(&options, &mut report),
            FigureName::Largest => hanging::run_larger(&options, &mut report),
            FigureName::Thorax => thorax::run(&options, &mut report),
            FigureName::Anew => anew::run(&options, &mut report),
        }
    }
    report.finish()
}
