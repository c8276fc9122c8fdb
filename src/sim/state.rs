//! What a simulation consists of besides its model, and how it takes a step.

mod change;
mod snapshot;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

pub use self::snapshot::Snapshot;
use super::body::Body;
use super::carried::{Carried, Mobility, is_held};
use super::cut::{Cuts, flags_of, no_room, uncut_surfaces};
use super::event::{Event, Events};
use super::haptics::Haptics;
use super::latency::Latency;
use super::reach::reached;
use super::tool_port::{self, Asked, Felt, ToolEnd, ToolPort};
use super::{LoadId, MAX_SUBSTEPS, MAX_TOOLS, NodeField, SimDesc, ToolId};
use crate::cpu::stability::strain_factor;
use crate::cut::cell::Piece;
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};
use crate::model::lattice::flag;
use crate::model::law::CellLaw;
use crate::model::surface::Surface;
use crate::model::{Model, efg, energy};
use crate::servo::device::DeviceDesc;
use crate::servo::{Servo, ServoOptions};
use crate::solver::blade::Held;
use crate::solver::load::NodalLoads;
use crate::solver::method::Method;
use crate::solver::statistics::{Energy, Statistics};
use crate::solver::tool::{Contact, ToolDesc, ToolForce, ToolPath, Wrench};
use crate::solver::{
    RegionStep, Solver, StepPlan, StepReport, SurfaceArrays, SurfaceField, ToolStep, ToolSum,
};
use crate::trace;

/// Share of the stable step that is used: the frequency it comes from is a lower bound, within a percent or so.
const SAFETY: f64 = 0.95;
/// Strain that a step is prepared for beyond what was last seen, as |1 − L / l|: a tool may add as much in one step.
const STRAIN_AHEAD: f64 = 0.05;
/// Substeps between two looks at whether the tissue has settled: explicit ones, and implicit ones.
const SETTLE_BLOCK: u32 = 50;
const SETTLE_BLOCK_IMPLICIT: u32 = 3;
/// Contact points from which the stiffness of a tool's contact is told; of more, the first.
const MAX_TOUCHED: usize = 1024;

/// A rigid region that is driven.
#[derive(Clone, Debug)]
pub(super) struct DrivenRegion {
    /// Its nodes, but for those whose tissue was removed.
    pub nodes: Arc<[u32]>,
    /// The transform from its rest place, world frame: where it is, and where the next step takes it.
    from: Pose,
    to: Pose,
}

/// A simulation's state.
#[derive(Debug)]
pub(super) struct State {
    pub model: Arc<Model>,
    pub solver: Box<dyn Solver>,
    pub(super) desc: SimDesc,
    rest_gravity: Vec3,
    pub(super) tools: Vec<ToolEnd>,
    load_ids: Vec<LoadId>,
    loads: Vec<NodalLoads>,
    /// Rigid regions that were driven since all was at rest, by their labels.
    pub(super) regions: BTreeMap<u16, DrivenRegion>,
    next_id: u64,
    pub(super) body: Body,
    report: StepReport,
    pub(super) statistics: Statistics,
    pub latency: Latency,
    tool_work_j: f64,
    diverged_at: Option<f64>,
    /// Why the device is lost.
    lost: Option<String>,
    /// Whether a panic ended the simulation's own thread, and left who knows what.
    is_broken: bool,
    /// Tools of the last plan, and their indices in `tools`.
    pub(super) steps: Vec<ToolStep>,
    pub(super) planned: Vec<usize>,
    nothing_held: Arc<[Held]>,
    sums: Vec<ToolSum>,
    /// Contacts of the tool at hand, world frame.
    touched: Vec<Contact>,
    carried: Carried,
    pub(super) events: Events,
    moved_regions: Vec<RegionStep>,
    pub(super) cuts: Option<Cuts>,
    /// The model's surfaces, as cuts have left them.
    pub(super) surfaces: Vec<Arc<Surface>>,
    /// Those that could not follow the last cuts.
    pub(super) is_behind: Vec<bool>,
    /// Counts what cuts and resets have made of them.
    pub(super) surface_version: u64,
}

