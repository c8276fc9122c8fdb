//! What a host changes while a simulation runs on a GPU, against the processor in double precision.

use std::sync::Arc;

use palpate::math::{Pose, Quat, Vec3};
use palpate::model::material::Material;
use palpate::model::{Fix, Model};
use palpate::sim::{NodeField, Precision, Sim};
use palpate::solver::tool::{ToolDesc, ToolMotion};

use super::gpu::has_gpu;
use super::{CELL_M, GPU, SAME_MOTION, SAME_SPEED, block, difference, largest, simulation};

/// Relative difference of what tools feel that hold tissue: a small difference between where nodes are taken and where they would go by themselves, in
/// single precision.
const SAME_PULL: f64 = 1e-3;

/// The processor in double precision, and the GPU.
fn simulations(model: &Arc<Model>) -> [Sim; 2] {
    [(palpate::sim::Backend::Cpu, Precision::Double), (GPU, Precision::Single)]
        .map(|(backend, precision)| simulation(model, backend, precision))
}

/// They move alike.
fn assert_same(what: &str, [cpu, gpu]: &[Sim; 2]) {
    for (field, tolerance) in [(NodeField::Displacement, SAME_MOTION), (NodeField::Velocity, SAME_SPEED)] {
        let (expected, found) = (cpu.nodes(field), gpu.nodes(field));
        let (most, off) = (largest(&expected), difference(&expected, &found));
        println!("{what}: {field:?} {:e} of {most:e}", off / most);
        assert!(most > 0.0 && off < tolerance * most, "{what}: {field:?} differs by {off:e} of {most:e}");
    }
}

fn step(simulations: &mut [Sim; 2], steps: usize) {
    for sim in simulations {
        (0..steps).for_each(|_| sim.step().unwrap());
    }
}

#[test]
fn what_a_tool_holds_on_a_gpu_goes_where_it_goes_and_pulls_as_on_the_processor() {
    if !has_gpu("what_a_tool_holds_on_a_gpu_goes_where_it_goes_and_pulls_as_on_the_processor") {
        return;
    }
    // Alone; and beside a tool that presses, whose impulses the two backends find by different iterations.
    for (damping_s, is_alone) in [(0.0, true), (1e-4, true), (0.0, false)] {
        let model = block(0.45, damping_s);
        let mut sims = simulations(&model);
        // Above the block, which it does not touch.
        let origin = Vec3::new(10.0, 9.0, 16.2) * CELL_M;
        let pose = |by: Vec3, turn: f64| {
            let local = Pose::from_parts((origin + by).into(), Quat::from_scaled_axis(Vec3::z() * turn));
            ToolMotion::at(model.frame() * local)
        };
        let mut tools = sims.each_mut().map(|sim| sim.add_tool(&ToolDesc::sphere(2.0 * CELL_M)).unwrap());
        let beside = |t: f64| {
            let lift = if is_alone { 5.0 } else { 0.0 };
            let local = Pose::translation(3.0 * CELL_M, 3.0 * CELL_M, (17.8 + lift - t) * CELL_M);
            ToolMotion::at(model.frame() * local)
        };
        let mut others = sims.each_mut().map(|sim| sim.add_tool(&ToolDesc::sphere(4.0 * CELL_M)).unwrap());
        for tool in &mut tools {
            tool.set_motion(&pose(Vec3::zeros(), 0.0)).unwrap();
        }
        for tool in &mut others {
            tool.set_motion(&beside(0.0)).unwrap();
        }
        step(&mut sims, 1);
        let held = [0, 1].map(|i| sims[i].grasp(tools[i].id(), 2.5 * CELL_M).unwrap());
        assert!(held[0] > 10 && held[0] == held[1], "{held:?}");
        for round in 1..=60 {
            let t = f64::from(round) / 60.0;
            for tool in &mut tools {
                tool.set_motion(&pose(Vec3::new(1e-3, 5e-4, 2e-3) * t, 0.2 * t)).unwrap();
            }
            for tool in &mut others {
                tool.set_motion(&beside(t)).unwrap();
            }
            step(&mut sims, 1);
        }
        if is_alone {
            assert_same("held", &sims);
        }
        for pair in [&mut tools, &mut others] {
            let [expected, found] = pair.each_mut().map(|tool| tool.force().wrench);
            if expected.force_n == Vec3::zeros() {
                assert!(is_alone && found == expected, "{found:?}");
                continue;
            }
            let force = (expected.force_n - found.force_n).norm() / expected.force_n.norm();
            // A ball without friction feels no torque about its middle.
            let turning = expected.torque_n_m.norm().max(CELL_M * expected.force_n.norm());
            let torque = (expected.torque_n_m - found.torque_n_m).norm() / turning;
            println!("force {force:e} of {}, torque {torque:e}", expected.force_n.norm());
            assert!(force < SAME_PULL && torque < SAME_PULL, "{expected:?} {found:?}");
        }
        for i in 0..2 {
            sims[i].release(tools[i].id()).unwrap();
        }
        step(&mut sims, 20);
        if is_alone {
            assert_same("let go", &sims);
        }
        let pulls = tools.each_mut().map(|tool| tool.force().wrench.force_n.norm());
        assert_eq!(pulls, [0.0; 2]);
    }
}

#[test]
fn a_material_changed_on_a_gpu_moves_as_on_the_processor() {
    if !has_gpu("a_material_changed_on_a_gpu_moves_as_on_the_processor") {
        return;
    }
    // Each asks for other kernels.
    for (poisson, damping_s) in [(0.25, 0.0), (0.45, 0.0), (0.25, 1e-4), (0.45, 1e-4)] {
        let mut sims = simulations(&block(0.25, 0.0));
        step(&mut sims, 10);
        let mut changed = Material::new("changed", 4.5e3, poisson, 1200.0).unwrap();
        changed.damping_s = damping_s;
        for sim in &mut sims {
            sim.set_material(1, &changed).unwrap();
        }
        step(&mut sims, 40);
        assert_same(&format!("nu {poisson} damping {damping_s}"), &sims);
    }
}

#[test]
fn tissue_fixed_and_freed_on_a_gpu_moves_as_on_the_processor() {
    if !has_gpu("tissue_fixed_and_freed_on_a_gpu_moves_as_on_the_processor") {
        return;
    }
    let model = block(0.45, 0.0);
    let mut sims = simulations(&model);
    step(&mut sims, 10);
    let corner = model.frame() * Pose::translation(0.0, 0.0, 13.0 * CELL_M);
    let fix = Fix { pose: corner, half_extents: Vec3::repeat(4.5 * CELL_M), axes: [true, true, false] };
    let fixed = sims.each_mut().map(|sim| sim.fix(&fix).unwrap());
    assert!(fixed[0] > 0 && fixed[0] == fixed[1], "{fixed:?}");
    step(&mut sims, 30);
    assert_same("fixed", &sims);
    for sim in &mut sims {
        sim.free(&fix).unwrap();
    }
    step(&mut sims, 30);
    assert_same("freed", &sims);
}
