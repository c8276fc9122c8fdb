//! Snapshots: what a simulation was at one instant, and back to it.

use super::boundary::{boundary, check_out};
use super::handle::{self, Handle};
use super::sim::with_sim;
use super::status::{PLP_OK, plp_status};
use super::types::*;
use crate::sim::Snapshot;

impl Handle for plp_snapshot {
    const KIND: u32 = 0x504C_504E;
    const NAME: &'static str = "plp_snapshot";
    type Body = Snapshot;
}

/// Keeps how a simulation is now, in the host's memory: tissue and how it moves, what cuts have made of it, materials, what is held, gravity, loads, where tools and rigid regions are, time and
/// statistics. Takes time and memory by the size of the model.
///
/// Answers PLP_ERR_DIVERGED for a simulation that has diverged.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_snapshot(sim: *mut plp_sim, snapshot: *mut *mut plp_snapshot) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            check_out(snapshot, "snapshot")?;
            let taken = body.sim.snapshot()?;
            // SAFETY: checked not to be NULL; the host offers a pointer's room.
            unsafe { snapshot.write_unaligned(handle::create::<plp_snapshot>(taken, 0, None)) };
            Ok(PLP_OK)
        })
    })
}

/// Makes all what it was at a snapshot of this simulation, or of another one of the same plp_model that was described alike; threads, gravity and which GPU it is may differ. From there the
/// simulation goes on as it did then: to the last bit, on a GPU of the same kind, for the same motions of its tools and drives of its regions. It goes on as well where it had diverged.
///
/// Tools and surfaces live on. A tool stands where it did and goes from there, in the next step, to where it was asked to be last; what it held it holds again. A tool that was not there then is put
/// in anew. In another simulation a tool is the one that was created in the same turn, loads counted too. Tools are without force until the next step, and devices feel nothing until they engage
/// anew. topology_version counts on where a surface changes. Loads have the ids of then.
///
/// Answers PLP_ERR_ARGUMENT for a snapshot of another model, or of a simulation that was described otherwise: nothing changes then. Where a GPU has too little memory left, PLP_ERR_LIMIT, steps
/// answer PLP_ERR_DIVERGED until plp_sim_reset or another restore. A snapshot serves any number of times.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_restore(sim: *mut plp_sim, snapshot: *const plp_snapshot) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            let taken = handle::share(snapshot).map_err(handle::fault::<plp_snapshot>)?;
            body.restore(&taken)?;
            Ok(PLP_OK)
        })
    })
}

/// Gives a snapshot back. It may outlive its simulation. NULL is fine.
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_snapshot_destroy(snapshot: *mut plp_snapshot) -> plp_status {
    boundary(|| {
        drop(handle::destroy(snapshot).map_err(handle::fault::<plp_snapshot>)?);
        Ok(PLP_OK)
    })
}
