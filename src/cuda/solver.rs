//! The GPU's backend: one simulation's state on a device, and how a step is asked of it.
//!
//! A step is one graph: the step's record goes to the device, all substeps follow each other, and the last kernel writes what happened into memory
//! that the host watches. Nothing else goes to and fro.

mod saved;

use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::Arc;

use super::body::Body;
use super::contact::{ContactSurface, Plan};
use super::device::Device;
use super::graph::Graph;
use super::kernels::{Kernel, Kernels};
use super::layout::{self, Law, MOBILE_THREADS, Pass, Places, REPORT_THREADS, Report, SOUND, Step, share};
use super::look::Look;
use super::memory::{Buffer, Pinned, Stream};
use super::near::NearTools;
use super::outside::{self, Outside};
use super::pointer;
use super::sleep::{self, Sleep};
use super::state::State;
use super::surface::Surfaces;
use super::told::Told;
use crate::cpu::stability;
use crate::cut::surface::drawn::Redrawn;
use crate::cut::topology::{Change, Topology};
use crate::error::{Error, Result};
use crate::math::{Bounds, Vec3};
use crate::model::Model;
use crate::model::lattice::{BRICK_SLOTS, flag};
use crate::model::law::{CellLaw, most_damping};
use crate::model::surface::Surface;
use crate::sim::MAX_TOOLS;
use crate::solver::statistics::Copied;
use crate::solver::tool::Contact;
use crate::solver::{
    Saved, SeenBrick, Solver, StepPlan, StepReport, SurfaceArrays, SurfaceField, ToolSum, saved_elsewhere,
};
use crate::trace;

/// Displacement, in cells, at which forces are taken for linear: small against a cell, large against single precision's rounding.
const PROBE: f64 = 1e-3;
/// Most recorded steps that are kept.
const MAX_GRAPHS: usize = 32;
/// From so many blocks on bricks near tools advance before the others, so that contact is at work while these advance: with fewer, one more kernel
/// takes longer than it saves. See docs/gpu.md.
const APART_BLOCKS: u32 = 600;
/// Threads of a block that evaluates pieces, eight for each.
const PIECE_THREADS: u32 = 128;
/// Blocks for the bricks near tools.
const NEAR_BLOCKS: u32 = 128;

/// A simulation's state on a GPU.
#[derive(Debug)]
pub struct CudaSolver {
    model: Arc<Model>,
    stream: Arc<Stream>,
    kernels: Kernels,
    body: Body,
    state: State,
    step: Pinned<Step>,
    report: Told,
    contact: ContactSurface,
    outside: Outside,
    near: NearTools,
    sleep: Sleep,
    surfaces: Surfaces,
    /// Where there is room for cuts.
    look: Option<Look<f32>>,
    /// Recorded steps by how many substeps they have, the copy of `u` that they start from, and what they do.
    graphs: HashMap<(u32, usize, Plans), Graph>,
    /// Speed of the fastest node at the end of the last step, m/s.
    speed: f64,
    /// Sum of m v² then, in J; 0 where velocities have just been cleared.
    vis_viva: f32,
    /// Where tools were at the end of the last step, model frame, and how long its substeps were.
    origins: Vec<Vec3>,
    last_dt: f64,
    dropped: u64,
    /// Of those, the ones before the last reset.
    dropped_before: u64,
    sequence: u32,
    stable_dt: f64,
    /// The host's copy of the nodes, where it is up to date.
    mirror: RefCell<Mirror>,
    /// The first failure of a call that has no way to tell it: the state is lost.
    lost: RefCell<Option<String>>,
}

/// What a step does besides moving the lattice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct Plans {
    contact: Plan,
    outside: outside::Plan,
    sleep: sleep::Plan,
    cut: CutPlan,
}

/// How cuts take part in a step: so many bricks hold nodes, so many blocks evaluate pieces, and sides are kept apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct CutPlan {
    bricks: u32,
    piece_blocks: u32,
    sides: layout::Sides,
}

/// Nodes as the host sees them, each field once it was asked for. Memory is kept.
#[derive(Debug, Default)]
struct Mirror {
    u: Vec<[f32; 4]>,
    v: Vec<f32>,
    are_known: [bool; 2],
}

