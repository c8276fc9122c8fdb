//! Cuts to the end, all at once, and of what is cut already.

use palpate::error::Error;
use palpate::math::{Pose, Vec3};
use palpate::sim::{NodeField, Removed, Sim, SimDesc};
use palpate::solver::blade::Blade;
use palpate::solver::method::Method;
use palpate::solver::tool::{Shape, ToolDesc, ToolMotion};

use super::closed::there;
use super::{CELL_M, EXACT, METHODS, beam, simulation, slit};

/// Cuts every edge of a block: by planes across each axis, in the middle of every layer of cells.
fn cut_every_edge(sim: &mut Sim, cells: [usize; 3]) {
    for (axis, &count) in cells.iter().enumerate() {
        let [along, across] = [1, 2].map(|n| Vec3::ith((axis + n) % 3, 1.0));
        for layer in 0..count {
            let at = |way: f64, edge: f64| {
                (Vec3::ith(axis, layer as f64 + 0.5) + way * along + edge * across) * CELL_M
            };
            sim.cut(&[at(-1.0, -99.0), at(-1.0, 99.0)], &[at(9.0, -99.0), at(9.0, 99.0)]).unwrap();
        }
    }
}

/// Of the same block, with crumbs kept or removed.
fn cuttable(method: Method, least_part_cells: f64) -> Sim {
    let desc = SimDesc {
        method,
        threads: 2,
        gravity_m_s2: -9.81 * Vec3::z(),
        rest_under_gravity: false,
        cut_nodes: 10_000,
        least_part_cells,
        ..SimDesc::default()
    };
    Sim::new(beam([4, 3, 3], true), &desc).unwrap()
}

#[test]
fn tissue_can_be_cut_and_taken_away_until_nothing_is_left_and_the_simulation_goes_on() {
    for method in METHODS {
        for least_part_cells in [0.0, 1.0] {
            let mut sim = cuttable(method, least_part_cells);
            let mut surface = sim.open_surface(0).unwrap();
            let whole = sim.parts()[0];
            cut_every_edge(&mut sim, [4, 3, 3]);
            let (nodes, parts) = (sim.model().lattice().node_count(), sim.parts());
            // Each node with what is next to it; what is free and smaller than a cell is gone.
            assert!(if least_part_cells == 0.0 { parts.len() == nodes } else { parts.len() < nodes });
            assert_eq!(sim.statistics().divided_cells, 36);
            (0..5).for_each(|_| sim.step().unwrap());
            assert!(sim.nodes(NodeField::Displacement).iter().flatten().all(|x| x.is_finite()));
            let ids: Vec<u32> = sim.parts().iter().map(|part| part.id).collect();
            for &id in &ids {
                sim.remove_part(id).unwrap();
            }

            assert!(sim.parts().is_empty() && there(surface.map().unwrap().triangles).next().is_none());
            let gone = sim.statistics();
            assert!((gone.removed_kg / whole.mass_kg - 1.0).abs() < EXACT, "{}", gone.removed_kg);
            assert!((gone.removed_m3 / whole.volume_m3 - 1.0).abs() < EXACT && gone.node_count == 0);
            // Nothing is left to step, to cut, to touch or to remove.
            let before = sim.nodes(NodeField::Displacement);
            let mut tool = sim.add_tool(&ToolDesc::sphere(2.0 * CELL_M)).unwrap();
            for step in 0..10 {
                let z = (5.0 - 0.3 * f64::from(step)) * CELL_M;
                tool.set_motion(&ToolMotion::at(Pose::translation(2.0 * CELL_M, CELL_M, z))).unwrap();
                sim.step().unwrap();
                assert_eq!(tool.force().wrench.force_n, Vec3::zeros());
            }
            assert_eq!(sim.nodes(NodeField::Displacement), before);
            let energy = sim.energy();
            assert_eq!((energy.kinetic_j, energy.elastic_j), (0.0, 0.0));
            assert_eq!(slit(&mut sim, 9.0, -1.0, 1.3), 0);
            let ball = Shape::Sphere { radius_m: 2.0 * CELL_M };
            assert_eq!(sim.ablate(&ball, &Pose::identity()).unwrap(), Removed::default());
            assert!(matches!(sim.remove_part(ids[0]), Err(Error::Argument(_))));
            assert!(sim.pick(Vec3::new(CELL_M, CELL_M, 1.0), -Vec3::z()).unwrap().is_none());
            // And all is back.
            sim.remove_tool(tool.id()).unwrap();
            sim.reset();
            let again = sim.parts();
            assert!(again.len() == 1 && again[0].mass_kg == whole.mass_kg);
            sim.step().unwrap();
        }
    }
}

#[test]
fn a_blade_that_crosses_the_whole_body_within_a_step_cuts_it_through() {
    for method in METHODS {
        let model = beam([12, 3, 4], true);
        for toughness_j_m2 in [0.0, 5.0] {
            let mut sim = simulation(&model, method, Vec3::zeros());
            let edge = ToolDesc::blade(Blade { edge: vec![-Vec3::y(), Vec3::y()], toughness_j_m2 });
            let mut blade = sim.add_tool(&edge).unwrap();
            // Beside the body, on its other side, far away, and back along its middle.
            let mut parts = Vec::new();
            for (x, z) in [(20.0, 1.3), (-5.0, 1.3), (-5.0, 1e4), (-5.0, 2.6), (20.0, 2.6)] {
                let pose = Pose::translation(x * CELL_M, 0.0, z * CELL_M);
                blade.set_motion(&ToolMotion::at(pose)).unwrap();
                sim.step().unwrap();
                assert_eq!(blade.force().wrench.force_n, Vec3::zeros(), "it stood in no tissue");
                parts.push(sim.parts().len());
            }
            assert_eq!(parts, [1, 2, 2, 2, 3]);
            let mut volumes: Vec<f64> =
                sim.parts().iter().map(|part| part.volume_m3 / (36.0 * CELL_M.powi(3))).collect();
            volumes.sort_by(f64::total_cmp);
            for (volume, height) in volumes.iter().zip([1.3, 1.3, 1.4]) {
                assert!((volume - height).abs() < 1e-4, "{volumes:?}");
            }
            (0..5).for_each(|_| sim.step().unwrap());
        }
    }
}

