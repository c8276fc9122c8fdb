//! The meshless model's backend on a GPU: how an implicit step is asked of the device.
//!
//! A step's record goes to the device, sites are listed where the last list is no longer good, one kernel takes the step, and its last block writes what
//! happened into memory that the host watches. Nothing else goes to and fro.

mod saved;

use std::cell::RefCell;
use std::sync::Arc;

use super::Number;
use super::state::{State, number};
use crate::cpu::contact::found;
use crate::cpu::efg::press::wall_n_m;
use crate::cpu::efg::solver::SETTLING_S;
use crate::cuda::body::Body;
use crate::cuda::contact::{ContactSurface, Plan};
use crate::cuda::device::Device;
use crate::cuda::kernels::EfgKernels;
use crate::cuda::layout::{self, EfgStep, MOBILE_THREADS, Places, Report, SOUND, Step};
use crate::cuda::look::Look;
use crate::cuda::memory::{Pinned, Stream};
use crate::cuda::near::NearTools;
use crate::cuda::outside::{self, Outside};
use crate::cuda::pointer;
use crate::cuda::surface::Surfaces;
use crate::cuda::told::Told;
use crate::cut::surface::drawn::Redrawn;
use crate::cut::topology::{Change, Topology};
use crate::error::{Error, Result};
use crate::math::{Bounds, Vec3};
use crate::model::Model;
use crate::model::lattice::flag;
use crate::model::law::CellLaw;
use crate::model::surface::Surface;
use crate::sim::MAX_TOOLS;
use crate::solver::method::{EfgDesc, Elasticity, Scheme};
use crate::solver::statistics::Copied;
use crate::solver::tool::Contact;
use crate::solver::{
    Saved, SeenBrick, Solver, StepPlan, StepReport, SurfaceArrays, SurfaceField, ToolSum, saved_elsewhere,
};
use crate::trace;

/// A simulation's state on a GPU.
#[derive(Debug)]
pub struct CudaEfgSolver<R: Number> {
    model: Arc<Model>,
    desc: EfgDesc,
    stream: Arc<Stream>,
    kernels: EfgKernels,
    body: Body,
    state: State<R>,
    step: Pinned<EfgStep>,
    report: Told,
    contact: ContactSurface,
    outside: Outside,
    near: NearTools,
    surfaces: Surfaces,
    /// Where there is room for cuts.
    look: Option<Look<R>>,
    /// The step that moduli were made for; 0 where they were made for none.
    dt: f64,
    /// A node that goes further in a step is lost: the diagonal of the model, in m.
    furthest: f64,
    /// Speed of the fastest node at the end of the last step, m/s, and how long that was.
    speed: f64,
    last_dt: f64,
    /// Where tools were then, model frame.
    origins: Vec<Vec3>,
    dropped: u64,
    /// Of those, the ones before the last reset.
    dropped_before: u64,
    sequence: u32,
    /// The host's copy of displacements and velocities, where it is up to date.
    mirror: RefCell<Mirror<R>>,
    /// The first failure of a call that has no way to tell it: the state is lost.
    lost: RefCell<Option<String>>,
}

impl<R: Number> CudaEfgSolver<R> {
    /// The model at rest on a device, with room for so many copies of nodes.
    pub fn new(model: &Arc<Model>, desc: &EfgDesc, device: Arc<Device>, copies: usize) -> Result<Self> {
        let stream = Arc::new(Stream::new(device)?);
        let (lattice, mut body) = (model.lattice(), Body::of(model, copies));
        let kernels = EfgKernels::load(&stream.device, R::PRECISION, body.bricks_for(0))?;
        let mut solver = Self {
            state: State::new(&mut body, desc.rows, kernels.blocks, &stream)?,
            step: Pinned::new(&stream)?,
            report: Told::new(&stream)?,
            contact: ContactSurface::new(model, copies, &stream)?,
            outside: Outside::new(model, Some(body.flags.len()), &stream)?,
            near: NearTools::new(body.bricks.count(), &stream)?,
            surfaces: Surfaces::new(model, copies),
            look: (copies > 0).then(|| Look::new(lattice, &stream)).transpose()?,
            dt: 0.0,
            furthest: Vec3::from(lattice.cells().map(|n| n as f64)).norm() * lattice.cell_m(),
            speed: 0.0,
            last_dt: 1.0,
            origins: Vec::with_capacity(MAX_TOOLS),
            dropped: 0,
            dropped_before: 0,
            sequence: 0,
            mirror: RefCell::default(),
            lost: RefCell::new(None),
            model: model.clone(),
            desc: *desc,
            body,
            kernels,
            stream,
        };
        solver.rest()?;
        Ok(solver)
    }

