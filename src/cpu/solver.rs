//! The processor's backend: one simulation's state, and how its threads take a step.
//!
//! In each substep all threads claim runs of bricks and advance them; then one thread alone applies loads, moves rigid regions, resolves
//! contact and decides who sleeps, while the others wait. Which thread advances a run changes nothing, so neither does their number.

mod saved;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

use super::contact::{ContactNodes, ContactSurface};
use super::facing::keep_apart;
use super::grasp::carry;
use super::hold::Hold;
use super::lattice::pieces::Pieces;
use super::lattice::{CpuReal, Kernel, LawTables, Mark, Pass, Scratch};
use super::looked::Looked;
use super::mobile::Mobile;
use super::nodes::{BRICK_OCTETS, Bricks, Field, Nodes, Run};
use super::sleep::{Sleep, Thresholds};
use super::stability;
use super::surface;
use super::workers::{Member, Workers};
use crate::cut::facing::Facings;
use crate::cut::surface::drawn::Redrawn;
use crate::cut::topology::{Change, Topology};
use crate::error::Result;
use crate::math::{Bounds, Vec3};
use crate::model::Model;
use crate::model::lattice::{BRICK_SLOTS, flag};
use crate::model::law::{CellLaw, most_damping};
use crate::model::surface::Surface;
use crate::solver::load::NodalLoads;
use crate::solver::tool::Contact;
use crate::solver::{
    RegionStep, Saved, SeenBrick, Solver, StepPlan, StepReport, SurfaceArrays, SurfaceField, ToolSum,
    saved_elsewhere,
};

/// Most runs claimed at a time.
const LONGEST_CLAIM: usize = 4;

/// A simulation's state on the processor.
#[derive(Debug)]
pub struct CpuSolver<R: CpuReal> {
    core: Core<R>,
    scratches: Vec<Box<Scratch<R>>>,
    workers: Workers,
}

#[derive(Debug)]
struct Core<R: CpuReal> {
    bricks: Bricks,
    flags: Vec<u8>,
    tables: LawTables<R>,
    pieces: Pieces<R>,
    /// The sides of cuts.
    facing: Facings,
    hold: Hold,
    corner_kg: [f64; 16],
    kernel: Kernel<R>,
    nodes: Nodes<R>,
    looked: Looked<R>,
    marks: Vec<Mark>,
    sleep: Sleep,
    contact: ContactSurface,
    stable_dt: f64,
    last_dt: f64,
    vis_viva: f64,
    /// Whether kinetic damping has just cleared the velocities.
    is_cleared: bool,
    buffers: Buffers<R>,
}

/// Where the coming substep reads and writes; set while one thread is alone.
#[derive(Debug)]
struct Buffers<R> {
    u: *const super::lanes::Octet<R>,
    v: *const super::lanes::Octet<R>,
    u_next: *mut super::lanes::Octet<R>,
    v_next: *mut super::lanes::Octet<R>,
    marks: *mut Mark,
}

// SAFETY: the pointers are to fields that the same `Core` owns.
unsafe impl<R: Send> Send for Buffers<R> {}
// SAFETY: see `Pass`: threads write disjoint bricks through them.
unsafe impl<R: Sync> Sync for Buffers<R> {}

/// A pointer that threads of one job share; who may use it when is said where it is used.
struct Shared<T: ?Sized>(*mut T);
// SAFETY: access is ordered by the meetings of the job.
unsafe impl<T: ?Sized> Sync for Shared<T> {}

