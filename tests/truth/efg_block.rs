//! The meshless model beside an independent finite element code: `reference/block.py` says which, and makes the figures anew.

use palpate::math::{Pose, Vec3};
use palpate::sim::SimDesc;
use palpate::solver::load::{Load, Region};
use palpate::solver::method::{EfgDesc, Elasticity, Method};

use super::scene::{Body, block, exact, hold, material};
use super::tolerance::{self as tol, Claim};

/// Poisson's ratio, place and displacement.
struct Sample {
    poisson: f64,
    at: Vec3,
    u: Vec3,
}

fn reference() -> Vec<Sample> {
    let rows = include_str!("reference/block.csv").lines().skip(1);
    let sample = |row: &str| {
        let numbers: Vec<f64> = row.split(',').map(|number| number.parse().unwrap()).collect();
        let [poisson, x, y, z, ux, uy, uz] = numbers[..] else { panic!("a row of seven numbers: {row}") };
        Sample { poisson, at: Vec3::new(x, y, z), u: Vec3::new(ux, uy, uz) }
    };
    rows.map(sample).collect()
}

#[test]
fn a_pressed_block_moves_as_in_scikit_fem() {
    let mut claim = Claim::new("EFG and finite elements");
    let (cells, h) = ([24, 20, 16], 2.5e-3);
    let reference = reference();
    for poisson in [0.3, 0.45, 0.49] {
        let mut build = block(cells, h, material(1e4, poisson, 1000.0));
        hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
        let elasticity = Elasticity::Linear;
        let method = EfgDesc { elasticity, tolerance: 1e-5, max_iterations: 5000, ..EfgDesc::default() };
        let desc = SimDesc { method: Method::Efg(method), step_s: 1.0, ..exact() };
        let mut body = Body::new(&build, &desc);
        let half = Region {
            pose: Pose::translation(0.015, 0.025, 0.04),
            half_extents_m: Vec3::new(0.015, 0.025, 0.0),
        };
        let traction_pa = Vec3::new(15.0, 10.0, -50.0);
        body.sim.add_load(&Load::Traction { region: half, traction_pa }).unwrap();
        body.steps(2);

        let u = body.u();
        let samples: Vec<&Sample> = reference.iter().filter(|sample| sample.poisson == poisson).collect();
        assert_eq!(samples.len(), 84);
        let largest = samples.iter().map(|sample| sample.u.norm()).fold(0.0, f64::max);
        let off = samples.iter().map(|sample| {
            let node = body.rest.iter().position(|rest| (rest - sample.at).norm() < 1e-6).unwrap();
            (u[node] - sample.u).norm() / largest
        });
        claim.check(tol::FINITE_ELEMENTS, &format!("nu {poisson}"), off.fold(0.0, f64::max));
    }
}
