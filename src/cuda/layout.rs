//! What the host and the kernels share: twins of `kernels/layout.cuh`.

mod cut;
mod efg;
mod outside;
#[cfg(all(test, unix))]
mod tests;

use std::mem::offset_of;

use cudarc::driver::sys::CUdeviceptr;

use crate::math::Pose;
use crate::model::lattice::BRICK_SLOTS;
use crate::model::law::CellLaw;
use crate::sim::MAX_TOOLS;
use crate::solver;
use crate::solver::tool::Shape;

pub use cut::*;
pub use efg::*;
pub use outside::*;

/// What a cell of one material contributes, SI units.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Law {
    spring: f32,
    volume: f32,
    corner: f32,
    damper: f32,
}

impl Law {
    /// Rounded from double precision.
    pub fn of(law: &CellLaw) -> Self {
        Self {
            spring: law.spring_n_m as f32,
            volume: law.volume_n as f32,
            corner: law.corner_kg as f32,
            damper: (law.spring_n_m * law.damping_s) as f32,
        }
    }
}

/// Most contact points at once; most sites of the surface that may become one before they are listed anew; most nodes that
/// carry a site; and most sites to which one is coupled where points are few.
pub const MAX_POINTS: usize = 2048;
pub const MAX_SITES: usize = 8192;
pub const MAX_ROW: usize = 24;
pub const MAX_COUPLED: usize = 32;
/// Bytes that contact's block shares beside what it declares: couplings between up to 64 points, five fields of those, and their impulses.
pub const CONTACT_SHARED_BYTES: u32 = 64 * (68 * 4 + 5 * 16 + 2 * 16 + 16);

/// One shape of a tool, in the tool's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Part {
    turn: [f32; 4],
    at: [f32; 3],
    shape: u32,
    size: [f32; 4],
}

impl Part {
    /// A shape at its pose.
    pub fn of(pose: &Pose, shape: &Shape) -> Self {
        let (shape, size) = match *shape {
            Shape::Sphere { radius_m } => (0, [radius_m, 0.0, 0.0, 0.0]),
            Shape::Capsule { radius_m, half_length_m } => (1, [radius_m, half_length_m, 0.0, 0.0]),
            Shape::Box { half_extents_m: half, rounding_m } => (2, [half.x, half.y, half.z, rounding_m]),
        };
        let (turn, at) = (pose.rotation.coords, pose.translation.vector);
        Self {
            turn: [turn.x, turn.y, turn.z, turn.w].map(|x| x as f32),
            at: [at.x, at.y, at.z].map(|x| x as f32),
            shape,
            size: size.map(|x| x as f32),
        }
    }
}

/// A tool during one step. Model frame.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct ToolStep {
    from: [f64; 3],
    to: [f64; 3],
    turn_from: [f32; 4],
    turn: [f32; 3],
    friction: f32,
    radius: f32,
    stride: f32,
    reach: f32,
    part: u32,
    part_count: u32,
}

impl ToolStep {
    /// A tool whose parts begin at `part`.
    pub fn of(tool: &solver::ToolStep, part: u32) -> Self {
        let (from, to) = (&tool.path.from, &tool.path.to);
        let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
        let coords = from.rotation.coords;
        Self {
            from: from.translation.vector.into(),
            to: to.translation.vector.into(),
            turn_from: [coords.x, coords.y, coords.z, coords.w].map(|x| x as f32),
            turn: [turn.x, turn.y, turn.z].map(|x| x as f32),
            friction: tool.desc.friction as f32,
            radius: tool.desc.bounding_radius_m() as f32,
            stride: (0.5 * tool.desc.feature_m()) as f32,
            reach: tool.path.reach(tool.desc.bounding_radius_m()) as f32,
            part,
            part_count: tool.desc.parts.len() as u32,
        }
    }
}

/// What a tool gave to the tissue in a step.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct ToolSum {
    pub impulse: [f64; 3],
    pub moment: [f64; 3],
    pub work: f64,
}

/// What is new in each step. Model frame, SI units. The device reads as many tools as there are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Step {
    pub dt: f32,
    pub keep: f32,
    pub gravity: [f32; 3],
    pub sequence: u32,
    pub tool_count: u32,
    pub margin: f32,
    pub duration: f32,
    pub push_limit: f32,
    pub may_jump: u32,
    pub vis_viva: f32,
    pub tools: [ToolStep; MAX_TOOLS],
}

