//! Figure `servo`: how old forces are while the torus is cut, with the simulation on its own thread.
//!
//! A servo thread ticks at 1 kHz. A hand holds a device against the side of the ring that is not cut, and goes in and out; the blade is moved by the same
//! thread, by the clock. The age of a force is told for every tick: the time since the device was where that force was computed, by the stamp of its motion.

use std::f64::consts::TAU;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use comfy_table::Table;
use palpate::error::{Error, Result};
use palpate::math::Vec3;
use palpate::servo::device::DeviceDesc;
use palpate::servo::{DeviceState, ServoOptions};
use palpate::sim::{Event, SimDesc, ThreadDesc, ToolPort};
use palpate::solver::tool::{ToolDesc, ToolMotion};
use serde::Serialize;

use super::common::clock::Ticks;
use super::common::report::{Figure, Report, columns};
use super::common::table::quantile;
use super::hanging;
use super::haptic_device::{Body, Hand, HapticDevice};
use super::options::{FRAME_S, ModelName, Options};
use super::scene::{Phase, Scene};
use super::stage::Stage;
use super::torus::{RING_M, TUBE_M};

const TICK_S: f64 = 1e-3;
/// In the air while the tool engages, in s.
const ENGAGES_S: f64 = 1.0;
const RADIUS_M: f64 = 8e-3;
/// The hand's way, in m, outside of the ring and into it, and how often it goes.
const GAP_M: f64 = 4e-3;
const DEPTH_M: f64 = 10e-3;
const PACE_HZ: f64 = 2.0;

/// Forces of a phase.
#[derive(Debug, Serialize)]
struct Ages {
    #[serde(flatten)]
    ran: Ran,
    phase: Phase,
    ticks: usize,
    age_p50_ms: f64,
    age_p99_ms: f64,
    age_p999_ms: f64,
    age_max_ms: f64,
    /// Ticks that saw a new force.
    fresh_ticks: usize,
    /// Ticks whose force was not finite or beyond the device.
    invalid_ticks: usize,
    /// Ticks more than 1.1 ms after the one before.
    late_ticks: usize,
    peak_force_n: f64,
}

/// What both phases share.
#[derive(Clone, Debug, Serialize)]
struct Ran {
    model: ModelName,
    threads: usize,
    cells: usize,
    triangles: usize,
    dt_s: f64,
    /// Of the whole run: simulated time by that of the clock, what was let go, and what steps took.
    rtf: f64,
    dropped_s: f64,
    step_p50_ms: f64,
    step_p99_ms: f64,
    step_max_ms: f64,
    divided_cells: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    diverged_at_s: Option<f64>,
}

/// One tick.
struct Tick {
    phase: Phase,
    period_s: f64,
    age_s: f64,
    is_fresh: bool,
    force_n: Vec3,
}

impl Figure for Ages {
    const NAME: &'static str = "servo";

    fn header() -> Table {
        columns([
            "model",
            "cells",
            "dt ms",
            "phase",
            "ticks",
            "age p50 / p99 / p999 / max ms",
            "fresh, invalid, late ticks",
            "peak N",
            "RTF, dropped s",
            "step p50 / p99 / max ms",
            "divided",
        ])
    }

    fn row(&self) -> Vec<String> {
        let list = |all: &[f64]| all.iter().map(|x| format!("{x:.2}")).collect::<Vec<_>>().join(" / ");
        let ran = &self.ran;
        vec![
            ran.model.name().into(),
            ran.cells.to_string(),
            format!("{:.2}", ran.dt_s * 1e3),
            format!("{:?}", self.phase).to_lowercase(),
            self.ticks.to_string(),
            list(&[self.age_p50_ms, self.age_p99_ms, self.age_p999_ms, self.age_max_ms]),
            format!("{}, {}, {}", self.fresh_ticks, self.invalid_ticks, self.late_ticks),
            format!("{:.2}", self.peak_force_n),
            format!("{:.2}, {:.2}", ran.rtf, ran.dropped_s),
            list(&[ran.step_p50_ms, ran.step_p99_ms, ran.step_max_ms]),
            ran.divided_cells.to_string(),
        ]
    }
}

/// Takes it: before the cut, from when the tool has engaged, and while cut.
pub fn run(options: &Options, report: &mut Report) {
    match measure(options) {
        Ok(figures) => figures.iter().for_each(|figure| report.add(figure)),
        Err(error) => report.fail("servo", &error.to_string()),
    }
}

