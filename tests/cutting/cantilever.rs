//! A double cantilever: a beam that is cut lengthwise, and whose arms are pulled apart by their ends.

use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::{Fix, Model};
use palpate::sim::{NodeField, Precision, Sim, SimDesc};
use palpate::solver::load::{Load, Region};
use palpate::solver::method::Method;

use super::{CELL_M, METHODS, POISSON, YOUNG_PA, beam, slit};

/// Cells along the beam, across it, and in the height of one arm.
const LENGTH: usize = 24;
const WIDTH: usize = 2;
const ARM: usize = 4;
/// The layer of nodes in which the cut ends, in cells from what is held.
const TIP: f64 = 8.0;
/// Pulls at the last cells, above and below: ends part by a twentieth of a cell.
const TRACTION_PA: f64 = 0.3;
/// Somewhat less than would keep the arms from swinging, which they do at some 15 rad/s.
const DRAG_PER_S: f64 = 20.0;
/// Acceleration at which arms count as at rest: they would go on by some 1e-4 of their way.
const REST_M_S2: f64 = 1e-6;

/// How much further or less far an arm may go than the same arm on rollers. A cut keeps a thousandth of a cell from nodes: so much thicker is one arm, and thinner the other. By the third
/// power of its height it is stiffer by 3 ÷ 4,000; in the lattice, where the springs of so thin a strip span a whole cell, by up to twice that.
const STRIP: f64 = 2e-3;
/// As does the mean of both, in which that cancels but for what the lattice makes of it.
const STRIP_BOTH: f64 = 1e-3;
/// How much further or less far an arm goes, at most, for each 0.002 of a cell by which the cut is moved.
const JUMP: f64 = 1e-2;
/// By how much of an arm's height its root gives way as if it were longer: 0.64 on an elastic foundation (Kanninen 1973), 0.69 by boundary collocation (Gross and Srawley 1966).
const ROOT: f64 = 0.66;
/// How far that may be off: by these figures alone by 2 %, and the tip of a cut in cells is stiffer than a sharp one.
const OFF: f64 = 0.05;

fn simulation(model: &Arc<Model>, method: Method) -> Sim {
    let desc = SimDesc {
        method,
        precision: Precision::Double,
        threads: 1,
        substeps: (method == Method::Lattice).then_some(8),
        drag_per_s: DRAG_PER_S,
        sleeping: false,
        cut_nodes: 1000,
        ..SimDesc::default()
    };
    Sim::new(model.clone(), &desc).unwrap()
}

/// How far the ends of arms go where they are pulled, each at a height in cells and up or down, in m.
fn pulled(mut sim: Sim, method: Method, arms: &[(f64, f64)]) -> Vec<f64> {
    for &(height, sign) in arms {
        let region = Region {
            pose: Pose::translation((LENGTH as f64 - 0.5) * CELL_M, 0.0, height * CELL_M),
            half_extents_m: Vec3::new(0.1 * CELL_M, 1.0, 0.1 * CELL_M),
        };
        sim.add_load(&Load::Traction { region, traction_pa: Vec3::z() * (sign * TRACTION_PA) }).unwrap();
    }
    if method == Method::Lattice {
        (0..1500).for_each(|_| sim.step().unwrap());
    }
    let left = sim.settle(REST_M_S2, 1000).unwrap();
    assert!(left <= REST_M_S2, "{left} m/s² are left");
    let (rest, moved) = (sim.nodes(NodeField::RestPosition), sim.nodes(NodeField::Displacement));
    let way = |&(height, sign): &(f64, f64)| {
        let (mut sum, mut whole) = (0.0, 0.0);
        for (p, u) in rest.iter().map(|p| p / CELL_M).zip(&moved) {
            if p.x > LENGTH as f64 - 1.1 && (p.z - height).abs() < 0.1 {
                // As the load is shared among nodes.
                let share = if p.y < 0.1 || p.y > WIDTH as f64 - 0.1 { 0.5 } else { 1.0 };
                (sum, whole) = (sum + share * sign * u.z, whole + share);
            }
        }
        sum / whole
    };
    arms.iter().map(way).collect()
}

/// How far the lower and the upper arm go where the beam is cut at a height, in cells.
fn cut_at(method: Method, height: f64) -> [f64; 2] {
    let mut sim = simulation(&beam([LENGTH, WIDTH, 2 * ARM], true), method);
    // Just beyond the nodes of the tip: the cells before them stay whole.
    let divided = slit(&mut sim, LENGTH as f64 + 1.0, TIP - 0.3, height);
    assert_eq!(divided, (LENGTH - TIP as usize) * WIDTH);
    let arms = pulled(sim, method, &[(0.0, -1.0), (2.0 * ARM as f64, 1.0)]);
    [arms[0], arms[1]]
}

/// How far one arm goes whose lower faces are the mirror's plane: it stands on rollers up to the tip, as either half of a beam does that is cut along faces of its cells.
fn on_rollers(method: Method) -> f64 {
    let mut sim = simulation(&beam([LENGTH, WIDTH, ARM], true), method);
    let half_extents = Vec3::new((TIP + 0.1) * CELL_M, 1.0, 0.1 * CELL_M);
    sim.fix(&Fix { pose: Pose::identity(), half_extents, axes: [false, false, true] }).unwrap();
    pulled(sim, method, &[(ARM as f64, 1.0)])[0]
}

#[test]
fn arms_that_are_pulled_apart_give_way_as_on_a_grid_that_ends_at_the_cut() {
    for method in METHODS {
        let expected = on_rollers(method);
        // A thousandth below the layer of nodes, and as much above it.
        let arms = [3.999, 4.001].map(|height| cut_at(method, height));
        for [lower, upper] in arms {
            let shares = [lower, upper, 0.5 * (lower + upper)].map(|way| way / expected - 1.0);
            assert!(shares[0].abs() < STRIP && shares[1].abs() < STRIP, "{shares:?}");
            assert!(shares[2].abs() < STRIP_BOTH, "{shares:?}");
        }
        check_moved(arms);
        // Through the middles of cells.
        check_moved([4.499, 4.501].map(|height| cut_at(method, height)));
    }
}

fn check_moved(arms: [[f64; 2]; 2]) {
    let change = [0, 1].map(|arm| arms[1][arm] / arms[0][arm] - 1.0);
    assert!(change.iter().all(|change| change.abs() < JUMP), "{change:?}");
}

#[test]
fn arms_that_are_pulled_apart_give_way_as_beam_theory_says_with_a_root_that_gives_way_too() {
    // How far beams of four cells bend, as a share of the way that they should: `tests/truth/elastic.rs`, between its ν, and `efg.rs`.
    for (method, bent) in METHODS.into_iter().zip([0.946, 1.017]) {
        let (length, height) = (LENGTH as f64 - 0.5 - TIP, ARM as f64);
        // F a³ ÷ 3 E I and F a ÷ κ G A, in which I = b h³ ÷ 12 and κ = 10 (1 + ν) ÷ (12 + 11 ν).
        let unit = 4.0 * TRACTION_PA * CELL_M / YOUNG_PA;
        let slender = (length / height).powi(3);
        let shear = (12.0 + 11.0 * POISSON) / 20.0 * (length / height);
        let rooted = (length / height + ROOT).powi(3);
        let share = on_rollers(method) / unit;
        assert!(share > bent * (slender + shear), "{share} of {}", slender + shear);
        assert!((share / (bent * rooted) - 1.0).abs() < OFF, "{share} of {rooted}");
    }
}
