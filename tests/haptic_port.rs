//! A haptic device on real tissue: what its contact models say, and what comes through the loop.
//!
//! Stepped by hand, a tick to a step, in time of the test's own.

use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::{LabelUse, Model};
use palpate::servo::ServoOptions;
use palpate::servo::contact_model::{ContactModel, stiffness_along};
use palpate::servo::coupling::Coupling;
use palpate::servo::device::DeviceDesc;
use palpate::servo::{DeviceState, flags::Flags};
use palpate::sim::{Sim, SimDesc, ToolPort};
use palpate::solver::tool::{ToolDesc, ToolMotion};

#[path = "truth/scene.rs"]
#[allow(dead_code, reason = "a few of the shared scenes serve here")]
mod scene;

/// Cells of the block along x, y, z, and the edge of one in m.
const CELLS: [usize; 3] = [14, 10, 8];
const H: f64 = 4e-3;
const RADIUS: f64 = 10e-3;
const TICK_S: f64 = 1e-3;

/// Soft tissue, with a rib in it where asked: two cells below the top, in the middle.
fn model(has_rib: bool) -> Arc<Model> {
    let label = |[i, j, k]: [usize; 3]| {
        let is_inside = (5..9).contains(&i) && (3..7).contains(&j) && (4..6).contains(&k);
        if has_rib && is_inside { 2 } else { 1 }
    };
    let soft = palpate::model::material::Material { damping_s: 1e-4, ..scene::material(5e3, 0.45, 1000.0) };
    let uses = [(1, LabelUse::Tissue(soft)), (2, LabelUse::Rigid(scene::material(1e9, 0.3, 1900.0)))];
    let mut build = scene::voxels(CELLS, H, label, &uses);
    scene::hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// Height of the surface that tools meet, which smoothing has moved off the cells' faces, in m.
fn highest(model: &Model) -> f64 {
    let vertices = model.surfaces()[model.contact_surface()].positions.iter();
    vertices
        .map(|vertex| model.frame().transform_point(&(*vertex).into()).z)
        .fold(f64::NEG_INFINITY, f64::max)
}

/// A device over the middle of the block, `aside` along x.
struct Rig {
    sim: Sim,
    port: ToolPort,
    time_s: f64,
    surface_m: f64,
    /// Depth of the device below the surface, and its way along x from the middle, in m.
    at: [f64; 2],
    force_n: Vec3,
    flags: Flags,
}

impl Rig {
    /// Engaged, 2 mm above the surface.
    fn new(model: &Arc<Model>, friction: f64, coupling: Coupling) -> Self {
        let desc = DeviceDesc::touch();
        let mut sim = Sim::new(model.clone(), &SimDesc { threads: 1, ..SimDesc::default() }).unwrap();
        let ball = ToolDesc { friction, ..ToolDesc::sphere(RADIUS) };
        let options = ServoOptions { coupling, ..ServoOptions::of(&desc) };
        let port = sim.add_haptic_tool(&ball, &desc, &options).unwrap();
        let mut rig = Self {
            sim,
            port,
            time_s: 0.0,
            surface_m: highest(model),
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
        let pose = Pose::translation(
            (0.5 * CELLS[0] as f64) * H + aside,
            0.5 * CELLS[1] as f64 * H,
            self.surface_m + RADIUS - depth,
        );
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
    let mut rig = Rig::new(&model(false), 0.3, Coupling::Direct);
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
    let mut rig = Rig::new(&model(false), 0.3, Coupling::Direct);
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
    let mut rig = Rig::new(&model(false), friction, coupled());
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
    let mut rig = Rig::new(&model(has_rib), 0.3, coupled());
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
