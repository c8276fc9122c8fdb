//! Nodes that a tool holds: they go where it goes, and it feels what that takes.

use super::lanes::Real;
use super::nodes::{Bricks, Nodes};
use crate::solver::{ToolStep, ToolSum};

/// Takes the nodes that a tool holds to where it is at the fraction `t` of the step, at the end of a substep of `dt` seconds in which they moved by
/// themselves; the impulses that this takes are the tool's. Returns how far a node went at most, in m.
pub fn carry<R: Real>(
    tool: &ToolStep,
    t: f64,
    dt: f64,
    bricks: &Bricks,
    corner_kg: &[f64; 16],
    nodes: &mut Nodes<R>,
    sum: &mut ToolSum,
) -> f64 {
    let pose = tool.path.at(t);
    let Nodes { u, u_next, v, v_next } = nodes;
    let v = v_next.as_mut().unwrap_or(v);
    let mut furthest = 0.0_f64;
    for &(slot, place) in tool.grasped.iter() {
        let arm = pose.rotation * place;
        let moved = pose.translation.vector + arm - bricks.model.lattice().rest_position(slot);
        let way = moved - u.vec3(slot);
        let mass = bricks.node_mass(slot, |material| corner_kg[usize::from(material)]);
        let impulse = (way / dt - v.vec3(slot)) * mass;
        sum.impulse.force_n -= impulse;
        sum.impulse.torque_n_m -= arm.cross(&impulse);
        sum.work_j += impulse.dot(&way) / dt;
        furthest = furthest.max(way.norm());
        v.set(slot, way / dt);
        u_next.set(slot, moved);
    }
    furthest
}