#[test]
fn a_blade_that_goes_to_and_fro_in_its_own_cut_changes_nothing() {
    for method in METHODS {
        let model = beam([10, 3, 4], true);
        let mut sim = simulation(&model, method, Vec3::zeros());
        let mut surface = sim.open_surface(0).unwrap();
        let edge = ToolDesc::blade(Blade { edge: vec![-Vec3::y(), Vec3::y()], toughness_j_m2: 0.0 });
        let mut blade = sim.add_tool(&edge).unwrap();
        let mut go = |sim: &mut Sim, x: f64| {
            blade.set_motion(&ToolMotion::at(Pose::translation(x * CELL_M, 0.0, 1.7 * CELL_M))).unwrap();
            sim.step().unwrap();
        };
        (0..=30).for_each(|step| go(&mut sim, 11.0 - 0.25 * f64::from(step)));
        let state = |sim: &mut Sim, surface: &mut palpate::sim::SurfacePort| {
            let now = sim.statistics();
            let frame = surface.map().unwrap();
            (sim.parts(), now.divided_cells, now.copies, frame.topology_version, frame.triangles.to_vec())
        };
        let before = state(&mut sim, &mut surface);
        for turn in 0..4 {
            (0..20).for_each(|step| go(&mut sim, 3.5 + 0.25 * f64::from(step)));
            (0..20).for_each(|step| go(&mut sim, 8.25 - 0.25 * f64::from(step)));
            assert!(state(&mut sim, &mut surface) == before, "turn {turn}");
        }
        // By hand as well, also faster and from the other side.
        assert_eq!(slit(&mut sim, 3.5, 12.0, 1.7), 0);
        assert_eq!(slit(&mut sim, 12.0, 3.5, 1.7), 0);
        assert!(state(&mut sim, &mut surface) == before);
    }
}

#[test]
fn segments_without_length_and_ways_without_length_change_nothing() {
    let model = beam([10, 3, 4], true);
    for method in METHODS {
        let points = |x: f64| [[-1.0, 1.2], [1.4, 1.9], [4.0, 1.6]].map(|[y, z]| Vec3::new(x, y, z) * CELL_M);
        let doubled = |x: f64| points(x).into_iter().flat_map(|p| [p, p, p]).collect::<Vec<_>>();
        let [mut plain, mut other] = [(); 2].map(|()| simulation(&model, method, -9.81 * Vec3::z()));
        for sim in [&mut plain, &mut other] {
            (0..10).for_each(|_| sim.step().unwrap());
        }
        for step in 0..12 {
            let [from, to] = [0.0, 1.0].map(|end| 11.0 - 0.7 * (f64::from(step) + end));
            let cells = plain.cut(&points(from), &points(to)).unwrap();
            // A blade that is all in one point, and one that stays where it is.
            assert_eq!(other.cut(&[points(from)[1]; 4], &[points(to)[1]; 4]).unwrap(), 0);
            assert_eq!(other.cut(&points(to), &points(to)).unwrap(), 0);
            assert_eq!(other.cut(&doubled(from), &doubled(to)).unwrap(), cells);
        }
        for sim in [&mut plain, &mut other] {
            (0..10).for_each(|_| sim.step().unwrap());
        }
        assert!(plain.statistics().divided_cells > 10);
        assert_eq!(plain.parts(), other.parts());
        assert_eq!(plain.nodes(NodeField::Displacement), other.nodes(NodeField::Displacement));
    }
}

#[test]
fn a_cut_for_which_there_is_no_room_changes_nothing_and_smaller_ones_are_made() {
    for method in METHODS {
        let desc = SimDesc { method, threads: 1, cut_nodes: 128, ..SimDesc::default() };
        let mut sim = Sim::new(beam([30, 6, 4], true), &desc).unwrap();
        let mut surface = sim.open_surface(0).unwrap();
        let edge = |x: f64| [-1.0, 99.0].map(|y| Vec3::new(x, y, 1.4) * CELL_M);
        let mut reached = 31.0;
        let refused = loop {
            match sim.cut(&edge(reached), &edge(reached - 1.0)) {
                Ok(_) => reached -= 1.0,
                Err(error) => break error,
            }
            sim.step().unwrap();
        };
        assert!(matches!(refused, Error::Limit(_)) && reached < 28.0 && reached > 1.0, "{refused}");
        let (before, version) = (sim.statistics(), surface.map().unwrap().topology_version);
        for _ in 0..5 {
            assert!(matches!(sim.cut(&edge(reached), &edge(reached - 1.0)), Err(Error::Limit(_))));
            sim.step().unwrap();
        }
        let now = sim.statistics();
        assert_eq!((now.divided_cells, now.copies), (before.divided_cells, before.copies));
        assert_eq!(surface.map().unwrap().topology_version, version);
        // What needs less still has room, and a reset gives all of it back.
        sim.reset();
        assert!(sim.cut(&edge(31.0), &edge(reached)).unwrap() > 0);
    }
}
