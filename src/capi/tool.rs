//! Tools: one servo thread's way to touch the tissue.

use std::sync::Arc;

use super::aside::WORDS;
use super::boundary::{
    boundary, check_out, check_output, init_desc, read_desc, read_list, rt_boundary, write_output,
};
use super::convert::{check_bits, haptic, motion_out, pose, try_motion};
use super::cut::points;
use super::handle::{self, Handle};
use super::sim::{Link, with_sim};
use super::status::{
    Fault, PLP_ERR_ARGUMENT, PLP_ERR_BUSY, PLP_ERR_NULL, PLP_ERR_STATE, PLP_OK, PLP_STOPPED, plp_status,
};
use super::types::*;
use crate::math::{Pose, Vec3};
use crate::servo::{DeviceState, ServoStatistics};
use crate::sim::{Exchange, ToolPort};
use crate::solver::blade::Blade;
use crate::solver::tool::{MAX_PARTS, Shape, ToolDesc, ToolMotion, Wrench};

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
/// once: start outside the tissue, whose skin plp_sim_pick finds. The tool is the caller's, to be given to
/// plp_tool_destroy, before or after the simulation.
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
            // SAFETY: the host's desc is as long as it says.
            let asked = unsafe { read_desc(desc) }?;
            // SAFETY: its parts are as many as it says.
            let desc = unsafe { desc_of(&asked) }?;
            let port = if asked.haptic.is_null() {
                body.sim.add_tool(&desc)?
            } else {
                // SAFETY: the host's desc is as long as it says.
                let (device, options) = haptic(&unsafe { read_desc(asked.haptic) }?)?;
                body.sim.add_haptic_tool(&desc, &device, &options)?
            };
            let said = port.servo_statistics().map(|now| Said::nothing(statistics_out(&now)).words());
            let (tag, link) = body.admit_tool(port.id());
            let handle = handle::create::<plp_tool>(ToolBody { port, link, tag }, tag, said.as_ref());
            // SAFETY: checked not to be NULL; the host offers a pointer's room.
            unsafe { tool.write_unaligned(handle) };
            Ok(PLP_OK)
        })
    })
}