impl CudaSolver {
    /// The model at rest on a device, with room for so many copies of nodes.
    pub fn new(model: &Arc<Model>, device: Arc<Device>, copies: usize) -> Result<Self> {
        let stream = Arc::new(Stream::new(device)?);
        let laws = model.laws();
        let body = Body::of(model, copies);
        let (volumetric, damped) = body.asks_for();
        let kernels = Kernels::load(&stream.device, volumetric, damped)?;
        let mut solver = Self {
            state: State::new(&body, &stream)?,
            step: Pinned::new(&stream)?,
            report: Told::new(&stream)?,
            contact: ContactSurface::new(model, copies, &stream)?,
            outside: Outside::new(model, None, &stream)?,
            near: NearTools::new(body.bricks.count(), &stream)?,
            sleep: Sleep::new(&body, &stream)?,
            surfaces: Surfaces::new(model, copies),
            look: (copies > 0).then(|| Look::new(model.lattice(), &stream)).transpose()?,
            graphs: HashMap::new(),
            speed: 0.0,
            vis_viva: 0.0,
            origins: Vec::with_capacity(MAX_TOOLS),
            last_dt: 1.0,
            dropped: 0,
            dropped_before: 0,
            sequence: 0,
            stable_dt: 0.0,
            mirror: RefCell::default(),
            lost: RefCell::new(None),
            model: model.clone(),
            body,
            kernels,
            stream,
        };
        let omega = solver.highest_frequency()?;
        solver.stable_dt = stability::stable_dt(omega, most_damping(laws));
        solver.sleep.set_thresholds(model.lattice().cell_m(), omega);
        solver.rest()?;
        Ok(solver)
    }

    /// Back to rest.
    fn rest(&mut self) -> Result<()> {
        self.state.rest(&self.body)?;
        self.state.diverged_at.fill(SOUND)?;
        self.contact.clear()?;
        self.near.clear()?;
        self.sleep.reset()?;
        self.dropped_before = self.dropped;
        self.speed = 0.0;
        self.vis_viva = 0.0;
        self.forget_nodes();
        self.stream.wait()
    }

    /// Asks for one step of `substeps` substeps.
    fn ask(&mut self, step: Step, substeps: u32, plans: Plans) -> Result<()> {
        let start = self.state.current;
        // SAFETY: the last step has been reported, so the device reads the record no more.
        unsafe { self.step.host().write(step) };
        let key = (substeps, start, plans);
        if self.graphs.len() == MAX_GRAPHS && !self.graphs.contains_key(&key) {
            self.graphs.clear();
        }
        if !self.graphs.contains_key(&key) {
            let graph = Graph::record(&self.stream, || self.work(substeps, start, plans))?;
            self.graphs.insert(key, graph);
        }
        let _range = trace::range(c"launch");
        self.graphs[&key].launch()?;
        let tools = plans.contact.tools as usize;
        self.stream.traffic.add_to_device(Step::bytes(tools));
        self.stream.traffic.add_to_host(Report::bytes(tools));
        Ok(())
    }

    /// As [`State::pass`], with the bricks that may not sleep.
    fn pass(&self, start: usize, substep: u32, mark: bool) -> Pass {
        let mut pass = self.state.pass(start, substep, mark);
        self.near.note_in(&mut pass);
        pass.acted_on = self.sleep.acted_on();
        pass
    }

