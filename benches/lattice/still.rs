//! What a substep costs that has nothing to do but move the lattice, and one that has nothing to do at all: tissue at rest without a tool, awake and asleep.

use std::time::Instant;

use palpate::error::Result;

use super::common::table::quantile;
use super::ellipsoid;
use super::measure::{Scene, simulation};
use super::options::Options;
use super::report::{Figures, Report, Still};

/// Steps in which tissue at rest falls asleep, where rounding lets it.
const STEPS_TO_SLEEP: usize = 100;

/// Measures the ellipsoid in all sizes and for each of Poisson's ratios that the options ask for.
pub fn run(options: &Options, report: &mut Report) {
    for nodes in ellipsoid::sizes(options) {
        for poisson in ellipsoid::ratios(options) {
            match ellipsoid::scene(nodes, poisson, options) {
                Ok(mut scene) => {
                    for sleeping in [false, true] {
                        scene.name = "still".into();
                        scene.sleeping = sleeping;
                        report.add(measure(&scene, options));
                    }
                }
                Err(error) => report.fail("still", &error.to_string()),
            }
        }
    }
}

fn measure(scene: &Scene, options: &Options) -> Figures {
    let mut figures = scene.figures();
    match steps(scene, options) {
        Ok(still) => figures.still = Some(still),
        Err(error) => figures.error = Some(error.to_string()),
    }
    figures
}

fn steps(scene: &Scene, options: &Options) -> Result<Still> {
    let mut sim = simulation(scene.model.clone(), scene.sleeping, scene.pace, options)?;
    for _ in 0..STEPS_TO_SLEEP {
        sim.step()?;
    }
    let substeps = sim.statistics().substeps_per_step;
    let mut passes_us = Vec::new();
    for _ in 0..scene.pace.steps(options.seconds) {
        let started = Instant::now();
        sim.step()?;
        passes_us.push(started.elapsed().as_secs_f64() * 1e6 / f64::from(substeps));
    }
    Ok(Still {
        substep_s: sim.statistics().substep_s,
        substeps,
        us_per_step: quantile(&mut passes_us, 0.5),
        least_us_per_step: passes_us[0],
        awake_nodes: sim.statistics().awake_nodes,
    })
}
