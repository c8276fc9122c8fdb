//! Data that crosses the border. Written for C readers: these comments are the header.
//!
//! Every struct is `repr(C)` without unnamed padding. Structs that start with `struct_size` (descs) and
//! structs whose size follows them in a parameter list (outputs) may grow at their end; all others never
//! change.

// Brackets are array shapes here, in a header's text, and not links.
#![allow(rustdoc::broken_intra_doc_links)]

use std::ffi::{c_char, c_void};

use super::boundary::{Desc, Output};

/// A model: tissue at rest, immutable. Any number of threads and simulations may share it.
#[derive(Debug)]
pub struct plp_model {
    _opaque: [u8; 0],
}

/// A running simulation. One thread at a time.
#[derive(Debug)]
pub struct plp_sim {
    _opaque: [u8; 0],
}

/// A tool of a simulation: the port of one servo thread. Works while the simulation steps on another thread.
#[derive(Debug)]
pub struct plp_tool {
    _opaque: [u8; 0],
}

/// A render surface of a simulation: the port of one render thread. Works while the simulation steps on
/// another thread.
#[derive(Debug)]
pub struct plp_surface {
    _opaque: [u8; 0],
}

// ---- Geometry
// -------------------------------------------------------------------------------------------------------

/// A position and an orientation. A pose "of" a thing maps the thing's frame to the world.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_pose {
    /// Position in metres.
    pub position_m: [f64; 3],
    /// Unit quaternion x, y, z, w; (0, 0, 0, 1) is no rotation. Normalised by the library; refused when its
    /// length is not within 0.9 to 1.1.
    pub rotation: [f64; 4],
}

/// A box that may be turned: the set of points within half_extents_m of the centre along the pose's axes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_box {
    /// Centre and axes.
    pub pose: plp_pose,
    /// Half the edge lengths in metres.
    pub half_extents_m: [f64; 3],
}

/// A bit of plp_fix.axes: the model's x axis.
pub const PLP_AXIS_X: u32 = 1;
/// A bit of plp_fix.axes: the model's y axis.
pub const PLP_AXIS_Y: u32 = 2;
/// A bit of plp_fix.axes: the model's z axis.
pub const PLP_AXIS_Z: u32 = 4;
/// All three axes.
pub const PLP_AXIS_ALL: u32 = 7;

// ---- Callbacks
// ------------------------------------------------------------------------------------------------------

/// Told how far a long call has come: a fraction in [0, 1] and the name of the stage (valid during the
/// callback). Returns 0 to go on, anything else to cancel the call, which then answers PLP_ERR_CANCELLED.
/// Called on the calling thread. Must not throw or longjmp.
pub type plp_progress_fn =
    Option<unsafe extern "C" fn(user: *mut c_void, fraction: f32, stage: *const c_char) -> i32>;

/// Told what the library has to say: PLP_LOG_INFO or PLP_LOG_WARNING, and one line of UTF-8 without a line
/// end (valid during the callback). Called on the thread of, and within, the call that caused the line; never
/// from @rt functions. Must not throw or longjmp.
pub type plp_log_fn = Option<unsafe extern "C" fn(user: *mut c_void, level: i32, line: *const c_char)>;

/// A log line that a curious user wants to know.
pub const PLP_LOG_INFO: i32 = 0;
/// A log line that a user should act on, or know before trusting a result.
pub const PLP_LOG_WARNING: i32 = 1;

// ---- Materials
// ------------------------------------------------------------------------------------------------------

/// An isotropic, linearly elastic material at small strain.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_material {
    /// Young's modulus in Pa, 1 to 1e12.
    pub young_pa: f64,
    /// Poisson's ratio, in [0.25, 0.5).
    pub poisson: f64,
    /// Density in kg/m^3, 1 to 30,000.
    pub density_kg_m3: f64,
    /// Stiffness-proportional damping in seconds, 0 to 1: a spring of stiffness k resists with damping_s * k
    /// times its rate of length.
    pub damping_s: f64,
    /// A name for tables and pictures, UTF-8, ended by NUL.
    pub name: [c_char; 64],
}

