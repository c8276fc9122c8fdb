//! What the bench `lattice` measures is what it says: its command line, its pace, and the baselines that it compares with.

use std::collections::BTreeMap;

use clap::Parser;
use palpate::cuda::device::Device;
use palpate::error::Error;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};

#[path = "support/gpu.rs"]
mod gpu;
#[allow(dead_code)] // its own program uses the rest
#[path = "../benches/lattice/main.rs"]
mod lattice;

use gpu::has_gpu;
use lattice::baseline::Baseline;
use lattice::baseline::masses::{Masses, offsets};
use lattice::baseline::parallel::{NO_MASS, Parallel, STEPS, Sphere, properties, springs_at};
use lattice::baseline::serial::{STRETCH, Serial};
use lattice::common::place::Place;
use lattice::ellipsoid;
use lattice::options::{Options, SceneName};
use lattice::pace::Pace;

/// Cells of a block along x, y, z, and the edge of one in m.
const CELLS: [usize; 3] = [5, 4, 3];
const CELL_M: f64 = 2e-3;
/// Relative difference of displacements after a hundred steps in single precision: the GPU's roots and quotients are approximate.
const SAME_MOTION: f64 = 1e-3;

/// A block of one tissue; its lowest layer of nodes is held where asked.
fn block(is_held: bool) -> Model {
    let labels = vec![1; CELLS.iter().product()];
    let grid = LabelGrid::new(CELLS, Vec3::repeat(CELL_M), Pose::identity(), labels).unwrap();
    let mut build = Build::new(grid);
    let tissue = Material::new("tissue", 3e3, 0.25, 1000.0).unwrap();
    build.uses = BTreeMap::from([(1, LabelUse::Tissue(tissue))]);
    if is_held {
        let lowest = Pose::translation(0.0, 0.0, -0.5 * CELL_M);
        let half_extents = Vec3::new(1.0, 1.0, 0.5 * CELL_M);
        build.fixes.push(Fix { pose: lowest, half_extents, axes: [true; 3] });
    }
    build.run(&mut |_, _| true).unwrap()
}

fn options(words: &[&str]) -> Options {
    Options::try_parse_from([&["lattice"], words].concat()).unwrap()
}

fn is_refused(words: &[&str]) -> bool {
    Options::try_parse_from([&["lattice"], words].concat()).is_err()
}

#[test]
fn the_full_thorax_runs_by_itself_on_a_gpu_only() {
    assert!(!options(&[]).scenes().contains(&SceneName::Thorax15));
    assert!(options(&["--backend", "cuda"]).scenes().contains(&SceneName::Thorax15));
    assert_eq!(options(&["--scene", "thorax-1.5mm"]).scenes(), [SceneName::Thorax15]);
}

#[test]
fn a_tick_has_one_substep_and_there_is_at_least_one() {
    assert_eq!(options(&["--latency"]).ticks, 100_000);
    assert!(is_refused(&["--latency", "--ticks", "0"]));
    assert!(is_refused(&["--latency", "--substeps", "2"]));
    assert!(is_refused(&["--latency", "--scene", "ellipsoid"]));
    assert!(is_refused(&["--ticks", "10"]));
    assert!(is_refused(&["--latency", "--still"]));
}

#[test]
fn without_a_gpu_the_bench_says_why() {
    let found = Place::of(&options(&["--backend", "cuda"]).machine);
    match (found, Device::open(None)) {
        (Ok(place), Ok(device)) => {
            assert_eq!((place.backend, &*place.device), ("cuda", device.info().name.as_str()));
        }
        (Err(error), Err(reason)) => {
            assert!(matches!(error, Error::NoDevice(_)));
            assert_eq!(error.to_string(), reason.to_string());
        }
        (found, device) => panic!("{found:?} where the device is {device:?}"),
    }
}

#[test]
fn steps_on_a_gpu_have_a_hundred_stable_substeps() {
    let model = block(true);
    let pace = Pace::of(&options(&["--backend", "cuda"]), &model);
    assert_eq!(pace.substeps, Some(100));
    // λ = μ at ν = ¼, so that the wave's speed is √(3 μ / ρ) with μ = E / 2.5; half the way through a cell.
    let expected = 100.0 * 0.5 * CELL_M / (3.0 * 3e3 / 2.5 / 1000.0_f64).sqrt();
    assert!((pace.step_s / expected - 1.0).abs() < 1e-12);
    let given = Pace::of(&options(&["--backend", "cuda", "--dt", "0.01"]), &model);
    assert_eq!(given, Pace { step_s: 0.01, substeps: None });
    assert_eq!(Pace::of(&options(&[]), &model), Pace { step_s: 1e-3, substeps: None });
}

#[test]
fn the_ellipsoid_has_as_many_nodes_as_were_counted() {
    let tissue = Material::new("tissue", 3e3, 0.25, 1000.0).unwrap();
    for wanted in [2_000, 4_000, 34_108] {
        let counted = ellipsoid::count(ellipsoid::semi_axis(wanted));
        let built = ellipsoid::model(wanted, tissue.clone()).unwrap().lattice().node_count();
        assert_eq!(counted, built, "{wanted} wanted");
        assert!(built.abs_diff(wanted) as f64 <= 0.06 * wanted as f64, "{built} for {wanted}");
    }
}

