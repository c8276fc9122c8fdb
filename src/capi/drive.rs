//! A simulation's own thread: start, pause, stop, and the events that it tells.

use std::ffi::c_void;

use super::boundary::{Desc, boundary, check_output, init_desc, read_desc, write_output};
use super::convert::check_bits;
use super::sim::{with_any_sim, with_sim};
use super::status::{PLP_NOTHING, PLP_OK, plp_status};
use super::types::*;
use crate::sim::{Event, Hook, ThreadDesc, ToolId};

/// Fills a desc with defaults. desc_size is sizeof(plp_thread_desc).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_thread_desc_init(desc: *mut plp_thread_desc, desc_size: u32) -> plp_status {
    // SAFETY: the host offers `desc_size` bytes.
    boundary(|| unsafe { init_desc(desc, desc_size) })
}

/// Has a thread of the simulation's own step at the wall clock's pace, one step in each plp_sim_desc.step_s, until plp_sim_stop or
/// plp_sim_destroy. plp_sim_step answers PLP_ERR_STATE meanwhile. All other calls work as before: those of the owner, and plp_surface_map, wait
/// for the step in progress; those of servo threads never wait. desc may be NULL for defaults (@nullable desc).
///
/// A simulation that fails on it pauses: its tools feel nothing, and plp_sim_poll_event says why. The log is told nothing from this thread.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_start(sim: *mut plp_sim, desc: *const plp_thread_desc) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            let desc = if desc.is_null() {
                plp_thread_desc::with_defaults()
            } else {
                // SAFETY: the host's desc is as long as it says.
                unsafe { read_desc(desc) }?
            };
            check_bits(desc.reserved, 0, "plp_thread_desc.reserved")?;
            body.sim.start(ThreadDesc {
                on_start: hook(desc.on_start, desc.user),
                on_stop: hook(desc.on_stop, desc.user),
                longest_lag_s: desc.longest_lag_s,
            })?;
            Ok(PLP_OK)
        })
    })
}

/// Holds the simulation's own thread after the step in progress. Time that passes meanwhile is not made up for.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_pause(sim: *mut plp_sim) -> plp_status {
    boundary(|| with_sim(sim, |body| Ok(body.sim.set_paused(true).map(|()| PLP_OK)?)))
}

/// Lets it go on.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_resume(sim: *mut plp_sim) -> plp_status {
    boundary(|| with_sim(sim, |body| Ok(body.sim.set_paused(false).map(|()| PLP_OK)?)))
}

/// Ends the simulation's own thread, after the step in progress; from then on plp_sim_step steps. Fine where there is none.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_stop(sim: *mut plp_sim) -> plp_status {
    boundary(|| with_sim(sim, |body| Ok(body.sim.stop().map(|()| PLP_OK)?)))
}

/// The oldest event that was not read yet, or PLP_NOTHING. At most 256 wait; plp_statistics.dropped_event_count counts those beyond. event_size
/// is sizeof(plp_event).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_poll_event(
    sim: *mut plp_sim,
    event: *mut plp_event,
    event_size: u32,
) -> plp_status {
    boundary(|| {
        // Also where the device is lost or the thread broke: that is what there is to read.
        with_any_sim(sim, |body| {
            check_output(event, event_size)?;
            let Some(found) = body.sim.poll_event() else { return Ok(PLP_NOTHING) };
            // SAFETY: checked above; the host offers `event_size` bytes.
            unsafe { write_output(event, event_size, &event_out(&found, |tool| body.id_of(tool))) };
            Ok(PLP_OK)
        })
    })
}

fn event_out(event: &Event, id_of: impl Fn(ToolId) -> u64) -> plp_event {
    let plain = |kind: u32, time_s: f64| plp_event { kind, buttons: 0, time_s, value: 0.0, tool_id: 0 };
    match *event {
        Event::Diverged { time_s } => plain(PLP_EVENT_DIVERGED, time_s),
        Event::DeviceLost { time_s } => plain(PLP_EVENT_DEVICE_LOST, time_s),
        Event::FellBehind { time_s, dropped_s } => {
            plp_event { value: dropped_s, ..plain(PLP_EVENT_FELL_BEHIND, time_s) }
        }
        Event::ServoSilent { time_s, tool } => {
            plp_event { tool_id: id_of(tool), ..plain(PLP_EVENT_SERVO_SILENT, time_s) }
        }
        Event::SurfaceBehind { time_s, surface } => {
            plp_event { value: surface as f64, ..plain(PLP_EVENT_SURFACE_BEHIND, time_s) }
        }
        Event::CutRefused { time_s, tool } => {
            plp_event { tool_id: id_of(tool), ..plain(PLP_EVENT_CUT_REFUSED, time_s) }
        }
        Event::Buttons { time_s, tool, buttons } => {
            plp_event { tool_id: id_of(tool), buttons, ..plain(PLP_EVENT_BUTTONS, time_s) }
        }
    }
}

/// A host's pointer on its way to the thread that gives it back to the host.
struct User(*mut c_void);
// SAFETY: the library never looks behind it; the host, who passed it for that thread, says who may.
unsafe impl Send for User {}

impl User {
    /// By a method, so that closures take the whole and not the pointer alone.
    fn pointer(&self) -> *mut c_void {
        self.0
    }
}

fn hook(function: plp_thread_fn, user: *mut c_void) -> Option<Hook> {
    let (function, user) = (function?, User(user));
    // SAFETY: the host's function, called with what the host gave for it.
    Some(Box::new(move || unsafe { function(user.pointer()) }))
}
