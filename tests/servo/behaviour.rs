//! What a host sees of a servo loop.

use palpate::math::{Pose, Vec3};
use palpate::servo::contact_model::ContactModel;
use palpate::servo::coupling::Coupling;
use palpate::servo::device::DeviceDesc;
use palpate::servo::flags::Flags;
use palpate::servo::{DeviceState, Output, Servo, ServoOptions};
use palpate::solver::tool::{ToolMotion, Wrench};

use crate::physics::{Physics, Says, Tissue};
use crate::rig::TICK_S;

const SOFT: Tissue = Tissue::Linear { stiffness_n_per_m: 125.0, relaxation_s: 0.0 };

/// A servo loop with a simulation behind it, and a device that goes where it is put.
struct Host {
    servo: Servo,
    physics: Physics,
    state: DeviceState,
    is_live: bool,
    last: Output,
}

impl Host {
    fn new(options: &ServoOptions) -> Self {
        let desc = DeviceDesc::touch();
        let motion = ToolMotion::at(Pose::translation(0.0, 0.0, 2e-3));
        let limits = options.coupling.limits(&desc);
        Self {
            servo: Servo::new(&desc, options).unwrap(),
            physics: Physics::new(SOFT, Says::Stiffness { doubt: 1.0 }, 1, &limits, TICK_S),
            state: DeviceState { motion, stamp_s: 100.0, is_held: true },
            is_live: true,
            last: Output { wrench: Wrench::default(), tool: motion, is_placed: true, flags: Flags::NONE },
        }
    }

    /// One tick with the simulation running, or standing still.
    fn tick_with(&mut self, runs: bool) -> Output {
        self.last = self.servo.tick(&self.state, self.physics.newest(), self.is_live);
        if runs {
            self.physics.advance(&self.last.tool, self.state.stamp_s);
        }
        self.state.stamp_s += TICK_S;
        self.last
    }

    /// Goes to a height within some time, and gives what the last tick gave.
    fn go(&mut self, height_m: f64, seconds: f64) -> Output {
        let start = self.state.motion.pose.translation.z;
        let count = (seconds / TICK_S).round() as u32;
        for tick in 1..=count {
            let z = start + (height_m - start) * f64::from(tick) / f64::from(count);
            self.state.motion = ToolMotion::at(Pose::translation(0.0, 0.0, z));
            self.tick_with(true);
        }
        self.last
    }

    /// Engaged, and 5 mm deep in tissue.
    fn pressing(options: &ServoOptions) -> Self {
        let mut host = Self::new(options);
        host.go(2e-3, 0.8);
        host.go(-5e-3, 0.1);
        host.go(-5e-3, 0.1);
        assert_eq!(host.last.flags, Flags::NONE);
        host
    }
}

fn direct() -> ServoOptions {
    ServoOptions { coupling: Coupling::Direct, controls_passivity: true }
}

fn coupled() -> ServoOptions {
    ServoOptions::of(&DeviceDesc::touch())
}

#[test]
fn a_press_is_felt_as_deep_as_it_is() {
    let force = |options: &ServoOptions| Host::pressing(options).last.wrench.force_n.z;
    assert!((force(&direct()) - 0.625).abs() < 1e-3, "125 N/m × 5 mm");
    assert!((force(&coupled()) - 0.625 * 700.0 / 825.0).abs() < 1e-3, "in series with 700 N/m");
}

#[test]
fn a_loop_that_starts_in_tissue_gives_no_force_until_the_tool_has_left_it() {
    let mut host = Host::new(&coupled());
    host.state.motion = ToolMotion::at(Pose::translation(0.0, 0.0, -5e-3));
    for _ in 0..2000 {
        let out = host.tick_with(true);
        assert_eq!(out.wrench, Wrench::default());
        assert!(out.flags.contains(Flags::WAITING));
    }
    host.go(2e-3, 0.2);
    host.go(2e-3, 0.7);
    assert!(host.go(-5e-3, 0.2).wrench.force_n.z > 0.5);
}

#[test]
fn a_simulation_that_fails_leaves_no_force_within_35_ms() {
    for (options, fails) in [(direct(), true), (coupled(), true), (coupled(), false)] {
        let mut host = Host::pressing(&options);
        host.is_live = !fails;
        let before = host.last.wrench.force_n.z;
        // One that merely stands still is waited for: held, then decaying, then gone after 100 ms.
        let gone_after = if fails { 35 } else { 101 };
        let mut last = before;
        for tick in 1..300 {
            let out = host.tick_with(false);
            assert!(out.wrench.force_n.z <= last + 1e-9, "it only ever falls");
            last = out.wrench.force_n.z;
            assert!(tick < gone_after || last == 0.0, "{last} N after {tick} ms, {:?}", out.flags);
            assert!(fails || tick > 10 || last == before, "held");
        }
        // And it comes back only when the tool has been out.
        host.is_live = true;
        assert!(host.go(-5e-3, 1.0).flags.contains(Flags::WAITING));
        host.go(2e-3, 0.2);
        host.go(2e-3, 0.7);
        assert!(host.go(-5e-3, 0.2).wrench.force_n.z > 0.5);
    }
}

