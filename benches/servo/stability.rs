//! Where the closed loop is stable: the least energy that a device and its tissue ever held, over stiffness and damping of the coupling.
//!
//! The block with its inclusion, one solve in each tick, a tick late, in simulated time. The device has little friction of its own, and is pushed
//! against the tissue by a weight instead of a hand, which damps nothing; or it is held loosely.

use std::sync::Arc;

use comfy_table::Table;
use palpate::error::{Error, Result};
use palpate::math::Vec3;
use palpate::model::Model;
use palpate::servo::contact_model::ContactModel;
use palpate::servo::coupling::{Coupling, VirtualCoupling};
use palpate::servo::device::DeviceDesc;
use palpate::servo::{DeviceState, Servo, ServoOptions};
use palpate::sim::{Sim, SimDesc};
use serde::Serialize;

use super::bare_loop::BareLoop;
use super::block;
use super::haptic_device::{Body, Hand, HapticDevice};
use super::options::Options;
use super::report::{Figure, Report, columns};
use super::stability_plot;

const TICK_S: f64 = 1e-3;
/// N/m and N s/m.
pub const STIFFNESSES: [f64; 5] = [50.0, 100.0, 200.0, 400.0, 700.0];
pub const DAMPINGS: [f64; 4] = [0.0, 0.5, 2.0, 5.0];
/// The least that a loop may show, in J: what a Touch has at a speed of 70 mm/s.
pub const LEAST_J: f64 = -1e-4;
/// A worse device than a Touch: a tenth of its viscous friction and no dry friction.
const BODY: Body =
    Body { mass_kg: 0.045, viscous_n_s_per_m: 0.005, coulomb_n: 0.0, encoder_m: 5.5e-5, filter_s: 2e-3 };
/// The weight in N, and where the hand wants to be, in m below the surface.
const WEIGHT_N: f64 = 0.6;
const WISH_M: f64 = 10e-3;
/// In the air while the tool engages, and the end, in s.
const ENGAGES_S: f64 = 0.8;
const ENDS_S: f64 = 1.8;
const GAP_M: f64 = 3e-3;

/// One loop.
#[derive(Clone, Debug, Serialize)]
pub struct Stability {
    pub stiffness_n_per_m: f64,
    pub damping_n_s_per_m: f64,
    pub hand: &'static str,
    pub has_chain: bool,
    pub least_energy_j: f64,
    /// Root mean square of the device's velocity in the last half second, in m/s.
    pub shaking_m_s: f64,
    pub force_n: f64,
    /// Whether it tore the tissue, and ended there.
    pub has_diverged: bool,
    pub is_passive: bool,
}

impl Figure for Stability {
    const NAME: &'static str = "stability";

    fn header() -> Table {
        columns(["hand", "chain", "K N/m", "B N s/m", "least J", "shaking m/s", "N", "passive"])
    }

    fn row(&self) -> Vec<String> {
        vec![
            self.hand.into(),
            if self.has_chain { "on".into() } else { "off".into() },
            self.stiffness_n_per_m.to_string(),
            self.damping_n_s_per_m.to_string(),
            format!("{:.1e}", self.least_energy_j),
            format!("{:.4}", self.shaking_m_s),
            format!("{:.2}", self.force_n),
            if self.is_passive { "yes".into() } else { "no".into() },
        ]
    }
}

/// Maps everything; draws it where a file is named.
pub fn run(options: &Options, report: &mut Report) {
    let model = match block::model(true) {
        Ok(model) => model,
        Err(error) => return report.fail("stability", &error.to_string()),
    };
    let mut all = Vec::new();
    for (hand_name, hand) in [("none", None), ("loose", Some(Hand::LOOSE))] {
        for has_chain in [false, true] {
            for stiffness in STIFFNESSES {
                for damping in DAMPINGS {
                    match measure(&model, [stiffness, damping], hand, has_chain, options) {
                        Ok(found) => {
                            let found = Stability { hand: hand_name, ..found };
                            report.add(&found);
                            all.push(found);
                        }
                        Err(error) => report.fail("stability", &error.to_string()),
                    }
                }
            }
        }
    }
    if let Some(path) = &options.out
        && let Err(error) = stability_plot::draw(path, &all)
    {
        report.fail("stability", &format!("no picture: {error}"));
    }
}

fn measure(
    model: &Arc<Model>,
    [stiffness_n_per_m, damping_n_s_per_m]: [f64; 2],
    hand: Option<Hand>,
    has_chain: bool,
    options: &Options,
) -> Result<Stability> {
    let desc = DeviceDesc::touch();
    let spring = VirtualCoupling { stiffness_n_per_m, damping_n_s_per_m, ..VirtualCoupling::of(&desc) };
    let servo_options = ServoOptions { coupling: Coupling::Virtual(spring), ..ServoOptions::of(&desc) };
    let mut sim = Sim::new(model.clone(), &SimDesc { step_s: TICK_S, ..options.machine().desc() })?;
    let mut port = sim.add_haptic_tool(&block::ball(), &desc, &servo_options)?;

    let start = block::pressed(-GAP_M, [0.0; 2], Vec3::zeros()).pose.translation.vector;
    let mut device = HapticDevice::new(BODY, hand, start);
    let first = device.read(TICK_S);
    let mut servo = Servo::new(&desc, &servo_options)?;
    let mut bare = BareLoop::new(&servo_options.coupling, &first, TICK_S);
    let mut newest = ContactModel::none();
    let (count, lead) = ((ENDS_S / TICK_S) as u32, (ENGAGES_S / TICK_S) as u32);
    let (mut squares, mut force_n, mut has_diverged) = (0.0, 0.0, false);
    for tick in 0..count {
        let now_s = TICK_S * f64::from(tick);
        let motion = device.read(TICK_S);
        let (wrench, tool) = if has_chain {
            let state = DeviceState { motion, stamp_s: now_s, is_held: true };
            let out = servo.tick(&state, &newest, true);
            (out.wrench, out.tool)
        } else {
            bare.tick(&motion, &newest, now_s)
        };
        // The solve begins with this motion and is there at the next tick, in simulated time.
        port.set_motion_at(&tool, now_s)?;
        match sim.step() {
            Ok(()) => {}
            // A loop that shakes that hard tears the tissue: that is its figure.
            Err(Error::Diverged { .. }) => {
                has_diverged = true;
                break;
            }
            Err(error) => return Err(error),
        }
        newest = *port.contact_model().ok_or_else(|| Error::argument("the tool has no device"))?;

        let down = ((now_s - ENGAGES_S) / 0.1).clamp(0.0, 1.0) * (GAP_M + WISH_M);
        let weight_n = if tick >= lead && hand.is_none() { -WEIGHT_N } else { 0.0 };
        device.advance(wrench.force_n, start - Vec3::z() * down, Vec3::z() * weight_n, TICK_S);
        force_n = wrench.force_n.norm();
        if tick + 500 >= count {
            squares += device.velocity_m_s.norm_squared() / 500.0;
        }
    }
    let least_energy_j = if has_chain { servo.statistics().least_energy_j } else { bare.least_j() };
    Ok(Stability {
        stiffness_n_per_m,
        damping_n_s_per_m,
        hand: "",
        has_chain,
        least_energy_j,
        shaking_m_s: squares.sqrt(),
        force_n,
        has_diverged,
        is_passive: least_energy_j >= LEAST_J && !has_diverged,
    })
}