    /// Back to rest.
    fn rest(&mut self) -> Result<()> {
        self.state.rest(&self.body)?;
        self.contact.clear()?;
        self.near.clear()?;
        self.dropped_before = self.dropped;
        self.speed = 0.0;
        self.forget_nodes();
        self.stream.wait()
    }

    /// A step's record without tools.
    fn record(&self, dt: f64, drag_per_s: f64, gravity: Vec3) -> EfgStep {
        EfgStep {
            dt,
            inertia: self.desc.scheme.inertia(dt, drag_per_s),
            gravity: gravity.into(),
            tolerance: self.desc.tolerance,
            furthest: self.furthest,
            wall: wall_n_m(&self.body.laws, self.model.lattice().cell_m()),
            to: 1.0,
            max_iterations: self.desc.max_iterations,
            elasticity: match self.desc.elasticity {
                Elasticity::Corotated => 0,
                Elasticity::Linear => 1,
                Elasticity::StVenantKirchhoff => 2,
            },
            is_paper: u32::from(self.desc.scheme == Scheme::Paper),
            ..EfgStep::default()
        }
    }

    /// Takes a step and waits for its report.
    fn take(&mut self, mut record: EfgStep, contact: Plan, outside: outside::Plan) -> Result<Report> {
        if self.dt != record.dt {
            let scheme = self.desc.scheme;
            self.state.set_moduli(&self.body.laws, |law| scheme.stiffness(record.dt, law.damping_s))?;
            self.dt = record.dt;
        }
        self.sequence = self.sequence.wrapping_add(1);
        record.step.sequence = self.sequence;
        // SAFETY: the last step has been reported, so the device reads the record no more.
        unsafe { self.step.host().write(record) };
        let asked = self.ask(contact, outside, record.only_forces == 0);
        asked.and_then(|()| self.report.wait(&self.stream, self.sequence)).inspect_err(|_| {
            // Nobody knows whether sites were listed.
            self.contact.lose_track();
        })
    }

    /// Asks the stream for the work of a step, in which nodes move or do not.
    fn ask(&self, contact: Plan, outside: outside::Plan, moves: bool) -> Result<()> {
        let _range = trace::range(c"launch");
        let (device, stream) = (&self.stream.device, self.stream.handle);
        let _entered = device.enter()?;
        let tools = contact.tools as usize;
        let mut pass = self.state.pass();
        self.near.note_in(&mut pass);
        // SAFETY: the record stays in place as long as the solver; kernels get what they declare, of this state, which outlives the work.
        unsafe {
            let status = (device.driver.memcpy_to_device)(
                self.state.step.at(),
                self.step.host().cast_const().cast(),
                EfgStep::bytes(tools),
                stream,
            );
            device.driver.check(status, "sending a step")?;
            self.contact.list(&self.kernels.surfaces, &self.stream, &mut pass, contact, 1)?;
            let mut efg = self.state.on_device(&pass, self.report.device_at());
            let mut contact = self.contact.on_device(contact);
            let outside::Plan { mut push, mut drive, mut hold, mut sticks, .. } = outside;
            let mut sides = if moves { self.state.sides() } else { layout::Sides::default() };
            let is_followed = sides != layout::Sides::default() || outside.sticks();
            efg.is_followed = is_followed.into();
            let arguments = &mut [
                pointer(&mut efg),
                pointer(&mut contact),
                pointer(&mut push),
                pointer(&mut drive),
                pointer(&mut hold),
                pointer(&mut sticks),
            ];
            let EfgKernels { step, blocks, threads, .. } = self.kernels;
            step.launch(device, stream, blocks, threads, arguments)?;
            if is_followed {
                let arguments = &mut [pointer(&mut efg), pointer(&mut sides), pointer(&mut sticks)];
                self.kernels.mobile.launch(device, stream, 1, MOBILE_THREADS, arguments)?;
            }
        }
        self.stream.traffic.add_to_device(EfgStep::bytes(tools));
        self.stream.traffic.add_to_host(Report::bytes(tools));
        Ok(())
    }