impl<R: CpuReal> CpuSolver<R> {
    /// The model at rest, computed by `threads` threads, the caller of [`Solver::advance`] included, with room for so many copies of nodes.
    ///
    /// Fails when the operating system starts no more threads.
    pub fn new(model: &Arc<Model>, threads: usize, copies: usize) -> Result<Self> {
        let lattice = model.lattice();
        let tables = LawTables::<R>::new(model.laws(), lattice.cell_m());
        let bricks = Bricks::new(model.clone(), copies.div_ceil(BRICK_SLOTS));
        let count = bricks.count();
        let mut core = Core {
            flags: bricks.flags(),
            corner_kg: std::array::from_fn(|m| model.laws()[m].corner_kg),
            kernel: R::kernel(&tables),
            nodes: Nodes::at_rest(count, tables.damped),
            looked: Looked::default(),
            marks: vec![Mark::default(); count],
            sleep: Sleep::new(&bricks),
            contact: ContactSurface::new(model.clone()),
            stable_dt: 0.0,
            last_dt: 0.0,
            vis_viva: 0.0,
            is_cleared: true,
            buffers: Buffers {
                u: std::ptr::null(),
                v: std::ptr::null(),
                u_next: std::ptr::null_mut(),
                v_next: std::ptr::null_mut(),
                marks: std::ptr::null_mut(),
            },
            tables,
            pieces: Pieces::default(),
            facing: Facings::default(),
            hold: Hold::default(),
            bricks,
        };
        let omega = core.highest_frequency();
        core.stable_dt = stability::stable_dt(omega, most_damping(model.laws()));
        core.sleep.set_thresholds(Thresholds::new(lattice.cell_m(), omega, R::EPSILON));
        let workers = Workers::new(threads)?;
        let scratches = (0..workers.count()).map(|_| Scratch::new()).collect();
        Ok(Self { core, scratches, workers })
    }
}

impl<R: CpuReal> Solver for CpuSolver<R> {
    fn stable_dt(&self) -> f64 {
        self.core.stable_dt
    }

    fn advance(&mut self, plan: &StepPlan, sums: &mut [ToolSum]) -> Result<StepReport> {
        let started = Instant::now();
        self.core.begin(plan);
        let mut report = StepReport::default();
        let (core, scratches) = (Shared(&raw mut self.core), Shared(self.scratches.as_mut_ptr()));
        let (sums, report_at) = (Shared(&raw mut *sums), Shared(&raw mut report));
        let claims = [AtomicUsize::new(0), AtomicUsize::new(0)];
        let stop = AtomicBool::new(false);

        self.workers.run(&|member: &Member| {
            let (core, scratches, sums, report) = (&core, &scratches, &sums, &report_at);
            for substep in 0..plan.substeps {
                {
                    // SAFETY: until the meeting every thread only reads the core, but for the bricks that it claims; each has a
                    // scratch of its own.
                    let (core, scratch) = unsafe { (&*core.0, &mut *scratches.0.add(member.index)) };
                    core.evaluate_pieces(member);
                    core.advance_claimed(plan, &claims[substep as usize & 1], member.count, scratch);
                }
                member.meet();
                if member.index == 0 {
                    // SAFETY: the other threads wait at the next meeting and hold no reference.
                    let (core, sums, report) = unsafe { (&mut *core.0, &mut *sums.0, &mut *report.0) };
                    claims[substep as usize & 1].store(0, Ordering::Relaxed);
                    core.finish(plan, substep, sums, report);
                    stop.store(report.has_diverged, Ordering::Relaxed);
                }
                // The meeting orders the stores above before what other threads read next.
                member.meet();
                if stop.load(Ordering::Relaxed) {
                    break;
                }
            }
        });
        self.core.measure(&mut report);
        report.device_s = started.elapsed().as_secs_f64();
        Ok(report)
    }

    fn contacts(&self, tool: usize, show: &mut dyn FnMut(Contact)) {
        self.core.contact.contacts_of(tool as u32, self.core.last_dt).for_each(show);
    }

    fn publish(
        &mut self,
        _index: usize,
        surface: &Surface,
        field: SurfaceField,
        arrays: &mut SurfaceArrays,
    ) -> Result<()> {
        let core = &self.core;
        surface::publish(&core.bricks.model, surface, &core.nodes.u, field, arrays, &mut self.workers);
        Ok(())
    }

    fn mass(&self, slot: u32) -> f64 {
        let core = &self.core;
        core.bricks.node_mass(slot, |material| core.corner_kg[usize::from(material)])
    }

    fn displacement(&self, slot: u32) -> Vec3 {
        self.core.nodes.u.vec3(slot)
    }

    fn velocity(&self, slot: u32) -> Vec3 {
        self.core.nodes.v.vec3(slot)
    }

