//! Tissue that is removed: by shape, by part, and as crumbs of cuts.

use std::sync::Arc;

use palpate::error::Error;
use palpate::math::{Pose, Vec3};
use palpate::model::Model;
use palpate::sim::{NodeField, Part, Removed, Sim, SimDesc};
use palpate::solver::load::Load;
use palpate::solver::method::Method;
use palpate::solver::tool::{Shape, ToolDesc, ToolMotion};

use super::closed::{check_closed, points, there};
use super::{CELL_M, DENSITY_KG_M3, EXACT, METHODS, beam, simulation, slit};

/// How much a ball's hole in the grid may differ from the ball: walls are flat between edges of cells.
const ROUND: f64 = 0.05;

fn at(cells: [f64; 3]) -> Pose {
    let [x, y, z] = cells.map(|n| n * CELL_M);
    Pose::translation(x, y, z)
}

/// A ball of a radius in cells.
fn ball(cells: f64) -> Shape {
    Shape::Sphere { radius_m: cells * CELL_M }
}

/// A box along the axes, next to without rounding, by its half extents in cells.
fn cuboid(cells: [f64; 3]) -> Shape {
    Shape::Box { half_extents_m: Vec3::from(cells) * CELL_M, rounding_m: 1e-5 }
}

fn total(parts: &[Part]) -> [f64; 2] {
    [parts.iter().map(|part| part.volume_m3).sum(), parts.iter().map(|part| part.mass_kg).sum()]
}

/// What is left and what was removed is what the model had, and the surface is closed around it.
fn check_account(sim: &mut Sim, model: &Arc<Model>) {
    let expected = model.lattice().cell_count() as f64 * CELL_M.powi(3);
    let [volume, mass] = total(&sim.parts());
    let gone = sim.statistics();
    assert!(((volume + gone.removed_m3) / expected - 1.0).abs() < EXACT);
    assert!(((mass + gone.removed_kg) / expected / DENSITY_KG_M3 - 1.0).abs() < EXACT);
}

#[test]
fn a_ball_leaves_a_hole_of_its_volume_and_all_else_as_it_was() {
    for method in METHODS {
        let model = beam([10, 10, 10], true);
        let mut sim = simulation(&model, method, Vec3::zeros());
        let mut surface = sim.open_surface(0).unwrap();
        let whole = {
            let frame = surface.map().unwrap();
            check_closed(&frame, &points(&frame))
        };
        // Past the layers of nodes, inside of the block.
        let Removed { volume_m3, mass_kg } = sim.ablate(&ball(3.3), &at([5.1, 4.8, 5.3])).unwrap();
        let expected = 4.0 / 3.0 * std::f64::consts::PI * (3.3 * CELL_M).powi(3);
        assert!((volume_m3 / expected - 1.0).abs() < ROUND, "{volume_m3} of {expected}");
        assert!((mass_kg / volume_m3 / DENSITY_KG_M3 - 1.0).abs() < EXACT);
        assert_eq!(sim.parts().len(), 1);
        check_account(&mut sim, &model);

        let frame = surface.map().unwrap();
        let at = points(&frame);
        let left = check_closed(&frame, &at);
        assert!(((whole - left) / volume_m3 - 1.0).abs() < 1e-4, "{} {volume_m3}", whole - left);
        // Walls are the ball's surface, looked at from the tissue: within what a chord of a cell leaves.
        let middle = Vec3::new(5.1, 4.8, 5.3) * CELL_M;
        assert!(frame.first_wall < frame.triangles.len());
        for corners in there(&frame.triangles[frame.first_wall..]) {
            for v in corners.map(|v| v as usize) {
                let radius = (at[v] - middle).norm() / CELL_M;
                assert!((radius - 3.3).abs() < 0.2, "{radius}");
                let normal = Vec3::new(
                    frame.normals[v][0].into(),
                    frame.normals[v][1].into(),
                    frame.normals[v][2].into(),
                );
                assert!(normal.dot(&(middle - at[v])) > 0.0, "walls face the hole");
            }
        }
        // At rest nothing acts, and nothing moves.
        (0..10).for_each(|_| sim.step().unwrap());
        let moved = sim.nodes(NodeField::Displacement).iter().map(Vec3::norm).fold(0.0, f64::max);
        assert!(moved < EXACT * CELL_M, "{moved}");
        assert!(sim.statistics().node_count < model.lattice().node_count() as u64);
        // What is gone is gone.
        assert_eq!(sim.ablate(&ball(3.3), &super::removal::at([5.1, 4.8, 5.3])).unwrap(), Removed::default());
    }
}

