//! The meshless model: statics, how its steps end what swings, and contact inside them.

use std::sync::Arc;

use palpate::cpu::efg::route::EfgReal;
use palpate::cpu::efg::solver::EfgSolver;
use palpate::error::Error;
use palpate::math::{Mat3, Pose, Quat, Vec3};
use palpate::model::efg::energy::elastic_j;
use palpate::model::{Build, LabelUse, Model};
use palpate::sim::{Precision, SimDesc};
use palpate::solver::Solver;
use palpate::solver::load::Load;
use palpate::solver::method::{EfgDesc, Elasticity, Method, Rows, Scheme};
use palpate::solver::tool::ToolDesc;

use super::elastic::{BEAM, cantilever, timoshenko};
use super::scene::{
    Body, Noise, block, exact, faces_at, hold, material, ragged, roller, step_to, touch_flat_top, voxels,
};
use super::tolerance::{self as tol, Claim};

const H: f64 = 0.01;
const YOUNG: f64 = 1e4;

/// Solved as far as double precision goes, in steps so long that tissue rests after a few.
fn statics(elasticity: Elasticity) -> SimDesc {
    let method = EfgDesc { elasticity, tolerance: 1e-9, max_iterations: 5000, ..EfgDesc::default() };
    SimDesc { method: Method::Efg(method), step_s: 1.0, ..exact() }
}

