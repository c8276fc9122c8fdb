//! Tools and their servo threads over a restore.

use palpate::servo::ServoOptions;
use palpate::servo::device::DeviceDesc;
use palpate::sim::ThreadDesc;

use super::*;

#[test]
fn a_tool_that_came_since_is_put_in_anew_and_what_one_that_went_held_is_free() {
    let model = model();
    for case in cases() {
        let mut rig = Rig::new(&model, &desc(case, 1), &balls());
        rig.run(0..20, busy);
        let snapshot = rig.sim.snapshot().unwrap();
        let holder = rig.tools.pop().unwrap();
        rig.sim.remove_tool(holder.id()).unwrap();
        rig.tools.push(rig.sim.add_tool(&balls()[1]).unwrap());
        // Deep in the tissue, from where it shall not sweep to its next place.
        rig.put(1, Vec3::new(6.0, 3.5, 5.0));
        rig.sim.step().unwrap();
        assert!(rig.sim.grasp(rig.tools[1].id(), CELL_M).unwrap() > 0);
        rig.sim.restore(&snapshot).unwrap();

        // As in a simulation that was restored and then lost its tool, and got one that was never anywhere.
        let mut other = Rig::new(&model, &desc(case, 1), &balls());
        other.sim.restore(&snapshot).unwrap();
        let second = other.tools.pop().unwrap();
        assert!(other.sim.release(second.id()).unwrap() > 4, "{case:?}");
        other.sim.remove_tool(second.id()).unwrap();
        other.tools.push(other.sim.add_tool(&balls()[1]).unwrap());
        let act = |rig: &mut Rig, step: u32| {
            rig.put(0, Vec3::new(4.0, 3.5, 6.6));
            rig.put(1, Vec3::new(9.0, 3.5, 8.4 - 0.05 * f64::from(step)));
        };
        assert!(rig.run(0..20, act) == other.run(0..20, act), "{case:?}");
    }
}

#[test]
fn a_device_feels_nothing_until_it_engages_anew() {
    let model = model();
    for (method, precision) in cases() {
        let mut sim = Sim::new(model.clone(), &desc((method, precision), 1)).unwrap();
        let touch = DeviceDesc::touch();
        let mut port = sim.add_haptic_tool(&balls()[0], &touch, &ServoOptions::of(&touch)).unwrap();
        let press = |sim: &mut Sim, port: &mut ToolPort, step: u32| {
            let z = (8.2 - 0.03 * f64::from(step).min(40.0)) * CELL_M;
            port.set_motion(&ToolMotion::at(Pose::translation(4.0 * CELL_M, 3.5 * CELL_M, z))).unwrap();
            sim.step().unwrap();
            port.contact_model().unwrap().wrench.force_n.norm()
        };
        let forces: Vec<f64> = (0..60).map(|step| press(&mut sim, &mut port, step)).collect();
        assert!(forces[59] > 0.0, "it touches");
        let (snapshot, epoch) = (sim.snapshot().unwrap(), port.contact_model().unwrap().epoch);
        press(&mut sim, &mut port, 60);
        assert_eq!(port.contact_model().unwrap().epoch, epoch, "a snapshot leaves it alone");

        sim.restore(&snapshot).unwrap();
        let model = port.contact_model().unwrap();
        assert!(model.epoch > epoch && model.wrench.force_n == Vec3::zeros());
        assert!(port.is_live());
        assert!(press(&mut sim, &mut port, 60) > 0.0, "{method:?} {precision:?}");
    }
}

#[test]
fn a_simulation_with_a_thread_of_its_own_is_restored_between_two_steps() {
    let case = (Method::Lattice, Precision::Single);
    let mut sim = Sim::new(model(), &desc(case, 1)).unwrap();
    sim.start(ThreadDesc::default()).unwrap();
    let wait_for = |sim: &Sim, steps: u64| {
        while sim.statistics().steps < steps {
            std::thread::yield_now();
        }
    };
    wait_for(&sim, 5);
    let snapshot = sim.snapshot().unwrap();
    let taken = sim.statistics().steps;
    wait_for(&sim, taken + 20);
    sim.set_paused(true).unwrap();
    sim.restore(&snapshot).unwrap();
    assert!(sim.statistics().steps <= taken + 1);
    sim.set_paused(false).unwrap();
    wait_for(&sim, taken + 20);
    sim.stop().unwrap();
}
