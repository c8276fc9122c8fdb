//! A hand that presses a whole chest through a device, in simulated time: the least energy that the loop ever held, and whether the tissue holds.
//!
//! What `examples/haptics` does by the clock, the same each time. A simulation slower than life takes several ticks for a step: it begins with the newest motion, and its force is
//! there when they are over.

use std::sync::Arc;

use comfy_table::Table;
use palpate::error::{Error, Result};
use palpate::math::Vec3;
use palpate::model::Model;
use palpate::servo::contact_model::ContactModel;
use palpate::servo::coupling::Coupling;
use palpate::servo::device::DeviceDesc;
use palpate::servo::{DeviceState, Servo, ServoOptions};
use palpate::sim::{Sim, SimDesc};
use palpate::solver::tool::ToolDesc;
use serde::Serialize;

use super::common::anatomy::{self, Anatomy, FRONT};
use super::haptic_device::{Body, Hand, HapticDevice};
use super::options::Options;
use super::report::{Figure, Report, columns};
use super::stability::LEAST_J;

const TICK_S: f64 = 1e-3;
/// Edges of cells, in m, and the cap on stiffness, in Pa.
const CELLS_M: [f64; 2] = [9e-3, 12e-3];
const YOUNG_CAP_PA: f64 = 20e3;
/// Ticks that a step takes: at life's pace, and on a small machine.
const TICKS_PER_STEP: [u32; 2] = [1, 6];
/// The ball, and how far before the skin it begins, in m.
const RADIUS_M: f64 = 10e-3;
const GAP_M: f64 = 10e-3;
/// Where it presses, as shares of breadth and height: below the breast bone, where there is soft tissue.
const ACROSS: f64 = 0.5;
const UP: f64 = 0.25;
/// The hand's way in m, its largest speed in m/s, and how long it stays, in s.
const TRAVEL_M: f64 = 30e-3;
const SPEED_M_S: f64 = 0.05;
const HOLD_S: f64 = 0.5;
/// In the air while the tool engages, and the end, in s: two presses.
const ENGAGES_S: f64 = 0.7;
const ENDS_S: f64 = 6.5;
/// Between the two of a relaxed grip and a tight one.
const HAND: Hand = Hand { mass_kg: 0.15, stiffness_n_per_m: 300.0, damping_n_s_per_m: 5.0 };

/// One loop.
#[derive(Clone, Debug, Serialize)]
pub struct Chest {
    /// Whether the skin is free, or held as the wall that a cut through tissue is.
    pub skin: &'static str,
    pub cell_m: f64,
    pub nodes: usize,
    pub coupling: &'static str,
    pub ticks_per_step: u32,
    /// When the tissue diverged, in simulated seconds of the tissue.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diverged_at_s: Option<f64>,
    pub least_energy_j: f64,
    pub peak_force_n: f64,
    /// Root mean square of the force's change from tick to tick while the hand is at rest in the tissue, in N.
    pub chatter_n: f64,
    pub is_passive: bool,
}

impl Figure for Chest {
    const NAME: &'static str = "chest";

    fn header() -> Table {
        columns([
            "skin",
            "cell mm",
            "nodes",
            "coupling",
            "ticks a step",
            "diverged at s",
            "least J",
            "peak N",
            "chatter N",
            "passive",
        ])
    }

    fn row(&self) -> Vec<String> {
        vec![
            self.skin.into(),
            format!("{:.0}", 1e3 * self.cell_m),
            self.nodes.to_string(),
            self.coupling.into(),
            self.ticks_per_step.to_string(),
            self.diverged_at_s.map_or("no".into(), |at| format!("{at:.3}")),
            format!("{:.1e}", self.least_energy_j),
            format!("{:.2}", self.peak_force_n),
            format!("{:.3}", self.chatter_n),
            if self.is_passive { "yes".into() } else { "no".into() },
        ]
    }
}

/// Runs all of them where the anatomy is.
pub fn run(options: &Options, report: &mut Report) {
    let path = match anatomy::labels() {
        Ok(path) => path,
        Err(why) => return report.skip("chest", &why),
    };
    for (skin, holds_front) in [("free", false), ("held", true)] {
        for cell_m in CELLS_M {
            let anatomy = Anatomy {
                cell_m,
                only: &[],
                young_pa: None,
                poisson: None,
                young_cap_pa: YOUNG_CAP_PA,
                holds_front,
            };
            let model = match anatomy.model(&path) {
                Ok(model) => model,
                Err(error) => return report.fail("chest", &error.to_string()),
            };
            for coupling in ["virtual", "direct"] {
                for ticks in TICKS_PER_STEP {
                    match measure(&model, cell_m, coupling, ticks, options) {
                        Ok(figure) => report.add(&Chest { skin, ..figure }),
                        Err(error) => report.fail("chest", &error.to_string()),
                    }
                }
            }
        }
    }
}

