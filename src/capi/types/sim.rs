//! How a simulation runs, what acts on it, and how it is doing.

use std::ffi::c_void;
use std::mem::offset_of;

use super::super::boundary::{Desc, Output};
use super::{PLP_BACKEND_CPU, plp_box, plp_log_fn, plp_pose};
use crate::solver::method::EfgDesc;

/// Steps compute in 32-bit floating point.
pub const PLP_PRECISION_SINGLE: u32 = 0;
/// Steps compute in 64-bit floating point.
pub const PLP_PRECISION_DOUBLE: u32 = 1;

/// The calibrated lattice of springs computes the tissue, by explicit substeps.
pub const PLP_METHOD_LATTICE: u32 = 0;
/// The meshless (element-free Galerkin) model computes the tissue, by implicit steps.
pub const PLP_METHOD_EFG: u32 = 1;

/// Hooke's law in axes that turn with each cell.
pub const PLP_ELASTICITY_COROTATED: u32 = 0;
/// Hooke's law for small rotations: tissue that turns is strained.
pub const PLP_ELASTICITY_LINEAR: u32 = 1;
/// Hooke's law between Green's strain and the second Piola-Kirchhoff stress.
pub const PLP_ELASTICITY_ST_VENANT_KIRCHHOFF: u32 = 2;

/// Backward Euler: stable for any step, damps what swings faster than the step.
pub const PLP_SCHEME_BACKWARD_EULER: u32 = 0;
/// The scheme as Magnoux and Ozell (2021) print it: stable for any step, damps nothing.
pub const PLP_SCHEME_PAPER: u32 = 1;

/// A bit of plp_sim_desc.flags (default on): quiet regions fall asleep and stay as anchors.
pub const PLP_SIM_SLEEPING: u32 = 1;
/// A bit of plp_sim_desc.flags (default on): the model's rest shape already balances gravity_m_s2, so that
/// nothing sags at the start.
pub const PLP_SIM_REST_UNDER_GRAVITY: u32 = 2;

/// How a simulation runs. Fill it with plp_sim_desc_init (or plp_sim_desc_default), then change what you
/// need.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_sim_desc {
    /// The size of this struct as the caller knows it.
    pub struct_size: u32,
    /// PLP_SIM_SLEEPING and so on, or'ed.
    pub flags: u32,
    /// Where it runs: PLP_BACKEND_CPU (default), PLP_BACKEND_CUDA or PLP_BACKEND_AUTO.
    pub backend: u32,
    /// CUDA: which GPU, from 0 to plp_device_count() - 1; -1 (default) takes the first that can. -1 for all others.
    pub device: i32,
    /// PLP_PRECISION_SINGLE (default) or PLP_PRECISION_DOUBLE.
    pub precision: u32,
    /// Threads of the processor that compute a step, the calling one included; 0 (default) takes one for each core. Leave a
    /// core to a servo thread.
    pub threads: u32,
    /// Simulated length of a step in seconds (default 0.001).
    pub step_s: f64,
    /// Gravity in m/s^2, world frame (default 0).
    pub gravity_m_s2: [f64; 3],
    /// Background drag in 1/s (default 5): every node loses this part of its momentum each second.
    pub drag_per_s: f64,
    /// Substeps in a step; 0 (default) takes what the stable step asks for, and more when strain demands it. EFG: 0 is one.
    pub substeps: u32,
    /// Must be 0.
    pub reserved: u32,
    /// Told about the simulation, within the calls that cause it. @nullable
    pub log: plp_log_fn,
    /// Given to log. @nullable
    pub log_user: *mut c_void,
    /// What computes the tissue: PLP_METHOD_LATTICE (default) or PLP_METHOD_EFG.
    pub method: u32,
    /// EFG: how tissue answers to strain, PLP_ELASTICITY_COROTATED (default) and so on.
    pub elasticity: u32,
    /// EFG: how a step is taken, PLP_SCHEME_BACKWARD_EULER (default) or PLP_SCHEME_PAPER.
    pub scheme: u32,
    /// EFG: most iterations of a step (default 500); what was reached by then stands, and plp_statistics says so.
    pub max_iterations: u32,
    /// EFG: a step's solution is good enough when its true residual is this share of what it was before (default 0.001).
    pub tolerance: f64,
    /// Room for cuts: copies of nodes that they may make in all, some two for each cell that a blade passes; surfaces get room alike. 0 (default): tissue cannot be
    /// cut. A cut whose cells fall into more pieces than that is refused too.
    pub cut_nodes: u64,
    /// Parts that a cut severs, that nothing holds, and that are smaller than so many cells of the grid are removed with the cut, 0 to 1000; with 0 all stay. 1 (default) is what the grid resolves.
    /// plp_statistics.removed_kg counts them.
    pub least_part_cells: f64,
}

