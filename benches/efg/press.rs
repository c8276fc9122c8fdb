//! A block that hangs and is pressed.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::error::Result;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse};
use palpate::sim::{Sim, SimDesc};
use palpate::solver::method::{EfgDesc, Method};
use palpate::solver::tool::{ToolDesc, ToolMotion};

use super::common::{allocations, table::quantile};
use super::options::Options;
use super::report::Figure;

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
    let steps = (options.seconds / dt).ceil().max(4.0) as usize;
    let (mut times, mut iterations, mut fastest) = (Vec::new(), 0.0, f64::INFINITY);
    let (mut residual, mut peak, mut allocated) = (0.0_f64, 0.0_f64, 0);
    for step in 0..steps {
        let deep = DEPTH * width * ((step + 1) as f64 * dt / PRESS_S).min(1.0);
        let at = Vec3::new(0.5 * width, 0.5 * width, width + radius - deep);
        tool.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z)))?;
        let before = allocations::count();
        sim.step()?;
        let statistics = sim.statistics();
        // The first steps reserve what later ones use.
        if step > steps / 2 {
            allocated += allocations::count() - before;
            times.push(statistics.step_wall_s * 1e6);
            iterations += f64::from(statistics.cg_iterations);
            fastest = fastest.min(statistics.step_wall_s * 1e6 / f64::from(statistics.cg_iterations.max(1)));
        }
        residual = residual.max(statistics.true_residual);
        peak = peak.max(tool.force().wrench.force_n.norm());
    }
    let count = times.len();
    let us_per_step = quantile(&mut times, 0.5);
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
        p99_us: quantile(&mut times, 0.99),
        steps_per_s: 1e6 / us_per_step,
        rtf: dt * 1e6 / us_per_step,
        cg_iterations: iterations / count as f64,
        us_per_iteration: fastest,
        true_residual: residual,
        allocations: allocated,
        max_force_n: peak,
        contact_points: sim.statistics().contact_points,
    })
}