    fn displacements(&self, all: &mut Vec<Vec3>) {
        all.clear();
        all.extend((0..self.core.flags.len() as u32).map(|slot| self.core.nodes.u.vec3(slot)));
    }

    fn look(&mut self, displaced: &mut Vec<Bounds>) {
        self.core.looked.look(&self.core.nodes.u, self.core.bricks.model.lattice(), displaced);
    }

    fn seen(&mut self, bricks: &[u32], nodes: &mut Vec<SeenBrick>) {
        self.core.looked.seen(bricks, nodes);
    }

    fn velocities(&self, all: &mut Vec<Vec3>) {
        all.clear();
        all.extend((0..self.core.flags.len() as u32).map(|slot| self.core.nodes.v.vec3(slot)));
    }

    fn largest_change(&self, before: &[Vec3]) -> f64 {
        let v = &self.core.nodes.v;
        (0..).zip(before).map(|(slot, old)| (v.vec3(slot) - old).norm()).fold(0.0, f64::max)
    }

    fn halt(&mut self) {
        let nodes = &mut self.core.nodes;
        nodes.v.0.fill(Default::default());
        if let Some(v_next) = &mut nodes.v_next {
            v_next.0.fill(Default::default());
        }
        self.core.vis_viva = 0.0;
        self.core.is_cleared = true;
        self.core.sleep.wake_all(&self.core.bricks);
    }

    fn set_node(&mut self, slot: u32, displacement: Vec3, velocity: Vec3) {
        let nodes = &mut self.core.nodes;
        nodes.u.set(slot, displacement);
        nodes.u_next.set(slot, displacement);
        nodes.v.set(slot, velocity);
        if let Some(v_next) = &mut nodes.v_next {
            v_next.set(slot, velocity);
        }
        self.core.contact.lose_track();
        self.core.sleep.wake_all(&self.core.bricks);
    }

    fn accelerations(&mut self) -> Vec<Vec3> {
        self.core.accelerations()
    }

    fn wake(&mut self) {
        self.core.sleep.wake_all(&self.core.bricks);
    }

    fn set_laws(&mut self, laws: &[CellLaw; 16], stable_dt: f64) -> Result<()> {
        let core = &mut self.core;
        core.tables = LawTables::new(laws, core.bricks.model.lattice().cell_m());
        core.corner_kg = std::array::from_fn(|material| laws[material].corner_kg);
        core.pieces.weigh(&core.corner_kg);
        core.kernel = R::kernel(&core.tables);
        core.nodes.keep_velocities(core.tables.damped);
        core.stable_dt = stable_dt;
        let omega = stability::highest_omega(stable_dt, most_damping(laws));
        let cell_m = core.bricks.model.lattice().cell_m();
        core.sleep.set_thresholds(Thresholds::new(cell_m, omega, R::EPSILON));
        self.wake();
        Ok(())
    }

    fn set_flags(&mut self, changed: &[(u32, u8)], stable_dt: f64) -> Result<()> {
        let core = &mut self.core;
        for &(slot, flags) in changed {
            core.flags[slot as usize] = flags;
            let v = core.nodes.v.vec3(slot);
            let kept =
                Vec3::from_fn(|axis, _| if flags & (flag::FIX_X << axis) == 0 { v[axis] } else { 0.0 });
            core.nodes.v.set(slot, kept);
        }
        core.stable_dt = stable_dt;
        self.wake();
        Ok(())
    }

    fn cut(&mut self, topology: &Topology, change: &Change, surfaces: &[(&Surface, &Redrawn)]) -> Result<()> {
        let core = &mut self.core;
        core.bricks.divide(topology, change);
        for birth in &change.births {
            let Nodes { u, u_next, v, v_next } = &mut core.nodes;
            for field in [u, u_next, v].into_iter().chain(v_next.as_mut()) {
                field.set(birth.slot, field.vec3(birth.from));
            }
        }
        core.pieces = Pieces::new(topology, core.bricks.count(), &core.corner_kg);
        core.facing.follow(topology, change);
        let (surface, redrawn) = surfaces[core.bricks.model.contact_surface()];
        core.contact.follow(surface, redrawn);
        Ok(())
    }

