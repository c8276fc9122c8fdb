//! What a tick of the servo loop costs the thread that runs it.

use std::time::Duration;

use comfy_table::Table;
use palpate::error::{Error, Result};
use palpate::math::{Pose, Quat, Vec3};
use palpate::servo::coupling::Coupling;
use palpate::servo::device::DeviceDesc;
use palpate::servo::flags::Flags;
use palpate::servo::{DeviceState, ServoOptions};
use palpate::sim::{Sim, ThreadDesc};
use palpate::solver::tool::ToolMotion;
use serde::Serialize;

use super::block;
use super::common::allocations;
use super::options::Options;
use super::report::{Figure, Report, columns};
use super::through_c::CTool;
use super::timer::{Timer, quantile, short};

/// Calls that are timed together for the median.
const BATCH: usize = 64;
/// Batches that are timed.
const BATCHES: usize = 20_000;
/// In the air while the tool engages, and then the way in, in s.
const ENGAGES_S: f64 = 0.8;
const PRESSES_S: f64 = 0.3;
/// How deep the ball is, and how far it goes on from there, in m: less than what the motors bear for long.
const DEPTH_M: f64 = 4e-3;
const SWING_M: f64 = 1e-3;
const SWING_HZ: f64 = 2.0;
const TURN_RAD: f64 = 0.2;
/// Where it starts: above the surface.
const GAP_M: f64 = 2e-3;

/// What calls have taken.
#[derive(Clone, Debug, Serialize)]
pub struct Exchange {
    pub through: &'static str,
    pub coupling: &'static str,
    pub calls: u32,
    pub p50_us: f64,
    pub least_us: f64,
    pub call_p50_us: f64,
    pub p99_us: f64,
    pub p999_us: f64,
    pub p9999_us: f64,
    pub max_us: f64,
    pub timer_us: f64,
    pub timer_p999_us: f64,
    pub allocations: u64,
    /// Share of the calls that felt tissue.
    pub in_contact: f64,
    /// Contact models that the calls have seen by second.
    pub models_per_s: f64,
    pub peak_force_n: f64,
}

impl Figure for Exchange {
    const NAME: &'static str = "exchange";

    fn header() -> Table {
        columns([
            "through",
            "coupling",
            "calls",
            "p50 (least) µs",
            "single p50 / p99 / p999 / p9999 µs",
            "max µs",
            "timer p50 / p999 µs",
            "allocations",
            "in contact",
            "models/s",
            "peak N",
        ])
    }

    fn row(&self) -> Vec<String> {
        let us = |all: &[f64]| all.iter().map(|us| format!("{us:.3}")).collect::<Vec<_>>().join(" / ");
        vec![
            self.through.into(),
            self.coupling.into(),
            self.calls.to_string(),
            format!("{:.3} ({:.3})", self.p50_us, self.least_us),
            us(&[self.call_p50_us, self.p99_us, self.p999_us, self.p9999_us]),
            format!("{:.1}", self.max_us),
            us(&[self.timer_us, self.timer_p999_us]),
            self.allocations.to_string(),
            format!("{:.2} %", 100.0 * self.in_contact),
            format!("{:.0}", self.models_per_s),
            format!("{:.2}", self.peak_force_n),
        ]
    }
}

/// Takes it through Rust and through C, coupled and directly.
pub fn run(options: &Options, report: &mut Report) {
    let coupled = ServoOptions::of(&DeviceDesc::touch());
    let direct = ServoOptions { coupling: Coupling::Direct, ..coupled };
    for servo in [coupled, direct] {
        for (through, taken) in [("Rust", through_rust(options, &servo)), ("C", through_c(options, &servo))] {
            match taken {
                Ok(figure) => report.add(&figure),
                Err(error) => report.fail(&format!("exchange through {through}"), &error.to_string()),
            }
        }
    }
}

fn name(servo: &ServoOptions) -> &'static str {
    match servo.coupling {
        Coupling::Direct => "direct",
        Coupling::Virtual(_) => "virtual",
    }
}

fn through_rust(options: &Options, servo: &ServoOptions) -> Result<Exchange> {
    let mut sim = Sim::new(block::model(false)?, &options.machine().desc())?;
    let mut port = sim.add_haptic_tool(&block::ball(), &DeviceDesc::touch(), servo)?;
    sim.start(ThreadDesc::default())?;
    let found = measure(options, move |device| {
        let exchange = port.exchange(device, 0, true)?;
        Some((exchange.output.wrench.force_n.norm(), exchange.output.flags, exchange.sequence))
    });
    sim.stop()?;
    found.map(|figure| Exchange { through: "Rust", coupling: name(servo), ..figure })
}

fn through_c(options: &Options, servo: &ServoOptions) -> Result<Exchange> {
    let mut tool = CTool::new(&options.machine(), servo.coupling == Coupling::Direct)?;
    tool.start()?;
    let mut end = tool.servo_end();
    let found = measure(options, move |device| {
        let servo = end.exchange(device)?;
        let force_n = Vec3::from(servo.force_n).norm();
        Some((force_n, Flags(servo.flags), servo.sequence))
    });
    drop(tool);
    found.map(|figure| Exchange { through: "C", coupling: name(servo), ..figure })
}

