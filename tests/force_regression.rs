//! Forces stay what they were: scripted motions on small models, against curves in `tests/force`.
//!
//! A curve that changed is not wrong by that; whoever changes one looks at where and by how much, says why in the commit, and records it
//! anew with `PALPATE_BLESS=1 cargo test --test force_regression`. What is right is what `tests/truth` claims.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use palpate::math::Vec3;
use palpate::model::LabelUse;
use palpate::sim::{Precision, Sim, SimDesc};
use palpate::solver::tool::{ToolDesc, ToolMotion};

#[path = "support/block.rs"]
mod block;

use block::{Block, Pressed, tissue};

/// How far a force or torque may be off, by the largest of its curve. A hundredth of what a hand can tell apart (7 %), and far above what sums in
/// another order make of it: contact points that come and go a substep earlier.
const SAME: f64 = 7e-4;

/// Cells of the block along x, y, z, and the edge of one in m.
const CELLS: [usize; 3] = [10, 10, 6];
const H: f64 = 4e-3;
const RADIUS: f64 = 8e-3;
const STEP_S: f64 = 1e-3;
/// Given, so that no rounding decides on one more: twice what the stiffest model needs.
const SUBSTEPS: u32 = 16;
/// Steps between two lines of a curve.
const EVERY: u32 = 10;

/// A motion, the number of tools that make it, and what they press.
struct Script {
    name: &'static str,
    seconds: f64,
    friction: f64,
    has_inclusion: bool,
    tools: usize,
    /// Depth below the surface and way along x from the middle, in m, of a tool at a time.
    at: fn(f64, usize) -> [f64; 2],
}

