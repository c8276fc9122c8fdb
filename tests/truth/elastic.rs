//! Statics: rotation, the patch test, moduli, beams, loads, gravity.

use std::sync::Arc;

use palpate::cpu::lattice::CpuReal;
use palpate::cpu::solver::CpuSolver;
use palpate::math::{Mat3, Quat, Vec3};
use palpate::model::{Build, LabelUse, Model, energy};
use palpate::sim::SimDesc;
use palpate::solver::Solver;
use palpate::solver::load::Load;

use super::scene::{Body, Noise, block, dragged, exact, faces_at, hold, material, roller, voxels};
use super::tolerance::{self as tol, Claim};

const H: f64 = 0.01;
const YOUNG: f64 = 1e4;

fn model(build: &Build) -> Arc<Model> {
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// Nodal forces of a displacement field, and the largest displacement.
fn forces<R: CpuReal>(model: &Arc<Model>, u: impl Fn(Vec3) -> Vec3) -> (Vec<Vec3>, f64) {
    let lattice = model.lattice();
    let mut solver = CpuSolver::<R>::new(model, 1, 0).unwrap();
    let mut furthest = 0.0_f64;
    let slots = (0..lattice.slot_count() as u32).filter(|&s| lattice.words()[s as usize] != 0);
    for slot in slots {
        let moved = u(lattice.rest_position(slot));
        furthest = furthest.max(moved.norm());
        solver.set_node(slot, moved, Vec3::zeros());
    }
    let mass = |slot| lattice.node_mass(slot, |m| model.laws()[usize::from(m)].corner_kg);
    let a = solver.accelerations();
    (a.iter().enumerate().map(|(slot, a)| a * mass(slot as u32)).collect(), furthest)
}

#[test]
fn a_rotated_and_shifted_body_feels_no_force() {
    let mut claim = Claim::new("rotation");
    let tissue = material(YOUNG, 0.45, 1000.0);
    let kappa = tissue.lame_lambda_pa() - tissue.shear_modulus_pa();
    let model = model(&block([9, 5, 4], H, tissue));
    let mut noise = Noise(5);
    for case in 0..6 {
        let rotation = Quat::from_scaled_axis(noise.vec3() * 3.0);
        let shift = noise.vec3() * H;
        let turned = |x: Vec3| rotation * x + shift - x;
        let unit = |u: f64| (1.0 + kappa / YOUNG) * (u / H) * YOUNG * H * H;
        let largest = |f: &[Vec3]| f.iter().map(Vec3::norm).fold(0.0, f64::max);

        let (f, u) = forces::<f32>(&model, turned);
        claim.check(tol::ROTATION_F32, &format!("single, rotation {case}"), largest(&f) / unit(u));
        let (f, u) = forces::<f64>(&model, turned);
        claim.check(tol::ROTATION_F64, &format!("double, rotation {case}"), largest(&f) / unit(u));
    }
}

/// A displacement gradient without symmetry, of size 1e-7.
fn small_gradient(noise: &mut Noise) -> Mat3 {
    Mat3::from_fn(|_, _| 1e-7 * noise.next())
}

fn stress(tissue: &palpate::model::material::Material, gradient: &Mat3) -> Mat3 {
    let strain = 0.5 * (gradient + gradient.transpose());
    Mat3::identity() * (tissue.lame_lambda_pa() * strain.trace()) + strain * (2.0 * tissue.shear_modulus_pa())
}

#[test]
fn affine_strain_stores_the_energy_of_the_continuum() {
    let mut claim = Claim::new("affine energy");
    let tissues =
        [material(YOUNG, 0.25, 1000.0), material(3.0 * YOUNG, 0.45, 1000.0), material(500.0, 0.49, 900.0)];
    // Materials in patches and a hole through the body, so that free surfaces and mixed cells all take part.
    let label = |[i, j, k]: [usize; 3]| if i == 3 && j == 2 { 0 } else { 1 + ((i / 2 + j + k) % 3) as u16 };
    let uses: Vec<_> = (1..).zip(tissues.iter().map(|t| LabelUse::Tissue(t.clone()))).collect();
    let model = model(&voxels([7, 5, 4], H, label, &uses));
    let mut noise = Noise(9);
    for case in 0..4 {
        let gradient = small_gradient(&mut noise);
        let strain = 0.5 * (gradient + gradient.transpose());
        let expected: f64 = model
            .lattice()
            .occupied()
            .map(|(cell, _)| {
                let tissue = &tissues[usize::from(label(cell)) - 1];
                0.5 * stress(tissue, &gradient).component_mul(&strain).sum() * H.powi(3)
            })
            .sum();
        let found =
            energy::elastic_j(model.lattice(), model.laws(), |s| gradient * model.lattice().rest_position(s));
        claim.check(tol::AFFINE_ENERGY, &format!("gradient {case}"), found / expected - 1.0);
    }
}

#[test]
fn affine_strain_pulls_free_surfaces_with_its_stress_and_nothing_else() {
    let mut claim = Claim::new("affine forces");
    for poisson in [0.25, 0.45] {
        let tissue = material(YOUNG, poisson, 1000.0);
        let model = model(&block([9, 5, 4], H, tissue.clone()));
        let lattice = model.lattice();
        let mut noise = Noise(11);
        let mut shear = Mat3::zeros();
        shear[(0, 1)] = 1e-7;
        for (case, gradient) in [("general", small_gradient(&mut noise)), ("shear", shear)] {
            let sigma = stress(&tissue, &gradient);
            let (found, _) = forces::<f64>(&model, |x| gradient * x);
            let scale = sigma.norm() * H * H;
            let (mut inner, mut corner) = (0.0_f64, 0.0_f64);
            for (slot, f) in found.iter().enumerate().filter(|(s, _)| lattice.words()[*s] != 0) {
                // Each cell around the node pulls by its stress through a quarter of three faces.
                let word = lattice.words()[slot];
                let cells = (0..8).filter(|c| word >> (4 * c) & 15 != 0);
                let outward: Vec3 = cells
                    .map(|c: u32| {
                        Vec3::from_fn(|a, _| if c >> a & 1 == 1 { 1.0 } else { -1.0 } * H * H / 4.0)
                    })
                    .sum();
                let off = (f - sigma * outward).norm();
                let is_corner = (0..8).filter(|c| word >> (4 * c) & 15 != 0).count() == 1;
                if is_corner { corner = corner.max(off) } else { inner = inner.max(off) }
            }
            let name = format!("nu {poisson}, {case}");
            claim.check(tol::AFFINE_FORCE, &format!("{name}, inside, on faces and edges"), inner / scale);
            if case == "shear" {
                // A cell's body diagonals do not balance alone: k₃ γ h / 3, and as much from each end.
                let k3 = 3.0 / 16.0 * tissue.shear_modulus_pa() * H / 0.75;
                let artefact = k3 * 1e-7 * H / 3.0;
                claim.check(tol::CORNER_ARTEFACT, &format!("{name}, corners"), corner / artefact - 1.0);
            }
        }
    }
}

/// A block on three rollers, pulled along x by a traction; steps until it rests.
fn pulled(cells: usize, poisson: f64, traction: f64) -> Body {
    let mut build = block([cells; 3], H, material(YOUNG, poisson, 1000.0));
    (0..3).for_each(|axis| roller(&mut build, axis));
    // Critical for the slowest mode, a quarter wave along the block at √(E / ρ).
    let slowest = 0.5 * std::f64::consts::PI * (YOUNG / 1000.0).sqrt() / (cells as f64 * H);
    let mut body = Body::new(&build, &dragged(2.0 * slowest));
    let load =
        Load::Traction { region: faces_at(0, cells as f64 * H), traction_pa: Vec3::new(traction, 0.0, 0.0) };
    body.sim.add_load(&load).unwrap();
    body.steps((60.0 / slowest / 1e-3) as usize);
    body
}

/// Stretch along and across the pull.
fn stretch(body: &Body) -> [f64; 2] {
    let length = body.sim.model().lattice().cells()[0] as f64 * H;
    let u = body.u();
    [0, 1].map(|axis| 1.0 + body.mean_over_plane(axis, length, &u)[axis] / length)
}

#[test]
fn uniform_traction_recovers_youngs_modulus_and_poissons_ratio() {
    let mut claim = Claim::new("uniaxial");
    for poisson in [0.25, 0.40, 0.45, 0.49] {
        let body = pulled(4, poisson, 1e-4 * YOUNG);
        let [along, across] = stretch(&body).map(|s| s - 1.0);
        claim.check(tol::MODULI, &format!("E at nu {poisson}"), 1e-4 / along - 1.0);
        claim.check(tol::MODULI, &format!("nu {poisson}"), -across / along / poisson - 1.0);
        let u = body.u();
        let bent = u
            .iter()
            .zip(&body.rest)
            .map(|(u, x)| (u - Vec3::new(along * x.x, across * x.y, across * x.z)).norm() / (1e-4 * 4.0 * H));
        claim.check(tol::UNIFORM, &format!("uniform strain, nu {poisson}"), bent.fold(0.0, f64::max));
    }
}

#[test]
fn large_stretch_follows_the_reference_curve() {
    let mut claim = Claim::new("large strain");
    // Stretch, nominal stress / E and stretch across, from the lattice's own strain energy minimised over the stretch across.
    let bare = [
        (0.6, -0.3105, Some(1.0922)),
        (0.7, -0.2490, Some(1.0714)),
        (0.8, -0.1771, None),
        (0.9, -0.0943, None),
        (1.1, 0.1057, Some(0.9750)),
        (1.2, 0.2225, None),
        (1.3, 0.3499, None),
        (1.5, 0.6328, Some(0.8808)),
    ];
    for (expected, stress, expected_across) in bare {
        let [along, across] = stretch(&pulled(2, 0.25, stress * YOUNG));
        claim.check(tol::LARGE_STRAIN, &format!("nu 0.25 at {expected}"), along / expected - 1.0);
        if let Some(expected_across) = expected_across {
            claim.check(tol::LARGE_STRAIN, &format!("across, at {expected}"), across / expected_across - 1.0);
        }
    }
    let stretches = [0.6, 0.7, 0.8, 0.9, 1.1, 1.2, 1.3, 1.5];
    let volumetric = [
        (0.45, [-0.6153, -0.3812, -0.2230, -0.1033, 0.0998, 0.2028, 0.3122, 0.5539]),
        (0.49, [-0.7657, -0.4329, -0.2377, -0.1058, 0.0985, 0.1987, 0.3050, 0.5397]),
    ];
    for (poisson, stresses) in volumetric {
        for (expected, stress) in stretches.into_iter().zip(stresses) {
            let [along, _] = stretch(&pulled(2, poisson, stress * YOUNG));
            claim.check(tol::LARGE_STRAIN, &format!("nu {poisson} at {expected}"), along / expected - 1.0);
        }
    }
}

/// Edge of the beams' square section, m; they are eight times as long.
pub const BEAM: f64 = 0.02;
pub const BEAM_DENSITY: f64 = 1000.0;

/// A quarter of a cantilever `cells` thick, by its two planes of symmetry: about y = 0 for the width, and about z = 0, across
/// which bending along z is antisymmetric, for the height. The root is softly clamped: it may contract.
pub fn cantilever(cells: usize, poisson: f64, desc: &SimDesc) -> Body {
    let (half, h) = (cells / 2, BEAM / cells as f64);
    let mut build = block([8 * cells, half, half], h, material(YOUNG, poisson, BEAM_DENSITY));
    roller(&mut build, 0);
    roller(&mut build, 1);
    hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true, true, false]);
    hold(&mut build, Vec3::new(0.0, -1.0, 0.0), Vec3::new(0.0, 1.0, 0.0), [false, false, true]);
    Body::new(&build, desc)
}

