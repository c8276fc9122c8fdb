//! The meshless model's state on the processor, and how its threads take an implicit step.
//!
//! In each step all threads turn the cells' frames and build the system; one thread alone looks for contact; all solve it, which is
//! done again where contact answered otherwise than it was asked; then nodes move.

mod saved;

use std::sync::Arc;
use std::time::Instant;

use super::super::contact::{ContactNodes, ContactSurface};
use super::super::facing::keep_apart;
use super::super::hold::Hold;
use super::super::looked::Looked;
use super::super::mobile::Mobile;
use super::super::nodes::{Bricks, Field, Run};
use super::super::surface;
use super::super::workers::{Member, Workers};
use super::cell_rows::CellRows;
use super::conjugate::{Budget, Reached};
use super::press::{Press, wall_n_m};
use super::route::{EfgReal, Route};
use super::system::{Parts, Step, System};
use crate::cut::facing::Facings;
use crate::cut::surface::drawn::Redrawn;
use crate::cut::topology::{Change, Topology};
use crate::error::Result;
use crate::math::{Bounds, Vec3};
use crate::model::Model;
use crate::model::lattice::{BRICK_SLOTS, flag};
use crate::model::law::CellLaw;
use crate::model::surface::Surface;
use crate::solver::load::NodalLoads;
use crate::solver::method::{EfgDesc, Scheme};
use crate::solver::statistics::Copied;
use crate::solver::tool::Contact;
use crate::solver::{
    Saved, SeenBrick, Solver, StepPlan, StepReport, SurfaceArrays, SurfaceField, ToolStep, ToolSum,
    saved_elsewhere,
};

/// Bricks of a run: with fewer, cells before a run's first brick are evaluated too often; with more, threads find no work.
const RUN: usize = 16;
/// Steps in which tissue settles, in s.
pub const SETTLING_S: f64 = 1.0;
/// Most solutions of a step, each with contact as the one before answered.
const MAX_SOLUTIONS: usize = 8;

/// A simulation's state.
#[derive(Debug)]
pub struct EfgSolver<R: EfgReal> {
    desc: EfgDesc,
    bricks: Bricks,
    runs: Vec<Run>,
    flags: Vec<u8>,
    laws: [CellLaw; 16],
    system: System<R>,
    cell_rows: CellRows,
    /// Bytes of rows that were copied.
    uploaded: u64,
    /// The last step.
    dt: f64,
    /// Whether the system was made for another step, or other materials.
    is_stale: bool,
    /// A node that goes further in a step is lost: the diagonal of the model, in m.
    furthest: f64,
    u: Field<R>,
    v: Field<R>,
    looked: Looked<R>,
    /// The sides of cuts.
    facing: Facings,
    hold: Hold,
    contact: ContactSurface,
    press: Press,
    fastest: f64,
    workers: Workers,
    route: Route<R>,
}

/// A place that members of a job share; who may write it when is said where that is done.
struct Place<T>(*mut T);
// SAFETY: access is ordered by the meetings of the job.
unsafe impl<T> Sync for Place<T> {}

impl<R: EfgReal> EfgSolver<R> {
    /// The model at rest, computed by `threads` threads, the caller of [`Solver::advance`] included, with room for so many copies of nodes.
    ///
    /// Fails when the operating system starts no more threads.
    pub fn new(model: &Arc<Model>, desc: &EfgDesc, threads: usize, copies: usize) -> Result<Self> {
        let mut bricks = Bricks::new(model.clone(), copies.div_ceil(BRICK_SLOTS));
        let (rows, cell_rows) = CellRows::uncut(&mut bricks, desc.rows)?;
        let mut runs = Vec::new();
        bricks.list_runs(RUN, |_| true, &mut runs);
        let contact = ContactSurface::new(model.clone());
        let mut system = System::new(&bricks, rows, desc.elasticity, model.laws());
        let uploaded = system.upload(&bricks);
        Ok(Self {
            desc: *desc,
            system,
            cell_rows,
            uploaded,
            flags: bricks.flags(),
            laws: *model.laws(),
            dt: 0.0,
            is_stale: true,
            furthest: Vec3::from(model.lattice().cells().map(|n| n as f64)).norm() * model.lattice().cell_m(),
            u: Field::zeros(bricks.count()),
            v: Field::zeros(bricks.count()),
            looked: Looked::default(),
            facing: Facings::default(),
            hold: Hold::default(),
            press: Press::of(&contact),
            contact,
            fastest: 0.0,
            workers: Workers::new(threads)?,
            route: R::route(),
            runs,
            bricks,
        })
    }

