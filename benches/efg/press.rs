//! A block that hangs and is pressed.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use palpate::error::Result;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::mesh::TriangleMesh;
use palpate::model::{Build, Fix, LabelUse, Model, SurfaceSource};
use palpate::sim::{Sim, SimDesc};
use palpate::solver::method::{EfgDesc, Method};
use palpate::solver::tool::{ToolDesc, ToolMotion};

use super::baseline::parallel::Parallel;
use super::baseline::serial::Serial;
use super::baseline::{self, Baseline, Body, Setting};
use super::beside::Beside;
use super::common::place::{Arithmetic, Backend};
use super::common::{allocations, table::quantile};
use super::options::{Options, Scene};
use super::report::{Compared, Figure};

const GRAVITY: f64 = 9.81;
/// Share of the block's width that the ball is pressed in, over this time.
const DEPTH: f64 = 0.08;
const PRESS_S: f64 = 0.1;

/// Where and with what a block is pressed.
#[derive(Clone, Copy)]
pub struct Press {
    pub width_m: f64,
    pub radius_m: f64,
}

impl Press {
    pub fn tool(&self) -> ToolDesc {
        ToolDesc { friction: 0.3, ..ToolDesc::sphere(self.radius_m) }
    }

    /// Where the ball's centre is at a time.
    fn centre(&self, time_s: f64) -> Vec3 {
        let deep = DEPTH * self.width_m * (time_s / PRESS_S).min(1.0);
        Vec3::new(0.5 * self.width_m, 0.5 * self.width_m, self.width_m + self.radius_m - deep)
    }

    /// Where the ball is taken in a step.
    pub fn motion(&self, step: usize, dt: f64) -> ToolMotion {
        let at = self.centre((step + 1) as f64 * dt);
        ToolMotion::at(Pose::translation(at.x, at.y, at.z))
    }
}

/// A block of so many cells along each side.
pub fn block(options: &Options, side: usize, cell_m: f64) -> Result<Arc<Model>> {
    let tissue = |young| Material::new("tissue", young, options.nu, 1000.0).map(LabelUse::Tissue);
    let is_hard = |n: usize| {
        let cell = [n % side, n / side % side, n / (side * side)];
        let away = Vec3::from_fn(|a, _| (cell[a] as f64 + 0.5) / side as f64 - 0.5).norm();
        away < 0.2
    };
    let labels = (0..side.pow(3)).map(|n| 1 + u16::from(options.contrast != 1.0 && is_hard(n))).collect();
    let frame = Pose::translation(0.5 * cell_m, 0.5 * cell_m, 0.5 * cell_m);
    let mut build = Build::new(LabelGrid::new([side; 3], Vec3::repeat(cell_m), frame, labels)?);
    build.uses =
        BTreeMap::from([(1, tissue(options.young)?), (2, tissue(options.young * options.contrast)?)]);
    build.fixes.push(Fix {
        pose: Pose::identity(),
        half_extents: Vec3::new(1.0, 1.0, 0.5 * cell_m),
        axes: [true; 3],
    });
    if options.scene == Scene::Flat {
        build.surfaces = vec![SurfaceSource::Mesh(top(side, cell_m))];
        build.contact_surface = Some(0);
    }
    Ok(Arc::new(build.run(&mut |_, _| true)?))
}

/// The top of a block, one square a cell.
fn top(side: usize, cell_m: f64) -> TriangleMesh {
    let row = side + 1;
    let at = |n: usize| Vec3::new((n % row) as f64, (n / row) as f64, side as f64) * cell_m;
    let mut triangles = Vec::new();
    for cell in 0..side * side {
        let n = (cell % side + cell / side * row) as u32;
        let (right, back) = (n + 1, n + row as u32);
        triangles.extend([[n, right, back], [right, back + 1, back]]);
    }
    TriangleMesh { positions: (0..row * row).map(at).collect(), triangles, uvs: Vec::new() }
}

/// Presses a block of about `cells` cells by steps of `dt`.
pub fn run(options: &Options, cells: usize, dt: f64) -> Result<Figure> {
    let side = (cells as f64).cbrt().round() as usize;
    let width_m = side as f64 * options.cell;
    let press = Press { width_m, radius_m: options.ball * width_m };
    let model = block(options, side, options.cell)?;

    let method = EfgDesc { tolerance: options.tolerance, max_iterations: 20_000, ..EfgDesc::default() };
    let desc = SimDesc {
        method: Method::Efg(method),
        step_s: dt,
        gravity_m_s2: Vec3::z() * -GRAVITY,
        rest_under_gravity: options.scene == Scene::Flat,
        ..options.machine.desc()
    };
    let mut sim = Sim::new(model.clone(), &desc)?;
    let mut tool = sim.add_tool(&press.tool())?;
    let steps = options.steps(dt);
    let (mut times, mut on_device, mut felt) = (Vec::new(), Vec::new(), Vec::new());
    let (mut iterations, mut fastest) = (0.0, f64::INFINITY);
    let (mut residual, mut allocated, mut bytes) = (0.0_f64, 0, 0);
    let mut bytes_before = 0;
    for step in 0..steps {
        tool.set_motion(&press.motion(step, dt))?;
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
        felt.push(tool.force().wrench.force_n);
    }
    let count = times.len();
    let us_per_step = quantile(&mut times, 0.5);
    let is_compared = !options.no_baseline && options.machine.precision == Arithmetic::F32;
    let beside =
        options.beside_lattice.then(|| Beside::of(options, side, &model, press, &desc, &felt)).transpose()?;
    let compared = is_compared.then(|| compare(options, &model, press, dt, us_per_step)).transpose()?;
    Ok(Figure {
        scene: options.scene,
        cells: side.pow(3),
        nodes: model.lattice().node_count(),
        dt_s: dt,
        young_pa: options.young,
        poisson: options.nu,
        contrast: options.contrast,
        cell_m: options.cell,
        us_per_step,
        least_us: times[0],
        device_us_per_step: quantile(&mut on_device, 0.5),
        p99_us: quantile(&mut times, 0.99),
        steps_per_s: 1e6 / us_per_step,
        rtf: dt * 1e6 / us_per_step,
        cg_iterations: iterations / count as f64,
        us_per_iteration: fastest,
        true_residual: residual,
        bytes_uploaded: (bytes - bytes_before) / count as u64,
        allocations: allocated,
        max_force_n: felt.iter().map(Vec3::norm).fold(0.0, f64::max),
        contact_points: sim.statistics().contact_points,
        compared,
        beside,
    })
}

/// The paper's flow on the same block, pressed along the same way.
fn compare(options: &Options, model: &Model, press: Press, dt: f64, us_per_step: f64) -> Result<Compared> {
    let setting = Setting {
        dt: dt as f32,
        gravity_m_s2: GRAVITY as f32,
        tolerance: options.tolerance,
        radius_m: press.radius_m as f32,
        push_n_m: (options.young * options.cell) as f32,
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
        let taken = compared.step(press.centre((step + 1) as f64 * dt))?;
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