impl State {
    pub fn new(model: Arc<Model>, desc: SimDesc, solver: Box<dyn Solver>, events: Events) -> Result<Self> {
        let rest_gravity = if desc.rest_under_gravity { desc.gravity_m_s2 } else { Vec3::zeros() };
        let body = Body::new(&model, solver.stable_dt());
        let cuts = (desc.cut_nodes > 0).then(|| Cuts::new(&model, desc.cut_nodes));
        let surfaces = uncut_surfaces(&model, desc.cut_nodes);
        let mut state = Self {
            statistics: Statistics {
                stable_substep_s: solver.stable_dt(),
                node_count: model.lattice().node_count() as u64,
                node_bytes: solver.node_bytes(),
                volume_ratio: [1.0, 1.0],
                ..Statistics::default()
            },
            solver,
            desc,
            rest_gravity,
            tools: Vec::with_capacity(MAX_TOOLS),
            load_ids: Vec::new(),
            loads: Vec::new(),
            regions: BTreeMap::new(),
            next_id: 1,
            body,
            report: StepReport::default(),
            latency: Latency::default(),
            tool_work_j: 0.0,
            diverged_at: None,
            lost: None,
            is_broken: false,
            steps: Vec::with_capacity(MAX_TOOLS),
            planned: Vec::with_capacity(MAX_TOOLS),
            nothing_held: Arc::new([]),
            moved_regions: Vec::with_capacity(model.regions().len()),
            sums: Vec::with_capacity(MAX_TOOLS),
            touched: Vec::with_capacity(MAX_TOUCHED),
            carried: Carried::default(),
            events,
            cuts,
            surfaces,
            is_behind: vec![false; model.surfaces().len()],
            surface_version: 0,
            model,
        };
        let needed = state.substeps_needed();
        if needed > f64::from(MAX_SUBSTEPS) {
            return Err(Error::Limit(format!(
                "a step of {} s would need {needed:.0} substeps of {:.3e} s, more than {MAX_SUBSTEPS}: soften or cap the \
                 stiffest material, or make it rigid",
                state.desc.step_s,
                state.solver.stable_dt()
            )));
        }
        state.note_substeps();
        Ok(state)
    }

    /// With a device, its servo loop runs in the port.
    pub fn add_tool(
        &mut self,
        desc: &ToolDesc,
        device: Option<(&DeviceDesc, &ServoOptions)>,
    ) -> Result<ToolPort> {
        self.check()?;
        let cell_m = self.model.lattice().cell_m();
        let device = device.map(|(device, options)| {
            Ok((Servo::new(device, options)?, Haptics::new(device, options, cell_m)))
        });
        let device = device.transpose()?;
        if desc.blade.is_some() && self.desc.cut_nodes == 0 {
            return Err(no_room());
        }
        if self.tools.len() == MAX_TOOLS {
            return Err(Error::Limit(format!("a simulation has at most {MAX_TOOLS} tools")));
        }
        let (port, mut end) = tool_port::open(ToolId(self.fresh_id()), desc, device);
        if self.diverged_at.is_some() {
            end.release(self.statistics.time_s, self.statistics.steps, true);
        }
        self.tools.push(end);
        Ok(port)
    }

    pub fn remove_tool(&mut self, id: ToolId) -> Result<()> {
        let index = self.tool_index(id)?;
        self.release(index)?;
        self.tools.remove(index);
        self.forget_plan();
        self.solver.wake();
        Ok(())
    }

    fn tool_index(&self, id: ToolId) -> Result<usize> {
        let found = self.tools.iter().position(|tool| tool.id == id);
        found.ok_or_else(|| Error::argument(format!("there is no tool {} in this simulation", id.0)))
    }

    /// Simulated length of a step in s.
    pub fn step_s(&self) -> f64 {
        self.desc.step_s
    }

