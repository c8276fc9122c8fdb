//! Data that crosses the border. Written for C readers: these comments are the header.
//!
//! Every struct is `repr(C)` without unnamed padding. Structs that start with `struct_size` (descs) and
//! structs whose size follows them in a parameter list (outputs) may grow at their end; all others never
//! change.
//!
//! | file | subject |
//! |---|---|
//! | this one | handles, geometry, callbacks, materials |
//! | `model`, `device`, `sim`, `drive`, `tool`, `cut`, `servo`, `surface` | what the functions of one noun take and give |

// Brackets are array shapes here, in a header's text, and not links.
#![allow(rustdoc::broken_intra_doc_links)]

use std::ffi::{c_char, c_void};
use std::mem::offset_of;

use super::boundary::Output;

mod cut;
mod device;
mod drive;
mod model;
mod servo;
mod sim;
mod surface;
mod tool;

pub use self::cut::*;
pub use self::device::*;
pub use self::drive::*;
pub use self::model::*;
pub use self::servo::*;
pub use self::sim::*;
pub use self::surface::*;
pub use self::tool::*;

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

/// What a simulation was at one instant. Immutable; any number of threads and simulations may share it.
#[derive(Debug)]
pub struct plp_snapshot {
    _opaque: [u8; 0],
}

// ---- Geometry
// --------------------------------------------------------------------------------------------------------------

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
// --------------------------------------------------------------------------------------------------------------

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
// --------------------------------------------------------------------------------------------------------------

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
    /// Stiffness-proportional damping in seconds, 0 (as in presets) to 1: a spring of stiffness k resists with
    /// damping_s * k times its rate of length. It shortens the stable substep.
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
    /// The publications that the numbers are taken from, and which of them are estimates, UTF-8, ended by NUL.
    pub source: [c_char; 512],
}

// SAFETY: repr(C), 32 + 64 + 512 bytes of doubles and characters.
unsafe impl Output for plp_preset {
    const NAME: &'static str = "plp_preset";
    const FIRST_SIZE: usize = offset_of!(Self, source) + size_of::<[c_char; 512]>();
}
