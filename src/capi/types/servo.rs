//! Haptic devices, and what a servo loop says and gets.

use std::mem::offset_of;

use super::super::boundary::{Desc, Output};
use super::plp_motion;
use crate::servo::device::{DeviceDesc, Workspace};
use crate::servo::flags::Flags;

/// The tool hangs on a spring between it and the device (default): stiff tissue, such as bone, is safe, and soft tissue feels a little softer.
pub const PLP_COUPLING_VIRTUAL: u32 = 0;
/// The tool is where the device is: soft tissue feels as soft as it is, and nothing may be stiffer than the device renders.
pub const PLP_COUPLING_DIRECT: u32 = 1;

/// A bit of plp_haptic_desc.flags (default on): damping is added where the loop has given the hand more energy than it got.
pub const PLP_HAPTIC_PASSIVE: u32 = 1;
/// A bit of plp_haptic_desc.flags (default on): workspace_m[0] is the radius of a ball; without it workspace_m are half the edges of a box.
pub const PLP_HAPTIC_BALL: u32 = 2;

/// What a haptic device can bear, and how it holds its tool. Defaults are those of a 3D Systems Touch, the former Phantom Omni; fill it with
/// plp_haptic_desc_init (or plp_haptic_desc_default), then say what yours can.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_haptic_desc {
    /// The size of this struct as the caller knows it.
    pub struct_size: u32,
    /// PLP_HAPTIC_PASSIVE and so on, or'ed.
    pub flags: u32,
    /// Largest force in N.
    pub max_force_n: f64,
    /// Largest torque in N m; 0 for a device that renders none.
    pub max_torque_n_m: f64,
    /// Largest force that the motors bear for long, in N: a root mean square over window_s.
    pub continuous_force_n: f64,
    /// The same of the torque, in N m.
    pub continuous_torque_n_m: f64,
    /// Time over which these average, in s.
    pub window_s: f64,
    /// Largest stiffness that it renders stably, in N/m.
    pub max_stiffness_n_m: f64,
    /// And of rotation, in N m/rad.
    pub max_stiffness_n_m_rad: f64,
    /// Largest damping, in N s/m.
    pub max_damping_n_s_m: f64,
    /// And of rotation, in N m s/rad.
    pub max_damping_n_m_s_rad: f64,
    /// Fastest change of the force, in N/s; enough for the largest force to be gone in 30 ms.
    pub slew_n_s: f64,
    /// Fastest change of the torque, in N m/s.
    pub slew_n_m_s: f64,
    /// Rate of the servo loop in Hz, 200 or more.
    pub servo_rate_hz: f64,
    /// Fastest motion that is believed, in m/s.
    pub max_speed_m_s: f64,
    /// Where it can go, around its middle, in m.
    pub workspace_m: [f64; 3],
    /// PLP_COUPLING_VIRTUAL or PLP_COUPLING_DIRECT.
    pub coupling: u32,
    /// Must be 0.
    pub reserved: u32,
    /// VIRTUAL: stiffness of the spring in N/m; 0 (default) takes the device's largest.
    pub coupling_n_m: f64,
    /// VIRTUAL: its damping in N s/m (default 0).
    pub coupling_n_s_m: f64,
    /// VIRTUAL: torsional stiffness in N m/rad; 0 (default) takes the device's largest, where it renders torque.
    pub coupling_n_m_rad: f64,
    /// VIRTUAL: torsional damping in N m s/rad (default 0).
    pub coupling_n_m_s_rad: f64,
}

// SAFETY: repr(C), integers in pairs and doubles.
unsafe impl Desc for plp_haptic_desc {
    const NAME: &'static str = "plp_haptic_desc";
    const FIRST_SIZE: usize = offset_of!(Self, coupling_n_m_s_rad) + size_of::<f64>();
    fn with_defaults() -> Self {
        let touch = DeviceDesc::touch();
        let (workspace_m, ball) = match touch.workspace {
            Workspace::Ball { radius_m } => ([radius_m, 0.0, 0.0], PLP_HAPTIC_BALL),
            Workspace::Box { half_extents_m } => (half_extents_m.into(), 0),
        };
        Self {
            struct_size: size_of::<Self>() as u32,
            flags: PLP_HAPTIC_PASSIVE | ball,
            max_force_n: touch.max_force_n,
            max_torque_n_m: touch.max_torque_n_m,
            continuous_force_n: touch.continuous_force_n,
            continuous_torque_n_m: touch.continuous_torque_n_m,
            window_s: touch.window_s,
            max_stiffness_n_m: touch.max_stiffness.linear,
            max_stiffness_n_m_rad: touch.max_stiffness.angular,
            max_damping_n_s_m: touch.max_damping.linear,
            max_damping_n_m_s_rad: touch.max_damping.angular,
            slew_n_s: touch.slew_n_per_s,
            slew_n_m_s: touch.slew_n_m_per_s,
            servo_rate_hz: touch.servo_rate_hz,
            max_speed_m_s: touch.max_speed_m_s,
            workspace_m,
            coupling: PLP_COUPLING_VIRTUAL,
            reserved: 0,
            coupling_n_m: 0.0,
            coupling_n_s_m: 0.0,
            coupling_n_m_rad: 0.0,
            coupling_n_m_s_rad: 0.0,
        }
    }
}

