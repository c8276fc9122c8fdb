//! Runs a scene and takes its figures.

use std::sync::Arc;
use std::time::Instant;

use palpate::error::{Error, Result};
use palpate::math::Vec3;
use palpate::model::Model;
use palpate::sim::{Sim, SimDesc};

use super::baseline::masses::Masses;
use super::baseline::parallel::{Parallel, STEPS, Sphere};
use super::baseline::serial::{STRETCH, Serial};
use super::baseline::{self, Baseline};
use super::common::allocations;
use super::common::place::Backend;
use super::common::table::quantile;
use super::options::Options;
use super::pace::Pace;
use super::press::Press;
use super::report::{Figures, Timing};

/// A scene that is ready to run.
pub struct Scene {
    pub name: String,
    pub model: Arc<Model>,
    pub pace: Pace,
    pub press: Press,
    pub sleeping: bool,
    /// Depth of the press at which measuring starts, in m.
    pub measured_from_m: f64,
    /// What figures say about the material.
    pub young_pa: Option<f64>,
    pub young_cap_pa: Option<f64>,
    pub poisson: Option<f64>,
}

impl Scene {
    /// What is known before anything has run.
    pub fn figures(&self) -> Figures {
        let lattice = self.model.lattice();
        Figures {
            scene: self.name.clone(),
            sleeping: self.sleeping,
            nodes: lattice.node_count(),
            cells: lattice.cell_count(),
            triangles: self.model.surfaces()[self.model.contact_surface()].triangles.len(),
            cell_m: lattice.cell_m(),
            tool_radius_m: self.press.radius_m,
            young_pa: self.young_pa,
            young_cap_pa: self.young_cap_pa,
            poisson: self.poisson,
            dt_s: self.pace.step_s,
            ..Figures::default()
        }
    }

    /// Steps before measuring starts.
    pub fn lead(&self) -> usize {
        self.pace.steps(self.press.pressed_s(self.measured_from_m))
    }
}

/// The simulation that the options ask for.
pub fn simulation(model: Arc<Model>, sleeping: bool, pace: Pace, options: &Options) -> Result<Sim> {
    let desc = SimDesc {
        step_s: pace.step_s,
        substeps: pace.substeps,
        gravity_m_s2: Vec3::new(0.0, 0.0, -9.81),
        sleeping,
        ..options.machine.desc()
    };
    Sim::new(model, &desc)
}

/// The figures of a scene; those up to an error, should there be one.
pub fn measure(scene: &Scene, options: &Options) -> Figures {
    let mut figures = scene.figures();
    match run(scene, options) {
        Ok(timing) => figures.timing = Some(timing),
        Err(error) => figures.error = Some(error.to_string()),
    }
    figures
}

fn run(scene: &Scene, options: &Options) -> Result<Timing> {
    let mut sim = simulation(scene.model.clone(), scene.sleeping, scene.pace, options)?;
    let mut tool = sim.add_tool(&scene.press.tool())?;
    let (lead, count) = (scene.lead(), scene.pace.steps(options.seconds));

    let mut compared = compared(scene, sim.statistics().substep_s, options.machine.backend)?;
    let mut compared_us = Vec::new();
    baseline::measure(&mut *compared, &mut compared_us)?;

    let mut walls_us = Vec::with_capacity(count);
    let mut passes_us = Vec::with_capacity(count);
    let mut device_us = Vec::with_capacity(count);
    let (mut awake, mut force, mut strain, mut points) = (0, 0.0, 0.0, 0);
    let (mut allocated, mut uploaded) = (0, 0);
    for step in 0..lead + count {
        tool.set_motion(&scene.press.motion((step + 1) as f64 * scene.pace.step_s))?;
        if step == lead {
            allocated = allocations::count();
            uploaded = sim.statistics().copied.to_device;
        }
        let started = Instant::now();
        sim.step()?;
        let wall_us = started.elapsed().as_secs_f64() * 1e6;
        if step >= lead {
            let statistics = sim.statistics();
            walls_us.push(wall_us);
            passes_us.push(wall_us / f64::from(statistics.substeps_per_step));
            device_us.push(statistics.step_device_s * 1e6 / f64::from(statistics.substeps_per_step));
            awake += statistics.awake_nodes;
            force = f64::max(force, tool.force().wrench.force_n.norm());
            strain = f64::max(strain, statistics.max_strain);
            points = points.max(statistics.contact_points);
        }
    }
    let allocations = allocations::count() - allocated;
    must_touch(force)?;
    baseline::measure(&mut *compared, &mut compared_us)?;

    let statistics = sim.statistics();
    let wall_us: f64 = walls_us.iter().sum();
    let is_gpu = options.machine.backend == Backend::Cuda;
    let us_per_step = quantile(&mut passes_us, 0.5);
    let baseline_us_per_step = quantile(&mut compared_us, 0.5);
    Ok(Timing {
        substep_s: statistics.substep_s,
        substeps: statistics.substeps_per_step,
        us_per_step,
        least_us_per_step: passes_us[0],
        device_us_per_step: is_gpu.then(|| quantile(&mut device_us, 0.5)),
        steps_per_s: 1e6 / us_per_step,
        p50_us: quantile(&mut walls_us, 0.5),
        p99_us: quantile(&mut walls_us, 0.99),
        p999_us: quantile(&mut walls_us, 0.999),
        rtf: count as f64 * scene.pace.step_s * 1e6 / wall_us,
        awake_nodes: awake / count as u64,
        allocations,
        bytes_uploaded: is_gpu.then(|| statistics.copied.to_device - uploaded),
        bytes_per_node: statistics.node_bytes as f64 / statistics.node_count as f64,
        max_force_n: force,
        max_strain: strain,
        contact_points: points,
        dropped_points: statistics.dropped_points,
        baseline: compared.name(),
        baseline_us_per_step,
        baseline_least_us: compared_us[0],
        ratio: baseline_us_per_step / us_per_step,
    })
}

/// What a scene is compared with: the paper's algorithm for the same kind of machine, where there is a tool when its press is at its end.
fn compared(scene: &Scene, dt: f64, backend: Backend) -> Result<Box<dyn Baseline>> {
    if backend == Backend::Cpu {
        return Ok(Box::new(Serial::new(&Masses::new(&scene.model, STRETCH), dt)));
    }
    let (press, to_model) = (scene.press.clone(), scene.model.frame().inverse());
    let sphere = Sphere {
        radius_m: press.radius_m,
        centre_m: Box::new(move |time_s| (to_model * press.motion(time_s).pose).translation.vector),
    };
    let masses = Masses::new(&scene.model, 1.0);
    let mut parallel = Parallel::new(&masses, dt, SimDesc::default().drag_per_s, sphere)?;
    let pressed_s = scene.press.pressed_s(scene.press.depth_m);
    for _ in 0..(pressed_s / (f64::from(STEPS) * dt)).ceil() as usize {
        parallel.advance()?;
    }
    Ok(Box::new(parallel))
}

/// Refuses a measurement without contact.
pub fn must_touch(force_n: f64) -> Result<()> {
    (force_n > 0.0)
        .then_some(())
        .ok_or_else(|| Error::argument("the tool touched nothing while steps were measured"))
}
