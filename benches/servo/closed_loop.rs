//! A device and a hand at the wall clock's pace, on the lungs, which step on a thread of their own.
//!
//! The hand goes up and down over the softest place, from outside to some millimetres deep. Device and hand are computed on the servo thread,
//! by the time that really passed.

use std::time::Instant;

use comfy_table::Table;
use palpate::error::{Error, Result};
use palpate::math::Vec3;
use palpate::servo::device::DeviceDesc;
use palpate::servo::flags::Flags;
use palpate::servo::safety::DISENGAGING;
use palpate::servo::{DeviceState, ServoOptions};
use palpate::sim::{Event, Sim, SimDesc, ThreadDesc, ToolPort};
use palpate::solver::tool::ToolDesc;
use serde::Serialize;

use super::common::anatomy::{self, Anatomy, FRONT, LUNG, softest};
use super::common::clock::Ticks;
use super::common::table::quantile;
use super::haptic_device::{Body, Hand, HapticDevice};
use super::options::Options;
use super::report::{Figure, Report, columns};

const TICK_S: f64 = 1e-3;
/// Cells of the lungs, in m, and the cap on their vessels, in Pa.
const CELL_M: f64 = 4.5e-3;
const YOUNG_CAP_PA: f64 = 20e3;
const RADIUS_M: f64 = 12e-3;
const FRICTION: f64 = 0.3;
/// In the air while the tool engages, in s.
const ENGAGES_S: f64 = 1.0;
/// The hand's way, in m, above the surface and below it, and how often it goes.
const GAP_M: f64 = 4e-3;
const DEPTH_M: f64 = 10e-3;
const PACE_HZ: f64 = 0.5;

/// What the loop went through.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ClosedLoop {
    pub scene: &'static str,
    pub nodes: usize,
    pub young_cap_pa: f64,
    pub seconds: f64,
    pub ticks: usize,
    pub period_p50_us: f64,
    pub period_p99_us: f64,
    pub period_p999_us: f64,
    pub period_max_us: f64,
    /// Periods longer than 1.1 ms and 2 ms.
    pub misses_1100_us: usize,
    pub misses_2000_us: usize,
    pub longest_run_of_misses: usize,
    /// What the exchange itself took.
    pub tick_p50_us: f64,
    pub tick_p999_us: f64,
    pub tick_max_us: f64,
    /// From a motion's stamp to the tick that saw the first force computed with it.
    pub age_p50_ms: f64,
    pub age_p99_ms: f64,
    pub age_max_ms: f64,
    pub fresh_per_s: f64,
    pub substeps: u32,
    /// Steps of the physics, from being begun to their forces, and what the device worked for the last of them.
    pub step_p50_us: f64,
    pub step_p99_us: f64,
    pub step_max_us: f64,
    pub step_device_us: f64,
    pub rtf: f64,
    pub overruns: u64,
    pub dropped_s: f64,
    /// Ticks whose force was not finite or beyond the device.
    pub invalid_ticks: u64,
    /// Ticks after the tool engaged at which the chain held an old force, or withdrew it.
    pub held_ticks: u64,
    pub withdrawn_ticks: u64,
    pub damped_ticks: u64,
    /// Ticks before it first engaged, and the flags of all failures since.
    pub unengaged_ticks: u64,
    pub failures: u32,
    pub servo_silent_events: u64,
    /// When the simulation failed, in simulated time: from then on there is no force.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diverged_at_s: Option<f64>,
    pub least_energy_j: f64,
    pub peak_force_n: f64,
}

impl Figure for ClosedLoop {
    const NAME: &'static str = "closed-loop";

    fn header() -> Table {
        columns([
            "scene",
            "nodes",
            "s",
            "period p50 / p99 / p999 / max µs",
            "> 1.1 ms, > 2 ms, run",
            "tick p50 / p999 µs",
            "age p50 / p99 / max ms",
            "fresh/s",
            "step p50 / p99 / max µs",
            "RTF",
            "overruns, dropped s",
            "invalid, held, withdrawn",
            "least J",
            "peak N",
        ])
    }