/// A bit of plp_haptic_state.flags: the dead-man switch is not held, and there shall be no force.
pub const PLP_HAPTIC_RELEASED: u32 = 1;

/// What a device says at a tick of its servo loop.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_haptic_state {
    /// Where it is and how it moves, world frame.
    pub motion: plp_motion,
    /// When that was, in seconds on a clock of yours that never runs backwards, from any start.
    pub stamp_s: f64,
    /// PLP_HAPTIC_RELEASED, or 0: also for a device without a dead-man switch.
    pub flags: u32,
    /// Its buttons, a bit each; changes come out as events.
    pub buttons: u32,
}

/// A bit of plp_servo.flags: the motion, the time stamp or the contact model was not finite, or time went backwards or stood
/// still. No force, until the tool engages again.
pub const PLP_SERVO_NOT_FINITE: u32 = 1;
/// The servo loop paused. No force, until the tool engages again.
pub const PLP_SERVO_PAUSED: u32 = 1 << 1;
/// The simulation is gone, has failed or was reset. No force, until the tool engages again.
pub const PLP_SERVO_STOPPED: u32 = 1 << 2;
/// The newest step is old: the last force is held and no longer follows the tool.
pub const PLP_SERVO_HELD: u32 = 1 << 3;
/// It is so old that the force decays, or is gone.
pub const PLP_SERVO_DECAYING: u32 = 1 << 4;
/// The device moved faster than is believed. No force, until the tool engages again.
pub const PLP_SERVO_TOO_FAST: u32 = 1 << 5;
/// There is no force yet: the tool engages when the force has been small for a tenth of a second.
pub const PLP_SERVO_WAITING: u32 = 1 << 6;
/// The force is rising to its full share after the tool engaged.
pub const PLP_SERVO_RAMPING: u32 = 1 << 7;
/// The force was lowered to what the motors bear for long.
pub const PLP_SERVO_AVERAGED: u32 = 1 << 8;
/// Force or torque was clamped to the device's largest.
pub const PLP_SERVO_CLAMPED: u32 = 1 << 9;
/// Force or torque changed as fast as it may, and is not where it should be yet.
pub const PLP_SERVO_SLEWED: u32 = 1 << 10;
/// The dead-man switch is not held. No force at once, until the tool engages again.
pub const PLP_SERVO_RELEASED: u32 = 1 << 11;
/// Damping was added to keep the loop passive.
pub const PLP_SERVO_DAMPED: u32 = 1 << 12;

const _: () = assert!(
    PLP_SERVO_NOT_FINITE == Flags::NOT_FINITE.0
        && PLP_SERVO_PAUSED == Flags::PAUSED.0
        && PLP_SERVO_STOPPED == Flags::STOPPED.0
        && PLP_SERVO_HELD == Flags::HELD.0
        && PLP_SERVO_DECAYING == Flags::DECAYING.0
        && PLP_SERVO_TOO_FAST == Flags::TOO_FAST.0
        && PLP_SERVO_WAITING == Flags::WAITING.0
        && PLP_SERVO_RAMPING == Flags::RAMPING.0
        && PLP_SERVO_AVERAGED == Flags::AVERAGED.0
        && PLP_SERVO_CLAMPED == Flags::CLAMPED.0
        && PLP_SERVO_SLEWED == Flags::SLEWED.0
        && PLP_SERVO_RELEASED == Flags::RELEASED.0
        && PLP_SERVO_DAMPED == Flags::DAMPED.0
);

/// What a servo loop gets at a tick.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_servo {
    /// Force for the device's motors in N, world frame: finite and within the device's limits, whatever happened.
    pub force_n: [f64; 3],
    /// Torque for its motors in N m, about the tool's origin, world frame.
    pub torque_n_m: [f64; 3],
    /// Where the tool is: the device's motion, or that of the proxy which hangs on it.
    pub tool: plp_motion,
    /// Simulated time of the step that the force comes from, in s.
    pub time_s: f64,
    /// How long ago that step arrived, in s; negative before the first.
    pub age_s: f64,
    /// How old the pose was with which the newest force was computed when that arrived, in s.
    pub latency_s: f64,
    /// Counts steps, as in plp_force.
    pub sequence: u64,
    /// PLP_SERVO_, or'ed; 0 where the force is just what the tissue answers.
    pub flags: u32,
    /// Always 0.
    pub reserved: u32,
}

/// How a servo loop is doing.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_servo_statistics {
    /// Ticks so far.
    pub tick_count: u64,
    /// How many of them came after a pause, the first included.
    pub pause_count: u64,
    /// Energy that the hand has put into the loop, in J.
    pub energy_j: f64,
    /// The least it ever was: a passive loop stays at or above 0.
    pub least_energy_j: f64,
    /// Root of the mean square of the force, over the device's window, in N.
    pub average_force_n: f64,
    /// How long ago the newest step arrived, in s; negative before the first.
    pub age_s: f64,
    /// Time from a motion's stamp to the tick that saw the first force computed with it, in s: the newest, ...
    pub latency_s: f64,
    /// ... and the longest so far.
    pub longest_latency_s: f64,
}

// SAFETY: repr(C), 8-byte fields.
unsafe impl Output for plp_servo_statistics {
    const NAME: &'static str = "plp_servo_statistics";
    const FIRST_SIZE: usize = offset_of!(Self, longest_latency_s) + size_of::<f64>();
}
