//! All that a simulation goes on from, kept in memory.

use std::collections::BTreeMap;
use std::mem::discriminant;
use std::sync::Arc;

use super::{
    Body, Cuts, DrivenRegion, LoadId, NodalLoads, SimDesc, State, Statistics, StepReport, ToolDesc, ToolEnd,
};
use crate::cut::surface::drawn::Redrawn;
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::Model;
use crate::model::lattice::BRICK_SLOTS;
use crate::model::surface::Surface;
use crate::sim::ToolId;
use crate::sim::tool_port::Asked;
use crate::solver::Saved;

/// What a simulation was at one instant: see [`Sim::snapshot`](crate::sim::Sim::snapshot). It may outlive its simulation, and any thread may have it.
#[derive(Debug)]
pub struct Snapshot {
    model: Arc<Model>,
    desc: SimDesc,
    rest_gravity: Vec3,
    /// What the solver has saved.
    saved: Saved,
    body: Body,
    report: StepReport,
    statistics: Statistics,
    tool_work_j: f64,
    tools: Vec<SavedTool>,
    load_ids: Vec<LoadId>,
    loads: Vec<NodalLoads>,
    regions: BTreeMap<u16, DrivenRegion>,
    next_id: u64,
    cuts: Option<Cuts>,
    surfaces: Vec<Arc<Surface>>,
    is_behind: Vec<bool>,
}

/// A tool, as far as steps change it.
#[derive(Debug)]
struct SavedTool {
    id: ToolId,
    desc: Arc<ToolDesc>,
    stands: Option<Asked>,
    began: Option<Asked>,
    entered: Option<Asked>,
    grasped: Arc<[(u32, Vec3)]>,
    is_refused: bool,
}

impl SavedTool {
    fn of(tool: &ToolEnd) -> Self {
        Self {
            id: tool.id,
            desc: tool.desc.clone(),
            stands: tool.stands,
            began: tool.began,
            entered: tool.entered,
            grasped: tool.grasped.clone(),
            is_refused: tool.is_refused,
        }
    }

    /// Whether a tool of a simulation is this one.
    fn is(&self, tool: &ToolEnd) -> bool {
        self.id == tool.id && self.desc == tool.desc
    }
}

/// The cuts that a solver knows of.
fn divided(cuts: Option<&Cuts>) -> Option<&Cuts> {
    cuts.filter(|cuts| cuts.topology.version() > 0)
}

impl State {
    /// See [`crate::sim::Sim::snapshot`].
    pub fn snapshot(&mut self) -> Result<Snapshot> {
        self.refuse_if_failed()?;
        let saved = self.solver.save();
        Ok(Snapshot {
            saved: self.heed(saved)?,
            model: self.model.clone(),
            desc: self.desc.clone(),
            rest_gravity: self.rest_gravity,
            body: self.body.clone(),
            report: self.report,
            statistics: self.statistics,
            tool_work_j: self.tool_work_j,
            tools: self.tools.iter().map(SavedTool::of).collect(),
            load_ids: self.load_ids.clone(),
            loads: self.loads.clone(),
            regions: self.regions.clone(),
            next_id: self.next_id,
            cuts: self.cuts.clone(),
            surfaces: self.surfaces.clone(),
            is_behind: self.is_behind.clone(),
        })
    }

    /// See [`crate::sim::Sim::restore`].
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<()> {
        self.check()?;
        self.refuse_other(snapshot)?;
        // It changes nothing where it fails; what is behind it may leave half a state.
        let body = &snapshot.body;
        let changed = self.solver.set_laws(&body.laws, body.stable_dt);
        self.heed(changed)?;
        self.body = body.clone();
        let restored = self.restore_tissue(snapshot);
        if let Err(error) = self.heed(restored) {
            self.diverged_at = Some(self.statistics.time_s);
            self.let_go();
            return Err(error);
        }

        self.diverged_at = None;
        self.desc.gravity_m_s2 = snapshot.desc.gravity_m_s2;
        self.report = snapshot.report;
        self.statistics = snapshot.statistics;
        self.tool_work_j = snapshot.tool_work_j;
        self.load_ids.clone_from(&snapshot.load_ids);
        self.loads.clone_from(&snapshot.loads);
        self.regions.clone_from(&snapshot.regions);
        self.next_id = self.next_id.max(snapshot.next_id);
        self.forget_plan();
        self.restore_tools(snapshot)
    }

