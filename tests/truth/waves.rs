//! Dynamics: momentum, energy, frequencies, wave speeds, the stable step.

use palpate::math::Vec3;
use palpate::model::{Build, LabelUse};
use palpate::sim::{Precision, SimDesc};

use palpate::cpu::solver::CpuSolver;
use palpate::solver::Solver;

use super::elastic::{BEAM, BEAM_DENSITY, cantilever, timoshenko};
use super::scene::{Body, Noise, block, exact, hold, material, ragged, voxels, with_dt};
use super::tolerance::{self as tol, Claim};

const H: f64 = 0.01;
const YOUNG: f64 = 1e4;
const DENSITY: f64 = 1000.0;

#[test]
fn a_free_body_keeps_its_momentum_and_angular_momentum() {
    let mut claim = Claim::new("momentum");
    for (precision, limits) in [
        (Precision::Single, [tol::MOMENTUM_F32, tol::ANGULAR_F32]),
        (Precision::Double, [tol::MOMENTUM_F64, tol::ANGULAR_F64]),
    ] {
        for damping_s in [0.0, 1e-4] {
            let mut tissue = material(YOUNG, 0.4, DENSITY);
            tissue.damping_s = damping_s;
            // One hundred thousand substeps.
            let desc = SimDesc { precision, step_s: 0.1, substeps: Some(100), ..exact() };
            let mut body = Body::new(&block([3; 3], H, tissue), &desc);
            let mut noise = Noise(3);
            let kicks: Vec<Vec3> = body.rest.iter().map(|_| noise.vec3() * 0.02).collect();
            let spin = Vec3::new(0.5, -0.3, 0.8);
            for i in 0..kicks.len() {
                let x = body.rest[i] - Vec3::repeat(1.5 * H);
                let v = kicks[i] + spin.cross(&x) + Vec3::new(1e-3, 0.0, -1e-3);
                body.sim.set_node(body.slots[i], Vec3::zeros(), v).unwrap();
            }
            let (start, size) = body.momentum();
            let (turn, turn_size) = body.angular_momentum();
            body.steps(1000);
            let name = format!("{precision:?}, damping {damping_s} s");
            claim.check(limits[0], &name, (body.momentum().0 - start).norm() / size);
            claim.check(
                limits[1],
                &format!("{name}, angular"),
                (body.angular_momentum().0 - turn).norm() / turn_size,
            );
        }
    }
}

/// Kinetic and elastic energy over a run from a smooth stretch: largest swing about its mean, and drift from first to last tenth.
fn energy_swing(dt: f64, substeps: u32, steps: usize) -> [f64; 2] {
    let desc = SimDesc { step_s: dt * f64::from(substeps), substeps: Some(substeps), ..exact() };
    let mut body = Body::new(&block([4, 3, 3], H, material(YOUNG, 0.4, DENSITY)), &desc);
    // The lowest longitudinal mode, or nearly.
    body.set(|x| {
        (Vec3::new(-0.01 * H * (std::f64::consts::PI * x.x / (4.0 * H)).cos(), 0.0, 0.0), Vec3::zeros())
    });
    let energies: Vec<f64> = (0..steps)
        .map(|_| {
            body.steps(1);
            body.total_energy()
        })
        .collect();
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let middle = mean(&energies);
    let swing = energies.iter().map(|e| (e / middle - 1.0).abs()).fold(0.0, f64::max);
    let tenth = steps / 10;
    [swing, mean(&energies[steps - tenth..]) / mean(&energies[..tenth]) - 1.0]
}

#[test]
fn energy_swings_with_the_square_of_the_step_and_does_not_drift() {
    let mut claim = Claim::new("energy");
    let dt = 0.1 * H / material(YOUNG, 0.4, DENSITY).longitudinal_speed_m_s();
    let [coarse, _] = energy_swing(dt, 1, 3000);
    let [fine, _] = energy_swing(0.5 * dt, 2, 3000);
    claim.check(tol::ENERGY_SWING, "largest swing / mean", fine);
    claim.check(tol::ENERGY_ORDER, "halving the step quarters the swing", coarse / fine / 4.0 - 1.0);
    let [_, drift] = energy_swing(0.5 * dt, 100, 2000);
    claim.check(tol::ENERGY_DRIFT, "drift over 200,000 substeps", drift);
}