    /// Has every thread do a part of a step with its own runs.
    fn together(&mut self, step: Step, part: impl Fn(&Route<R>, &Parts<R>, &Press, &Member, &[Run]) + Sync) {
        let Self { bricks, flags, system, u, v, workers, route, runs, press, .. } = self;
        let parts = system.parts(bricks, flags, step, u, v);
        let (route, press, runs) = (&*route, &*press, &*runs);
        workers.run(&|member: &Member| {
            part(route, &parts, press, member, &runs[member.share(runs.len())]);
        });
    }

    /// One implicit step, over the fraction `span` of the plan's.
    fn substep(&mut self, plan: &StepPlan, span: [f64; 2], sums: &mut [ToolSum], report: &mut StepReport) {
        let g = plan.gravity;
        let step = Step {
            dt: plan.dt,
            drag_per_s: plan.drag_per_s,
            gravity: [g.x, g.y, g.z],
            scheme: self.desc.scheme,
            furthest: self.furthest,
        };
        if self.is_stale || self.dt != plan.dt {
            self.system.set_step(&self.bricks, &self.laws, plan.dt, self.desc.scheme);
            (self.dt, self.is_stale) = (plan.dt, false);
        }
        self.together(step, |route, parts, _, member, mine| {
            // SAFETY: every run is one member's; they meet before other bricks' frames are read.
            unsafe { (route.begin)(parts, member, mine) }
        });
        self.look_for_contact(plan, span);
        let step_s = plan.dt * f64::from(plan.substeps);
        self.press.edges.begin(plan.tools, span[1], [plan.dt, step_s], &self.flags, &mut self.system);
        self.move_held(plan, span[1]);
        for loads in plan.loads {
            self.load(loads, plan.dt);
        }

        let mut budget = Budget {
            tolerance: self.desc.tolerance,
            iterations: self.desc.max_iterations,
            noise: self.system.seen().noise2.sqrt(),
            reference: None,
        };
        let mut reached = Reached::default();
        let mut iterations = 0;
        for solution in 1.. {
            self.press.load(1.0, &mut self.system);
            let mut found = Reached::default();
            let (mut work, place) = (0.0, Place(&raw mut found));
            let work = Place(&raw mut work);
            self.together(step, |route, parts, press, member, mine| {
                let (work, place) = (&work, &place);
                // SAFETY: as above; the first member alone writes the answer.
                unsafe {
                    let found = (route.solve)(parts, press, member, mine, &budget, work.0);
                    if member.index == 0 {
                        *place.0 = found;
                    }
                }
            });
            reached = found;
            iterations += found.iterations;
            budget.reference = Some(found.reference);
            budget.iterations = self.desc.max_iterations.saturating_sub(iterations);
            let is_settled = self.press.judge(solution, &self.system);
            if is_settled || solution == MAX_SOLUTIONS || budget.iterations == 0 {
                break;
            }
            self.press.load(-1.0, &mut self.system);
            self.press.mend();
        }
        report.iterations = iterations;
        if !(reached.residual.is_finite() && reached.reference.is_finite()) {
            return self.give_up(report);
        }
        let left = reached.residual / reached.reference.max(f64::MIN_POSITIVE);
        // Less than what rounding makes is as good as can be.
        let is_met = reached.residual <= budget.noise;
        report.residual = if is_met { left.min(self.desc.tolerance) } else { left };
        self.tell_tools(plan, span[1], sums);

        self.together(step, |route, parts, _, member, mine| {
            // SAFETY: as above.
            unsafe { (route.finish)(parts, member, mine) }
        });
        self.fastest = self.system.seen().speed2.sqrt();
        if self.fastest * plan.dt < self.furthest {
            self.place_held(plan, span[1]);
            self.hold(plan, span[1], sums);
        } else {
            self.give_up(report);
        }
    }

    /// The state stays the last good one, at rest.
    fn give_up(&mut self, report: &mut StepReport) {
        report.has_diverged = true;
        self.halt();
        self.system.reset(&self.bricks);
    }

