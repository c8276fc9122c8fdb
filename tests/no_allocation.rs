//! A step allocates nothing, on any thread of the library, whatever goes on in it.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use palpate::math::{Pose, Vec3};
use palpate::servo::coupling::Coupling;
use palpate::servo::device::DeviceDesc;
use palpate::servo::{DeviceState, ServoOptions};
use palpate::sim::{Precision, Sim, SimDesc, ToolPort};
use palpate::solver::load::Load;
use palpate::solver::method::{EfgDesc, Method};
use palpate::solver::tool::{Shape, ToolDesc, ToolMotion};

#[path = "truth/scene.rs"]
#[allow(dead_code, reason = "a few of the shared scenes serve here")]
mod scene;

/// Counts what is asked of the system's allocator while told to.
struct Counting;

static IS_COUNTING: AtomicBool = AtomicBool::new(false);
static COUNT: AtomicU64 = AtomicU64::new(0);

/// ORDERING: the steps between two readings synchronise the threads; the counter itself needs none.
fn note() {
    if IS_COUNTING.load(Ordering::Relaxed) {
        COUNT.fetch_add(1, Ordering::Relaxed);
    }
}

// SAFETY: every call is handed on unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note();
        // SAFETY: as this function's caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        note();
        // SAFETY: as this function's caller promised.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note();
        // SAFETY: as this function's caller promised.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const H: f64 = 4e-3;

/// Tissue with a bone in it, loads, gravity and two tools, one of them with a servo loop.
fn scene_of(method: Method, precision: Precision, threads: usize, damping_s: f64) -> (Sim, [ToolPort; 2]) {
    let mut tissue = scene::material(5e3, 0.45, 1000.0);
    tissue.damping_s = damping_s;
    let bone = palpate::model::LabelUse::Rigid(scene::material(1e9, 0.3, 1900.0));
    let label = |[i, _, k]: [usize; 3]| if i < 2 && k < 2 { 2 } else { 1 };
    let uses = [(1, palpate::model::LabelUse::Tissue(tissue)), (2, bone)];
    let mut build = scene::voxels([16, 8, 8], H, label, &uses);
    scene::hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
    let model = Arc::new(build.run(&mut |_, _| true).unwrap());
    let desc = SimDesc { method, precision, threads, drag_per_s: 130.0, ..SimDesc::default() };
    let mut sim = Sim::new(model, &desc).unwrap();

    let region = scene::faces_at(0, 16.0 * H);
    sim.add_load(&Load::Traction { region, traction_pa: Vec3::new(0.0, 0.0, 2.0) }).unwrap();
    sim.add_load(&Load::Pressure { region, pressure_pa: 2.0 }).unwrap();
    let ball = Shape::Sphere { radius_m: 6e-3 };
    let parts = vec![(Pose::identity(), ball), (Pose::translation(5e-3, 0.0, 0.0), ball)];
    let [plain, rough] = [0.0, 0.4].map(|friction| ToolDesc { parts: parts.clone(), friction, blade: None });
    // One of them is held by a haptic device.
    let device = DeviceDesc::touch();
    let options = ServoOptions { coupling: Coupling::Direct, ..ServoOptions::of(&device) };
    let ports = [sim.add_tool(&plain).unwrap(), sim.add_haptic_tool(&rough, &device, &options).unwrap()];
    (sim, ports)
}

/// Tools come, press, slide and go; the bone is driven; bricks wake and sleep.
fn act(sim: &mut Sim, ports: &mut [ToolPort; 2], step: u32) {
    let share = f64::from((step % 500).min(200)) / 100.0;
    let height = 8.0 * H + 6e-3 + 4e-3 * (1.0 - 2.0 * share).max(-1.0 + share);
    for (port, x) in ports.iter_mut().zip([5.0, 10.0]) {
        let at = Pose::translation(x * H + 2e-3 * share, 4.0 * H, height);
        let state =
            DeviceState { motion: ToolMotion::at(at), stamp_s: 1e-3 * f64::from(step), is_held: true };
        if port.exchange(&state, step % 2, true).is_none() {
            port.set_motion(&state.motion).unwrap();
        }
    }
    if step % 500 < 20 {
        sim.drive_region(2, &Pose::translation(0.0, 0.0, 1e-5 * f64::from(step % 500))).unwrap();
    }
    sim.step().unwrap();
    let _ = ports.each_mut().map(ToolPort::force);
}

#[test]
fn a_step_allocates_nothing_on_any_thread() {
    let efg = Method::Efg(EfgDesc::default());
    for (method, precision, threads, damping_s) in [
        (Method::Lattice, Precision::Single, 1, 0.0),
        (Method::Lattice, Precision::Single, 2, 0.0),
        (Method::Lattice, Precision::Single, 2, 1e-4),
        (Method::Lattice, Precision::Double, 1, 0.0),
        (efg, Precision::Single, 2, 1e-4),
    ] {
        let (mut sim, mut ports) = scene_of(method, precision, threads, damping_s);
        // Warmed up by less than what follows: not all memory may come from the first round.
        (0..5).for_each(|step| act(&mut sim, &mut ports, step));
        // Nor does one that follows a restore.
        let snapshot = sim.snapshot().unwrap();
        sim.restore(&snapshot).unwrap();

        let (mut most_touching, mut fewest_awake) = (0, u64::MAX);
        COUNT.store(0, Ordering::Relaxed);
        IS_COUNTING.store(true, Ordering::Relaxed);
        for step in 5..1100 {
            act(&mut sim, &mut ports, step);
            let now = sim.statistics();
            most_touching = most_touching.max(now.contact_points);
            fewest_awake = fewest_awake.min(now.awake_nodes);
        }
        IS_COUNTING.store(false, Ordering::Relaxed);

        assert!(most_touching > 10, "tools touch: {most_touching}");
        let sleeps = fewest_awake < sim.statistics().node_count;
        assert_eq!(sleeps, method == Method::Lattice, "some bricks of a lattice sleep");
        let count = COUNT.load(Ordering::Relaxed);
        assert_eq!(count, 0, "{method:?}, {precision:?}, {threads} threads, damping {damping_s}");
    }
}
