//! The GPU's backend against the processor's. What needs a GPU is skipped, and says so, where there is none.

#[path = "cuda/changes.rs"]
mod changes;
#[path = "cuda/cutting.rs"]
mod cutting;
#[path = "cuda/efg.rs"]
mod efg;
#[path = "support/gpu.rs"]
mod gpu;
#[path = "cuda/outside.rs"]
mod outside;
#[path = "cuda/sleep.rs"]
mod sleep;
#[path = "cuda/snapshot.rs"]
mod snapshot;

use std::collections::BTreeMap;
use std::sync::Arc;

use gpu::has_gpu;
use palpate::cuda::device::Device;
use palpate::error::Error;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::sim::{Backend, NodeField, Place, Precision, Sim, SimDesc, SurfaceField, ToolPort};
use palpate::solver::load::Load;
use palpate::solver::tool::{Shape, ToolDesc, ToolMotion};

/// Relative difference of displacements after a thousand substeps in single precision, at strains of some percent.
const SAME_MOTION: f64 = 1e-5;
/// And of velocities: an acceleration is a small difference of large forces, and keeps what rounding does to those.
const SAME_SPEED: f64 = 1e-4;
/// Relative difference of forces: the two backends find the impulses by different iterations.
const SAME_FORCE: f64 = 1e-4;
/// And of tools finer than the surface, where many sites hang on few nodes: neither iteration is at its end when it stops.
const SAME_TIP_FORCE: f64 = 1e-2;
/// Edge of a cell in m.
const CELL_M: f64 = 2e-3;

/// The largest of numbers, or a NaN once one is met: a maximum alone would lose it.
fn most(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.fold(0.0, |most, x| if x <= most { most } else { x })
}

/// A block of two tissues, held below.
fn block(poisson: f64, damping_s: f64) -> Arc<Model> {
    block_of([22, 18, 13], poisson, damping_s)
}