/// Lowest bending frequency of a Timoshenko cantilever in rad/s: shooting from the root, for the end to be free.
pub fn timoshenko_frequency(poisson: f64) -> f64 {
    let (length, inertia, area) = (8.0 * BEAM, BEAM.powi(4) / 12.0, BEAM * BEAM);
    let shear = 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson) * YOUNG / (2.0 * (1.0 + poisson)) * area;
    let bending = YOUNG * inertia;
    // Deflection, turn, moment and shear force along the beam.
    let slope = |y: [f64; 4], omega: f64| {
        let inertial = BEAM_DENSITY * omega * omega;
        [y[3] / shear + y[1], y[2] / bending, -y[3] - inertial * inertia * y[1], -inertial * area * y[0]]
    };
    let end = |mut y: [f64; 4], omega: f64| {
        let n = 400;
        let dx = length / f64::from(n);
        let plus = |y: [f64; 4], k: [f64; 4], s: f64| std::array::from_fn(|i| y[i] + s * k[i]);
        for _ in 0..n {
            let a = slope(y, omega);
            let b = slope(plus(y, a, 0.5 * dx), omega);
            let c = slope(plus(y, b, 0.5 * dx), omega);
            let d = slope(plus(y, c, dx), omega);
            y = std::array::from_fn(|i| y[i] + dx / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
        }
        (y[2], y[3])
    };
    let unbalanced = |omega: f64| {
        let (one, two) = (end([0.0, 0.0, 1.0, 0.0], omega), end([0.0, 0.0, 0.0, 1.0], omega));
        one.0 * two.1 - one.1 * two.0
    };
    let slender = 1.875_104_f64.powi(2) / length.powi(2) * (bending / (BEAM_DENSITY * area)).sqrt();
    let (mut low, mut high) = (0.5 * slender, 1.1 * slender);
    assert!(unbalanced(low) * unbalanced(high) < 0.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if unbalanced(low) * unbalanced(middle) > 0.0 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[test]
fn a_cantilever_swings_at_the_frequency_of_timoshenko() {
    let mut claim = Claim::new("bending frequency");
    for poisson in [0.25, 0.45] {
        let expected = timoshenko_frequency(poisson);
        let mut offs = Vec::new();
        for cells in [4, 8] {
            let step_s = 0.005 / expected;
            let mut body = cantilever(cells, poisson, &SimDesc { step_s, ..exact() });
            let tip = 1e-4 * 8.0 * BEAM;
            let scale = tip / timoshenko(poisson, 8.0 * BEAM).0;
            let shape = |x: Vec3| {
                let (w, turn) = timoshenko(poisson, x.x);
                Vec3::new(-x.z * turn, 0.0, w) * scale
            };
            body.set(|x| (shape(x), Vec3::zeros()));
            // The amplitude of the released shape: the mass matrix keeps the higher modes out of it.
            let amplitude = |body: &Body| -> f64 {
                let u = body.u();
                (0..u.len()).map(|i| body.mass[i] * shape(body.rest[i]).dot(&u[i])).sum()
            };
            let (mut crossings, mut before) = (Vec::new(), amplitude(&body));
            for step in 1.. {
                body.steps(1);
                let now = amplitude(&body);
                if now * before < 0.0 {
                    crossings.push(f64::from(step) - now / (now - before));
                    if crossings.len() == 3 {
                        break;
                    }
                }
                before = now;
            }
            let found = 2.0 * std::f64::consts::PI / ((crossings[2] - crossings[0]) * step_s);
            let name = format!("nu {poisson}, {cells} cells, ratio {:.4}", found / expected);
            let limit = if cells == 8 { tol::FREQUENCY_8 } else { tol::FREQUENCY_4 };
            claim.check(limit, &name, found / expected - 1.0);
            offs.push((found / expected - 1.0).abs());
        }
        assert!(offs[1] < offs[0], "finer is better: {offs:?}");
    }
}

/// A bar of `cells` that can move along its axis alone: exactly a chain with C₁₁ h springs and ρ h³ masses.
fn chain(cells: usize, poisson: f64) -> Build {
    let mut build = block([cells, 1, 1], H, material(YOUNG, poisson, DENSITY));
    hold(&mut build, Vec3::repeat(-1.0), Vec3::repeat(10.0), [false, true, true]);
    build
}

#[test]
fn waves_along_an_axis_obey_the_dispersion_of_leapfrog_exactly() {
    let mut claim = Claim::new("dispersion");
    for (poisson, cells, half_waves) in [(0.25, 40, 4), (0.25, 40, 20), (0.45, 40, 4), (0.49, 20, 13)] {
        let speed = material(YOUNG, poisson, DENSITY).longitudinal_speed_m_s();
        let dt = 0.8 * H / speed;
        let mut body = Body::new(&chain(cells, poisson), &with_dt(dt));
        let q = f64::from(half_waves) * std::f64::consts::PI / (cells as f64 * H);
        let amplitude = 1e-8 * H;
        body.set(|x| (Vec3::new(amplitude * (q * x.x).cos(), 0.0, 0.0), Vec3::zeros()));
        // sin(ω dt / 2) = (c dt / h) sin(q h / 2); at rest half a substep before the start.
        let phase = 2.0 * (speed * dt / H * (0.5 * q * H).sin()).asin();
        let mut off = 0.0_f64;
        for step in 1..=400 {
            body.steps(1);
            let expected = amplitude * (phase * (f64::from(step) + 0.5)).cos() / (0.5 * phase).cos();
            off = off.max((body.u()[0].x - expected).abs() / amplitude);
        }
        claim.check(tol::DISPERSION, &format!("nu {poisson}, {half_waves} half waves in {cells} cells"), off);
    }
    // At twenty cells a wave the phase speed is 0.9959 c for small steps: sin(π/20) / (π/20).
    let x = std::f64::consts::PI / 20.0;
    claim.check(tol::PHASE_SPEED, "20 cells a wave", x.sin() / x - 0.9959);
}

/// Largest displacement after some steps from noise, over the noise; infinite when the run diverged.
fn growth(build: &Build, dt: f64, steps: usize) -> f64 {
    let mut body = Body::new(build, &with_dt(dt));
    let mut noise = Noise(17);
    let slots = body.slots.clone();
    let size = 1e-9 * H;
    for slot in slots {
        body.sim.set_node(slot, noise.vec3() * size, Vec3::zeros()).unwrap();
    }
    let mut largest = 0.0_f64;
    for step in 0..steps {
        if body.sim.step().is_err() {
            return f64::INFINITY;
        }
        if step % 50 == 0 {
            largest = body.u().iter().map(Vec3::norm).fold(largest, f64::max);
        }
    }
    // A free body drifts with the momentum of the noise; a chain's ends bound nothing else.
    largest / size
}

#[test]
fn the_stable_step_of_a_chain_is_the_time_of_sound_through_a_cell() {
    let mut claim = Claim::new("stable step of a chain");
    for poisson in [0.25, 0.45, 0.49] {
        let build = chain(40, poisson);
        let limit = H / material(YOUNG, poisson, DENSITY).longitudinal_speed_m_s();
        let found = Body::new(&build, &exact()).sim.statistics().stable_substep_s;
        claim.check(tol::STABLE_STEP, &format!("nu {poisson}, computed / analytic"), found / limit - 1.0);
        let (below, above) = (growth(&build, 0.99 * limit, 5000), growth(&build, 1.01 * limit, 5000));
        claim.check(tol::BOUNDED, &format!("nu {poisson}, growth at 0.99"), below);
        assert!(
            above > 1e6,
            "nu {poisson}: at 1.01 of the limit noise must blow up, not grow {above:.3} times"
        );
    }
}

#[test]
fn the_stable_step_of_any_body_is_sharp() {
    let mut claim = Claim::new("stable step");
    let tissue = |poisson: f64| material(YOUNG, poisson, DENSITY);
    let stiff = material(5.0 * YOUNG, 0.3, 1.2 * DENSITY);
    let bodies = [
        ("cube, nu 0.25", block([6; 3], H, tissue(0.25))),
        ("cube, nu 0.45", block([6; 3], H, tissue(0.45))),
        ("cube, nu 0.49", block([6; 3], H, tissue(0.49))),
        ("plate", block([7, 5, 1], H, tissue(0.45))),
        ("ragged", ragged([7, 6, 5], H, 1, 0.7, [tissue(0.45), stiff])),
    ];
    for (name, build) in bodies {
        let limit = Body::new(&build, &exact()).sim.statistics().stable_substep_s;
        let (below, above) = (growth(&build, 0.99 * limit, 4000), growth(&build, 1.01 * limit, 4000));
        claim.check(tol::BOUNDED, &format!("{name}, growth at 0.99"), below);
        assert!(above > 1e6, "{name}: at 1.01 of the limit noise must blow up, not grow {above:.3} times");
    }
}

#[test]
fn the_stable_step_of_random_voxels_is_safe_and_within_theory() {
    let mut claim = Claim::new("stable step of voxels");
    for seed in 0..10 {
        let (poisson, fill) = ([0.25, 0.40, 0.45, 0.49][seed as usize % 4], 0.25 + 0.06 * seed as f64);
        let tissue = material(YOUNG, poisson, DENSITY);
        let build = ragged([5, 4, 4], H, 100 + seed, fill, [tissue.clone(), tissue.clone()]);
        let model = std::sync::Arc::new(build.run(&mut |_, _| true).unwrap());
        let mut solver = CpuSolver::<f64>::new(&model, 1, 0).unwrap();
        let limit = solver.stable_dt();
        let shortest = 0.55 * H / tissue.longitudinal_speed_m_s();
        assert!(limit >= shortest, "the element theorem promises {shortest:e}, found {limit:e}");

        // No Rayleigh quotient exceeds ω²: those of single nodes bound the step from above.
        let lattice = model.lattice();
        let mut stiffest = 0.0_f64;
        for slot in (0..lattice.slot_count() as u32).filter(|&s| lattice.words()[s as usize] != 0) {
            for axis in 0..3 {
                let moved = Vec3::from_fn(|a, _| if a == axis { 1e-7 * H } else { 0.0 });
                solver.set_node(slot, moved, Vec3::zeros());
                stiffest = stiffest.max(-solver.accelerations()[slot as usize][axis] / (1e-7 * H));
            }
            solver.set_node(slot, Vec3::zeros(), Vec3::zeros());
        }
        assert!(
            limit <= 2.0 / stiffest.sqrt() * (1.0 + 1e-6),
            "{limit:e} s is longer than a single node allows"
        );
        claim.check(
            tol::BOUNDED,
            &format!("seed {seed}, growth at 0.95"),
            growth(&build, 0.95 * limit, 3000),
        );
    }
}

#[test]
fn a_stiff_inclusion_sets_the_stable_step() {
    let label = |[i, j, k]: [usize; 3]| if [i, j, k] == [3, 3, 3] { 2 } else { 1 };
    let uses = |stiff: f64| {
        [
            (1, LabelUse::Tissue(material(YOUNG, 0.25, DENSITY))),
            (2, LabelUse::Tissue(material(stiff, 0.25, DENSITY))),
        ]
    };
    let stable = |stiff: f64| {
        let build = voxels([7; 3], H, label, &uses(stiff));
        Body::new(&build, &exact()).sim.statistics().stable_substep_s
    };
    let (soft, stiff) = (stable(YOUNG), stable(100.0 * YOUNG));
    // A single cell among soft ones carries eight corners of its neighbours' mass: ω falls by √8 at most.
    assert!(stiff < soft / 2.0 && stiff > soft / 10.0, "{stiff:e} against {soft:e}");
}
