//! What cannot be simulated is refused or noticed, and nothing is lost.

use std::sync::Arc;

use palpate::error::Error;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, LabelUse};
use palpate::sim::{NodeField, Sim, SimDesc};
use palpate::solver::load::Load;
use palpate::solver::tool::{ToolDesc, ToolMotion};

const H: f64 = 2e-3;

/// Two separate bars along z in one grid: first one of tissue 1, which lies first in memory, then one of tissue 2.
fn two_bars(first: f64, second: f64) -> Build {
    let dims = [4, 4, 40];
    let label = |i: usize| match i / 16 {
        0..16 => 1,
        24.. => 2,
        _ => 0,
    };
    let labels = (0..dims.iter().product()).map(label).collect();
    let grid = LabelGrid::new(dims, Vec3::repeat(H), Pose::identity(), labels).unwrap();
    let mut build = Build::new(grid);
    build.uses.insert(0, LabelUse::Empty);
    for (label, young) in [(1, first), (2, second)] {
        build.uses.insert(label, LabelUse::Tissue(Material::new("bar", young, 0.45, 1000.0).unwrap()));
    }
    build
}

/// A simulation whose first bar is far beyond its stable step, and whose second is far below.
fn half_unstable() -> Sim {
    let model = Arc::new(two_bars(1e6, 1e2).run(&mut |_, _| true).unwrap());
    let desc = SimDesc { substeps: Some(10), sleeping: false, threads: 1, ..SimDesc::default() };
    let mut sim = Sim::new(model.clone(), &desc).unwrap();
    let slot = model.lattice().slots().next().unwrap();
    sim.set_node(slot, Vec3::x() * 1e-6, Vec3::zeros()).unwrap();
    sim
}

#[test]
fn one_body_that_diverges_is_noticed_beside_one_that_does_not() {
    let mut sim = half_unstable();
    let mut tool = sim.add_tool(&ToolDesc::sphere(0.01)).unwrap();
    tool.set_motion(&ToolMotion::at(Pose::translation(1.0, 0.0, 0.0))).unwrap();
    let failed = (0..1000).find_map(|_| sim.step().err());
    assert!(matches!(failed, Some(Error::Diverged { .. })), "{failed:?}");
    assert!(!tool.is_live() && tool.is_running());
    assert!(tool.force().wrench.force_n == Vec3::zeros());
    for field in [NodeField::Displacement, NodeField::Velocity] {
        assert!(sim.nodes(field).iter().all(|v| v.iter().all(|x| x.is_finite())));
    }

    // It stays frozen until it is reset, and is then at rest.
    assert!(matches!(sim.step(), Err(Error::Diverged { .. })));
    sim.reset();
    assert!(tool.is_live());
    sim.step().unwrap();
    assert!(sim.nodes(NodeField::Displacement).iter().all(|u| *u == Vec3::zeros()));
}

#[test]
fn numbers_without_bounds_are_refused() {
    let model = Arc::new(two_bars(1e3, 1e3).run(&mut |_, _| true).unwrap());
    let mut sim = Sim::new(model, &SimDesc::default()).unwrap();
    let inside = Vec3::repeat(3.0 * H);
    let argument = |e: Result<_, Error>| assert!(matches!(e, Err(Error::Argument(_))), "{e:?}");
    argument(sim.add_load(&Load::Point { at_m: inside, force_n: Vec3::x() * 1e300 }).map(|_| ()));
    argument(sim.add_load(&Load::Point { at_m: Vec3::repeat(-2.0 * H), force_n: Vec3::x() }).map(|_| ()));
    assert!(sim.add_load(&Load::Point { at_m: inside, force_n: Vec3::x() * 1e-3 }).is_ok());
    let mut tool = sim.add_tool(&ToolDesc::sphere(0.01)).unwrap();
    argument(tool.set_motion(&ToolMotion::at(Pose::translation(1e300, 0.0, 0.0))));
    argument(sim.settle(1.0, 0).map(|_| ()));
}

#[test]
fn cells_without_number_are_refused_before_memory_is_taken() {
    let labels = vec![1; 1000];
    let grid = LabelGrid::new([10, 10, 10], Vec3::repeat(0.1), Pose::identity(), labels).unwrap();
    let mut build = Build::new(grid);
    build.uses.insert(1, LabelUse::Tissue(Material::new("block", 1e3, 0.45, 1000.0).unwrap()));
    build.cell_m = Some(1e-3);
    assert!(matches!(build.run(&mut |_, _| true), Err(Error::Limit(_))));
}
