//! Tools: one servo thread's way to touch the tissue.

use std::sync::Arc;

use super::boundary::{boundary, check_out, init_desc, read_desc, read_list, rt_boundary};
use super::convert::{check_bits, motion_out, pose, try_motion};
use super::handle::{self, Handle};
use super::sim::{Link, with_sim};
use super::status::{Fault, PLP_ERR_ARGUMENT, PLP_ERR_NULL, PLP_OK, PLP_STOPPED, plp_status};
use super::types::*;
use crate::sim::ToolPort;
use crate::solver::tool::{MAX_PARTS, Shape, ToolDesc, Wrench};

/// What a `plp_tool` stands for.
#[derive(Debug)]
pub(super) struct ToolBody {
    port: ToolPort,
    link: Arc<Link>,
    tag: u64,
}

impl ToolBody {
    /// Whether the tool's force means something: see [`ToolPort::is_live`]. Wait-free.
    fn is_live(&self) -> bool {
        self.port.is_live() && !self.link.is_poisoned()
    }

    /// Whether the simulation exists, has this tool and is sound. Wait-free.
    fn is_running(&self) -> bool {
        self.port.is_running() && !self.link.is_poisoned()
    }
}

impl Handle for plp_tool {
    const KIND: u32 = 0x504C_5054;
    const NAME: &'static str = "plp_tool";
    type Body = ToolBody;
}

/// Fills a desc with defaults: no parts yet, no friction. desc_size is sizeof(plp_tool_desc).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_tool_desc_init(desc: *mut plp_tool_desc, desc_size: u32) -> plp_status {
    // SAFETY: the host offers `desc_size` bytes.
    boundary(|| unsafe { init_desc(desc, desc_size) })
}

/// Adds a tool to a simulation. It touches nothing until its first plp_tool_set_pose, which puts it there at
/// once: start outside the tissue. The tool is the caller's, to be given to plp_tool_destroy, before or after
/// the simulation.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_tool_create(
    sim: *mut plp_sim,
    desc: *const plp_tool_desc,
    tool: *mut *mut plp_tool,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            check_out(tool, "tool")?;
            // SAFETY: the host's desc is as long as it says, and its parts as many.
            let desc = unsafe { desc_of(&read_desc(desc)?) }?;
            let port = body.sim.add_tool(&desc)?;
            let (tag, link) = body.admit_tool(port.id());
            let handle = handle::create::<plp_tool>(ToolBody { port, link, tag }, tag);
            // SAFETY: checked not to be NULL; the host offers a pointer's room.
            unsafe { tool.write_unaligned(handle) };
            Ok(PLP_OK)
        })
    })
}

/// Takes a tool out of its simulation, from the next call of its owner on. NULL is fine.
///
/// @thread port
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_tool_destroy(tool: *mut plp_tool) -> plp_status {
    boundary(|| {
        if let Some(body) = handle::destroy(tool).map_err(handle::fault::<plp_tool>)? {
            body.link.departed.lock().push(body.tag);
        }
        Ok(PLP_OK)
    })
}

/// Says where the tool is and how it moves. The simulation moves it there over its next step. A motion that
/// is not finite, lies more than 10 km from the origin, or whose quaternion is not nearly unit, answers
/// PLP_ERR_ARGUMENT and leaves the tool where it was; a tool whose simulation is gone answers PLP_STOPPED.
///
/// @thread port @rt
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_tool_set_pose(tool: *mut plp_tool, motion: *const plp_motion) -> plp_status {
    rt_boundary(|| {
        let mut body = handle::hold(tool)?;
        if motion.is_null() {
            return Err(PLP_ERR_NULL);
        }
        // SAFETY: not NULL; the host passes a motion.
        let motion = try_motion(&unsafe { motion.read_unaligned() }).ok_or(PLP_ERR_ARGUMENT)?;
        if !body.is_running() {
            return Ok(PLP_STOPPED);
        }
        // The motion is valid, so that nothing is refused here, which would take memory for the words.
        body.port.set_motion(&motion).map_err(|_| PLP_ERR_ARGUMENT)?;
        Ok(PLP_OK)
    })
}

/// The newest force and torque on the tool. When the simulation is gone or failed it answers PLP_STOPPED, and
/// force and torque are zero, so that a device is let go even by a caller who ignores the status.
///
/// @thread port @rt
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_tool_get_force(tool: *mut plp_tool, force: *mut plp_force) -> plp_status {
    rt_boundary(|| {
        let mut body = handle::hold(tool)?;
        if force.is_null() {
            return Err(PLP_ERR_NULL);
        }
        let felt = body.port.force();
        // The last gate before a motor: whatever went wrong inside, a number that is none must not pass.
        let finite = felt.wrench.force_n.iter().chain(&felt.wrench.torque_n_m).all(|x| x.is_finite());
        let live = finite && body.is_live();
        let wrench = if live { felt.wrench } else { Wrench::default() };
        let felt = plp_force {
            force_n: wrench.force_n.into(),
            torque_n_m: wrench.torque_n_m.into(),
            motion: motion_out(&felt.motion),
            time_s: felt.time_s,
            sequence: felt.sequence,
        };
        // SAFETY: not NULL; the host offers room for a force.
        unsafe { force.write_unaligned(felt) };
        Ok(if live { PLP_OK } else { PLP_STOPPED })
    })
}

/// # Safety
/// `parts` is NULL or leads to `part_count` parts.
unsafe fn desc_of(desc: &plp_tool_desc) -> Result<ToolDesc, Fault> {
    let count = desc.part_count as usize;
    if !(1..=MAX_PARTS).contains(&count) {
        return Err(Fault::argument(format!("a tool has 1 to {MAX_PARTS} parts, not {count}")));
    }
    // SAFETY: promised by the caller.
    let parts = unsafe { read_list(desc.parts, count, "parts") }?;
    let parts = parts.iter().enumerate().map(|(i, part)| {
        let what = format!("parts[{i}]");
        check_bits(part.reserved, 0, &format!("{what}.reserved"))?;
        let shape = match part.kind {
            PLP_SHAPE_SPHERE => Shape::Sphere { radius_m: part.radius_m },
            PLP_SHAPE_CAPSULE => {
                Shape::Capsule { radius_m: part.radius_m, half_length_m: part.half_length_m }
            }
            PLP_SHAPE_BOX => {
                Shape::Box { half_extents_m: part.half_extents_m.into(), rounding_m: part.radius_m }
            }
            other => return Err(Fault::argument(format!("{what}: kind {other} is no PLP_SHAPE_ value"))),
        };
        Ok((pose(&part.pose, &what)?, shape))
    });
    let desc = ToolDesc { parts: parts.collect::<Result<_, Fault>>()?, friction: desc.friction };
    desc.check()?;
    Ok(desc)
}
