//! WHO drives: a running simulation and its ports.
//!
//! A [`Sim`] is driven by its owner, one thread at a time, or by a thread of its own ([`Sim::start`]). A [`ToolPort`] belongs to one servo thread and a [`SurfacePort`] to one
//! render thread; both may be used while the owner steps, and both outlive the simulation.
//!
//! What the owner changes of a simulation that runs on its own thread (gravity, materials, what is held, tools, a reset or a restore) is changed under its lock, between two
//! steps. Commands in a ring would return at once, but with nothing to return: errors, ids and counts would come later, as events that the owner would have to
//! wait for all the same, and what he asks next would be answered out of order. The price is the step in progress, no more than that one even where steps follow
//! each other without a pause, because the lock is handed over fairly; the thread in turn waits for the command's own work. Servo threads take no lock.

mod backend;
mod blade;
mod body;
mod carried;
mod cut;
mod drive;
mod event;
mod haptics;
mod hearing;
mod latency;
mod parts;
mod pick;
mod reach;
mod removal;
mod seen;
mod state;
mod surface_port;
mod tool_port;

use std::sync::Arc;
use std::time::Instant;

use parking_lot::Mutex;

pub use self::backend::{Backend, Place};
pub use self::drive::{Hook, ThreadDesc};
pub use self::event::Event;
pub use self::latency::Latency;
pub use self::parts::Part;
pub use self::pick::Pick;
pub use self::removal::Removed;
pub use self::state::Snapshot;
pub use self::surface_port::{SurfaceFrame, SurfacePort};
pub use self::tool_port::{Exchange, ToolPort};
pub use crate::solver::SurfaceField;

use self::drive::Driver;
use self::event::{EVENTS, Events};
use self::state::State;
use crate::channel::ring::{Consumer, ring};
use crate::error::{Error, Result};
use crate::math::{FAR_M, Pose, Vec3};
use crate::model::material::Material;
use crate::model::{Fix, Model};
use crate::servo::ServoOptions;
use crate::servo::device::DeviceDesc;
use crate::solver::load::Load;
use crate::solver::method::Method;
use crate::solver::statistics::{Energy, Statistics};
use crate::solver::tool::{Contact, Shape, ToolDesc};
use crate::trace;

/// The arithmetic of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 32-bit floating point.
    #[default]
    Single,
    /// 64-bit floating point.
    Double,
}

/// How a simulation runs.
#[derive(Clone, Debug)]
pub struct SimDesc {
    /// Where it runs.
    pub backend: Backend,
    /// What computes the tissue.
    pub method: Method,
    /// Arithmetic of a step.
    pub precision: Precision,
    /// Threads that compute, the caller of [`Sim::step`] included; 0 takes one for each core.
    pub threads: usize,
    /// Simulated length of a step in seconds.
    pub step_s: f64,
    /// Substeps in a step; `None` takes as many as the model's stable step asks for, and more when strain demands it.
    pub substeps: Option<u32>,
    /// Gravity in m/s², world frame.
    pub gravity_m_s2: Vec3,
    /// Whether the model's rest shape is already in balance with `gravity_m_s2` (only later changes of gravity then act).
    pub rest_under_gravity: bool,
    /// Background drag α in 1/s: every node loses α times its momentum each second.
    pub drag_per_s: f64,
    /// Whether quiet bricks of nodes fall asleep and stay as anchors.
    pub sleeping: bool,
    /// Room for the copies of nodes that cuts make, rounded up to whole bricks of 128; with 0 the tissue cannot be cut. A wide cut takes two for each cell that it divides, a short
    /// one more, up to eight; cells may fall into as many pieces. What is cut off has weight only where [`Self::rest_under_gravity`] is not set.
    pub cut_nodes: usize,
    /// Parts that a cut severs, that nothing holds, and that are smaller than so many cells are removed with the cut, 0 to 1000; with 0 all stay. The default, 1, is what the grid resolves: a smaller part holds no cell,
    /// hangs mostly on copies, and flies away as a crumb. [`Statistics::removed_kg`] counts them.
    pub least_part_cells: f64,
}

impl Default for SimDesc {
    fn default() -> Self {
        Self {
            backend: Backend::Cpu,
            method: Method::Lattice,
            precision: Precision::Single,
            threads: 0,
            step_s: 1e-3,
            substeps: None,
            gravity_m_s2: Vec3::zeros(),
            rest_under_gravity: true,
            drag_per_s: 5.0,
            sleeping: true,
            cut_nodes: 0,
            least_part_cells: 1.0,
        }
    }
}