#[test]
fn what_stays_keeps_its_momentum_and_then_gains_its_weight_alone() {
    for method in METHODS {
        let model = beam([12, 4, 4], false);
        let mut sim = simulation(&model, method, -9.81 * Vec3::z());
        (0..5).for_each(|_| sim.step().unwrap());
        let before = sim.parts()[0];
        // An end of the beam, while it falls.
        let removed = sim.ablate(&cuboid([2.6, 9.0, 9.0]), &at([0.0, 0.0, 0.0])).unwrap();
        assert!((removed.volume_m3 / (2.6 * 16.0 * CELL_M.powi(3)) - 1.0).abs() < 1e-6, "{removed:?}");
        let after = sim.parts();
        assert_eq!(after.len(), 1);
        // It falls as one: each share of it as fast.
        assert!((after[0].velocity_m_s - before.velocity_m_s).norm() < EXACT);
        assert!((after[0].mass_kg + removed.mass_kg - before.mass_kg).abs() < EXACT * before.mass_kg);
        for _ in 0..20 {
            let before = sim.parts()[0].velocity_m_s;
            sim.step().unwrap();
            let gained = sim.parts()[0].velocity_m_s - before;
            assert!((gained + Vec3::z() * 9.81e-3).norm() < 1e-8, "{gained:?}");
        }
        check_account(&mut sim, &model);
    }
}

#[test]
fn what_only_removed_tissue_joined_falls_apart() {
    for method in METHODS {
        let model = beam([12, 3, 4], true);
        let mut sim = simulation(&model, method, 9.81 * Vec3::x());
        let mut surface = sim.open_surface(0).unwrap();
        // Its middle, all through; and by a cut lengthwise what is left beyond.
        sim.ablate(&cuboid([1.2, 9.0, 9.0]), &at([6.0, 0.0, 0.0])).unwrap();
        let parts = sim.parts();
        assert_eq!(parts.len(), 2);
        assert_eq!(parts.iter().filter(|part| part.is_held).count(), 1);
        slit(&mut sim, 14.0, 6.5, 2.3);
        assert_eq!(sim.parts().len(), 3);
        check_account(&mut sim, &model);
        let frame = surface.map().unwrap();
        check_closed(&frame, &points(&frame));
        for _ in 0..20 {
            let before: Vec<Part> = sim.parts();
            sim.step().unwrap();
            for (a, b) in before.iter().zip(sim.parts()).filter(|(a, _)| !a.is_held) {
                let gained = b.velocity_m_s - a.velocity_m_s;
                assert!((gained - Vec3::x() * 9.81e-3).norm() < 1e-3, "{gained:?}");
            }
        }
    }
}

#[test]
fn a_part_that_was_cut_off_can_be_taken_away_and_the_other_does_not_notice() {
    for method in METHODS {
        let model = beam([10, 3, 4], true);
        let mut sim = simulation(&model, method, -9.81 * Vec3::z());
        // Askew, so that what is free comes to lie on what is held.
        let blade = |y: f64| [[8.0, -1.0], [3.0, 5.0]].map(|[x, z]| Vec3::new(x, y, z) * CELL_M);
        assert!(sim.cut(&blade(-1.0), &blade(4.0)).unwrap() > 0);
        (0..5).for_each(|_| sim.step().unwrap());
        let [held, free] =
            [true, false].map(|held| *sim.parts().iter().find(|part| part.is_held == held).unwrap());
        let mut surface = sim.open_surface(0).unwrap();
        let removed = sim.remove_part(held.id).unwrap();
        assert_eq!([removed.volume_m3, removed.mass_kg], [held.volume_m3, held.mass_kg]);
        assert_eq!(sim.parts(), [free]);
        check_account(&mut sim, &model);
        let frame = surface.map().unwrap();
        let volume = check_closed(&frame, &points(&frame));
        assert!(volume > 0.5 * free.volume_m3 && volume < 1.5 * free.volume_m3);
        for _ in 0..10 {
            let before = sim.parts()[0].velocity_m_s;
            sim.step().unwrap();
            assert!((sim.parts()[0].velocity_m_s - before + Vec3::z() * 9.81e-3).norm() < 1e-8);
        }
        // It can be cut on, and taken away until nothing is left.
        slit(&mut sim, 12.0, -1.0, 2.6);
        assert_eq!(sim.parts().len(), 2);
        for part in sim.parts() {
            sim.remove_part(part.id).unwrap();
        }
        assert!(sim.parts().is_empty());
        sim.step().unwrap();
        assert!(there(surface.map().unwrap().triangles).next().is_none());
        check_account(&mut sim, &model);
    }
}