/// Where the hand is at a time.
fn motion(time_s: f64) -> ToolMotion {
    let since = time_s - ENGAGES_S - PRESSES_S;
    if since < 0.0 {
        let share = ((time_s - ENGAGES_S) / PRESSES_S).max(0.0);
        let speed = if share > 0.0 { (GAP_M + DEPTH_M) / PRESSES_S } else { 0.0 };
        return block::pressed(share * (GAP_M + DEPTH_M) - GAP_M, [0.0; 2], Vec3::z() * -speed);
    }
    let pace = 2.0 * std::f64::consts::PI * SWING_HZ;
    let (sin, cos) = (pace * since).sin_cos();
    let speed = Vec3::new(cos, sin, 0.0) * (SWING_M * pace);
    let at = block::pressed(DEPTH_M, [SWING_M * sin, SWING_M * (1.0 - cos)], speed);
    // A stylus turns in the hand, too.
    let turned = Pose::from_parts(at.pose.translation, Quat::from_scaled_axis(Vec3::y() * (TURN_RAD * sin)));
    ToolMotion { pose: turned, angular_rad_s: Vec3::y() * (TURN_RAD * pace * cos), ..at }
}

/// Runs a servo loop without pauses on a thread of its own. `call` gives the force, what happened to it, and the step that it came from.
fn measure(
    options: &Options,
    call: impl FnMut(&DeviceState) -> Option<(f64, Flags, u64)> + Send,
) -> Result<Exchange> {
    let mut call = call;
    let calls = options.calls as usize;
    std::thread::scope(|scope| {
        let thread = scope.spawn(move || {
            let timer = Timer::new();
            let itself = timer.itself(calls.min(1_000_000));
            // Written once before, so that no page is taken in while calls are timed.
            let (mut singles, mut batches) = (vec![1_u32; calls], vec![1_u32; BATCHES]);

            let start_s = timer.stamp_s(timer.now());
            let state = |now: u64| {
                let stamp_s = timer.stamp_s(now);
                DeviceState { motion: motion(stamp_s - start_s), stamp_s, is_held: true }
            };
            // A thousand times a second is enough on the way.
            while timer.stamp_s(timer.now()) - start_s < ENGAGES_S + PRESSES_S {
                call(&state(timer.now())).ok_or_else(refused)?;
                std::thread::sleep(Duration::from_micros(500));
            }

            let allocated = allocations::count_here();
            let began = timer.now();
            let (mut touching, mut models, mut peak, mut last) = (0_u64, 0_u64, 0.0_f64, 0);
            for taken in &mut singles {
                let state = state(timer.now());
                let before = timer.now();
                let felt = call(&state);
                *taken = short(timer.now() - before);
                let Some((force_n, flags, sequence)) = felt else { return Err(refused()) };
                touching += u64::from(force_n > 0.0 && !flags.intersects(Flags::WAITING));
                models += u64::from(sequence != last);
                (last, peak) = (sequence, peak.max(force_n));
            }
            let took_s = timer.stamp_s(timer.now()) - timer.stamp_s(began);
            let mut states = [state(timer.now()); BATCH];
            for taken in &mut batches {
                let (now, apart) = (timer.now(), u64::from(*singles.first().unwrap_or(&1)));
                for (state_of, ahead) in states.iter_mut().zip(0..) {
                    *state_of = state(now + ahead * apart);
                }
                let before = timer.now();
                for state in &states {
                    std::hint::black_box(call(state));
                }
                *taken = short(timer.now() - before);
            }
            let allocations = allocations::count_here() - allocated;

            singles.sort_unstable();
            batches.sort_unstable();
            let own = quantile(&itself, 0.5);
            let single = |q: f64| timer.us(u64::from(quantile(&singles, q).saturating_sub(own)));
            Ok(Exchange {
                through: "",
                coupling: "",
                calls: options.calls,
                p50_us: timer.us(u64::from(quantile(&batches, 0.5))) / BATCH as f64,
                least_us: timer.us(u64::from(batches[0])) / BATCH as f64,
                call_p50_us: single(0.5),
                p99_us: single(0.99),
                p999_us: single(0.999),
                p9999_us: single(0.9999),
                max_us: single(1.0),
                timer_us: timer.us(u64::from(own)),
                timer_p999_us: timer.us(u64::from(quantile(&itself, 0.999))),
                allocations,
                in_contact: touching as f64 / calls as f64,
                models_per_s: models as f64 / took_s,
                peak_force_n: peak,
            })
        });
        thread.join().unwrap_or_else(|_| Err(Error::Defect("the servo thread panicked".into())))
    })
}

fn refused() -> Error {
    Error::argument("the servo loop was refused")
}