    /// One implicit step, number `substep` of the plan's.
    fn substep(&mut self, plan: &StepPlan, substep: u32, outside: outside::Plan) -> Result<Report> {
        let [from, to] = [substep, substep + 1].map(|n| f64::from(n) / f64::from(plan.substeps));
        let mut record = self.record(plan.dt, plan.drag_per_s, plan.gravity);
        let h = self.model.lattice().cell_m();
        let reach = found::reach(plan.tools, [from, to], self.speed * plan.dt, h);
        (record.from, record.to, record.reach) = (from as f32, to as f32, reach as f32);
        record.substep = substep;
        record.step = Step { duration: (plan.dt * f64::from(plan.substeps)) as f32, ..Step::default() };
        let way = self.speed * self.last_dt;
        let contact = self.contact.prepare_ahead(plan.tools, way, reach, &mut record.step)?;
        self.near.prepare(plan.tools.len())?;
        let report = self.take(record, contact, outside)?;
        self.stream.traffic.add_to_host(self.contact.hear(report.points, contact));
        self.speed = f64::from(report.speed2).sqrt();
        self.last_dt = plan.dt;
        if report.diverged_at != SOUND {
            // The state stays the last good one, at rest.
            self.state.v.clear()?;
            self.state.turn_back()?;
            self.speed = 0.0;
            self.contact.lose_track();
        }
        Ok(report)
    }

    /// What a call without an error of its own gives: nothing where it failed.
    fn or_lost<T: Default>(&self, result: Result<T>) -> T {
        result.unwrap_or_else(|error| {
            let why = if let Error::Device(why) = error { why } else { error.to_string() };
            self.lost.borrow_mut().get_or_insert(why);
            T::default()
        })
    }

    /// Takes what cuts have changed of surfaces, whose nodes are, or are copies of, those that `origin` says.
    fn show(&mut self, surfaces: &[(&Surface, &Redrawn)], origin: impl Fn(u32) -> u32) -> Result<()> {
        let model = self.model.clone();
        self.surfaces.follow(surfaces)?;
        let rest = |slot| model.lattice().rest_position(origin(slot));
        let (surface, redrawn) = surfaces[model.contact_surface()];
        self.contact.follow(surface, redrawn, rest)
    }

    /// Displacements, or velocities, as they are now.
    fn read<T>(&self, at: Field, see: impl FnOnce(&[R]) -> T) -> T {
        let field = [&self.state.u, &self.state.v][at as usize];
        let Mirror { fields, are_known } = &mut *self.mirror.borrow_mut();
        let all = &mut fields[at as usize];
        if !std::mem::replace(&mut are_known[at as usize], true) {
            all.resize(3 * self.body.flags.len(), R::splat(0.0));
            self.or_lost(field.read(0, all));
        }
        see(all)
    }

    /// The nodes have changed.
    fn forget_nodes(&self) {
        self.mirror.borrow_mut().are_known = [false; 2];
    }

    /// Impulses of inner forces in a second from where nodes are, at rest there.
    fn inner_forces(&mut self) -> Result<Vec<R>> {
        let mut v = vec![R::splat(0.0); 3 * self.body.flags.len()];
        self.state.v.read(0, &mut v)?;
        self.state.v.clear()?;
        let inertia =
            EfgStep { inertia: 1.0, is_paper: 0, only_forces: 1, ..self.record(1.0, 0.0, Vec3::zeros()) };
        self.take(inertia, Plan::default(), outside::Plan::default())?;
        self.state.v.write(0, &v)?;
        self.state.impulses(&mut v)?;
        Ok(v)
    }
}

/// Displacements and velocities as the host sees them, each once it was asked for. Memory is kept.
#[derive(Debug)]
struct Mirror<R> {
    fields: [Vec<R>; 2],
    are_known: [bool; 2],
}

impl<R> Default for Mirror<R> {
    fn default() -> Self {
        Self { fields: [Vec::new(), Vec::new()], are_known: [false; 2] }
    }
}

/// What the host sees of nodes.
#[derive(Clone, Copy)]
enum Field {
    Displacement,
    Velocity,
}

