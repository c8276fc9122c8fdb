//! A person, a device, a servo loop and a simulation, closed.

use palpate::math::Vec3;
use palpate::servo::coupling::Coupling;
use palpate::servo::device::DeviceDesc;
use palpate::servo::flags::Flags;
use palpate::servo::{DeviceState, Servo, ServoOptions};

use crate::bare_loop::BareLoop;
use crate::haptic_device::{Body, Hand, HapticDevice};
use crate::physics::{Physics, Says, Tissue};

pub const TICK_S: f64 = 1e-3;

/// A person with a device.
#[derive(Clone, Copy, Debug)]
pub struct Person {
    pub body: Body,
    pub hand: Option<Hand>,
    /// A force along z on the device, beside the hand's.
    pub push_n: f64,
}

/// What happened in the last part of a run.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// The least energy that the hand had ever put into the loop, in J.
    pub least_j: f64,
    /// Root mean square of the device's velocity along z, in m/s.
    pub shaking_m_s: f64,
    /// The force on the motors at the end, in N.
    pub force_n: f64,
    /// The tool's height at the end, in m.
    pub tool_m: f64,
    /// All that the chain did since the tool engaged.
    pub flags: Flags,
}

/// A second in the air, 5 mm above the tissue; then the hand goes to 10 mm below its surface in a tenth of a second, or the push begins; two seconds
/// there. With the chain and the passivity controller, or with the law and the coupling alone.
pub fn press(
    person: &Person,
    tissue: Tissue,
    ticks_per_solve: u32,
    coupling: Coupling,
    has_chain: bool,
) -> Outcome {
    let desc = DeviceDesc::touch();
    let start = Vec3::z() * 5e-3;
    let mut device = HapticDevice::new(person.body, person.hand, start);
    let limits = coupling.limits(&desc);
    let mut physics = Physics::new(tissue, Says::Stiffness { doubt: 1.0 }, ticks_per_solve, &limits, TICK_S);
    let mut servo = Servo::new(&desc, &ServoOptions { coupling, controls_passivity: true }).unwrap();
    let first = device.read(TICK_S);
    let mut bare = BareLoop::new(&coupling, &first, TICK_S);

    let (mut squares, mut force_n, mut tool_m, mut flags) = (0.0, 0.0, 0.0, Flags::NONE);
    for tick in 0..3000 {
        let now = TICK_S * f64::from(tick);
        let motion = device.read(TICK_S);
        let (wrench, tool) = if has_chain {
            let state = DeviceState { motion, stamp_s: now, is_held: true };
            let out = servo.tick(&state, physics.newest(), true);
            flags |= Flags(if tick > 800 { out.flags.0 } else { 0 });
            (out.wrench, out.tool)
        } else {
            bare.tick(&motion, physics.newest(), now)
        };
        physics.advance(&tool, now);
        let down = ((now - 1.0) / 0.1).clamp(0.0, 1.0);
        let push = if tick >= 1000 { person.push_n } else { 0.0 };
        device.advance(wrench.force_n, start - Vec3::z() * 15e-3 * down, Vec3::z() * push, TICK_S);
        (force_n, tool_m) = (wrench.force_n.z, tool.pose.translation.z);
        if tick >= 2000 {
            squares += device.velocity_m_s.z.powi(2) / 1000.0;
        }
    }
    let least_j = if has_chain { servo.statistics().least_energy_j } else { bare.least_j() };
    Outcome { least_j, shaking_m_s: squares.sqrt(), force_n, tool_m, flags }
}