impl Step {
    /// Those that a step with so many tools needs.
    pub fn bytes(tools: usize) -> usize {
        offset_of!(Self, tools) + tools * size_of::<ToolStep>()
    }
}

impl Default for Step {
    fn default() -> Self {
        Self {
            dt: 0.0,
            keep: 1.0,
            gravity: [0.0; 3],
            sequence: 0,
            tool_count: 0,
            margin: 0.0,
            duration: 0.0,
            push_limit: 0.0,
            may_jump: 0,
            vis_viva: 0.0,
            tools: [ToolStep::default(); MAX_TOOLS],
        }
    }
}

/// What a substep saw in one brick.
pub const MARK_BYTES: usize = 24;
/// Threads of the block that reports: 96 for each number of a mark.
pub const REPORT_THREADS: u32 = 96 * (MARK_BYTES as u32 / 4);

/// Threads of the block that has impulses act on nodes that have moved.
pub const MOBILE_THREADS: u32 = 512;

/// How a step went.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Report {
    pub diverged_at: u32,
    pub speed2: f32,
    pub strain: f32,
    pub swelling: f32,
    pub shrinking: f32,
    pub awake: [u32; sleepers::COUNTS],
    pub vis_viva: f64,
    pub contact_points: u32,
    pub dropped_points: u32,
    pub iterations: u32,
    pub residual: f32,
    pub points: u32,
    pub device_ns: u64,
    pub sums: [ToolSum; MAX_TOOLS],
    pub sequence: u32,
}

impl Report {
    /// Those that a step with so many tools writes.
    pub fn bytes(tools: usize) -> usize {
        offset_of!(Self, sums) + tools * size_of::<ToolSum>() + size_of::<u32>()
    }
}

impl Default for Report {
    fn default() -> Self {
        Self {
            diverged_at: SOUND,
            speed2: 0.0,
            strain: 0.0,
            swelling: 0.0,
            shrinking: 0.0,
            awake: [0; sleepers::COUNTS],
            vis_viva: 0.0,
            contact_points: 0,
            dropped_points: 0,
            iterations: 0,
            residual: 0.0,
            points: 0,
            device_ns: 0,
            sums: [ToolSum::default(); MAX_TOOLS],
            sequence: 0,
        }
    }
}

/// No substep went wrong.
pub const SOUND: u32 = u32::MAX;

/// Bricks that a kernel advances.
pub mod share {
    pub const WHOLE: u32 = 0;
    pub const FIRST: u32 = 1;
    pub const REST: u32 = 2;
}

/// The fields of one simulation on the device.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Pass {
    pub u: CUdeviceptr,
    pub u_next: CUdeviceptr,
    pub v: CUdeviceptr,
    pub v_next: CUdeviceptr,
    pub neighbours: CUdeviceptr,
    pub flags: CUdeviceptr,
    pub laws: CUdeviceptr,
    pub step: CUdeviceptr,
    pub marks: CUdeviceptr,
    pub diverged_at: CUdeviceptr,
    pub started: CUdeviceptr,
    pub cell: f32,
    pub substep: u32,
    pub mark: u32,
    pub share: u32,
    pub near_tools: CUdeviceptr,
    pub acted_on: CUdeviceptr,
    pub near_bricks: CUdeviceptr,
    pub near_counts: CUdeviceptr,
    pub piece_bricks: CUdeviceptr,
    pub pieces: CUdeviceptr,
}

/// Which bricks sleep.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Sleep {
    pub bricks: u32,
    pub speed2: f32,
    pub acceleration2: f32,
    pub wake2: f32,
    pub asleep: CUdeviceptr,
    pub quiet: CUdeviceptr,
    pub nodes_in: CUdeviceptr,
    pub awake: CUdeviceptr,
    pub watched: CUdeviceptr,
    pub counts: CUdeviceptr,
}

/// Places in [`Sleep::counts`].
pub mod sleepers {
    pub const AWAKE: usize = 0;
    pub const WATCHED: usize = 1;
    pub const AWAKE_NODES: usize = 2;
    /// How many there are.
    pub const COUNTS: usize = 3;
}

/// Places in [`Contact::counts`]: how many there are.
pub const COUNTS: usize = 8;