/// From nothing to all between two times, in a line.
fn ramp(time_s: f64, from_s: f64, to_s: f64) -> f64 {
    ((time_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0)
}

const PRESS: Script = Script {
    name: "press",
    seconds: 0.5,
    friction: 0.0,
    has_inclusion: false,
    tools: 1,
    at: |t, _| [7e-3 * (ramp(t, 0.0, 0.25) - ramp(t, 0.25, 0.5)) - 1e-3, 0.0],
};
const HOLD: Script = Script {
    name: "hold",
    seconds: 0.6,
    friction: 0.3,
    has_inclusion: false,
    tools: 1,
    at: |t, _| [5e-3 * ramp(t, 0.0, 0.1) - 1e-3, 0.0],
};
const DRAG: Script = Script {
    name: "drag",
    seconds: 0.8,
    friction: 0.4,
    has_inclusion: false,
    tools: 1,
    at: |t, _| [5e-3 * ramp(t, 0.0, 0.2) - 1e-3, 8e-3 * (ramp(t, 0.2, 0.4) - 2.0 * ramp(t, 0.4, 0.8))],
};
const TAP: Script = Script {
    name: "tap",
    seconds: 0.2,
    friction: 0.2,
    has_inclusion: false,
    tools: 1,
    // 175 mm/s, in and out in 80 ms.
    at: |t, _| [7e-3 * (ramp(t, 0.0, 0.04) - ramp(t, 0.04, 0.08)) - 1e-3, 0.0],
};
const TWO_TOOLS: Script = Script {
    name: "two_tools",
    seconds: 0.5,
    friction: 0.3,
    has_inclusion: false,
    tools: 2,
    // Towards each other, with a fold between them.
    at: |t, tool| {
        let aside = 11e-3 - 1.5e-3 * ramp(t, 0.2, 0.5);
        [4e-3 * ramp(t, 0.0, 0.2) - 1e-3, if tool == 0 { -aside } else { aside }]
    },
};
const INCLUSION: Script = Script {
    name: "inclusion",
    seconds: 0.6,
    friction: 0.3,
    has_inclusion: true,
    tools: 1,
    at: |t, _| [6e-3 * ramp(t, 0.0, 0.2) - 1e-3, -8e-3 + 16e-3 * ramp(t, 0.2, 0.6)],
};

fn pressed(has_inclusion: bool) -> Pressed {
    let of = |young_pa: f64| tissue(young_pa, 0.45, 1000.0, 1e-4).unwrap();
    // Two cells on a side, one cell below the surface.
    let is_inside = |[i, j, k]: [usize; 3]| (4..6).contains(&i) && (4..6).contains(&j) && (3..5).contains(&k);
    let inclusion = has_inclusion.then_some((LabelUse::Tissue(of(40e3)), is_inside as fn(_) -> _));
    Block { cells: CELLS, cell_m: H, soft: of(5e3), inclusion }.build().unwrap()
}

/// A curve: the time, and three numbers of force in N and of torque in N m for each tool, a line each.
type Curve = Vec<Vec<f64>>;

fn record(script: &Script, threads: usize) -> Curve {
    record_beside(script, threads, 0.0)
}

/// With the tools so far beside their way, in m.
fn record_beside(script: &Script, threads: usize, beside_m: f64) -> Curve {
    let desc = SimDesc {
        precision: Precision::Double,
        threads,
        step_s: STEP_S,
        substeps: Some(SUBSTEPS),
        ..SimDesc::default()
    };
    let block = pressed(script.has_inclusion);
    let mut sim = Sim::new(block.model.clone(), &desc).unwrap();
    let ball = ToolDesc { friction: script.friction, ..ToolDesc::sphere(RADIUS) };
    let mut ports: Vec<_> = (0..script.tools).map(|_| sim.add_tool(&ball).unwrap()).collect();
    let mut curve = Vec::new();
    for step in 1..=(script.seconds / STEP_S).round() as u32 {
        let time_s = STEP_S * f64::from(step);
        for (tool, port) in ports.iter_mut().enumerate() {
            let [depth, aside] = (script.at)(time_s, tool);
            let at = block.at(RADIUS, depth, [aside + beside_m, 0.0]);
            port.set_motion(&ToolMotion::at(at)).unwrap();
        }
        sim.step().unwrap();
        if step % EVERY == 0 {
            let mut line = vec![time_s];
            for port in &mut ports {
                let wrench = port.force().wrench;
                line.extend(wrench.force_n.iter().chain(wrench.torque_n_m.iter()));
            }
            curve.push(line);
        }
    }
    curve
}

fn path(script: &Script) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/force").join(format!("{}.csv", script.name))
}

/// The names of a curve's columns.
fn columns(script: &Script) -> Vec<String> {
    let of = |tool: usize| {
        ["fx_n", "fy_n", "fz_n", "tx_n_m", "ty_n_m", "tz_n_m"].map(|name| format!("{name}_{tool}"))
    };
    std::iter::once("time_s".to_owned()).chain((0..script.tools).flat_map(of)).collect()
}

fn write(script: &Script, curve: &Curve) {
    let mut text = columns(script).join(",") + "\n";
    for line in curve {
        let numbers: Vec<_> = line.iter().map(|x| format!("{x:.6e}")).collect();
        writeln!(text, "{}", numbers.join(",")).unwrap();
    }
    std::fs::create_dir_all(path(script).parent().unwrap()).unwrap();
    std::fs::write(path(script), text).unwrap();
}

fn read(script: &Script) -> Curve {
    let path = path(script);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|why| panic!("{}: {why}", path.display()));
    let number = |text: &str| text.parse().unwrap_or_else(|_| panic!("{}: '{text}'", path.display()));
    text.lines().skip(1).map(|line| line.split(',').map(number).collect()).collect()
}

