//! Tissue ahead of a blade's edge: it sticks to the edge until that takes more than its toughness.

use super::lanes::Real;
use super::mobile::Mobile;
use crate::math::Vec3;
use crate::solver::{ToolStep, ToolSum};

/// Gives tissue that a tool's edge holds at the fraction `t` of the step the velocity of the edge, across it, by impulses that are limited by its toughness; what they take
/// is the tool's. A substep takes `dt`, its whole way `step`, in s. Returns how far a node went by that at most, in m.
///
/// One point after the other, once: each impulse takes energy from the motion against the edge, so that all do.
pub fn hold<R: Real>(
    tool: &ToolStep,
    t: f64,
    [dt, step]: [f64; 2],
    nodes: &mut Mobile<R>,
    sum: &mut ToolSum,
) -> f64 {
    let pose = tool.path.at(t);
    let mut furthest = 0.0_f64;
    for held in tool.held.iter() {
        let arm = pose.rotation * held.at;
        let along = pose.rotation * held.along;
        let mobilities = held.nodes.map(|slot| nodes.mobility(slot));
        let pairs = || held.nodes.into_iter().zip(held.weights);
        let velocity: Vec3 = pairs().map(|(slot, weight)| nodes.v.vec3(slot) * weight).sum();
        let slip = tool.path.velocity(&pose, pose.translation.vector + arm, step) - velocity;
        let slip = slip - along * slip.dot(&along);
        let size = slip.norm();
        // By the most mobile axis of each node: no impulse overshoots.
        let give: f64 =
            mobilities.iter().zip(held.weights).map(|(m, weight)| m.max() * weight * weight).sum();
        if size == 0.0 || give == 0.0 {
            continue;
        }
        let impulse = slip / size * (size / give).min(held.limit_n * dt);
        for ((slot, weight), mobility) in pairs().zip(&mobilities) {
            let change = mobility.component_mul(&impulse) * weight;
            nodes.v.set(slot, nodes.v.vec3(slot) + change);
            nodes.u.set(slot, nodes.u.vec3(slot) + change * dt);
            furthest = furthest.max(change.norm() * dt);
        }
        let tool_velocity = tool.path.velocity(&pose, pose.translation.vector + arm, step);
        sum.impulse.force_n -= impulse;
        sum.impulse.torque_n_m -= arm.cross(&impulse);
        sum.work_j += impulse.dot(&tool_velocity);
    }
    furthest
}