    fn heal(&mut self) -> Result<()> {
        let core = &mut self.core;
        core.bricks.heal();
        core.pieces = Pieces::default();
        core.facing.clear();
        core.flags[core.bricks.model.lattice().slot_count()..].fill(flag::FIX_ALL);
        core.contact.heal();
        Ok(())
    }

    fn reset(&mut self) {
        let core = &mut self.core;
        core.nodes = Nodes::at_rest(core.bricks.count(), core.tables.damped);
        core.contact.clear();
        core.contact.lose_track();
        core.vis_viva = 0.0;
        core.is_cleared = true;
        core.sleep.wake_all(&core.bricks);
    }

    fn save(&mut self) -> Result<Saved> {
        Ok(Box::new(self.core.save()))
    }

    fn restore(&mut self, saved: &Saved) -> Result<()> {
        self.core.restore(saved.downcast_ref().ok_or_else(saved_elsewhere)?);
        Ok(())
    }

    fn node_bytes(&self) -> u64 {
        let core = &self.core;
        let fields = 3 + u64::from(core.nodes.v_next.is_some());
        let brick = fields * (BRICK_OCTETS * 8 * size_of::<R>()) as u64
            + (BRICK_SLOTS * (size_of::<u32>() + 3 * size_of::<u8>())) as u64
            + (size_of::<[u32; 27]>() + size_of::<u16>() + size_of::<Mark>()) as u64
            + (size_of::<bool>() + 2 * size_of::<u8>() + 2 * size_of::<Run>() + size_of::<[u16; 3]>()) as u64;
        brick * core.bricks.count() as u64
    }
}

impl<R: CpuReal> Core<R> {
    /// Prepares a step: who may be touched, and where the first substep reads and writes.
    fn begin(&mut self, plan: &StepPlan) {
        if !plan.sleeping {
            self.sleep.wake_all(&self.bricks);
        }
        self.last_dt = plan.dt;
        self.contact.clear();
        self.aim();
    }

    /// Points the buffers at the current fields.
    fn aim(&mut self) {
        let nodes = &mut self.nodes;
        let v = nodes.v.0.as_mut_ptr();
        self.buffers = Buffers {
            u: nodes.u.0.as_ptr(),
            v,
            u_next: nodes.u_next.0.as_mut_ptr(),
            v_next: nodes.v_next.as_mut().map_or(v, |field| field.0.as_mut_ptr()),
            marks: self.marks.as_mut_ptr(),
        };
    }

    /// Evaluates the member's share of the pieces; after the meeting all can gather from them.
    fn evaluate_pieces(&self, member: &Member) {
        if self.pieces.count() == 0 {
            return;
        }
        // SAFETY: shares are disjoint, and nobody writes the current fields before the meeting.
        unsafe {
            self.pieces.evaluate(
                member.share(self.pieces.count()),
                &self.tables,
                self.buffers.u,
                self.buffers.v,
            );
        }
        member.meet();
    }

    /// Claims runs and advances them until none is left.
    fn advance_claimed(
        &self,
        plan: &StepPlan,
        claims: &AtomicUsize,
        threads: usize,
        scratch: &mut Scratch<R>,
    ) {
        let g = plan.gravity;
        let pass = |watch: bool| Pass {
            bricks: &self.bricks,
            flags: &self.flags,
            laws: &self.tables,
            pieces: &self.pieces,
            u: self.buffers.u,
            v: self.buffers.v,
            u_next: self.buffers.u_next,
            v_next: self.buffers.v_next,
            marks: self.buffers.marks,
            dt: plan.dt,
            gravity: [g.x, g.y, g.z],
            keep: self.keep(plan),
            watch,
        };
        let (awake, watched) = (self.sleep.awake(), self.sleep.watched());
        let (advance, watch) = (pass(false), pass(true));
        let count = awake.len() + watched.len();
        let run_at = |at: usize| if at < awake.len() { awake[at] } else { watched[at - awake.len()] };
        // Neighbouring runs share halos, so a claim takes a few; but every thread must find work to the end.
        let claim = (count / (16 * threads)).clamp(1, LONGEST_CLAIM);
        loop {
            // Relaxed: a claim only has to be made once; the meetings order everything else.
            let first = claims.fetch_add(claim, Ordering::Relaxed);
            if first >= count {
                return;
            }
            for at in first..(first + claim).min(count) {
                let pass = if at < awake.len() { &advance } else { &watch };
                let next = (at + 1 < count).then(|| run_at(at + 1));
                // SAFETY: a run is claimed by one thread; awake and watched runs share no brick; nobody writes what is read.
                unsafe { (self.kernel)(pass, run_at(at), next, scratch) };
            }
        }
    }