/// How deep the hand wants to be on its way, in m.
fn wish_m(time_s: f64) -> f64 {
    // A raised cosine is at its fastest at π/2 of its mean speed.
    let way_s = std::f64::consts::FRAC_PI_2 * TRAVEL_M / SPEED_M_S;
    let rounded = |since_s: f64| {
        0.5 * TRAVEL_M * (1.0 - (std::f64::consts::PI * (since_s / way_s).clamp(0.0, 1.0)).cos())
    };
    let since_s = (time_s - ENGAGES_S).max(0.0) % (2.0 * (way_s + HOLD_S));
    rounded(since_s) - rounded(since_s - way_s - HOLD_S)
}

fn measure(
    model: &Arc<Model>,
    cell_m: f64,
    coupling: &'static str,
    ticks_per_step: u32,
    options: &Options,
) -> Result<Chest> {
    let desc = DeviceDesc::touch();
    let mut servo_options = ServoOptions::of(&desc);
    if coupling == "direct" {
        servo_options.coupling = Coupling::Direct;
    }
    let mut sim = Sim::new(model.clone(), &SimDesc { step_s: TICK_S, ..options.machine().desc() })?;
    let mut port = sim.add_haptic_tool(&ToolDesc::sphere(RADIUS_M), &desc, &servo_options)?;
    let mut servo = Servo::new(&desc, &servo_options)?;

    let start = skin(&sim)? + FRONT * (RADIUS_M + GAP_M);
    let mut device = HapticDevice::new(Body::default(), Some(HAND), start);
    // What is felt, and the outcome of the step that is under way.
    let (mut newest, mut coming) = (ContactModel::none(), ContactModel::none());
    let mut figure = Chest {
        skin: "",
        cell_m,
        nodes: model.lattice().node_count(),
        coupling,
        ticks_per_step,
        diverged_at_s: None,
        least_energy_j: 0.0,
        peak_force_n: 0.0,
        chatter_n: 0.0,
        is_passive: false,
    };
    let (mut last, mut squares, mut resting) = (Vec3::zeros(), 0.0, 0_u32);
    for tick in 0..(ENDS_S / TICK_S) as u32 {
        let now_s = TICK_S * f64::from(tick);
        let motion = device.read(TICK_S);
        let is_due = tick.is_multiple_of(ticks_per_step);
        if is_due {
            newest = coming;
        }
        let state = DeviceState { motion, stamp_s: now_s, is_held: true };
        let out = servo.tick(&state, &newest, figure.diverged_at_s.is_none());
        if is_due && figure.diverged_at_s.is_none() {
            port.set_motion_at(&out.tool, now_s)?;
            match sim.step() {
                Ok(()) => {
                    coming =
                        *port.contact_model().ok_or_else(|| Error::argument("the tool has no device"))?;
                }
                Err(Error::Diverged { time_s, .. }) => figure.diverged_at_s = Some(time_s),
                Err(error) => return Err(error),
            }
        }
        let force = out.wrench.force_n;
        device.advance(force, start - FRONT * wish_m(now_s), Vec3::zeros(), TICK_S);
        figure.peak_force_n = figure.peak_force_n.max(force.norm());
        if wish_m(now_s) == TRAVEL_M && wish_m(now_s - 0.2) == TRAVEL_M {
            squares += (force - last).norm_squared();
            resting += 1;
        }
        last = force;
    }
    figure.chatter_n = (squares / f64::from(resting.max(1))).sqrt();
    figure.least_energy_j = servo.statistics().least_energy_j;
    figure.is_passive = figure.least_energy_j >= LEAST_J && figure.diverged_at_s.is_none();
    Ok(figure)
}

/// Where a ray from the front meets the chest.
fn skin(sim: &Sim) -> Result<Vec3> {
    let (lattice, frame) = (sim.model().lattice(), sim.model().frame());
    let size = Vec3::from(lattice.cells().map(|n| n as f64)) * lattice.cell_m();
    let corners = (0..8_u8).map(|corner| {
        let local = Vec3::from_fn(|axis, _| if corner >> axis & 1 == 1 { size[axis] } else { 0.0 });
        frame.transform_point(&local.into()).coords
    });
    let (low, high) = corners
        .fold((Vec3::repeat(f64::MAX), Vec3::repeat(f64::MIN)), |(low, high), p| (low.inf(&p), high.sup(&p)));
    let eye = Vec3::new(low.x + ACROSS * (high.x - low.x), high.y + 0.1, low.z + UP * (high.z - low.z));
    let pick = sim.pick(eye, -FRONT)?;
    pick.map(|pick| pick.point_m).ok_or_else(|| Error::argument("there is nothing to press"))
}