    /// `asked` is when the step was asked for.
    pub fn step(&mut self, asked: Instant) -> Result<()> {
        self.refuse_if_failed()?;
        let (substeps, dt) = self.note_substeps();
        self.take_motions(asked);
        self.stick_to_blades();
        self.advance(substeps, dt, None)?;

        self.statistics.time_s += dt * f64::from(self.report.substeps);
        if self.report.has_diverged {
            return Err(self.note_divergence());
        }
        self.statistics.steps += 1;
        self.publish_forces(dt * f64::from(substeps), false)?;
        let begun = Instant::now();
        self.cut_with_blades();
        self.statistics.cut_wall_s = begun.elapsed().as_secs_f64();
        let wall = asked.elapsed().as_secs_f64();
        self.latency.note(wall);
        self.statistics.step_device_s = self.report.device_s;
        self.statistics.step_wall_s = wall;
        self.statistics.real_time_factor = self.desc.step_s / wall;
        Ok(())
    }

    pub fn settle(&mut self, tolerance: f64, max_substeps: u64) -> Result<f64> {
        self.refuse_if_failed()?;
        self.take_motions(Instant::now());
        // Regions and tools arrive within the first block, then stay.
        let mut taken = 0;
        let mut left = f64::INFINITY;
        let most = if self.desc.method == Method::Lattice { SETTLE_BLOCK } else { SETTLE_BLOCK_IMPLICIT };
        let mut before = Vec::new();
        self.disengage();
        while taken < max_substeps && left > tolerance {
            let (_, dt) = self.note_substeps();
            let block = u64::from(most).min(max_substeps - taken) as u32;
            self.settle_for(block, dt, true)?;

            // What a node gains in one more substep is by all that acts on it, loads and contact too.
            self.solver.velocities(&mut before);
            self.settle_for(1, dt, false)?;
            self.publish_forces(dt, true)?;
            taken += u64::from(block) + 1;
            left = self.solver.largest_change(&before) / dt;
        }
        self.solver.halt();
        Ok(left)
    }

    /// Some substeps of settling; tools stay where the first ones took them.
    fn settle_for(&mut self, substeps: u32, dt: f64, kinetic_damping: bool) -> Result<()> {
        self.advance(substeps, dt, Some(kinetic_damping))?;
        if self.report.has_diverged {
            return Err(self.note_divergence());
        }
        for tool in &mut self.steps {
            tool.path.from = tool.path.to;
        }
        Ok(())
    }

    pub fn reset(&mut self) {
        if self.check().is_err() {
            return;
        }
        for index in 0..self.tools.len() {
            // As for a tool that leaves.
            let _ = self.release(index);
        }
        if self.heal().is_err() {
            return;
        }
        self.solver.reset();
        self.diverged_at = None;
        self.report = StepReport::default();
        self.statistics = Statistics {
            stable_substep_s: self.statistics.stable_substep_s,
            node_count: self.model.lattice().node_count() as u64,
            node_bytes: self.statistics.node_bytes,
            volume_ratio: [1.0, 1.0],
            ..Statistics::default()
        };
        self.tool_work_j = 0.0;
        self.forget_plan();
        self.regions.clear();
        for index in 0..self.tools.len() {
            let outside = self.outside(&self.tools[index]);
            let tool = &mut self.tools[index];
            tool.stands = outside.or(tool.stands);
            tool.is_refused = false;
            tool.release(0.0, 0, false);
        }
        self.note_substeps();
    }

    /// Where a tool with a device comes in again once tissue was put back, as it did before: around a tool tissue would be caught on it, and no spring pulls that off.
    fn outside(&self, tool: &ToolEnd) -> Option<Asked> {
        tool.entered.filter(|at| self.is_clear(tool, &at.motion.pose)).or(tool.began)
    }

    /// Whether no node is in a tool.
    fn is_clear(&self, tool: &ToolEnd, pose: &Pose) -> bool {
        let (lattice, pose) = (self.model.lattice(), self.model.frame().inverse() * pose);
        let at = |slot: u32| lattice.rest_position(slot) + self.solver.displacement(slot);
        let place = |slot| pose.inverse_transform_point(&at(slot).into()).coords;
        lattice.slots().all(|slot| tool.desc.distance(place(slot)).distance > 0.0)
    }

