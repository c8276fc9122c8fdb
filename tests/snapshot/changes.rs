//! What the owner has changed since a snapshot.

use palpate::error::Error;
use palpate::solver::load::{Load, Region};

use super::*;

/// A block that is pushed at its side.
fn pushed(rig: &mut Rig, step: u32) {
    rig.put(0, Vec3::new(4.0, 3.5, 8.0 - 0.03 * f64::from(step)));
}

#[test]
fn materials_loads_gravity_and_what_is_held_become_what_they_were() {
    let model = model();
    let half = Fix { half_extents: Vec3::new(6.2 * CELL_M, 1.0, 0.1 * CELL_M), ..lowest() };
    let stiff = Material { damping_s: 2e-4, ..Material::new("stiff", 2e4, 0.4, 1500.0).unwrap() };
    let load = |force| Load::Traction {
        region: Region {
            pose: Pose::translation(12.0 * CELL_M, 0.0, 0.0),
            half_extents_m: Vec3::new(0.1 * CELL_M, 1.0, 1.0),
        },
        traction_pa: Vec3::new(0.0, 0.0, force),
    };
    for case in cases() {
        let mut rig = Rig::new(&model, &desc(case, 1), &balls()[..1]);
        // What the model did not have at first is kept as well.
        rig.sim.set_material(1, &stiff).unwrap();
        rig.sim.free(&half).unwrap();
        rig.sim.set_gravity(Vec3::new(1.0, 0.0, -5.0)).unwrap();
        let kept = rig.sim.add_load(&load(20.0)).unwrap();
        rig.run(0..20, pushed);
        let snapshot = rig.sim.snapshot().unwrap();
        let then = rig.run(20..35, pushed);

        rig.sim.set_material(1, &Material::new("soft", 2e3, 0.3, 900.0).unwrap()).unwrap();
        rig.sim.set_material(3, &stiff).unwrap();
        rig.sim.fix(&half).unwrap();
        rig.sim.set_gravity(Vec3::zeros()).unwrap();
        rig.sim.remove_load(kept).unwrap();
        let later = rig.sim.add_load(&load(-300.0)).unwrap();
        rig.run(35..40, pushed);

        rig.sim.restore(&snapshot).unwrap();
        assert!(rig.run(20..35, pushed) == then, "{case:?}");
        // Ids are those of then, and none is given twice.
        assert!(matches!(rig.sim.remove_load(later), Err(Error::Argument(_))));
        rig.sim.remove_load(kept).unwrap();
        let newest = rig.sim.add_load(&load(1.0)).unwrap();
        assert!(newest != kept && newest != later);
    }
}

#[test]
fn a_simulation_that_is_restored_without_its_changes_is_the_models() {
    let model = model();
    for case in cases() {
        let mut rig = Rig::new(&model, &desc(case, 1), &balls()[..1]);
        let snapshot = rig.sim.snapshot().unwrap();
        let then = rig.run(0..20, pushed);
        rig.sim.set_material(3, &Material::new("other", 1e4, 0.45, 1100.0).unwrap()).unwrap();
        rig.sim.free(&lowest()).unwrap();
        rig.run(20..30, pushed);
        rig.sim.restore(&snapshot).unwrap();
        let mut fresh = Rig::new(&model, &desc(case, 1), &balls()[..1]);
        // A tool that was nowhere appears where it is put first.
        assert!(rig.run(0..20, pushed) == then && fresh.run(0..20, pushed) == then, "{case:?}");
    }
}
