//! A haptic device on real tissue: what its contact models say, and what comes through the loop.
//!
//! Stepped by hand, a tick to a step, in time of the test's own.

use palpate::math::{Pose, Vec3};
use palpate::model::{Fix, LabelUse};
use palpate::servo::ServoOptions;
use palpate::servo::contact_model::{ContactModel, stiffness_along};
use palpate::servo::coupling::Coupling;
use palpate::servo::device::DeviceDesc;
use palpate::servo::{DeviceState, flags::Flags};
use palpate::sim::{Event, Sim, SimDesc, ToolPort};
use palpate::solver::tool::{ToolDesc, ToolMotion};

#[path = "support/block.rs"]
mod block;

use block::{Block, Pressed, tissue};

/// Cells of the block along x, y, z, and the edge of one in m.
const CELLS: [usize; 3] = [14, 10, 8];
const H: f64 = 4e-3;
const RADIUS: f64 = 10e-3;
const TICK_S: f64 = 1e-3;

/// Soft tissue, with a rib in it where asked: two cells below the top, in the middle.
fn pressed(has_rib: bool) -> Pressed {
    let rib = LabelUse::Rigid(tissue(1e9, 0.3, 1900.0, 0.0).unwrap());
    let is_rib = |[i, j, k]: [usize; 3]| (5..9).contains(&i) && (3..7).contains(&j) && (4..6).contains(&k);
    let inclusion = has_rib.then_some((rib, is_rib as fn(_) -> _));
    let soft = tissue(5e3, 0.45, 1000.0, 1e-4).unwrap();
    Block { cells: CELLS, cell_m: H, soft, inclusion }.build().unwrap()
}

/// A device over the middle of the block, `aside` along x.
struct Rig {
    sim: Sim,
    port: ToolPort,
    block: Pressed,
    time_s: f64,
    /// Depth of the device below the surface, and its way along x from the middle, in m.
    at: [f64; 2],
    force_n: Vec3,
    flags: Flags,
}

impl Rig {
    /// Engaged, 2 mm above the surface.
    fn new(block: Pressed, friction: f64, coupling: Coupling) -> Self {
        let desc = DeviceDesc::touch();
        let mut sim = Sim::new(block.model.clone(), &SimDesc { threads: 1, ..SimDesc::default() }).unwrap();
        let ball = ToolDesc { friction, ..ToolDesc::sphere(RADIUS) };
        let options = ServoOptions { coupling, ..ServoOptions::of(&desc) };
        let port = sim.add_haptic_tool(&ball, &desc, &options).unwrap();
        let mut rig = Self {
            sim,
            port,
            block,
            time_s: 0.0,
            at: [-2e-3, 0.0],
            force_n: Vec3::zeros(),
            flags: Flags::NONE,
        };
        rig.go([-2e-3, 0.0], 0.7);
        assert_eq!(rig.flags, Flags::NONE, "engaged");
        rig
    }

    fn tick(&mut self, at: [f64; 2]) {
        let [depth, aside] = at;
        let pose = self.block.at(RADIUS, depth, [aside, 0.0]);
        let speed = Vec3::new(aside - self.at[1], 0.0, self.at[0] - depth) / TICK_S;
        self.at = at;
        self.time_s += TICK_S;
        let motion = ToolMotion { linear_m_s: speed, ..ToolMotion::at(pose) };
        let state = DeviceState { motion, stamp_s: self.time_s, is_held: true };
        let exchange = self.port.exchange(&state, 0, true).unwrap();
        (self.force_n, self.flags) = (exchange.output.wrench.force_n, exchange.output.flags);
        self.sim.step().unwrap();
    }

    /// Goes there evenly within some time.
    fn go(&mut self, to: [f64; 2], seconds: f64) {
        let (from, count) = (self.at, (seconds / TICK_S).round() as u32);
        for tick in 1..=count {
            let share = f64::from(tick) / f64::from(count);
            self.tick([0, 1].map(|i| from[i] + (to[i] - from[i]) * share));
        }
    }

    /// Goes to a depth, waits until tissue and device have come to rest, and gives the force.
    fn press(&mut self, depth: f64) -> f64 {
        self.go([depth, self.at[1]], 0.1);
        self.go([depth, self.at[1]], 0.4);
        self.force_n.z
    }