/// The same of any size, in cells.
fn block_of(dims: [usize; 3], poisson: f64, damping_s: f64) -> Arc<Model> {
    let labels =
        (0..dims.iter().product()).map(|i: usize| 1 + u16::from(i % dims[0] > dims[0] / 2)).collect();
    let frame = Pose::from_parts(
        Vec3::new(0.01, -0.02, 0.03).into(),
        palpate::math::Quat::from_euler_angles(0.1, -0.2, 0.3),
    );
    let mut build = Build::new(LabelGrid::new(dims, Vec3::repeat(CELL_M), frame, labels).unwrap());
    let tissue = |young_pa| {
        let mut material = Material::new("tissue", young_pa, poisson, 1000.0).unwrap();
        material.damping_s = damping_s;
        LabelUse::Tissue(material)
    };
    build.uses = BTreeMap::from([(1, tissue(3e3)), (2, tissue(6e3))]);
    build.fixes.push(Fix { pose: frame, half_extents: Vec3::new(1.0, 1.0, 1.5 * CELL_M), axes: [true; 3] });
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// A ball of tissue, held below.
fn ball() -> Arc<Model> {
    let (cells, radius) = (24_usize, 11.0);
    let middle = Vec3::repeat(0.5 * cells as f64);
    let label = |i: usize| {
        let cell = [i % cells, i / cells % cells, i / (cells * cells)].map(|x| x as f64 + 0.5);
        u16::from((Vec3::from(cell) - middle).norm() < radius)
    };
    let labels = (0..cells.pow(3)).map(label).collect();
    let mut build =
        Build::new(LabelGrid::new([cells; 3], Vec3::repeat(CELL_M), Pose::identity(), labels).unwrap());
    let tissue = LabelUse::Tissue(Material::new("tissue", 5e3, 0.45, 1000.0).unwrap());
    build.uses = BTreeMap::from([(0, LabelUse::Empty), (1, tissue)]);
    let low = Pose::translation(0.0, 0.0, CELL_M);
    build.fixes.push(Fix { pose: low, half_extents: Vec3::new(1.0, 1.0, 3.0 * CELL_M), axes: [true; 3] });
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

fn desc(backend: Backend, precision: Precision) -> SimDesc {
    SimDesc {
        backend,
        precision,
        gravity_m_s2: Vec3::new(4.0, -2.0, -8.0),
        rest_under_gravity: false,
        // The same ones for both: how many there ought to be hangs on the last bits of a strain.
        substeps: Some(8),
        sleeping: false,
        ..SimDesc::default()
    }
}

fn simulation(model: &Arc<Model>, backend: Backend, precision: Precision) -> Sim {
    Sim::new(model.clone(), &desc(backend, precision)).unwrap()
}

const GPU: Backend = Backend::Cuda { index: None };

/// The largest value of a field.
fn largest(field: &[Vec3]) -> f64 {
    most(field.iter().map(Vec3::norm))
}

/// The largest difference between two fields.
fn difference(a: &[Vec3], b: &[Vec3]) -> f64 {
    most(a.iter().zip(b).map(|(a, b)| (a - b).norm()))
}

#[test]
fn without_a_gpu_the_error_says_why() {
    if let Err(error) = Device::open(None) {
        assert!(matches!(error, Error::NoDevice(_)), "{error}");
        assert!(error.to_string().len() > "no GPU: ".len());
    }
}

#[test]
fn auto_takes_the_gpu_that_there_is_or_says_why_not() {
    let model = block(0.45, 0.0);
    let place = simulation(&model, Backend::Auto, Precision::Single).place().clone();
    match Device::open(None) {
        Ok(device) => {
            let index = Some(device.info().index);
            let name = device.info().name.clone();
            assert_eq!(place, Place { backend: Backend::Cuda { index }, device: name, fallback: None });
        }
        Err(error) => {
            assert_eq!(place.backend, Backend::Cpu);
            assert_eq!(place.fallback, Some(error.to_string()));
        }
    }

    // No GPU does this.
    let place = simulation(&model, Backend::Auto, Precision::Double).place().clone();
    assert_eq!(place.backend, Backend::Cpu);
    assert!(place.fallback.unwrap().contains("single precision"));
    assert_eq!(simulation(&model, Backend::Cpu, Precision::Single).place().fallback, None);
}

#[test]
fn a_gpu_that_does_not_exist_is_refused() {
    assert!(Device::open(Some(1_000_000)).is_err());
}

#[test]
fn free_motion_is_that_of_the_processor() {
    if !has_gpu("free_motion_is_that_of_the_processor") {
        return;
    }
    for (poisson, damping_s) in [(0.25, 0.0), (0.45, 0.0), (0.45, 1e-4)] {
        let model = block(poisson, damping_s);
        let (mut cpu, mut gpu) =
            (simulation(&model, Backend::Cpu, Precision::Double), simulation(&model, GPU, Precision::Single));
        // Velocities die away; what they are measured by does not.
        let mut peaks = [0.0_f64; 2];
        let fields = [NodeField::Displacement, NodeField::Velocity];
        while cpu.statistics().substeps < 1000 {
            cpu.step().unwrap();
            gpu.step().unwrap();
            for (peak, field) in peaks.iter_mut().zip(fields) {
                *peak = peak.max(largest(&cpu.nodes(field)));
            }
        }
        for ((peak, field), tolerance) in peaks.into_iter().zip(fields).zip([SAME_MOTION, SAME_SPEED]) {
            let found = difference(&cpu.nodes(field), &gpu.nodes(field)) / peak;
            println!("nu {poisson} damping {damping_s}: {field:?} {found:e} of {peak:e}");
            assert!(found < tolerance, "{field:?}: {found:e}");
        }
        let (of_cpu, of_gpu) = (cpu.statistics(), gpu.statistics());
        assert!((of_cpu.max_strain - of_gpu.max_strain).abs() < 1e-3 * of_cpu.max_strain);
        assert!((of_cpu.volume_ratio[0] - of_gpu.volume_ratio[0]).abs() < 1e-4);
    }
}

#[test]
fn a_step_says_how_long_the_gpu_worked_and_reading_nodes_what_was_copied() {
    if !has_gpu("a_step_says_how_long_the_gpu_worked_and_reading_nodes_what_was_copied") {
        return;
    }
    let mut sim = simulation(&block(0.45, 0.0), GPU, Precision::Single);
    let mut copied = [sim.statistics().copied; 3];
    for step in 0..60 {
        sim.step().unwrap();
        let now = sim.statistics();
        // The GPU's clock may tick once in a microsecond.
        assert!(now.step_device_s < now.step_wall_s + 2e-6, "{now:?}");
        assert!(now.step_device_s > 1e-6, "eight kernels one after the other: {now:?}");
        copied[step % 3] = now.copied;
    }
    let grown = |from: usize, to: usize| {
        (copied[to].to_device - copied[from].to_device, copied[to].to_host - copied[from].to_host)
    };
    assert_eq!(grown(0, 1), grown(1, 2), "each step copies as much as the next");
    assert!(grown(0, 1).0 > 0 && grown(0, 1).1 > 0);

    // Four numbers of displacement, or three of velocity, for each of a brick's 8 × 4 × 4 places; once after a step.
    for (field, bytes) in [(NodeField::Displacement, 16), (NodeField::Velocity, 28)] {
        assert!(sim.nodes(field) == sim.nodes(field));
        let read = sim.statistics().copied.to_host - copied[2].to_host;
        assert_eq!(read, sim.statistics().awake_bricks * 128 * bytes);
    }
}

/// Presses a tool with a tip of this radius into the top of the model and strokes it, on the processor and twice on the GPU. Gives the
/// simulations, the tools, the largest force, and the largest difference between both.
fn press(
    model: &Arc<Model>,
    desc: ToolDesc,
    radius_m: f64,
    depth_m: f64,
) -> ([Sim; 3], [ToolPort; 3], f64, f64) {
    let mut sims = [(Backend::Cpu, Precision::Double), (GPU, Precision::Single), (GPU, Precision::Single)]
        .map(|(backend, precision)| simulation(model, backend, precision));
    let surface = &model.surfaces()[model.contact_surface()];
    let [least, most] = [f64::INFINITY, f64::NEG_INFINITY].map(Vec3::repeat);
    let (low, high) =
        surface.positions.iter().fold((least, most), |(low, high), p| (low.inf(p), high.sup(p)));
    let top = Vec3::new(0.5 * (low.x + high.x), 0.5 * (low.y + high.y), high.z);
    let centre = model.frame().transform_point(&top.into()).coords;
    let outward = model.frame() * Vec3::z();
    let desc = ToolDesc { friction: 0.3, ..desc };
    let mut tools = sims.each_mut().map(|sim| sim.add_tool(&desc).unwrap());
    let along = model.frame() * Vec3::x();
    let (mut force, mut apart) = (0.0_f64, 0.0_f64);
    for step in 0..250 {
        let deep = (depth_m / 20.0 * f64::from(step)).min(depth_m);
        let aside = 1e-5 * f64::from((step - 120).max(0));
        let at = centre + outward * (radius_m + 5e-4 - deep) + along * aside;
        for (sim, tool) in sims.iter_mut().zip(&mut tools) {
            tool.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
            sim.step().unwrap();
        }
        let [a, b, c] = tools.each_mut().map(|tool| tool.force().wrench);
        assert_eq!(b, c, "the same GPU gives the same bits");
        force = force.max(a.force_n.norm());
        apart = apart.max((a.force_n - b.force_n).norm() + (a.torque_n_m - b.torque_n_m).norm() / radius_m);
    }
    println!("radius {radius_m} m: force {force:e} N, difference {apart:e} N");
    (sims, tools, force, apart)
}

#[test]
fn a_tip_smaller_than_a_cell_feels_as_on_the_processor() {
    if !has_gpu("a_tip_smaller_than_a_cell_feels_as_on_the_processor") {
        return;
    }
    let radius = 0.8 * CELL_M;
    let (.., force, apart) = press(&block(0.45, 0.0), ToolDesc::sphere(radius), radius, 2e-3);
    assert!(apart < SAME_TIP_FORCE * force);
}

#[test]
fn a_ball_on_a_thin_shaft_presses_a_round_body_as_on_the_processor() {
    if !has_gpu("a_ball_on_a_thin_shaft_presses_a_round_body_as_on_the_processor") {
        return;
    }
    // The shaft decides how fine sites are, and the ball how many.
    let (ball_m, shaft_m) = (9e-3, 2e-3);
    let shaft = Shape::Capsule { radius_m: shaft_m, half_length_m: 0.04 };
    let mut desc = ToolDesc::sphere(ball_m);
    desc.parts.push((Pose::translation(0.0, 0.0, 0.04), shaft));
    let (sims, _, force, apart) = press(&ball(), desc, ball_m, 8e-3);
    assert!(apart < SAME_TIP_FORCE * force);
    for sim in sims {
        assert_eq!(sim.statistics().dropped_points, 0);
    }
}

#[test]
fn a_press_feels_and_looks_as_on_the_processor() {
    if !has_gpu("a_press_feels_and_looks_as_on_the_processor") {
        return;
    }
    let model = block(0.45, 0.0);
    let (mut sims, mut tools, force, apart) = press(&model, ToolDesc::sphere(9e-3), 9e-3, 5e-3);
    assert!(apart < SAME_FORCE * force);

    let id = tools.each_ref().map(ToolPort::id);
    let touched = [0, 1].map(|i| sims[i].contacts(id[i]).unwrap());
    assert_eq!(touched[0].len(), touched[1].len());
    let sum = touched[1].iter().map(|contact| contact.force_n).sum::<Vec3>();
    let last = tools[1].force().wrench.force_n;
    assert!((sum + last).norm() < 0.05 * last.norm(), "contacts of the last substep against the step's mean");

    for field in [SurfaceField::Displacement, SurfaceField::Strain] {
        let mut ports = [0, 1].map(|i| sims[i].open_surface(model.contact_surface()).unwrap());
        ports.iter_mut().for_each(|port| port.set_field(field));
        let [cpu, gpu] = ports.each_mut().map(|port| port.map().unwrap());
        let apart = |a: &[[f32; 4]], b: &[[f32; 4]]| {
            let pairs = a.iter().flatten().zip(b.iter().flatten());
            most(pairs.map(|(a, b)| f64::from((a - b).abs())))
        };
        assert!(apart(cpu.positions, gpu.positions) < 1e-6, "m");
        assert!(apart(cpu.normals, gpu.normals) < 1e-3);
        let largest = most(cpu.scalars.iter().map(|x| f64::from(*x)));
        let pairs = cpu.scalars.iter().zip(gpu.scalars);
        let off = most(pairs.map(|(a, b)| f64::from((a - b).abs())));
        assert!(off < 1e-3 * largest, "{field:?}: {off} of {largest}");
    }
}

/// All kernels in a moment: so small that tools that check every access to memory come to an end.
#[test]
fn a_moment_of_everything_is_that_of_the_processor() {
    if !has_gpu("a_moment_of_everything_is_that_of_the_processor") {
        return;
    }
    let dims = [7, 6, 5];
    let model = block_of(dims, 0.45, 2e-5);
    let top = model.frame().transform_point(&(Vec3::new(3.5, 3.0, 5.0) * CELL_M).into()).coords;
    let (outward, along) = (model.frame() * Vec3::z(), model.frame() * Vec3::x());
    let [cpu, gpu] =
        [(Backend::Cpu, Precision::Double), (GPU, Precision::Single)].map(|(backend, precision)| {
            // So much drag that tissue creeps: what bounces off a tool comes back by how it was pushed to the last digit.
            let desc = SimDesc { drag_per_s: 2e3, ..desc(backend, precision) };
            let mut sim = Sim::new(model.clone(), &desc).unwrap();
            // A tool with few sites, and one with many.
            let mut felt = Vec::new();
            for (radius_m, side) in [(6e-3, -4e-3), (1.6e-3, 4e-3)] {
                let mut tool =
                    sim.add_tool(&ToolDesc { friction: 0.3, ..ToolDesc::sphere(radius_m) }).unwrap();
                for step in 0..3 {
                    let at = top + outward * (radius_m - 2e-4 * f64::from(step)) + along * side;
                    tool.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
                    sim.step().unwrap();
                }
                felt.push(tool.force().wrench.force_n);
            }
            sim.add_load(&Load::Point { at_m: top, force_n: outward * 1e-3 }).unwrap();
            sim.settle(1.0, 60).unwrap();
            let mut surface = sim.open_surface(model.contact_surface()).unwrap();
            felt.push(
                surface
                    .map()
                    .unwrap()
                    .positions
                    .iter()
                    .map(|p| Vec3::new(p[0].into(), p[1].into(), p[2].into()))
                    .sum(),
            );
            felt
        });
    for (cpu, gpu) in cpu.iter().zip(&gpu) {
        assert!(
            cpu.norm() > 0.0 && (cpu - gpu).norm() < SAME_TIP_FORCE * cpu.norm(),
            "{cpu} on the processor, {gpu} on the GPU"
        );
    }
}

#[test]
fn bricks_near_tools_that_advance_first_move_as_if_all_advanced_together() {
    if !has_gpu("bricks_near_tools_that_advance_first_move_as_if_all_advanced_together") {
        return;
    }
    for damping_s in [0.0, 2e-5] {
        // So large that near bricks come first; where a load acts, be it none at all, all come together.
        let dims = [80, 60, 36];
        let model = block_of(dims, 0.45, damping_s);
        let mut sims = [0, 1].map(|_| simulation(&model, GPU, Precision::Single));
        let place = |cell: Vec3| model.frame().transform_point(&(cell * CELL_M).into()).coords;
        sims[0].add_load(&Load::Point { at_m: place(Vec3::zeros()), force_n: Vec3::zeros() }).unwrap();
        let desc = ToolDesc { friction: 0.3, ..ToolDesc::sphere(9e-3) };
        let mut tools = sims.each_mut().map(|sim| sim.add_tool(&desc).unwrap());
        let top = place(Vec3::new(40.0, 30.0, 36.0));
        let (outward, along) = (model.frame() * Vec3::z(), model.frame() * Vec3::x());
        let mut most_n = 0.0;
        for step in 0..60 {
            // In, and then aside: so fast that contact takes several moves in a substep.
            let (deep, aside) =
                if step < 40 { (2e-4 * f64::from(step), 0.0) } else { (4e-3, 3e-3 * f64::from(step - 39)) };
            let at = top + outward * (9e-3 - deep) + along * aside;
            for (sim, tool) in sims.iter_mut().zip(&mut tools) {
                tool.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
                sim.step().unwrap();
            }
            let [together, apart] = tools.each_mut().map(|tool| tool.force().wrench);
            assert_eq!(together, apart, "step {step}");
            most_n = together.force_n.norm().max(most_n);
        }
        assert!(most_n > 0.1, "{most_n} N");
        for field in [NodeField::Displacement, NodeField::Velocity] {
            let [together, apart] = sims.each_ref().map(|sim| sim.nodes(field));
            assert!(together == apart, "{field:?} differ by {:e}", difference(&together, &apart));
        }
    }
}

#[test]
fn two_tools_and_a_reset_leave_no_trace() {
    if !has_gpu("two_tools_and_a_reset_leave_no_trace") {
        return;
    }
    let model = block(0.45, 0.0);
    let centre = model.frame().transform_point(&(Vec3::new(11.0, 9.0, 13.0) * CELL_M).into()).coords;
    let outward = model.frame() * Vec3::z();
    let along = model.frame() * Vec3::x();
    let mut sim = simulation(&model, GPU, Precision::Single);
    // Both are inside the tissue from the first substep on, and share vertices.
    let mut tools =
        [0, 1].map(|_| sim.add_tool(&ToolDesc { friction: 0.3, ..ToolDesc::sphere(9e-3) }).unwrap());
    let mut press = |sim: &mut Sim| {
        let mut felt = Vec::new();
        // At the end back to where they began.
        for step in (0..20).chain([0]) {
            for (tool, side) in tools.iter_mut().zip([-4e-3, 4e-3]) {
                let at = centre + along * side + outward * (8e-3 - 1e-4 * f64::from(step));
                tool.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
            }
            sim.step().unwrap();
            felt.extend(tools.each_mut().map(|tool| tool.force().wrench));
        }
        felt
    };
    let first = press(&mut sim);
    assert!(first[..2].iter().all(|wrench| wrench.force_n.norm() > 0.0), "both press from the first step on");
    sim.reset();
    assert_eq!(press(&mut sim), first, "a reset simulation is as good as new");
}

/// Sites in both balls have two points, each with an impulse of its own.
#[test]
fn two_balls_in_the_same_tissue_push_as_on_the_processor() {
    if !has_gpu("two_balls_in_the_same_tissue_push_as_on_the_processor") {
        return;
    }
    let model = block(0.45, 0.0);
    let top = model.frame().transform_point(&(Vec3::new(11.0, 9.0, 13.0) * CELL_M).into()).coords;
    let (outward, along) = (model.frame() * Vec3::z(), model.frame() * Vec3::x());
    let [cpu, gpu] =
        [(Backend::Cpu, Precision::Double), (GPU, Precision::Single)].map(|(backend, precision)| {
            let mut sim =
                Sim::new(model.clone(), &SimDesc { drag_per_s: 2e3, ..desc(backend, precision) }).unwrap();
            let mut balls =
                [0, 1].map(|_| sim.add_tool(&ToolDesc { friction: 0.3, ..ToolDesc::sphere(9e-3) }).unwrap());
            for step in 0..40 {
                for (ball, side) in balls.iter_mut().zip([-1e-3, 1e-3]) {
                    let at = top + along * side + outward * (9e-3 - 1e-4 * f64::from(step));
                    ball.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
                }
                sim.step().unwrap();
            }
            // How two balls share a site is not determined; what both together push is.
            balls.iter_mut().map(|ball| ball.force().wrench.force_n).sum::<Vec3>()
        });
    let apart = (cpu - gpu).norm();
    assert!(cpu.dot(&outward) > 0.0 && apart < SAME_TIP_FORCE * cpu.norm(), "{cpu} against {gpu}");
}

#[test]
fn double_precision_on_a_gpu_is_refused() {
    let double = SimDesc { backend: GPU, precision: Precision::Double, ..SimDesc::default() };
    assert!(matches!(Sim::new(block(0.45, 0.0), &double), Err(Error::Unsupported(_))));
}
