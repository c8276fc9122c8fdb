//! Tools with an edge: what they cut, and what they feel.

use palpate::error::Error;
use palpate::math::{Pose, Vec3};
use palpate::sim::{Event, Sim, SimDesc, ToolPort};
use palpate::solver::blade::Blade;
use palpate::solver::method::Method;
use palpate::solver::tool::{ToolDesc, ToolMotion};

use super::{CELL_M, METHODS, beam, dragged, simulation, slit, stepped};

/// J/m².
const TOUGHNESS: f64 = 5.0;
/// Share of the toughness that steps of a frame feel at least. Measured are 0.78; why it is not more is not known.
const LONG_STEPS: f64 = 0.7;

/// An edge along y through the origin, longer than any beam is wide.
fn edge(toughness_j_m2: f64) -> ToolDesc {
    ToolDesc::blade(Blade { edge: vec![-Vec3::y(), Vec3::y()], toughness_j_m2 })
}

fn go(sim: &mut Sim, blade: &mut ToolPort, x: f64, z: f64) -> Vec3 {
    blade.set_motion(&ToolMotion::at(Pose::translation(x * CELL_M, 0.0, z * CELL_M))).unwrap();
    sim.step().unwrap();
    blade.force().wrench.force_n
}

#[test]
fn a_blade_that_does_not_resist_cuts_as_the_same_way_by_hand_does() {
    for method in METHODS {
        let model = beam([10, 3, 4], true);
        let mut by_tool = simulation(&model, method, Vec3::zeros());
        let mut by_hand = simulation(&model, method, Vec3::zeros());
        let mut blade = by_tool.add_tool(&edge(0.0)).unwrap();
        for step in 0..40 {
            let [from, to] = [0.0, 1.0].map(|end| 11.0 - 0.2 * (f64::from(step) + end));
            if step == 0 {
                assert_eq!(go(&mut by_tool, &mut blade, from, 1.7), Vec3::zeros());
            }
            assert_eq!(go(&mut by_tool, &mut blade, to, 1.7), Vec3::zeros());
            slit(&mut by_hand, from, to, 1.7);
        }
        let volumes = |sim: &Sim| sim.parts().iter().map(|part| part.volume_m3).collect::<Vec<_>>();
        assert_eq!(volumes(&by_tool), volumes(&by_hand));
    }
}

#[test]
fn a_blade_that_cuts_feels_the_toughness_for_each_metre_of_its_edge_in_the_tissue() {
    for method in METHODS {
        let (width, model) = (5, beam([20, 5, 6], true));
        // Tissue that rings would let go of the edge and catch it again.
        let mut sim = dragged(&model, method, Vec3::zeros(), 200.0);
        let mut blade = sim.add_tool(&edge(TOUGHNESS)).unwrap();
        let expected = TOUGHNESS * f64::from(width) * CELL_M;
        // Tissue that is pressed is a little wider, and the edge is asked at points half a cell apart.
        let limit = expected + 0.501 * TOUGHNESS * CELL_M;
        let (mut sum, mut count, mut most) = (Vec3::zeros(), 0, 0.0_f64);
        for step in 0..700 {
            let x = 20.5 - 0.02 * f64::from(step);
            let force = go(&mut sim, &mut blade, x, 3.3);
            most = most.max(force.norm());
            // From three cells in on, where tissue has given way.
            if x < 16.0 {
                (sum, count) = (sum + force, count + 1);
            }
        }
        let mean = sum / f64::from(count);
        assert!(sim.parts().len() == 1 && most < limit, "{most} of {expected}");
        assert!(mean.x > 0.99 * expected && mean.x < limit, "{mean:?} of {expected}");
        assert!(mean.yz().norm() < 0.2 * mean.x, "{mean:?}");
        // Drawn back through its own cut it meets nothing.
        for step in 0..100 {
            let force = go(&mut sim, &mut blade, 7.5 + 0.05 * f64::from(step), 3.3);
            assert!(step < 40 || force == Vec3::zeros(), "{force:?} at {step}");
        }
    }
}

#[test]
fn in_steps_of_a_frame_a_blade_feels_the_toughness_too_and_cuts_what_it_passes() {
    // So tough that impulses on masses alone would take the nodes some 80 mm along in a step.
    let (width, model, step_s) = (5, beam([20, 5, 6], true), 1.0 / 60.0);
    let mut sim = stepped(&model, METHODS[1], Vec3::zeros(), 200.0, step_s);
    let mut blade = sim.add_tool(&edge(TOUGHNESS)).unwrap();
    let expected = TOUGHNESS * f64::from(width) * CELL_M;
    let limit = expected + 0.501 * TOUGHNESS * CELL_M;
    let (mut sum, mut count) = (0.0, 0);
    let mut x = 21.0;
    while x > 8.0 {
        x -= 20.0 * step_s;
        let force = go(&mut sim, &mut blade, x, 3.3);
        if x < 16.0 {
            (sum, count) = (sum + force.x, count + 1);
        }
    }
    let mean = sum / f64::from(count);
    assert!(mean > LONG_STEPS * expected && mean < limit, "{mean} of {expected}");
    while x > -3.0 {
        x -= 20.0 * step_s;
        go(&mut sim, &mut blade, x, 3.3);
    }
    // Through all of its length, and out of it.
    let parts: Vec<f64> = sim.parts().iter().map(|part| part.volume_m3).collect();
    assert!(parts.len() == 2 && parts[1] > 0.4 * parts[0], "{parts:?}");
    assert_eq!(go(&mut sim, &mut blade, x, 3.3), Vec3::zeros());
}

