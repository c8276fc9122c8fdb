//! The meshless model on a GPU, against the processor in double precision.
//!
//! Each solves its steps by its own iterations. So all solve them far beyond what is compared.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::math::{Pose, Quat, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::sim::{Backend, NodeField, Precision, Sim, SimDesc, SurfaceField, ToolPort};
use palpate::solver::load::{Load, Region};
use palpate::solver::method::{EfgDesc, Elasticity, Method, Rows, Scheme};
use palpate::solver::tool::{Shape, ToolDesc, ToolMotion};

use super::gpu::has_gpu;
use super::{CELL_M, GPU, difference, largest, most};

/// Cells of the models.
const CELLS: [usize; 3] = [11, 9, 7];
/// Bone, as a label.
const BONE: u16 = 3;
/// Relative differences of displacements, of velocities and of forces; in double precision what the tolerance of a solution leaves of them, in single what rounding does.
pub const SAME: [(Precision, f64, [f64; 3]); 2] =
    [(Precision::Double, 1e-11, [1e-8, 1e-7, 2e-5]), (Precision::Single, 2e-6, [1e-4, 1e-3, 2e-3])];

/// A block of two tissues, held below, perhaps around a bone.
fn block(has_bone: bool) -> Arc<Model> {
    let label = |i: usize| {
        let [x, y, z] = [i % CELLS[0], i / CELLS[0] % CELLS[1], i / (CELLS[0] * CELLS[1])];
        let is_bone = has_bone && (4..7).contains(&x) && (3..6).contains(&y) && (3..5).contains(&z);
        if is_bone { BONE } else { 1 + u16::from(x > CELLS[0] / 2) }
    };
    let labels = (0..CELLS.iter().product()).map(label).collect();
    let frame =
        Pose::from_parts(Vec3::new(0.01, -0.02, 0.03).into(), Quat::from_euler_angles(0.1, -0.2, 0.3));
    let mut build = Build::new(LabelGrid::new(CELLS, Vec3::repeat(CELL_M), frame, labels).unwrap());
    let tissue = |young_pa| {
        let mut material = Material::new("tissue", young_pa, 0.45, 1000.0).unwrap();
        material.damping_s = 1e-3;
        LabelUse::Tissue(material)
    };
    let bone = LabelUse::Rigid(Material::new("bone", 1e10, 0.3, 1900.0).unwrap());
    build.uses = BTreeMap::from([(1, tissue(3e3)), (2, tissue(6e3)), (BONE, bone)]);
    build.fixes.push(Fix { pose: frame, half_extents: Vec3::new(1.0, 1.0, 1.5 * CELL_M), axes: [true; 3] });
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// A place in cells, in the world.
fn place(model: &Model, cells: [f64; 3]) -> Vec3 {
    model.frame().transform_point(&(Vec3::from(cells) * CELL_M).into()).coords
}

/// Gravity acts, and steps are long.
fn falling(method: EfgDesc) -> SimDesc {
    SimDesc {
        method: Method::Efg(EfgDesc { max_iterations: 5000, ..method }),
        gravity_m_s2: Vec3::new(4.0, -2.0, -8.0),
        rest_under_gravity: false,
        step_s: 4e-3,
        drag_per_s: 2.0,
        ..SimDesc::default()
    }
}

/// The processor in double precision, and twice the GPU.
fn simulations(model: &Arc<Model>, desc: &SimDesc, precision: Precision, tolerance: f64) -> [Sim; 3] {
    let Method::Efg(method) = desc.method else { panic!("a meshless simulation") };
    let sim = |backend, precision, tolerance| {
        let method = Method::Efg(EfgDesc { tolerance, ..method });
        Sim::new(model.clone(), &SimDesc { backend, precision, method, ..desc.clone() }).unwrap()
    };
    [
        sim(Backend::Cpu, Precision::Double, 1e-12),
        sim(GPU, precision, tolerance),
        sim(GPU, precision, tolerance),
    ]
}

/// Whether all have come to the same, the GPU twice to the same bits: differences of displacements and velocities as shares of the largest ones so far.
fn compare(sims: &[Sim; 3], peaks: &mut [f64; 2], same: [f64; 3], what: &str) {
    for ((field, peak), same) in
        [NodeField::Displacement, NodeField::Velocity].into_iter().zip(peaks).zip(same)
    {
        let [cpu, gpu, again] = sims.each_ref().map(|sim| sim.nodes(field));
        assert!(gpu == again, "{what}: the same GPU gives the same bits");
        *peak = peak.max(largest(&cpu));
        let found = difference(&cpu, &gpu) / *peak;
        println!("{what}: {field:?} {found:e} of {peak:e}");
        assert!(found < same, "{what}: {field:?} {found:e}");
    }
}

#[test]
fn implicit_steps_are_those_of_the_processor() {
    if !has_gpu("implicit_steps_are_those_of_the_processor") {
        return;
    }
    let model = block(false);
    let elasticities = [Elasticity::Corotated, Elasticity::Linear, Elasticity::StVenantKirchhoff];
    for elasticity in elasticities {
        for scheme in [Scheme::BackwardEuler, Scheme::Paper] {
            for (precision, tolerance, same) in SAME {
                let desc = falling(EfgDesc { elasticity, scheme, ..EfgDesc::default() });
                let mut sims = simulations(&model, &desc, precision, tolerance);
                let what = format!("{elasticity:?} {scheme:?} {precision:?}");
                let mut peaks = [0.0; 2];
                for step in 0..10 {
                    sims.iter_mut().for_each(|sim| sim.step().unwrap());
                    // The first steps are small ones.
                    if step > 4 {
                        compare(&sims, &mut peaks, same, &what);
                    }
                }
                let [cpu, gpu, _] = sims.each_ref().map(Sim::statistics);
                assert!(gpu.cg_iterations > 10, "{what}: {gpu:?}");
                assert!((cpu.max_strain - gpu.max_strain).abs() < 1e-3 * cpu.max_strain, "{what}");
                assert!((cpu.volume_ratio[0] - gpu.volume_ratio[0]).abs() < 1e-4, "{what}");
                if precision == Precision::Double {
                    assert!(gpu.true_residual <= tolerance, "{what}: {}", gpu.true_residual);
                }
            }
        }
    }
}

#[test]
fn rows_of_all_cells_are_those_of_the_processor() {
    if !has_gpu("rows_of_all_cells_are_those_of_the_processor") {
        return;
    }
    let model = block(false);
    for elasticity in [Elasticity::Corotated, Elasticity::Linear, Elasticity::StVenantKirchhoff] {
        for (precision, tolerance, same) in SAME {
            let desc = falling(EfgDesc { elasticity, rows: Rows::All, ..EfgDesc::default() });
            let mut sims = simulations(&model, &desc, precision, tolerance);
            let mut without = simulations(
                &model,
                &falling(EfgDesc { elasticity, ..EfgDesc::default() }),
                precision,
                tolerance,
            );
            let what = format!("rows {elasticity:?} {precision:?}");
            let mut peaks = [0.0; 2];
            for _ in 0..8 {
                sims.iter_mut().chain(&mut without).for_each(|sim| sim.step().unwrap());
            }
            compare(&sims, &mut peaks, same, &what);
            // And those of cells that the bricks know.
            let [with, without] = [&sims[1], &without[1]].map(|sim| sim.nodes(NodeField::Displacement));
            let found = difference(&with, &without) / peaks[0];
            assert!(found < same[0], "{what}: {found:e}");
            let [cpu, gpu, _] = sims.each_ref().map(Sim::statistics);
            assert!((cpu.max_strain - gpu.max_strain).abs() < 1e-3 * cpu.max_strain, "{what}");
            assert!((cpu.volume_ratio[0] - gpu.volume_ratio[0]).abs() < 1e-4, "{what}");
        }
    }
}

#[test]
fn what_a_tool_holds_in_implicit_steps_goes_where_it_goes_and_pulls_as_on_the_processor() {
    if !has_gpu("what_a_tool_holds_in_implicit_steps_goes_where_it_goes_and_pulls_as_on_the_processor") {
        return;
    }
    let model = block(false);
    for (precision, tolerance, _) in SAME {
        // Alone; and while another tool presses beside it.
        for is_alone in [true, false] {
            let what = format!("held {precision:?}, alone {is_alone}");
            let mut sims = simulations(&model, &falling(EfgDesc::default()), precision, tolerance);
            let mut holders = sims.each_mut().map(|sim| sim.add_tool(&ToolDesc::sphere(CELL_M)).unwrap());
            let id = holders.each_ref().map(ToolPort::id);
            let mut pressers = sims
                .each_mut()
                .map(|sim| sim.add_tool(&ToolDesc { friction: 0.3, ..ToolDesc::sphere(7e-3) }).unwrap());
            let mut step = |sims: &mut [Sim; 3], t: f64| {
                let origin = place(&model, [7.0, 4.5, 8.2]);
                let way = model.frame() * (Vec3::new(1e-3, 5e-4, 2e-3) * t);
                let held =
                    Pose::from_parts((origin + way).into(), Quat::from_scaled_axis(Vec3::z() * (0.2 * t)));
                let lift = if is_alone { 0.05 } else { 1e-3 - 2e-3 * t };
                let beside = place(&model, [3.0, 4.5, 7.0]) + model.frame() * Vec3::z() * (7e-3 + lift);
                for i in 0..3 {
                    holders[i].set_motion(&ToolMotion::at(held)).unwrap();
                    let at = Pose::translation(beside.x, beside.y, beside.z);
                    pressers[i].set_motion(&ToolMotion::at(at)).unwrap();
                    sims[i].step().unwrap();
                }
                [&mut holders, &mut pressers].map(|tools| tools.each_mut().map(|tool| tool.force().wrench))
            };
            step(&mut sims, 0.0);
            let held = [0, 1, 2].map(|i| sims[i].grasp(id[i], 2.5 * CELL_M).unwrap());
            assert!(held[0] > 4 && held[0] == held[1], "{what}: {held:?}");
            let mut peaks = [0.0; 2];
            for round in 1..=20 {
                let forces = step(&mut sims, f64::from(round) / 20.0);
                if round < 10 {
                    continue;
                }
                // The tool's pose turns what it holds in single precision.
                compare(&sims, &mut peaks, [1e-4, 2e-3, 0.0], &what);
                for [expected, found, again] in forces {
                    assert_eq!(found, again, "{what}: the same GPU gives the same bits");
                    let force = expected.force_n.norm();
                    let apart = (expected.force_n - found.force_n).norm()
                        + (expected.torque_n_m - found.torque_n_m).norm() / 7e-3;
                    println!("{what}: {apart:e} of {force:e} N");
                    assert!(apart <= 5e-3 * force, "{what}: {apart:e} of {force:e} N");
                }
            }
            for i in 0..3 {
                sims[i].release(id[i]).unwrap();
            }
            step(&mut sims, 1.0);
            let forces = step(&mut sims, 1.0);
            assert!(
                forces[0].iter().all(|wrench| wrench.force_n == Vec3::zeros()),
                "{what}: {:?}",
                forces[0]
            );
        }
    }
}

#[test]
fn loads_and_driven_bones_act_as_on_the_processor() {
    if !has_gpu("loads_and_driven_bones_act_as_on_the_processor") {
        return;
    }
    let model = block(true);
    let top = Region {
        pose: Pose::from_parts(place(&model, [5.5, 4.5, 7.0]).into(), model.frame().rotation),
        half_extents_m: Vec3::new(4.0, 4.0, 0.1) * CELL_M,
    };
    let loads = [
        Load::Point { at_m: place(&model, [9.3, 4.4, 5.2]), force_n: Vec3::new(1e-3, 2e-3, -1e-3) },
        Load::Traction { region: top, traction_pa: Vec3::new(20.0, -10.0, 15.0) },
        Load::Pressure { region: top, pressure_pa: 60.0 },
    ];
    let bone_at = |share: f64| {
        let centre = place(&model, [5.5, 4.5, 4.0]);
        let turned = Pose::from_parts(
            (centre + Vec3::new(-3e-4, 1e-4, 5e-4) * share).into(),
            Quat::from_scaled_axis(Vec3::new(0.04, 0.0, -0.03) * share),
        );
        turned * Pose::translation(-centre.x, -centre.y, -centre.z)
    };
    for (precision, tolerance, same) in SAME {
        let mut sims = simulations(&model, &falling(EfgDesc::default()), precision, tolerance);
        let ids = sims.each_mut().map(|sim| loads.map(|load| sim.add_load(&load).unwrap()));
        let mut peaks = [0.0; 2];
        for step in 0..10 {
            for sim in &mut sims {
                sim.drive_region(BONE, &bone_at(f64::from(step) / 10.0)).unwrap();
                sim.step().unwrap();
            }
        }
        compare(&sims, &mut peaks, same, &format!("loaded and driven {precision:?}"));
        // What is driven is where it was taken, to the last digit of its displacement.
        let [u, rest] = [NodeField::Displacement, NodeField::RestPosition].map(|field| sims[1].nodes(field));
        let bone = &model.regions()[&BONE];
        let nodes = model.lattice().slots().zip(u.iter().zip(&rest)).filter(|(slot, _)| bone.contains(slot));
        let off =
            most(nodes.map(|(_, (u, x))| (bone_at(0.9).transform_point(&(*x).into()).coords - x - u).norm()));
        assert!(off < 4.0 * f64::from(f32::EPSILON) * largest(&u), "{off:e} m");

        for (sim, ids) in sims.iter_mut().zip(ids) {
            ids.into_iter().for_each(|id| sim.remove_load(id).unwrap());
            (0..5).for_each(|_| sim.step().unwrap());
        }
        compare(&sims, &mut peaks, same, &format!("let go of {precision:?}"));

        let left = sims.each_mut().map(|sim| sim.settle(1e-9, 8).unwrap());
        println!("settled: {left:?} m/s² left");
        compare(&sims, &mut peaks, same, &format!("settled {precision:?}"));
    }
}

/// Presses a tool with a tip of this radius into the top of the block and strokes it. Gives the simulations, the tools, the largest force, and the largest
/// difference from the processor's.
fn press(
    desc: &SimDesc,
    tool: ToolDesc,
    radius_m: f64,
    tolerance: f64,
) -> ([Sim; 3], [ToolPort; 3], f64, f64) {
    let model = block(false);
    let mut sims = simulations(&model, desc, desc.precision, tolerance);
    let tool = ToolDesc { friction: 0.3, ..tool };
    let mut tools = sims.each_mut().map(|sim| sim.add_tool(&tool).unwrap());
    let [outward, along] = [Vec3::z(), Vec3::x()].map(|axis| model.frame() * axis);
    let (mut force, mut apart) = (0.0_f64, 0.0_f64);
    for step in 0..20 {
        let deep = (2e-4 * f64::from(step)).min(1.6e-3);
        let aside = 1e-4 * f64::from((step - 10).max(0));
        let at = place(&model, [5.5, 4.5, 7.0]) + outward * (radius_m - deep) + along * aside;
        for (sim, tool) in sims.iter_mut().zip(&mut tools) {
            tool.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
            sim.step().unwrap();
        }
        let [a, b, c] = tools.each_mut().map(|tool| tool.force().wrench);
        assert_eq!(b, c, "the same GPU gives the same bits");
        force = force.max(a.force_n.norm());
        apart = apart.max((a.force_n - b.force_n).norm() + (a.torque_n_m - b.torque_n_m).norm() / radius_m);
    }
    println!("radius {radius_m} m, {:?}: force {force:e} N, difference {apart:e} N", desc.precision);
    (sims, tools, force, apart)
}

#[test]
fn a_press_inside_the_implicit_step_feels_as_on_the_processor() {
    if !has_gpu("a_press_inside_the_implicit_step_feels_as_on_the_processor") {
        return;
    }
    for (precision, tolerance, same) in SAME {
        let desc = SimDesc { precision, ..falling(EfgDesc::default()) };
        let (mut sims, mut tools, force, apart) = press(&desc, ToolDesc::sphere(7e-3), 7e-3, tolerance);
        assert!(force > 1e-2 && apart < same[2] * force, "{apart:e} of {force:e} N");

        let id = tools.each_ref().map(ToolPort::id);
        let touched = [0, 1].map(|i| sims[i].contacts(id[i]).unwrap());
        assert_eq!(touched[0].len(), touched[1].len());
        let sum = touched[1].iter().map(|contact| contact.force_n).sum::<Vec3>();
        let last = tools[1].force().wrench.force_n;
        assert!((sum + last).norm() < 1e-4 * last.norm(), "contacts of the last step against its force");
        assert_eq!(sims[0].statistics().contact_points, sims[1].statistics().contact_points);

        let surface = sims[0].model().contact_surface();
        let mut ports = [0, 1].map(|i| sims[i].open_surface(surface).unwrap());
        ports.iter_mut().for_each(|port| port.set_field(SurfaceField::Strain));
        let [cpu, gpu] = ports.each_mut().map(|port| port.map().unwrap());
        let pairs = cpu.positions.iter().flatten().zip(gpu.positions.iter().flatten());
        assert!(most(pairs.map(|(a, b)| f64::from((a - b).abs()))) < 2e-6, "m");
    }
}

#[test]
fn a_tip_finer_than_cells_feels_as_on_the_processor_in_implicit_steps() {
    if !has_gpu("a_tip_finer_than_cells_feels_as_on_the_processor_in_implicit_steps") {
        return;
    }
    // A tip that divides triangles on a shaft that does not.
    let tip = 0.8 * CELL_M;
    let mut tool = ToolDesc::sphere(tip);
    tool.parts
        .push((Pose::translation(0.0, 0.0, 0.04), Shape::Capsule { radius_m: 7e-3, half_length_m: 0.02 }));
    for (precision, tolerance, same) in SAME {
        let desc = SimDesc { precision, ..falling(EfgDesc::default()) };
        let (.., force, apart) = press(&desc, tool.clone(), tip, tolerance);
        assert!(force > 1e-3 && apart < same[2] * force, "{apart:e} of {force:e} N");
    }
}

#[test]
fn bone_is_the_same_wall_on_both() {
    if !has_gpu("bone_is_the_same_wall_on_both") {
        return;
    }
    // Bone that nothing moves, on tissue that says how stiff it is.
    let labels = (0..75).map(|i| if i < 25 { 1 } else { BONE }).collect();
    let grid = LabelGrid::new([5, 5, 3], Vec3::repeat(CELL_M), Pose::identity(), labels).unwrap();
    let mut build = Build::new(grid);
    let bone = LabelUse::Rigid(Material::new("bone", 1e10, 0.3, 1900.0).unwrap());
    let tissue = LabelUse::Tissue(Material::new("tissue", 5e3, 0.45, 1000.0).unwrap());
    build.uses = BTreeMap::from([(1, tissue), (BONE, bone)]);
    let model = Arc::new(build.run(&mut |_, _| true).unwrap());
    let (precision, tolerance, same) = SAME[1];
    let mut sims = simulations(&model, &falling(EfgDesc::default()), precision, tolerance);
    let at = Vec3::new(2.0, 2.0, 2.5) * CELL_M + Vec3::z() * (5e-3 - 3e-4);
    let forces = sims.each_mut().map(|sim| {
        let mut tool = sim.add_tool(&ToolDesc::sphere(5e-3)).unwrap();
        tool.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
        sim.step().unwrap();
        tool.force().wrench.force_n
    });
    assert!(forces[0].z > 0.0 && (forces[0] - forces[1]).norm() < same[2] * forces[0].norm(), "{forces:?}");
}

#[test]
fn implicit_steps_after_a_change_or_a_reset_are_those_of_the_processor() {
    if !has_gpu("implicit_steps_after_a_change_or_a_reset_are_those_of_the_processor") {
        return;
    }
    let model = block(false);
    let (precision, tolerance, same) = SAME[0];
    let mut sims = simulations(&model, &falling(EfgDesc::default()), precision, tolerance);
    let mut peaks = [0.0; 2];
    let mut steps = |sims: &mut [Sim; 3], what: &str| {
        sims.iter_mut().for_each(|sim| (0..5).for_each(|_| sim.step().unwrap()));
        compare(sims, &mut peaks, same, what);
        sims[1].nodes(NodeField::Displacement)
    };
    let first = steps(&mut sims, "at first");
    let stiffer = Material::new("tissue", 9e3, 0.3, 1100.0).unwrap();
    sims.iter_mut().for_each(|sim| sim.set_material(1, &stiffer).unwrap());
    steps(&mut sims, "of other material");
    let side = Fix {
        pose: model.frame(),
        half_extents: Vec3::new(1.5 * CELL_M, 1.0, 1.0),
        axes: [true, false, true],
    };
    sims.iter_mut().for_each(|sim| assert!(sim.fix(&side).unwrap() > 0));
    steps(&mut sims, "held aside");
    sims.iter_mut().for_each(|sim| assert!(sim.free(&side).unwrap() > 0));
    steps(&mut sims, "free again");
    let mut fresh = simulations(&model, &falling(EfgDesc::default()), precision, tolerance);
    fresh[1].reset();
    fresh[2].step().unwrap();
    fresh[2].reset();
    assert!(steps(&mut fresh, "reset") == first, "a reset simulation is as good as new");
}

/// One cell that can only stretch along x.
fn oscillator() -> Arc<Model> {
    let grid = LabelGrid::new([1; 3], Vec3::repeat(CELL_M), Pose::identity(), vec![1]).unwrap();
    let mut build = Build::new(grid);
    build.uses = BTreeMap::from([(1, LabelUse::Tissue(Material::new("tissue", 5e3, 0.3, 1000.0).unwrap()))]);
    // A grid's origin is the middle of its first voxel.
    let root = Pose::translation(-0.5 * CELL_M, 0.0, 0.0);
    let whole = Vec3::repeat(1.0);
    build.fixes.push(Fix { pose: root, half_extents: Vec3::new(1e-4, 1.0, 1.0), axes: [true; 3] });
    build.fixes.push(Fix { pose: Pose::identity(), half_extents: whole, axes: [false, true, true] });
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

#[test]
fn what_swings_on_a_gpu_is_damped_as_its_scheme_says() {
    if !has_gpu("what_swings_on_a_gpu_is_damped_as_its_scheme_says") {
        return;
    }
    let tissue = Material::new("tissue", 5e3, 0.3, 1000.0).unwrap();
    let modulus = tissue.lame_lambda_pa() + 2.0 * tissue.shear_modulus_pa();
    let model = oscillator();
    let far =
        model.lattice().slots().find(|&slot| model.lattice().rest_position(slot).x > 0.5 * CELL_M).unwrap();
    for (dt, scheme) in
        [1e-4, 1e-3, 1e-2].into_iter().flat_map(|dt| [(dt, Scheme::BackwardEuler), (dt, Scheme::Paper)])
    {
        // Half the mass swings on a bar of one cell.
        let s = 2.0 * modulus / (1000.0 * CELL_M * CELL_M) * dt * dt;
        // u and v go by a matrix of this trace and determinant.
        let (trace, determinant) = match scheme {
            Scheme::BackwardEuler => (2.0 / (1.0 + s), 1.0 / (1.0 + s)),
            Scheme::Paper => (1.0 + 1.0 / (1.0 + s), 1.0),
        };
        let method =
            EfgDesc { elasticity: Elasticity::Linear, scheme, tolerance: 1e-12, ..EfgDesc::default() };
        let desc = SimDesc {
            method: Method::Efg(method),
            backend: GPU,
            precision: Precision::Double,
            gravity_m_s2: Vec3::zeros(),
            drag_per_s: 0.0,
            step_s: dt,
            ..SimDesc::default()
        };
        let mut sim = Sim::new(model.clone(), &desc).unwrap();
        for slot in model.lattice().slots() {
            let stretch = model.lattice().rest_position(slot).x / CELL_M;
            sim.set_node(slot, Vec3::x() * (1e-6 * stretch), Vec3::zeros()).unwrap();
        }
        let place = model.lattice().slots().position(|slot| slot == far).unwrap();
        let mut u = vec![sim.nodes(NodeField::Displacement)[place].x];
        for _ in 0..20 {
            sim.step().unwrap();
            u.push(sim.nodes(NodeField::Displacement)[place].x);
        }
        for n in 1..20 {
            let off = (u[n + 1] - trace * u[n] + determinant * u[n - 1]) / u[0];
            assert!(off.abs() < 1e-9, "{scheme:?}, dt {dt}, step {n}: {off:e}");
        }
    }
}