impl SimDesc {
    fn check(&self) -> Result<()> {
        if !(1e-6..=1.0).contains(&self.step_s) {
            return Err(Error::argument(format!(
                "a step of {} s is not between 1e-6 s and 1 s",
                self.step_s
            )));
        }
        if !(0.0..=1e4).contains(&self.drag_per_s) {
            return Err(Error::argument(format!(
                "a drag of {} 1/s is not between 0 and 10,000",
                self.drag_per_s
            )));
        }
        if self.substeps.is_some_and(|n| !(1..=MAX_SUBSTEPS).contains(&n)) {
            return Err(Error::argument(format!("a step has 1 to {MAX_SUBSTEPS} substeps")));
        }
        if self.threads > MAX_THREADS {
            return Err(Error::Limit(format!("{} threads are more than {MAX_THREADS}", self.threads)));
        }
        if self.cut_nodes > MAX_CUT_NODES {
            return Err(Error::Limit(format!(
                "room for {} copies of nodes is more than for {MAX_CUT_NODES}",
                self.cut_nodes
            )));
        }
        if !(0.0..=MAX_LEAST_PART_CELLS).contains(&self.least_part_cells) {
            return Err(Error::argument(format!(
                "a least part of {} cells is not between 0 and {MAX_LEAST_PART_CELLS}",
                self.least_part_cells
            )));
        }
        if let Method::Efg(desc) = &self.method {
            desc.check()?;
        }
        check_gravity(self.gravity_m_s2)
    }
}

/// Most substeps in one step.
pub const MAX_SUBSTEPS: u32 = 100_000;
/// Most threads of one simulation.
pub const MAX_THREADS: usize = 256;
/// Largest gravity along an axis in m/s²: a hundred times that of the Earth.
pub const MAX_GRAVITY_M_S2: f64 = 1e3;
/// Most copies of nodes that cuts make.
pub const MAX_CUT_NODES: usize = 1 << 24;
/// Largest [`SimDesc::least_part_cells`].
pub const MAX_LEAST_PART_CELLS: f64 = 1000.0;
/// Most tools of one simulation.
pub const MAX_TOOLS: usize = 64;

/// The id of a load in its simulation; never 0, never used again there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LoadId(pub u64);

/// The id of a tool in its simulation; never 0, never used again there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ToolId(pub u64);

/// Nodal quantity for [`Sim::nodes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeField {
    /// Rest position, world frame, m.
    RestPosition,
    /// Displacement, world axes, m.
    Displacement,
    /// Velocity, world axes, m/s, half a substep behind the displacement.
    Velocity,
}

/// A running simulation.
#[derive(Debug)]
pub struct Sim {
    model: Arc<Model>,
    place: Place,
    /// The renderers' ports wait here for a step to end; `None` once the simulation is gone.
    state: Arc<Mutex<Option<State>>>,
    events: Consumer<Event>,
    /// The thread that steps, where it is not the owner.
    driver: Option<Driver>,
}

impl Sim {
    /// A simulation at rest.
    pub fn new(model: Arc<Model>, desc: &SimDesc) -> Result<Self> {
        desc.check()?;
        let (solver, place) = backend::open(&model, desc)?;
        let desc = SimDesc { backend: place.backend, ..desc.clone() };
        let (told, events) = ring(EVENTS);
        let state = State::new(model.clone(), desc, solver, Events::new(told))?;
        Ok(Self { model, place, state: Arc::new(Mutex::new(Some(state))), events, driver: None })
    }

    /// Where it runs.
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// Whether the simulation is sound and still has its device: [`Error::Defect`] once its own thread ended by a defect of this library, and
    /// [`Error::Device`] once any call found that the GPU was lost. Every further step
    /// then fails in the same way, tools feel nothing, and [`Self::nodes`] and [`Self::energy`] mean nothing, from the call on that
    /// found it. A reset does not help; a new simulation may run elsewhere.
    pub fn check(&self) -> Result<()> {
        self.with(State::check)
    }

    /// The model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Adds a tool. It touches nothing until its first motion is set.
    pub fn add_tool(&mut self, desc: &ToolDesc) -> Result<ToolPort> {
        desc.check()?;
        self.with(|state| state.add_tool(desc, None))
    }

    /// Adds a tool that a haptic device holds: its port runs the servo loop, see [`ToolPort::exchange`].
    pub fn add_haptic_tool(
        &mut self,
        desc: &ToolDesc,
        device: &DeviceDesc,
        options: &ServoOptions,
    ) -> Result<ToolPort> {
        desc.check()?;
        self.with(|state| state.add_tool(desc, Some((device, options))))
    }