    fn model(&mut self) -> ContactModel {
        *self.port.contact_model().unwrap()
    }
}

fn coupled() -> Coupling {
    ServoOptions::of(&DeviceDesc::touch()).coupling
}

#[test]
fn the_contact_model_of_a_press_pushes_along_its_force_and_is_as_stiff_as_the_tissue() {
    let mut rig = Rig::new(pressed(false), 0.3, Coupling::Direct);
    let shallow = rig.press(3e-3);
    let before = rig.press(4e-3);
    // On the way on from there, what it has just learned is the tissue under the tool.
    rig.go([4.5e-3, 0.0], 0.05);
    let told = rig.model();
    let after = rig.press(5e-3);

    let along = told.push.dot(&told.wrench.force_n.normalize());
    assert!(along > 0.999, "pressed straight, it pushes straight: {along}");
    assert!((told.push.norm() - 1.0).abs() < 1e-9);
    // The slope of Hertz's force rises by a ninth from 4 to 5 mm, F' ∝ √d: the secants on both sides bound the slope between but for what the tissue
    // moves on its way, which a hold lets go. A quarter covers that; a half-space alone would be off by the block's finite depth, a half.
    let (low, high) = ((before - shallow) / 1e-3, (after - before) / 1e-3);
    let stiffness = stiffness_along(&told.stiffness, told.push);
    assert!(low > 0.0 && high > low, "{low} and {high} N/m");
    assert!(stiffness > low / 1.25 && stiffness < high * 1.25, "{stiffness} N/m, not {low} to {high}");
    // What a model says at its own motion is the force that was felt.
    assert_eq!(told.evaluate(&told.motion), told.wrench);
}

#[test]
fn models_are_counted_over_resets_and_start_from_nothing() {
    let mut rig = Rig::new(pressed(false), 0.3, Coupling::Direct);
    rig.press(4e-3);
    let before = rig.model();
    assert!(before.push != Vec3::zeros() && before.sequence >= 1200);
    rig.sim.reset();
    let released = rig.model();
    assert_eq!(released.sequence, before.sequence + 1);
    assert_eq!((released.wrench.force_n, released.push), (Vec3::zeros(), Vec3::zeros()));
    rig.go([-2e-3, 0.0], 0.01);
    assert_eq!(rig.model().sequence, released.sequence + 10);
}

/// Drag and normal force, felt half way through a way of 8 mm along x.
fn dragged(friction: f64) -> (f64, f64) {
    let mut rig = Rig::new(pressed(false), friction, coupled());
    rig.go([-2e-3, -4e-3], 0.1);
    rig.press(4e-3);
    rig.go([4e-3, 4e-3], 0.4);
    let felt = -rig.force_n.x;
    let normal = rig.force_n.z;
    (felt, normal)
}

#[test]
fn friction_is_felt_against_the_motion_and_within_its_cone() {
    let (smooth, _) = dragged(0.0);
    let (felt, normal) = dragged(0.3);
    // Without friction there is what tissue piles up before the ball: with it, at most μ N more, as every point is in its cone, and nearly that
    // where all of them slide. A tenth for normals that are not straight.
    let limit = 0.3 * normal;
    assert!(normal > 0.1 && felt > 0.0, "{felt} N against {normal} N");
    assert!(
        felt - smooth > 0.5 * limit && felt - smooth < 1.1 * limit,
        "{felt} and {smooth} N, μ N {limit} N"
    );
}

/// How the force rises with the device's depth, near the surface and at depth, in N/m.
fn slopes(has_rib: bool) -> [f64; 2] {
    let mut rig = Rig::new(pressed(has_rib), 0.3, coupled());
    let depths = [2e-3, 3e-3, 6e-3, 7e-3];
    let felt = depths.map(|depth| rig.press(depth));
    [felt[1] - felt[0], felt[3] - felt[2]].map(|rise| rise / 1e-3)
}