/// A material preset and where its numbers come from.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_preset {
    /// The material; its name is the preset's.
    pub material: plp_material,
    /// The publications that the numbers are taken from, UTF-8, ended by NUL.
    pub source: [c_char; 512],
}

// SAFETY: repr(C), 32 + 64 + 512 bytes of doubles and characters.
unsafe impl Output for plp_preset {
    const NAME: &'static str = "plp_preset";
    const FIRST_SIZE: usize = 608;
}

// ---- Models
// ---------------------------------------------------------------------------------------------------------

/// A grid of labels in memory: one integer for each voxel. Copied during the call.
///
/// Voxel (i, j, k) is labels[i + nx * (j + ny * k)]. Its centre lies at frame * (i * sx, j * sy, k * sz), or
/// at index_to_world * (i, j, k, 1).
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_label_grid {
    /// The labels, x fastest.
    pub labels: *const c_void,
    /// Bytes of one label: 1 (uint8_t) or 2 (uint16_t).
    pub label_bytes: u32,
    /// Voxels along x, y, z.
    pub voxels: [u32; 3],
    /// Distance of neighbouring voxel centres along x, y, z in metres, each 1e-6 to 1.
    pub spacing_m: [f64; 3],
    /// The grid's axes, and the centre of voxel (0, 0, 0).
    pub frame: plp_pose,
    /// 12 doubles, 3 rows of 4, to metres: replaces spacing_m and frame. Mirrored axes are welcome, sheared
    /// ones are refused.
    /// @nullable
    pub index_to_world: *const f64,
}

/// The label of CT voxels from low_hu to high_hu.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_hu_range {
    /// Lowest value in Hounsfield units, included.
    pub low_hu: f32,
    /// Highest value in Hounsfield units, included.
    pub high_hu: f32,
    /// The label, up to 65535.
    pub label: u32,
    /// Must be 0.
    pub reserved: u32,
}

/// A label's voxels become nothing: air, gas, outside.
pub const PLP_USE_EMPTY: u32 = 0;
/// A label's voxels become deformable tissue.
pub const PLP_USE_TISSUE: u32 = 1;
/// A label's voxels become a rigid region, such as a bone: held in place until plp_sim_drive_region moves it.
pub const PLP_USE_RIGID: u32 = 2;

/// What the voxels of one label become.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_label_use {
    /// The label, up to 65535.
    pub label: u32,
    /// PLP_USE_EMPTY, PLP_USE_TISSUE or PLP_USE_RIGID.
    pub kind: u32,
    /// The material; not read for PLP_USE_EMPTY. Equal materials of several labels count once; a model has at
    /// most 15.
    pub material: plp_material,
}

/// Nodes that are held: those whose rest position lies in a box.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_fix {
    /// The box.
    pub region: plp_box,
    /// Which axes of the model frame (plp_model_info.frame) are held: PLP_AXIS_X and so on, or'ed.
    pub axes: u32,
    /// Must be 0.
    pub reserved: u32,
}

/// A bit of plp_model_desc.fix_faces: all nodes on the grid's low x face are held.
pub const PLP_FACE_X_LOW: u32 = 1;
/// A bit of plp_model_desc.fix_faces: the high x face.
pub const PLP_FACE_X_HIGH: u32 = 2;
/// A bit of plp_model_desc.fix_faces: the low y face.
pub const PLP_FACE_Y_LOW: u32 = 4;
/// A bit of plp_model_desc.fix_faces: the high y face.
pub const PLP_FACE_Y_HIGH: u32 = 8;
/// A bit of plp_model_desc.fix_faces: the low z face.
pub const PLP_FACE_Z_LOW: u32 = 16;
/// A bit of plp_model_desc.fix_faces: the high z face.
pub const PLP_FACE_Z_HIGH: u32 = 32;