    /// What is left of a velocity after a substep's kick. Velocities lag by half a substep: from rest, where kinetic damping has put
    /// them, the first kick is half a one. A whole one would add energy to modes near the stable step.
    fn keep(&self, plan: &StepPlan) -> f64 {
        if plan.kinetic_damping && self.is_cleared { 0.5 } else { 1.0 / (1.0 + plan.drag_per_s * plan.dt) }
    }

    /// What one thread does alone after all runs have advanced.
    fn finish(&mut self, plan: &StepPlan, substep: u32, sums: &mut [ToolSum], report: &mut StepReport) {
        let fastest = self.fastest();
        // A node that crosses a whole cell in one substep, or goes nowhere finite, is lost; a comparison with NaN is false.
        let is_sound = fastest * plan.dt < self.bricks.model.lattice().cell_m();
        if !is_sound {
            report.has_diverged = true;
            self.nodes.v.0.fill(Default::default());
            return;
        }
        let duration = plan.dt * f64::from(plan.substeps);
        let span = [0, 1].map(|end| f64::from(substep + end) / f64::from(plan.substeps));
        let keep = self.keep(plan);
        let mut furthest = fastest * plan.dt;
        for loads in plan.loads {
            furthest = furthest.max(self.push(loads, plan.dt, keep));
        }
        for region in plan.regions {
            furthest = furthest.max(self.drive(region, span[1], plan.dt));
        }
        for (tool, sum) in plan.tools.iter().zip(&mut *sums) {
            let way = carry(tool, span[1], plan.dt, &self.bricks, &self.corner_kg, &mut self.nodes, sum);
            furthest = furthest.max(way);
        }
        let Nodes { u, u_next, v, v_next } = &mut self.nodes;
        let (marks, bricks) = (&self.marks, &self.bricks);
        let kg = |slot: u32| bricks.node_mass(slot, |m| self.corner_kg[usize::from(m)]);
        let v_now = v_next.as_mut().unwrap_or(&mut *v);
        let mut mobile = Mobile { u: &mut *u_next, v: v_now, flags: &self.flags, kg: &kg };
        for (tool, sum) in plan.tools.iter().zip(&mut *sums) {
            furthest +=
                self.hold.hold(tool, span[1], [plan.dt, duration], &mut std::iter::empty(), &mut mobile, sum);
        }
        furthest += keep_apart(&self.facing, bricks.model.lattice().cell_m(), plan.dt, &mut mobile);
        let moved = |brick: usize| f64::from(marks[brick].displacement2).sqrt();
        let mut nodes = ContactNodes {
            u_before: u,
            u: u_next,
            v: v_next.as_mut().unwrap_or(v),
            flags: &self.flags,
            bricks,
            corner_kg: &self.corner_kg,
            dt: plan.dt,
            step: duration,
            fastest,
            furthest,
        };
        self.contact.resolve(bricks, plan.tools, span, &mut nodes, moved, sums);

        report.contact_points = self.contact.point_count() as u32;
        report.substeps = substep + 1;
        self.nodes.swap();

        let vis_viva: f64 = self
            .sleep
            .awake()
            .iter()
            .flat_map(|run| &self.marks[run.first..run.end()])
            .map(|m| f64::from(m.vis_viva))
            .sum();
        self.is_cleared = plan.kinetic_damping && vis_viva < self.vis_viva;
        self.vis_viva = if self.is_cleared { 0.0 } else { vis_viva };
        if self.is_cleared {
            self.nodes.v.0.fill(Default::default());
        }
        if plan.sleeping {
            self.put_to_sleep(plan);
        }
        self.aim();
    }

