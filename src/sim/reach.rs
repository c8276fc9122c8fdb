//! How far a tool that a device holds goes in one step.
//!
//! The device moves in the hand's time, the tissue in its own. Where the simulation runs slower than life, or where a tool on a spring snaps back to
//! its device, the tool would sweep a centimetre in a simulated millisecond: at 10 m/s, a blow that tears tissue. So no point of such a tool
//! moves faster than [`FASTEST_M_S`] in the tissue's time. Its step ends on the way to where it was asked to be, the next one goes on from
//! there, and the contact model tells the servo where it was and how it moved.

use crate::math::Pose;
use crate::solver::tool::{ToolMotion, ToolPath};

/// Fastest that any point of a device's tool moves in the tissue's time, in m/s: as fast as a hand that a servo believes.
const FASTEST_M_S: f64 = 1.0;

/// The motion with which a tool of this radius, in m, ends a step of `step_s` seconds that begins at `from`.
pub(super) fn reached(from: &Pose, asked: &ToolMotion, radius_m: f64, step_s: f64) -> ToolMotion {
    let path = ToolPath { from: *from, to: asked.pose };
    let (way, most) = (path.reach(radius_m), FASTEST_M_S * step_s);
    // A device's own velocity is better than one that is made of two positions, as long as the tool keeps up with it.
    if way <= most {
        return *asked;
    }
    let pose = path.at(most / way);
    ToolMotion {
        pose,
        linear_m_s: (pose.translation.vector - from.translation.vector) / step_s,
        angular_rad_s: (pose.rotation * from.rotation.inverse()).scaled_axis() / step_s,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    const STEP_S: f64 = 1e-3;

    #[test]
    fn a_tool_that_keeps_up_is_where_it_was_asked_to_be() {
        let asked = ToolMotion {
            linear_m_s: Vec3::x() * 0.3,
            ..ToolMotion::at(Pose::new(Vec3::x() * 4e-4, Vec3::y() * 0.05))
        };
        assert_eq!(reached(&Pose::identity(), &asked, 0.01, STEP_S), asked);
    }

    #[test]
    fn no_point_of_a_tool_that_falls_behind_is_faster_than_the_limit_and_it_arrives() {
        let radius = 0.02;
        // Far away and half turned round.
        let asked = ToolMotion::at(Pose::new(Vec3::new(0.01, 0.0, -0.02), Vec3::new(0.0, 3.0, 0.5)));
        let (mut at, mut steps) = (Pose::identity(), 0);
        while at != asked.pose {
            let next = reached(&at, &asked, radius, STEP_S);
            let way = ToolPath { from: at, to: next.pose }.reach(radius);
            assert!(way <= FASTEST_M_S * STEP_S * (1.0 + 1e-9), "{way} m");
            if next.pose != asked.pose {
                let speed = next.linear_m_s.norm() + radius * next.angular_rad_s.norm();
                assert!((speed - FASTEST_M_S).abs() < 1e-9, "{speed} m/s");
            }
            (at, steps) = (next.pose, steps + 1);
            assert!(steps < 1000);
        }
        let whole = ToolPath { from: Pose::identity(), to: asked.pose }.reach(radius);
        assert_eq!(steps, (whole / (FASTEST_M_S * STEP_S)).ceil() as u32);
    }
}
