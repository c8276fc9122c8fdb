//! A block that hangs and is pressed.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use palpate::error::Result;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::sim::{Sim, SimDesc};
use palpate::solver::method::{EfgDesc, Method};
use palpate::solver::tool::{ToolDesc, ToolMotion};

use super::baseline::parallel::Parallel;
use super::baseline::serial::Serial;
use super::baseline::{self, Baseline, Body, Setting};
use super::common::place::{Arithmetic, Backend};
use super::common::{allocations, table::quantile};
use super::options::Options;
use super::report::{Beside, Compared, Figure};

const CELL_M: f64 = 2e-3;
const GRAVITY: f64 = 9.81;
/// Share of the block's width that is the ball's radius, and that it is pressed in, over this time.
const RADIUS: f64 = 1.0 / 12.0;
const DEPTH: f64 = 0.08;
const PRESS_S: f64 = 0.1;

/// Presses a block of about `cells` cells by steps of `dt`.
pub fn run(options: &Options, cells: usize, dt: f64) -> Result<Figure> {
    let side = (cells as f64).cbrt().round() as usize;
    let width = side as f64 * CELL_M;
    let tissue = |young| Material::new("tissue", young, options.nu, 1000.0).map(LabelUse::Tissue);
    let is_hard = |n: usize| {
        let cell = [n % side, n / side % side, n / (side * side)];
        let away = Vec3::from_fn(|a, _| (cell[a] as f64 + 0.5) / side as f64 - 0.5).norm();
        away < 0.2
    };
    let labels = (0..side.pow(3)).map(|n| 1 + u16::from(options.contrast != 1.0 && is_hard(n))).collect();
    let frame = Pose::translation(0.5 * CELL_M, 0.5 * CELL_M, 0.5 * CELL_M);
    let mut build = Build::new(LabelGrid::new([side; 3], Vec3::repeat(CELL_M), frame, labels)?);
    build.uses =
        BTreeMap::from([(1, tissue(options.young)?), (2, tissue(options.young * options.contrast)?)]);
    build.fixes.push(Fix {
        pose: Pose::identity(),
        half_extents: Vec3::new(1.0, 1.0, 0.5 * CELL_M),
        axes: [true; 3],
    });
    let model = Arc::new(build.run(&mut |_, _| true)?);

    let method = EfgDesc { tolerance: options.tolerance, max_iterations: 20_000, ..EfgDesc::default() };
    let desc = SimDesc {
        method: Method::Efg(method),
        step_s: dt,
        gravity_m_s2: Vec3::z() * -GRAVITY,
        rest_under_gravity: false,
        ..options.machine.desc()
    };
    let mut sim = Sim::new(model.clone(), &desc)?;
    let radius = RADIUS * width;
    let mut tool = sim.add_tool(&ToolDesc { friction: 0.3, ..ToolDesc::sphere(radius) })?;
    let steps = options.steps(dt);
    let (mut times, mut on_device) = (Vec::new(), Vec::new());
    let (mut iterations, mut fastest) = (0.0, f64::INFINITY);
    let (mut residual, mut peak, mut allocated, mut bytes) = (0.0_f64, 0.0_f64, 0, 0);
    let mut bytes_before = 0;
    for step in 0..steps {
        tool.set_motion(&motion(width, step, dt))?;
        let before = allocations::count();
        sim.step()?;
        let statistics = sim.statistics();
        // The first steps reserve what later ones use.
        if step <= steps / 2 {
            bytes_before = statistics.copied.to_device;
        } else {
            allocated += allocations::count() - before;
            times.push(statistics.step_wall_s * 1e6);
            on_device.push(statistics.step_device_s * 1e6);
            iterations += f64::from(statistics.cg_iterations);
            fastest = fastest.min(statistics.step_wall_s * 1e6 / f64::from(statistics.cg_iterations.max(1)));
            bytes = statistics.copied.to_device;
        }
        residual = residual.max(statistics.true_residual);
        peak = peak.max(tool.force().wrench.force_n.norm());
    }
    let count = times.len();
    let us_per_step = quantile(&mut times, 0.5);
    let is_compared = !options.no_baseline && options.machine.precision == Arithmetic::F32;
    let beside = options.beside_lattice.then(|| beside(options, &model, width, &desc)).transpose()?;
    let compared = is_compared.then(|| compare(options, &model, width, dt, us_per_step)).transpose()?;
    Ok(Figure {
        scene: "block",
        cells: side.pow(3),
        nodes: model.lattice().node_count(),
        dt_s: dt,
        young_pa: options.young,
        poisson: options.nu,
        contrast: options.contrast,
        cell_m: CELL_M,
        us_per_step,
        device_us_per_step: quantile(&mut on_device, 0.5),
        p99_us: quantile(&mut times, 0.99),
        steps_per_s: 1e6 / us_per_step,
        rtf: dt * 1e6 / us_per_step,
        cg_iterations: iterations / count as f64,
        us_per_iteration: fastest,
        true_residual: residual,
        bytes_uploaded: (bytes - bytes_before) / count as u64,
        allocations: allocated,
        max_force_n: peak,
        contact_points: sim.statistics().contact_points,
        compared,
        beside,
    })
}

