//! HOW a step is asked for: what every backend must answer, and what tools, loads and statistics are.

pub mod blade;
pub mod load;
pub mod method;
pub mod statistics;
pub mod tool;

use std::any::Any;
use std::sync::Arc;

use crate::cut::surface::drawn::Redrawn;
use crate::cut::topology::{Change, Topology};
use crate::error::{Error, Result};
use crate::math::{Bounds, Pose, Vec3};
use crate::model::lattice::BRICK_SLOTS;
use crate::model::law::CellLaw;
use crate::model::surface::Surface;
use blade::Held;
use load::NodalLoads;
use statistics::Copied;
use tool::{Contact, ToolDesc, ToolPath, Wrench};

/// One step, as a backend takes it. Model frame.
#[derive(Clone, Copy, Debug)]
pub struct StepPlan<'a> {
    /// How many substeps.
    pub substeps: u32,
    /// Their length in s.
    pub dt: f64,
    /// Acceleration of every node in m/s².
    pub gravity: Vec3,
    /// Background drag α in 1/s; none with kinetic damping.
    pub drag_per_s: f64,
    /// Tools that may touch the tissue.
    pub tools: &'a [ToolStep],
    /// Rigid regions that move.
    pub regions: &'a [RegionStep],
    /// Loads in force.
    pub loads: &'a [NodalLoads],
    /// Whether bricks may sleep.
    pub sleeping: bool,
    /// Whether velocities are cleared whenever the kinetic energy falls, so that the tissue settles.
    pub kinetic_damping: bool,
    /// Whether contacts are asked for as soon as the step has ended, so that they had better come with what it reports.
    pub tells_contacts: bool,
}

/// A tool during one step.
#[derive(Clone, Debug)]
pub struct ToolStep {
    /// Shape and friction.
    pub desc: Arc<ToolDesc>,
    /// Its way.
    pub path: ToolPath,
    /// Nodes that it holds: slots, and where they are in its frame, in m.
    pub grasped: Arc<[(u32, Vec3)]>,
    /// Where its edge stands in tissue.
    pub held: Arc<[Held]>,
}

/// A rigid region during one step: the transform from its rest place.
#[derive(Clone, Debug)]
pub struct RegionStep {
    /// Slots of its nodes, but for those whose tissue was removed, ascending. The same list as long as they are the same.
    pub nodes: Arc<[u32]>,
    /// The transform at the start.
    pub from: Pose,
    /// The transform at the end.
    pub to: Pose,
}

impl RegionStep {
    /// Where the region is after the fraction `t` of the step.
    pub fn at(&self, t: f64) -> Pose {
        // The end itself, not an interpolation's rounding of it.
        let between = (t < 1.0).then(|| self.from.try_lerp_slerp(&self.to, t, 1e-9)).flatten();
        between.unwrap_or(self.to)
    }
}

/// What a tool gave to the tissue during a step.
#[derive(Clone, Copy, Debug, Default)]
pub struct ToolSum {
    /// Impulse on the **tool** in N s, and its moment about the tool's origin in N m s.
    pub impulse: Wrench,
    /// Work done on the tissue in J.
    pub work_j: f64,
}

/// How a step went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Substeps that were taken; fewer than planned when the state diverged.
    pub substeps: u32,
    /// Whether a node moved further than a cell in one substep, or became not finite. The state is that before.
    pub has_diverged: bool,
    /// Nodes integrated in the last substep.
    pub awake_nodes: u64,
    /// Bricks integrated in the last substep.
    pub awake_bricks: u64,
    /// How long the device was at work, in s.
    pub device_s: f64,
    /// Largest |1 − L / l| of an edge spring.
    pub strain: f64,
    /// Smallest and largest J of a cell with a volume term.
    pub volume_ratio: [f64; 2],
    /// Iterations of the last substep's solution, and the share of its first residual that was left; 0 where steps are explicit.
    pub iterations: u32,
    /// See [`Self::iterations`].
    pub residual: f64,
    /// Surface points in contact in the last substep.
    pub contact_points: u32,
    /// Surface points in tools since creation for which there was no room.
    pub dropped_points: u64,
}

/// A surface's arrays, filled by a backend. World frame.
#[derive(Debug)]
pub struct SurfaceArrays<'a> {
    /// x, y, z in metres and 1, `[vertex_count]`.
    pub positions: &'a mut [[f32; 4]],
    /// Unit normals and 0, `[vertex_count]`.
    pub normals: &'a mut [[f32; 4]],
    /// The scalar field, `[vertex_count]`.
    pub scalars: &'a mut [f32],
}

/// Scalar shown on a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SurfaceField {
    /// Length of the displacement in metres.
    #[default]
    Displacement,
    /// Largest principal strain magnitude of the tissue under the vertex.
    Strain,
}

/// What displaced the nodes of a brick at the look before the last one, where there was none at the last one, and at the last one, by their places in the brick, m, model frame.
pub type SeenBrick = [[Vec3; BRICK_SLOTS]; 2];

