//! How far the force between two solves is from the force that a solve gives.
//!
//! One solve in each tick, in simulated time, the tool where the device is. At tick k the servo has the contact model of tick k − 1, and
//! evaluates it at its motion now; the solve that takes that motion tells the truth. Neither coupling nor chain is in the way.

use std::f64::consts::TAU;

use comfy_table::Table;
use palpate::error::{Error, Result};
use palpate::math::Vec3;
use palpate::servo::ServoOptions;
use palpate::servo::contact_model::ContactModel;
use palpate::servo::coupling::Coupling;
use palpate::servo::device::DeviceDesc;
use palpate::sim::{Sim, SimDesc};
use palpate::solver::tool::ToolMotion;
use serde::Serialize;

use super::block;
use super::options::Options;
use super::report::{Figure, Report, columns};

const TICK_S: f64 = 1e-3;
/// Ticks up to here are not counted: the first touch is unlike all others.
const FIRST_S: f64 = 1.0;
const LAST_S: f64 = 4.0;
/// How deep strokes and presses go, and how far above the surface they turn, in m.
const DEPTH_M: f64 = 8e-3;
const GAP_M: f64 = 1e-3;
/// A drag: its depth, how far it goes to either side, and how often.
const DRAG_DEPTH_M: f64 = 5e-3;
const DRAG_M: f64 = 12e-3;
const DRAG_HZ: f64 = 0.7;

/// A motion of the tool.
#[derive(Clone, Copy, Debug)]
struct Script {
    name: &'static str,
    has_tumour: bool,
    /// Depth and way aside, in m, at a time.
    at: fn(f64) -> [f64; 2],
}

fn stroke(time_s: f64, pace_hz: f64) -> f64 {
    0.5 * (DEPTH_M + GAP_M) * (1.0 - (TAU * pace_hz * time_s).cos()) - GAP_M
}