#[test]
fn every_spring_is_held_at_both_of_its_ends() {
    let masses = Masses::new(&block(true), STRETCH);
    let start = masses.positions();
    let springs: Vec<_> = (0..26).map(|k| springs_at(&masses, k)).collect();
    let mut ends = 0;
    for (k, mass) in (0..26).flat_map(|k| (0..masses.count()).map(move |mass| (k, mass))) {
        let spring = springs[k][mass];
        if spring.other == NO_MASS {
            continue;
        }
        ends += 1;
        // The list of offsets is symmetric, so that the opposite one is as far from its end.
        let back = springs[25 - k][spring.other as usize];
        assert_eq!((back.other as usize, back.rest_m), (mass, spring.rest_m));
        let apart = (0..3).map(|a| start[mass][a] - start[spring.other as usize][a]);
        let length = apart.map(|d| d * d).sum::<f32>().sqrt();
        assert!((length / (STRETCH * spring.rest_m) - 1.0).abs() < 1e-5, "stretched as asked");
    }
    // In a block, for each offset, there are as many springs as pairs of nodes that lie so apart.
    let pairs =
        |offset: [isize; 3]| (0..3).map(|a| CELLS[a] + 1 - offset[a].unsigned_abs()).product::<usize>();
    assert_eq!(ends, offsets().map(pairs).iter().sum::<usize>());
}

#[test]
fn masses_are_active_and_the_lowest_layer_is_held() {
    let masses = Masses::new(&block(true), STRETCH);
    let layer = (CELLS[0] + 1) * (CELLS[1] + 1);
    let material_1 = 1 << 8;
    for (mass, property) in properties(&masses).into_iter().enumerate() {
        assert_eq!(property, material_1 | 1 | if mass < layer { 2 } else { 0 }, "mass {mass}");
    }
}

/// The largest difference along an axis.
fn apart(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    // A NaN stays once it is met.
    pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, |most, x| if x <= most { most } else { x })
}

#[test]
fn both_baselines_move_alike() {
    if !has_gpu("both_baselines_move_alike") {
        return;
    }
    let masses = Masses::new(&block(false), STRETCH);
    let dt = 1e-4;
    // Neither damping nor a tool, as in the serial one.
    let nothing = Sphere { radius_m: 0.0, centre_m: Box::new(|_| Vec3::zeros()) };
    let mut parallel = Parallel::new(&masses, dt, 0.0, nothing).unwrap();
    let mut serial = Serial::new(&masses, dt);
    assert_eq!(parallel.advance().unwrap(), STEPS);
    for _ in 0..STEPS {
        serial.advance().unwrap();
    }
    let moved = apart(serial.positions(), &masses.positions());
    let off = apart(serial.positions(), &parallel.positions().unwrap());
    assert!(moved > 1e-5, "the block contracts: {moved} m");
    assert!(off < SAME_MOTION * moved, "{off} m of {moved} m");
}

#[test]
fn a_sphere_in_a_held_block_is_felt_by_the_baseline() {
    if !has_gpu("a_sphere_in_a_held_block_is_felt_by_the_baseline") {
        return;
    }
    let masses = Masses::new(&block(true), 1.0);
    let [x, y, z] = CELLS.map(|n| n as f64 * CELL_M);
    let radius_m = 4e-3;
    let above = Vec3::new(0.5 * x, 0.5 * y, z + radius_m);
    let away = Sphere { radius_m, centre_m: Box::new(move |_| above + Vec3::repeat(1.0)) };
    let mut untouched = Parallel::new(&masses, 1e-4, 5.0, away).unwrap();
    untouched.advance().unwrap();
    assert!(untouched.check().is_err(), "what touches nothing is no figure");
    assert!(
        apart(&untouched.positions().unwrap(), &masses.positions()) < 1e-6,
        "nothing moves by itself, in m"
    );

    // Half a cell deep within 33 ms, and at rest there.
    let depth_m = |time_s: f64| (0.03 * time_s).min(0.5 * CELL_M);
    let centre_m = move |time_s| above - Vec3::z() * depth_m(time_s);
    let mut pressed =
        Parallel::new(&masses, 1e-4, 5.0, Sphere { radius_m, centre_m: Box::new(centre_m) }).unwrap();
    for _ in 0..10 {
        pressed.advance().unwrap();
        pressed.check().unwrap();
    }
    let (start, found) = (masses.positions(), pressed.positions().unwrap());
    let end = centre_m(1.0);
    let distance = |p: &[f32; 4]| (Vec3::from_fn(|a, _| f64::from(p[a])) - end).norm();
    let nearest = found.iter().map(distance).fold(f64::MAX, f64::min);
    assert!((nearest / radius_m - 1.0).abs() < 1e-4, "masses lie on the sphere, not in it: {nearest} m");
    for mass in (0..masses.count()).filter(|&mass| masses.is_held(mass)) {
        assert_eq!(found[mass], start[mass], "what is held stays");
    }
}