/// What a solver has saved, for itself and for others of its kind on the same model that have as much room.
pub type Saved = Box<dyn Any + Send + Sync>;

/// Why a solver cannot take up what was saved.
pub fn saved_elsewhere() -> Error {
    Error::Defect("a solver of another kind has saved this".into())
}

/// A backend that holds the state of one simulation and advances it.
///
/// Coarse on purpose: everything hot lies behind [`Self::advance`], so that a backend may fuse as it likes.
pub trait Solver: Send + std::fmt::Debug {
    /// Largest stable substep at rest in s, damping included.
    fn stable_dt(&self) -> f64;

    /// Takes a step. `sums` has one entry for each tool of the plan and is added to. Fails when the device is lost.
    fn advance(&mut self, plan: &StepPlan, sums: &mut [ToolSum]) -> Result<StepReport>;

    /// Whether the device is still there. Calls that have no way to fail give nothing when it is not; this says so afterwards.
    fn check(&self) -> Result<()> {
        Ok(())
    }

    /// Shows the contacts of the tool with index `tool` in the last plan, model frame.
    fn contacts(&self, tool: usize, show: &mut dyn FnMut(Contact));

    /// Computes the model's surface `index`, of which cuts have made `surface`, as it is now. Fails when the device is lost, or has no room.
    fn publish(
        &mut self,
        index: usize,
        surface: &Surface,
        field: SurfaceField,
        arrays: &mut SurfaceArrays,
    ) -> Result<()>;

    /// Mass of the node in a slot in kg, of the lattice or a copy.
    fn mass(&self, slot: u32) -> f64;

    /// Displacement of a slot in m, model frame.
    fn displacement(&self, slot: u32) -> Vec3;

    /// Velocity of a slot in m/s, model frame, half a substep behind the displacement.
    fn velocity(&self, slot: u32) -> Vec3;

    /// Displacements of all slots in m, model frame, into `all`, which keeps its memory.
    fn displacements(&self, all: &mut Vec<Vec3>);

    /// Looks where the lattice's nodes are, for [`Self::seen`]. Adds for each brick what displaces its nodes along each axis: the least and the most, m, model frame.
    fn look(&mut self, displaced: &mut Vec<Bounds>);

    /// Adds what displaced the nodes of some bricks, ascending, at the last look and at the one before.
    fn seen(&mut self, bricks: &[u32], nodes: &mut Vec<SeenBrick>);

    /// Velocities of all slots in m/s, model frame, into `all`, which keeps its memory.
    fn velocities(&self, all: &mut Vec<Vec3>);

    /// Largest length of the difference between velocities now and `before`, in m/s.
    fn largest_change(&self, before: &[Vec3]) -> f64;

    /// Brings all nodes to rest where they are, and wakes them.
    fn halt(&mut self);

    /// Replaces displacement and velocity of a slot.
    fn set_node(&mut self, slot: u32, displacement: Vec3, velocity: Vec3);

    /// Accelerations of all slots by inner forces alone, m/s², zero along held axes.
    fn accelerations(&mut self) -> Vec<Vec3>;

    /// Wakes everything: gravity, loads or boundaries changed. Plans hold other loads than the last one did only after this.
    fn wake(&mut self);

    /// Replaces what cells of each material contribute `[16]`, and with it the largest substep that is stable at rest. Fails when the device is lost, or has
    /// no room.
    fn set_laws(&mut self, laws: &[CellLaw; 16], stable_dt: f64) -> Result<()>;

    /// Replaces the flags of these slots: what is held from now on stays where it is. As [`Self::set_laws`] for the rest.
    fn set_flags(&mut self, changed: &[(u32, u8)], stable_dt: f64) -> Result<()>;

    /// Takes over what a cut has made of the tissue: `change` is what is new in `topology`, and `surfaces` are what has become of the model's, and what is new in them. [`Self::set_flags`] with
    /// those of [`Topology::nodes_of`] that are copies, or [`Self::restore`], follows. Fails when the device is lost, or has no room.
    fn cut(&mut self, topology: &Topology, change: &Change, surfaces: &[(&Surface, &Redrawn)]) -> Result<()>;

    /// Forgets all cuts; [`Self::reset`] or [`Self::restore`] follows. Fails when the device is lost.
    fn heal(&mut self) -> Result<()>;

    /// Back to rest.
    fn reset(&mut self);

    /// Copies what it takes to go on from here to the last bit, besides laws, cuts and surfaces. Fails when the device is lost.
    fn save(&mut self) -> Result<Saved>;

    /// Goes on from what was saved. The cuts and the laws of then are in force already: [`Self::heal`], [`Self::cut`] with all cuts at once, and [`Self::set_laws`] came before. Fails
    /// when the device is lost, or has no room.
    fn restore(&mut self, saved: &Saved) -> Result<()>;

    /// Bytes resident for the state and topology of nodes, the model's part included.
    fn node_bytes(&self) -> u64;

    /// Bytes copied between host and device since creation.
    fn copied(&self) -> Copied {
        Copied::default()
    }
}
