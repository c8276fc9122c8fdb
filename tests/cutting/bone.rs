//! Bone: cuts end at it, removal leaves it, and it goes where it is driven.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, LabelUse, Model};
use palpate::sim::{NodeField, Part, Removed, Sim};
use palpate::solver::blade::Blade;
use palpate::solver::tool::{Shape, ToolDesc, ToolMotion};

use super::{CELL_M, DENSITY_KG_M3, EXACT, METHODS, POISSON, YOUNG_PA, simulation, slit};

/// Cells of the block.
const CELLS: [usize; 3] = [10, 8, 8];
/// The label of the bone, and the middle of its eight cells.
const BONE: u16 = 2;
const MIDDLE: Vec3 = Vec3::new(5.0, 4.0, 4.0);
/// What a cut leaves on each face of bone, in cells.
const SKIN: f64 = 1e-3;
/// The least volume of a piece, in cells.
const LEAST_PIECE: f64 = 1e-4;

/// A block whose lowest corner is the origin, held by nothing but the bone in its middle.
fn boned() -> Arc<Model> {
    let label = |n: usize| match [n % CELLS[0], n / CELLS[0] % CELLS[1], n / (CELLS[0] * CELLS[1])] {
        [4 | 5, 3 | 4, 3 | 4] => BONE,
        _ => 1,
    };
    let labels = (0..CELLS.iter().product()).map(label).collect();
    let middle = Pose::translation(0.5 * CELL_M, 0.5 * CELL_M, 0.5 * CELL_M);
    let mut build = Build::new(LabelGrid::new(CELLS, Vec3::repeat(CELL_M), middle, labels).unwrap());
    let material = |young_pa| Material::new("tissue", young_pa, POISSON, DENSITY_KG_M3).unwrap();
    build.uses =
        BTreeMap::from([(1, LabelUse::Tissue(material(YOUNG_PA))), (BONE, LabelUse::Rigid(material(1e9)))]);
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// Which nodes are the bone's.
fn of_bone(sim: &Sim) -> Vec<bool> {
    let rest = sim.nodes(NodeField::RestPosition);
    rest.iter().map(|p| (p / CELL_M - MIDDLE).iter().all(|x| x.abs() < 1.1)).collect()
}

/// The longest way of the nodes for which that is asked, in cells.
fn way(sim: &Sim, is_asked: impl Fn(usize) -> bool) -> f64 {
    let moved = sim.nodes(NodeField::Displacement);
    assert!(moved.iter().flatten().all(|x| x.is_finite()));
    (0..moved.len()).filter(|&n| is_asked(n)).map(|n| moved[n].norm() / CELL_M).fold(0.0, f64::max)
}

/// Takes the tissue around the bone away, so that it stands free in a hole with its skin alone. Gives both parts, the block first.
fn lay_bare(sim: &mut Sim) -> (Removed, Vec<Part>) {
    let at = MIDDLE * CELL_M;
    // All nodes of the cells around the bone are in it, and it ends in the block.
    let ball = Shape::Sphere { radius_m: 3.6 * CELL_M };
    let removed = sim.ablate(&ball, &Pose::translation(at.x, at.y, at.z)).unwrap();
    (removed, sim.parts())
}

#[test]
fn a_cut_ends_at_bone_and_bone_stays_where_it_is() {
    for method in METHODS {
        let model = boned();
        let mut sim = simulation(&model, method, -9.81 * Vec3::z());
        // Level through bone and block at once: cells stay whole that have an edge at the bone, which are four by four.
        assert_eq!(slit(&mut sim, 12.0, -1.0, 4.3), CELLS[0] * CELLS[1] - 16);
        assert_eq!(sim.parts().len(), 1, "the bone and what is on it joins both sides");
        assert_eq!(slit(&mut sim, -1.0, 12.0, 4.3), 0);
        // Through the bone alone there is nothing to cut.
        let edge = |x: f64| [-0.9, 0.9].map(|y| (MIDDLE + Vec3::new(x, y, 0.4)) * CELL_M);
        assert_eq!(sim.cut(&edge(-0.9), &edge(0.9)).unwrap(), 0);
        let bone = of_bone(&sim);
        (0..30).for_each(|_| sim.step().unwrap());
        assert_eq!(way(&sim, |n| bone[n]), 0.0);
        let sunk = way(&sim, |n| !bone[n]);
        assert!(sunk > 0.05 && sunk < 3.0, "the rest hangs on it: {sunk} cells");
    }
}

#[test]
fn a_blade_goes_through_bone_as_through_air_and_feels_the_tissue_on_both_sides() {
    let toughness_j_m2 = 5.0;
    for method in METHODS {
        let model = boned();
        let mut sim = simulation(&model, method, Vec3::zeros());
        let edge = ToolDesc::blade(Blade { edge: vec![-Vec3::y(), Vec3::y()], toughness_j_m2 });
        let mut blade = sim.add_tool(&edge).unwrap();
        // Up to two points of the edge more than the block is wide, half a cell each, where the tissue bulges.
        let limit = toughness_j_m2 * (CELLS[1] as f64 + 1.001) * CELL_M;
        let mut most = 0.0_f64;
        for step in 0..240 {
            let x = (11.0 - 0.05 * f64::from(step)) * CELL_M;
            blade.set_motion(&ToolMotion::at(Pose::translation(x, 0.0, 4.3 * CELL_M))).unwrap();
            sim.step().unwrap();
            most = most.max(blade.force().wrench.force_n.norm());
        }
        assert!(most > 0.5 * limit && most < limit, "{most} N of {limit}");
        let bone = of_bone(&sim);
        assert_eq!((way(&sim, |n| bone[n]), sim.parts().len()), (0.0, 1));
        assert!(sim.statistics().divided_cells > 40);
    }
}

#[test]
fn removal_beside_bone_leaves_the_bone_and_a_skin_on_it() {
    for method in METHODS {
        let model = boned();
        let mut sim = simulation(&model, method, Vec3::zeros());
        let (removed, parts) = lay_bare(&mut sim);
        let cells = |volume_m3: f64| volume_m3 / CELL_M.powi(3);
        // Nothing joins the block to the bone any more.
        assert_eq!(parts.len(), 2);
        assert!(parts[1].is_held && !parts[0].is_held);
        // A slab in each cell at one of its 24 faces, and the least that a piece has in those at its edges and corners.
        let skin = cells(parts[1].volume_m3) - 8.0;
        assert!((skin / (24.0 * SKIN + 32.0 * LEAST_PIECE) - 1.0).abs() < 1e-6, "{skin} cells");
        let whole: f64 = parts.iter().map(|part| part.volume_m3).sum::<f64>() + removed.volume_m3;
        assert!((cells(whole) / CELLS.iter().product::<usize>() as f64 - 1.0).abs() < EXACT);
        // At rest nothing acts.
        (0..10).for_each(|_| sim.step().unwrap());
        assert!(way(&sim, |_| true) < EXACT);
        // The bone is driven in its hole: it goes there, with its skin, and nothing else notices.
        let bone = of_bone(&sim);
        for step in 1..=20 {
            sim.drive_region(BONE, &Pose::translation(0.02 * f64::from(step) * CELL_M, 0.0, 0.0)).unwrap();
            sim.step().unwrap();
        }
        let moved = sim.nodes(NodeField::Displacement);
        assert!((0..moved.len()).all(|n| !bone[n] || (moved[n] - Vec3::x() * 0.4 * CELL_M).norm() < 1e-12));
        assert!(way(&sim, |n| !bone[n]) < EXACT);
    }
}

#[test]
fn a_driven_bone_can_be_removed_and_nothing_drives_it_any_more() {
    for method in METHODS {
        let model = boned();
        let mut sim = simulation(&model, method, Vec3::zeros());
        let (_, parts) = lay_bare(&mut sim);
        let drive = |sim: &mut Sim, steps: std::ops::RangeInclusive<u32>| {
            for step in steps {
                let motion = Pose::translation(0.02 * f64::from(step) * CELL_M, 0.0, 0.0);
                sim.drive_region(BONE, &motion).unwrap();
                sim.step().unwrap();
            }
        };
        drive(&mut sim, 1..=5);
        assert_eq!(sim.remove_part(parts[1].id).unwrap().volume_m3, parts[1].volume_m3);
        assert_eq!(sim.parts().len(), 1);
        let gone = of_bone(&sim);
        let (before, snapshot) = (sim.nodes(NodeField::Displacement), sim.snapshot().unwrap());
        for mut sim in [sim, simulation(&model, method, Vec3::zeros())] {
            sim.restore(&snapshot).unwrap();
            drive(&mut sim, 6..=10);
            let (after, speeds) = (sim.nodes(NodeField::Displacement), sim.nodes(NodeField::Velocity));
            let is_still = |n: usize| after[n] == before[n] && speeds[n] == Vec3::zeros();
            assert!((0..after.len()).all(|n| !gone[n] || is_still(n)));
            assert!(way(&sim, |n| !gone[n]) < EXACT, "the block stays");
            // All tissue is back after a reset, and driven as before.
            sim.reset();
            drive(&mut sim, 1..=2);
            let moved = sim.nodes(NodeField::Displacement);
            assert!((0..moved.len()).all(|n| !gone[n] || (moved[n].x / CELL_M - 0.04).abs() < 1e-9));
        }
    }
}

#[test]
fn tissue_on_a_driven_bone_goes_with_it_and_the_rest_of_the_block_falls() {
    for method in METHODS {
        let model = boned();
        let mut sim = simulation(&model, method, -9.81 * Vec3::z());
        // Beside the bone, all through; then the bone goes, and what hangs on it.
        let blade = |y: f64| [-99.0, 99.0].map(|z| Vec3::new(7.4, y, z) * CELL_M);
        assert_eq!(sim.cut(&blade(-1.0), &blade(9.0)).unwrap(), CELLS[1] * CELLS[2]);
        let held = *sim.parts().iter().find(|part| part.is_held).unwrap();
        sim.drive_region(BONE, &Pose::translation(-0.05 * CELL_M, 0.0, 0.0)).unwrap();
        sim.step().unwrap();
        sim.remove_part(held.id).unwrap();
        let [left] = sim.parts()[..] else { panic!("one part is left") };
        assert!((left.volume_m3 / CELL_M.powi(3) - 2.6 * 64.0).abs() < 1e-3 && !left.is_held);
        for step in 2..12 {
            sim.drive_region(BONE, &Pose::translation(-0.05 * f64::from(step) * CELL_M, 0.0, 0.0)).unwrap();
            let before = sim.parts()[0].velocity_m_s;
            sim.step().unwrap();
            let gained = sim.parts()[0].velocity_m_s - before;
            assert!((gained + Vec3::z() * 9.81e-3).norm() < 1e-8, "{gained:?}");
        }
    }
}