    fn row(&self) -> Vec<String> {
        let list = |all: &[f64], digits: usize| {
            all.iter().map(|x| format!("{x:.digits$}")).collect::<Vec<_>>().join(" / ")
        };
        vec![
            self.scene.into(),
            self.nodes.to_string(),
            format!("{:.0}", self.seconds),
            list(&[self.period_p50_us, self.period_p99_us, self.period_p999_us, self.period_max_us], 0),
            format!("{}, {}, {}", self.misses_1100_us, self.misses_2000_us, self.longest_run_of_misses),
            list(&[self.tick_p50_us, self.tick_p999_us], 2),
            list(&[self.age_p50_ms, self.age_p99_ms, self.age_max_ms], 1),
            format!("{:.0}", self.fresh_per_s),
            list(&[self.step_p50_us, self.step_p99_us, self.step_max_us], 0),
            format!("{:.2}", self.rtf),
            format!("{}, {:.2}", self.overruns, self.dropped_s),
            format!("{}, {}, {}", self.invalid_ticks, self.held_ticks, self.withdrawn_ticks),
            format!("{:.1e}", self.least_energy_j),
            format!("{:.2}", self.peak_force_n),
        ]
    }
}

/// Runs it where the anatomy is.
pub fn run(options: &Options, report: &mut Report) {
    match anatomy::labels() {
        Ok(path) => match measure(&path, options) {
            Ok(figure) => report.add(&figure),
            Err(error) => report.fail("closed-loop", &error.to_string()),
        },
        Err(why) => report.skip("closed-loop", &why),
    }
}

fn measure(labels: &std::path::Path, options: &Options) -> Result<ClosedLoop> {
    let anatomy = Anatomy {
        cell_m: CELL_M,
        only: LUNG,
        young_pa: None,
        poisson: None,
        young_cap_pa: YOUNG_CAP_PA,
        holds_front: false,
    };
    let model = anatomy.model(labels)?;
    let desc = SimDesc { gravity_m_s2: Vec3::new(0.0, 0.0, -9.81), ..options.machine().desc() };
    let mut sim = Sim::new(model.clone(), &desc)?;
    let surface = softest(&sim)?.point_m + FRONT * RADIUS_M;
    let device = DeviceDesc::touch();
    let ball = ToolDesc { friction: FRICTION, ..ToolDesc::sphere(RADIUS_M) };
    let mut port = sim.add_haptic_tool(&ball, &device, &ServoOptions::of(&device))?;

    let started = Instant::now();
    sim.start(ThreadDesc::default())?;
    let seconds = options.seconds;
    let (mut figure, port) = std::thread::scope(|scope| {
        let thread = scope.spawn(move || {
            let figure = servo(&mut port, surface, seconds, &device);
            (figure, port)
        });
        thread.join().map_err(|_| Error::Defect("the servo thread panicked".into()))
    })?;
    sim.stop()?;
    let ran_s = started.elapsed().as_secs_f64();
    while let Some(event) = sim.poll_event() {
        figure.servo_silent_events += u64::from(matches!(event, Event::ServoSilent { .. }));
        if let Event::Diverged { time_s } = event {
            figure.diverged_at_s = Some(time_s);
        }
    }
    let (statistics, latency) = (sim.statistics(), sim.latency());
    let own = port.servo_statistics().unwrap_or_default();
    if figure.peak_force_n == 0.0 {
        return Err(Error::argument("the tool touched nothing"));
    }
    Ok(ClosedLoop {
        scene: "lung-4.5mm",
        nodes: model.lattice().node_count(),
        young_cap_pa: YOUNG_CAP_PA,
        seconds,
        step_p50_us: latency.quantile_s(0.5) * 1e6,
        step_p99_us: latency.quantile_s(0.99) * 1e6,
        step_max_us: latency.max_s() * 1e6,
        step_device_us: statistics.step_device_s * 1e6,
        rtf: statistics.time_s / ran_s,
        substeps: statistics.substeps_per_step,
        overruns: statistics.overruns,
        dropped_s: statistics.dropped_s,
        least_energy_j: own.least_energy_j,
        ..figure
    })
}

/// Where the hand wants to be.
fn wish(surface: Vec3, time_s: f64) -> Vec3 {
    let phase = std::f64::consts::TAU * PACE_HZ * (time_s - ENGAGES_S).max(0.0);
    surface + FRONT * (GAP_M - 0.5 * (GAP_M + DEPTH_M) * (1.0 - phase.cos()))
}

