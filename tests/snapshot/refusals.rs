//! Snapshots that a simulation cannot take up.

use palpate::error::Error;

use super::*;

#[test]
fn a_snapshot_of_something_else_is_refused_and_nothing_changes() {
    let (model, case) = (model(), (Method::Lattice, Precision::Single));
    let own = desc(case, 1);
    let mut rig = Rig::new(&model, &own, &balls());
    rig.run(0..20, busy);
    let (seen, snapshot) = (rig.seen(), rig.sim.snapshot().unwrap());
    let efg = |tolerance| Method::Efg(EfgDesc { tolerance, ..EfgDesc::default() });
    for (other_model, other, what) in [
        (&self::model(), own.clone(), "model"),
        (&model, SimDesc { method: efg(1e-3), ..own.clone() }, "method"),
        (&model, SimDesc { precision: Precision::Double, ..own.clone() }, "precision"),
        (&model, SimDesc { cut_nodes: 3000, ..own.clone() }, "room for cuts"),
        (&model, SimDesc { cut_nodes: 5000, ..own.clone() }, "room for cuts"),
        (&model, SimDesc { step_s: 2e-3, ..own.clone() }, "length of a step"),
        (&model, SimDesc { substeps: Some(50), ..own.clone() }, "length of a step"),
        (&model, SimDesc { rest_under_gravity: true, ..own.clone() }, "rest shape"),
        (&model, SimDesc { drag_per_s: 1.0, ..own.clone() }, "drag"),
        (&model, SimDesc { sleeping: false, ..own.clone() }, "rule of sleep"),
    ] {
        let mut foreign = Rig::new(other_model, &other, &balls());
        for (to, from) in [(&mut rig.sim, &foreign.sim.snapshot().unwrap()), (&mut foreign.sim, &snapshot)] {
            let answer = to.restore(from).unwrap_err();
            let Error::Argument(why) = &answer else { panic!("{answer}") };
            assert!(why.ends_with(what), "{why}");
        }
        assert_eq!(rig.seen(), seen, "{what}");
    }
    let then = rig.run(20..30, busy);
    rig.sim.restore(&snapshot).unwrap();
    assert!(rig.run(20..30, busy) == then);
}

#[test]
fn a_simulation_that_has_failed_gives_no_snapshot_and_goes_on_from_one() {
    let model = model();
    for case in cases() {
        let mut rig = Rig::new(&model, &desc(case, 1), &balls());
        rig.run(0..20, busy);
        let snapshot = rig.sim.snapshot().unwrap();
        let then = rig.run(20..30, busy);
        let slot = model.lattice().slots().last().unwrap();
        rig.sim.set_node(slot, Vec3::zeros(), Vec3::repeat(1e6)).unwrap();
        assert!(matches!(rig.sim.step(), Err(Error::Diverged { .. })), "{case:?}");
        assert!(matches!(rig.sim.snapshot(), Err(Error::Diverged { .. })));
        assert!(rig.tools.iter().all(|tool| !tool.is_live()));

        rig.sim.restore(&snapshot).unwrap();
        assert!(rig.tools.iter().all(ToolPort::is_live));
        assert!(rig.run(20..30, busy) == then, "{case:?}");
    }
}
