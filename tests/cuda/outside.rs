//! Loads, driven regions and settling on a GPU, against the processor in double precision.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::math::{Pose, Quat, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::sim::{Backend, NodeField, Precision, Sim, SimDesc};
use palpate::solver::load::{Load, Region};
use palpate::solver::tool::{ToolDesc, ToolMotion};

use super::gpu::has_gpu;
use super::{CELL_M, GPU, SAME_MOTION, SAME_SPEED, block, difference, largest, most};

/// Relative difference of displacements at rest: what rounding does to forces is spread by the softest mode.
const SAME_REST: f64 = 2e-4;
/// Relative difference of the forces of one step in which tissue meets a tool at speed.
const SAME_BLOW: f64 = 1e-3;
/// An acceleration, in m/s², that settling in single precision reaches.
const AT_REST: f64 = 0.05;
/// One that it does not reach.
const NEVER: f64 = 1e-12;

/// The processor in double precision, and twice the GPU.
fn simulations(model: &Arc<Model>, desc: &SimDesc) -> [Sim; 3] {
    let sim = |backend, precision| {
        Sim::new(model.clone(), &SimDesc { backend, precision, ..desc.clone() }).unwrap()
    };
    [sim(Backend::Cpu, Precision::Double), sim(GPU, Precision::Single), sim(GPU, Precision::Single)]
}

/// Gravity acts; the same substeps for all.
fn falling() -> SimDesc {
    SimDesc {
        gravity_m_s2: Vec3::new(4.0, -2.0, -8.0),
        rest_under_gravity: false,
        substeps: Some(8),
        sleeping: false,
        ..SimDesc::default()
    }
}

/// Nothing acts by itself, in steps so long that tissue comes further in one than contact has room to spare.
fn still() -> SimDesc {
    SimDesc { step_s: 2e-2, substeps: Some(160), sleeping: false, ..SimDesc::default() }
}