    fn look_for_contact(&mut self, plan: &StepPlan, span: [f64; 2]) {
        let corner_kg = std::array::from_fn(|material| self.laws[material].corner_kg);
        let wall_n_m = wall_n_m(&self.laws, self.bricks.model.lattice().cell_m());
        let Self { system, contact, u, v, bricks, flags, press, fastest, .. } = self;
        let nodes = ContactNodes {
            bricks,
            u_before: &Field(Vec::new()),
            u,
            v,
            flags,
            corner_kg: &corner_kg,
            dt: plan.dt,
            step: plan.dt * f64::from(plan.substeps),
            fastest: *fastest,
            furthest: *fastest * plan.dt,
        };
        contact.look_ahead(bricks, plan.tools, span, &nodes, |brick| system.moved(brick));
        press.begin(contact, plan.tools, plan.dt, wall_n_m, system);
    }

    /// What regions and tools hold has the velocity that takes it where they are at the fraction `t` of the plan's step.
    fn move_held(&mut self, plan: &StepPlan, t: f64) {
        let Self { system, u, .. } = self;
        for_each_held(&self.bricks.model, plan, t, |_, slot, place| {
            system.x.set(slot, (place - u.vec3(slot)) / plan.dt);
        });
    }

    /// And it is there to the last digit.
    fn place_held(&mut self, plan: &StepPlan, t: f64) {
        let Self { u, .. } = self;
        for_each_held(&self.bricks.model, plan, t, |_, slot, place| u.set(slot, place));
    }

    /// Tissue sticks to the edges of blades, and sides of cuts stay apart, once all has moved.
    fn hold(&mut self, plan: &StepPlan, t: f64, sums: &mut [ToolSum]) {
        let step = plan.dt * f64::from(plan.substeps);
        let Self { u, v, flags, bricks, system, facing, hold, press, .. } = self;
        let kg = |slot: u32| system.mass(slot);
        let mut mobile = Mobile { u, v, flags, kg: &kg };
        let mut way = keep_apart(facing, bricks.model.lattice().cell_m(), plan.dt, &mut mobile);
        let mut begun = press.edges.impulses();
        for (tool, sum) in plan.tools.iter().zip(sums) {
            way += hold.hold(tool, t, [plan.dt, step], &mut begun, &mut mobile, sum);
        }
        self.fastest += way / plan.dt;
    }

    fn load(&mut self, loads: &NodalLoads, dt: f64) {
        let b = &mut self.system.b;
        for &(slot, force) in &loads.forces {
            b.set(slot, b.vec3(slot) + force * dt);
        }
        let lattice = self.bricks.model.lattice();
        for &(corners, pressure) in &loads.pressed {
            let at = corners.map(|slot| lattice.rest_position(slot) + self.u.vec3(slot));
            let area = 0.5 * (at[2] - at[0]).cross(&(at[3] - at[1]));
            for slot in corners {
                b.set(slot, b.vec3(slot) - area * (pressure * dt / 4.0));
            }
        }
    }

    /// What tools gave by contact, and what it took to carry what they hold.
    fn tell_tools(&mut self, plan: &StepPlan, t: f64, sums: &mut [ToolSum]) {
        self.contact.answer(plan.tools, t, self.press.impulses(), sums);
        let system = &self.system;
        for_each_grasped(&self.bricks.model, plan.tools, t, |tool, slot, place| {
            // A x − b: what was missing to move so.
            let impulse = system.q.vec3(slot) - system.b.vec3(slot);
            let at = self.bricks.model.lattice().rest_position(slot) + place;
            let arm = at - plan.tools[tool].path.at(t).translation.vector;
            let sum = &mut sums[tool];
            sum.impulse.force_n -= impulse;
            sum.impulse.torque_n_m -= arm.cross(&impulse);
            sum.work_j += impulse.dot(&system.x.vec3(slot));
        });
    }
}

/// The nodes that regions and tools hold: the tool, if it is one, the slot, and its displacement at the fraction `t` of the plan's step.
fn for_each_held(model: &Model, plan: &StepPlan, t: f64, mut visit: impl FnMut(Option<usize>, u32, Vec3)) {
    for region in plan.regions {
        let pose = region.at(t);
        for &slot in region.nodes.iter() {
            let rest = model.lattice().rest_position(slot);
            visit(None, slot, pose.transform_point(&rest.into()).coords - rest);
        }
    }
    for_each_grasped(model, plan.tools, t, |tool, slot, place| visit(Some(tool), slot, place));
}