#[test]
fn a_stiff_inclusion_is_felt_under_soft_tissue() {
    let (plain, rib) = (slopes(false), slopes(true));
    // Hertz's slope goes with the root of the depth: √(6.5 ÷ 2.5). A rib leaves 8 mm of tissue where there were 32 mm.
    let hertz = (6.5_f64 / 2.5).sqrt();
    let rises = [plain[1] / plain[0], rib[1] / rib[0]];
    assert!(rises[0] < 1.35 * hertz, "{rises:?}: tissue stiffens as it should");
    assert!(rises[1] > 1.2 * rises[0] && rib[1] > 1.5 * plain[1], "{plain:?} and {rib:?} N/m");
    assert!(rib[1] < 700.0, "never stiffer than the coupling: {rib:?}");
}

#[test]
fn tissue_that_cannot_move_is_a_wall_and_no_hammer() {
    // Contact answers for what cannot move as for the mass of its nodes in a substep: E h and some, for each point.
    let hard = tissue(60e3, 0.45, 1000.0, 1e-4).unwrap();
    let block = Block { cells: CELLS, cell_m: H, soft: hard, inclusion: None }.build().unwrap();
    let mut rig = Rig::new(block, 0.3, coupled());
    rig.sim.fix(&Fix { pose: Pose::identity(), half_extents: Vec3::repeat(1.0), axes: [true; 3] }).unwrap();
    rig.go([-2e-3, 0.0], 0.7);
    for depth in [1e-3, 2e-3, 3e-3] {
        rig.go([depth, 0.0], 0.3);
        // The spring alone, 700 N/m, but for what the ball sinks into the wall: some 10⁴ N/m.
        let (spring, felt) = (700.0 * depth, rig.force_n.z);
        assert!(felt > 0.8 * spring && felt < 1.01 * spring, "{felt} N at {depth} m");
    }
    rig.go([-2e-3, 0.0], 0.5);
    let least = rig.port.servo_statistics().unwrap().least_energy_j;
    // A force that is held for a tick is late by half of its way, 10 µm, in and out: 2.1 N × 10 µm at most.
    assert!(least > -1e-4, "{least} J");
}

#[test]
fn tissue_that_is_held_in_part_is_no_hammer_either() {
    // One node of the top is free. A point that hangs on it by a small share is heavy, and its neighbours push another way.
    let (cells, cell_m) = ([8, 8, 5], 12e-3);
    let firm = tissue(20e3, 0.45, 1000.0, 1e-4).unwrap();
    let block = Block { cells, cell_m, soft: firm, inclusion: None }.build().unwrap();
    let mut rig = Rig::new(block, 0.0, coupled());
    for node in (0..81).filter(|node| *node != 40) {
        let [x, y] = [node % 9, node / 9].map(|n| f64::from(n) * cell_m);
        let pose = Pose::translation(x, y, cells[2] as f64 * cell_m);
        rig.sim.fix(&Fix { pose, half_extents: Vec3::repeat(1e-3), axes: [true; 3] }).unwrap();
    }
    for aside in [6e-3, 9e-3] {
        rig.go([-2e-3, aside], 0.1);
        for depth in [2e-3, 4e-3] {
            rig.go([depth, aside], 0.2);
            for _ in 0..200 {
                rig.tick([depth, aside]);
                // The spring that the tool hangs on is all that presses it, and none is stretched by more than the device is deep; twice that for the ticks
                // in which a point comes.
                let (pressed, most) = (rig.port.force().wrench.force_n.norm(), 2.0 * 700.0 * depth);
                assert!(pressed < most, "{pressed} N of {most} N, {depth} m deep, {aside} m aside");
            }
        }
        rig.go([-2e-3, aside], 0.5);
        let least = rig.port.servo_statistics().unwrap().least_energy_j;
        // As above.
        assert!(least > -1e-4, "{least} J");
    }
}

