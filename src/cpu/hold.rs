//! Tissue ahead of a blade's edge: it sticks to the edge until that takes more than its toughness.

use super::lanes::Real;
use super::nodes::{Bricks, Field};
use crate::math::Vec3;
use crate::model::lattice::flag;
use crate::solver::{ToolStep, ToolSum};

/// What is changed of the nodes at the end of a substep of `dt` seconds.
#[derive(Debug)]
pub struct HeldNodes<'a, R> {
    pub u: &'a mut Field<R>,
    pub v: &'a mut Field<R>,
    pub flags: &'a [u8],
    pub bricks: &'a Bricks,
    pub corner_kg: &'a [f64; 16],
    pub dt: f64,
}

/// Gives tissue that a tool's edge holds at the fraction `t` of the step the velocity of the edge, across it, by impulses that are limited by its toughness; what they take
/// is the tool's. `step` is the time that its way takes, in s. Returns how far a node went by that at most, in m.
///
/// One point after the other, once: each impulse takes energy from the motion against the edge, so that all do.
pub fn hold<R: Real>(tool: &ToolStep, t: f64, step: f64, nodes: &mut HeldNodes<R>, sum: &mut ToolSum) -> f64 {
    let pose = tool.path.at(t);
    let mut furthest = 0.0_f64;
    for held in tool.held.iter() {
        let arm = pose.rotation * held.at;
        let along = pose.rotation * held.along;
        let mobility = |slot: u32| {
            let flags = nodes.flags[slot as usize];
            let kg = nodes.bricks.node_mass(slot, |material| nodes.corner_kg[usize::from(material)]);
            let is_free = |axis: usize| flags & (flag::GRASPED | flag::FIX_X << axis) == 0;
            Vec3::from_fn(|axis, _| if is_free(axis) { 1.0 / kg } else { 0.0 })
        };
        let mobilities = held.nodes.map(mobility);
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
        let impulse = slip / size * (size / give).min(held.limit_n * nodes.dt);
        for ((slot, weight), mobility) in pairs().zip(&mobilities) {
            let change = mobility.component_mul(&impulse) * weight;
            nodes.v.set(slot, nodes.v.vec3(slot) + change);
            nodes.u.set(slot, nodes.u.vec3(slot) + change * nodes.dt);
            furthest = furthest.max(change.norm() * nodes.dt);
        }
        let tool_velocity = tool.path.velocity(&pose, pose.translation.vector + arm, step);
        sum.impulse.force_n -= impulse;
        sum.impulse.torque_n_m -= arm.cross(&impulse);
        sum.work_j += impulse.dot(&tool_velocity);
    }
    furthest
}