/// Where the ball is taken in a step, over a block of this width.
fn motion(width: f64, step: usize, dt: f64) -> ToolMotion {
    let at = centre(width, (step + 1) as f64 * dt);
    ToolMotion::at(Pose::translation(at.x, at.y, at.z))
}

/// The lattice of the same block, pressed along the same way by substeps that are stable.
fn beside(options: &Options, model: &Arc<Model>, width: f64, desc: &SimDesc) -> Result<Beside> {
    let desc = SimDesc { method: Method::Lattice, sleeping: false, ..desc.clone() };
    let mut sim = Sim::new(model.clone(), &desc)?;
    let mut tool = sim.add_tool(&ToolDesc { friction: 0.3, ..ToolDesc::sphere(RADIUS * width) })?;
    let steps = options.steps(desc.step_s);
    let mut times = Vec::new();
    for step in 0..steps {
        tool.set_motion(&motion(width, step, desc.step_s))?;
        sim.step()?;
        if step > steps / 2 {
            times.push(sim.statistics().step_wall_s * 1e6);
        }
    }
    let us_per_step = quantile(&mut times, 0.5);
    Ok(Beside {
        lattice_us_per_step: us_per_step,
        lattice_substeps: sim.statistics().substeps_per_step,
        lattice_rtf: desc.step_s * 1e6 / us_per_step,
    })
}

/// Where the ball's centre is at a time, over a block of this width.
fn centre(width: f64, time_s: f64) -> Vec3 {
    let deep = DEPTH * width * (time_s / PRESS_S).min(1.0);
    Vec3::new(0.5 * width, 0.5 * width, (1.0 + RADIUS) * width - deep)
}

/// The paper's flow on the same block, pressed along the same way.
fn compare(options: &Options, model: &Model, width: f64, dt: f64, us_per_step: f64) -> Result<Compared> {
    let setting = Setting {
        dt: dt as f32,
        gravity_m_s2: GRAVITY as f32,
        tolerance: options.tolerance,
        radius_m: (RADIUS * width) as f32,
        push_n_m: (options.young * CELL_M) as f32,
    };
    let body = Body::new(model)?;
    let mut compared: Box<dyn Baseline> = match options.machine.backend {
        Backend::Cpu => Box::new(Serial::new(body, setting)),
        Backend::Cuda => Box::new(Parallel::new(&body, setting)?),
    };
    let steps = options.steps(dt);
    let (mut times, mut iterations, mut peak) = (Vec::new(), 0.0, 0.0_f32);
    for step in 0..steps {
        let started = Instant::now();
        let taken = compared.step(centre(width, (step + 1) as f64 * dt))?;
        if step > steps / 2 {
            times.push(started.elapsed().as_secs_f64() * 1e6);
            iterations += f64::from(taken);
        }
        peak = compared.felt_n().into_iter().fold(peak, |peak, f| peak.max(f.abs()));
    }
    baseline::check(&*compared, peak)?;
    let count = times.len() as f64;
    let baseline_us_per_step = quantile(&mut times, 0.5);
    Ok(Compared {
        baseline: compared.name(),
        baseline_us_per_step,
        baseline_cg_iterations: iterations / count,
        ratio: baseline_us_per_step / us_per_step,
    })
}