/// A surface is extracted, smoothly, from the labels.
pub const PLP_SURFACE_LABELS: u32 = 0;
/// A surface is a mesh in memory.
pub const PLP_SURFACE_MESH: u32 = 1;
/// A surface is a mesh file: OBJ, STL or PLY.
pub const PLP_SURFACE_FILE: u32 = 2;

/// Where a render surface comes from. A zeroed one is the boundary of everything that is not empty.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_surface_source {
    /// PLP_SURFACE_LABELS, PLP_SURFACE_MESH or PLP_SURFACE_FILE; it says which of the fields below are read.
    pub kind: u32,
    /// LABELS: how many; 0 takes all labels that are not empty.
    pub label_count: u32,
    /// LABELS: the labels whose union's boundary is wanted. @nullable
    pub labels: *const u16,
    /// MESH: x, y, z in metres, world frame.
    pub positions: *const f32,
    /// MESH: texture coordinates u, v. @nullable
    pub uvs: *const f32,
    /// MESH: three vertex indices for each triangle, counter-clockwise seen from outside.
    pub triangles: *const u32,
    /// MESH: how many vertices.
    pub vertex_count: u32,
    /// MESH: how many triangles.
    pub triangle_count: u32,
    /// MESH: bytes from one position to the next; 0 means tightly packed, 12.
    pub position_stride: u32,
    /// MESH: bytes from one texture coordinate to the next; 0 means tightly packed, 8.
    pub uv_stride: u32,
    /// FILE: its path, UTF-8.
    pub path: *const c_char,
    /// FILE: metres for each unit of the file, such as 0.001 for millimetres.
    pub scale_to_m: f64,
}

/// A cell takes the label that fills the largest part of it.
pub const PLP_RESAMPLE_MAJORITY: u32 = 0;
/// A cell takes the label of the voxel at its centre.
pub const PLP_RESAMPLE_NEAREST: u32 = 1;

/// What a model is built from. Fill it with plp_model_desc_init (or plp_model_desc_default), then change what
/// you need.
///
/// The anatomy is the first that is given of grid, labels_path and ct_path; giving two is an error. Without
/// any, it is a generated thorax: lungs with airways and vessels, a tumour, ribs, with materials and fixing
/// of its own, so that a desc of nothing but defaults builds.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_model_desc {
    /// The size of this struct as the caller knows it.
    pub struct_size: u32,
    /// How a cell takes its label from the voxels: PLP_RESAMPLE_MAJORITY (default) or PLP_RESAMPLE_NEAREST.
    pub resample: u32,
    /// Labels in memory. @nullable
    pub grid: *const plp_label_grid,
    /// A label file: NIfTI (.nii, .nii.gz) or NRRD (.nrrd). @nullable
    pub labels_path: *const c_char,
    /// A CT file in Hounsfield units, same formats, made into labels by hu_ranges. @nullable
    pub ct_path: *const c_char,
    /// Ranges of Hounsfield units [hu_range_count]; the first that fits gives the label, none gives 0.
    /// @nullable
    pub hu_ranges: *const plp_hu_range,
    /// What each label becomes [use_count]. Every label that occurs must be named, except for the generated
    /// thorax. @nullable
    pub uses: *const plp_label_use,
    /// Nodes that are held, besides rigid regions [fix_count]. @nullable
    pub fixes: *const plp_fix,
    /// Render surfaces [surface_count], numbered in this order. NULL with a count of 0 makes one surface of
    /// all labels. @nullable
    pub surfaces: *const plp_surface_source,
    /// Number of hu_ranges.
    pub hu_range_count: u32,
    /// Number of uses.
    pub use_count: u32,
    /// Number of fixes.
    pub fix_count: u32,
    /// Number of surfaces.
    pub surface_count: u32,
    /// Faces of the grid whose nodes are held: PLP_FACE_X_LOW and so on, or'ed.
    pub fix_faces: u32,
    /// Which of surfaces tools touch (default 0); -1 extracts one of all labels for it.
    pub contact_surface: i32,
    /// Edge length of a cell in metres; 0 (default) takes the smallest voxel spacing, and 6 mm for the
    /// generated thorax.
    pub cell_m: f64,
    /// Young's moduli above this are lowered to it, in Pa (an explicit step shrinks with the root of the
    /// modulus); 0 (default) for no cap. plp_model_info tells how many materials it met.
    pub young_cap_pa: f64,
    /// Told how far building is, and may cancel it. @nullable
    pub progress: plp_progress_fn,
    /// Given to progress. @nullable
    pub progress_user: *mut c_void,
    /// Told about the finished model. Not called after plp_model_create has returned. @nullable
    pub log: plp_log_fn,
    /// Given to log. @nullable
    pub log_user: *mut c_void,
}

