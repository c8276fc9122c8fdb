//! What a model is built from, and what it turned out to be.

use std::ffi::{c_char, c_void};
use std::mem::offset_of;

use super::super::boundary::{Desc, Output};
use super::{plp_box, plp_log_fn, plp_material, plp_pose, plp_progress_fn};

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

/// A surface is extracted from the labels and smoothed: it runs within half a cell of their border, which it
/// does not follow exactly. Where that matters, give a mesh.
pub const PLP_SURFACE_LABELS: u32 = 0;
/// A surface is a mesh in memory.
pub const PLP_SURFACE_MESH: u32 = 1;
/// A surface is a mesh file: OBJ, STL or PLY.
pub const PLP_SURFACE_FILE: u32 = 2;

/// Where a render surface comes from. A zeroed one is the smoothed boundary of everything that is not empty.
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
/// The anatomy is the one that is given of grid, labels_path, ct_path and solid; giving two is an error. Without
/// any, it is a generated thorax: lungs with airways and vessels, a tumour, ribs, with materials and fixing
/// of its own, so that a desc of nothing but defaults builds. It fills a box of 0.30 x 0.20 x 0.24 m around the
/// origin, x to the right of the body, y to its front, z to its head; at (0, y, -0.06) its skin is met
/// at y = 0.096 with cells of 6 mm, the default, and up to a centimetre further out with others; plp_sim_pick finds it.
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
    /// Told about the finished model, with warnings about materials that the cap lowered and about loose pieces of
    /// tissue: specks that are joined to nothing and held nowhere. These are kept, and move as free bodies. Not
    /// called after plp_model_create has returned. @nullable
    pub log: plp_log_fn,
    /// Given to log. @nullable
    pub log_user: *mut c_void,
    /// A closed mesh, PLP_SURFACE_MESH or PLP_SURFACE_FILE: cells of cell_m (which must be given) whose centres it winds around have label
    /// 1, those around it label 0, which is empty unless uses says otherwise. Triangles may face outwards or inwards, all of them alike; a shell
    /// in another that faces the other way is a cavity. A mesh with a hole is refused. It is no render surface by itself: name it among surfaces as
    /// well where it shall be one. @nullable
    pub solid: *const plp_surface_source,
}

// SAFETY: repr(C), integers, doubles, raw pointers and optional function pointers, 4-byte fields in pairs.
unsafe impl Desc for plp_model_desc {
    const NAME: &'static str = "plp_model_desc";
    const FIRST_SIZE: usize = offset_of!(Self, log_user) + size_of::<*mut c_void>();
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
            solid: std::ptr::null(),
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
    /// Lowest corner of the grid's bounding box, world axes, metres. Smoothed surfaces may reach half a cell
    /// beyond it.
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
    const FIRST_SIZE: usize = offset_of!(Self, reserved) + size_of::<u32>();
}
