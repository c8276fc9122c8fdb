//! The press: the tool comes from outside, goes in to a depth, holds, and comes out again.

use anyhow::Context;
use indicatif::ProgressBar;
use palpate::math::{Pose, Vec3};
use palpate::sim::{Sim, ToolPort};
use palpate::solver::statistics::{Energy, Statistics};
use palpate::solver::tool::{ToolMotion, Wrench};

use super::approach::Approach;
use super::snapshot::{Camcorder, Snapshot};
use super::tool::Tool;

/// Air between tool and tissue at the start, in metres.
pub const GAP_M: f64 = 0.003;
/// How long the tool stays at depth, in seconds.
const HOLD_S: f64 = 0.2;
/// How far below where tissue was seen the tool looks for it before giving up, in metres.
const SEARCH_M: f64 = 0.02;
/// Steps between two rows of the record.
const ROW_STEPS: u64 = 6;

/// What the tool is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// On its way to the tissue.
    Approach,
    /// Going in.
    Press,
    /// At depth.
    Hold,
    /// On its way back.
    Retract,
}

/// One row of the record.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// What the tool was doing.
    pub phase: Phase,
    /// Where the tool was.
    pub pose: Pose,
    /// Travel since first contact in metres; 0 before it.
    pub indentation_m: f64,
    /// Force and torque on the tool.
    pub wrench: Wrench,
    /// Energies.
    pub energy: Energy,
    /// How the simulation was doing.
    pub statistics: Statistics,
}

/// Everything that happened.
#[derive(Debug)]
pub struct Record {
    /// Rows, in the order of time.
    pub rows: Vec<Row>,
    /// The tissue before the press and at the end of the hold; empty when no pictures were asked for.
    pub snapshots: Vec<Snapshot>,
    /// Wall-clock time spent in steps, in seconds.
    pub wall_s: f64,
}

/// How the press is to go.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Where and along what.
    pub approach: Approach,
    /// Indentation to reach, in metres.
    pub depth_m: f64,
    /// Speed in and out, in m/s.
    pub speed_m_s: f64,
    /// Length of a step in seconds.
    pub step_s: f64,
}

/// Presses, with one tick of `bar` for each step.
pub fn run(
    sim: &mut Sim,
    tool: &Tool,
    plan: &Plan,
    mut camcorder: Option<Camcorder>,
    bar: &ProgressBar,
) -> anyhow::Result<Record> {
    let mut port = sim.add_tool(&tool.desc)?;
    let mut record = Record { rows: Vec::new(), snapshots: Vec::new(), wall_s: 0.0 };
    let mut path = Path::new(plan);
    bar.set_length(path.expected_steps());

    let start = tool.pose(path.tip(), plan.approach.direction);
    if let Some(camcorder) = &mut camcorder {
        record.snapshots.push(camcorder.shoot(sim, start, 0.0, Wrench::default())?);
    }

    while let Some(velocity) = path.advance() {
        let pose = tool.pose(path.tip(), plan.approach.direction);
        let row = step(sim, &mut port, &path, pose, velocity)?;
        record.wall_s += row.statistics.step_wall_s;

        // The first touch is always in the record: everything is measured from it.
        let met = path.notice(row.statistics.contact_points > 0)?;
        if met || row.statistics.steps.is_multiple_of(ROW_STEPS) {
            record.rows.push(Row { energy: sim.energy(), ..row });
        }
        if path.is_hold_over()
            && let Some(camcorder) = &mut camcorder
        {
            record.snapshots.push(camcorder.shoot(sim, pose, row.indentation_m, row.wrench)?);
        }
        report(bar, &row);
    }
    bar.finish_and_clear();
    Ok(record)
}

