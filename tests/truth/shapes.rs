//! Odd, thin, disconnected and single-cell grids, several bodies, held axes and driven bones.

use palpate::math::{Pose, Quat, Vec3};
use palpate::model::LabelUse;
use palpate::sim::SimDesc;
use palpate::solver::load::{Load, Region};

use super::scene::{Body, block, dragged, exact, hold, material, ragged, roller, voxels};
use super::tolerance::{self as tol, Claim};

const H: f64 = 0.01;

fn tissue() -> palpate::model::material::Material {
    material(1e4, 0.45, 1000.0)
}

#[test]
fn grids_of_any_shape_keep_mass_momentum_and_energy() {
    let mut claim = Claim::new("odd grids");
    let bodies = [
        ("single cell", block([1; 3], H, tissue())),
        ("row", block([17, 1, 1], H, tissue())),
        ("column", block([1, 1, 13], H, tissue())),
        ("plate", block([9, 11, 1], H, tissue())),
        ("prime", block([7, 5, 3], H, tissue())),
        ("ragged and disconnected", ragged([9, 8, 7], H, 5, 0.3, [tissue(), material(2e4, 0.3, 800.0)])),
        (
            "cells that touch in corners",
            voxels([4; 3], H, |[i, j, k]| u16::from(i == j && j == k), &[(1, LabelUse::Tissue(tissue()))]),
        ),
    ];
    for (name, build) in bodies {
        let mut body = Body::new(&build, &exact());
        let model = body.sim.model().clone();
        let mass: f64 = model
            .materials()
            .iter()
            .enumerate()
            .map(|(m, material)| {
                let cells =
                    model.lattice().occupied().filter(|(_, other)| usize::from(*other) == m + 1).count();
                material.density_kg_m3 * H.powi(3) * cells as f64
            })
            .sum();
        claim.check(tol::ROUNDING, &format!("{name}, mass"), body.mass.iter().sum::<f64>() / mass - 1.0);

        body.set(|x| (Vec3::zeros(), Vec3::new(0.01 * (90.0 * x.y).sin(), 0.01 * (70.0 * x.z).cos(), 0.02)));
        let (momentum, size) = body.momentum();
        let energy = body.total_energy();
        body.steps(300);
        claim.check(
            tol::MOMENTUM_F64,
            &format!("{name}, momentum"),
            (body.momentum().0 - momentum).norm() / size,
        );
        // Close to the stable step the energy swings, but what is bounded cannot run away.
        claim.check(tol::ENERGY_NEAR_LIMIT, &format!("{name}, energy"), body.total_energy() / energy - 1.0);
    }
}

#[test]
fn of_two_bodies_in_one_grid_the_untouched_one_stays() {
    let label = |[i, _, _]: [usize; 3]| u16::from(i != 4);
    let build = voxels([9, 4, 4], H, label, &[(1, LabelUse::Tissue(tissue()))]);
    let mut body = Body::new(&build, &exact());
    body.set(|x| {
        (Vec3::zeros(), if x.x < 4.5 * H { Vec3::new(0.2, 0.05, 0.0) * x.z / H } else { Vec3::zeros() })
    });
    body.steps(200);
    let u = body.u();
    for (u, x) in u.iter().zip(&body.rest) {
        assert_eq!(*u == Vec3::zeros(), x.x > 4.5 * H, "at {x}");
    }
}

#[test]
fn held_axes_do_not_move_and_free_ones_do() {
    let mut build = block([5, 4, 3], H, tissue());
    roller(&mut build, 0);
    hold(&mut build, Vec3::new(-1.0, -1.0, 3.0 * H), Vec3::repeat(1.0), [false, true, false]);
    let desc = SimDesc { gravity_m_s2: Vec3::new(1.0, 2.0, 3.0), rest_under_gravity: false, ..exact() };
    let mut body = Body::new(&build, &desc);
    body.steps(50);
    for (u, x) in body.u().iter().zip(&body.rest) {
        assert_eq!(u.x == 0.0, x.x == 0.0, "x at {x}");
        assert_eq!(u.y == 0.0, x.z == 3.0 * H, "y at {x}");
        assert!(u.z != 0.0, "z at {x}");
    }
}

#[test]
fn a_driven_bone_moves_exactly_and_carries_its_tissue() {
    let mut claim = Claim::new("driven bone");
    // Tissue between two bones.
    let label = |[i, _, _]: [usize; 3]| match i {
        0 => 2,
        9 => 3,
        _ => 1,
    };
    let bone = material(1e10, 0.3, 1900.0);
    let uses =
        [(1, LabelUse::Tissue(tissue())), (2, LabelUse::Rigid(bone.clone())), (3, LabelUse::Rigid(bone))];
    let mut body = Body::new(&voxels([10, 4, 4], H, label, &uses), &dragged(60.0));
    let motion = |share: f64| {
        let turn = Quat::from_axis_angle(&Vec3::x_axis(), 0.02 * share);
        Pose::from_parts((Vec3::new(1e-3, 0.0, -2e-3) * share).into(), turn)
    };
    for step in 1..=200 {
        body.sim.drive_region(3, &motion(f64::from(step) / 200.0)).unwrap();
        body.steps(1);
    }
    body.steps(500);
    let (u, end) = (body.u(), motion(1.0));
    let (mut off, mut middle) = (0.0_f64, Vec3::zeros());
    for (u, x) in u.iter().zip(&body.rest) {
        if x.x > 8.5 * H {
            off = off.max((u - (end.transform_point(&(*x).into()).coords - x)).norm() / H);
        } else if x.x < 1.5 * H {
            assert_eq!(*u, Vec3::zeros(), "the other bone stays");
        } else if x.x == 5.0 * H {
            middle += u / 25.0;
        }
    }
    claim.check(tol::ROUNDING, "bone", off);
    // By symmetry the middle goes half the way of the bone's middle.
    let centre = Vec3::new(9.0 * H, 2.0 * H, 2.0 * H);
    let expected = 0.5 * (end.transform_point(&centre.into()).coords - centre);
    claim.check(tol::HALF_WAY, "middle", (middle - expected).norm() / expected.norm());
}

#[test]
fn settling_under_a_point_load_agrees_with_waiting() {
    let mut claim = Claim::new("settle");
    let mut build = block([6, 6, 4], H, tissue());
    hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
    let load = Load::Point { at_m: Vec3::new(0.031, 0.027, 0.04), force_n: Vec3::new(0.002, 0.0, -0.01) };
    let mut bodies = [dragged(80.0), dragged(0.0)].map(|desc| Body::new(&build, &desc));
    bodies.iter_mut().for_each(|body| {
        body.sim.add_load(&load).unwrap();
    });
    bodies[0].steps(1500);
    let time = bodies[1].sim.statistics().time_s;
    bodies[1].sim.settle(1e-6, 100_000).unwrap();
    assert_eq!(bodies[1].sim.statistics().time_s, time, "settling takes no simulated time");
    let [waited, settled] = bodies.each_ref().map(Body::u);
    let size = waited.iter().map(Vec3::norm).fold(0.0, f64::max);
    let off = waited.iter().zip(&settled).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    claim.check(tol::SETTLED_MOTION, "largest difference / largest displacement", off / size);
}

#[test]
fn a_load_without_faces_is_refused() {
    let mut body = Body::new(&block([2; 3], H, tissue()), &exact());
    let region = Region { pose: Pose::translation(1.0, 1.0, 1.0), half_extents_m: Vec3::repeat(0.1) };
    assert!(body.sim.add_load(&Load::Pressure { region, pressure_pa: 1.0 }).is_err());
}