fn for_each_grasped(model: &Model, tools: &[ToolStep], t: f64, mut visit: impl FnMut(usize, u32, Vec3)) {
    for (index, tool) in tools.iter().enumerate() {
        let pose = tool.path.at(t);
        for &(slot, place) in tool.grasped.iter() {
            visit(
                index,
                slot,
                pose.transform_point(&place.into()).coords - model.lattice().rest_position(slot),
            );
        }
    }
}

impl<R: EfgReal> Solver for EfgSolver<R> {
    fn stable_dt(&self) -> f64 {
        f64::INFINITY
    }

    fn advance(&mut self, plan: &StepPlan, sums: &mut [ToolSum]) -> Result<StepReport> {
        let started = Instant::now();
        let mut report = StepReport::default();
        let part = |substep: u32| f64::from(substep) / f64::from(plan.substeps);
        // Settling looks for rest alone: steps so long that inertia is nothing, from no velocity each.
        let settling = StepPlan { dt: SETTLING_S, ..*plan };
        let plan = if plan.kinetic_damping { &settling } else { plan };
        for substep in 0..plan.substeps {
            if plan.kinetic_damping {
                self.halt();
            }
            self.substep(plan, [part(substep), part(substep + 1)], sums, &mut report);
            if report.has_diverged {
                break;
            }
            report.substeps += 1;
        }
        let deformed = self.system.seen().deformed;
        report.strain = deformed.strain.into();
        report.volume_ratio = [1.0 - f64::from(deformed.shrinking), 1.0 + f64::from(deformed.swelling)];
        report.awake_nodes = self.bricks.model.lattice().node_count() as u64;
        report.awake_bricks = self.bricks.count() as u64;
        report.contact_points = self.contact.point_count() as u32;
        report.dropped_points = self.contact.dropped_points();
        report.device_s = started.elapsed().as_secs_f64();
        Ok(report)
    }

    fn contacts(&self, tool: usize, show: &mut dyn FnMut(Contact)) {
        self.contact.contacts_of(tool as u32, self.dt).for_each(show);
    }

    fn publish(
        &mut self,
        _index: usize,
        surface: &Surface,
        field: SurfaceField,
        arrays: &mut SurfaceArrays,
    ) -> Result<()> {
        surface::publish(&self.bricks.model, surface, &self.u, field, arrays, &mut self.workers);
        Ok(())
    }

    fn mass(&self, slot: u32) -> f64 {
        self.system.mass(slot)
    }

    fn displacement(&self, slot: u32) -> Vec3 {
        self.u.vec3(slot)
    }

    fn velocity(&self, slot: u32) -> Vec3 {
        self.v.vec3(slot)
    }

    fn displacements(&self, all: &mut Vec<Vec3>) {
        all.clear();
        all.extend((0..self.flags.len() as u32).map(|slot| self.u.vec3(slot)));
    }

    fn look(&mut self, displaced: &mut Vec<Bounds>) {
        self.looked.look(&self.u, self.bricks.model.lattice(), displaced);
    }

    fn seen(&mut self, bricks: &[u32], nodes: &mut Vec<SeenBrick>) {
        self.looked.seen(bricks, nodes);
    }

    fn velocities(&self, all: &mut Vec<Vec3>) {
        all.clear();
        all.extend((0..self.flags.len() as u32).map(|slot| self.v.vec3(slot)));
    }

    fn largest_change(&self, before: &[Vec3]) -> f64 {
        (0..).zip(before).map(|(slot, old)| (self.v.vec3(slot) - old).norm()).fold(0.0, f64::max)
    }

    fn halt(&mut self) {
        self.v.0.fill(Default::default());
        self.fastest = 0.0;
        self.contact.lose_track();
    }

    fn set_node(&mut self, slot: u32, displacement: Vec3, velocity: Vec3) {
        self.u.set(slot, displacement);
        self.v.set(slot, velocity);
        self.fastest = self.fastest.max(velocity.norm());
        self.contact.lose_track();
    }