    pub fn add_load(&mut self, loads: NodalLoads) -> LoadId {
        let id = self.fresh_id();
        self.load_ids.push(LoadId(id));
        self.loads.push(loads);
        self.solver.wake();
        LoadId(id)
    }

    pub fn remove_load(&mut self, id: LoadId) -> Result<()> {
        let found = self.load_ids.iter().position(|&other| other == id);
        let index =
            found.ok_or_else(|| Error::argument(format!("there is no load {} in this simulation", id.0)))?;
        self.load_ids.remove(index);
        self.loads.remove(index);
        self.solver.wake();
        Ok(())
    }

    pub fn drive_region(&mut self, label: u16, motion: &Pose) -> Result<()> {
        let Some(nodes) = self.model.regions().get(&label) else {
            return Err(Error::argument(format!("label {label} is no rigid region of this model")));
        };
        let is_left = |slot: &u32| self.cuts.as_ref().is_none_or(|cuts| !cuts.topology.is_removed(*slot));
        let driven = || DrivenRegion {
            nodes: nodes.iter().copied().filter(is_left).collect(),
            from: Pose::identity(),
            to: *motion,
        };
        self.regions.entry(label).or_insert_with(driven).to = *motion;
        Ok(())
    }

    pub fn contacts(&mut self, id: ToolId) -> Result<Vec<Contact>> {
        let index = self.tool_index(id)?;
        let Some(planned) = self.planned.iter().position(|&p| p == index) else { return Ok(Vec::new()) };
        let (frame, mut contacts) = (self.model.frame(), Vec::new());
        self.solver.contacts(planned, &mut |contact| contacts.push(in_world(&frame, contact)));
        self.check()?;
        Ok(contacts)
    }

    pub fn nodes(&self, field: NodeField) -> Vec<Vec3> {
        let (lattice, frame) = (self.model.lattice(), self.model.frame());
        lattice
            .slots()
            .map(|slot| match field {
                NodeField::RestPosition => frame.transform_point(&lattice.rest_position(slot).into()).coords,
                NodeField::Displacement => frame * self.solver.displacement(slot),
                NodeField::Velocity => frame * self.solver.velocity(slot),
            })
            .collect()
    }

    pub fn statistics(&self) -> Statistics {
        let (copied, dropped_events) = (self.solver.copied(), self.events.dropped);
        Statistics { copied, dropped_events, ..self.statistics }
    }

    pub fn energy(&mut self) -> Energy {
        let laws = &self.body.laws;
        let masses = self.masses();
        // Velocities of the lattice lag by half a substep.
        let half = if self.desc.method == Method::Lattice { 0.5 * self.statistics.substep_s } else { 0.0 };
        let gravity = self.gravity();
        let accelerations = if half > 0.0 { self.solver.accelerations() } else { Vec::new() };
        let (mut kinetic_j, mut gravity_j) = (0.0, 0.0);
        for (slot, mass) in masses {
            // At the time of the displacements velocities are this.
            let v = self.solver.velocity(slot);
            let flags = self.flags_of(slot);
            let a = accelerations.get(slot as usize).map_or(Vec3::zeros(), |a| a + gravity);
            let v = Vec3::from_fn(|axis, _| {
                if flags & (flag::FIX_X << axis) == 0 { v[axis] + a[axis] * half } else { v[axis] }
            });
            kinetic_j += 0.5 * mass * v.norm_squared();
            gravity_j -= mass * gravity.dot(&self.solver.displacement(slot));
        }
        let h = self.model.lattice().cell_m();
        let cell_j = |law: &CellLaw, piece: &Piece, u: &[Vec3; 8]| match self.desc.method {
            Method::Lattice => energy::cell_j(law, h, u),
            Method::Efg(desc) => efg::energy::cell_j(law, h, desc.elasticity, piece.centroid, u),
        };
        let hung = self.hung();
        let elastic = hung.iter().map(|(material, hung)| {
            let u = hung.nodes.map(|slot| self.solver.displacement(slot));
            hung.piece.volume * cell_j(&laws[usize::from(*material)], &hung.piece, &u)
        });
        let elastic_j = elastic.sum();
        Energy { kinetic_j, elastic_j, gravity_j, tool_work_j: self.tool_work_j }
    }