#[test]
fn a_tool_that_a_device_holds_goes_a_metre_in_a_second_at_most_and_its_model_says_where_it_was() {
    let mut rig = Rig::new(pressed(false), 0.3, Coupling::Direct);
    rig.press(3e-3);
    let start = rig.model().motion.pose;
    // The hand is 5 mm higher at once: a jump for the servo, and the tissue's tool is on its way.
    let to = rig.block.at(RADIUS, -2e-3, [0.0, 0.0]);
    rig.port.set_motion(&ToolMotion::at(to)).unwrap();
    for step in 1..=6 {
        rig.sim.step().unwrap();
        let told = rig.model();
        let way = told.motion.pose.translation.vector - start.translation.vector;
        let expected = f64::min(1e-3 * f64::from(step), 5e-3);
        assert!((way - Vec3::z() * expected).norm() < 1e-12, "{way} m after {step} steps");
        // The last millimetre may be one that it keeps up with.
        let is_behind = step < 5;
        let speed = told.motion.linear_m_s;
        assert!(!is_behind || (speed - Vec3::z()).norm() < 1e-9, "{:?}", told.motion);
        assert!(step < 6 || speed == Vec3::zeros(), "{:?}", told.motion);
        assert_eq!(rig.port.force().motion, told.motion);
    }
    // A tool that nobody holds is where it is put.
    let mut free = rig.sim.add_tool(&ToolDesc::sphere(RADIUS)).unwrap();
    for z in [0.2, 0.3] {
        free.set_motion(&ToolMotion::at(Pose::translation(0.0, 0.0, z))).unwrap();
        rig.sim.step().unwrap();
        assert_eq!(free.force().motion.pose.translation.z, z);
    }
}

#[test]
fn a_servo_loop_of_the_hosts_own_says_how_long_a_model_has_to_serve() {
    let mut rig = Rig::new(pressed(false), 0.3, Coupling::Direct);
    let motion = ToolMotion::at(rig.block.at(RADIUS, -2e-3, [0.0, 0.0]));
    let start = rig.time_s;
    for solve in 1..=3 {
        let stamp_s = start + 7e-3 * f64::from(solve);
        rig.port.set_motion_at(&motion, stamp_s).unwrap();
        rig.sim.step().unwrap();
        let told = rig.model();
        assert!(told.stamp_s == stamp_s && (told.period_s - 7e-3).abs() < 1e-9, "{told:?}");
    }
}

#[test]
fn a_device_that_is_everywhere_at_once_does_not_tear_the_tissue() {
    let mut rig = Rig::new(pressed(true), 0.3, Coupling::Direct);
    let mut noise = 1_u32;
    for _ in 0..400 {
        // From 30 mm above to 30 mm below the surface, and aside.
        let mut next = || {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            0.06 * (f64::from(noise >> 8) / f64::from(1 << 24) - 0.5)
        };
        let at = rig.block.at(RADIUS, next(), [next(), next()]);
        rig.port.set_motion(&ToolMotion::at(at)).unwrap();
        rig.sim.step().unwrap();
    }
}

#[test]
fn a_tool_that_a_reset_finds_in_tissue_comes_free_with_its_hand() {
    let mut rig = Rig::new(pressed(false), 0.3, coupled());
    // The centre of the ball is below where the surface was.
    rig.press(RADIUS + 4e-3);
    rig.sim.reset();
    rig.press(RADIUS + 4e-3);
    assert!(rig.flags.contains(Flags::WAITING), "{:?}", rig.flags);
    rig.go([-2e-3, 0.0], 0.1);
    rig.go([-2e-3, 0.0], 0.7);
    assert_eq!((rig.flags, rig.force_n), (Flags::NONE, Vec3::zeros()), "free, and engaged");
    assert!(rig.press(3e-3) > 0.1, "{} N", rig.force_n.z);
}

#[test]
fn every_click_of_a_button_becomes_an_event_however_short() {
    let mut rig = Rig::new(pressed(false), 0.3, Coupling::Direct);
    let mut ticks = |buttons: &[u32]| {
        for &buttons in buttons {
            rig.time_s += TICK_S;
            let motion = ToolMotion::at(rig.block.at(RADIUS, -2e-3, [0.0; 2]));
            let state = DeviceState { motion, stamp_s: rig.time_s, is_held: true };
            rig.port.exchange(&state, buttons, true).unwrap();
        }
        rig.sim.step().unwrap();
        let (sim, own) = (&mut rig.sim, rig.port.id());
        let told = std::iter::from_fn(|| sim.poll_event()).map(|event| match event {
            Event::Buttons { tool, buttons, .. } if tool == own => buttons,
            other => panic!("{other:?}"),
        });
        told.collect::<Vec<_>>()
    };
    // All in one step: two clicks of one button, and one of another that lasts.
    assert_eq!(ticks(&[0, 1, 1, 0, 1, 0, 2]), [1, 0, 1, 0, 2]);
    assert_eq!(ticks(&[2, 2]), []);
    assert_eq!(ticks(&[0]), [0]);
}