fn measure(options: &Options) -> Result<Vec<Ages>> {
    let machine = options.machine.beside_servo();
    let desc = SimDesc { threads: machine.threads, ..options.desc(options.model, options.step_s()) };
    let mut stage = Stage::new(hanging::scene(&options.torus())?, &desc)?;
    let device = DeviceDesc::touch();
    let mut port =
        stage.sim.add_haptic_tool(&ToolDesc::sphere(RADIUS_M), &device, &ServoOptions::of(&device))?;
    let Stage { scene, desc, mut sim, mut surface, mut blade, .. } = stage;

    let is_over = AtomicBool::new(false);
    let begun = Instant::now();
    sim.start(ThreadDesc::default())?;
    let ticks = std::thread::scope(|scope| {
        // Somebody looks, too.
        scope.spawn(|| {
            let mut due = begun;
            // Relaxed: nothing else is read on the strength of this.
            while !is_over.load(Ordering::Relaxed) && surface.map().is_ok() {
                due += Duration::from_secs_f64(FRAME_S);
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
        });
        let cut_s = options.seconds.map_or(scene.cut_s, |seconds| seconds.min(scene.cut_s));
        let ticks = tick(&scene, &mut blade, &mut port, scene.rest_s + cut_s);
        // Relaxed: as above.
        is_over.store(true, Ordering::Relaxed);
        ticks
    })?;
    sim.stop()?;
    let ran_s = begun.elapsed().as_secs_f64();

    let mut diverged_at_s = None;
    while let Some(event) = sim.poll_event() {
        if let Event::Diverged { time_s } = event {
            diverged_at_s = Some(time_s);
        }
    }
    let (statistics, latency, lattice) = (sim.statistics(), sim.latency(), scene.model.lattice());
    let ran = Ran {
        model: options.model,
        threads: machine.threads,
        cells: lattice.cell_count(),
        triangles: scene.model.surfaces()[0].triangles.len(),
        dt_s: desc.step_s,
        rtf: statistics.time_s / ran_s,
        dropped_s: statistics.dropped_s,
        step_p50_ms: latency.quantile_s(0.5) * 1e3,
        step_p99_ms: latency.quantile_s(0.99) * 1e3,
        step_max_ms: latency.max_s() * 1e3,
        divided_cells: statistics.divided_cells,
        diverged_at_s,
    };
    [Phase::Before, Phase::Cut].map(|phase| Ages::of(&ran, phase, &ticks, &device)).into_iter().collect()
}

/// Moves the device and the blade until a time of the clock.
fn tick(scene: &Scene, blade: &mut ToolPort, port: &mut ToolPort, end_s: f64) -> Result<Vec<Tick>> {
    let mut device = HapticDevice::new(Body::default(), Some(Hand::LOOSE), wish(0.0));
    let mut ticks = Vec::with_capacity((end_s / TICK_S) as usize);
    let (mut rendered, mut last, mut computed_s) = (Vec3::zeros(), 0, f64::NAN);
    let mut clock = Ticks::every(TICK_S);
    loop {
        let [stamp_s, period_s] = clock.wait();
        if stamp_s > end_s {
            return Ok(ticks);
        }
        blade.set_motion(&ToolMotion::at(scene.blade_at(stamp_s)))?;
        device.advance(rendered, wish(stamp_s), Vec3::zeros(), period_s.max(1e-4));
        let motion = device.read(period_s.max(1e-4));
        let state = DeviceState { motion, stamp_s, is_held: true };
        let no_device = || Error::argument("the tool has no device");
        let exchange = port.exchange(&state, 0, true).ok_or_else(no_device)?;
        rendered = exchange.output.wrench.force_n;
        let is_fresh = exchange.sequence != last;
        if is_fresh {
            last = exchange.sequence;
            computed_s = port.servo_statistics().map_or(f64::NAN, |own| stamp_s - own.latency_s);
        }
        if stamp_s >= ENGAGES_S {
            let (phase, age_s) = (scene.phase(stamp_s), stamp_s - computed_s);
            ticks.push(Tick { phase, period_s, age_s, is_fresh, force_n: rendered });
        }
    }
}

/// Where the hand wants to be: beside the ring until the tool has engaged, then in and out.
fn wish(time_s: f64) -> Vec3 {
    let phase = TAU * PACE_HZ * (time_s - ENGAGES_S).max(0.0);
    let into = 0.5 * (GAP_M + DEPTH_M) * (1.0 - phase.cos()) - GAP_M;
    Vec3::x() * (into - RING_M - TUBE_M - RADIUS_M)
}

impl Ages {
    fn of(ran: &Ran, phase: Phase, all: &[Tick], device: &DeviceDesc) -> Result<Self> {
        let ticks: Vec<&Tick> = all.iter().filter(|tick| tick.phase == phase).collect();
        let peak_force_n = ticks.iter().map(|tick| tick.force_n.norm()).fold(0.0, f64::max);
        if peak_force_n == 0.0 {
            return Err(Error::argument("the tool touched nothing"));
        }
        let count = |is: &dyn Fn(&Tick) -> bool| ticks.iter().filter(|tick| is(tick)).count();
        let mut ages_ms: Vec<f64> = ticks.iter().map(|tick| tick.age_s * 1e3).collect();
        let [age_p50_ms, age_p99_ms, age_p999_ms, age_max_ms] =
            [0.5, 0.99, 0.999, 1.0].map(|q| quantile(&mut ages_ms, q));
        Ok(Self {
            ran: ran.clone(),
            phase,
            ticks: ticks.len(),
            age_p50_ms,
            age_p99_ms,
            age_p999_ms,
            age_max_ms,
            fresh_ticks: count(&|tick| tick.is_fresh),
            // A NaN is not valid.
            invalid_ticks: ticks.len()
                - count(&|tick| tick.force_n.norm() <= device.max_force_n * (1.0 + 1e-9)),
            late_ticks: count(&|tick| tick.period_s > 1.1 * TICK_S),
            peak_force_n,
        })
    }
}