// SAFETY: repr(C), integers, doubles, raw pointers and optional function pointers, 4-byte fields in pairs.
unsafe impl Desc for plp_model_desc {
    const NAME: &'static str = "plp_model_desc";
    const FIRST_SIZE: usize = size_of::<Self>();
    fn with_defaults() -> Self {
        Self {
            struct_size: size_of::<Self>() as u32,
            resample: PLP_RESAMPLE_MAJORITY,
            grid: std::ptr::null(),
            labels_path: std::ptr::null(),
            ct_path: std::ptr::null(),
            hu_ranges: std::ptr::null(),
            uses: std::ptr::null(),
            fixes: std::ptr::null(),
            surfaces: std::ptr::null(),
            hu_range_count: 0,
            use_count: 0,
            fix_count: 0,
            surface_count: 0,
            fix_faces: 0,
            contact_surface: 0,
            cell_m: 0.0,
            young_cap_pa: 0.0,
            progress: None,
            progress_user: std::ptr::null_mut(),
            log: None,
            log_user: std::ptr::null_mut(),
        }
    }
}

/// What a model turned out to be.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_model_info {
    /// Nodes.
    pub node_count: u64,
    /// Occupied cells.
    pub cell_count: u64,
    /// Edge length of a cell in metres.
    pub cell_m: f64,
    /// The model frame: axes along the cells, origin at the grid's lowest corner.
    pub frame: plp_pose,
    /// Lowest corner of the grid's bounding box, world axes, metres.
    pub bounds_min_m: [f64; 3],
    /// Highest corner.
    pub bounds_max_m: [f64; 3],
    /// The cap on Young's modulus in Pa, 0 for none.
    pub young_cap_pa: f64,
    /// How many materials the cap lowered.
    pub capped_material_count: u32,
    /// Materials; in contacts, picks and surface views they are numbered from 1.
    pub material_count: u32,
    /// Surfaces; the desc's, and one more when contact needed one of its own.
    pub surface_count: u32,
    /// The surface that tools touch.
    pub contact_surface: u32,
    /// Cells of the bounding grid along x, y, z of the model frame.
    pub cells: [u32; 3],
    /// Always 0.
    pub reserved: u32,
}

// SAFETY: repr(C), 8-byte fields first, then eight 4-byte ones.
unsafe impl Output for plp_model_info {
    const NAME: &'static str = "plp_model_info";
    const FIRST_SIZE: usize = size_of::<Self>();
}

// ---- Simulations
// ----------------------------------------------------------------------------------------------------

/// Steps compute in 32-bit floating point.
pub const PLP_PRECISION_SINGLE: u32 = 0;
/// Steps compute in 64-bit floating point.
pub const PLP_PRECISION_DOUBLE: u32 = 1;

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
    /// PLP_PRECISION_SINGLE (default) or PLP_PRECISION_DOUBLE.
    pub precision: u32,
    /// Threads that compute a step, the calling one included; 0 (default) takes one for each core. Leave a
    /// core to a servo thread.
    pub threads: u32,
    /// Simulated length of a step in seconds (default 0.001).
    pub step_s: f64,
    /// Gravity in m/s^2, world frame (default 0).
    pub gravity_m_s2: [f64; 3],
    /// Background drag in 1/s (default 5): every node loses this part of its momentum each second.
    pub drag_per_s: f64,
    /// Substeps in a step; 0 (default) takes what the stable step asks for, and more when strain demands it.
    pub substeps: u32,
    /// Must be 0.
    pub reserved: u32,
    /// Told about the simulation, within the calls that cause it. @nullable
    pub log: plp_log_fn,
    /// Given to log. @nullable
    pub log_user: *mut c_void,
}