    /// Has a thread of the simulation's own step at the wall clock's pace, one step in each [`SimDesc::step_s`], until [`Self::stop`]. Calls of the owner
    /// meanwhile wait for the step in progress, as do renderers; servo threads never wait.
    ///
    /// A simulation that fails on it pauses: its tools feel nothing, and an [`Event`] says why.
    pub fn start(&mut self, desc: ThreadDesc) -> Result<()> {
        if self.driver.is_some() {
            return Err(Error::State("the simulation has a thread of its own already".into()));
        }
        let step_s = self.with(|state| state.step_s());
        self.driver = Some(Driver::start(self.state.clone(), step_s, desc)?);
        Ok(())
    }

    /// Holds the simulation's own thread after the step in progress, or lets it go on. Time that passes meanwhile is no time behind.
    pub fn set_paused(&mut self, paused: bool) -> Result<()> {
        let driver = self.driver.as_ref();
        let driver = driver.ok_or_else(|| Error::State("the simulation has no thread of its own".into()))?;
        driver.set_paused(paused);
        Ok(())
    }

    /// Ends the simulation's own thread; from then on the owner steps again. Nothing where there is none.
    pub fn stop(&mut self) -> Result<()> {
        self.driver = None;
        self.with(|state| state.refuse_defect())
    }