    /// Changes velocity and the displacement to come of a node.
    fn kick(&mut self, slot: u32, dv: Vec3, dt: f64) {
        let flags = self.flags[slot as usize];
        let dv = Vec3::from_fn(|axis, _| if flags & (flag::FIX_X << axis) == 0 { dv[axis] } else { 0.0 });
        let Nodes { u_next, v, v_next, .. } = &mut self.nodes;
        let v = v_next.as_mut().unwrap_or(v);
        v.set(slot, v.vec3(slot) + dv);
        u_next.set(slot, u_next.vec3(slot) + dv * dt);
    }

    /// Applies a load for one substep. Returns how far a loaded node has moved in it at most, in m.
    fn push(&mut self, loads: &NodalLoads, dt: f64, keep: f64) -> f64 {
        let per_mass = |core: &Self, slot: u32| {
            dt * keep / core.bricks.node_mass(slot, |m| core.corner_kg[usize::from(m)])
        };
        for &(slot, force) in &loads.forces {
            self.kick(slot, force * per_mass(self, slot), dt);
        }
        let model = self.bricks.model.clone();
        for &(corners, pressure) in &loads.pressed {
            // The vector area of a quadrilateral is half the cross product of its diagonals; displacements before this substep, so
            // that faces do not see each other's kicks.
            let at = corners.map(|slot| model.lattice().rest_position(slot) + self.nodes.u.vec3(slot));
            let area = 0.5 * (at[2] - at[0]).cross(&(at[3] - at[1]));
            for slot in corners {
                self.kick(slot, -area * (pressure / 4.0) * per_mass(self, slot), dt);
            }
        }
        let Nodes { u, u_next, .. } = &self.nodes;
        let way = |slot: u32| (u_next.vec3(slot) - u.vec3(slot)).norm();
        loads.slots().map(way).fold(0.0, f64::max)
    }

    /// Moves a rigid region to where it is after the fraction `t` of the step. Returns how far a node of it has moved at most, in m.
    fn drive(&mut self, region: &RegionStep, t: f64, dt: f64) -> f64 {
        let pose = region.at(t);
        let model = self.bricks.model.clone();
        let Nodes { u, u_next, v, v_next } = &mut self.nodes;
        let v = v_next.as_mut().unwrap_or(v);
        let mut furthest = 0.0_f64;
        for &slot in region.nodes.iter() {
            let rest = model.lattice().rest_position(slot);
            let moved = pose.transform_point(&rest.into()).coords - rest;
            let way = moved - u.vec3(slot);
            furthest = furthest.max(way.norm());
            v.set(slot, way / dt);
            u_next.set(slot, moved);
        }
        furthest
    }

    /// Speed of the fastest node in this substep, in m/s; not finite where any is not.
    fn fastest(&self) -> f64 {
        let marks = self.sleep.awake().iter().flat_map(|run| &self.marks[run.first..run.end()]);
        // A NaN, once met, stays: comparisons with it are false.
        let faster =
            |most: f32, mark: &Mark| if most.is_nan() || mark.speed2 <= most { most } else { mark.speed2 };
        let speed2 = marks.fold(0.0, faster);
        f64::from(speed2).sqrt()
    }

    fn put_to_sleep(&mut self, plan: &StepPlan) {
        let Self { bricks, marks, sleep, contact, nodes, pieces, .. } = self;
        let brick_of = |slot: u32| slot / BRICK_SLOTS as u32;
        let loaded = plan.loads.iter().flat_map(NodalLoads::slots);
        let driven = plan.regions.iter().flat_map(|region| region.nodes.iter().copied());
        let grasped = plan.tools.iter().flat_map(|tool| tool.grasped.iter().map(|(slot, _)| *slot));
        let held = plan.tools.iter().flat_map(|tool| tool.held.iter().flat_map(|held| held.nodes));
        let acted_on = loaded.chain(driven).chain(grasped).chain(held).map(brick_of);
        // Pieces reach over to bricks that are no neighbours: where there are any, tissue stays awake.
        let touched = contact.touched_bricks().iter().chain(pieces.bricks()).copied().chain(acted_on);
        sleep.update(bricks, marks, touched, |brick| {
            // The other copy must say the same, for nobody writes it now.
            let octets = brick * BRICK_OCTETS..(brick + 1) * BRICK_OCTETS;
            nodes.u_next.0[octets.clone()].copy_from_slice(&nodes.u.0[octets.clone()]);
            nodes.v.0[octets.clone()].fill(Default::default());
            if let Some(v_next) = &mut nodes.v_next {
                v_next.0[octets].fill(Default::default());
            }
        });
    }