/// Places of a contact point's fields: four numbers each, in an array over the points.
pub mod point {
    pub const NORMAL: usize = 0;
    pub const AT: usize = 1;
    pub const NAMES: usize = 2;
    pub const IMPULSE: usize = 3;
    /// How many there are, and how many of them the host is told.
    pub const FIELDS: usize = 7;
    pub const TOLD: usize = 4;
}

/// What the host is told of a contact point: its first fields.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Touched {
    pub fields: [[f32; 4]; point::TOLD],
}

/// A node that carries sites.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Carrier {
    slot: u32,
    start: u32,
    count: u32,
    name: u32,
}

/// A site on a carrier.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Load {
    site: u32,
    weight: f32,
}

/// Contact of one surface.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Contact {
    pub vertices: u32,
    pub triangles: u32,
    pub first_triangle: u32,
    pub divides: u32,
    pub reach: f32,
    pub rest: CUdeviceptr,
    pub row_nodes: CUdeviceptr,
    pub row_weights: CUdeviceptr,
    pub corners: CUdeviceptr,
    pub parts: CUdeviceptr,
    pub triangle_edges: CUdeviceptr,
    pub vertex_edges: CUdeviceptr,
    pub near_bits: CUdeviceptr,
    pub near: CUdeviceptr,
    pub near_starts: CUdeviceptr,
    pub divisions: CUdeviceptr,
    pub counts: CUdeviceptr,
    pub site_rest: CUdeviceptr,
    pub site_own: CUdeviceptr,
    pub site_edges: CUdeviceptr,
    pub site_names: CUdeviceptr,
    pub site_slots: CUdeviceptr,
    pub site_weights: CUdeviceptr,
    pub site_carriers: CUdeviceptr,
    pub site_coupled: CUdeviceptr,
    pub couplings: CUdeviceptr,
    pub carrier_at: CUdeviceptr,
    pub carriers: CUdeviceptr,
    pub mobility: CUdeviceptr,
    pub loads: CUdeviceptr,
    pub active_loads: CUdeviceptr,
    pub claimed: CUdeviceptr,
    pub moved: CUdeviceptr,
    pub changes: CUdeviceptr,
    pub active_rows: CUdeviceptr,
    pub impulses: CUdeviceptr,
    pub given: CUdeviceptr,
    pub points: CUdeviceptr,
    pub sums: CUdeviceptr,
    pub touched: CUdeviceptr,
}

/// A look at where nodes are.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Look {
    pub places: Places,
    pub u: CUdeviceptr,
    pub nodes: CUdeviceptr,
    pub seen: CUdeviceptr,
    pub bounds: CUdeviceptr,
}

/// How far apart displacements of bricks, of a node along two axes, and of two nodes are, in numbers.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Places {
    pub brick: u32,
    pub axis: u32,
    pub node: u32,
}

impl Places {
    /// Of displacements with words.
    pub const QUADS: Self = Self { brick: 4 * BRICK_SLOTS as u32, axis: 1, node: 4 };
    /// Of fields of three numbers for each node.
    pub const VECTORS: Self = Self { brick: 3 * BRICK_SLOTS as u32, axis: BRICK_SLOTS as u32, node: 1 };
}

/// What was seen of some bricks.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Shown {
    pub bricks: CUdeviceptr,
    pub seen: [CUdeviceptr; 2],
    pub nodes: CUdeviceptr,
}

/// Where and when a projection takes place.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Moment {
    pub from: f32,
    pub to: f32,
    pub is_first: u32,
    pub tissue_moves: u32,
    pub is_last: u32,
}

/// From the model's frame to the world's.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Frame {
    pub turn: [f32; 9],
    pub cell: f32,
}

/// A surface that is shown. World frame.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Surface {
    pub vertices: u32,
    pub strain: u32,
    pub frame: Frame,
    pub u: CUdeviceptr,
    pub rest: CUdeviceptr,
    pub row_nodes: CUdeviceptr,
    pub row_weights: CUdeviceptr,
    pub triangles: CUdeviceptr,
    pub fans: CUdeviceptr,
    pub triangle_of: CUdeviceptr,
    pub positions: CUdeviceptr,
    pub normals: CUdeviceptr,
    pub scalars: CUdeviceptr,
}