    /// The work of one step, in order.
    fn work(&self, substeps: u32, start: usize, plans: Plans) -> Result<()> {
        let Plans { contact, outside, sleep, cut } = plans;
        let (device, stream) = (&self.stream.device, self.stream.handle);
        // SAFETY: the record stays in place as long as the solver; kernels get what they declare, of this state, which outlives the graph.
        unsafe {
            let status = (device.driver.memcpy_to_device)(
                self.state.step.at(),
                self.step.host().cast_const().cast(),
                Step::bytes(contact.tools as usize),
                stream,
            );
            device.driver.check(status, "recording a step")?;
            let mut are_lists_new = true;
            for substep in 1..=substeps {
                let look = sleep.look(substep, substeps);
                let mark = outside.settles || substep == substeps || look.is_some();
                let mut pass = self.pass(start, substep, mark);
                let lists =
                    self.contact.list(&self.kernels.surfaces, &self.stream, &mut pass, contact, substeps)?;
                let sleepers = self.sleep.on_device();
                let (kernel, blocks) = match sleep {
                    sleep::Plan::Listed { blocks, .. } => {
                        if lists {
                            self.sleep.decide(&self.kernels, &self.stream, &mut pass, 0)?;
                        }
                        (self.kernels.substep_awake, blocks)
                    }
                    _ => (self.kernels.substep, cut.bricks),
                };
                // Kernels that overlap read lists before they wait.
                are_lists_new |= lists;
                let first = |kernel: Kernel| if are_lists_new { kernel.alone() } else { kernel };
                if cut.piece_blocks > 0 {
                    let pieces = first(self.kernels.pieces);
                    pieces.launch(
                        device,
                        stream,
                        cut.piece_blocks,
                        PIECE_THREADS,
                        &mut [pointer(&mut pass)],
                    )?;
                    // Only the first kernel of a step notes when it began.
                    pass.started = 0;
                }
                let apart = contact.tools > 0
                    && outside.is_idle()
                    && cut.sides == layout::Sides::default()
                    && self.kernels.contact.overlaps()
                    && blocks >= APART_BLOCKS;
                let begins_sums = !outside.holds() && !outside.sticks();
                let resolve = |pass: &mut Pass| {
                    self.contact.resolve(&self.kernels, &self.stream, pass, contact, substeps, begins_sums)
                };
                let advance = |kernel: Kernel, blocks, pass: &mut Pass, mut listed: layout::Sleep| {
                    let arguments = &mut [pointer(pass), pointer(&mut listed)];
                    kernel.launch(device, stream, blocks, BRICK_SLOTS as u32, arguments)
                };
                if apart {
                    pass.share = share::FIRST;
                    advance(
                        first(self.kernels.substep_awake),
                        NEAR_BLOCKS,
                        &mut pass,
                        self.near.as_awake(sleepers),
                    )?;
                    resolve(&mut pass)?;
                    let mut rest = Pass { share: share::REST, started: 0, ..pass };
                    advance(kernel, blocks, &mut rest, sleepers)?;
                } else {
                    advance(first(kernel), blocks, &mut pass, sleepers)?;
                    outside.act(&self.kernels, &self.stream, &mut pass)?;
                    if cut.sides != layout::Sides::default() || outside.sticks() {
                        let (mut sides, mut sticks) = (cut.sides, outside.sticks);
                        let arguments = &mut [pointer(&mut pass), pointer(&mut sides), pointer(&mut sticks)];
                        self.kernels.mobile.launch(device, stream, 1, MOBILE_THREADS, arguments)?;
                    }
                    if contact.tools > 0 {
                        resolve(&mut pass)?;
                    }
                }
                are_lists_new = look.is_some();
                if let Some(since) = look {
                    self.sleep.decide(&self.kernels, &self.stream, &mut pass, since)?;
                }
                outside.settle(&self.kernels, &self.stream, &mut pass, cut.bricks, self.state.step.at())?;
            }
            let (mut marks, mut quads) = (self.state.marks.at(), self.state.marks.bytes() as u32 / 16);
            let (mut step, mut flag) = (self.state.step.at(), self.state.diverged_at.at());
            let mut started = self.state.started.at();
            let [mut counts, mut points, mut touched] = self.contact.told(contact);
            let mut sums = self.contact.sums();
            let mut awake = self.sleep.on_device().counts;
            let mut report = self.report.device_at();
            let arguments = &mut [
                pointer(&mut marks),
                pointer(&mut quads),
                pointer(&mut step),
                pointer(&mut flag),
                pointer(&mut started),
                pointer(&mut counts),
                pointer(&mut points),
                pointer(&mut sums),
                pointer(&mut awake),
                pointer(&mut touched),
                pointer(&mut report),
            ];
            self.kernels.report.launch(device, stream, 1, REPORT_THREADS, arguments)
        }
    }

    fn next_sequence(&mut self) -> u32 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    /// Accelerations by inner forces at displacements `u`, all slots, and the state is lost.
    fn forces_of(&mut self, u: &[[f32; 4]]) -> Result<Vec<f32>> {
        self.sleep.wake_all()?;
        self.state.current = 0;
        self.state.u[0].write(0, u)?;
        self.state.v.iter().try_for_each(Buffer::clear)?;
        // From rest, one second at constant acceleration leaves a velocity of that size.
        let sequence = self.next_sequence();
        let plans = Plans { cut: self.cut_plan(), ..Plans::default() };
        self.ask(Step { dt: 1.0, sequence, ..Step::default() }, 1, plans)?;
        self.report.wait(&self.stream, sequence)?;
        let mut a = vec![0.0; 3 * self.body.slot_count()];
        self.state.v[1 % self.state.v.len()].read(0, &mut a)?;
        Ok(a)
    }