    /// Sums up what the marks of the last substep say.
    fn measure(&mut self, report: &mut StepReport) {
        report.awake_nodes = self.sleep.awake_nodes();
        report.awake_bricks = self.sleep.awake().iter().map(|run| run.bricks as u64).sum();
        report.dropped_points = self.contact.dropped_points();
        let [strain, swelling, shrinking] = self.pieces.extremes();
        let largest = |f: fn(&Mark) -> f32, of_pieces: f32| {
            f64::from(self.marks.iter().map(f).fold(of_pieces, f32::max))
        };
        report.strain = largest(|m| m.strain, strain);
        report.volume_ratio =
            [1.0 - largest(|m| m.shrinking, shrinking), 1.0 + largest(|m| m.swelling, swelling)];
    }

    /// Accelerations by inner forces, without moving anything.
    fn accelerations(&self) -> Vec<Vec3> {
        let field = self.forces_of(&self.nodes.u);
        (0..self.flags.len() as u32).map(|slot| field.vec3(slot)).collect()
    }

    /// Accelerations by the springs and volumes that a displacement field strains.
    fn forces_of(&self, u: &Field<R>) -> Field<R> {
        let count = self.bricks.count();
        // From rest, one second at constant acceleration leaves a velocity of that size.
        let (v, mut u_next, mut v_next) =
            (Field::<R>::zeros(count), Field::<R>::zeros(count), Field::<R>::zeros(count));
        let mut marks = vec![Mark::default(); count];
        let pass = Pass {
            bricks: &self.bricks,
            flags: &self.flags,
            laws: &self.tables,
            pieces: &self.pieces,
            u: u.0.as_ptr(),
            v: v.0.as_ptr(),
            u_next: u_next.0.as_mut_ptr(),
            v_next: v_next.0.as_mut_ptr(),
            marks: marks.as_mut_ptr(),
            dt: 1.0,
            gravity: [0.0; 3],
            keep: 1.0,
            watch: false,
        };
        let mut runs = Vec::new();
        self.bricks.list_runs(super::lattice::MAX_RUN, |_| true, &mut runs);
        let mut scratch = Scratch::new();
        // SAFETY: this thread is alone, and the fields are those of all slots.
        unsafe { self.pieces.evaluate(0..self.pieces.count(), &self.tables, u.0.as_ptr(), v.0.as_ptr()) };
        for run in runs {
            // SAFETY: this thread is alone, and all fields have the size of the model.
            unsafe { (self.kernel)(&pass, run, None, &mut scratch) };
        }
        v_next
    }

    /// Highest angular frequency of the model at rest.
    fn highest_frequency(&self) -> f64 {
        let lattice = self.bricks.model.lattice();
        let (h, slots) = (lattice.cell_m(), lattice.slot_count() as u32);
        let mut mass = vec![0.0; 3 * slots as usize];
        for slot in lattice.slots() {
            let m = lattice.node_mass(slot, |material| self.corner_kg[usize::from(material)]);
            for axis in 0..3 {
                if self.flags[slot as usize] & (flag::FIX_X << axis) == 0 {
                    mass[3 * slot as usize + axis] = m;
                }
            }
        }
        let mut field = Field::<R>::zeros(self.bricks.count());
        stability::highest_frequency(&mass, |u| {
            // Forces are linear for displacements this small, and lose nothing to rounding: they are computed from differences.
            let most = u.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let scale = 1e-7 * h / most.max(1e-300);
            for slot in 0..slots {
                let at = 3 * slot as usize;
                field.set(slot, Vec3::new(u[at], u[at + 1], u[at + 2]) * scale);
            }
            let a = self.forces_of(&field);
            for slot in 0..slots {
                let a = -a.vec3(slot) / scale;
                u[3 * slot as usize..3 * slot as usize + 3].copy_from_slice(a.as_slice());
            }
        })
    }
}
