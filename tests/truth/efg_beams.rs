//! Slender bars of the meshless model: bent far, and twisted.

use palpate::math::Vec3;
use palpate::sim::SimDesc;
use palpate::solver::load::Load;
use palpate::solver::method::{EfgDesc, Method};

use super::scene::{Body, block, exact, faces_at, hold, material, roller};
use super::tolerance::{self as tol, Claim};

const H: f64 = 0.005;
const YOUNG: f64 = 1e5;
const DENSITY: f64 = 1000.0;

fn desc(step_s: f64) -> SimDesc {
    let method = EfgDesc { tolerance: 1e-6, max_iterations: 20_000, ..EfgDesc::default() };
    SimDesc { method: Method::Efg(method), step_s, ..exact() }
}

#[test]
fn a_bar_that_is_bent_far_follows_the_elastica() {
    let mut claim = Claim::new("EFG elastica");
    // Half of a square bar by its plane of symmetry, four cells thick and twenty times as long.
    let cells = [80, 2, 4];
    let [length, thick] = [cells[0] as f64 * H, cells[2] as f64 * H];
    let mut build = block(cells, H, material(YOUNG, 0.3, DENSITY));
    roller(&mut build, 0);
    roller(&mut build, 1);
    let middle = 0.5 * thick;
    hold(&mut build, Vec3::new(0.0, -1.0, middle), Vec3::new(0.0, 1.0, middle), [false, false, true]);
    let bending = YOUNG * thick.powi(4) / 12.0;
    // Steps of the length in which the slowest mode turns by about a radian: its inertia keeps steps stable that leave out how stress stiffens.
    let slowest = 3.516 / length.powi(2) * (bending / (DENSITY * thick * thick)).sqrt();
    let mut body = Body::new(&build, &desc(1.0 / slowest));
    for (load, sideways, back) in [(1.0, 0.30172, 0.05643), (2.0, 0.49346, 0.16064), (5.0, 0.71379, 0.38763)]
    {
        let traction_pa = Vec3::z() * (load * bending / length.powi(2) / (thick * thick));
        let id = body.sim.add_load(&Load::Traction { region: faces_at(0, length), traction_pa }).unwrap();
        body.steps(40);
        body.sim.remove_load(id).unwrap();
        let tip = body.mean_over_plane(0, length, &body.u()) / length;
        claim.check(
            tol::ELASTICA,
            &format!("P L² / E I = {load}, aside {:.5}", tip.z),
            tip.z / sideways - 1.0,
        );
        claim.check(
            tol::ELASTICA_BACK,
            &format!("P L² / E I = {load}, back {:.5}", tip.x),
            -tip.x / back - 1.0,
        );
    }
}

/// How much less a square bar twists that is twice `cells` thick than by its torsion constant.
fn too_stiff(cells: usize) -> f64 {
    // A quarter, about whose planes of symmetry twisting is odd.
    let (h, poisson) = (0.02 / cells as f64, 0.45);
    let [length, thick] = [8.0, 2.0].map(|n| n * cells as f64 * h);
    let mut build = block([8 * cells, cells, cells], h, material(YOUNG, poisson, DENSITY));
    for axis in [1, 2] {
        let low = Vec3::from_fn(|a, _| if a == axis { 0.0 } else { -1.0 });
        let high = Vec3::from_fn(|a, _| if a == axis { 0.0 } else { 1.0 });
        hold(&mut build, low, high, std::array::from_fn(|a| a != axis));
    }
    // One end does not turn, and may warp.
    hold(&mut build, Vec3::new(0.0, -1.0, -1.0), Vec3::new(0.0, 1.0, 1.0), [false, true, true]);
    let mut body = Body::new(&build, &desc(1.0));
    // Across the upper half of the other end, against the lower half by symmetry: a couple of half the force each at a quarter of the thickness.
    let pull = 1e-3 * YOUNG;
    let traction_pa = Vec3::y() * -pull;
    body.sim.add_load(&Load::Traction { region: faces_at(0, length), traction_pa }).unwrap();
    body.steps(4);
    let torque = pull * thick * thick / 2.0 * (thick / 4.0) * 2.0;

    let u = body.u();
    // The turn of a section, from those of its nodes.
    let turn = |at: f64| {
        let of = |i: usize| {
            let (x, m) = (body.rest[i], body.mass[i]);
            (m * (x.y * u[i].z - x.z * u[i].y), m * (x.y * x.y + x.z * x.z))
        };
        let section = (0..u.len()).filter(|&i| (body.rest[i].x - at).abs() < 1e-6);
        let (moment, inertia) = section.map(of).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        moment / inertia
    };
    // Away from both ends, where how they are held and loaded is forgotten.
    let (near, far) = (1.5 * thick, 2.5 * thick);
    let twist = (turn(far) - turn(near)) / (far - near);
    let shear = YOUNG / (2.0 * (1.0 + poisson));
    1.0 - twist * shear * 0.140577 * thick.powi(4) / torque
}

#[test]
fn a_square_bar_twists_by_its_torsion_constant() {
    let mut claim = Claim::new("EFG torsion");
    let [coarse, fine] = [3, 6].map(too_stiff);
    claim.check(tol::TORSION, "12 cells thick", fine);
    // What is left goes with the square of the cells.
    claim.check(tol::TORSION_LIMIT, &format!("from {coarse:.4} and {fine:.4}"), (4.0 * fine - coarse) / 3.0);
}
