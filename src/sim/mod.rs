//! WHO drives: a running simulation and its ports.
//!
//! A [`Sim`] is driven by its owner, one thread at a time. A [`ToolPort`] belongs to one servo thread and a [`SurfacePort`] to one
//! render thread; both may be used while the owner steps, and both outlive the simulation.

use std::sync::Arc;

use crate::error::Result;
use crate::math::{Pose, Vec3};
use crate::model::Model;
use crate::solver::load::Load;
use crate::solver::statistics::{Energy, Statistics};
use crate::solver::tool::{Contact, ToolDesc, ToolForce, ToolMotion};

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
}

impl Default for SimDesc {
    fn default() -> Self {
        Self {
            precision: Precision::Single,
            threads: 0,
            step_s: 1e-3,
            substeps: None,
            gravity_m_s2: Vec3::new(0.0, 0.0, 0.0),
            rest_under_gravity: true,
            drag_per_s: 5.0,
            sleeping: true,
        }
    }
}

/// The id of a load in a running simulation; never 0, never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LoadId(pub u64);

/// The id of a tool in its simulation; never 0, never used again there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ToolId(pub u64);

/// What a ray met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Where, world frame.
    pub point_m: Vec3,
    /// Outward unit normal of the triangle there.
    pub normal: Vec3,
    /// Distance along the ray in metres.
    pub distance_m: f64,
    /// The triangle of the contact surface.
    pub triangle: u32,
    /// Material index of the tissue, 1 to 15.
    pub material: u8,
}

/// Nodal quantity for [`Sim::nodes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeField {
    /// Rest position, world frame, m.
    RestPosition,
    /// Displacement, world axes, m.
    Displacement,
    /// Velocity, world axes, m/s.
    Velocity,
}

/// Scalar shown on a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SurfaceField {
    /// Length of the displacement in metres.
    #[default]
    Displacement,
    /// Largest principal strain magnitude of the cell under the vertex.
    Strain,
}

/// A running simulation.
#[derive(Debug)]
pub struct Sim {}

/// One tool of a simulation, held by its servo thread.
#[derive(Debug)]
pub struct ToolPort {}

/// One renderer's view of one surface.
#[derive(Debug)]
pub struct SurfacePort {}

/// One frame of a surface, valid until the port takes the next one. World frame. Arrays are `[vertex_count]`, 16-byte aligned.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceFrame<'a> {
    /// x, y, z in metres and 1.
    pub positions: &'a [[f32; 4]],
    /// Unit normals and 0.
    pub normals: &'a [[f32; 4]],
    /// The positions of the frame that this port took before, for motion vectors.
    pub previous_positions: &'a [[f32; 4]],
    /// The field chosen with [`SurfacePort::set_field`].
    pub scalars: &'a [f32],
    /// Texture coordinates.
    pub uvs: &'a [[f32; 2]],
    /// Material indices, 1 to 15.
    pub materials: &'a [u8],
    /// Vertex indices `[triangle_count]`.
    pub triangles: &'a [[u32; 3]],
    /// Counts changes of `triangles`; 0 until the first cut.
    pub topology_version: u64,
    /// Simulated time of the frame in seconds.
    pub time_s: f64,
}

impl Sim {
    /// A simulation at rest.
    pub fn new(model: Arc<Model>, desc: &SimDesc) -> Result<Self> {
        let _ = (model, desc);
        todo!()
    }

    /// The model.
    pub fn model(&self) -> &Arc<Model> {
        todo!()
    }

    /// Adds a tool. It touches nothing until its first motion is set.
    pub fn add_tool(&mut self, desc: &ToolDesc) -> Result<ToolPort> {
        let _ = desc;
        todo!()
    }

    /// Removes a tool; its port then reports that it is stopped.
    pub fn remove_tool(&mut self, tool: ToolId) -> Result<()> {
        let _ = tool;
        todo!()
    }

    /// Opens a port on surface `index` of the model.
    pub fn open_surface(&mut self, index: usize) -> Result<SurfacePort> {
        let _ = index;
        todo!()
    }

    /// Advances by one step of [`SimDesc::step_s`].
    pub fn step(&mut self) -> Result<()> {
        todo!()
    }

    /// Lets the tissue come to rest under its loads, with the tools where they are, without simulated time passing.
    /// Returns the largest residual acceleration in m/s².
    pub fn settle(&mut self, tolerance_m_s2: f64, max_substeps: u64) -> Result<f64> {
        let _ = (tolerance_m_s2, max_substeps);
        todo!()
    }

    /// Back to the rest state at time 0, with loads, tools and gravity as they are.
    pub fn reset(&mut self) {
        todo!()
    }

    /// Changes gravity, world frame, m/s².
    pub fn set_gravity(&mut self, gravity_m_s2: Vec3) -> Result<()> {
        let _ = gravity_m_s2;
        todo!()
    }

    /// Adds a load that acts until it is removed.
    pub fn add_load(&mut self, load: &Load) -> Result<LoadId> {
        let _ = load;
        todo!()
    }

    /// Removes a load.
    pub fn remove_load(&mut self, id: LoadId) -> Result<()> {
        let _ = id;
        todo!()
    }

    /// Drives the rigid region of a label: the transform (world frame) from its rest place to its new one, reached at the end of the
    /// next step.
    pub fn drive_region(&mut self, label: u16, motion: &Pose) -> Result<()> {
        let _ = (label, motion);
        todo!()
    }

    /// The contacts of a tool in the last substep.
    pub fn contacts(&self, tool: ToolId) -> Result<Vec<Contact>> {
        let _ = tool;
        todo!()
    }

    /// The first triangle of the contact surface, as deformed now, that a ray meets. World frame.
    pub fn pick(&self, origin_m: Vec3, direction: Vec3) -> Result<Option<Pick>> {
        let _ = (origin_m, direction);
        todo!()
    }

    /// A nodal quantity for every node, in slot order `[node_count]`.
    pub fn nodes(&self, field: NodeField) -> Vec<Vec3> {
        let _ = field;
        todo!()
    }

    /// How the simulation is doing.
    pub fn statistics(&self) -> Statistics {
        todo!()
    }

    /// Energies now.
    pub fn energy(&self) -> Energy {
        todo!()
    }
}

impl ToolPort {
    /// Names the tool to its simulation's owner, who must not touch a port that a servo thread is using.
    pub fn id(&self) -> ToolId {
        todo!()
    }

    /// Says where the tool is. The simulation moves it there over its next step. Wait-free: no lock, allocation or system call.
    pub fn set_motion(&mut self, motion: &ToolMotion) -> Result<()> {
        let _ = motion;
        todo!()
    }

    /// The newest force. Wait-free.
    pub fn force(&mut self) -> ToolForce {
        todo!()
    }

    /// Whether the simulation still exists and still has this tool. Wait-free.
    pub fn is_running(&self) -> bool {
        todo!()
    }
}

impl SurfacePort {
    /// Takes the newest state of the surface. Waits for a step in progress, never makes a step wait for the renderer to finish.
    pub fn map(&mut self) -> Result<SurfaceFrame<'_>> {
        todo!()
    }

    /// Chooses the scalar of later frames.
    pub fn set_field(&mut self, field: SurfaceField) {
        let _ = field;
        todo!()
    }

    /// Whether the simulation still exists.
    pub fn is_running(&self) -> bool {
        todo!()
    }
}