#[test]
fn tissue_that_was_cut_can_be_removed_and_cut_again() {
    for method in METHODS {
        let model = beam([12, 6, 6], true);
        let mut sim = simulation(&model, method, -9.81 * Vec3::z());
        let mut surface = sim.open_surface(0).unwrap();
        slit(&mut sim, 14.0, 5.0, 2.4);
        for step in 0..20 {
            match step {
                2 => assert!(sim.ablate(&ball(1.7), &at([9.0, 3.0, 2.4])).unwrap().volume_m3 > 0.0),
                5 => assert!(slit(&mut sim, 14.0, 7.3, 4.2) > 0),
                8 => assert!(sim.ablate(&ball(2.1), &at([7.5, 3.0, 3.2])).unwrap().volume_m3 > 0.0),
                // Where nothing is left there is nothing to cut.
                11 => {
                    let edge = |x: f64| [2.9, 3.1].map(|y| Vec3::new(x, y, 3.2) * CELL_M);
                    assert_eq!(sim.cut(&edge(7.4), &edge(7.6)).unwrap(), 0);
                }
                _ => {}
            }
            sim.step().unwrap();
            check_account(&mut sim, &model);
            let frame = surface.map().unwrap();
            check_closed(&frame, &points(&frame));
        }
        assert!(sim.nodes(NodeField::Displacement).iter().flatten().all(|x| x.is_finite()));
    }
}

#[test]
fn a_reset_brings_removed_tissue_back() {
    for method in METHODS {
        let model = beam([8, 3, 4], true);
        let press = |sim: &mut Sim| {
            (0..20).for_each(|_| sim.step().unwrap());
            sim.nodes(NodeField::Displacement)
        };
        let mut sim = simulation(&model, method, -9.81 * Vec3::z());
        let expected = press(&mut sim);
        let mut sim = simulation(&model, method, -9.81 * Vec3::z());
        let mut surface = sim.open_surface(0).unwrap();
        let count = surface.map().unwrap().triangles.len();
        sim.ablate(&ball(2.2), &at([8.0, 1.5, 2.0])).unwrap();
        press(&mut sim);
        sim.reset();
        assert_eq!((sim.parts().len(), sim.statistics().removed_kg), (1, 0.0));
        assert_eq!(sim.statistics().node_count, model.lattice().node_count() as u64);
        assert_eq!(surface.map().unwrap().triangles.len(), count);
        let largest = expected.iter().map(Vec3::norm).fold(0.0, f64::max);
        let off = press(&mut sim).iter().zip(&expected).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(off < EXACT * largest, "{off} of {largest}");
    }
}

#[test]
fn nothing_moves_nodes_without_tissue() {
    for method in METHODS {
        let model = beam([10, 5, 5], true);
        let mut sim = simulation(&model, method, -9.81 * Vec3::z());
        // The free end: it is held by a tool, pressed by a load, and looked for by another tool.
        let end = Vec3::new(10.0, 2.5, 2.5) * CELL_M;
        let mut tool = sim.add_tool(&ToolDesc::sphere(1.2 * CELL_M)).unwrap();
        tool.set_motion(&ToolMotion::at(Pose::translation(end.x, end.y, end.z))).unwrap();
        sim.step().unwrap();
        assert!(sim.grasp(tool.id(), 0.5 * CELL_M).unwrap() > 0);
        sim.add_load(&Load::Point { at_m: end - Vec3::repeat(0.1 * CELL_M), force_n: Vec3::z() * 1e-3 })
            .unwrap();
        sim.step().unwrap();
        sim.ablate(&ball(3.2), &Pose::translation(end.x, end.y, end.z)).unwrap();
        let gone: Vec<usize> = {
            let rest = sim.nodes(NodeField::RestPosition);
            (0..rest.len()).filter(|&n| (rest[n] - end).norm() < 2.5 * CELL_M).collect()
        };
        let before = sim.nodes(NodeField::Displacement);
        let everything =
            palpate::model::Fix { pose: Pose::identity(), half_extents: Vec3::repeat(1.0), axes: [true; 3] };
        for step in 0..10 {
            if step == 3 {
                sim.fix(&everything).unwrap();
                sim.free(&everything).unwrap();
            }
            sim.step().unwrap();
            assert_eq!(tool.force().wrench.force_n, Vec3::zeros(), "nothing is there to be felt");
        }
        assert_eq!(sim.release(tool.id()).unwrap(), 0);
        let now = sim.nodes(NodeField::Displacement);
        assert!(now.iter().flatten().all(|x| x.is_finite()));
        assert!(gone.iter().all(|&n| now[n] == before[n]) && !gone.is_empty());
        let speeds = sim.nodes(NodeField::Velocity);
        assert!(gone.iter().all(|&n| speeds[n] == Vec3::zeros()));
        assert!(sim.energy().kinetic_j.is_finite() && sim.energy().elastic_j.is_finite());
    }
}

