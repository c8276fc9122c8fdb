//! Tools that hold tissue.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::error::Error;
use palpate::math::{Pose, Quat, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::sim::{NodeField, Precision, Sim, SimDesc, ToolPort};
use palpate::solver::tool::{ToolDesc, ToolMotion};

const CELL_M: f64 = 4e-3;
/// Where the tool stands: in the middle of the block's top.
const PLACE: Vec3 = Vec3::new(3.5 * CELL_M, 3.5 * CELL_M, 6.5 * CELL_M);
const RADIUS_M: f64 = 5e-3;

/// A block of 8 × 8 × 6 cells, its top at 5.5 cells; held below where asked.
fn block(is_held: bool) -> Arc<Model> {
    let mut build =
        Build::new(LabelGrid::new([8, 8, 6], Vec3::repeat(CELL_M), Pose::identity(), vec![1; 384]).unwrap());
    build.uses = BTreeMap::from([(1, LabelUse::Tissue(Material::new("tissue", 4e3, 0.45, 1000.0).unwrap()))]);
    if is_held {
        let lowest = Pose::translation(0.0, 0.0, -0.5 * CELL_M);
        build.fixes.push(Fix {
            pose: lowest,
            half_extents: Vec3::new(1.0, 1.0, 0.1 * CELL_M),
            axes: [true; 3],
        });
    }
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

fn simulation(model: &Arc<Model>) -> Sim {
    let desc = SimDesc { precision: Precision::Double, threads: 1, drag_per_s: 0.0, ..SimDesc::default() };
    Sim::new(model.clone(), &desc).unwrap()
}

/// A ball that stands above the block, touches nothing, and holds what is near.
fn holding(sim: &mut Sim) -> (ToolPort, usize) {
    let mut tool = sim.add_tool(&ToolDesc::sphere(RADIUS_M)).unwrap();
    tool.set_motion(&ToolMotion::at(Pose::translation(PLACE.x, PLACE.y, PLACE.z + RADIUS_M))).unwrap();
    sim.step().unwrap();
    let count = sim.grasp(tool.id(), 1.6 * CELL_M).unwrap();
    (tool, count)
}

fn move_to(tool: &mut ToolPort, by: Vec3, turn: f64) {
    let at = PLACE + Vec3::z() * RADIUS_M + by;
    let pose = Pose::from_parts(at.into(), Quat::from_scaled_axis(Vec3::z() * turn));
    tool.set_motion(&ToolMotion::at(pose)).unwrap();
}

#[test]
fn what_a_tool_holds_goes_where_it_goes_and_pulls() {
    let mut sim = simulation(&block(true));
    let (mut tool, count) = holding(&mut sim);
    let rest = sim.nodes(NodeField::RestPosition);
    let before = sim.nodes(NodeField::Displacement);
    let origin = PLACE + Vec3::z() * RADIUS_M;
    for step in 1..=60 {
        let t = f64::from(step) / 60.0;
        move_to(&mut tool, Vec3::new(0.5e-3, 0.0, 2e-3) * t, 0.2 * t);
        sim.step().unwrap();
    }
    let pose = Pose::from_parts(
        (origin + Vec3::new(0.5e-3, 0.0, 2e-3)).into(),
        Quat::from_scaled_axis(Vec3::z() * 0.2),
    );
    let after = sim.nodes(NodeField::Displacement);
    let carried = (0..rest.len()).filter(|&i| {
        let arm = rest[i] + before[i] - origin;
        let goal = pose.transform_point(&arm.into()).coords;
        (rest[i] + after[i] - goal).norm() < 1e-12
    });
    assert_eq!(carried.count(), count);
    assert!(count > 4, "{count}");
    let felt = tool.force().wrench;
    assert!(felt.force_n.z < -0.01 && felt.force_n.x < 0.0, "drawn back: {felt:?}");
    assert!(felt.torque_n_m.z < 0.0, "and turned back: {felt:?}");
}

#[test]
fn a_tool_that_carries_a_free_body_gives_it_all_its_momentum() {
    let model = block(false);
    let mut sim = simulation(&model);
    let (mut tool, _) = holding(&mut sim);
    let laws = model.laws();
    let masses: Vec<f64> = model
        .lattice()
        .slots()
        .map(|s| model.lattice().node_mass(s, |m| laws[usize::from(m)].corner_kg))
        .collect();
    let momentum =
        |sim: &Sim| -> Vec3 { sim.nodes(NodeField::Velocity).iter().zip(&masses).map(|(v, m)| v * *m).sum() };
    let (start, mut given) = (momentum(&sim), Vec3::zeros());
    for step in 1..=80 {
        let t = f64::from(step) / 80.0;
        move_to(&mut tool, Vec3::new(4e-3, -2e-3, 6e-3) * t * t, 0.1 * t);
        sim.step().unwrap();
        given -= tool.force().wrench.force_n * 1e-3;
    }
    let gained = momentum(&sim) - start;
    assert!(gained.norm() > 1e-4, "{gained}");
    assert!((gained - given).norm() < 1e-9 * gained.norm(), "{gained} gained, {given} given");
}

#[test]
fn tissue_that_is_let_go_springs_back() {
    let model = block(true);
    for leaves in [false, true] {
        let mut sim = simulation(&model);
        let (mut tool, count) = holding(&mut sim);
        for step in 1..=40 {
            move_to(&mut tool, Vec3::z() * 5e-5 * f64::from(step), 0.0);
            sim.step().unwrap();
        }
        let pulled = sim.energy().elastic_j;
        assert!(pulled > 1e-6, "{pulled}");
        let id = tool.id();
        if leaves {
            tool.leave();
            sim.step().unwrap();
            assert!(sim.release(id).is_err(), "it is gone");
        } else {
            assert_eq!(sim.release(id).unwrap(), count);
            assert_eq!(sim.release(id).unwrap(), 0);
            sim.step().unwrap();
            assert!(tool.force().wrench.force_n.norm() == 0.0);
        }
        sim.settle(0.05, 200_000).unwrap();
        assert!(sim.energy().elastic_j < 1e-4 * pulled, "{} of {pulled} J", sim.energy().elastic_j);
    }
}

#[test]
fn what_cannot_be_grasped_is_refused() {
    let mut sim = simulation(&block(true));
    let mut tool = sim.add_tool(&ToolDesc::sphere(RADIUS_M)).unwrap();
    assert!(matches!(sim.grasp(tool.id(), 1e-3), Err(Error::State(_))), "it stands nowhere");
    tool.set_motion(&ToolMotion::at(Pose::translation(0.0, 0.0, 0.5))).unwrap();
    sim.step().unwrap();
    assert_eq!(sim.grasp(tool.id(), 1e-3).unwrap(), 0, "nothing is near");
    for reach in [f64::NAN, -1.0, f64::INFINITY] {
        assert!(matches!(sim.grasp(tool.id(), reach), Err(Error::Argument(_))), "{reach}");
    }
    // What the model holds stays held by it alone.
    let mut tool = sim.add_tool(&ToolDesc::sphere(RADIUS_M)).unwrap();
    tool.set_motion(&ToolMotion::at(Pose::translation(0.0, 0.0, -0.5 * CELL_M - RADIUS_M))).unwrap();
    sim.step().unwrap();
    assert_eq!(sim.grasp(tool.id(), 0.5 * CELL_M).unwrap(), 0);
}