/// From one value to the next between two times, without a jump of the velocity.
fn rise(time_s: f64, from_s: f64, to_s: f64) -> f64 {
    let share = ((time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0);
    0.5 * (1.0 - (0.5 * TAU * share).cos())
}

fn drag(time_s: f64) -> [f64; 2] {
    let depth = rise(time_s, 0.0, 0.4) * (DRAG_DEPTH_M + GAP_M) - GAP_M;
    let aside = DRAG_M * (TAU * DRAG_HZ * (time_s - 0.6).max(0.0)).sin() * rise(time_s, 0.6, 0.9);
    [depth, aside]
}

const SCRIPTS: [Script; 6] = [
    Script { name: "stroke 2 Hz", has_tumour: false, at: |t| [stroke(t, 2.0), 0.0] },
    Script { name: "stroke 5 Hz", has_tumour: false, at: |t| [stroke(t, 5.0), 0.0] },
    Script {
        name: "slow press",
        has_tumour: false,
        at: |t| [(rise(t, 0.0, 2.0) - rise(t, 3.0, 4.0)) * (DEPTH_M + GAP_M) - GAP_M, 0.0],
    },
    Script { name: "drag", has_tumour: false, at: drag },
    Script { name: "stroke 2 Hz, inclusion", has_tumour: true, at: |t| [stroke(t, 2.0), 0.0] },
    Script { name: "drag, inclusion", has_tumour: true, at: drag },
];

/// How far predictions were off.
#[derive(Clone, Debug, Serialize)]
pub struct Prediction {
    pub script: &'static str,
    pub damping_s: f64,
    pub rms_percent: f64,
    pub max_percent: f64,
    pub max_at_s: f64,
    pub held_rms_percent: f64,
    pub held_max_percent: f64,
    pub peak_force_n: f64,
    pub ticks: u32,
    pub contact_points: u32,
}

impl Figure for Prediction {
    const NAME: &'static str = "prediction";

    fn header() -> Table {
        columns([
            "script",
            "β ms",
            "rms %",
            "max % (at s)",
            "held rms %",
            "held max %",
            "peak N",
            "ticks",
            "points",
        ])
    }

    fn row(&self) -> Vec<String> {
        vec![
            self.script.into(),
            format!("{}", 1e3 * self.damping_s),
            format!("{:.2}", self.rms_percent),
            format!("{:.2} ({:.3})", self.max_percent, self.max_at_s),
            format!("{:.2}", self.held_rms_percent),
            format!("{:.2}", self.held_max_percent),
            format!("{:.2}", self.peak_force_n),
            self.ticks.to_string(),
            self.contact_points.to_string(),
        ]
    }
}

/// Takes all motions, in tissue with viscosity and in tissue without.
pub fn run(options: &Options, report: &mut Report) {
    for damping_s in [block::RELAXATION_S, 0.0] {
        for script in &SCRIPTS {
            match measure(script, damping_s, options) {
                Ok(figure) => report.add(&figure),
                Err(error) => report.fail(script.name, &error.to_string()),
            }
        }
    }
}

fn motion(script: &Script, time_s: f64) -> ToolMotion {
    let [depth, aside] = (script.at)(time_s);
    let (before, after) = ((script.at)(time_s - 1e-5), (script.at)(time_s + 1e-5));
    let rate = |i: usize| (after[i] - before[i]) / 2e-5;
    block::pressed(depth, [aside, 0.0], Vec3::new(rate(1), 0.0, -rate(0)))
}

/// The errors of one kind of prediction.
#[derive(Default)]
struct Errors {
    squares: f64,
    largest: f64,
    at_s: f64,
}

impl Errors {
    fn note(&mut self, error: f64, time_s: f64) {
        self.squares += error * error;
        if error > self.largest {
            (self.largest, self.at_s) = (error, time_s);
        }
    }
}

fn measure(script: &Script, damping_s: f64, options: &Options) -> Result<Prediction> {
    let desc = DeviceDesc::touch();
    let servo = ServoOptions { coupling: Coupling::Direct, ..ServoOptions::of(&desc) };
    let model = block::model_with(script.has_tumour, damping_s)?;
    let mut sim = Sim::new(model, &SimDesc { step_s: TICK_S, ..options.machine().desc() })?;
    let mut port = sim.add_haptic_tool(&block::ball(), &desc, &servo)?;

    let (mut law, mut held) = (Errors::default(), Errors::default());
    let (mut newest, mut ticks, mut peak, mut points) = (ContactModel::none(), 0, 0.0_f64, 0);
    for tick in 0..(LAST_S / TICK_S) as u32 {
        let time_s = TICK_S * f64::from(tick);
        let motion = motion(script, time_s);
        let predicted = newest.evaluate(&motion).force_n;
        port.set_motion(&motion)?;
        sim.step()?;
        let truth = port.force().wrench.force_n;
        let before = newest.wrench.force_n;
        newest = *port.contact_model().ok_or_else(|| Error::argument("the tool has no device"))?;
        peak = peak.max(truth.norm());
        points = points.max(sim.statistics().contact_points);
        if time_s < FIRST_S || truth.norm() + predicted.norm() == 0.0 {
            continue;
        }
        ticks += 1;
        law.note((predicted - truth).norm(), time_s);
        held.note((before - truth).norm(), time_s);
    }
    if ticks == 0 {
        return Err(Error::argument("the tool touched nothing"));
    }
    let percent = |x: f64| 100.0 * x / peak;
    let rms = |errors: &Errors| percent((errors.squares / f64::from(ticks)).sqrt());
    Ok(Prediction {
        script: script.name,
        damping_s,
        rms_percent: rms(&law),
        max_percent: percent(law.largest),
        max_at_s: law.at_s,
        held_rms_percent: rms(&held),
        held_max_percent: percent(held.largest),
        peak_force_n: peak,
        ticks,
        contact_points: points,
    })
}