// SAFETY: repr(C), integers, doubles, a raw pointer and an optional function pointer, 4-byte fields in pairs.
unsafe impl Desc for plp_sim_desc {
    const NAME: &'static str = "plp_sim_desc";
    const FIRST_SIZE: usize = size_of::<Self>();
    fn with_defaults() -> Self {
        let defaults = crate::sim::SimDesc::default();
        let flag = |on: bool, bit: u32| if on { bit } else { 0 };
        Self {
            struct_size: size_of::<Self>() as u32,
            flags: flag(defaults.sleeping, PLP_SIM_SLEEPING)
                | flag(defaults.rest_under_gravity, PLP_SIM_REST_UNDER_GRAVITY),
            precision: PLP_PRECISION_SINGLE,
            threads: defaults.threads as u32,
            step_s: defaults.step_s,
            gravity_m_s2: defaults.gravity_m_s2.into(),
            drag_per_s: defaults.drag_per_s,
            substeps: defaults.substeps.unwrap_or(0),
            reserved: 0,
            log: None,
            log_user: std::ptr::null_mut(),
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
    const FIRST_SIZE: usize = size_of::<Self>();
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
    /// Largest stable substep at rest in seconds, damping included.
    pub stable_substep_s: f64,
    /// Wall-clock time of the last step in seconds.
    pub step_wall_s: f64,
    /// Simulated time over wall-clock time of the last step: at least 1 keeps up with the world.
    pub real_time_factor: f64,
    /// All nodes.
    pub node_count: u64,
    /// Nodes integrated in the last substep.
    pub awake_node_count: u64,
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
}

// SAFETY: repr(C), 8-byte fields and one pair of 4-byte ones.
unsafe impl Output for plp_statistics {
    const NAME: &'static str = "plp_statistics";
    const FIRST_SIZE: usize = size_of::<Self>();
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
    const FIRST_SIZE: usize = size_of::<Self>();
}

/// Rest positions of nodes in metres, world frame.
pub const PLP_NODES_REST_POSITION: u32 = 0;
/// Displacements of nodes in metres, world axes.
pub const PLP_NODES_DISPLACEMENT: u32 = 1;
/// Velocities of nodes in m/s, world axes.
pub const PLP_NODES_VELOCITY: u32 = 2;

// ---- Tools
// ----------------------------------------------------------------------------------------------------------

/// A ball of radius_m.
pub const PLP_SHAPE_SPHERE: u32 = 0;
/// A ball of radius_m swept along local z, over half_length_m both ways.
pub const PLP_SHAPE_CAPSULE: u32 = 1;
/// A box of half_extents_m whose edges are rounded by radius_m.
pub const PLP_SHAPE_BOX: u32 = 2;

/// A shape of a tool. Sizes lie between 1e-5 m and 1 m.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_tool_part {
    /// PLP_SHAPE_SPHERE, PLP_SHAPE_CAPSULE or PLP_SHAPE_BOX.
    pub kind: u32,
    /// Must be 0.
    pub reserved: u32,
    /// The shape's place in the tool's frame.
    pub pose: plp_pose,
    /// SPHERE, CAPSULE: the radius in metres. BOX: the radius of its edges, above 0 and at most the smallest
    /// half extent.
    pub radius_m: f64,
    /// CAPSULE: half the length of the swept segment in metres, caps not counted.
    pub half_length_m: f64,
    /// BOX: half the edge lengths in metres, rounding included.
    pub half_extents_m: [f64; 3],
}

/// A tool: a rigid compound of shapes. Fill it with plp_tool_desc_init (or plp_tool_desc_default), then give
/// it parts.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_tool_desc {
    /// The size of this struct as the caller knows it.
    pub struct_size: u32,
    /// Number of parts, 1 to 16.
    pub part_count: u32,
    /// The shapes [part_count].
    pub parts: *const plp_tool_part,
    /// Coulomb friction coefficient between tool and tissue, at least 0 (default 0).
    pub friction: f64,
}