/// One step of the simulation with the tool at `pose`.
fn step(sim: &mut Sim, port: &mut ToolPort, path: &Path, pose: Pose, velocity: Vec3) -> anyhow::Result<Row> {
    port.set_motion(&ToolMotion { linear_m_s: velocity, ..ToolMotion::at(pose) })?;
    let tip = path.tip() * 1e3;
    let place =
        || format!("{:.1} mm deep at {:.1}, {:.1}, {:.1} mm", path.indentation() * 1e3, tip.x, tip.y, tip.z);
    sim.step().with_context(place)?;
    Ok(Row {
        phase: path.phase,
        pose,
        indentation_m: path.indentation(),
        wrench: port.force().wrench,
        energy: Energy::default(),
        statistics: sim.statistics(),
    })
}

fn report(bar: &ProgressBar, row: &Row) {
    bar.inc(1);
    if row.statistics.steps.is_multiple_of(16) {
        bar.set_message(format!(
            "{:4.1} mm  {:5.2} N  {:4.1} × real time",
            row.indentation_m * 1e3,
            row.wrench.force_n.norm(),
            row.statistics.real_time_factor
        ));
    }
}

/// Where the tip is along the direction of the press. Travel 0 is the surface that the ray met.
struct Path<'a> {
    plan: &'a Plan,
    phase: Phase,
    travel_m: f64,
    contact_m: Option<f64>,
    hold_steps_left: u64,
}

impl<'a> Path<'a> {
    fn new(plan: &'a Plan) -> Self {
        let hold_steps_left = (HOLD_S / plan.step_s).round() as u64;
        Self { plan, phase: Phase::Approach, travel_m: -GAP_M, contact_m: None, hold_steps_left }
    }

    fn expected_steps(&self) -> u64 {
        let way_m = 2.0 * (GAP_M + self.plan.depth_m);
        (way_m / (self.plan.speed_m_s * self.plan.step_s)) as u64 + self.hold_steps_left
    }

    fn tip(&self) -> Vec3 {
        self.plan.approach.point_m + self.plan.approach.direction * self.travel_m
    }

    fn indentation(&self) -> f64 {
        self.contact_m.map_or(0.0, |contact_m| (self.travel_m - contact_m).max(0.0))
    }

    fn is_hold_over(&self) -> bool {
        self.phase == Phase::Hold && self.hold_steps_left == 0
    }

    /// Moves on by one step and returns the velocity of that step; `None` when the press is over.
    fn advance(&mut self) -> Option<Vec3> {
        let stride_m = self.plan.speed_m_s * self.plan.step_s;
        let before_m = self.travel_m;
        match (self.phase, self.contact_m) {
            (Phase::Approach, None) => self.travel_m += stride_m,
            (Phase::Approach | Phase::Press, Some(contact_m)) => {
                let bottom_m = contact_m + self.plan.depth_m;
                self.phase = Phase::Press;
                self.travel_m = (self.travel_m + stride_m).min(bottom_m);
                if self.travel_m == bottom_m {
                    self.phase = Phase::Hold;
                }
            }
            (Phase::Hold, _) if self.hold_steps_left > 0 => self.hold_steps_left -= 1,
            (Phase::Hold, _) => {
                self.phase = Phase::Retract;
                self.travel_m -= stride_m;
            }
            (Phase::Retract, _) if self.travel_m > -GAP_M => self.travel_m -= stride_m,
            (Phase::Retract, _) | (Phase::Press, None) => return None,
        }
        Some(self.plan.approach.direction * ((self.travel_m - before_m) / self.plan.step_s))
    }

    /// Takes note of the first contact; `true` when this is it.
    fn notice(&mut self, is_touching: bool) -> anyhow::Result<bool> {
        if self.contact_m.is_some() {
            return Ok(false);
        }
        if is_touching {
            self.contact_m = Some(self.travel_m);
        } else if self.travel_m > SEARCH_M {
            anyhow::bail!("the tool met no tissue within {} mm of where a ray met it", SEARCH_M * 1e3);
        }
        Ok(is_touching)
    }
}
