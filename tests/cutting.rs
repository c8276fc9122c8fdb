//! Cutting: what blades leave of a block, as solid mechanics says.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::error::Error;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::sim::{NodeField, Precision, Sim, SimDesc};
use palpate::solver::method::{EfgDesc, Elasticity, Method, Rows, Scheme};

#[path = "cutting/behind.rs"]
mod behind;
#[path = "cutting/blade.rs"]
mod blade;
#[path = "cutting/bone.rs"]
mod bone;
#[path = "cutting/cantilever.rs"]
mod cantilever;
#[path = "support/closed.rs"]
mod closed;
#[path = "cutting/limits.rs"]
mod limits;
#[path = "cutting/opening.rs"]
mod opening;
#[path = "cutting/random.rs"]
mod random;
#[path = "cutting/removal.rs"]
mod removal;
#[path = "cutting/surface.rs"]
mod surface;

const CELL_M: f64 = 2e-3;
const DENSITY_KG_M3: f64 = 1000.0;
const YOUNG_PA: f64 = 5e3;
const POISSON: f64 = 0.4;
/// What rounding and the floors of the volume of tiny pieces leave of a mass or a volume.
const EXACT: f64 = 1e-9;

/// Acceleration at which a beam under 1 m/s² counts as at rest.
const REST_M_S2: f64 = 1e-3;
/// How much more or less an arm bends, at most, for each hundredth of a cell by which the cut is moved.
const JUMP: f64 = 1e-2;

