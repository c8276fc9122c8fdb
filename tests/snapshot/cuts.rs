//! Cuts, replayed and restored.

use palpate::math::Quat;
use palpate::solver::blade::Blade;

use super::*;

/// A block that hangs by its top.
fn hanging() -> Arc<Model> {
    let cells = [9, 5, 6];
    let frame = Pose::translation(0.5 * CELL_M, 0.5 * CELL_M, 0.5 * CELL_M);
    let labels = vec![1; cells.iter().product()];
    let mut build = Build::new(LabelGrid::new(cells, Vec3::repeat(CELL_M), frame, labels).unwrap());
    build.uses = BTreeMap::from([(1, LabelUse::Tissue(Material::new("tissue", 4e3, 0.45, 1000.0).unwrap()))]);
    build.fixes.push(Fix { pose: Pose::translation(0.0, 0.0, 6.0 * CELL_M), ..lowest() });
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// A blade that resists.
fn blade() -> [ToolDesc; 1] {
    [ToolDesc::blade(Blade { edge: vec![-Vec3::y(), Vec3::y()], toughness_j_m2: 2.0 })]
}

/// The blade comes in from the side, swaying and turning; by hand another cut goes up from below, on and on.
fn cut(rig: &mut Rig, step: u32) {
    let t = f64::from(step);
    let at = Vec3::new(9.6 - 0.17 * t, 2.5, 2.4 + 0.3 * (0.2 * t).sin()) * CELL_M;
    let turn = Quat::from_scaled_axis(Vec3::new(0.2, 0.0, 0.01 * t));
    rig.tools[0].set_motion(&ToolMotion::at(Pose::from_parts(at.into(), turn))).unwrap();
    if (4..20).contains(&step) {
        let edge = |t: f64| [-1.0, 6.0].map(|y| Vec3::new(2.6, y, -1.0 + 0.2 * t) * CELL_M);
        rig.sim.cut(&edge(t), &edge(t + 1.0)).unwrap();
    }
}

const STEPS: u32 = 44;

#[test]
fn a_recorded_cut_replays_to_the_same_bits_with_any_number_of_threads_and_from_any_snapshot() {
    let model = hanging();
    for case in cases() {
        let fresh = |threads| Rig::new(&model, &desc(case, threads), &blade());
        let mut first = fresh(1);
        let mut snapshots = Vec::new();
        let record = (0..STEPS).flat_map(|step| {
            if [0, 13, 30].contains(&step) {
                snapshots.push((step, first.sim.snapshot().unwrap()));
            }
            first.run(step..step + 1, cut)
        });
        let record: Vec<u64> = record.collect();
        let now = first.sim.statistics();
        assert!(now.divided_cells > 30 && now.copies > 60, "{case:?}: {now:?}");

        assert!(fresh(3).run(0..STEPS, cut) == record, "{case:?}, other threads");
        // Last, in a simulation that was cut further, and in one that never was.
        for (step, snapshot) in &snapshots {
            for mut rig in [fresh(2), std::mem::replace(&mut first, fresh(1))] {
                rig.sim.restore(snapshot).unwrap();
                assert!(rig.run(*step..STEPS, cut) == record[*step as usize..], "{case:?}, from step {step}");
                first = rig;
            }
        }
    }
}

#[test]
fn a_restore_heals_what_was_cut_since_and_cuts_again_what_was_healed() {
    let model = hanging();
    for case in cases() {
        let mut rig = Rig::new(&model, &desc(case, 1), &blade());
        rig.run(0..2, cut);
        let whole = rig.sim.snapshot().unwrap();
        rig.run(2..STEPS, cut);
        let (divided, at_last) = (rig.sim.snapshot().unwrap(), rig.sim.statistics());
        let surface = |rig: &mut Rig| {
            let frame = rig.surface.map().unwrap();
            let mut hash = Hash(DefaultHasher::new());
            hash.surface(&frame);
            (hash.0.finish(), frame.topology_version, frame.triangles.len() - frame.first_wall)
        };
        let (open, version, walls) = surface(&mut rig);
        assert!(walls > 0);

        rig.sim.restore(&whole).unwrap();
        let (closed, newer, walls) = surface(&mut rig);
        assert!(newer > version && walls == 0 && closed != open, "{case:?}");
        assert_eq!((rig.sim.parts().len(), rig.sim.statistics().copies), (1, 0));

        rig.sim.reset();
        let (_, version, _) = surface(&mut rig);
        rig.sim.restore(&divided).unwrap();
        let (again, newer, _) = surface(&mut rig);
        assert!(newer > version && again == open, "{case:?}");
        let now = rig.sim.statistics();
        assert_eq!((now.divided_cells, now.copies), (at_last.divided_cells, at_last.copies));
    }
}

#[test]
fn what_was_removed_is_gone_after_a_restore_and_what_was_removed_since_is_back() {
    use palpate::solver::tool::Shape;
    let model = hanging();
    let remove = |rig: &mut Rig, x: f64| {
        let pose = Pose::translation(x * CELL_M, 2.5 * CELL_M, 2.0 * CELL_M);
        assert!(rig.sim.ablate(&Shape::Sphere { radius_m: 1.4 * CELL_M }, &pose).unwrap().volume_m3 > 0.0);
    };
    for case in cases() {
        let fresh = || Rig::new(&model, &desc(case, 1), &blade());
        let mut first = fresh();
        first.run(0..6, cut);
        remove(&mut first, 5.0);
        first.run(6..10, cut);
        let (snapshot, gone) = (first.sim.snapshot().unwrap(), first.sim.statistics().removed_kg);
        let record = first.run(10..24, cut);
        remove(&mut first, 2.0);
        assert!(gone > 0.0 && first.sim.statistics().removed_kg > gone);
        for mut rig in [first, fresh()] {
            rig.sim.restore(&snapshot).unwrap();
            assert_eq!(rig.sim.statistics().removed_kg, gone);
            assert!(rig.run(10..24, cut) == record, "{case:?}");
        }
    }
}