    /// Highest angular frequency of the model at rest.
    fn highest_frequency(&mut self) -> Result<f64> {
        let model = self.model.clone();
        let (lattice, laws) = (model.lattice(), model.laws());
        let slots = lattice.slot_count();
        let mut mass = vec![0.0; 3 * slots];
        for slot in lattice.slots() {
            let m = lattice.node_mass(slot, |material| laws[usize::from(material)].corner_kg);
            for axis in 0..3 {
                if lattice.flags()[slot as usize] & (flag::FIX_X << axis) == 0 {
                    mass[3 * slot as usize + axis] = m;
                }
            }
        }
        let mut failed = Ok(());
        let omega = stability::highest_frequency(&mass, |u| {
            if failed.is_err() {
                return;
            }
            let most = u.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let scale = PROBE * lattice.cell_m() / most.max(1e-300);
            let word = |slot: usize| f32::from_bits(lattice.words()[slot]);
            let displaced = (0..slots).map(|slot| {
                let [x, y, z] = [0, 1, 2].map(|axis| (u[3 * slot + axis] * scale) as f32);
                [x, y, z, word(slot)]
            });
            match self.forces_of(&displaced.collect::<Vec<_>>()) {
                Ok(a) => {
                    for slot in 0..slots {
                        for axis in 0..3 {
                            u[3 * slot + axis] = -f64::from(a[number(slot, axis)]) / scale;
                        }
                    }
                }
                Err(error) => failed = Err(error),
            }
        });
        failed.map(|()| omega)
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
        // Recorded steps name the surface, and are done.
        self.graphs.clear();
        let model = self.model.clone();
        self.surfaces.follow(surfaces)?;
        let rest = |slot| model.lattice().rest_position(origin(slot));
        let (surface, redrawn) = surfaces[model.contact_surface()];
        self.contact.follow(surface, redrawn, rest)
    }

    /// Materials or what is held have changed: what was made of them before is made anew.
    fn change(&mut self, stable_dt: f64) -> Result<()> {
        self.stable_dt = stable_dt;
        self.outside.forget_masses();
        self.contact.lose_track();
        self.forget_nodes();
        self.sleep.wake_all()
    }

    /// Displacements and words as they are now.
    fn look_at_displacements<T>(&self, see: impl FnOnce(&[[f32; 4]]) -> T) -> T {
        let Mirror { u, are_known: [is_known, _], .. } = &mut *self.mirror.borrow_mut();
        if !std::mem::replace(is_known, true) {
            u.resize(self.body.slot_count(), [0.0; 4]);
            self.or_lost(self.state.u[self.state.current].read(0, u));
        }
        see(u)
    }

    /// Velocities as they are now.
    fn look_at_velocities<T>(&self, see: impl FnOnce(&[f32]) -> T) -> T {
        let Mirror { v, are_known: [_, is_known], .. } = &mut *self.mirror.borrow_mut();
        if !std::mem::replace(is_known, true) {
            v.resize(3 * self.body.slot_count(), 0.0);
            self.or_lost(self.state.velocities().read(0, v));
        }
        see(v)
    }

    /// The nodes have changed.
    fn forget_nodes(&self) {
        self.mirror.borrow_mut().are_known = [false; 2];
    }

    /// How cuts take part in the coming step. Blocks are a power of two, so that few cuts ask for another recording.
    fn cut_plan(&self) -> CutPlan {
        let blocks = (8 * self.state.pieces.count() as u32).div_ceil(PIECE_THREADS);
        let piece_blocks = if blocks > 0 { blocks.next_power_of_two() } else { 0 };
        CutPlan { bricks: self.state.bricks, piece_blocks, sides: self.state.sides.on_device() }
    }
}

/// Place of a component of a slot's velocity.
fn number(slot: usize, axis: usize) -> usize {
    slot / BRICK_SLOTS * 3 * BRICK_SLOTS + axis * BRICK_SLOTS + slot % BRICK_SLOTS
}

impl Solver for CudaSolver {
    fn stable_dt(&self) -> f64 {
        self.stable_dt
    }