/// A beam along x whose lowest corner is the origin; held at x = 0 where asked.
fn beam(cells: [usize; 3], is_held: bool) -> Arc<Model> {
    let middle = Pose::translation(0.5 * CELL_M, 0.5 * CELL_M, 0.5 * CELL_M);
    let labels = vec![1; cells.iter().product()];
    let mut build = Build::new(LabelGrid::new(cells, Vec3::repeat(CELL_M), middle, labels).unwrap());
    let tissue = Material::new("tissue", YOUNG_PA, POISSON, DENSITY_KG_M3).unwrap();
    build.uses = BTreeMap::from([(1, LabelUse::Tissue(tissue))]);
    if is_held {
        let half_extents = Vec3::new(0.1 * CELL_M, 1.0, 1.0);
        build.fixes.push(Fix { pose: Pose::identity(), half_extents, axes: [true; 3] });
    }
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// Both models; the meshless one solved to rounding.
const METHODS: [Method; 2] = [
    Method::Lattice,
    Method::Efg(EfgDesc {
        elasticity: Elasticity::Corotated,
        scheme: Scheme::BackwardEuler,
        tolerance: 1e-10,
        max_iterations: 5000,
        rows: Rows::Irregular,
    }),
];

fn simulation(model: &Arc<Model>, method: Method, gravity_m_s2: Vec3) -> Sim {
    dragged(model, method, gravity_m_s2, 0.0)
}

/// With background drag, 1/s.
fn dragged(model: &Arc<Model>, method: Method, gravity_m_s2: Vec3, drag_per_s: f64) -> Sim {
    stepped(model, method, gravity_m_s2, drag_per_s, SimDesc::default().step_s)
}

/// In steps of a length, s.
fn stepped(model: &Arc<Model>, method: Method, gravity_m_s2: Vec3, drag_per_s: f64, step_s: f64) -> Sim {
    let desc = SimDesc {
        step_s,
        method,
        precision: Precision::Double,
        threads: 2,
        // The same before and after a cut, for which the stable substep gets shorter.
        substeps: (method == Method::Lattice).then_some(8),
        drag_per_s,
        gravity_m_s2,
        rest_under_gravity: false,
        cut_nodes: 10_000,
        ..SimDesc::default()
    };
    Sim::new(model.clone(), &desc).unwrap()
}

/// Moves a straight blade along y through a beam from its end, x = `from` cells, to x = `to`, at a height of `height` cells.
fn slit(sim: &mut Sim, from: f64, to: f64, height: f64) -> usize {
    let edge = |x: f64| [-1.0, 99.0].map(|y| Vec3::new(x, y, height) * CELL_M);
    sim.cut(&edge(from), &edge(to)).unwrap()
}

#[test]
fn a_beam_cut_through_falls_in_two_that_do_not_feel_each_other() {
    for method in METHODS {
        // Beyond the middle of the beam; and through the cells that are held at their other side.
        sever(method, 6.35);
        sever(method, 0.4);
    }
}

fn sever(method: Method, at: f64) {
    let cells = [12, 3, 4];
    let model = beam(cells, true);
    // It is pulled away from what holds it, so that both sides part at once.
    let mut sim = simulation(&model, method, 9.81 * Vec3::x());
    for _ in 0..10 {
        sim.step().unwrap();
    }
    let (whole, energy) = (sim.parts(), sim.energy());
    assert_eq!(whole.len(), 1);
    // A blade along z; the beam hangs, and is cut where it is.
    let blade = |y: f64| [-99.0, 99.0].map(|z| Vec3::new(at, y, z) * CELL_M);
    assert_eq!(sim.cut(&blade(-1.0), &blade(4.0)).unwrap(), 12);
    let parts = sim.parts();
    assert_eq!(parts.len(), 2);
    let volume: f64 = parts.iter().map(|part| part.volume_m3).sum();
    let mass: f64 = parts.iter().map(|part| part.mass_kg).sum();
    let expected = (cells[0] * cells[1] * cells[2]) as f64 * CELL_M.powi(3);
    assert!((volume / expected - 1.0).abs() < EXACT && (mass / expected / DENSITY_KG_M3 - 1.0).abs() < EXACT);
    let free = parts.iter().position(|part| !part.is_held).expect("what was cut off is free");
    assert!(parts[1 - free].is_held);
    // Nothing has moved yet: of the motion neither momentum nor energy was lost.
    let momentum =
        |parts: &[palpate::sim::Part]| parts.iter().map(|p| p.velocity_m_s * p.mass_kg).sum::<Vec3>();
    let (before, after) = (momentum(&whole), momentum(&parts));
    assert!((before - after).norm() < 0.02 * before.norm(), "{before:?} {after:?}");
    assert!((sim.energy().kinetic_j - energy.kinetic_j).abs() < 0.02 * energy.kinetic_j);

    // What was cut off falls freely: its momentum grows by its weight, and by nothing else.
    for _ in 0..30 {
        let before = sim.parts()[free].velocity_m_s;
        sim.step().unwrap();
        let gained = sim.parts()[free].velocity_m_s - before;
        assert!((gained - Vec3::x() * 9.81e-3).norm() < 1e-8, "{gained:?}");
    }
}

/// How far the ends of both arms bend, at last, of a beam whose free end is cut lengthwise at a height. The lower arm is the thinner one, so that it sinks away from the other.
fn bent(method: Method, height: f64) -> [f64; 2] {
    let model = beam([16, 2, 8], true);
    let mut sim = simulation(&model, method, -1.0 * Vec3::z());
    slit(&mut sim, 20.0, 6.0, height);
    let left = sim.settle(REST_M_S2, 40_000).unwrap();
    assert!(left <= REST_M_S2, "{left} m/s² are left at {height}");
    let (rest, moved) = (sim.nodes(NodeField::RestPosition), sim.nodes(NodeField::Displacement));
    let end = |z: f64| Vec3::new(16.0, 0.0, z) * CELL_M;
    [0.0, 8.0].map(|z| moved[rest.iter().position(|p| (p - end(z)).norm() < 1e-9).unwrap()].z.abs())
}

#[test]
fn arms_of_a_beam_bend_the_same_wherever_in_a_cell_it_is_cut() {
    // Past a layer of nodes and the middle of a cell, in steps of a hundredth of a cell or less there, and longer ones between.
    let heights = [2.98, 2.99, 2.999, 3.0, 3.001, 3.01, 3.02, 3.1, 3.2, 3.3, 3.4, 3.49, 3.5, 3.51, 3.6];
    for method in METHODS {
        check_continuity(&heights, heights.map(|height| bent(method, height)));
    }
}

fn check_continuity(heights: &[f64], all: [[f64; 2]; 15]) {
    for (pair, height) in all.windows(2).zip(heights.windows(2)) {
        for arm in 0..2 {
            let change = (pair[1][arm] / pair[0][arm] - 1.0) / ((height[1] - height[0]) / 0.01).max(1.0);
            assert!(change.abs() < JUMP, "arm {arm} between {height:?} by {change}");
        }
    }
}

#[test]
fn what_cannot_be_cut_says_why_and_nothing_is_lost() {
    let model = beam([6, 3, 4], false);
    let mut sim = simulation(&model, Method::Lattice, Vec3::zeros());
    let good = [Vec3::zeros(), Vec3::x()];
    for bad in [
        &[][..],
        &[Vec3::zeros()],
        &[Vec3::zeros(), Vec3::repeat(f64::NAN)],
        &[Vec3::zeros(), Vec3::repeat(1e9)],
    ] {
        assert!(matches!(sim.cut(bad, bad), Err(Error::Argument(_))));
        assert!(matches!(sim.cut(&good, bad), Err(Error::Argument(_))));
    }
    // Blades without length or way cut nothing, and so does one that cuts what is cut.
    assert_eq!(sim.cut(&[Vec3::zeros(); 2], &[Vec3::repeat(0.1); 2]).unwrap(), 0);
    assert_eq!(slit(&mut sim, 3.0, 3.0, 1.5), 0);
    assert_eq!(slit(&mut sim, 9.0, -1.0, 1.5), 18);
    assert_eq!(slit(&mut sim, -1.0, 9.0, 1.5), 0);
    assert_eq!(sim.parts().len(), 2);

    let desc = SimDesc { cut_nodes: 0, method: Method::Efg(EfgDesc::default()), ..SimDesc::default() };
    assert!(matches!(Sim::new(model.clone(), &desc).unwrap().cut(&good, &good), Err(Error::State(_))));
    let desc = SimDesc { cut_nodes: 1, method: Method::Efg(EfgDesc::default()), ..SimDesc::default() };
    let mut small = Sim::new(beam([30, 3, 4], false), &desc).unwrap();
    assert!(matches!(
        small.cut(
            &good.map(|p| p - Vec3::new(0.5, 0.01, -3e-3)),
            &good.map(|p| p + Vec3::new(-0.5, 0.1, 3e-3))
        ),
        Err(Error::Limit(_))
    ));
    assert_eq!(small.parts().len(), 1);
    small.step().unwrap();
}

#[test]
fn a_reset_makes_tissue_whole_again() {
    for method in METHODS {
        let model = beam([8, 3, 4], true);
        let press = |sim: &mut Sim| {
            (0..20).for_each(|_| sim.step().unwrap());
            sim.nodes(NodeField::Displacement)
        };
        let mut whole = simulation(&model, method, -9.81 * Vec3::z());
        let expected = press(&mut whole);
        let mut cut = simulation(&model, method, -9.81 * Vec3::z());
        slit(&mut cut, 12.0, -1.0, 1.7);
        slit(&mut cut, 5.0, 3.0, 2.3);
        assert_eq!(cut.parts().len(), 2);
        assert_ne!(press(&mut cut), expected);
        cut.reset();
        assert_eq!(cut.parts().len(), 1);
        let largest = expected.iter().map(Vec3::norm).fold(0.0, f64::max);
        let off = press(&mut cut).iter().zip(&expected).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(off < EXACT * largest, "{off} of {largest}");
    }
}

#[test]
fn cells_with_rows_of_their_own_are_cut_as_others_are() {
    let model = beam([8, 3, 4], true);
    let moved = [Rows::Irregular, Rows::All].map(|rows| {
        let Method::Efg(desc) = METHODS[1] else { unreachable!("the second is the meshless model") };
        let mut sim = simulation(&model, Method::Efg(EfgDesc { rows, ..desc }), -9.81 * Vec3::z());
        for step in 0..20 {
            // On and on, while it falls.
            slit(&mut sim, 12.0 - 0.5 * f64::from(step), 11.5 - 0.5 * f64::from(step), 1.7);
            sim.step().unwrap();
        }
        sim.nodes(NodeField::Displacement)
    });
    let largest = moved[0].iter().map(Vec3::norm).fold(0.0, f64::max);
    for (a, b) in moved[0].iter().zip(&moved[1]) {
        assert!((a - b).norm() < 1e-7 * largest);
    }
}

#[test]
fn copies_of_nodes_are_held_freed_and_weighed_as_what_they_are_copies_of() {
    for method in METHODS {
        let model = beam([8, 3, 4], false);
        let mut sim = simulation(&model, method, -9.81 * Vec3::z());
        slit(&mut sim, 12.0, -1.0, 1.7);
        // Held at x = 0, both parts hang on; twice as heavy and as stiff, they fall as before.
        let fix =
            Fix { pose: Pose::identity(), half_extents: Vec3::new(0.1 * CELL_M, 1.0, 1.0), axes: [true; 3] };
        assert_eq!(sim.fix(&fix).unwrap(), 20);
        assert!(sim.parts().iter().all(|part| part.is_held));
        (0..20).for_each(|_| sim.step().unwrap());
        let momentum =
            |sim: &Sim| sim.parts().iter().map(|part| part.velocity_m_s * part.mass_kg).sum::<Vec3>();
        sim.free(&fix).unwrap();
        sim.set_material(1, &Material::new("heavy", 1e4, 0.4, 2.0 * DENSITY_KG_M3).unwrap()).unwrap();
        let mass: f64 = sim.parts().iter().map(|part| part.mass_kg).sum();
        assert!((mass / (96.0 * CELL_M.powi(3) * 2.0 * DENSITY_KG_M3) - 1.0).abs() < EXACT);
        let before = momentum(&sim);
        sim.step().unwrap();
        let gained = (momentum(&sim) - before) / mass;
        assert!((gained - Vec3::z() * -9.81e-3).norm() < 1e-8, "{gained:?}");
    }
}