// SAFETY: repr(C), integers, doubles, a raw pointer and an optional function pointer, 4-byte fields in pairs.
unsafe impl Desc for plp_sim_desc {
    const NAME: &'static str = "plp_sim_desc";
    const FIRST_SIZE: usize = offset_of!(Self, log_user) + size_of::<*mut c_void>();
    fn with_defaults() -> Self {
        let defaults = crate::sim::SimDesc::default();
        let efg = EfgDesc::default();
        let flag = |on: bool, bit: u32| if on { bit } else { 0 };
        Self {
            struct_size: size_of::<Self>() as u32,
            flags: flag(defaults.sleeping, PLP_SIM_SLEEPING)
                | flag(defaults.rest_under_gravity, PLP_SIM_REST_UNDER_GRAVITY),
            backend: PLP_BACKEND_CPU,
            device: -1,
            precision: PLP_PRECISION_SINGLE,
            threads: defaults.threads as u32,
            step_s: defaults.step_s,
            gravity_m_s2: defaults.gravity_m_s2.into(),
            drag_per_s: defaults.drag_per_s,
            substeps: defaults.substeps.unwrap_or(0),
            reserved: 0,
            log: None,
            log_user: std::ptr::null_mut(),
            method: PLP_METHOD_LATTICE,
            elasticity: PLP_ELASTICITY_COROTATED,
            scheme: PLP_SCHEME_BACKWARD_EULER,
            max_iterations: efg.max_iterations,
            tolerance: efg.tolerance,
            cut_nodes: 0,
            least_part_cells: defaults.least_part_cells,
        }
    }
}

/// A force at a material point.
pub const PLP_LOAD_POINT: u32 = 0;
/// A force per rest area on boundary faces of cells, of constant direction.
pub const PLP_LOAD_TRACTION: u32 = 1;
/// A pressure on boundary faces of cells; it pushes against the outward normal and follows the deformed
/// surface.
pub const PLP_LOAD_PRESSURE: u32 = 2;

/// A load that acts until it is removed. Fill it with plp_load_init (or plp_load_default), then set what its
/// kind needs.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_load {
    /// The size of this struct as the caller knows it.
    pub struct_size: u32,
    /// PLP_LOAD_POINT, PLP_LOAD_TRACTION or PLP_LOAD_PRESSURE.
    pub kind: u32,
    /// POINT: the rest position in metres, inside the tissue, world frame.
    pub at_m: [f64; 3],
    /// POINT: the force in N, world frame.
    pub force_n: [f64; 3],
    /// TRACTION: force per area in Pa, world frame.
    pub traction_pa: [f64; 3],
    /// PRESSURE: in Pa; negative pulls.
    pub pressure_pa: f64,
    /// TRACTION, PRESSURE: the boundary faces whose rest centres lie in this box.
    pub region: plp_box,
}

// SAFETY: repr(C), two integers, then doubles.
unsafe impl Desc for plp_load {
    const NAME: &'static str = "plp_load";
    const FIRST_SIZE: usize = offset_of!(Self, region) + size_of::<plp_box>();
    fn with_defaults() -> Self {
        Self {
            struct_size: size_of::<Self>() as u32,
            kind: PLP_LOAD_POINT,
            at_m: [0.0; 3],
            force_n: [0.0; 3],
            traction_pa: [0.0; 3],
            pressure_pa: 0.0,
            region: plp_box {
                pose: plp_pose { position_m: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] },
                half_extents_m: [0.0; 3],
            },
        }
    }
}

/// What a ray met.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_pick {
    /// Where, world frame, metres.
    pub point_m: [f64; 3],
    /// Outward unit normal of the triangle there.
    pub normal: [f64; 3],
    /// Distance along the ray in metres.
    pub distance_m: f64,
    /// The triangle of the contact surface.
    pub triangle: u32,
    /// Material of the tissue, from 1.
    pub material: u32,
}

