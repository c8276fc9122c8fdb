//! The simulation's own thread. Nothing here asserts how long a thing takes, but that it comes.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use palpate::error::Error;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::servo::device::DeviceDesc;
use palpate::servo::{DeviceState, ServoOptions};
use palpate::sim::{Event, Sim, SimDesc, ThreadDesc, ToolPort};
use palpate::solver::tool::{ToolDesc, ToolMotion};

const CELL_M: f64 = 5e-3;

/// A block of tissue, held below, its top at 8 cells.
fn block() -> Arc<Model> {
    let labels = vec![1; 512];
    let mut build =
        Build::new(LabelGrid::new([8; 3], Vec3::repeat(CELL_M), Pose::identity(), labels).unwrap());
    let tissue = Material::new("tissue", 5e3, 0.4, 1000.0).unwrap();
    build.uses = BTreeMap::from([(1, LabelUse::Tissue(tissue))]);
    let lowest = Pose::translation(0.0, 0.0, -0.5 * CELL_M);
    build.fixes.push(Fix { pose: lowest, half_extents: Vec3::new(1.0, 1.0, 0.1 * CELL_M), axes: [true; 3] });
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

fn simulation(step_s: f64) -> Sim {
    Sim::new(block(), &SimDesc { threads: 1, step_s, ..SimDesc::default() }).unwrap()
}

fn at(z: f64) -> ToolMotion {
    ToolMotion::at(Pose::translation(3.5 * CELL_M, 3.5 * CELL_M, z))
}

/// A ball, pressed in.
fn ball(sim: &mut Sim) -> ToolPort {
    let mut tool = sim.add_tool(&ToolDesc::sphere(8e-3)).unwrap();
    let top = sim.pick(Vec3::new(3.5 * CELL_M, 3.5 * CELL_M, 1.0), -Vec3::z()).unwrap().unwrap();
    tool.set_motion(&at(top.point_m.z + 6e-3)).unwrap();
    tool
}

/// Waits until something is so.
fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    for _ in 0..20_000 {
        if is_so() {
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("it did not come: {what}");
}

#[test]
fn the_thread_steps_by_itself_until_it_is_stopped() {
    let mut sim = simulation(1e-3);
    let mut tool = ball(&mut sim);
    assert!(matches!(sim.set_paused(true), Err(Error::State(_))));
    sim.start(ThreadDesc::default()).unwrap();
    assert!(matches!(sim.start(ThreadDesc::default()), Err(Error::State(_))));
    assert!(matches!(sim.step(), Err(Error::State(_))));
    until("a force", || tool.force().wrench.force_n.z > 0.0);
    sim.set_paused(true).unwrap();
    // The step in progress ends.
    sim.statistics();
    let steps = {
        std::thread::sleep(Duration::from_millis(20));
        sim.statistics().steps
    };
    std::thread::sleep(Duration::from_millis(20));
    assert_eq!(sim.statistics().steps, steps, "paused");
    sim.set_paused(false).unwrap();
    until("another step", || sim.statistics().steps > steps);
    sim.stop().unwrap();
    let steps = sim.statistics().steps;
    sim.step().unwrap();
    let after = sim.statistics();
    assert_eq!(after.steps, steps + 1);
    assert!((after.time_s - 1e-3 * after.steps as f64).abs() < 1e-9, "a step is a step, whoever takes it");
}

#[test]
fn a_tool_that_leaves_is_gone_without_the_owners_doing() {
    let mut sim = simulation(1e-3);
    let mut tool = ball(&mut sim);
    let mut other = sim.add_tool(&ToolDesc::sphere(8e-3)).unwrap();
    other.set_motion(&at(0.1)).unwrap();
    sim.start(ThreadDesc::default()).unwrap();
    until("a force", || tool.force().wrench.force_n.z > 0.0);
    tool.leave();
    until("nothing touched", || sim.statistics().contact_points == 0);
    assert!(other.is_live());
}

#[test]
fn a_simulation_that_fails_on_its_thread_pauses_and_says_so() {
    let mut sim = simulation(1e-3);
    let mut tool = ball(&mut sim);
    sim.start(ThreadDesc::default()).unwrap();
    let mut is_down = false;
    let mut told = None;
    until("a divergence", || {
        is_down = !is_down;
        // By more than a cell in a substep, until a cell gives in.
        tool.set_motion(&at(if is_down { -0.02 } else { 0.06 })).unwrap();
        told = std::iter::from_fn(|| sim.poll_event()).find(|event| matches!(event, Event::Diverged { .. }));
        told.is_some()
    });
    assert!(!tool.is_live() && tool.force().wrench.force_n == Vec3::zeros());
    let steps = sim.statistics().steps;
    tool.set_motion(&at(0.1)).unwrap();
    sim.reset();
    sim.set_paused(false).unwrap();
    until("a step after the reset", || sim.statistics().steps > 0);
    assert!(tool.is_live() && steps > 0);
}

#[test]
fn time_that_cannot_be_made_up_for_is_let_go_and_told() {
    // No machine steps a million times a second.
    let mut sim = simulation(1e-6);
    sim.start(ThreadDesc { longest_lag_s: 1e-4, ..ThreadDesc::default() }).unwrap();
    let mut told = None;
    until("falling behind", || {
        told = sim.poll_event();
        told.is_some()
    });
    assert!(matches!(told, Some(Event::FellBehind { dropped_s, .. }) if dropped_s > 1e-4), "{told:?}");
    until("losing time again and again", || sim.statistics().dropped_s > 256.0 * 1e-4);
    let statistics = sim.statistics();
    assert!(
        statistics.overruns > 0 && statistics.dropped_events == 0,
        "it is told now and then: {statistics:?}"
    );
}

#[test]
fn a_command_waits_for_one_step_at_most_though_steps_follow_without_a_pause() {
    // Steps that take longer than a millisecond: the thread is always late.
    let desc = SimDesc { threads: 1, substeps: Some(1000), sleeping: false, ..SimDesc::default() };
    let mut sim = Sim::new(block(), &desc).unwrap();
    let mut tool = ball(&mut sim);
    sim.start(ThreadDesc::default()).unwrap();
    until("a force", || tool.force().wrench.force_n.z > 0.0);
    let mut waited: Vec<u64> = (0..21)
        .map(|i| {
            let before = tool.force().sequence;
            sim.set_gravity(Vec3::z() * -0.1 * f64::from(i)).unwrap();
            // Seen without the lock, right after the command was done.
            tool.force().sequence - before
        })
        .collect();
    waited.sort_unstable();
    // Not all of them: this thread, too, may have to wait for a processor.
    assert!(waited[10] <= 1, "{waited:?}");
    assert!(sim.statistics().overruns > 0);
}

#[test]
fn a_servo_goes_on_while_a_command_holds_the_simulation() {
    let mut sim = simulation(1e-3);
    let desc = DeviceDesc::touch();
    let mut port = sim.add_haptic_tool(&ToolDesc::sphere(8e-3), &desc, &ServoOptions::of(&desc)).unwrap();
    let (is_over, ticks) = (AtomicBool::new(false), AtomicU32::new(0));
    let went_on = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::SeqCst) {
                let stamp_s = 1e-3 * f64::from(ticks.load(Ordering::SeqCst));
                let state = DeviceState { motion: at(0.1), stamp_s, is_held: true };
                port.exchange(&state, 0, true).unwrap();
                ticks.fetch_add(1, Ordering::SeqCst);
            }
        });
        // A servo that waited for commands would tick once in each; one that does not may still have no processor during some.
        let went_on = (0..1000).any(|_| {
            let before = ticks.load(Ordering::SeqCst);
            sim.settle(1e-12, 30_000).unwrap();
            ticks.load(Ordering::SeqCst) - before > 100
        });
        is_over.store(true, Ordering::SeqCst);
        went_on
    });
    assert!(went_on);
}

