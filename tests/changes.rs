//! What is changed while a simulation runs: materials, and what is held.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::error::Error;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::sim::{NodeField, Precision, Sim, SimDesc};
use palpate::solver::tool::{ToolDesc, ToolMotion};

const CELL_M: f64 = 4e-3;
const CELLS: [usize; 3] = [12, 10, 8];

fn tissue(young_pa: f64, poisson: f64, density: f64, damping_s: f64) -> Material {
    let mut material = Material::new("tissue", young_pa, poisson, density).unwrap();
    material.damping_s = damping_s;
    material
}

/// The lowest layer of nodes, the highest, or those of one half.
fn layer(low: f64, high: f64) -> Fix {
    let middle = 0.5 * (low + high);
    Fix {
        pose: Pose::translation(0.0, 0.0, (middle - 0.5) * CELL_M),
        half_extents: Vec3::new(1.0, 1.0, 0.5 * (high - low) * CELL_M),
        axes: [true; 3],
    }
}

/// A block of two materials with a rigid corner.
fn model(first: &Material, second: &Material, fixes: &[Fix]) -> Arc<Model> {
    let label = |i: usize| if i == 0 { 3 } else { 1 + u16::from(i % CELLS[0] > 6) };
    let labels = (0..CELLS.iter().product()).map(label).collect();
    let mut build =
        Build::new(LabelGrid::new(CELLS, Vec3::repeat(CELL_M), Pose::identity(), labels).unwrap());
    build.uses = BTreeMap::from([
        (1, LabelUse::Tissue(first.clone())),
        (2, LabelUse::Tissue(second.clone())),
        (3, LabelUse::Rigid(tissue(1e9, 0.3, 1900.0, 0.0))),
    ]);
    build.fixes = fixes.to_vec();
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

fn simulation(model: &Arc<Model>) -> Sim {
    let desc = SimDesc { precision: Precision::Double, threads: 1, substeps: Some(20), ..SimDesc::default() };
    Sim::new(model.clone(), &desc).unwrap()
}

/// Displacements after a press.
fn pressed(sim: &mut Sim) -> Vec<Vec3> {
    let mut tool = sim.add_tool(&ToolDesc { friction: 0.2, ..ToolDesc::sphere(0.01) }).unwrap();
    for step in 0..60 {
        let z = 7.5 * CELL_M + 0.01 - 1e-4 * f64::from(step);
        tool.set_motion(&ToolMotion::at(Pose::translation(6.0 * CELL_M, 4.5 * CELL_M, z))).unwrap();
        sim.step().unwrap();
    }
    assert!(tool.force().wrench.force_n.norm() > 0.0);
    sim.nodes(NodeField::Displacement)
}

#[test]
fn a_changed_material_is_as_if_the_model_had_been_built_with_it() {
    let plain = tissue(4e3, 0.25, 1000.0, 0.0);
    // Stiffer, heavier, with a volume term, damped: each asks for other arithmetic.
    for changed in [
        tissue(9e3, 0.25, 1000.0, 0.0),
        tissue(4e3, 0.25, 1500.0, 0.0),
        tissue(4e3, 0.45, 1000.0, 0.0),
        tissue(4e3, 0.45, 1000.0, 1e-3),
    ] {
        let held = [layer(0.0, 0.0)];
        let mut sim = simulation(&model(&plain, &plain, &held));
        // Both labels share one material, the rigid one is the second.
        sim.set_material(1, &changed).unwrap();
        let mut built = simulation(&model(&changed, &changed, &held));
        assert_eq!(pressed(&mut sim), pressed(&mut built), "{changed:?}");
        // And back.
        sim.reset();
        sim.set_material(1, &plain).unwrap();
        let back = sim.energy();
        assert_eq!((back.kinetic_j, back.elastic_j), (0.0, 0.0));
    }
}

#[test]
fn nodes_that_are_fixed_or_freed_are_as_if_the_model_had_been_built_so() {
    let (soft, stiff) = (tissue(4e3, 0.4, 1000.0, 0.0), tissue(8e3, 0.45, 1000.0, 0.0));
    let (low, more) = (layer(0.0, 0.0), layer(0.0, 2.0));
    let once = std::slice::from_ref(&low);
    let mut fixed = simulation(&model(&soft, &stiff, once));
    assert!(fixed.fix(&more).unwrap() > 0);
    assert_eq!(fixed.fix(&more).unwrap(), 0, "held already");
    let built = pressed(&mut simulation(&model(&soft, &stiff, &[low.clone(), more.clone()])));
    assert_eq!(pressed(&mut fixed), built);

    let mut freed = simulation(&model(&soft, &stiff, &[low.clone(), more.clone()]));
    let upper = layer(1.0, 2.0);
    assert!(freed.free(&upper).unwrap() > 0);
    let built = pressed(&mut simulation(&model(&soft, &stiff, once)));
    assert_eq!(pressed(&mut freed), built);
}

#[test]
fn what_is_fixed_stays_where_it_is() {
    let soft = tissue(4e3, 0.4, 1000.0, 0.0);
    let mut sim = simulation(&model(&soft, &soft, &[layer(0.0, 0.0)]));
    let before = pressed(&mut sim);
    let top = layer(8.0, 8.0);
    let count = sim.fix(&top).unwrap();
    for _ in 0..50 {
        sim.step().unwrap();
    }
    let (rest, after) = (sim.nodes(NodeField::RestPosition), sim.nodes(NodeField::Displacement));
    let held: Vec<_> = (0..rest.len()).filter(|&i| (rest[i].z - 7.5 * CELL_M).abs() < 1e-9).collect();
    assert_eq!(held.len(), count);
    assert!(held.iter().all(|&i| before[i] == after[i]) && before.iter().any(|u| u.norm() > 1e-3));
    assert!(before != after, "the rest goes on");
}

#[test]
fn the_stable_step_after_a_change_is_one_that_is_stable() {
    let (soft, heavy) = (tissue(4e3, 0.4, 1000.0, 0.0), tissue(4e3, 0.4, 2000.0, 0.0));
    let held = [layer(0.0, 3.0)];
    for (changed, is_freed) in [
        (tissue(16e3, 0.4, 1000.0, 0.0), false),
        (tissue(16e3, 0.49, 500.0, 0.0), false),
        (tissue(1e3, 0.25, 1000.0, 1e-3), false),
        (heavy.clone(), true),
    ] {
        let mut sim = simulation(&model(&soft, &soft, &held));
        sim.set_material(1, &changed).unwrap();
        let mut fixes = held.to_vec();
        if is_freed {
            sim.free(&held[0]).unwrap();
            fixes.clear();
        }
        let asked = sim.statistics().stable_substep_s;
        let found = simulation(&model(&changed, &changed, &fixes)).statistics().stable_substep_s;
        // Never longer than what is found by looking, and no shorter than the worst of cells would ask for, softened by damping.
        assert!(asked <= found * 1.001 && asked > 0.4 * found, "{asked} for {found} s: {changed:?}");
    }
}

#[test]
fn what_cannot_be_changed_is_refused_and_nothing_changes() {
    let soft = tissue(4e3, 0.4, 1000.0, 0.0);
    let mut sim = simulation(&model(&soft, &soft, &[layer(0.0, 0.0)]));
    let before = sim.statistics().stable_substep_s;
    for index in [0, 2, 3, 15, 255] {
        assert!(matches!(sim.set_material(index, &soft), Err(Error::Argument(_))), "{index}");
    }
    let absurd = Material { young_pa: -1.0, ..soft.clone() };
    assert!(matches!(sim.set_material(1, &absurd), Err(Error::Argument(_))));
    let nowhere = Fix { pose: Pose::translation(9.0, 0.0, 0.0), ..layer(0.0, 0.0) };
    assert!(matches!(sim.fix(&nowhere), Err(Error::Argument(_))));
    let nothing = Fix { axes: [false; 3], ..layer(0.0, 0.0) };
    assert!(matches!(sim.free(&nothing), Err(Error::Argument(_))));
    assert_eq!(sim.statistics().stable_substep_s, before);
    // Nodes of the rigid corner are not freed.
    let all = layer(0.0, 9.0);
    let freed = sim.free(&all).unwrap();
    let corner = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]].len();
    assert_eq!(freed, (CELLS[0] + 1) * (CELLS[1] + 1) - corner);
}

#[test]
fn tissue_that_was_made_stiff_still_falls_asleep() {
    // So stiff that single precision's rounding alone accelerates nodes by more than soft tissue may in its sleep.
    let (soft, stiff) = (tissue(4e3, 0.3, 1000.0, 0.0), tissue(4e6, 0.3, 1000.0, 0.0));
    let desc = SimDesc { threads: 1, drag_per_s: 200.0, ..SimDesc::default() };
    let mut sim = Sim::new(model(&soft, &soft, &[layer(0.0, 0.0)]), &desc).unwrap();
    sim.set_material(1, &stiff).unwrap();
    for slot in sim.model().lattice().slots().collect::<Vec<_>>() {
        let at = sim.model().lattice().rest_position(slot);
        sim.set_node(slot, Vec3::x() * (at.z * 0.05), Vec3::zeros()).unwrap();
    }
    for _ in 0..300 {
        sim.step().unwrap();
    }
    assert_eq!(sim.statistics().awake_nodes, 0);
}
