//! Whatever comes in, what goes out is bounded.

use palpate::math::{Pose, Vec3};
use palpate::servo::contact_model::ContactModel;
use palpate::servo::coupling::{Coupling, VirtualCoupling};
use palpate::servo::device::DeviceDesc;
use palpate::servo::flags::Flags;
use palpate::servo::impedance::{BlockLimit, isotropic};
use palpate::servo::{DeviceState, Servo, ServoOptions};
use palpate::solver::tool::{ToolMotion, Wrench};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

/// Numbers of every size, most of them sane for something measured in `unit`.
fn number(unit: f64) -> impl Strategy<Value = f64> {
    prop_oneof![
        60 => (-1.0..1.0).prop_map(move |x: f64| x * unit),
        2 => Just(0.0),
        1 => any::<f64>(),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
    ]
}

fn vector(unit: f64) -> impl Strategy<Value = Vec3> {
    // Mostly all sane: three numbers would seldom be.
    prop_oneof![
        20 => [-1.0..1.0, -1.0..1.0, -1.0..1.0_f64].prop_map(move |v| Vec3::from(v) * unit),
        1 => [number(unit), number(unit), number(unit)].prop_map(Vec3::from),
    ]
}

fn motion() -> impl Strategy<Value = ToolMotion> {
    (vector(5e-4), vector(0.1), vector(0.2), vector(1.0)).prop_map(|(at, turn, linear_m_s, angular_rad_s)| {
        ToolMotion { pose: Pose::new(at, turn), linear_m_s, angular_rad_s }
    })
}

fn model() -> impl Strategy<Value = ContactModel> {
    let wrenches = (vector(5.0), vector(0.1), prop_oneof![Just(Vec3::zeros()), Just(Vec3::z())]);
    (wrenches, motion(), number(1000.0), number(5.0), number(0.02), 0..50_u64).prop_map(
        |((force_n, torque_n_m, push), motion, stiffness, damping, period_s, sequence)| ContactModel {
            wrench: Wrench { force_n, torque_n_m },
            motion,
            stiffness: isotropic(stiffness, 1e-3 * stiffness),
            damping: isotropic(damping, 1e-3 * damping),
            push,
            period_s,
            sequence,
            ..ContactModel::none()
        },
    )
}

/// A tick: the device, the time since the last, the model, whether the simulation lives and the dead-man switch is held.
fn tick() -> impl Strategy<Value = (ToolMotion, f64, ContactModel, bool, bool)> {
    let pass = prop_oneof![50 => Just(1e-3), 2 => Just(0.0), 1 => number(0.1)];
    (motion(), pass, model(), prop::bool::weighted(0.99), prop::bool::weighted(0.99))
}

fn device() -> DeviceDesc {
    DeviceDesc {
        max_torque_n_m: 0.2,
        continuous_torque_n_m: 0.05,
        max_stiffness: BlockLimit { linear: 700.0, angular: 1.0 },
        max_damping: BlockLimit { linear: 5.0, angular: 0.01 },
        slew_n_m_per_s: 20.0,
        ..DeviceDesc::touch()
    }
}

/// Plays ticks to an engaged loop, and checks what goes out.
fn play(
    ticks: Vec<(ToolMotion, f64, ContactModel, bool, bool)>,
    is_direct: bool,
) -> Result<(), TestCaseError> {
    let desc = device();
    let coupling = if is_direct { Coupling::Direct } else { Coupling::Virtual(VirtualCoupling::of(&desc)) };
    let mut servo = Servo::new(&desc, &ServoOptions { coupling, controls_passivity: true }).unwrap();
    let mut stamp_s = 0.0;
    let still = ContactModel { period_s: 1e-3, ..ContactModel::none() };
    for sequence in 1000..1800 {
        stamp_s += 1e-3;
        let state = DeviceState { motion: still.motion, stamp_s, is_held: true };
        servo.tick(&state, &ContactModel { sequence, ..still }, true);
    }
    let mut last = Wrench::default();
    for (motion, passed_s, model, is_live, is_held) in ticks {
        stamp_s = if stamp_s.is_finite() { stamp_s + passed_s } else { 1.0 };
        let out = servo.tick(&DeviceState { motion, stamp_s, is_held }, &model, is_live);
        let given = out.wrench;
        prop_assert!(given.force_n.iter().chain(given.torque_n_m.iter()).all(|x| x.is_finite()));
        prop_assert!(given.force_n.norm() <= desc.max_force_n * (1.0 + 1e-12));
        prop_assert!(given.torque_n_m.norm() <= desc.max_torque_n_m * (1.0 + 1e-12));
        prop_assert!(out.tool.is_valid());
        if out.flags.intersects(Flags::RELEASED | Flags::PAUSED) {
            prop_assert_eq!(given, Wrench::default());
        } else if passed_s.is_finite() {
            // Two ticks' worth at most, but for what is withdrawn.
            let most_s = if out.flags.contains(Flags::WAITING) { passed_s.abs().max(2e-3) } else { 2e-3 };
            let change = (given.force_n - last.force_n).norm();
            prop_assert!(change <= desc.slew_n_per_s * most_s * (1.0 + 1e-9));
        }
        last = given;
    }
    Ok(())
}

#[test]
fn no_input_makes_a_force_that_the_device_cannot_bear() {
    // The same ticks every time.
    let config = Config { cases: 200, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let runs = (prop::collection::vec(tick(), 1..200), any::<bool>());
    runner.run(&runs, |(ticks, is_direct)| play(ticks, is_direct)).unwrap();
}