/// A block of tissue, held below, around two bones that share nodes.
fn boned(damping_s: f64) -> Arc<Model> {
    let dims = [22, 18, 13];
    let label = |i: usize| {
        let [x, y, z] = [i % 22, i / 22 % 18, i / (22 * 18)];
        let is_bone = (8..14).contains(&x) && (7..11).contains(&y) && (8..11).contains(&z);
        if is_bone { 2 + u16::from(x >= 11) } else { 1 }
    };
    let labels = (0..dims.iter().product()).map(label).collect();
    let frame =
        Pose::from_parts(Vec3::new(0.01, -0.02, 0.03).into(), Quat::from_euler_angles(0.1, -0.2, 0.3));
    let mut build = Build::new(LabelGrid::new(dims, Vec3::repeat(CELL_M), frame, labels).unwrap());
    let mut tissue = Material::new("tissue", 3e3, 0.45, 1000.0).unwrap();
    tissue.damping_s = damping_s;
    let bone = LabelUse::Rigid(Material::new("bone", 1e10, 0.3, 1900.0).unwrap());
    build.uses = BTreeMap::from([(1, LabelUse::Tissue(tissue)), (2, bone.clone()), (3, bone)]);
    build.fixes.push(Fix { pose: frame, half_extents: Vec3::new(1.0, 1.0, 1.5 * CELL_M), axes: [true; 3] });
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// A place in cells, in the world.
fn place(model: &Model, cells: [f64; 3]) -> Vec3 {
    model.frame().transform_point(&(Vec3::from(cells) * CELL_M).into()).coords
}

/// Boundary faces around a place.
fn faces(model: &Model, cells: [f64; 3], half: [f64; 3]) -> Region {
    let at = Pose::from_parts(place(model, cells).into(), model.frame().rotation);
    Region { pose: at, half_extents_m: Vec3::from(half) * CELL_M }
}

/// Loads of every kind that share nodes; two of them press across an edge of the block.
fn loads(model: &Model) -> [Load; 4] {
    let top = faces(model, [16.0, 9.0, 13.0], [4.0, 4.0, 0.1]);
    let edge = faces(model, [22.0, 9.0, 13.0], [3.1, 5.0, 3.1]);
    [
        Load::Point { at_m: place(model, [15.3, 9.2, 12.7]), force_n: Vec3::new(4e-3, -3e-3, 5e-3) },
        Load::Traction { region: top, traction_pa: Vec3::new(20.0, -10.0, 15.0) },
        Load::Pressure { region: top, pressure_pa: 60.0 },
        Load::Pressure { region: edge, pressure_pa: -25.0 },
    ]
}

/// How far the GPU is from the processor, relative to what is the most so far. The two on the GPU are equal to the last bit.
fn apart(sims: &[Sim; 3], field: NodeField, peak: &mut f64) -> f64 {
    let [cpu, gpu, again] = sims.each_ref().map(|sim| sim.nodes(field));
    assert_eq!(gpu, again, "the same GPU gives the same bits");
    *peak = peak.max(largest(&cpu));
    difference(&cpu, &gpu) / *peak
}

/// Steps, and compares displacements and velocities.
fn step_alike(sims: &mut [Sim; 3], steps: u32, peaks: &mut [f64; 2], mut act: impl FnMut(&mut Sim, u32)) {
    for step in 1..=steps {
        for sim in &mut *sims {
            act(sim, step);
            sim.step().unwrap();
        }
        if step % 20 == 0 || step == steps {
            let fields = [(NodeField::Displacement, SAME_MOTION), (NodeField::Velocity, SAME_SPEED)];
            for ((field, tolerance), peak) in fields.into_iter().zip(&mut *peaks) {
                let found = apart(sims, field, peak);
                println!("{field:?} after {step} steps: {found:e} of {peak:e}");
                assert!(found < tolerance, "{field:?} after {step} steps: {found:e}");
            }
        }
    }
}

#[test]
fn loads_come_and_go_as_on_the_processor() {
    if !has_gpu("loads_come_and_go_as_on_the_processor") {
        return;
    }
    for damping_s in [0.0, 1e-4] {
        let model = block(0.45, damping_s);
        let mut sims = simulations(&model, &falling());
        let mut peaks = [0.0; 2];
        let ids = sims.each_mut().map(|sim| loads(&model).map(|load| sim.add_load(&load).unwrap()));
        step_alike(&mut sims, 60, &mut peaks, |_, _| {});
        // One after the other; some faces lose one of two loads.
        for (place, _) in loads(&model).iter().enumerate() {
            for (sim, ids) in sims.iter_mut().zip(&ids) {
                sim.remove_load(ids[place]).unwrap();
            }
            step_alike(&mut sims, 15, &mut peaks, |_, _| {});
        }
    }
}

#[test]
fn a_load_that_is_removed_leaves_no_trace() {
    if !has_gpu("a_load_that_is_removed_leaves_no_trace") {
        return;
    }
    let model = block(0.45, 0.0);
    let [_, mut sim, mut other] = simulations(&model, &falling());
    for load in loads(&model) {
        let id = sim.add_load(&load).unwrap();
        sim.remove_load(id).unwrap();
    }
    (0..20).for_each(|_| [&mut sim, &mut other].into_iter().for_each(|sim| sim.step().unwrap()));
    assert_eq!(sim.nodes(NodeField::Displacement), other.nodes(NodeField::Displacement));

    let settled = |sim: &mut Sim| {
        sim.settle(NEVER, 4000).unwrap();
        sim.nodes(NodeField::Displacement)
    };
    let before = settled(&mut sim);
    let ids = loads(&model).map(|load| sim.add_load(&load).unwrap());
    let loaded = settled(&mut sim);
    ids.into_iter().for_each(|id| sim.remove_load(id).unwrap());
    let after = settled(&mut sim);
    let [moved, left] = [&loaded, &after].map(|now| difference(&before, now) / largest(&before));
    println!("loads move by {moved:e} and leave {left:e}");
    assert!(moved > 0.1 && left < SAME_REST, "{moved:e}, {left:e}");
}

/// Where the bones are after a share of their way, world frame: each turns about its own axis.
fn bone_at(model: &Model, label: u16, share: f64) -> Pose {
    let centre = place(model, [11.0, 9.0, 9.5]);
    let (way, turn) = match label {
        2 => (Vec3::new(-3e-4, 1e-4, 5e-4), Vec3::new(0.04, 0.0, -0.03)),
        _ => (Vec3::new(2e-4, -2e-4, 4e-4), Vec3::new(0.0, -0.03, 0.05)),
    };
    let to_centre = Pose::translation(-centre.x, -centre.y, -centre.z);
    let turned = Pose::from_parts((centre + way * share).into(), Quat::from_scaled_axis(turn * share));
    turned * to_centre
}

#[test]
fn bones_are_driven_as_on_the_processor() {
    if !has_gpu("bones_are_driven_as_on_the_processor") {
        return;
    }
    for damping_s in [0.0, 1e-4] {
        let model = boned(damping_s);
        let mut sims = simulations(&model, &falling());
        let mut peaks = [0.0; 2];
        let drive = |sim: &mut Sim, label, share| {
            sim.drive_region(label, &bone_at(&model, label, share)).unwrap();
        };
        // Both; then one alone, which takes the shared nodes along; then none.
        step_alike(&mut sims, 40, &mut peaks, |sim, step| {
            [2, 3].into_iter().for_each(|label| drive(sim, label, f64::from(step) / 60.0));
        });
        step_alike(&mut sims, 20, &mut peaks, |sim, step| drive(sim, 2, f64::from(40 + step) / 60.0));
        step_alike(&mut sims, 20, &mut peaks, |_, _| {});

        // No step rounds on what steps before it rounded.
        let (lattice, end) = (model.lattice(), bone_at(&model, 2, 1.0));
        let (u, rest) = (sims[1].nodes(NodeField::Displacement), sims[1].nodes(NodeField::RestPosition));
        let bone = &model.regions()[&2];
        let nodes = lattice.slots().zip(u.iter().zip(&rest)).filter(|(slot, _)| bone.contains(slot));
        let off = most(nodes.map(|(_, (u, x))| (end.transform_point(&(*x).into()).coords - x - u).norm()));
        assert!(off < 4.0 * f64::from(f32::EPSILON) * largest(&u), "{off:e} m");
    }
}

/// Simulations that have much to settle: loads, and bones that were just driven.
fn unsettled(damping_s: f64) -> [Sim; 3] {
    let model = boned(damping_s);
    let mut sims = simulations(&model, &falling());
    for sim in &mut sims {
        for load in loads(&model) {
            sim.add_load(&load).unwrap();
        }
        for label in [2, 3] {
            sim.drive_region(label, &bone_at(&model, label, 1.0)).unwrap();
        }
        sim.step().unwrap();
    }
    sims
}

#[test]
fn settling_sees_the_peaks_that_the_processor_sees() {
    if !has_gpu("settling_sees_the_peaks_that_the_processor_sees") {
        return;
    }
    for damping_s in [0.0, 1e-4] {
        let mut sims = unsettled(damping_s);
        let mut peak = 0.0;
        for substeps in [51, 102, 306] {
            let left = sims.each_mut().map(|sim| sim.settle(NEVER, substeps).unwrap());
            let found = apart(&sims, NodeField::Displacement, &mut peak);
            println!("after {substeps} more substeps: {found:e} of {peak:e}, left {left:?} m/s²");
            assert!(found < SAME_MOTION, "after {substeps} more substeps: {found:e}");
            assert!((left[0] - left[1]).abs() < AT_REST, "{left:?}");
            assert_eq!(largest(&sims[1].nodes(NodeField::Velocity)), 0.0);
        }
    }
}

#[test]
fn settling_ends_at_the_processors_rest() {
    if !has_gpu("settling_ends_at_the_processors_rest") {
        return;
    }
    for damping_s in [0.0, 1e-4] {
        let mut sims = unsettled(damping_s);
        // As far as rounding lets it come.
        let left = sims.each_mut().map(|sim| sim.settle(NEVER, 20_000).unwrap());
        let mut peak = 0.0;
        let found = apart(&sims, NodeField::Displacement, &mut peak);
        println!("at rest: {found:e} of {peak:e}, left {left:?} m/s²");
        assert!(found < SAME_REST, "{found:e}");

        let [_, mut sim, _] = unsettled(damping_s);
        let left = sim.settle(AT_REST, 40_000).unwrap();
        assert!(left > 0.0 && left <= AT_REST, "{left} m/s²");
        assert!(sim.statistics().substeps < 20_000, "it stops where that is reached");
    }
}

/// Holds a ball `gap_m` above the block for one long step in which the tissue comes up to meet it. Gives its forces.
fn blow(model: &Arc<Model>, gap_m: f64, lift: impl Fn(&mut Sim)) -> [Vec3; 3] {
    let mut sims = simulations(model, &still());
    let at = place(model, [11.0, 9.0, 13.0]) + model.frame() * Vec3::z() * (9e-3 + gap_m);
    let forces = sims.each_mut().map(|sim| {
        let mut tool = sim.add_tool(&ToolDesc::sphere(9e-3)).unwrap();
        tool.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
        lift(sim);
        sim.step().unwrap();
        tool.force().wrench.force_n
    });
    println!("the ball feels {forces:?} N");
    forces
}

#[test]
fn tissue_that_loads_or_bones_carry_to_a_tool_is_seen_in_time() {
    if !has_gpu("tissue_that_loads_or_bones_carry_to_a_tool_is_seen_in_time") {
        return;
    }
    // Beyond the room that contact has to spare around a tool: a cell.
    let gap_m = 1.25 * CELL_M;
    let model = boned(0.0);
    let up = model.frame() * Vec3::z();
    let by_bones = blow(&model, gap_m, |sim| {
        // No further: the processor would divide triangles that have been stretched, which the GPU does not.
        let way = up * 2.0 * CELL_M;
        let to = Pose::translation(way.x, way.y, way.z);
        [2, 3].into_iter().for_each(|label| sim.drive_region(label, &to).unwrap());
    });
    let model = block(0.45, 0.0);
    let by_loads = blow(&model, gap_m, |sim| {
        let region = faces(&model, [11.0, 9.0, 13.0], [11.0, 9.0, 0.1]);
        sim.add_load(&Load::Traction { region, traction_pa: up * 800.0 }).unwrap();
    });
    for [cpu, gpu, again] in [by_bones, by_loads] {
        assert_eq!(gpu, again, "the same GPU gives the same bits");
        assert!(cpu.dot(&up) > 2e-3, "{cpu:?} N");
        assert!((cpu - gpu).norm() < SAME_BLOW * cpu.norm(), "{cpu:?} and {gpu:?} N");
    }
}