    fn accelerations(&mut self) -> Vec<Vec3> {
        // From rest, the impulse of inner forces in a second.
        let v = std::mem::replace(&mut self.v, Field::zeros(self.bricks.count()));
        let step = Step {
            dt: 1.0,
            drag_per_s: 0.0,
            gravity: [0.0; 3],
            scheme: Scheme::BackwardEuler,
            furthest: self.furthest,
        };
        self.together(step, |route, parts, _, member, mine| {
            // SAFETY: every run is one member's; they meet before other bricks' frames are read.
            unsafe { (route.begin)(parts, member, mine) }
        });
        self.v = v;
        let mut all = vec![Vec3::zeros(); self.flags.len()];
        for slot in 0..self.flags.len() as u32 {
            let mass = self.system.mass(slot);
            let flags = self.flags[slot as usize];
            let force = self.system.b.vec3(slot);
            let is_free = |axis: usize| mass > 0.0 && flags & ((flag::FIX_X << axis) | flag::GRASPED) == 0;
            let free = |axis: usize| if is_free(axis) { force[axis] / mass } else { 0.0 };
            all[slot as usize] = Vec3::from_fn(|axis, _| free(axis));
        }
        all
    }

    fn wake(&mut self) {}

    fn set_laws(&mut self, laws: &[CellLaw; 16], _stable_dt: f64) -> Result<()> {
        self.laws = *laws;
        self.system.set_laws(&self.bricks, laws);
        self.is_stale = true;
        Ok(())
    }

    fn set_flags(&mut self, changed: &[(u32, u8)], _stable_dt: f64) -> Result<()> {
        for &(slot, flags) in changed {
            self.flags[slot as usize] = flags;
            let v = self.v.vec3(slot);
            let kept = |axis: usize| if flags & (flag::FIX_X << axis) == 0 { v[axis] } else { 0.0 };
            self.v.set(slot, Vec3::from_fn(|axis, _| kept(axis)));
        }
        Ok(())
    }

    fn cut(&mut self, topology: &Topology, change: &Change, surfaces: &[(&Surface, &Redrawn)]) -> Result<()> {
        self.bricks.divide(topology, change);
        for birth in &change.births {
            self.u.set(birth.slot, self.u.vec3(birth.from));
            self.v.set(birth.slot, self.v.vec3(birth.from));
        }
        let lattice = self.bricks.model.lattice();
        for (row, like) in self.cell_rows.divide(self.system.rows(), lattice, topology, change) {
            self.system.turn_to(row, self.system.rotation(like));
        }
        self.uploaded += self.system.upload(&self.bricks);
        self.system.set_laws(&self.bricks, &self.laws);
        self.facing.follow(topology, change);
        let (surface, redrawn) = surfaces[self.bricks.model.contact_surface()];
        self.contact.follow(surface, redrawn);
        Ok(())
    }

    fn heal(&mut self) -> Result<()> {
        self.bricks.heal();
        let (rows, cell_rows) = CellRows::uncut(&mut self.bricks, self.desc.rows)?;
        self.cell_rows = cell_rows;
        self.flags[self.bricks.model.lattice().slot_count()..].fill(flag::FIX_ALL);
        self.system = System::new(&self.bricks, rows, self.desc.elasticity, &self.laws);
        self.uploaded += self.system.upload(&self.bricks);
        self.is_stale = true;
        self.facing.clear();
        self.contact.heal();
        Ok(())
    }

    fn reset(&mut self) {
        self.u = Field::zeros(self.bricks.count());
        self.v = Field::zeros(self.bricks.count());
        self.system.reset(&self.bricks);
        self.contact.clear();
        self.contact.lose_track();
        self.fastest = 0.0;
    }

    fn save(&mut self) -> Result<Saved> {
        Ok(Box::new(self.state()))
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        self.set_state(saved.downcast_ref().ok_or_else(saved_elsewhere)?);
        Ok(())
    }

    fn node_bytes(&self) -> u64 {
        let fields = 2 * self.u.0.len() * size_of_val(&self.u.0[0]);
        fields as u64 + self.system.bytes() + self.flags.len() as u64 * 6
    }

    fn copied(&self) -> Copied {
        Copied { to_device: self.uploaded, ..Copied::default() }
    }
}