/// Says where curves differ, and by how much; nothing where they are the same.
fn difference(script: &Script, kept: &Curve, now: &Curve) -> Option<String> {
    if kept.len() != now.len() || kept.iter().zip(now).any(|(a, b)| a.len() != b.len()) {
        return Some(format!("{}: {} lines were kept, {} there are now", script.name, kept.len(), now.len()));
    }
    let names = columns(script);
    // Forces are measured by the largest force, torques by the largest torque.
    let is_force = |column: usize| (column - 1) % 6 < 3;
    let largest = |force: bool| {
        let values = kept.iter().flat_map(|line| line.iter().enumerate().skip(1));
        values.filter(|(column, _)| is_force(*column) == force).map(|(_, x)| x.abs()).fold(0.0, f64::max)
    };
    let peaks = [largest(false), largest(true)];
    let (mut first, mut worst) = (None, (0.0, String::new()));
    for (was, is) in kept.iter().zip(now) {
        for column in 1..was.len() {
            let off = (is[column] - was[column]).abs() / peaks[usize::from(is_force(column))];
            // Written so that a NaN differs.
            let is_same = off <= SAME;
            let words = || {
                format!("{} at {:.3} s: {:.6e}, was {:.6e}", names[column], was[0], is[column], was[column])
            };
            if !is_same && first.is_none() {
                first = Some(words());
            }
            if !is_same && (off >= worst.0 || off.is_nan()) {
                worst = (off, words());
            }
        }
    }
    first.map(|first| {
        let (off, worst) = worst;
        format!("{}: first {first}; worst, by {:.3} % of the peak, {worst}", script.name, 100.0 * off)
    })
}

fn stays(script: &Script) {
    let now = record(script, 1);
    let peak = now.iter().map(|line| Vec3::new(line[1], line[2], line[3]).norm()).fold(0.0, f64::max);
    assert!(peak > 0.1, "{}: something is felt: {peak} N", script.name);
    if std::env::var_os("PALPATE_BLESS").is_some() {
        write(script, &now);
    }
    assert_eq!(difference(script, &read(script), &now), None);
}

#[test]
fn a_press_feels_as_it_did() {
    stays(&PRESS);
}

#[test]
fn a_hold_feels_as_it_did() {
    stays(&HOLD);
}

#[test]
fn a_drag_with_friction_feels_as_it_did() {
    stays(&DRAG);
}

#[test]
fn a_quick_tap_feels_as_it_did() {
    stays(&TAP);
}

#[test]
fn two_tools_feel_as_they_did() {
    stays(&TWO_TOOLS);
}

#[test]
fn an_inclusion_feels_as_it_did() {
    stays(&INCLUSION);
}

#[test]
fn forces_do_not_depend_on_the_number_of_threads() {
    assert_eq!(difference(&TAP, &record(&TAP, 1), &record(&TAP, 3)), None);
}

#[test]
fn rounding_does_not_grow_into_a_difference() {
    // What another order of sums does to 24 mm in double precision, thousands of times over: were friction and contact points that come and go to
    // blow that up, curves would depend on the processor.
    for script in [&DRAG, &TWO_TOOLS] {
        assert_eq!(difference(script, &read(script), &record_beside(script, 1, 1e-14)), None);
    }
}

#[test]
fn a_curve_that_changed_says_where_and_by_how_much() {
    let kept = vec![vec![0.01, 0.0, 0.0, 1.0, 0.0, 0.01, 0.0], vec![0.02, 0.0, 0.0, 2.0, 0.0, 0.02, 0.0]];
    let mut now = kept.clone();
    now[1][3] += 0.9 * SAME * 2.0;
    assert_eq!(difference(&PRESS, &kept, &now), None);
    now[0][5] += 2e-4;
    now[1][3] = 2.2;
    let said = difference(&PRESS, &kept, &now).unwrap();
    assert!(said.contains("first ty_n_m_0 at 0.010 s") && said.contains("by 10.000 %"), "{said}");
    assert!(said.contains("fz_n_0 at 0.020 s: 2.2"), "{said}");
    now[1][3] = f64::NAN;
    assert!(difference(&PRESS, &kept, &now).is_some());
    assert!(difference(&PRESS, &kept, &kept[..1].to_vec()).is_some());
}
