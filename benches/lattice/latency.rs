//! What a servo loop waits for: a pose written by the host, a step of one substep, the force read by the host. One tick follows the other
//! without a pause.

use std::time::Instant;

use palpate::error::Result;

use super::common::allocations;
use super::common::table::quantile;
use super::ellipsoid;
use super::measure::{Scene, must_touch, simulation};
use super::options::Options;
use super::pace::Pace;
use super::report::{Figures, Latency, Report};

/// Nodes when the command line names none: the arm of Etheredge 2011.
const NODES: usize = 82_105;

/// Measures the ellipsoid for each of Poisson's ratios that the options ask for.
pub fn run(options: &Options, report: &mut Report) {
    for poisson in ellipsoid::ratios(options) {
        match ellipsoid::scene(options.nodes.unwrap_or(NODES), poisson, options) {
            Ok(mut scene) => {
                scene.name = "latency".into();
                scene.pace = Pace::stable(1, &scene.model);
                scene.pace.step_s = options.dt.unwrap_or(scene.pace.step_s);
                report.add(measure(&scene, options));
            }
            Err(error) => report.fail("latency", &error.to_string()),
        }
    }
}

fn measure(scene: &Scene, options: &Options) -> Figures {
    let mut figures = scene.figures();
    match ticks(scene, options) {
        Ok(latency) => figures.latency = Some(latency),
        Err(error) => figures.error = Some(error.to_string()),
    }
    figures
}

fn ticks(scene: &Scene, options: &Options) -> Result<Latency> {
    let mut sim = simulation(scene.model.clone(), scene.sleeping, scene.pace, options)?;
    let mut tool = sim.add_tool(&scene.press.tool())?;
    let lead = scene.lead();
    let mut walls_us = Vec::with_capacity(options.ticks);
    let (mut least, mut most) = (f64::MAX, 0.0);
    let mut allocated = 0;
    for tick in 0..lead + options.ticks {
        let motion = scene.press.motion((tick + 1) as f64 * scene.pace.step_s);
        if tick == lead {
            allocated = allocations::count();
            sim.reset_latency();
        }
        let started = Instant::now();
        tool.set_motion(&motion)?;
        sim.step()?;
        let force = tool.force().wrench.force_n.norm();
        let wall_us = started.elapsed().as_secs_f64() * 1e6;
        if tick >= lead {
            walls_us.push(wall_us);
            (least, most) = (f64::min(least, force), f64::max(most, force));
        }
    }
    let allocations = allocations::count() - allocated;
    must_touch(most)?;

    let (statistics, steps) = (sim.statistics(), sim.latency());
    let step_us = |q: f64| steps.quantile_s(q) * 1e6;
    Ok(Latency {
        ticks: options.ticks,
        substep_s: statistics.substep_s,
        substeps: statistics.substeps_per_step,
        p50_us: quantile(&mut walls_us, 0.5),
        p99_us: quantile(&mut walls_us, 0.99),
        p999_us: quantile(&mut walls_us, 0.999),
        max_us: quantile(&mut walls_us, 1.0),
        step_p50_us: step_us(0.5),
        step_p99_us: step_us(0.99),
        step_p999_us: step_us(0.999),
        awake_nodes: statistics.awake_nodes,
        allocations,
        min_force_n: least,
        max_force_n: most,
        contact_points: statistics.contact_points,
        dropped_points: statistics.dropped_points,
    })
}