fn servo(port: &mut ToolPort, surface: Vec3, seconds: f64, desc: &DeviceDesc) -> ClosedLoop {
    let lead = (ENGAGES_S / TICK_S) as usize;
    let count = lead + (seconds / TICK_S) as usize;
    let mut device = HapticDevice::new(Body::default(), Some(Hand::LOOSE), wish(surface, 0.0));
    let (mut periods_us, mut ticks_us) = (Vec::with_capacity(count), Vec::with_capacity(count));
    let mut ages_ms = Vec::with_capacity(count);
    let mut figure = ClosedLoop { ticks: count - lead, ..ClosedLoop::default() };
    let (mut last, mut run, mut fresh, mut has_engaged) = (0, 0, 0_u64, false);
    let mut rendered = Vec3::zeros();
    let mut clock = Ticks::every(TICK_S);
    for tick in 0..count {
        let [stamp_s, period_s] = clock.wait();
        // Since the last tick the motors did what they were told then.
        device.advance(rendered, wish(surface, stamp_s), Vec3::zeros(), period_s.max(1e-4));
        let motion = device.read(period_s.max(1e-4));
        let state = DeviceState { motion, stamp_s, is_held: true };
        let asked = Instant::now();
        let Some(exchange) = port.exchange(&state, 0, true) else { break };
        let took_us = asked.elapsed().as_secs_f64() * 1e6;
        let (force, flags) = (exchange.output.wrench.force_n, exchange.output.flags);
        rendered = force;

        let is_fresh = exchange.sequence != last;
        last = exchange.sequence;
        // Written so that a NaN is not valid.
        let is_valid = force.norm() <= desc.max_force_n * (1.0 + 1e-9);
        figure.invalid_ticks += u64::from(!is_valid);
        if tick < lead {
            continue;
        }
        periods_us.push(period_s * 1e6);
        ticks_us.push(took_us);
        run = if period_s > 1.1e-3 { run + 1 } else { 0 };
        figure.longest_run_of_misses = figure.longest_run_of_misses.max(run);
        if is_fresh {
            fresh += 1;
            ages_ms.push(port.servo_statistics().map_or(f64::NAN, |own| own.latency_s * 1e3));
        }
        let is_engaging = flags.intersects(Flags::WAITING | Flags::RAMPING);
        has_engaged |= !is_engaging;
        let is_withdrawn = has_engaged && (is_engaging || flags.intersects(Flags::DECAYING));
        figure.withdrawn_ticks += u64::from(is_withdrawn);
        figure.unengaged_ticks += u64::from(!has_engaged);
        figure.failures |= if has_engaged { flags.0 & DISENGAGING.0 } else { 0 };
        figure.held_ticks += u64::from(has_engaged && flags.intersects(Flags::HELD) && !is_withdrawn);
        figure.damped_ticks += u64::from(flags.intersects(Flags::DAMPED));
        figure.peak_force_n = figure.peak_force_n.max(force.norm());
    }
    let took_s = clock.elapsed_s() - ENGAGES_S;
    let longer = |than: f64| periods_us.iter().filter(|us| **us > than).count();
    (figure.misses_1100_us, figure.misses_2000_us) = (longer(1100.0), longer(2000.0));
    let of = |all: &mut [f64], q: f64| if all.is_empty() { f64::NAN } else { quantile(all, q) };
    ClosedLoop {
        period_p50_us: of(&mut periods_us, 0.5),
        period_p99_us: of(&mut periods_us, 0.99),
        period_p999_us: of(&mut periods_us, 0.999),
        period_max_us: of(&mut periods_us, 1.0),
        tick_p50_us: of(&mut ticks_us, 0.5),
        tick_p999_us: of(&mut ticks_us, 0.999),
        tick_max_us: of(&mut ticks_us, 1.0),
        age_p50_ms: of(&mut ages_ms, 0.5),
        age_p99_ms: of(&mut ages_ms, 0.99),
        age_max_ms: of(&mut ages_ms, 1.0),
        fresh_per_s: fresh as f64 / took_s,
        ..figure
    }
}
