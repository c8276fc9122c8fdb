//! The same run gives the same bits: with any number of threads, and after a reset.

use palpate::math::Vec3;
use palpate::sim::{Precision, SimDesc, ToolPort};
use palpate::solver::load::Load;
use palpate::solver::tool::{ToolDesc, ToolForce};

use super::scene::{Body, ellipsoid, faces_at, hold, material, step_to};

const H: f64 = 4e-3;

/// An ellipsoid of damped tissue that a tool strokes, with gravity, a load and sleep.
fn scene(precision: Precision, threads: usize, damping_s: f64) -> (Body, ToolPort) {
    let mut tissue = material(5e3, 0.45, 1000.0);
    tissue.damping_s = damping_s;
    let mut build = ellipsoid([22, 14, 10], H, tissue);
    hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 2.0 * H), [true; 3]);
    let desc = SimDesc { precision, threads, gravity_m_s2: Vec3::new(0.0, 0.0, -9.81), ..SimDesc::default() };
    let mut body = Body::new(&build, &desc);
    let traction_pa = Vec3::new(0.0, 5.0, 0.0);
    body.sim.add_load(&Load::Traction { region: faces_at(0, 4.0 * H), traction_pa }).unwrap();
    let mut tool = ToolDesc::sphere(5e-3);
    tool.friction = 0.4;
    let port = body.sim.add_tool(&tool).unwrap();
    (body, port)
}

fn run((body, port): &mut (Body, ToolPort), steps: u32) -> (Vec<Vec3>, Vec<Vec3>, Vec<ToolForce>) {
    let forces = (0..steps)
        .map(|step| {
            let t = f64::from(step) * 1e-3;
            let depth = 5e-3 * (t / 0.05).min(1.0);
            step_to(body, port, Vec3::new(8.0 * H + 0.2 * t, 7.0 * H, 10.0 * H + 5e-3 - depth))
        })
        .collect();
    (body.u(), body.v(), forces)
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    for (precision, damping_s) in
        [(Precision::Single, 0.0), (Precision::Single, 1e-4), (Precision::Double, 0.0)]
    {
        let reference = run(&mut scene(precision, 1, damping_s), 120);
        assert!(reference.2.iter().any(|force| force.wrench.force_n.norm() > 0.0), "the tool touches");
        for threads in [2, 3] {
            let found = run(&mut scene(precision, threads, damping_s), 120);
            assert!(found == reference, "{precision:?}, {threads} threads, damping {damping_s}");
        }
    }
}

#[test]
fn a_reset_simulation_repeats_its_run_to_the_bit() {
    for precision in [Precision::Single, Precision::Double] {
        let mut body = scene(precision, 1, 0.0);
        let first = run(&mut body, 150);
        body.0.sim.reset();
        assert!(body.0.u().iter().chain(&body.0.v()).all(|x| *x == Vec3::zeros()));
        // The tool's way into its first place is part of a run: a fresh one appears there.
        let id = body.1.id();
        body.0.sim.remove_tool(id).unwrap();
        let mut tool = ToolDesc::sphere(5e-3);
        tool.friction = 0.4;
        body.1 = body.0.sim.add_tool(&tool).unwrap();
        let second = run(&mut body, 150);
        assert!(first.0 == second.0 && first.1 == second.1, "{precision:?}: nodes");
        assert!(first.2 == second.2, "{precision:?}: forces");
    }
}