/// Deflection and slope of a Timoshenko cantilever under unit tip load at x; κ of a rectangle after Cowper (1966).
pub fn timoshenko(poisson: f64, x: f64) -> (f64, f64) {
    let (length, inertia, area) = (8.0 * BEAM, BEAM.powi(4) / 12.0, BEAM * BEAM);
    let shear = 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson) * YOUNG / (2.0 * (1.0 + poisson)) * area;
    let turn = x * (length - 0.5 * x) / (YOUNG * inertia);
    (x * x * (3.0 * length - x) / (6.0 * YOUNG * inertia) + x / shear, turn)
}

#[test]
fn a_cantilever_converges_to_timoshenko_without_locking() {
    let mut claim = Claim::new("cantilever");
    let length = 8.0 * BEAM;
    let first = 3.516 / length.powi(2) * (YOUNG / BEAM_DENSITY / 12.0).sqrt() * BEAM;
    for (poisson, references) in
        [(0.25, [0.778, 0.934, 0.983]), (0.45, [0.824, 0.949, 0.987]), (0.49, [0.830, 0.950, 0.988])]
    {
        let mut ratios = Vec::new();
        for (cells, reference) in [2, 4, 8].into_iter().zip(references) {
            let mut body = cantilever(cells, poisson, &SimDesc { step_s: 0.01, ..dragged(2.0 * first) });
            // So small that deflection does not stretch the axis, which antisymmetry holds.
            let tip = 1e-4 * length;
            let force = tip / timoshenko(poisson, length).0;
            // Starting near the answer leaves little to wait for.
            body.set(|x| {
                let (w, turn) = timoshenko(poisson, x.x);
                (Vec3::new(-x.z * turn, 0.0, w) * (force * reference), Vec3::zeros())
            });
            let traction_pa = Vec3::new(0.0, 0.0, force / (BEAM * BEAM));
            body.sim.add_load(&Load::Traction { region: faces_at(0, length), traction_pa }).unwrap();
            body.steps((5.0 / first / 0.01) as usize);

            let ratio = body.mean_over_plane(0, length, &body.u()).z / tip;
            let name = format!("nu {poisson}, {cells} cells, ratio {ratio:.4}");
            claim.check(tol::BEAM_REFERENCE, &name, ratio - reference);
            ratios.push(ratio);
        }
        assert!(ratios.is_sorted(), "convergence is monotone: {ratios:?}");
        claim.check(tol::BEAM_CONVERGED, &format!("nu {poisson}, 8 cells"), ratios[2] - 1.0);
    }
}