fn model(build: &Build) -> Arc<Model> {
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// Nodal forces of a displacement field, and the largest displacement.
fn forces<R: EfgReal>(
    model: &Arc<Model>,
    elasticity: Elasticity,
    u: impl Fn(Vec3) -> Vec3,
) -> (Vec<Vec3>, f64) {
    forces_of::<R>(model, EfgDesc { elasticity, ..EfgDesc::default() }, u)
}

fn forces_of<R: EfgReal>(
    model: &Arc<Model>,
    desc: EfgDesc,
    mut u: impl FnMut(Vec3) -> Vec3,
) -> (Vec<Vec3>, f64) {
    let lattice = model.lattice();
    let mut solver = EfgSolver::<R>::new(model, &desc, 1, 0).unwrap();
    let mut furthest = 0.0_f64;
    for slot in lattice.slots() {
        let moved = u(lattice.rest_position(slot));
        furthest = furthest.max(moved.norm());
        solver.set_node(slot, moved, Vec3::zeros());
    }
    let mass = |slot| lattice.node_mass(slot, |m| model.laws()[usize::from(m)].corner_kg);
    // Rotations are found from where they were: a few times for those that were at rest.
    (0..8).for_each(|_| drop(solver.accelerations()));
    let a = solver.accelerations();
    (lattice.slots().map(|slot| a[slot as usize] * mass(slot)).collect(), furthest)
}

#[test]
fn a_rotated_body_feels_no_force_unless_it_is_linear() {
    let mut claim = Claim::new("EFG rotation");
    let tissue = material(YOUNG, 0.45, 1000.0);
    let stiff = (2.0 * tissue.shear_modulus_pa() + tissue.lame_lambda_pa()) / YOUNG;
    let model = model(&block([9, 5, 4], H, tissue));
    let mut noise = Noise(5);
    let largest = |f: &[Vec3]| f.iter().map(Vec3::norm).fold(0.0, f64::max);
    for elasticity in [Elasticity::Corotated, Elasticity::StVenantKirchhoff] {
        for case in 0..4 {
            let rotation = Quat::from_scaled_axis(noise.vec3() * 1.5);
            let shift = noise.vec3() * H;
            let turned = |x: Vec3| rotation * x + shift - x;
            let unit = |u: f64| stiff * (u / H) * YOUNG * H * H;
            let (f, u) = forces::<f32>(&model, elasticity, turned);
            claim.check(tol::ROTATION_F32, &format!("{elasticity:?}, single, {case}"), largest(&f) / unit(u));
            let (f, u) = forces::<f64>(&model, elasticity, turned);
            claim.check(tol::ROTATION_F64, &format!("{elasticity:?}, double, {case}"), largest(&f) / unit(u));
        }
    }
    let turned = |x: Vec3| Quat::from_scaled_axis(Vec3::z() * 0.35) * x - x;
    let (f, _) = forces::<f64>(&model, Elasticity::Linear, turned);
    assert!(largest(&f) > 0.01 * YOUNG * H * H, "a linear body is strained by cos 0.35 - 1");
}

#[test]
fn affine_strain_pulls_free_surfaces_with_its_stress_and_stores_its_energy() {
    let mut claim = Claim::new("EFG affine");
    let tissue = material(YOUNG, 0.45, 1000.0);
    let model = model(&block([9, 5, 4], H, tissue.clone()));
    let lattice = model.lattice();
    let mut noise = Noise(11);
    for elasticity in [Elasticity::Corotated, Elasticity::Linear, Elasticity::StVenantKirchhoff] {
        let gradient = Mat3::from_fn(|_, _| 1e-7 * noise.next());
        let strain = 0.5 * (gradient + gradient.transpose());
        let sigma = Mat3::identity() * (tissue.lame_lambda_pa() * strain.trace())
            + strain * (2.0 * tissue.shear_modulus_pa());
        let (found, _) = forces::<f64>(&model, elasticity, |x| gradient * x);
        let scale = sigma.norm() * H * H;
        let off = lattice.slots().zip(&found).map(|(slot, f)| {
            // Each cell around the node pulls by its stress through a quarter of three faces.
            let word = lattice.words()[slot as usize];
            let cells = (0..8).filter(|c| word >> (4 * c) & 15 != 0);
            let outward: Vec3 = cells
                .map(|c: u32| Vec3::from_fn(|a, _| if c >> a & 1 == 1 { 1.0 } else { -1.0 } * H * H / 4.0))
                .sum();
            (f - sigma * outward).norm() / scale
        });
        claim.check(tol::AFFINE_FORCE, &format!("{elasticity:?}, forces"), off.fold(0.0, f64::max));
        let stored = elastic_j(lattice, model.laws(), elasticity, |s| gradient * lattice.rest_position(s));
        let expected = 0.5 * sigma.component_mul(&strain).sum() * lattice.cell_count() as f64 * H.powi(3);
        claim.check(tol::AFFINE_ENERGY, &format!("{elasticity:?}, energy"), stored / expected - 1.0);
    }
}

#[test]
fn forces_are_the_slope_of_the_energy() {
    let mut claim = Claim::new("EFG potential");
    let model = model(&block([4, 3, 3], H, material(YOUNG, 0.45, 1000.0)));
    let lattice = model.lattice();
    for elasticity in [Elasticity::Corotated, Elasticity::Linear, Elasticity::StVenantKirchhoff] {
        let mut noise = Noise(21);
        let bent: Vec<Vec3> = (0..lattice.slot_count()).map(|_| noise.vec3() * 0.05 * H).collect();
        let way: Vec<Vec3> = (0..lattice.slot_count()).map(|_| noise.vec3()).collect();
        let step = 1e-6 * H;
        let at =
            |t: f64| elastic_j(lattice, model.laws(), elasticity, |s| bent[s as usize] + way[s as usize] * t);
        let slope = (at(step) - at(-step)) / (2.0 * step);
        let place = |x: Vec3| {
            let slot = lattice.slot([0, 1, 2].map(|a| (x[a] / H).round() as usize)).unwrap();
            bent[slot as usize]
        };
        let (found, _) = forces::<f64>(&model, elasticity, place);
        let work: f64 = lattice.slots().zip(&found).map(|(slot, f)| f.dot(&way[slot as usize])).sum();
        claim.check(tol::POTENTIAL, &format!("{elasticity:?}"), work / slope + 1.0);
    }
}

#[test]
fn uniform_traction_recovers_youngs_modulus_and_poissons_ratio() {
    let mut claim = Claim::new("EFG uniaxial");
    for poisson in [0.25, 0.40, 0.45, 0.49] {
        let cells = 4;
        let mut build = block([cells; 3], H, material(YOUNG, poisson, 1000.0));
        (0..3).for_each(|axis| roller(&mut build, axis));
        let mut body = Body::new(&build, &statics(Elasticity::Corotated));
        let length = cells as f64 * H;
        let traction_pa = Vec3::x() * (1e-4 * YOUNG);
        body.sim.add_load(&Load::Traction { region: faces_at(0, length), traction_pa }).unwrap();
        body.steps(4);
        let u = body.u();
        let [along, across] = [0, 1].map(|axis| body.mean_over_plane(axis, length, &u)[axis] / length);
        claim.check(tol::MODULI, &format!("E at nu {poisson}"), 1e-4 / along - 1.0);
        claim.check(tol::MODULI, &format!("nu {poisson}"), -across / along / poisson - 1.0);
    }
}

#[test]
fn a_cantilever_converges_to_timoshenko_without_locking_or_hourglass() {
    let mut claim = Claim::new("EFG cantilever");
    let length = 8.0 * BEAM;
    for (poisson, references) in [
        (0.25, [1.063, 1.015, 1.005]),
        (0.40, [1.070, 1.017, 1.005]),
        (0.45, [1.071, 1.016, 1.005]),
        (0.49, [1.070, 1.016, 1.005]),
    ] {
        let mut ratios = Vec::new();
        for (cells, reference) in [2, 4, 8].into_iter().zip(references) {
            let mut body = cantilever(cells, poisson, &statics(Elasticity::Corotated));
            let tip = 1e-4 * length;
            let force = tip / timoshenko(poisson, length).0;
            let traction_pa = Vec3::z() * (force / (BEAM * BEAM));
            body.sim.add_load(&Load::Traction { region: faces_at(0, length), traction_pa }).unwrap();
            body.steps(6);
            let ratio = body.mean_over_plane(0, length, &body.u()).z / tip;
            let name = format!("nu {poisson}, {cells} cells, ratio {ratio:.4}");
            claim.check(tol::BEAM_REFERENCE, &name, ratio - reference);
            ratios.push(ratio);
        }
        assert!(ratios.is_sorted_by(|a, b| a >= b), "convergence is monotone: {ratios:?}");
        claim.check(tol::BEAM_CONVERGED, &format!("nu {poisson}, 8 cells"), ratios[2] - 1.0);
    }
}

/// One cell that can only stretch along x: an oscillator. Its (ω dt)², and a body that swings.
fn oscillator(scheme: Scheme, dt: f64) -> (f64, Body) {
    let tissue = material(YOUNG, 0.3, 1000.0);
    let modulus = tissue.lame_lambda_pa() + 2.0 * tissue.shear_modulus_pa();
    // Half the mass swings on a bar of one cell.
    let omega2 = 2.0 * modulus / (1000.0 * H * H);
    let mut build = block([1; 3], H, tissue);
    roller(&mut build, 0);
    hold(&mut build, Vec3::repeat(-1.0), Vec3::repeat(1.0), [false, true, true]);
    let method = EfgDesc { elasticity: Elasticity::Linear, scheme, tolerance: 1e-12, ..EfgDesc::default() };
    let desc = SimDesc { method: Method::Efg(method), step_s: dt, ..exact() };
    let mut body = Body::new(&build, &desc);
    body.set(|x| (Vec3::x() * (1e-6 * x.x / H), Vec3::zeros()));
    (omega2 * dt * dt, body)
}

#[test]
fn backward_euler_loses_its_share_of_amplitude_in_each_step() {
    let mut claim = Claim::new("backward Euler");
    for dt in [1e-4, 1e-3, 1e-2] {
        let (s, mut body) = oscillator(Scheme::BackwardEuler, dt);
        for step in 0..5 {
            let before = body.total_energy();
            body.steps(1);
            let lost = body.total_energy() / before * (1.0 + s);
            claim.check(tol::STEP_LOSS, &format!("dt {dt}, step {step}"), lost - 1.0);
        }
    }
}

#[test]
fn the_papers_scheme_damps_nothing_and_slows_what_is_fast() {
    let mut claim = Claim::new("paper's scheme");
    for dt in [1e-4, 1e-3, 1e-2] {
        let (s, mut body) = oscillator(Scheme::Paper, dt);
        let far = |body: &Body| body.mean_over_plane(0, H, &body.u()).x;
        let mut u = vec![far(&body)];
        for _ in 0..50 {
            body.steps(1);
            u.push(far(&body));
        }
        // A matrix of determinant 1 and this trace moves (u, v).
        let trace = 1.0 + 1.0 / (1.0 + s);
        for n in 1..50 {
            let left = u[n + 1] - trace * u[n] + u[n - 1];
            claim.check(tol::STEP_LOSS, &format!("dt {dt}, step {n}"), left / 1e-6);
        }
    }
}

#[test]
fn momentum_of_a_free_body_is_kept() {
    let mut claim = Claim::new("EFG momentum");
    let method = EfgDesc { tolerance: 1e-10, max_iterations: 1000, ..EfgDesc::default() };
    let desc = SimDesc { method: Method::Efg(method), ..exact() };
    let mut body = Body::new(&block([5, 4, 3], H, material(YOUNG, 0.45, 1000.0)), &desc);
    let mut noise = Noise(3);
    let kicks: Vec<Vec3> = body.slots.iter().map(|_| noise.vec3() * 0.1).collect();
    let mut at = 0;
    for (&slot, kick) in body.slots.iter().zip(&kicks) {
        body.sim.set_node(slot, Vec3::zeros(), *kick).unwrap();
        at += 1;
    }
    assert_eq!(at, kicks.len());
    let (before, size) = body.momentum();
    body.steps(200);
    claim.check(tol::IMPLICIT_MOMENTUM, "linear", (body.momentum().0 - before).norm() / size);
}

/// A quarter of a block with a flat top, to be pressed by a ball on its axis; and its height.
fn pressable(cells: [usize; 3], h: f64) -> (Build, f64) {
    let mut build = block(cells, h, material(YOUNG, 0.45, 1000.0));
    roller(&mut build, 0);
    roller(&mut build, 1);
    hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
    touch_flat_top(&mut build, cells, h);
    (build, cells[2] as f64 * h)
}

#[test]
fn a_ball_in_tissue_is_felt_as_hertz_says_whether_it_moves_or_stands() {
    let mut claim = Claim::new("EFG indentation");
    let (radius, depth) = (0.010, 0.6e-3);
    let (build, top) = pressable([24, 24, 24], 0.6e-3);
    let method = EfgDesc {
        elasticity: Elasticity::Linear,
        tolerance: 1e-4,
        max_iterations: 3000,
        ..EfgDesc::default()
    };
    let desc = SimDesc { method: Method::Efg(method), step_s: 0.05, threads: 2, ..exact() };
    let mut body = Body::new(&build, &desc);
    let mut tool = body.sim.add_tool(&ToolDesc { friction: 0.0, ..ToolDesc::sphere(radius) }).unwrap();
    let hertz = 4.0 / 3.0 * YOUNG / (1.0 - 0.45 * 0.45) * radius.sqrt() / 4.0;
    for step in 1..=5 {
        let deep = depth * (f64::from(step) / 3.0).min(1.0);
        let felt = step_to(&mut body, &mut tool, Vec3::new(0.0, 0.0, top + radius - deep)).wrench.force_n;
        claim.check(tol::EFG_INDENTATION, &format!("step {step}"), felt.z / (hertz * deep.powf(1.5)) - 1.0);
        let contacts = body.sim.contacts(tool.id()).unwrap();
        let pushed: Vec3 = contacts.iter().map(|contact| contact.force_n).sum();
        claim.check(
            tol::THIRD_LAW_F64,
            &format!("third law, step {step}"),
            (pushed + felt).norm() / felt.norm(),
        );
    }
    // And it lets go.
    let felt = step_to(&mut body, &mut tool, Vec3::new(0.0, 0.0, top + radius + 1e-3)).wrench.force_n;
    assert_eq!(felt, Vec3::zeros());
}

#[test]
fn what_a_tool_gives_is_what_tissue_gains() {
    let mut claim = Claim::new("EFG third law");
    let method = EfgDesc { tolerance: 1e-10, max_iterations: 5000, ..EfgDesc::default() };
    let desc = SimDesc { method: Method::Efg(method), ..exact() };
    let mut body = Body::new(&block([6, 6, 4], H, material(YOUNG, 0.45, 1000.0)), &desc);
    let mut tool = body.sim.add_tool(&ToolDesc { friction: 0.4, ..ToolDesc::sphere(0.02) }).unwrap();
    let mut given = Vec3::zeros();
    for step in 0..60 {
        // Onto a free body from above, and aside.
        let at = Vec3::new(0.025 + 2e-4 * f64::from(step), 0.03, 0.061 - 1e-4 * f64::from(step));
        given -= step_to(&mut body, &mut tool, at).wrench.force_n * 1e-3;
    }
    let (gained, size) = body.momentum();
    assert!(size > 1e-4, "the body was pushed: {size}");
    claim.check(tol::THIRD_LAW_F64, "impulse of the tool", (gained - given).norm() / size);
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let (build, top) = pressable([20, 12, 8], 2e-3);
    let model = model(&build);
    let of = |threads: usize| {
        let method = Method::Efg(EfgDesc::default());
        let desc = SimDesc { method, threads, precision: Precision::Single, ..exact() };
        let mut body = Body::of(&model, &desc);
        let mut tool = body.sim.add_tool(&ToolDesc { friction: 0.3, ..ToolDesc::sphere(6e-3) }).unwrap();
        let felt = (0..20).map(|step| {
            step_to(&mut body, &mut tool, Vec3::new(0.0, 0.0, top + 6e-3 - 1e-4 * f64::from(step))).wrench
        });
        let felt: Vec<_> = felt.collect();
        (felt, body.u())
    };
    let alone = of(1);
    assert!(alone.0.last().unwrap().force_n.norm() > 0.0);
    assert!(alone == of(2) && alone == of(3));
}

#[test]
fn rows_for_all_cells_give_the_forces_of_cells_without() {
    let mut claim = Claim::new("EFG rows");
    let tissue = [material(YOUNG, 0.45, 1000.0), material(5.0 * YOUNG, 0.3, 1100.0)];
    let model = model(&ragged([11, 9, 6], H, 4, 0.7, tissue));
    for elasticity in [Elasticity::Corotated, Elasticity::Linear, Elasticity::StVenantKirchhoff] {
        let of = |rows: Rows| {
            let mut noise = Noise(31);
            let turn = Quat::from_scaled_axis(Vec3::new(0.2, -0.5, 0.3));
            let desc = EfgDesc { elasticity, rows, ..EfgDesc::default() };
            forces_of::<f64>(&model, desc, |x| turn * x - x + noise.vec3() * 0.05 * H).0
        };
        let (without, with) = (of(Rows::Irregular), of(Rows::All));
        let largest = without.iter().map(Vec3::norm).fold(0.0, f64::max);
        let off = without.iter().zip(&with).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        claim.check(tol::ROUNDING, &format!("{elasticity:?}"), off / largest);
    }
}

#[test]
fn rows_for_all_cells_give_the_steps_of_cells_without() {
    let mut claim = Claim::new("EFG rows, steps");
    let (build, top) = pressable([7, 6, 5], 2e-3);
    let model = model(&build);
    let of = |rows: Rows, threads: usize| {
        let method =
            Method::Efg(EfgDesc { rows, tolerance: 1e-11, max_iterations: 2000, ..EfgDesc::default() });
        let mut body = Body::of(&model, &SimDesc { method, threads, ..exact() });
        let mut tool = body.sim.add_tool(&ToolDesc { friction: 0.3, ..ToolDesc::sphere(6e-3) }).unwrap();
        for step in 0..15 {
            step_to(&mut body, &mut tool, Vec3::new(0.0, 0.0, top + 6e-3 - 1e-4 * f64::from(step)));
        }
        let statistics = body.sim.statistics();
        assert!(statistics.contact_points > 0);
        (body.u(), statistics)
    };
    let ((without, seen), (with, also_seen)) = (of(Rows::Irregular, 1), of(Rows::All, 1));
    let largest = without.iter().map(Vec3::norm).fold(0.0, f64::max);
    let off = without.iter().zip(&with).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
    claim.check(tol::ROWS_STEPS, "displacements", off / largest);
    claim.check(tol::ROWS_SEEN, "strain", also_seen.max_strain / seen.max_strain - 1.0);
    for (a, b) in seen.volume_ratio.into_iter().zip(also_seen.volume_ratio) {
        claim.check(tol::ROWS_SEEN, "volume ratio", b - a);
    }
    // Rows were copied, and copied once.
    assert_eq!(seen.copied.to_device, 0);
    assert!(also_seen.copied.to_device > 210 * 20 * 60, "{:?}", also_seen.copied);
    assert!(with == of(Rows::All, 3).0, "the number of threads changes no bit");
}

#[test]
fn single_precision_reaches_its_tolerance_and_says_so() {
    let mut claim = Claim::new("EFG single precision");
    let (build, top) = pressable([16, 16, 10], 2e-3);
    let model = model(&build);
    let of = |precision| {
        let method = Method::Efg(EfgDesc { tolerance: 1e-4, ..EfgDesc::default() });
        let mut body = Body::of(&model, &SimDesc { method, precision, ..exact() });
        let mut tool = body.sim.add_tool(&ToolDesc { friction: 0.0, ..ToolDesc::sphere(8e-3) }).unwrap();
        let (mut felt, mut left) = (0.0, 0.0_f64);
        for step in 0..40 {
            felt = step_to(&mut body, &mut tool, Vec3::new(0.0, 0.0, top + 8e-3 - 5e-5 * f64::from(step)))
                .wrench
                .force_n
                .z;
            left = left.max(body.sim.statistics().true_residual);
        }
        (felt, left)
    };
    let ((single, left), (double, _)) = (of(Precision::Single), of(Precision::Double));
    claim.check(tol::TRUE_RESIDUAL, "true residual", left);
    claim.check(tol::SINGLE_FORCE, "force", single / double - 1.0);
}

#[test]
fn a_hanging_bar_settles_at_half_its_weight() {
    let mut claim = Claim::new("EFG gravity");
    let (gravity, length) = (0.01, 32.0 * H);
    let mut build = block([32, 2, 2], H, material(YOUNG, 0.4, 1000.0));
    (0..3).for_each(|axis| roller(&mut build, axis));
    let method = Method::Efg(EfgDesc { tolerance: 1e-6, max_iterations: 5000, ..EfgDesc::default() });
    let gravity_m_s2 = Vec3::x() * gravity;
    let desc = SimDesc { method, gravity_m_s2, rest_under_gravity: false, ..exact() };
    let mut body = Body::new(&build, &desc);
    let left = body.sim.settle(1e-4 * gravity, 100).unwrap();
    claim.check(tol::SETTLED, "largest acceleration left / g", left / gravity);
    let sag = 1000.0 * gravity * length * length / (2.0 * YOUNG);
    claim.check(tol::SAG, "tip", body.mean_over_plane(0, length, &body.u()).x / sag - 1.0);
    assert!(body.v().iter().all(|v| *v == Vec3::zeros()));
}

/// A block with a rigid block in its middle third, held at its base.
fn with_bone() -> Build {
    let label = |cell: [usize; 3]| if cell.iter().all(|&i| (3..6).contains(&i)) { 2 } else { 1 };
    let bone = LabelUse::Rigid(material(1e9, 0.3, 1900.0));
    let uses = [(1, LabelUse::Tissue(material(YOUNG, 0.45, 1000.0))), (2, bone)];
    let mut build = voxels([9; 3], H, label, &uses);
    hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
    build
}

#[test]
fn a_driven_bone_stays_where_it_was_taken() {
    let mut body = Body::new(&with_bone(), &SimDesc { method: Method::Efg(EfgDesc::default()), ..exact() });
    let way = Vec3::new(2e-3, 0.0, 1e-3);
    body.sim.drive_region(2, &Pose::translation(way.x, way.y, way.z)).unwrap();
    body.steps(20);
    let slots = body.sim.model().regions()[&2].clone();
    let u = body.u();
    for (slot, u) in body.slots.iter().zip(&u).filter(|(slot, _)| slots.contains(slot)) {
        assert!((u - way).norm() < 1e-12, "slot {slot} is at {u}");
    }
    let pulled = u.iter().map(Vec3::norm).sum::<f64>();
    assert!(pulled > way.norm() * slots.len() as f64 * 1.5, "tissue comes along");
}

#[test]
fn bone_is_as_stiff_a_wall_whatever_the_step() {
    let mut claim = Claim::new("EFG wall");
    let felt = |dt: f64| {
        let mut build = voxels([4; 3], H, |_| 2, &[(2, LabelUse::Rigid(material(1e9, 0.3, 1900.0)))]);
        build.uses.insert(1, LabelUse::Tissue(material(YOUNG, 0.45, 1000.0)));
        build.grid = palpate::model::grid::LabelGrid::new(
            [4; 3],
            Vec3::repeat(H),
            Pose::translation(0.5 * H, 0.5 * H, 0.5 * H),
            (0..64).map(|n| if n < 16 { 1 } else { 2 }).collect(),
        )
        .unwrap();
        touch_flat_top(&mut build, [4; 3], H);
        let mut body =
            Body::new(&build, &SimDesc { step_s: dt, method: Method::Efg(EfgDesc::default()), ..exact() });
        let mut tool = body.sim.add_tool(&ToolDesc { friction: 0.0, ..ToolDesc::sphere(0.01) }).unwrap();
        let at = Vec3::new(0.02, 0.02, 4.0 * H + 0.01 - 1e-3);
        (0..3).map(|_| step_to(&mut body, &mut tool, at).wrench.force_n.z).last().unwrap()
    };
    let (short, long) = (felt(1e-3), felt(0.1));
    assert!(short > 1e-3 * 10.0 * YOUNG * H, "{short} N: stiffer than tissue");
    claim.check(tol::ROUNDING, "force at 1 ms and 100 ms", short / long - 1.0);
}

#[test]
fn to_ask_for_energy_changes_nothing_that_follows() {
    let of = |asks: bool| {
        let mut body =
            Body::new(&with_bone(), &SimDesc { method: Method::Efg(EfgDesc::default()), ..exact() });
        body.set(|x| (Vec3::new(0.0, 0.1 * x.z * x.z, 0.0), Vec3::x()));
        for _ in 0..5 {
            if asks {
                body.total_energy();
            }
            body.steps(1);
        }
        body.u()
    };
    assert!(of(true) == of(false));
}

#[test]
fn contacts_are_finite_after_a_material_changes_and_implicit_steps_stay_stable() {
    let (build, top) = pressable([8, 8, 6], 2e-3);
    let mut body = Body::new(&build, &SimDesc { method: Method::Efg(EfgDesc::default()), ..exact() });
    let mut tool = body.sim.add_tool(&ToolDesc { friction: 0.0, ..ToolDesc::sphere(6e-3) }).unwrap();
    for n in 0..5 {
        step_to(&mut body, &mut tool, Vec3::new(0.0, 0.0, top + 6e-3 - 1e-4 * f64::from(n)));
    }
    body.sim.set_material(1, &material(1e9, 0.45, 1000.0)).unwrap();
    let contacts = body.sim.contacts(tool.id()).unwrap();
    assert!(!contacts.is_empty() && contacts.iter().all(|contact| contact.force_n.norm() < 10.0));
    assert_eq!(body.sim.statistics().stable_substep_s, f64::INFINITY);
    body.steps(3);
}

#[test]
fn a_step_that_leads_nowhere_finite_is_not_taken() {
    let (build, _) = pressable([4, 4, 4], 2e-3);
    let method = Method::Efg(EfgDesc::default());
    let mut body = Body::new(&build, &SimDesc { method, precision: Precision::Single, ..exact() });
    body.steps(1);
    let slot = *body.slots.last().unwrap();
    body.sim.set_node(slot, Vec3::zeros(), Vec3::repeat(1e30)).unwrap();
    let error = body.sim.step().unwrap_err();
    assert!(matches!(error, Error::Diverged { .. }), "{error}");
    assert!(body.u().iter().chain(&body.v()).all(|x| *x == Vec3::zeros()));
    body.sim.reset();
    body.steps(1);
}