#[test]
fn what_cannot_be_removed_says_why_and_nothing_is_lost() {
    let model = beam([6, 4, 4], false);
    let mut sim = simulation(&model, Method::Lattice, Vec3::zeros());
    let here = at([3.0, 2.0, 2.0]);
    for shape in [ball(0.0), ball(f64::NAN), cuboid([1.0, f64::INFINITY, 1.0])] {
        assert!(matches!(sim.ablate(&shape, &here), Err(Error::Argument(_))));
    }
    for pose in [at([f64::NAN, 0.0, 0.0]), at([1e9, 0.0, 0.0])] {
        assert!(matches!(sim.ablate(&ball(1.0), &pose), Err(Error::Argument(_))));
    }
    // Beside the tissue, and between its nodes.
    assert_eq!(sim.ablate(&ball(1.0), &at([30.0, 2.0, 2.0])).unwrap(), Removed::default());
    assert_eq!(sim.ablate(&ball(0.4), &at([2.5, 2.5, 2.5])).unwrap(), Removed::default());
    assert!(matches!(sim.remove_part(1 << 30), Err(Error::Argument(_))));
    assert_eq!(sim.statistics().removed_m3, 0.0);
    assert_eq!(total(&sim.parts())[0], total(&simulation(&model, Method::Lattice, Vec3::zeros()).parts())[0]);

    let mut uncuttable = Sim::new(model.clone(), &SimDesc::default()).unwrap();
    let id = uncuttable.parts()[0].id;
    assert!(matches!(uncuttable.ablate(&ball(1.0), &here), Err(Error::State(_))));
    assert!(matches!(uncuttable.remove_part(id), Err(Error::State(_))));
    let desc = SimDesc { cut_nodes: 1, ..SimDesc::default() };
    let large = beam([12, 12, 12], false);
    let mut small = Sim::new(large.clone(), &desc).unwrap();
    assert!(matches!(small.ablate(&ball(4.0), &at([6.0, 6.0, 6.0])), Err(Error::Limit(_))));
    check_account(&mut small, &large);
    assert_eq!(small.statistics().removed_m3, 0.0);
    small.step().unwrap();
    let desc = SimDesc { least_part_cells: f64::NAN, ..SimDesc::default() };
    assert!(matches!(Sim::new(model, &desc), Err(Error::Argument(_))));
}

#[test]
fn a_part_smaller_than_the_grid_resolves_goes_with_the_cut_and_is_counted() {
    // A blade across a corner of a block: less than a cell comes off, or more.
    let severed = |method: Method, reach: f64, desc: &dyn Fn(SimDesc) -> SimDesc| {
        let model = beam([6, 5, 5], true);
        let desc = desc(SimDesc { method, cut_nodes: 10_000, ..SimDesc::default() });
        let mut sim = Sim::new(model.clone(), &desc).unwrap();
        let corner = Vec3::new(6.0, 5.0, 5.0);
        let edge = |n: f64| {
            let middle = corner - Vec3::new(reach, reach, 0.0) * 0.5 - Vec3::z() * (reach * n);
            let along = Vec3::new(1.0, -1.0, 0.0);
            [-20.0, 20.0].map(|far| (middle + Vec3::new(0.5, 0.5, 0.0) * (reach * n) + along * far) * CELL_M)
        };
        assert!(sim.cut(&edge(3.0), &edge(-3.0)).unwrap() > 0);
        check_account(&mut sim, &model);
        let gone = sim.statistics().removed_m3 / CELL_M.powi(3);
        (sim.parts().len(), gone)
    };
    for method in METHODS {
        let (parts, gone) = severed(method, 1.4, &|desc| desc);
        assert!(parts == 1 && gone > 0.1 && gone < 1.0, "{parts} parts, {gone} cells");
        assert_eq!(severed(method, 1.4, &|desc| SimDesc { least_part_cells: 0.0, ..desc }), (2, 0.0));
        assert_eq!(severed(method, 3.1, &|desc| desc), (2, 0.0));
        let (parts, gone) = severed(method, 3.1, &|desc| SimDesc { least_part_cells: 20.0, ..desc });
        assert!(parts == 1 && gone > 1.0, "{parts} parts, {gone} cells");
    }
}