#[test]
fn hooks_run_first_and_last_on_the_thread() {
    let counts: [Arc<AtomicU32>; 2] = std::array::from_fn(|_| Arc::default());
    let [started, stopped] = counts.clone();
    let mut sim = simulation(1e-3);
    let own = std::thread::current().id();
    sim.start(ThreadDesc {
        on_start: Some(Box::new(move || {
            assert_ne!(std::thread::current().id(), own);
            started.fetch_add(1, Ordering::SeqCst);
        })),
        on_stop: Some(Box::new(move || {
            stopped.fetch_add(1, Ordering::SeqCst);
        })),
        ..ThreadDesc::default()
    })
    .unwrap();
    drop(sim);
    assert_eq!(counts.map(|count| count.load(Ordering::SeqCst)), [1, 1]);
}

#[test]
fn a_hook_may_end_the_simulation_and_a_hook_that_panics_ends_its_thread_alone() {
    let shared: Arc<Mutex<Option<Sim>>> = Arc::default();
    let theirs = shared.clone();
    let mut sim = simulation(1e-3);
    let tool = ball(&mut sim);
    sim.start(ThreadDesc {
        on_start: Some(Box::new(move || until("the simulation", || theirs.lock().unwrap().take().is_some()))),
        ..ThreadDesc::default()
    })
    .unwrap();
    *shared.lock().unwrap() = Some(sim);
    until("the end", || !tool.is_running());

    let mut sim = simulation(1e-3);
    let mut tool = ball(&mut sim);
    let mut surface = sim.open_surface(0).unwrap();
    assert!(surface.map().unwrap().is_running);
    sim.start(ThreadDesc { on_start: Some(Box::new(|| panic!("a host's defect"))), ..ThreadDesc::default() })
        .unwrap();
    until("the defect", || sim.check().is_err());
    assert!(matches!(sim.check(), Err(Error::Defect(_))) && matches!(sim.stop(), Err(Error::Defect(_))));
    assert!(!tool.is_live() && tool.force().wrench.force_n == Vec3::zeros());
    // Nobody knows what state this is: it is not stepped, shown or asked any more, with the thread or without.
    assert!(matches!(sim.step(), Err(Error::Defect(_))) && matches!(surface.map(), Err(Error::Defect(_))));
    assert!(!surface.last().unwrap().is_running, "what was seen before stays");
}
