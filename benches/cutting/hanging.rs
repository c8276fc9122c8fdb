//! Figures `torus` and `largest`: the torus of the example, of one size, and ever larger until steps last longer than what they simulate.

use palpate::error::{Error, Result};

use super::common::report::Report;
use super::options::{MOST_CELLS, Options};
use super::phases::measure;
use super::scene::{Phase, Scene};
use super::torus::{self, Torus};

/// How much of the cut `largest` measures when the command line says nothing, in s: the edge is in the middle of the ring by then.
const HALF_S: f64 = 1.0;

/// The scene of a torus.
pub fn scene(torus: &Torus) -> Result<Scene> {
    torus::scene(torus).map_err(|error| Error::argument(format!("{error:#}")))
}

/// Takes the figure `torus`.
pub fn run(options: &Options, report: &mut Report) {
    let how = (options.model, options.step_s(), options.seconds);
    match scene(&options.torus()).and_then(|scene| measure("torus", scene, how, options)) {
        Ok(phases) => phases.iter().for_each(|phase| report.add(phase)),
        Err(error) => report.fail("torus", &error.to_string()),
    }
}

/// Takes the figure `largest`.
pub fn run_larger(options: &Options, report: &mut Report) {
    let mut torus = options.torus();
    let how = (options.model, options.frame_s(), options.seconds.or(Some(HALF_S)));
    while torus.cells <= MOST_CELLS {
        let phases = match scene(&torus).and_then(|scene| measure("largest", scene, how, options)) {
            Ok(phases) => phases,
            Err(error) => return report.fail(&format!("largest, {} cells", torus.cells), &error.to_string()),
        };
        let cut = phases.into_iter().find(|phase| phase.phase == Phase::Cut);
        cut.iter().for_each(|cut| report.add(cut));
        if !cut.is_some_and(|cut| cut.keeps_up) {
            return;
        }
        torus.cells *= 2;
    }
}