#[test]
fn pressure_on_all_faces_shrinks_a_cube_by_its_bulk_modulus() {
    let mut claim = Claim::new("pressure");
    for poisson in [0.25, 0.45] {
        let tissue = material(YOUNG, poisson, 1000.0);
        let bulk = tissue.lame_lambda_pa() + tissue.shear_modulus_pa() * 2.0 / 3.0;
        let mut body = Body::new(&block([4; 3], H, tissue), &dragged(200.0));
        let everywhere = faces_at(0, 0.0);
        let region = palpate::solver::load::Region { half_extents_m: Vec3::repeat(1.0), ..everywhere };
        body.sim.add_load(&Load::Pressure { region, pressure_pa: 1e-5 * bulk }).unwrap();
        body.steps(300);
        let u = body.u();
        for axis in 0..3 {
            let ends = [0.0, 4.0 * H].map(|at| body.mean_over_plane(axis, at, &u)[axis]);
            let strain = (ends[1] - ends[0]) / (4.0 * H);
            claim.check(tol::MODULI, &format!("nu {poisson}, axis {axis}"), 3.0 * strain / -1e-5 - 1.0);
        }
    }
}

#[test]
fn loads_give_a_free_body_exactly_their_impulse() {
    let mut claim = Claim::new("impulse of loads");
    let tissue = material(YOUNG, 0.45, 1000.0);
    let force_n = Vec3::new(0.01, -0.02, 0.03);
    let traction_pa = Vec3::new(3.0, 4.0, -5.0);
    let loads = [
        ("point", Load::Point { at_m: Vec3::new(0.013, 0.017, 0.021), force_n }, force_n),
        (
            "traction",
            Load::Traction { region: faces_at(2, 4.0 * H), traction_pa },
            traction_pa * 16.0 * H * H,
        ),
    ];
    for (name, load, total) in loads {
        let mut body = Body::new(&block([4; 3], H, tissue.clone()), &exact());
        let id = body.sim.add_load(&load).unwrap();
        body.steps(50);
        let expected = total * 0.05;
        let off = (body.momentum().0 - expected).norm() / expected.norm();
        claim.check(tol::LOAD_IMPULSE, name, off);
        body.sim.remove_load(id).unwrap();
        body.steps(50);
        let off = (body.momentum().0 - expected).norm() / expected.norm();
        claim.check(tol::LOAD_IMPULSE, &format!("{name}, after it is removed"), off);
    }
}

