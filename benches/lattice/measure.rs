//! Runs a scene and takes its figures.

use std::sync::Arc;
use std::time::Instant;

use palpate::error::Result;
use palpate::math::Vec3;
use palpate::model::Model;
use palpate::sim::{Precision, Sim, SimDesc};

use super::allocations;
use super::baseline::{self, Serial};
use super::options::{Arithmetic, Options};
use super::press::Press;
use super::report::{Figures, Timing};

/// A scene that is ready to run.
pub struct Scene {
    pub name: String,
    pub model: Arc<Model>,
    pub press: Press,
    pub sleeping: bool,
    /// Depth of the press at which measuring starts, in m.
    pub measured_from_m: f64,
    /// What figures say about the material.
    pub young_pa: Option<f64>,
    pub young_cap_pa: Option<f64>,
    pub poisson: Option<f64>,
}

/// The simulation that the options ask for.
pub fn simulation(model: Arc<Model>, sleeping: bool, options: &Options) -> Result<Sim> {
    let precision = match options.precision {
        Arithmetic::F32 => Precision::Single,
        Arithmetic::F64 => Precision::Double,
    };
    let desc = SimDesc {
        precision,
        threads: options.threads,
        step_s: options.dt,
        gravity_m_s2: Vec3::new(0.0, 0.0, -9.81),
        sleeping,
        ..SimDesc::default()
    };
    Sim::new(model, &desc)
}

/// The figures of a scene; those up to an error, should there be one.
pub fn measure(scene: &Scene, options: &Options) -> Figures {
    let lattice = scene.model.lattice();
    let mut figures = Figures {
        scene: scene.name.clone(),
        backend: "cpu",
        device: device(),
        precision: if options.precision == Arithmetic::F32 { "f32" } else { "f64" },
        threads: if options.threads == 0 { cores() } else { options.threads },
        sleeping: scene.sleeping,
        nodes: lattice.node_count(),
        cells: lattice.cell_count(),
        triangles: scene.model.surfaces()[scene.model.contact_surface()].triangles.len(),
        cell_m: lattice.cell_m(),
        young_pa: scene.young_pa,
        young_cap_pa: scene.young_cap_pa,
        poisson: scene.poisson,
        dt_s: options.dt,
        ..Figures::default()
    };
    match run(scene, options) {
        Ok(timing) => figures.timing = Some(timing),
        Err(error) => figures.error = Some(error.to_string()),
    }
    figures
}

fn run(scene: &Scene, options: &Options) -> Result<Timing> {
    let mut sim = simulation(scene.model.clone(), scene.sleeping, options)?;
    let mut tool = sim.add_tool(&scene.press.tool())?;
    let lead = (scene.press.pressed_s(scene.measured_from_m) / options.dt).ceil() as usize;
    let count = (options.seconds / options.dt).ceil().max(1.0) as usize;

    let mut serial = Serial::new(&scene.model, sim.statistics().substep_s);
    let mut serial_us = Vec::new();
    serial.measure(&mut serial_us);

    let mut walls_us = Vec::with_capacity(count);
    let mut passes_us = Vec::with_capacity(count);
    let (mut awake, mut force, mut strain) = (0, 0.0, 0.0);
    let mut allocated = 0;
    for step in 0..lead + count {
        tool.set_motion(&scene.press.motion((step + 1) as f64 * options.dt))?;
        if step == lead {
            allocated = allocations::count();
        }
        let started = Instant::now();
        sim.step()?;
        let wall_us = started.elapsed().as_secs_f64() * 1e6;
        if step >= lead {
            let statistics = sim.statistics();
            walls_us.push(wall_us);
            passes_us.push(wall_us / f64::from(statistics.substeps_per_step));
            awake += statistics.awake_nodes;
            force = f64::max(force, tool.force().wrench.force_n.norm());
            strain = f64::max(strain, statistics.max_strain);
        }
    }
    let allocations = allocations::count() - allocated;
    serial.measure(&mut serial_us);

    let statistics = sim.statistics();
    let wall_us: f64 = walls_us.iter().sum();
    let us_per_step = quantile(&mut passes_us, 0.5);
    let baseline_us_per_step = quantile(&mut serial_us, 0.5);
    Ok(Timing {
        substep_s: statistics.substep_s,
        substeps: statistics.substeps_per_step,
        us_per_step,
        least_us_per_step: passes_us[0],
        steps_per_s: 1e6 / us_per_step,
        p50_us: quantile(&mut walls_us, 0.5),
        p99_us: quantile(&mut walls_us, 0.99),
        p999_us: quantile(&mut walls_us, 0.999),
        rtf: count as f64 * options.dt * 1e6 / wall_us,
        awake_nodes: awake / count as u64,
        allocations,
        bytes_per_node: statistics.node_bytes as f64 / statistics.node_count as f64,
        max_force_n: force,
        max_strain: strain,
        baseline: baseline::NAME,
        baseline_us_per_step,
        baseline_least_us: serial_us[0],
        ratio: baseline_us_per_step / us_per_step,
    })
}

/// The nearest-rank quantile.
fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((q * values.len() as f64).ceil() as usize).clamp(1, values.len()) - 1]
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The processor's own name where the system tells it.
fn device() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let line = told.lines().find_map(|line| line.strip_prefix("model name"));
    let name = line.and_then(|line| line.split_once(':')).map(|(_, name)| name.trim().to_owned());
    name.unwrap_or_else(|| std::env::consts::ARCH.to_owned())
}