    fn advance(&mut self, plan: &StepPlan, sums: &mut [ToolSum]) -> Result<StepReport> {
        self.forget_nodes();
        let sequence = self.next_sequence();
        let duration = plan.dt * f64::from(plan.substeps);
        let outside =
            self.outside.prepare(plan, &self.body, |slot| self.body.node_mass(slot), self.contact.sums())?;
        let fall = 0.5 * (plan.gravity.norm() + outside.acceleration) * duration * duration;
        let way = self.speed * duration + fall + outside.way;
        let is_at_rest = self.vis_viva == 0.0;
        let mut step = Step {
            dt: plan.dt as f32,
            keep: if plan.kinetic_damping && is_at_rest {
                0.5
            } else {
                (1.0 / (1.0 + plan.drag_per_s * plan.dt)) as f32
            },
            gravity: [plan.gravity.x, plan.gravity.y, plan.gravity.z].map(|g| g as f32),
            sequence,
            duration: duration as f32,
            vis_viva: self.vis_viva,
            ..Step::default()
        };
        let contact = self.contact.prepare(plan, way, &mut step)?;
        let may_sleep = plan.sleeping && plan.regions.is_empty();
        self.near.prepare(plan.tools.len())?;
        let sleep = self.sleep.prepare(may_sleep, contact.lists > 0)?;
        let start = self.state.current;
        let plans = Plans { contact, outside: outside.plan, sleep, cut: self.cut_plan() };
        let asked = self.ask(step, plan.substeps, plans);
        let report = asked.and_then(|()| self.report.wait(&self.stream, sequence)).inspect_err(|_| {
            // Nobody knows whether sites were listed.
            self.contact.lose_track();
        })?;

        // Loads push after speeds were seen.
        self.stream.traffic.add_to_host(self.contact.hear(report.points, contact));
        self.speed = f64::from(report.speed2).sqrt() + outside.acceleration * plan.dt;
        self.vis_viva = report.vis_viva as f32;
        self.origins.clear();
        self.origins.extend(plan.tools.iter().map(|tool| tool.path.to.translation.vector));
        self.last_dt = plan.dt;
        for (sum, told) in sums.iter_mut().zip(&report.sums).take(plan.tools.len()) {
            sum.impulse.force_n += Vec3::from(told.impulse);
            sum.impulse.torque_n_m += Vec3::from(told.moment);
            sum.work_j += told.work;
        }
        let has_diverged = report.diverged_at != SOUND;
        let taken = if has_diverged { report.diverged_at - 1 } else { plan.substeps };
        self.state.current = (start + taken as usize) % 2;
        if has_diverged {
            self.contact.lose_track();
            self.state.v.iter().try_for_each(Buffer::clear)?;
        }
        let [awake_bricks, awake_nodes] = self.sleep.tell(sleep, report.awake);
        if has_diverged {
            self.sleep.wake_all()?;
        }
        self.dropped = self.dropped_before + u64::from(report.dropped_points);
        Ok(StepReport {
            iterations: 0,
            residual: 0.0,
            substeps: taken,
            has_diverged,
            awake_nodes,
            awake_bricks,
            device_s: report.device_ns as f64 * 1e-9,
            strain: f64::from(report.strain),
            volume_ratio: [1.0 - f64::from(report.shrinking), 1.0 + f64::from(report.swelling)],
            contact_points: report.contact_points,
            dropped_points: self.dropped,
        })
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
        let pass = self.pass(self.state.current, 1, false);
        self.surfaces.publish(index, surface, &self.kernels.surfaces, &self.stream, &pass, field, arrays)
    }

    fn mass(&self, slot: u32) -> f64 {
        self.body.node_mass(slot)
    }

    fn displacement(&self, slot: u32) -> Vec3 {
        self.look_at_displacements(|u| Vec3::from_fn(|axis, _| f64::from(u[slot as usize][axis])))
    }

    fn velocity(&self, slot: u32) -> Vec3 {
        self.look_at_velocities(|v| Vec3::from_fn(|axis, _| f64::from(v[number(slot as usize, axis)])))
    }

    fn displacements(&self, all: &mut Vec<Vec3>) {
        all.clear();
        self.look_at_displacements(|u| {
            all.extend(u.iter().map(|u| Vec3::from([0, 1, 2].map(|a| f64::from(u[a])))));
        });
    }

    fn look(&mut self, displaced: &mut Vec<Bounds>) {
        let u = self.state.u[self.state.current].at();
        let looked = self.look.as_mut().map_or(Ok(()), |look| look.look(u, Places::QUADS, displaced));
        self.or_lost(looked);
    }

    fn seen(&mut self, bricks: &[u32], nodes: &mut Vec<SeenBrick>) {
        let shown = self.look.as_mut().map_or(Ok(()), |look| look.show(bricks, nodes));
        self.or_lost(shown);
    }

    fn velocities(&self, all: &mut Vec<Vec3>) {
        all.clear();
        let vector = |v: &[f32], slot| Vec3::from_fn(|axis, _| f64::from(v[number(slot, axis)]));
        self.look_at_velocities(|v| all.extend((0..self.body.slot_count()).map(|slot| vector(v, slot))));
    }