    pub fn set_node(&mut self, slot: u32, displacement: Vec3, velocity: Vec3) -> Result<()> {
        if self.cuts.as_ref().is_some_and(|cuts| cuts.topology.is_removed(slot)) {
            return Err(Error::argument(format!("the tissue at slot {slot} was removed")));
        }
        self.solver.set_node(slot, displacement, velocity);
        Ok(())
    }

    /// A surface as it is now, and what counts its changes.
    pub fn surface(&self, index: usize) -> (&Arc<Surface>, u64) {
        (&self.surfaces[index], self.surface_version)
    }

    /// Fills a surface's arrays; gives the simulated time.
    pub fn publish(&mut self, index: usize, field: SurfaceField, arrays: &mut SurfaceArrays) -> Result<f64> {
        let _range = trace::range(c"publish");
        let published = self.solver.publish(index, &self.surfaces[index], field, arrays);
        self.heed(published)?;
        Ok(self.statistics.time_s)
    }

    /// Whether all is sound and the device is still there.
    pub fn check(&mut self) -> Result<()> {
        self.refuse_defect()?;
        match &self.lost {
            Some(why) => Err(Error::Device(why.clone())),
            None => {
                let answer = self.solver.check();
                self.heed(answer)
            }
        }
    }

    pub fn refuse_defect(&self) -> Result<()> {
        if self.is_broken {
            return Err(Error::Defect("a defect of the library ended the simulation's thread".into()));
        }
        Ok(())
    }

    /// A panic ended the simulation's own thread: nobody knows what state this is, and nobody shall see it.
    pub fn give_up(&mut self) {
        self.is_broken = true;
        self.let_go();
    }

    /// Hands a backend's answer on; one that says that the device is lost ends the simulation.
    pub(super) fn heed<T>(&mut self, answer: Result<T>) -> Result<T> {
        if let Err(Error::Device(why)) = &answer {
            self.lost = Some(why.clone());
            self.events.tell(Event::DeviceLost { time_s: self.statistics.time_s });
            self.let_go();
        }
        answer
    }

    fn fresh_id(&mut self) -> u64 {
        self.next_id += 1;
        self.next_id - 1
    }

    /// Gravity that acts, model frame.
    fn gravity(&self) -> Vec3 {
        self.model.frame().rotation.inverse() * (self.desc.gravity_m_s2 - self.rest_gravity)
    }

    fn substeps_needed(&self) -> f64 {
        let factor = strain_factor(self.report.strain + STRAIN_AHEAD, self.body.poisson()).max(0.1);
        (self.desc.step_s / (SAFETY * factor * self.solver.stable_dt())).ceil().max(1.0)
    }

    /// Chooses the substeps of the next step: how many, and their length.
    fn note_substeps(&mut self) -> (u32, f64) {
        let count =
            self.desc.substeps.unwrap_or_else(|| self.substeps_needed().min(f64::from(MAX_SUBSTEPS)) as u32);
        let dt = self.desc.step_s / f64::from(count);
        self.statistics.substeps_per_step = count;
        self.statistics.substep_s = dt;
        (count, dt)
    }

