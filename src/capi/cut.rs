//! Cutting: by hand along a way, by removing tissue, and what is left.

use super::boundary::{boundary, read_list};
use super::convert::vector;
use super::sim::{with_sim, write_list};
use super::status::{Fault, PLP_OK, plp_status};
use super::tool::shape_of;
use super::types::*;
use crate::math::Vec3;
use crate::sim::Removed;

/// Most points of a polyline.
const MAX_POINTS: u32 = 4096;

/// Cuts what the edge of a blade sweeps on its straight way from one polyline to another, at once and without a tool: from_m and to_m are the edge's
/// points at the start and at the end, x, y, z in metres, world frame [point_count * 3]. Where it starts where the last such cut ended it sweeps on, and tissue that has moved against it meanwhile is
/// cut as well. Rigid tissue is not cut. How many cells were divided, or divided otherwise, goes to cell_count (@nullable cell_count).
///
/// Answers PLP_ERR_STATE where plp_sim_desc.cut_nodes is 0 and PLP_ERR_LIMIT where the room is spent: nothing is cut then. Tools with a blade cut by themselves.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_cut(
    sim: *mut plp_sim,
    from_m: *const f64,
    to_m: *const f64,
    point_count: u32,
    cell_count: *mut u64,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            // SAFETY: the host passes three numbers for each point.
            let [from, to] =
                unsafe { [points(from_m, point_count, "from_m")?, points(to_m, point_count, "to_m")?] };
            let divided = body.sim.cut(&from, &to)?;
            if !cell_count.is_null() {
                // SAFETY: the host offers room for a count.
                unsafe { cell_count.write_unaligned(divided as u64) };
            }
            Ok(PLP_OK)
        })
    })
}

/// Removes the soft tissue in a shape, where it is now: the nodes in the shape, with all that lies between them and the shape's surface. The shape's pose is that in the world. The hole has walls as a cut has, and what stays
/// keeps its mass, place and velocity. How much that was goes to removed (@nullable removed): nothing where the shape holds no such node. Rigid tissue stays, with what is next to it, a thousandth of a cell. plp_sim_reset
/// brings all tissue back.
///
/// Answers PLP_ERR_STATE where plp_sim_desc.cut_nodes is 0 and PLP_ERR_LIMIT where the room is spent: nothing is removed then.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_ablate(
    sim: *mut plp_sim,
    shape: *const plp_tool_part,
    removed: *mut plp_removed,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            // SAFETY: the host passes a shape.
            let part = unsafe { read_list(shape, 1, "shape") }?[0];
            let (pose, shape) = shape_of(&part, "shape")?;
            let gone = body.sim.ablate(&shape, &pose)?;
            // SAFETY: the host offers room for an answer, or NULL.
            unsafe { tell(gone, removed) };
            Ok(PLP_OK)
        })
    })
}

/// Removes a part by its id, all of it, bone and held tissue too. How much that was goes to removed (@nullable removed).
///
/// Answers PLP_ERR_ARGUMENT where there is no part of that id, and PLP_ERR_STATE where plp_sim_desc.cut_nodes is 0.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_remove_part(
    sim: *mut plp_sim,
    id: u32,
    removed: *mut plp_removed,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            let gone = body.sim.remove_part(id)?;
            // SAFETY: the host offers room for an answer, or NULL.
            unsafe { tell(gone, removed) };
            Ok(PLP_OK)
        })
    })
}

/// Tells how much was removed.
///
/// # Safety
/// `to` is NULL or leads to room for it.
unsafe fn tell(gone: Removed, to: *mut plp_removed) {
    if !to.is_null() {
        // SAFETY: as the caller promises.
        unsafe { to.write_unaligned(plp_removed { volume_m3: gone.volume_m3, mass_kg: gone.mass_kg }) };
    }
}

/// The parts that cuts have left, the largest first. Writes at most `capacity` of them and the number of all to part_count; answers PLP_TRUNCATED where capacity is less. parts may be
/// NULL with a capacity of 0 (@nullable parts).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_get_parts(
    sim: *mut plp_sim,
    parts: *mut plp_part,
    capacity: u64,
    part_count: *mut u64,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            let parts_now: Vec<plp_part> = body
                .sim
                .parts()
                .iter()
                .map(|part| plp_part {
                    volume_m3: part.volume_m3,
                    mass_kg: part.mass_kg,
                    velocity_m_s: part.velocity_m_s.into(),
                    is_held: u32::from(part.is_held),
                    id: part.id,
                })
                .collect();
            // SAFETY: the host offers `capacity` parts and room for a count.
            unsafe { write_list(&parts_now, parts, capacity, part_count, "parts") }
        })
    })
}

/// Points of a polyline.
///
/// # Safety
/// `numbers` is NULL or leads to three numbers for each point.
pub(super) unsafe fn points(numbers: *const f64, count: u32, what: &str) -> Result<Vec<Vec3>, Fault> {
    if count > MAX_POINTS {
        return Err(Fault::argument(format!("{what}: {count} points are more than {MAX_POINTS}")));
    }
    // SAFETY: promised by the caller.
    let numbers = unsafe { read_list(numbers, 3 * count as usize, what) }?;
    numbers.chunks_exact(3).map(|p| vector(&[p[0], p[1], p[2]], what)).collect()
}
