//! What a host changes of a running simulation's body: materials, and what is held.

use super::boundary::boundary;
use super::convert::{fix_of, material};
use super::sim::{SimBody, with_sim};
use super::status::{Fault, PLP_OK, plp_status};
use super::types::*;
use crate::error::Result;
use crate::model::Fix;

/// Gives a material of the model, by its index from 1 (as in vertex streams and contacts), other properties, in this simulation alone and from the next
/// step on. Rigid materials stay rigid: PLP_ERR_ARGUMENT. The stable step follows at once, from a bound; it may be shorter than that of a model built so.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_set_material(
    sim: *mut plp_sim,
    material_index: u32,
    properties: *const plp_material,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            if properties.is_null() {
                return Err(Fault::null("properties"));
            }
            // SAFETY: not NULL; the host passes a material.
            let properties = material(&unsafe { properties.read_unaligned() }, "properties")?;
            let index = u8::try_from(material_index)
                .map_err(|_| Fault::argument(format!("the model has no material {material_index}")))?;
            body.sim.set_material(index, &properties)?;
            Ok(PLP_OK)
        })
    })
}

/// Holds the nodes whose rest positions lie in a box where they are now, along some axes, in this simulation alone. How many were not held so before goes to
/// node_count (@nullable node_count).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_fix(
    sim: *mut plp_sim,
    fix: *const plp_fix,
    node_count: *mut u64,
) -> plp_status {
    // SAFETY: promised by the host.
    unsafe { change(sim, fix, node_count, |body, fix| body.sim.fix(fix)) }
}

/// Frees the nodes whose rest positions lie in a box along some axes, also what the model holds, but for rigid regions. How many were held goes to
/// node_count (@nullable node_count).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_free(
    sim: *mut plp_sim,
    fix: *const plp_fix,
    node_count: *mut u64,
) -> plp_status {
    // SAFETY: promised by the host.
    unsafe { change(sim, fix, node_count, |body, fix| body.sim.free(fix)) }
}

/// Has a tool hold the tissue's nodes that are within reach_m of it now and held by nothing else, besides those that it holds already: they go where it goes,
/// and it feels what that takes. How many it holds goes to node_count (@nullable node_count). The tool's
/// thread may be using it meanwhile; plp_sim_reset and plp_tool_destroy let go.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_grasp(
    sim: *mut plp_sim,
    tool: *const plp_tool,
    reach_m: f64,
    node_count: *mut u64,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            let tool = body.tool(tool)?;
            let count = body.sim.grasp(tool, reach_m)?;
            // SAFETY: the host passes NULL or room for a count.
            unsafe { tell(node_count, count) };
            Ok(PLP_OK)
        })
    })
}

/// Has a tool let go of what it holds. How many nodes that were goes to node_count (@nullable node_count).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_release(
    sim: *mut plp_sim,
    tool: *const plp_tool,
    node_count: *mut u64,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            let tool = body.tool(tool)?;
            let count = body.sim.release(tool)?;
            // SAFETY: the host passes NULL or room for a count.
            unsafe { tell(node_count, count) };
            Ok(PLP_OK)
        })
    })
}

/// # Safety
/// `to` is NULL or room for a count.
unsafe fn tell(to: *mut u64, count: usize) {
    if !to.is_null() {
        // SAFETY: promised by the caller.
        unsafe { to.write_unaligned(count as u64) };
    }
}

/// # Safety
/// `fix` is NULL or a fix, and `node_count` NULL or room for a count.
unsafe fn change(
    sim: *mut plp_sim,
    fix: *const plp_fix,
    node_count: *mut u64,
    act: impl FnOnce(&mut SimBody, &Fix) -> Result<usize>,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            if fix.is_null() {
                return Err(Fault::null("fix"));
            }
            // SAFETY: not NULL; promised by the caller.
            let fix = fix_of(&unsafe { fix.read_unaligned() }, "fix")?;
            let count = act(body, &fix)?;
            // SAFETY: promised by the caller.
            unsafe { tell(node_count, count) };
            Ok(PLP_OK)
        })
    })
}
