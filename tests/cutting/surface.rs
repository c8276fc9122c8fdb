//! What renderers and tools see of a cut.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::sim::Sim;
use palpate::solver::tool::{ToolDesc, ToolMotion};

use super::closed::{check_closed, points, there};
use super::{CELL_M, METHODS, beam, simulation, slit};

/// A block of 6 × 6 × 8 cells, held at z = 0.
fn pillar() -> Arc<Model> {
    let middle = Pose::translation(0.5 * CELL_M, 0.5 * CELL_M, 0.5 * CELL_M);
    let mut build =
        Build::new(LabelGrid::new([6, 6, 8], Vec3::repeat(CELL_M), middle, vec![1; 288]).unwrap());
    let tissue = Material::new("tissue", 5e3, 0.4, 1000.0).unwrap();
    build.uses = BTreeMap::from([(1, LabelUse::Tissue(tissue))]);
    let half_extents = Vec3::new(1.0, 1.0, 0.1 * CELL_M);
    build.fixes.push(Fix { pose: Pose::identity(), half_extents, axes: [true; 3] });
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

#[test]
fn a_cut_is_seen_as_closed_parts_with_walls_in_the_blades_plane() {
    for method in METHODS {
        let model = beam([10, 3, 4], true);
        let mut sim = simulation(&model, method, Vec3::zeros());
        let mut surface = sim.open_surface(0).unwrap();
        let (before, version) = {
            let frame = surface.map().unwrap();
            assert_eq!((frame.first_wall, frame.topology_version), (frame.triangles.len(), 0));
            (points(&frame), frame.topology_version)
        };
        let whole = check_closed(&surface.map().unwrap(), &before);
        // In part: the sides are still one.
        slit(&mut sim, 12.0, 5.3, 1.7);
        let frame = surface.map().unwrap();
        assert!(frame.first_wall < frame.triangles.len() && frame.topology_version > version);
        let at = points(&frame);
        assert_eq!(at[..before.len()], before, "vertices of the model's own surface keep their numbers");
        assert!((check_closed(&frame, &at) / whole - 1.0).abs() < 1e-5);
        for corners in there(&frame.triangles[frame.first_wall..]) {
            for v in corners.map(|v| v as usize) {
                assert!((at[v].z - 1.7 * CELL_M).abs() < 1e-3 * CELL_M, "a wall lies in the cut");
                assert!(frame.normals[v][2].abs() > 0.999, "and is flat");
                assert_eq!(
                    frame.previous_positions[v], frame.positions[v],
                    "new vertices were where they are"
                );
            }
            // Texture coordinates are lengths.
            let [a, b] = [corners[0] as usize, corners[1] as usize];
            let uv = [a, b].map(|v| frame.uvs[v].map(f64::from));
            let length = (uv[0][0] - uv[1][0]).hypot(uv[0][1] - uv[1][1]);
            assert!((length - (at[a] - at[b]).norm()).abs() < 1e-3 * CELL_M);
        }
        // Through: both parts are closed for themselves, and fall apart where one is free.
        slit(&mut sim, 12.0, -1.0, 1.7);
        sim.set_gravity(-9.81 * Vec3::z()).unwrap();
        sim.reset();
        assert_eq!(
            surface.map().unwrap().first_wall,
            surface.map().unwrap().triangles.len(),
            "a reset heals"
        );
    }
}

#[test]
fn what_was_cut_off_is_drawn_where_it_falls() {
    for method in METHODS {
        let model = beam([12, 3, 4], true);
        // Away from what is held.
        let mut sim = simulation(&model, method, 9.81 * Vec3::x());
        let mut surface = sim.open_surface(0).unwrap();
        let blade = |y: f64| [-99.0, 99.0].map(|z| Vec3::new(6.35, y, z) * CELL_M);
        sim.cut(&blade(-1.0), &blade(4.0)).unwrap();
        let rest = points(&surface.map().unwrap());
        (0..60).for_each(|_| sim.step().unwrap());
        let frame = surface.map().unwrap();
        let now = points(&frame);
        check_closed(&frame, &now);
        // Beyond the cut all has fallen by g t²/2; the held rest hangs. Explicit velocities lag by half a step.
        let fallen = 0.5 * 9.81 * 0.06 * 0.06;
        for (a, b) in rest.iter().zip(&now).filter(|(a, _)| a.x > 6.5 * CELL_M) {
            assert!(((b.x - a.x) / fallen - 1.0).abs() < 0.03, "{} of {fallen}", b.x - a.x);
        }
        let held = rest.iter().zip(&now).filter(|(a, _)| a.x < 6.2 * CELL_M);
        assert!(held.map(|(a, b)| b.x - a.x).fold(0.0, f64::max) < 0.1 * fallen);
    }
}

#[test]
fn a_tool_touches_the_wall_of_a_cut() {
    for method in METHODS {
        let model = beam([12, 5, 6], true);
        let mut sim = simulation(&model, method, Vec3::zeros());
        let blade = |y: f64| [-99.0, 99.0].map(|z| Vec3::new(6.35, y, z) * CELL_M);
        sim.cut(&blade(-1.0), &blade(6.0)).unwrap();
        // The free part leaves along x; then a ball comes after it, and back to the wall.
        let away = |sim: &mut Sim| {
            sim.set_gravity(Vec3::x() * 50.0).unwrap();
            (0..60).for_each(|_| sim.step().unwrap());
            sim.set_gravity(Vec3::zeros()).unwrap();
        };
        away(&mut sim);
        let mut tool = sim.add_tool(&ToolDesc::sphere(2.0 * CELL_M)).unwrap();
        let mut force = Vec3::zeros();
        for step in 0..80 {
            let x = 9.0 - 0.02 * f64::from(step);
            let at = Vec3::new(x, 2.5, 3.0) * CELL_M;
            tool.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
            sim.step().unwrap();
            force = tool.force().wrench.force_n;
        }
        assert!(force.x > 1e-3 && force.x > 5.0 * force.yz().norm(), "{force:?}");
        assert!(sim.contacts(tool.id()).unwrap().iter().all(|contact| contact.normal.x < -0.5));
    }
}

#[test]
fn a_part_that_was_cut_off_comes_to_lie_on_the_other() {
    for method in METHODS {
        // A block that is held at its foot, cut through level.
        let model = pillar();
        let mut sim = simulation(&model, method, -9.81 * Vec3::z());
        slit(&mut sim, 9.0, -1.0, 3.3);
        let mass: f64 = sim.parts().iter().map(|part| part.mass_kg).sum();
        let mut surface = sim.open_surface(0).unwrap();
        let rest = points(&surface.map().unwrap());
        let momentum = |sim: &Sim| sim.parts().iter().map(|p| p.velocity_m_s * p.mass_kg).sum::<Vec3>();
        (0..150).for_each(|_| sim.step().unwrap());
        assert_eq!(sim.parts().len(), 2);
        // In free fall it would have 1.5 m/s; sides that touch chatter.
        assert!(momentum(&sim).norm() < 0.05 * mass, "it lies still: {:?}", momentum(&sim) / mass);
        let now = points(&surface.map().unwrap());
        let sunk = rest.iter().zip(&now).map(|(a, b)| a.z - b.z).fold(0.0, f64::max);
        // In 0.15 s it would have fallen by 0.11 m; as one piece it sinks by a few hundredths of a cell.
        assert!(sunk < 0.3 * CELL_M, "{} cells", sunk / CELL_M);
    }
}