/// Takes a tool out of its simulation, from its next step on. NULL is fine.
///
/// @thread port
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_tool_destroy(tool: *mut plp_tool) -> plp_status {
    boundary(|| {
        if let Some(body) = handle::destroy(tool).map_err(handle::fault::<plp_tool>)? {
            let ToolBody { port, link, tag } = *body;
            port.leave();
            link.departed.lock().push(tag);
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

/// One tick of the servo loop of a tool's haptic device: where the device is goes in, and the force for its motors comes out, followed from the newest
/// step to where the device is now and bounded by all that plp_haptic_desc says. Call it at the device's rate, whatever the simulation's; it does the work of
/// plp_tool_set_pose and plp_tool_get_force.
///
/// The force is there for every answer, also below 0: then and for a motion that is not valid it is going to zero or is zero. Answers PLP_STOPPED
/// when the simulation is gone or failed, PLP_ERR_STATE for a tool without plp_tool_desc.haptic, PLP_ERR_BUSY to the second of two threads. That one gets what
/// the tool answered last, with PLP_SERVO_HELD, for 10 ms by its own stamp_s, and no force after that, nor with PLP_HAPTIC_RELEASED or a motion that is none; as it has not been told of these, tell it again.
///
/// @thread port @rt
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_tool_exchange(
    tool: *mut plp_tool,
    state: *const plp_haptic_state,
    servo: *mut plp_servo,
) -> plp_status {
    if servo.is_null() {
        return PLP_ERR_NULL;
    }
    let mut is_answered = false;
    let status = rt_boundary(|| {
        let held = handle::hold(tool);
        if let Err(PLP_ERR_BUSY) = held
            && !state.is_null()
        {
            // SAFETY: not NULL; the host passes a state.
            let asked = unsafe { state.read_unaligned() };
            if let Some(felt) =
                handle::aside(tool)?.get().and_then(|words| still_felt(&Said::of(words), &asked))
            {
                // SAFETY: not NULL; the host offers room for it.
                unsafe { servo.write_unaligned(felt) };
                is_answered = true;
            }
        }
        let mut body = held?;
        if state.is_null() {
            return Err(PLP_ERR_NULL);
        }
        // SAFETY: not NULL; the host passes a state.
        let state = unsafe { state.read_unaligned() };
        let device = DeviceState {
            motion: try_motion(&state.motion).unwrap_or_else(no_motion),
            stamp_s: state.stamp_s,
            is_held: state.flags & PLP_HAPTIC_RELEASED == 0,
        };
        let is_sound = !body.link.is_poisoned();
        let exchange = body.port.exchange(&device, state.buttons, is_sound).ok_or(PLP_ERR_STATE)?;
        let statistics = statistics_out(&body.port.servo_statistics().ok_or(PLP_ERR_STATE)?);
        let felt = servo_out(&exchange, statistics.age_s, statistics.latency_s);
        // SAFETY: as above.
        unsafe { servo.write_unaligned(felt) };
        is_answered = true;
        body.aside().put(&Said { felt, stamp_s: state.stamp_s, statistics }.words());
        Ok(if exchange.is_live { PLP_OK } else { PLP_STOPPED })
    });
    if !is_answered {
        // SAFETY: as above. Whatever went wrong, there is no force.
        unsafe { servo.write_unaligned(NO_SERVO) };
    }
    status
}

/// What is written where nothing can be said.
const NO_SERVO: plp_servo = plp_servo {
    force_n: [0.0; 3],
    torque_n_m: [0.0; 3],
    tool: plp_motion {
        pose: plp_pose { position_m: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] },
        linear_m_s: [0.0; 3],
        angular_rad_s: [0.0; 3],
    },
    time_s: 0.0,
    age_s: -1.0,
    latency_s: 0.0,
    sequence: 0,
    flags: PLP_SERVO_STOPPED,
    reserved: 0,
};

/// How long a servo that finds its tool busy keeps the force, in s: as long as one that finds no new model.
const BUSY_HOLD_S: f64 = 10e-3;

/// What a tool said last, which stands aside for callers who do not or cannot enter it.
#[repr(C)]
#[derive(Clone, Copy)]
struct Said {
    felt: plp_servo,
    stamp_s: f64,
    statistics: plp_servo_statistics,
}

impl Said {
    /// Before the first tick: nothing is felt, at no time.
    fn nothing(statistics: plp_servo_statistics) -> Self {
        Self { felt: NO_SERVO, stamp_s: f64::NAN, statistics }
    }

    #[inline]
    fn words(&self) -> [u64; WORDS] {
        // SAFETY: repr(C), fields of eight bytes and a pair of u32: as many words, none of them padding.
        unsafe { std::mem::transmute(*self) }
    }

    fn of(words: [u64; WORDS]) -> Self {
        // SAFETY: as above, the other way; any bits are valid in its fields.
        unsafe { std::mem::transmute(words) }
    }
}

/// The last answer, for a servo that finds its tool busy and asks so.
fn still_felt(said: &Said, asked: &plp_haptic_state) -> Option<plp_servo> {
    // A stamp that is no number, or of another clock, holds nothing.
    let is_recent = (0.0..=BUSY_HOLD_S).contains(&(asked.stamp_s - said.stamp_s));
    let held = plp_servo { flags: said.felt.flags | PLP_SERVO_HELD, ..said.felt };
    // A switch that was let go is obeyed here too, and a motion that is none is one.
    let is_let_go = asked.flags & PLP_HAPTIC_RELEASED != 0 || try_motion(&asked.motion).is_none();
    let none =
        plp_servo { force_n: [0.0; 3], torque_n_m: [0.0; 3], flags: held.flags | PLP_SERVO_RELEASED, ..held };
    is_recent.then_some(if is_let_go { none } else { held })
}

/// A motion that is none, which the servo answers with no force.
fn no_motion() -> ToolMotion {
    ToolMotion { linear_m_s: Vec3::repeat(f64::NAN), ..ToolMotion::at(Pose::identity()) }
}

/// An age that a host can print.
fn age_out(age_s: f64) -> f64 {
    if age_s.is_finite() { age_s } else { -1.0 }
}

#[inline]
fn servo_out(exchange: &Exchange, age_s: f64, latency_s: f64) -> plp_servo {
    let Exchange { output, time_s, sequence, .. } = exchange;
    plp_servo {
        force_n: output.wrench.force_n.into(),
        torque_n_m: output.wrench.torque_n_m.into(),
        tool: motion_out(&output.tool),
        time_s: *time_s,
        age_s,
        latency_s,
        sequence: *sequence,
        flags: output.flags.0,
        reserved: 0,
    }
}

#[inline]
fn statistics_out(now: &ServoStatistics) -> plp_servo_statistics {
    plp_servo_statistics {
        tick_count: now.ticks,
        pause_count: now.pauses,
        energy_j: now.energy_j,
        least_energy_j: now.least_energy_j,
        average_force_n: now.average_force_n,
        age_s: age_out(now.age_s),
        latency_s: now.latency_s,
        longest_latency_s: now.longest_latency_s,
    }
}

/// How a tool's servo loop was doing at its last tick. Never enters the tool, so that it costs a servo nothing, whatever thread looks.
/// Answers PLP_ERR_STATE for a tool without plp_tool_desc.haptic. statistics_size is sizeof(plp_servo_statistics).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_tool_get_servo_statistics(
    tool: *const plp_tool,
    statistics: *mut plp_servo_statistics,
    statistics_size: u32,
) -> plp_status {
    boundary(|| {
        let aside = handle::aside(tool).map_err(handle::fault::<plp_tool>)?;
        check_output(statistics, statistics_size)?;
        if aside.is_empty() {
            return Err(Fault::new(PLP_ERR_STATE, "the tool was made without a haptic device"));
        }
        let words = aside
            .get()
            .ok_or_else(|| Fault::new(PLP_ERR_BUSY, "the servo went on faster than it could be read"))?;
        // SAFETY: checked above; the host offers `statistics_size` bytes.
        unsafe { write_output(statistics, statistics_size, &Said::of(words).statistics) };
        Ok(PLP_OK)
    })
}

/// The id by which events name a tool: never 0 and never used again; 0 for what is no tool.
///
/// @thread any
#[unsafe(no_mangle)]
pub extern "C" fn plp_tool_get_id(tool: *const plp_tool) -> u64 {
    handle::tag(tool).unwrap_or(0)
}

/// Fills a desc with what a 3D Systems Touch bears. desc_size is sizeof(plp_haptic_desc).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_haptic_desc_init(desc: *mut plp_haptic_desc, desc_size: u32) -> plp_status {
    // SAFETY: the host offers `desc_size` bytes.
    boundary(|| unsafe { init_desc(desc, desc_size) })
}

/// # Safety
/// `parts` is NULL or leads to `part_count` parts, `blade` to a blade as [`blade_of`] wants it.
unsafe fn desc_of(desc: &plp_tool_desc) -> Result<ToolDesc, Fault> {
    let count = desc.part_count as usize;
    let least = usize::from(desc.blade.is_null());
    if !(least..=MAX_PARTS).contains(&count) {
        return Err(Fault::argument(format!("a tool has 1 to {MAX_PARTS} parts, not {count}")));
    }
    // SAFETY: promised by the caller.
    let parts = unsafe { read_list(desc.parts, count, "parts") }?;
    let parts = parts.iter().enumerate().map(|(i, part)| shape_of(part, &format!("parts[{i}]")));
    // SAFETY: promised by the caller.
    let blade =
        (!desc.blade.is_null()).then(|| unsafe { blade_of(&desc.blade.read_unaligned()) }).transpose()?;
    let desc = ToolDesc { parts: parts.collect::<Result<_, Fault>>()?, friction: desc.friction, blade };
    desc.check()?;
    Ok(desc)
}

/// A shape and its pose.
pub(super) fn shape_of(part: &plp_tool_part, what: &str) -> Result<(Pose, Shape), Fault> {
    check_bits(part.reserved, 0, &format!("{what}.reserved"))?;
    let shape = match part.kind {
        PLP_SHAPE_SPHERE => Shape::Sphere { radius_m: part.radius_m },
        PLP_SHAPE_CAPSULE => Shape::Capsule { radius_m: part.radius_m, half_length_m: part.half_length_m },
        PLP_SHAPE_BOX => Shape::Box { half_extents_m: part.half_extents_m.into(), rounding_m: part.radius_m },
        other => return Err(Fault::argument(format!("{what}: kind {other} is no PLP_SHAPE_ value"))),
    };
    Ok((pose(&part.pose, what)?, shape))
}

/// # Safety
/// `edge_m` is NULL or leads to three numbers for each point.
unsafe fn blade_of(blade: &plp_blade) -> Result<Blade, Fault> {
    check_bits(blade.reserved, 0, "blade.reserved")?;
    // SAFETY: promised by the caller.
    let edge = unsafe { points(blade.edge_m, blade.point_count, "blade.edge_m") }?;
    Ok(Blade { edge, toughness_j_m2: blade.toughness_j_m2 })
}

#[cfg(test)]
mod tests {
    use super::super::boundary::Desc;
    use super::super::sim::plp_sim_destroy;
    use super::super::sim::tests::cell_and_tool;
    use super::*;

    #[test]
    fn a_servo_that_finds_its_tool_busy_keeps_its_force_for_ten_milliseconds() {
        let device = plp_haptic_desc::with_defaults();
        let (sim, tool) = cell_and_tool(&raw const device);
        let tick = |stamp_s: f64| {
            let motion = motion_out(&ToolMotion::at(Pose::translation(0.0, 0.0, 0.1)));
            let state = plp_haptic_state { motion, stamp_s, flags: 0, buttons: 0 };
            let mut felt = NO_SERVO;
            // SAFETY: a living handle, a state, and room for an answer.
            (unsafe { plp_tool_exchange(tool, &raw const state, &raw mut felt) }, felt)
        };
        let (status, first) = tick(7.0);
        assert_eq!((status, first.tool.pose.position_m), (PLP_OK, [0.0, 0.0, 0.1]));
        let kept = plp_servo { flags: first.flags | PLP_SERVO_HELD, ..first };
        // As if the device had felt something.
        let force_n = [0.0, 0.0, 0.5];
        let held = handle::hold(tool).unwrap();
        let statistics = Said::of(held.aside().get().unwrap()).statistics;
        held.aside().put(&Said { felt: plp_servo { force_n, ..first }, stamp_s: 7.0, statistics }.words());
        for (stamp_s, expected) in [
            (7.001, plp_servo { force_n, ..kept }),
            (7.0099, plp_servo { force_n, ..kept }),
            (7.0101, NO_SERVO),
            (6.9, NO_SERVO),
            (f64::NAN, NO_SERVO),
        ] {
            assert_eq!(tick(stamp_s), (PLP_ERR_BUSY, expected), "at {stamp_s}");
        }
        // A switch that is let go is no force, whoever is inside.
        let nowhere = ToolMotion { linear_m_s: Vec3::repeat(f64::NAN), ..ToolMotion::at(Pose::identity()) };
        for (motion, flags) in
            [(ToolMotion::at(Pose::translation(0.0, 0.0, 0.1)), PLP_HAPTIC_RELEASED), (nowhere, 0)]
        {
            let state = plp_haptic_state { motion: motion_out(&motion), stamp_s: 7.001, flags, buttons: 0 };
            let mut felt = NO_SERVO;
            // SAFETY: a living handle, a state, and room for an answer.
            let status = unsafe { plp_tool_exchange(tool, &raw const state, &raw mut felt) };
            assert_eq!(
                (status, felt),
                (PLP_ERR_BUSY, plp_servo { flags: kept.flags | PLP_SERVO_RELEASED, ..kept })
            );
        }
        // Who looks does not have to enter.
        let mut seen = statistics;
        let size = size_of::<plp_servo_statistics>() as u32;
        // SAFETY: a living handle, and room for an answer.
        assert_eq!(unsafe { plp_tool_get_servo_statistics(tool, &raw mut seen, size) }, PLP_OK);
        assert_eq!(seen.tick_count, 1);
        drop(held);
        assert_eq!(tick(7.002).0, PLP_OK);
        // SAFETY: living handles.
        unsafe { assert_eq!((plp_tool_destroy(tool), plp_sim_destroy(sim)), (PLP_OK, PLP_OK)) };
    }
}