/// A slot's vector in a field.
fn vector<R: Number>(field: &[R], slot: u32) -> Vec3 {
    Vec3::from_fn(|axis, _| field[number(slot as usize, axis)].to_f64())
}

impl<R: Number> Solver for CudaEfgSolver<R> {
    fn stable_dt(&self) -> f64 {
        f64::INFINITY
    }

    fn advance(&mut self, plan: &StepPlan, sums: &mut [ToolSum]) -> Result<StepReport> {
        self.forget_nodes();
        let outside =
            self.outside.prepare(plan, &self.body, |slot| self.state.mass(slot), self.contact.sums())?.plan;
        // Settling looks for rest alone: steps so long that inertia is nothing, from no velocity each.
        let settling = StepPlan { dt: SETTLING_S, ..*plan };
        let plan = if plan.kinetic_damping { &settling } else { plan };
        let mut all = StepReport {
            awake_nodes: self.model.lattice().node_count() as u64,
            awake_bricks: self.model.lattice().bricks().len() as u64,
            ..StepReport::default()
        };
        for substep in 0..plan.substeps {
            if plan.kinetic_damping {
                self.halt();
            }
            let report = self.substep(plan, substep, outside)?;
            for (sum, told) in sums.iter_mut().zip(&report.sums).take(plan.tools.len()) {
                sum.impulse.force_n += Vec3::from(told.impulse);
                sum.impulse.torque_n_m += Vec3::from(told.moment);
                sum.work_j += told.work;
            }
            self.dropped = self.dropped_before + u64::from(report.dropped_points);
            all.iterations = report.iterations;
            all.residual = report.residual.into();
            all.strain = report.strain.into();
            all.volume_ratio = [1.0 - f64::from(report.shrinking), 1.0 + f64::from(report.swelling)];
            all.contact_points = report.contact_points;
            all.dropped_points = self.dropped;
            all.device_s += report.device_ns as f64 * 1e-9;
            all.has_diverged = report.diverged_at != SOUND;
            if all.has_diverged {
                break;
            }
            all.substeps += 1;
        }
        self.origins.clear();
        self.origins.extend(plan.tools.iter().map(|tool| tool.path.to.translation.vector));
        Ok(all)
    }

    fn check(&self) -> Result<()> {
        self.lost.borrow().as_ref().map_or(Ok(()), |why| Err(Error::Device(why.clone())))
    }

    fn contacts(&self, tool: usize, show: &mut dyn FnMut(Contact)) {
        let Some(&origin) = self.origins.get(tool) else { return };
        self.or_lost(self.contact.show(tool as u32, origin, self.last_dt, show));
    }

    fn publish(
        &mut self,
        index: usize,
        surface: &Surface,
        field: SurfaceField,
        arrays: &mut SurfaceArrays,
    ) -> Result<()> {
        let pass = self.state.pass();
        self.surfaces.publish(index, surface, &self.kernels.surfaces, &self.stream, &pass, field, arrays)
    }

    fn mass(&self, slot: u32) -> f64 {
        self.state.mass(slot)
    }

    fn displacement(&self, slot: u32) -> Vec3 {
        self.read(Field::Displacement, |u| vector(u, slot))
    }

    fn velocity(&self, slot: u32) -> Vec3 {
        self.read(Field::Velocity, |v| vector(v, slot))
    }

    fn displacements(&self, all: &mut Vec<Vec3>) {
        all.clear();
        let slots = 0..self.body.flags.len() as u32;
        self.read(Field::Displacement, |u| all.extend(slots.map(|slot| vector(u, slot))));
    }

    fn look(&mut self, displaced: &mut Vec<Bounds>) {
        let u = self.state.u.at();
        let looked = self.look.as_mut().map_or(Ok(()), |look| look.look(u, Places::VECTORS, displaced));
        self.or_lost(looked);
    }

    fn seen(&mut self, bricks: &[u32], nodes: &mut Vec<SeenBrick>) {
        let shown = self.look.as_mut().map_or(Ok(()), |look| look.show(bricks, nodes));
        self.or_lost(shown);
    }

    fn velocities(&self, all: &mut Vec<Vec3>) {
        all.clear();
        let slots = 0..self.body.flags.len() as u32;
        self.read(Field::Velocity, |v| all.extend(slots.map(|slot| vector(v, slot))));
    }