/// How a simulation is doing.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_statistics {
    /// Steps since creation.
    pub steps: u64,
    /// Substeps since creation.
    pub substeps: u64,
    /// Simulated time in seconds.
    pub time_s: f64,
    /// Length of the last substep in seconds.
    pub substep_s: f64,
    /// Largest stable substep at rest in seconds, damping included; infinite where steps are implicit.
    pub stable_substep_s: f64,
    /// Wall-clock time of the last step in seconds: from the call, waiting for a surface that is being mapped included, until
    /// the forces can be read. plp_sim_get_latency counts these times.
    pub step_wall_s: f64,
    /// How long the device was at work on the last step, in seconds: on a GPU by its own clock (which may tick but once in a
    /// microsecond), from the start of the first kernel until the report; on the processor wall-clock time. The rest of
    /// step_wall_s is spent on asking and answering.
    pub step_device_s: f64,
    /// Simulated time over wall-clock time of the last step: at least 1 keeps up with the world.
    pub real_time_factor: f64,
    /// All nodes.
    pub node_count: u64,
    /// Nodes integrated in the last substep.
    pub awake_node_count: u64,
    /// Bricks of 8 x 4 x 4 places for nodes that were integrated in the last substep.
    pub awake_brick_count: u64,
    /// Bytes held for the nodes' state and topology.
    pub node_bytes: u64,
    /// Largest |1 - L/l| of a spring along a cell's edge in the last substep, l being its length and L its rest length.
    pub max_strain: f64,
    /// Smallest volume ratio of a cell with a Poisson ratio above 1/4 in the last substep; 1 is undeformed, at most 0 is
    /// inside out.
    pub min_volume_ratio: f64,
    /// Largest volume ratio of such a cell in the last substep.
    pub max_volume_ratio: f64,
    /// Substeps in the last step.
    pub substeps_per_step: u32,
    /// Surface points in contact in the last substep.
    pub contact_point_count: u32,
    /// Surface points in tools since creation that were left out, because more were touched at once than there is room
    /// for. A force is then too small.
    pub dropped_point_count: u64,
    /// Bytes copied from the host to the GPU since creation, that included; 0 on the processor.
    pub bytes_to_device: u64,
    /// Bytes copied from the GPU to the host since creation, what it reports of each step included; 0 on the processor.
    pub bytes_to_host: u64,
    /// Steps of the simulation's own thread that ended after the next one was due.
    pub overrun_count: u64,
    /// Wall-clock time that this thread has let go because it fell too far behind, in seconds.
    pub dropped_s: f64,
    /// Events that found no room because nobody read them.
    pub dropped_event_count: u64,
    /// EFG: share of its first residual that the last step's solution left, computed from what was found.
    pub true_residual: f64,
    /// EFG: iterations of the last step's solution.
    pub cg_iterations: u32,
    /// 0.
    pub reserved: u32,
    /// Wall-clock time that cutting took in the last step, in seconds; part of step_wall_s.
    pub cut_wall_s: f64,
    /// Cells that cuts have divided.
    pub divided_cell_count: u64,
    /// Copies of nodes that cuts have made, of the room of plp_sim_desc.cut_nodes.
    pub copy_count: u64,
    /// Volume at rest of the tissue that was removed since the last reset, in m^3: what is left of the parts and this is what the model had.
    pub removed_m3: f64,
    /// Mass of that tissue in kg.
    pub removed_kg: f64,
}

// SAFETY: repr(C), 8-byte fields and two pairs of 4-byte ones.
unsafe impl Output for plp_statistics {
    const NAME: &'static str = "plp_statistics";
    const FIRST_SIZE: usize = offset_of!(Self, dropped_event_count) + size_of::<u64>();
}

/// Buckets of plp_latency.
pub const PLP_LATENCY_BUCKETS: usize = 82;

/// How long the steps of a simulation took, from the call until the forces could be read. Quantiles are the ends of buckets: up
/// to 19 % too long, never too short, and nothing longer than max_s. All are 0 before the first step.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_latency {
    /// Steps that were counted: those that ended well.
    pub step_count: u64,
    /// Half of all steps took no longer, in seconds.
    pub p50_s: f64,
    /// 99 of 100 took no longer.
    pub p99_s: f64,
    /// 999 of 1000 took no longer.
    pub p999_s: f64,
    /// The longest.
    pub max_s: f64,
    /// Steps that took less than a microsecond; for i from 1 to 80, at least 2^((i-1)/4) and less than 2^(i/4)
    /// microseconds; and, last, 2^20 microseconds or more.
    pub counts: [u64; PLP_LATENCY_BUCKETS],
}

// SAFETY: repr(C), 8-byte fields.
unsafe impl Output for plp_latency {
    const NAME: &'static str = "plp_latency";
    const FIRST_SIZE: usize = offset_of!(Self, counts) + size_of::<[u64; PLP_LATENCY_BUCKETS]>();
}

/// Energies in J, computed in double precision when asked for.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_energy {
    /// Kinetic energy.
    pub kinetic_j: f64,
    /// Elastic energy of springs and volume terms.
    pub elastic_j: f64,
    /// Potential energy under the gravity in force; balanced gravity counts as none.
    pub gravity_j: f64,
    /// Work that tools have done on the tissue since creation.
    pub tool_work_j: f64,
}

// SAFETY: repr(C), doubles.
unsafe impl Output for plp_energy {
    const NAME: &'static str = "plp_energy";
    const FIRST_SIZE: usize = offset_of!(Self, tool_work_j) + size_of::<f64>();
}

/// Rest positions of nodes in metres, world frame.
pub const PLP_NODES_REST_POSITION: u32 = 0;
/// Displacements of nodes in metres, world axes.
pub const PLP_NODES_DISPLACEMENT: u32 = 1;
/// Velocities of nodes in m/s, world axes.
pub const PLP_NODES_VELOCITY: u32 = 2;