    /// Reads the tools' newest motions and plans their ways in the coming step, which begins `now`.
    fn take_motions(&mut self, now: Instant) {
        let to_model = self.model.frame().inverse();
        self.forget_plan();
        while let Some(index) = self.tools.iter().position(ToolEnd::has_left) {
            // A device that is lost here is found to be so by the step.
            let _ = self.release(index);
            self.tools.remove(index);
            self.solver.wake();
        }
        for (index, tool) in self.tools.iter_mut().enumerate() {
            let (time_s, id) = (self.statistics.time_s, tool.id);
            if let Some((_, hearing)) = &mut tool.device {
                while let Some(buttons) = hearing.next_change() {
                    self.events.tell(Event::Buttons { time_s, tool: id, buttons });
                }
            }
            let (newest, is_news) = tool.asked.read();
            let Some(mut asked) = *newest else { continue };
            // A tool appears where it is first set, without having swept the way there.
            let from = tool.stands.unwrap_or(asked).motion.pose;
            if let Some((haptics, hearing)) = &mut tool.device {
                tool.began.get_or_insert(asked);
                let (step_s, radius) = (self.desc.step_s, tool.desc.reach_m());
                asked.motion = reached(&from, &haptics.led(&from, &asked.motion, step_s), radius, step_s);
                if hearing.falls_silent(is_news, now) {
                    self.events.tell(Event::ServoSilent { time_s, tool: id });
                }
            }
            tool.stands = Some(asked);
            let path = ToolPath { from: to_model * from, to: to_model * asked.motion.pose };
            self.planned.push(index);
            let (desc, grasped) = (tool.desc.clone(), tool.grasped.clone());
            self.steps.push(ToolStep { desc, path, grasped, held: self.nothing_held.clone() });
        }
    }

    fn forget_plan(&mut self) {
        self.planned.clear();
        self.steps.clear();
    }

    /// `settling` says whether velocities are cleared on the way, and that neither drag nor sleep shall disturb; `None` is a step.
    fn advance(&mut self, substeps: u32, dt: f64, settling: Option<bool>) -> Result<()> {
        let frame = self.model.frame();
        let to_model = |motion: &Pose| frame.inverse() * motion * frame;
        self.moved_regions.clear();
        let is_moved = |region: &&DrivenRegion| region.from != region.to && !region.nodes.is_empty();
        let moved = self.regions.values().filter(is_moved);
        self.moved_regions.extend(moved.map(|region| RegionStep {
            nodes: region.nodes.clone(),
            from: to_model(&region.from),
            to: to_model(&region.to),
        }));
        let plan = StepPlan {
            substeps,
            dt,
            gravity: self.gravity(),
            drag_per_s: if settling.is_some() { 0.0 } else { self.desc.drag_per_s },
            tools: &self.steps,
            regions: &self.moved_regions,
            loads: &self.loads,
            sleeping: self.desc.sleeping && settling.is_none(),
            kinetic_damping: settling == Some(true),
            tells_contacts: settling.is_none()
                && self.planned.iter().any(|&i| self.tools[i].device.is_some()),
        };
        self.sums.clear();
        self.sums.resize(self.steps.len(), ToolSum::default());
        let advanced = self.solver.advance(&plan, &mut self.sums);
        self.report = self.heed(advanced)?;
        for region in self.regions.values_mut() {
            region.from = region.to;
        }

        let (report, statistics) = (&self.report, &mut self.statistics);
        statistics.substeps += u64::from(report.substeps);
        statistics.awake_nodes = report.awake_nodes;
        statistics.awake_bricks = report.awake_bricks;
        statistics.max_strain = report.strain;
        statistics.volume_ratio = report.volume_ratio;
        statistics.cg_iterations = report.iterations;
        statistics.true_residual = report.residual;
        statistics.contact_points = report.contact_points;
        statistics.dropped_points = report.dropped_points;
        self.tool_work_j += self.sums.iter().map(|sum| sum.work_j).sum::<f64>();
        Ok(())
    }

    /// The tissue changes otherwise than by steps in time: what a device feels begins anew.
    fn disengage(&mut self) {
        for tool in &mut self.tools {
            tool.disengage(self.statistics.time_s, self.statistics.steps);
        }
    }

    /// After a pause tools are where they are now, and have not swept the way there. A device's goes there at its pace and
    /// pushes tissue before it: tissue in which it is from one step to the next would be caught on it.
    pub fn forget_ways(&mut self) {
        for tool in self.tools.iter_mut().filter(|tool| tool.device.is_none()) {
            let newest = *tool.asked.read().0;
            tool.stands = newest.or(tool.stands);
        }
    }

