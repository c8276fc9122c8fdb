//! A simulation's own thread, and what it tells its owner.

use std::ffi::c_void;
use std::mem::offset_of;

use super::super::boundary::{Desc, Output};

/// Called on the simulation's own thread.
pub type plp_thread_fn = Option<unsafe extern "C" fn(user: *mut c_void)>;

/// How a simulation's own thread runs. Fill it with plp_thread_desc_init (or plp_thread_desc_default), then change what you need.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_thread_desc {
    /// The size of this struct as the caller knows it.
    pub struct_size: u32,
    /// Must be 0.
    pub reserved: u32,
    /// The first thing on the thread: set its priority and affinity here. @nullable
    pub on_start: plp_thread_fn,
    /// The last thing on it. @nullable
    pub on_stop: plp_thread_fn,
    /// Given to both. @nullable
    pub user: *mut c_void,
    /// How much lateness is made up for at most, in s (default 0.02); what is beyond is let go.
    pub longest_lag_s: f64,
}

// SAFETY: repr(C), two integers, pointers, a double.
unsafe impl Desc for plp_thread_desc {
    const NAME: &'static str = "plp_thread_desc";
    const FIRST_SIZE: usize = offset_of!(Self, longest_lag_s) + size_of::<f64>();
    fn with_defaults() -> Self {
        Self {
            struct_size: size_of::<Self>() as u32,
            reserved: 0,
            on_start: None,
            on_stop: None,
            user: std::ptr::null_mut(),
            longest_lag_s: crate::sim::ThreadDesc::default().longest_lag_s,
        }
    }
}

/// The simulation diverged: its tools feel nothing until plp_sim_reset. On its own thread it is paused.
pub const PLP_EVENT_DIVERGED: u32 = 1;
/// The GPU was lost: the simulation can only be destroyed.
pub const PLP_EVENT_DEVICE_LOST: u32 = 2;
/// The simulation's own thread fell so far behind that it let `value` seconds go.
pub const PLP_EVENT_FELL_BEHIND: u32 = 3;
/// The servo of a tool's device has not called for a fifth of a second: the tool stands where it was.
pub const PLP_EVENT_SERVO_SILENT: u32 = 4;
/// The buttons of a tool's device have changed, to `buttons`.
pub const PLP_EVENT_BUTTONS: u32 = 5;
/// A cut of a tool's blade was refused: the room of plp_sim_desc.cut_nodes is spent. Told once for each tool, until a reset.
pub const PLP_EVENT_CUT_REFUSED: u32 = 6;
/// Surface number `value` does not show the last cuts: it is not closed where they meet it, or its room is spent. The tissue is cut all the same. Told once, until it follows.
pub const PLP_EVENT_SURFACE_BEHIND: u32 = 7;

/// Something that happened while the simulation ran.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_event {
    /// A PLP_EVENT_ value; later versions may have more.
    pub kind: u32,
    /// BUTTONS: all buttons now, a bit each.
    pub buttons: u32,
    /// Simulated time in s.
    pub time_s: f64,
    /// FELL_BEHIND: how much wall-clock time was let go since that was last told, half a second ago or longer, in s. SURFACE_BEHIND: the
    /// surface.
    pub value: f64,
    /// SERVO_SILENT, BUTTONS, CUT_REFUSED: plp_tool_get_id of the tool; 0 for all others.
    pub tool_id: u64,
}

// SAFETY: repr(C), integers in pairs, doubles.
unsafe impl Output for plp_event {
    const NAME: &'static str = "plp_event";
    const FIRST_SIZE: usize = offset_of!(Self, tool_id) + size_of::<u64>();
}