#[test]
fn an_edge_shorter_than_half_a_cell_holds_tissue_too() {
    for method in METHODS {
        let mut sim = simulation(&beam([6, 3, 3], true), method, Vec3::zeros());
        let edge = [-0.2, 0.2].map(|y| Vec3::new(0.0, y * CELL_M, 0.0));
        let blade = Blade { edge: edge.to_vec(), toughness_j_m2: 1e5 };
        let mut blade = sim.add_tool(&ToolDesc::blade(blade)).unwrap();
        let at = |x: f64| ToolMotion::at(Pose::translation(x * CELL_M, 1.5 * CELL_M, 1.5 * CELL_M));
        blade.set_motion(&at(4.5)).unwrap();
        sim.step().unwrap();
        blade.set_motion(&at(4.6)).unwrap();
        sim.step().unwrap();
        // It pulls tissue along, which pulls back.
        assert!(blade.force().wrench.force_n.x < 0.0, "{:?}", blade.force().wrench);
        assert_eq!(sim.statistics().divided_cells, 0);
    }
}

#[test]
fn tissue_tougher_than_the_push_goes_with_the_blade_and_is_not_cut() {
    for method in METHODS {
        let model = beam([12, 3, 5], true);
        let mut sim = simulation(&model, method, Vec3::zeros());
        // Put in first, without a way.
        let mut blade = sim.add_tool(&edge(1e5)).unwrap();
        let mut force = go(&mut sim, &mut blade, 9.5, 2.5);
        for step in 0..200 {
            force = go(&mut sim, &mut blade, 9.5, 2.5 - 0.004 * f64::from(step));
        }
        assert_eq!(sim.parts().len(), 1);
        assert_eq!(sim.cut(&[Vec3::x(), Vec3::y()], &[Vec3::x(), Vec3::y()]).unwrap(), 0);
        // The beam is bent down by 0.8 cells and pulls the blade up.
        assert!(force.z > 0.0, "{force:?}");
        let rest = sim.nodes(palpate::sim::NodeField::RestPosition);
        let moved = sim.nodes(palpate::sim::NodeField::Displacement);
        let near = |p: &Vec3| (p.x / CELL_M - 9.5).abs() < 0.6 && (p.z / CELL_M - 2.5).abs() < 0.6;
        let sunk: Vec<f64> =
            rest.iter().zip(&moved).filter(|(p, _)| near(p)).map(|(_, u)| u.z / CELL_M).collect();
        let mean = sunk.iter().sum::<f64>() / sunk.len() as f64;
        assert!((mean + 0.8).abs() < 0.05, "{mean}");
    }
}

#[test]
fn bad_blades_are_refused_and_a_cut_without_room_is_told_once_while_the_simulation_goes_on() {
    let model = beam([12, 3, 4], true);
    let mut sim = simulation(&model, Method::Lattice, Vec3::zeros());
    let bad = |edge: Vec<Vec3>, toughness_j_m2: f64| ToolDesc::blade(Blade { edge, toughness_j_m2 });
    for desc in [
        bad(vec![], 1.0),
        bad(vec![Vec3::zeros()], 1.0),
        bad(vec![Vec3::zeros(); 2], 1.0),
        bad(vec![Vec3::zeros(), Vec3::repeat(f64::NAN)], 1.0),
        bad(vec![Vec3::zeros(), Vec3::x()], f64::NAN),
        bad(vec![Vec3::zeros(), Vec3::x()], -1.0),
    ] {
        assert!(matches!(sim.add_tool(&desc), Err(Error::Argument(_))), "{desc:?}");
    }
    let none = SimDesc { cut_nodes: 0, ..SimDesc::default() };
    assert!(matches!(Sim::new(model.clone(), &none).unwrap().add_tool(&edge(0.0)), Err(Error::State(_))));

    let small = SimDesc { cut_nodes: 64, threads: 1, ..SimDesc::default() };
    let mut sim = Sim::new(beam([40, 12, 4], true), &small).unwrap();
    let mut blade = sim.add_tool(&edge(0.0)).unwrap();
    for step in 0..60 {
        go(&mut sim, &mut blade, 41.0 - 0.5 * f64::from(step), 1.5);
        let nan = ToolMotion::at(Pose::translation(f64::NAN, 0.0, 0.0));
        assert!(matches!(blade.set_motion(&nan), Err(Error::Argument(_))));
    }
    let events: Vec<Event> = std::iter::from_fn(|| sim.poll_event()).collect();
    let refused = |event: &&Event| matches!(event, Event::CutRefused { tool, .. } if *tool == blade.id());
    assert!(events.iter().filter(refused).count() == 1 && events.len() <= 2, "{events:?}");
    assert_eq!(sim.parts().len(), 1);
    // All of the body at once, in one step.
    let mut sim = simulation(&model, Method::Lattice, Vec3::zeros());
    let mut blade = sim.add_tool(&edge(0.0)).unwrap();
    go(&mut sim, &mut blade, 20.0, 1.5);
    go(&mut sim, &mut blade, -5.0, 1.5);
    assert_eq!(sim.parts().len(), 2);
    (0..5).for_each(|_| sim.step().unwrap());
}
