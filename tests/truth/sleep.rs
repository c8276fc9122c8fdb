//! Sleeping: it hides little, wakes when it must, and gives no energy away.

use palpate::math::Vec3;
use palpate::sim::{Precision, SimDesc};
use palpate::solver::tool::ToolDesc;

use super::scene::{Body, block, hold, material, place, step_to, touch_flat_top};
use super::tolerance::{self as tol, Claim};

const H: f64 = 4e-3;
const CELLS: [usize; 3] = [24, 16, 8];

/// Soft tissue on a rigid ground, in steps of a millisecond.
fn tissue(sleeping: bool, precision: Precision) -> Body {
    let mut build = block(CELLS, H, material(5e3, 0.45, 1000.0));
    hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
    touch_flat_top(&mut build, CELLS, H);
    let desc = SimDesc { precision, sleeping, threads: 1, drag_per_s: 100.0, ..SimDesc::default() };
    Body::new(&build, &desc)
}

/// A place above one end of the block, at this height over its top.
fn above(height: f64) -> Vec3 {
    Vec3::new(6.0 * H, 8.0 * H, CELLS[2] as f64 * H + 6e-3 + height)
}

#[test]
fn sleep_moves_no_node_by_more_than_a_hundredth_of_a_cell() {
    let mut claim = Claim::new("sleeping against not sleeping");
    let mut bodies = [true, false].map(|sleeping| tissue(sleeping, Precision::Single));
    let mut ports = bodies.each_mut().map(|body| body.sim.add_tool(&ToolDesc::sphere(6e-3)).unwrap());
    let (mut furthest, mut fewest) = (0.0_f64, u64::MAX);
    for step in 0..1600 {
        // Down in 0.2 s, held, up again in 0.2 s, away.
        let t = f64::from(step) * 1e-3;
        let depth = 5e-3 * (t / 0.2).min(1.0).min((1.2 - t) / 0.2);
        for (body, port) in bodies.iter_mut().zip(&mut ports) {
            step_to(body, port, above(-depth));
        }
        if step % 20 == 0 {
            let [one, two] = bodies.each_ref().map(Body::u);
            furthest = one.iter().zip(&two).map(|(a, b)| (a - b).norm()).fold(furthest, f64::max);
        }
        fewest = fewest.min(bodies[0].sim.statistics().awake_nodes);
    }
    claim.check(tol::SLEEP_HIDES, "largest difference / h", furthest / H);
    let all = bodies[0].sim.statistics().node_count;
    assert!(fewest < all, "part of the body must have slept");
    assert_eq!(bodies[1].sim.statistics().awake_nodes, all);
}

#[test]
fn a_body_at_rest_sleeps_fully_and_wakes_at_touch_and_at_a_change_of_gravity() {
    for precision in [Precision::Single, Precision::Double] {
        let mut body = tissue(true, precision);
        body.steps(40);
        assert_eq!(body.sim.statistics().awake_nodes, 0);

        let mut port = body.sim.add_tool(&ToolDesc::sphere(6e-3)).unwrap();
        step_to(&mut body, &mut port, above(1e-3));
        assert_eq!(body.sim.statistics().awake_nodes, 0, "a tool nearby is no touch");
        let force = step_to(&mut body, &mut port, above(-1e-3));
        assert!(force.wrench.force_n.z > 0.0, "the first touch is felt at once");
        let awake = body.sim.statistics().awake_nodes;
        assert!(awake > 0 && awake < body.sim.statistics().node_count, "what is far sleeps on: {awake}");

        place(&mut port, above(0.1));
        body.steps(1500);
        assert_eq!(body.sim.statistics().awake_nodes, 0, "quiet again");

        body.sim.set_gravity(Vec3::new(0.0, 0.0, -1.0)).unwrap();
        body.steps(1);
        assert_eq!(body.sim.statistics().awake_nodes, body.sim.statistics().node_count);
        assert!(body.momentum().0.z < 0.0, "gravity pulls");
    }
}

#[test]
fn falling_asleep_and_waking_create_no_energy() {
    let mut claim = Claim::new("energy and sleep");
    let mut body = tissue(true, Precision::Double);
    let mut port = body.sim.add_tool(&ToolDesc::sphere(6e-3)).unwrap();
    for step in 0..300 {
        step_to(&mut body, &mut port, above(-4e-3 * (f64::from(step) / 100.0).min(1.0)));
    }
    // Let go: waves run into sleeping bricks and wake them, while drag takes energy away.
    place(&mut port, above(0.1));
    body.steps(2);
    let start = body.total_energy();
    let (mut least, mut gained) = (start, 0.0_f64);
    let (mut fewest, mut most) = (u64::MAX, 0);
    for _ in 0..800 {
        body.steps(1);
        let energy = body.total_energy();
        gained = gained.max(energy - least);
        least = least.min(energy);
        let awake = body.sim.statistics().awake_nodes;
        (fewest, most) = (fewest.min(awake), most.max(awake));
    }
    assert!(fewest < most, "bricks fell asleep or woke");
    claim.check(tol::SLEEP_ENERGY, "largest gain / start", gained / start);
}