    fn largest_change(&self, before: &[Vec3]) -> f64 {
        (0..).zip(before).map(|(slot, old)| (self.velocity(slot) - old).norm()).fold(0.0, f64::max)
    }

    fn halt(&mut self) {
        let woken = self.sleep.wake_all();
        self.or_lost(woken);
        self.or_lost(self.state.v.iter().try_for_each(Buffer::clear));
        self.vis_viva = 0.0;
        self.forget_nodes();
    }

    fn set_node(&mut self, slot: u32, displacement: Vec3, velocity: Vec3) {
        let word = self.body.bricks.word(slot);
        let [x, y, z] = [0, 1, 2].map(|axis| displacement[axis] as f32);
        let u = [[x, y, z, f32::from_bits(word)]];
        self.or_lost(self.state.u.iter().try_for_each(|copy| copy.write(slot as usize, &u)));
        for axis in 0..3 {
            let at = number(slot as usize, axis);
            self.or_lost(self.state.v.iter().try_for_each(|copy| copy.write(at, &[velocity[axis] as f32])));
        }
        self.speed = self.speed.max(velocity.norm());
        let woken = self.sleep.wake_all();
        self.or_lost(woken);
        self.contact.lose_track();
        self.forget_nodes();
    }

    fn accelerations(&mut self) -> Vec<Vec3> {
        let u = self.look_at_displacements(<[_]>::to_vec);
        let v = self.look_at_velocities(<[_]>::to_vec);
        let slots = self.body.slot_count();
        let found = self.forces_of(&u).and_then(|a| {
            self.state.u.iter().try_for_each(|copy| copy.write(0, &u))?;
            self.state.v.iter().try_for_each(|copy| copy.write(0, &v))?;
            Ok(a)
        });
        let mut a = self.or_lost(found);
        a.resize(3 * slots, 0.0);
        (0..slots).map(|slot| Vec3::from_fn(|axis, _| f64::from(a[number(slot, axis)]))).collect()
    }

    fn wake(&mut self) {
        self.outside.forget_loads();
        let woken = self.sleep.wake_all();
        self.or_lost(woken);
    }

    fn set_laws(&mut self, laws: &[CellLaw; 16], stable_dt: f64) -> Result<()> {
        // Recorded steps name the kernels and what counts as quiet, and are done.
        self.graphs.clear();
        let asked = self.body.asks_for();
        let before = std::mem::replace(&mut self.body.laws, *laws);
        let (volumetric, damped) = self.body.asks_for();
        if (volumetric, damped) != asked {
            // What may fail for lack of room comes first.
            let loaded = self.state.keep_velocities(damped, &self.stream);
            let loaded = loaded.and_then(|()| Kernels::load(&self.stream.device, volumetric, damped));
            self.kernels = loaded.inspect_err(|_| self.body.laws = before)?;
        }
        self.state.laws.write(0, &laws.map(|law| Law::of(&law)))?;
        self.state.pieces.weigh(&self.body)?;
        self.state.sides.weigh(|slot| self.body.node_mass(slot))?;
        let omega = stability::highest_omega(stable_dt, most_damping(laws));
        self.sleep.set_thresholds(self.model.lattice().cell_m(), omega);
        self.change(stable_dt)
    }

    fn set_flags(&mut self, changed: &[(u32, u8)], stable_dt: f64) -> Result<()> {
        for &(slot, flags) in changed {
            self.body.flags[slot as usize] = flags;
        }
        if !changed.is_empty() {
            self.state.flags.set(self.body.flags.clone())?;
        }
        self.change(stable_dt)
    }

    fn cut(&mut self, topology: &Topology, change: &Change, surfaces: &[(&Surface, &Redrawn)]) -> Result<()> {
        self.state.cut(self.kernels.cut, topology, change, &mut self.body)?;
        // What was made of nodes before is made anew with the flags that follow.
        self.sleep.set_bricks(self.state.bricks)?;
        self.show(surfaces, |slot| topology.origin(slot))
    }

    fn heal(&mut self) -> Result<()> {
        self.state.heal(&mut self.body)?;
        self.outside.forget_masses();
        self.sleep.set_bricks(self.state.bricks)?;
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

impl Drop for CudaSolver {
    fn drop(&mut self) {
        // The last step's work may still be ending, and recorded steps name what is freed after this.
        let _ = self.stream.wait();
        self.graphs.clear();
    }
}