    /// Gives each tool the mean wrench of the step, and those with a device what their servo needs. World frame.
    fn publish_forces(&mut self, duration: f64, settling: bool) -> Result<()> {
        let (frame, now) = (self.model.frame(), Instant::now());
        for (planned, (&index, sum)) in self.planned.iter().zip(&self.sums).enumerate() {
            let tool = &mut self.tools[index];
            let asked = tool.stands.expect("a planned tool stands somewhere");
            let force = ToolForce {
                wrench: Wrench {
                    force_n: frame * sum.impulse.force_n / duration,
                    torque_n_m: frame * sum.impulse.torque_n_m / duration,
                },
                motion: asked.motion,
                time_s: self.statistics.time_s,
                sequence: self.statistics.steps,
            };
            let Some((haptics, _)) = tool.device.as_mut().filter(|_| !settling) else {
                tool.publish_force(force);
                continue;
            };
            let touched = &mut self.touched;
            touched.clear();
            self.solver.contacts(planned, &mut |contact| {
                if touched.len() < MAX_TOUCHED {
                    touched.push(in_world(&frame, contact));
                }
            });
            if touched.is_empty() {
                tool.entered = Some(asked);
            }
            let friction = tool.desc.friction;
            let Body { materials, flags, .. } = &self.body;
            let (lattice, rows) = (self.model.lattice(), &self.surfaces[self.model.contact_surface()].rows);
            let mobility = |slot: u32, push: &Vec3| {
                let push = frame.inverse() * push;
                let held = flags_of(self.cuts.as_ref(), lattice, flags, slot);
                let kg = self.solver.mass(slot);
                let free = (0..3).filter(|axis| held & (flag::GRASPED | flag::FIX_X << axis) == 0);
                let square: f64 = free.map(|axis| push[axis] * push[axis]).sum();
                Mobility { free: square / kg, all: push.norm_squared() / kg }
            };
            let is_held = |contact: &Contact| is_held(contact, rows, mobility);
            let mass_kg = || self.carried.mass_kg(touched.iter().filter(|c| !is_held(c)), rows, mobility);
            let model =
                haptics.model(&asked, &force, touched, friction, duration, now, materials, is_held, mass_kg);
            tool.felt.publish(Felt { force, model });
        }
        self.check()
    }

    /// The simulation's own thread ended a step late, and has let so much time go.
    pub fn note_late(&mut self, dropped_s: Option<f64>) {
        self.statistics.overruns += 1;
        if let Some(dropped_s) = dropped_s {
            self.statistics.dropped_s += dropped_s;
            self.events.fell_behind(self.statistics.time_s, dropped_s);
        }
    }

    fn refuse_if_failed(&mut self) -> Result<()> {
        self.check()?;
        match self.diverged_at {
            None => Ok(()),
            Some(time_s) => Err(Error::Diverged { time_s, reason: "reset it before the next step".into() }),
        }
    }

    /// The simulation failed: tools feel nothing.
    pub fn let_go(&mut self) {
        for tool in &mut self.tools {
            tool.release(self.statistics.time_s, self.statistics.steps, true);
        }
    }

    /// Freezes the simulation.
    fn note_divergence(&mut self) -> Error {
        let time_s = self.statistics.time_s;
        self.diverged_at = Some(time_s);
        self.events.tell(Event::Diverged { time_s });
        self.let_go();
        let dt = self.statistics.substep_s;
        Error::Diverged {
            time_s,
            reason: format!(
                "a node moved further than a cell (of the meshless model, than the body is large), or nowhere finite, in a \
                 substep of {dt:.3e} s"
            ),
        }
    }
}

/// A contact of the model's frame in the world's.
fn in_world(frame: &Pose, contact: Contact) -> Contact {
    Contact {
        point_m: frame.transform_point(&contact.point_m.into()).coords,
        normal: frame * contact.normal,
        force_n: frame * contact.force_n,
        ..contact
    }
}