    /// Refuses what another simulation was, or one that is described otherwise.
    fn refuse_other(&self, snapshot: &Snapshot) -> Result<()> {
        let (own, then) = (&self.desc, &snapshot.desc);
        let room = |desc: &SimDesc| desc.cut_nodes.div_ceil(BRICK_SLOTS);
        let is_other = [
            ("model", !Arc::ptr_eq(&self.model, &snapshot.model)),
            ("backend", discriminant(&own.backend) != discriminant(&then.backend)),
            ("method", own.method != then.method),
            ("precision", own.precision != then.precision),
            ("room for cuts", room(own) != room(then)),
            ("least part", own.least_part_cells != then.least_part_cells),
            ("length of a step", (own.step_s, own.substeps) != (then.step_s, then.substeps)),
            ("rest shape", self.rest_gravity != snapshot.rest_gravity),
            ("drag", own.drag_per_s != then.drag_per_s),
            ("rule of sleep", own.sleeping != then.sleeping),
        ];
        match is_other.iter().find(|(_, is_other)| *is_other) {
            None => Ok(()),
            Some((what, _)) => {
                Err(Error::argument(format!("the snapshot is of a simulation with another {what}")))
            }
        }
    }

    /// The solver takes over what was cut then, and how nodes moved.
    fn restore_tissue(&mut self, snapshot: &Snapshot) -> Result<()> {
        // Loads may be others.
        self.solver.wake();
        if divided(self.cuts.as_ref()).is_some() {
            self.solver.heal()?;
        }
        self.cuts.clone_from(&snapshot.cuts);
        if let Some(cuts) = divided(snapshot.cuts.as_ref()) {
            let change = cuts.topology.everything_and_removed(self.model.lattice());
            let all = Redrawn::all();
            let surfaces: Vec<_> = snapshot.surfaces.iter().map(|surface| (surface.as_ref(), &all)).collect();
            self.solver.cut(&cuts.topology, &change, &surfaces)?;
        }
        let are_same = self.surfaces.iter().zip(&snapshot.surfaces).all(|(now, then)| Arc::ptr_eq(now, then));
        self.surface_version += u64::from(!are_same);
        self.surfaces.clone_from(&snapshot.surfaces);
        self.is_behind.clone_from(&snapshot.is_behind);
        self.solver.restore(&snapshot.saved)
    }

    /// Tools stand where they did and hold what they held; what one held that is gone is let go of.
    fn restore_tools(&mut self, snapshot: &Snapshot) -> Result<()> {
        let is_gone = |then: &&SavedTool| !self.tools.iter().any(|tool| then.is(tool));
        let lost = snapshot.tools.iter().filter(is_gone);
        let changed =
            self.body.set_grasped(lost.flat_map(|then| then.grasped.iter().map(|held| held.0)), false);
        if !changed.is_empty() {
            let answer = self.solver.set_flags(&changed, self.body.stable_dt);
            self.heed(answer)?;
        }
        for index in 0..self.tools.len() {
            let tool = &self.tools[index];
            if let Some(then) = snapshot.tools.iter().find(|then| then.is(tool)) {
                let tool = &mut self.tools[index];
                (tool.stands, tool.began, tool.entered) = (then.stands, then.began, then.entered);
                tool.grasped = then.grasped.clone();
                tool.is_refused = then.is_refused;
            } else {
                let outside = self.outside(tool);
                let tool = &mut self.tools[index];
                (tool.stands, tool.grasped, tool.is_refused) = (outside, Arc::new([]), false);
            }
            let tool = &mut self.tools[index];
            tool.release(self.statistics.time_s, self.statistics.steps, false);
        }
        Ok(())
    }
}