#[test]
fn nonsense_from_the_device_or_the_physics_is_no_force_and_never_leaves() {
    let spoil: [fn(&mut Host); 5] = [
        |host| host.state.motion.pose.translation.z = f64::NAN,
        |host| host.state.motion.linear_m_s.x = f64::INFINITY,
        |host| host.state.stamp_s = f64::NAN,
        |host| host.state.motion.pose.translation.x += 0.1,
        |host| host.state.stamp_s -= 5.0,
    ];
    for (which, spoil) in spoil.iter().enumerate() {
        for options in [direct(), coupled()] {
            let mut host = Host::pressing(&options);
            let sound = host.state;
            spoil(&mut host);
            let first = host.tick_with(true);
            assert!(
                first.flags.intersects(Flags::NOT_FINITE | Flags::TOO_FAST),
                "case {which}: {:?}",
                first.flags
            );
            // The clock that stepped back goes on from there; all else is as it was.
            host.state = DeviceState { stamp_s: sound.stamp_s + TICK_S, ..sound };
            for tick in 0..1000 {
                let out = host.tick_with(true);
                assert!(out.tool.is_valid() && out.flags.contains(Flags::WAITING), "case {which}");
                assert!(out.wrench.force_n.norm() == 0.0 || tick < 5, "case {which}, {tick} ms: {out:?}");
            }
        }
    }
    let mut host = Host::pressing(&coupled());
    let mut wild = *host.physics.newest();
    wild.sequence += 1000;
    wild.stiffness[(1, 1)] = f64::NAN;
    let out = host.servo.tick(&host.state, &wild, true);
    assert!(out.flags.contains(Flags::NOT_FINITE) && out.wrench.force_n.iter().all(|x| x.is_finite()));
}

#[test]
fn a_loop_that_paused_engages_again() {
    let mut host = Host::pressing(&coupled());
    let energy_j = host.servo.statistics().energy_j;
    host.state.stamp_s += 0.2;
    host.state.motion.pose.translation.z -= 5e-3;
    let out = host.tick_with(true);
    assert_eq!(host.servo.statistics().energy_j, energy_j, "nobody knows what the motors did meanwhile");
    assert_eq!((out.wrench, out.flags.contains(Flags::PAUSED | Flags::WAITING)), (Wrench::default(), true));
    assert_eq!(host.servo.statistics().pauses, 2, "the start and this one");
    assert_eq!(host.go(-5e-3, 1.0).wrench, Wrench::default());
}

#[test]
fn missed_ticks_are_no_pause() {
    let mut host = Host::pressing(&coupled());
    host.state.stamp_s += 0.02;
    let out = host.tick_with(true);
    assert!(out.wrench.force_n.z > 0.5 && !out.flags.intersects(Flags::PAUSED | Flags::WAITING));
}

#[test]
fn the_dead_man_switch_alone_steps_to_zero() {
    let mut host = Host::pressing(&coupled());
    host.state.is_held = false;
    let out = host.tick_with(true);
    assert_eq!((out.wrench, out.flags.contains(Flags::RELEASED)), (Wrench::default(), true));
    assert_eq!(out.tool.pose.translation.z, -5e-3, "a proxy lets go as well");
    host.state.is_held = true;
    assert_eq!(host.go(-5e-3, 1.0).wrench, Wrench::default());
}

#[test]
fn nothing_is_felt_before_the_first_solve() {
    let mut host = Host::new(&direct());
    for _ in 0..1000 {
        let out = host.servo.tick(&host.state, &ContactModel::none(), true);
        host.state.stamp_s += TICK_S;
        assert_eq!(out.wrench, Wrench::default());
        assert!(out.flags.contains(Flags::WAITING), "nobody knows what will be felt");
    }
    assert_eq!(host.servo.statistics().age_s, f64::INFINITY);
}

#[test]
fn statistics_tell_the_energy_and_how_late_the_force_is() {
    let host = Host::pressing(&direct());
    let statistics = host.servo.statistics();
    // What was put in is stored in the tissue, but for the tick that the force lags: ½ 125 N/m (5 mm)².
    let stored = 0.5 * 125.0 * 5e-3_f64.powi(2);
    assert!((statistics.energy_j - stored).abs() < 0.03 * stored, "{} J of {stored} J", statistics.energy_j);
    // A pose is solved when the tick ends, published when the next solve begins, and seen a tick later.
    assert!((statistics.latency_s - 2.0 * TICK_S).abs() < 1e-9, "{}", statistics.latency_s);
    assert!(statistics.age_s < 1.5 * TICK_S && statistics.ticks == 1000);
    assert!(statistics.average_force_n > 0.1 && statistics.average_force_n < 0.625);
}

#[test]
fn a_lost_motion_leaves_the_tool_where_it_was() {
    let mut host = Host::pressing(&direct());
    let before = host.last.tool.pose;
    host.state.motion.pose.translation.vector = Vec3::repeat(f64::NAN);
    assert_eq!(host.tick_with(true).tool.pose, before);
}