// SAFETY: repr(C), two integers, a raw pointer, a double.
unsafe impl Desc for plp_tool_desc {
    const NAME: &'static str = "plp_tool_desc";
    const FIRST_SIZE: usize = size_of::<Self>();
    fn with_defaults() -> Self {
        Self { struct_size: size_of::<Self>() as u32, part_count: 0, parts: std::ptr::null(), friction: 0.0 }
    }
}

/// Where a tool is and how it moves.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_motion {
    /// The tool's pose.
    pub pose: plp_pose,
    /// Velocity of the tool's origin in m/s, world frame. Contact takes the velocity from successive poses; this
    /// one and the next are kept with the force.
    pub linear_m_s: [f64; 3],
    /// Angular velocity in rad/s, world frame.
    pub angular_rad_s: [f64; 3],
}

/// What a tool feels: the tissue's reaction, averaged over the last step.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_force {
    /// Force of the tissue on the tool in N, world frame.
    pub force_n: [f64; 3],
    /// Torque of the tissue on the tool about the tool's origin in N m, world frame.
    pub torque_n_m: [f64; 3],
    /// The motion that both were computed at.
    pub motion: plp_motion,
    /// Simulated time at the end of that step in seconds.
    pub time_s: f64,
    /// Counts steps; 0 before the first one.
    pub sequence: u64,
}

/// A touched point of the tissue's surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_contact {
    /// Where, world frame, metres.
    pub point_m: [f64; 3],
    /// Unit normal of the tool there, pointing into the tissue.
    pub normal: [f64; 3],
    /// How deep the point would have been inside the tool without contact, in metres.
    pub depth_m: f64,
    /// Force on the tissue at this point in N.
    pub force_n: [f64; 3],
    /// Material of the tissue, from 1.
    pub material: u32,
    /// Always 0.
    pub reserved: u32,
}

// ---- Surfaces
// -------------------------------------------------------------------------------------------------------

/// A surface's scalar is the length of the displacement in metres.
pub const PLP_FIELD_DISPLACEMENT: u32 = 0;
/// A surface's scalar is the largest principal strain under the vertex.
pub const PLP_FIELD_STRAIN: u32 = 1;

/// One frame of a surface, world frame. The arrays belong to the library and are valid until
/// plp_surface_unmap; positions, normals and previous positions are aligned to 16 bytes. Vertex streams are
/// float, because renderers take float; poses and forces are double.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_surface_view {
    /// x, y, z in metres and 1 [vertex_count * 4].
    pub positions: *const f32,
    /// Unit normals and 0 [vertex_count * 4].
    pub normals: *const f32,
    /// The positions of the frame that this port mapped before, for motion vectors [vertex_count * 4].
    pub previous_positions: *const f32,
    /// The field chosen with plp_surface_set_field [vertex_count].
    pub scalars: *const f32,
    /// Texture coordinates u, v [vertex_count * 2].
    pub uvs: *const f32,
    /// Materials, from 1 [vertex_count].
    pub materials: *const u8,
    /// Vertex indices, counter-clockwise seen from outside [triangle_count * 3].
    pub triangles: *const u32,
    /// Number of vertices.
    pub vertex_count: u64,
    /// Number of triangles.
    pub triangle_count: u64,
    /// Changes whenever vertex_count or triangles do; 0 until the first cut.
    pub topology_version: u64,
    /// Simulated time of the frame in seconds.
    pub time_s: f64,
}

// SAFETY: repr(C), pointers and 8-byte numbers.
unsafe impl Output for plp_surface_view {
    const NAME: &'static str = "plp_surface_view";
    const FIRST_SIZE: usize = size_of::<Self>();
}