    /// The oldest event that was not read yet. At most 256 wait; [`Statistics::dropped_events`] counts those beyond.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop()
    }

    /// Removes a tool; its port then reports that it is stopped.
    pub fn remove_tool(&mut self, tool: ToolId) -> Result<()> {
        self.with(|state| state.remove_tool(tool))
    }

    /// Opens a port on surface `index` of the model.
    pub fn open_surface(&mut self, index: usize) -> Result<SurfacePort> {
        let copies = self.with(|state| state.desc.cut_nodes);
        SurfacePort::new(self.model.surfaces(), copies, self.state.clone(), index)
    }

    /// Advances by one step of [`SimDesc::step_s`].
    ///
    /// After [`Error::Diverged`] the state is the last good one, at rest, and every further step fails in the same way until
    /// [`Self::reset`].
    pub fn step(&mut self) -> Result<()> {
        if self.driver.is_some() {
            return Err(Error::State("the simulation steps on a thread of its own; stop it first".into()));
        }
        let _range = trace::range(c"step");
        let asked = Instant::now();
        self.with(|state| state.step(asked))
    }

    /// Lets the tissue come to rest under its loads, with the tools where they are, without simulated time passing. Stops when no
    /// node is accelerated more than `tolerance_m_s2` by all that acts on it (inner forces, gravity, loads, contact), or after
    /// about `max_substeps`. Returns the largest such acceleration that was left, in m/s².
    ///
    /// Velocities are cleared whenever the kinetic energy falls (kinetic damping), and at the end. A tolerance is met in single
    /// precision only while it lies above rounding: some 1e-7 times the displacement times ω², ω = 2 over the stable substep.
    pub fn settle(&mut self, tolerance_m_s2: f64, max_substeps: u64) -> Result<f64> {
        if !(tolerance_m_s2.is_finite() && tolerance_m_s2 > 0.0) {
            return Err(Error::argument(format!("a tolerance of {tolerance_m_s2} m/s² is not above 0")));
        }
        if max_substeps == 0 {
            return Err(Error::argument("settling needs at least one substep"));
        }
        self.with(|state| state.settle(tolerance_m_s2, max_substeps))
    }

    /// Back to the rest state at time 0: tissue whole (the substep stays as short as a cut has made it), rigid regions at their rest places, tools without force. Loads, tools and gravity stay. A
    /// simulation whose GPU was lost stays as it is.
    pub fn reset(&mut self) {
        self.with(State::reset);
    }

    /// Keeps how all is now, in memory: tissue and how it moves, what cuts have made of it, materials, what is held, gravity, loads, where tools and rigid regions are, time and statistics.
    /// Takes time and memory by the size of the model. Fails for a simulation that has failed.
    pub fn snapshot(&self) -> Result<Snapshot> {
        self.with(State::snapshot)
    }

    /// Makes all what it was at a snapshot of this simulation, or of another one of the same model that was described alike; [`SimDesc::threads`], gravity and which GPU it is may differ. From there the simulation
    /// goes on as it did then: to the last bit, on a GPU of the same kind, for the same motions of its tools and drives of its regions.
    ///
    /// Tools and ports live on. A tool stands where the one with its id and shape did and goes from there, in the next step, to where it was asked to be last; what it held it holds again. One that was not there then
    /// is put in anew. Tools are without force until that step, and devices feel nothing until they engage anew. Surfaces that change count as changed by a cut. Loads have the ids of then.
    ///
    /// A snapshot of another model, or of a simulation described otherwise, is refused with [`Error::Argument`], and nothing changes. Where a GPU has too little memory left, [`Error::Limit`], steps fail
    /// until a [`Self::reset`] or another restore.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<()> {
        self.with(|state| state.restore(snapshot))
    }

    /// Changes gravity, world frame, m/s².
    pub fn set_gravity(&mut self, gravity_m_s2: Vec3) -> Result<()> {
        check_gravity(gravity_m_s2)?;
        self.with(|state| state.set_gravity(gravity_m_s2));
        Ok(())
    }

    /// Gives a material of the model, by its index from 1, other properties, in this simulation alone and from the next step on. Rigid materials stay rigid.
    ///
    /// The stable step follows from a bound and may then be shorter than a model built so would have: no frequency is searched for while tissue moves.
    pub fn set_material(&mut self, index: u8, material: &Material) -> Result<()> {
        self.with(|state| state.set_material(index, material))
    }

    /// Holds nodes where they are, in this simulation alone. Gives how many were not held so before.
    pub fn fix(&mut self, fix: &Fix) -> Result<usize> {
        self.with(|state| state.set_held(fix, true))
    }

    /// Frees nodes, also of what the model holds, but for rigid regions. Gives how many were held.
    pub fn free(&mut self, fix: &Fix) -> Result<usize> {
        self.with(|state| state.set_held(fix, false))
    }

    /// Has a tool hold the tissue's nodes that are within `reach_m` of it now and not held otherwise, besides those that it holds already. They go where
    /// it goes, and it feels what that takes. Gives how many it holds.
    pub fn grasp(&mut self, tool: ToolId, reach_m: f64) -> Result<usize> {
        if !(0.0..=1.0).contains(&reach_m) {
            return Err(Error::argument(format!("a reach of {reach_m} m is not between 0 and 1 m")));
        }
        self.with(|state| state.grasp(tool, reach_m))
    }

    /// Has a tool let go of what it holds. Gives how many nodes that were.
    pub fn release(&mut self, tool: ToolId) -> Result<usize> {
        self.with(|state| state.release_tissue(tool))
    }

    /// Cuts what the edge of a blade sweeps on its way from one polyline to another, world frame, in m: the first point to the first, and so on. Where it starts where the last
    /// cut ended, it sweeps on: tissue that has moved against the blade since is cut as well, and no gap is left. Gives how many cells were divided, or divided otherwise.
    ///
    /// A cell that is crossed in part is whole until the blade, now or later, has come through. Rigid cells are not cut. Where there is no room for the nodes that
    /// a cut takes ([`SimDesc::cut_nodes`]) nothing is cut.
    pub fn cut(&mut self, from: &[Vec3], to: &[Vec3]) -> Result<usize> {
        if from.len() != to.len() || from.len() < 2 {
            return Err(Error::argument(
                "the edge of a blade has two points or more, as many at the end of its way as at the start",
            ));
        }
        for &point in from.iter().chain(to) {
            if !point.iter().all(|x| x.abs() <= FAR_M) {
                return Err(Error::argument(format!("a blade must stay within {FAR_M} m of the origin")));
            }
        }
        self.with(|state| state.cut(from, to))
    }

    /// Removes the soft tissue in a shape at a pose, world frame, where it is now: the nodes in the shape, with all that lies between them and the shape's surface. The hole has walls as a cut has, and what stays keeps its mass, place and
    /// velocity. Gives how much that was; a shape that holds no such node removes nothing.
    ///
    /// Rigid cells stay, and so does what is next to them, a thousandth of a cell. Where there is no room for the nodes that the cut around the shape takes ([`SimDesc::cut_nodes`]) nothing is removed. Nodes without tissue stay
    /// where they were, at rest, and nothing moves them until [`Self::reset`] brings all tissue back.
    pub fn ablate(&mut self, shape: &Shape, pose: &Pose) -> Result<Removed> {
        shape.check()?;
        if !pose.to_homogeneous().iter().all(|x| x.abs() <= FAR_M) {
            return Err(Error::argument(format!("a shape must stay within {FAR_M} m of the origin")));
        }
        self.with(|state| state.ablate(shape, pose))
    }

    /// Removes one of [`Self::parts`] by its id, all of it, bone and held tissue too, as [`Self::ablate`] does.
    pub fn remove_part(&mut self, id: u32) -> Result<Removed> {
        self.with(|state| state.remove_part(id))
    }

    /// The parts that cuts have left, the largest first.
    pub fn parts(&self) -> Vec<Part> {
        self.with(|state| state.parts())
    }

    /// Adds a load that acts until it is removed.
    pub fn add_load(&mut self, load: &Load) -> Result<LoadId> {
        let nodal = load.resolve(&self.model)?;
        Ok(self.with(|state| state.add_load(nodal)))
    }

    /// Removes a load.
    pub fn remove_load(&mut self, id: LoadId) -> Result<()> {
        self.with(|state| state.remove_load(id))
    }

    /// Drives the rigid region of a label: the transform (world frame) from its rest place to its new one, reached at the end of the
    /// next step.
    pub fn drive_region(&mut self, label: u16, motion: &Pose) -> Result<()> {
        if !motion.to_homogeneous().iter().all(|x| x.abs() <= FAR_M) {
            return Err(Error::argument(format!("the motion of a rigid region must stay within {FAR_M} m")));
        }
        self.with(|state| state.drive_region(label, motion))
    }

    /// The contacts of a tool in the last substep.
    pub fn contacts(&self, tool: ToolId) -> Result<Vec<Contact>> {
        let _range = trace::range(c"list of contacts");
        self.with(|state| state.contacts(tool))
    }

    /// The first triangle of the contact surface, as deformed now, that a ray meets. World frame.
    pub fn pick(&self, origin_m: Vec3, direction: Vec3) -> Result<Option<Pick>> {
        check_finite("the origin of a ray", origin_m)?;
        check_finite("the direction of a ray", direction)?;
        let direction = direction
            .try_normalize(1e-12)
            .ok_or_else(|| Error::argument("the direction of a ray must not be zero"))?;
        self.with(|state| {
            let pick = state.pick(origin_m, direction);
            state.check().map(|()| pick)
        })
    }

    /// A nodal quantity for every node, in the order of [`Lattice::slots`](crate::model::lattice::Lattice::slots) `[node_count]`.
    pub fn nodes(&self, field: NodeField) -> Vec<Vec3> {
        self.with(|state| state.nodes(field))
    }

    /// How the simulation is doing.
    pub fn statistics(&self) -> Statistics {
        self.with(|state| state.statistics())
    }

    /// How long steps that ended well took since creation or [`Self::reset_latency`]; [`Self::reset`] leaves it alone.
    pub fn latency(&self) -> Latency {
        self.with(|state| state.latency)
    }

    /// Counts the times of steps from none on.
    pub fn reset_latency(&mut self) {
        self.with(|state| state.latency = Latency::default());
    }

    /// Energies now.
    pub fn energy(&self) -> Energy {
        self.with(State::energy)
    }

    /// Replaces displacement (m) and velocity (m/s, half a substep behind) of a node, both in the **model** frame: an initial
    /// condition.
    pub fn set_node(&mut self, slot: u32, displacement: Vec3, velocity: Vec3) -> Result<()> {
        check_finite("a displacement", displacement)?;
        check_finite("a velocity", velocity)?;
        if self.model.lattice().words().get(slot as usize).is_none_or(|&word| word == 0) {
            return Err(Error::argument(format!("slot {slot} holds no node")));
        }
        self.with(|state| state.set_node(slot, displacement, velocity))
    }

    fn with<T>(&self, act: impl FnOnce(&mut State) -> T) -> T {
        let mut state = self.state.lock();
        act(state.as_mut().expect("the state lives as long as its simulation"))
    }
}

impl Drop for Sim {
    fn drop(&mut self) {
        // Its thread first: it looks at the state. Ports may live on; the state must not.
        self.driver = None;
        let state = self.state.lock().take();
        if let Some(mut state) = state {
            // Tools first: giving back a GPU takes longer than a servo may hold a force.
            state.tools.clear();
        }
    }
}

fn check_gravity(gravity_m_s2: Vec3) -> Result<()> {
    let good = gravity_m_s2.iter().all(|x| x.abs() <= MAX_GRAVITY_M_S2);
    good.then_some(()).ok_or_else(|| {
        Error::argument(format!("gravity must be finite and at most {MAX_GRAVITY_M_S2} m/s² along each axis"))
    })
}

fn check_finite(what: &str, v: Vec3) -> Result<()> {
    let good = v.iter().all(|x| x.is_finite());
    good.then_some(()).ok_or_else(|| Error::argument(format!("{what} must be finite")))
}