    fn largest_change(&self, before: &[Vec3]) -> f64 {
        (0..).zip(before).map(|(slot, old)| (self.velocity(slot) - old).norm()).fold(0.0, f64::max)
    }

    fn halt(&mut self) {
        self.or_lost(self.state.v.clear());
        self.speed = 0.0;
        self.contact.lose_track();
        self.forget_nodes();
    }

    fn set_node(&mut self, slot: u32, displacement: Vec3, velocity: Vec3) {
        let word = self.body.bricks.word(slot);
        self.or_lost(self.state.set_node(slot, word, displacement, velocity));
        self.speed = self.speed.max(velocity.norm());
        self.contact.lose_track();
        self.forget_nodes();
    }

    fn accelerations(&mut self) -> Vec<Vec3> {
        let forces = self.inner_forces();
        let forces = self.or_lost(forces);
        let mut all = vec![Vec3::zeros(); self.body.flags.len()];
        let slots = (0..all.len() as u32).filter(|&slot| !forces.is_empty() && self.state.mass(slot) > 0.0);
        for slot in slots {
            let (flags, force) = (self.body.flags[slot as usize], vector(&forces, slot));
            let free = |axis: usize| {
                let is_free = flags & (flag::FIX_X << axis | flag::GRASPED) == 0;
                if is_free { force[axis] / self.state.mass(slot) } else { 0.0 }
            };
            all[slot as usize] = Vec3::from_fn(|axis, _| free(axis));
        }
        all
    }

    fn wake(&mut self) {
        self.outside.forget_loads();
    }

    fn set_laws(&mut self, laws: &[CellLaw; 16], _stable_dt: f64) -> Result<()> {
        self.body.laws = *laws;
        self.dt = 0.0;
        self.outside.forget_loads();
        self.contact.lose_track();
        self.state.set_laws(&self.body)
    }

    fn set_flags(&mut self, changed: &[(u32, u8)], _stable_dt: f64) -> Result<()> {
        if changed.is_empty() {
            return Ok(());
        }
        // What is held already is at rest.
        let mut stopped = Vec::new();
        for &(slot, flags) in changed {
            let before = std::mem::replace(&mut self.body.flags[slot as usize], flags);
            let axes = (0..3).filter(|axis| flags & !before & (flag::FIX_X << axis) != 0);
            stopped.extend(axes.map(|axis| number(slot as usize, axis)));
        }
        if !stopped.is_empty() {
            let mut v = vec![R::splat(0.0); 3 * self.body.flags.len()];
            self.state.v.read(0, &mut v)?;
            stopped.into_iter().for_each(|at| v[at] = R::splat(0.0));
            self.state.v.write(0, &v)?;
        }
        self.outside.forget_loads();
        self.contact.lose_track();
        self.forget_nodes();
        self.state.set_flags(&self.body.flags)
    }

    fn cut(&mut self, topology: &Topology, change: &Change, surfaces: &[(&Surface, &Redrawn)]) -> Result<()> {
        self.state.cut(self.kernels.cut, topology, change, &mut self.body)?;
        // Copies are held as what they start from, until their own flags follow.
        for birth in &change.births {
            self.body.flags[birth.slot as usize] = self.body.flags[birth.from as usize];
        }
        self.outside.forget_masses();
        self.forget_nodes();
        self.show(surfaces, |slot| topology.origin(slot))
    }

    fn heal(&mut self) -> Result<()> {
        self.outside.forget_masses();
        self.state.heal(&mut self.body)?;
        let model = self.model.clone();
        let all = Redrawn::all();
        let own: Vec<_> = model.surfaces().iter().map(|surface| (surface.as_ref(), &all)).collect();
        self.show(&own, |slot| slot)
    }

    fn reset(&mut self) {
        let rested = self.rest();
        self.or_lost(rested);
    }

    fn save(&mut self) -> Result<Saved> {
        Ok(Box::new(self.state()?))
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        self.set_state(saved.downcast_ref().ok_or_else(saved_elsewhere)?)
    }

    fn node_bytes(&self) -> u64 {
        self.state.bytes()
    }

    fn copied(&self) -> Copied {
        self.stream.traffic.total()
    }
}

impl<R: Number> Drop for CudaEfgSolver<R> {
    fn drop(&mut self) {
        // The last step's work may still be ending.
        let _ = self.stream.wait();
    }
}