/// A hanging bar: a quarter of a square one by symmetry, hung up by its end x = 0.
fn hanging(gravity: f64, rest_under_gravity: bool) -> Body {
    let mut build = block([32, 2, 2], H, material(YOUNG, 0.4, 1000.0));
    (0..3).for_each(|axis| roller(&mut build, axis));
    let desc = SimDesc { gravity_m_s2: Vec3::new(gravity, 0.0, 0.0), rest_under_gravity, ..exact() };
    Body::new(&build, &desc)
}

#[test]
fn a_hanging_bar_sags_by_half_its_weight_and_settles_there() {
    let mut claim = Claim::new("gravity");
    let (gravity, length) = (0.01, 32.0 * H);
    let mut body = hanging(gravity, false);
    let left = body.sim.settle(1e-4 * gravity, 200_000).unwrap();
    claim.check(tol::SETTLED, "largest acceleration left / g", left / gravity);
    let sag = 1000.0 * gravity * length * length / (2.0 * YOUNG);
    let tip = body.mean_over_plane(0, length, &body.u()).x;
    claim.check(tol::SAG, "tip", tip / sag - 1.0);

    // Settled means settled: it does not move on.
    assert_eq!(body.v().iter().map(Vec3::norm).fold(0.0, f64::max), 0.0);
    body.steps(500);
    let moved = (body.mean_over_plane(0, length, &body.u()).x - tip).abs();
    claim.check(tol::SETTLED_MOTION, "motion after settling / sag", moved / sag);
}

#[test]
fn a_rest_shape_under_gravity_does_not_sag_until_gravity_changes() {
    let mut body = hanging(9.81, true);
    body.steps(100);
    assert!(body.u().iter().all(|u| *u == Vec3::zeros()));
    body.sim.set_gravity(Vec3::new(0.0, 0.0, 0.0)).unwrap();
    body.steps(5);
    // Without its weight the bar shortens.
    assert!(body.mean_over_plane(0, 32.0 * H, &body.u()).x < 0.0);
}
