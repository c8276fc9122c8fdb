//! What a simulation says of itself: bricks, times of steps, bytes.

use palpate::math::Vec3;
use palpate::sim::{Latency, SimDesc};
use palpate::solver::statistics::Copied;

use super::scene::{Body, block, hold, material};

/// 32 × 8 × 8 nodes: 4 × 2 × 2 whole bricks.
const CELLS: [usize; 3] = [31, 7, 7];
const BRICKS: u64 = 16;

fn body(substeps: Option<u32>) -> Body {
    let mut build = block(CELLS, 4e-3, material(5e3, 0.45, 1000.0));
    hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
    let desc = SimDesc { substeps, threads: 1, drag_per_s: 100.0, ..SimDesc::default() };
    Body::new(&build, &desc)
}

#[test]
fn awake_bricks_are_those_that_hold_the_awake_nodes() {
    let mut body = body(None);
    body.steps(1);
    let all = body.sim.statistics();
    assert_eq!((all.awake_nodes, all.awake_bricks), (all.node_count, BRICKS));
    body.steps(40);
    let asleep = body.sim.statistics();
    assert_eq!((asleep.awake_nodes, asleep.awake_bricks), (0, 0));
}

#[test]
fn steps_that_end_well_are_timed_until_a_new_count_is_asked_for() {
    let mut body = body(None);
    assert_eq!(body.sim.latency(), Latency::default());
    let (mut longest, mut shortest) = (0.0_f64, f64::MAX);
    for _ in 0..50 {
        body.steps(1);
        let now = body.sim.statistics();
        assert!(now.step_device_s > 0.0 && now.step_device_s <= now.step_wall_s);
        (longest, shortest) = (longest.max(now.step_wall_s), shortest.min(now.step_wall_s));
    }
    body.sim.reset();
    let latency = body.sim.latency();
    assert_eq!((latency.steps(), latency.max_s()), (50, longest));
    assert!((shortest..=longest).contains(&latency.quantile_s(0.5)));
    body.sim.reset_latency();
    assert_eq!(body.sim.latency(), Latency::default());
}

#[test]
fn a_step_that_fails_is_not_timed() {
    let mut body = body(Some(1));
    body.steps(1);
    let slot = body.sim.model().lattice().slots().last().unwrap();
    body.sim.set_node(slot, Vec3::zeros(), Vec3::repeat(1e3)).unwrap();
    assert!(body.sim.step().is_err(), "a node crosses a cell in a substep");
    assert_eq!(body.sim.latency().steps(), 1);
}

#[test]
fn the_processor_copies_nothing_to_a_device() {
    let mut body = body(None);
    body.steps(3);
    assert_eq!(body.sim.statistics().copied, Copied::default());
}
