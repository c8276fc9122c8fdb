//! What a blade sweeps, and which edges of the tissue that crosses.
//!
//! Edges are looked at where they are now, deformed: trilinear motion keeps them straight, so that a share along the deformed edge is one along the edge at rest, and
//! no point of the blade has to be taken back to the tissue's rest. The blade's way is seen from each edge, whose own motion is taken from it: where one step ends the
//! next begins, and tissue that moves against a blade at rest is cut as well.

use super::topology::LatticeEdge;
use crate::math::Vec3;
use crate::model::lattice::{BRICK_SLOTS, Lattice};

/// How far outside a triangle, as a share of its size, a crossing still counts: triangles that share an edge leave no gap.
const GAP: f64 = 1e-9;
/// Where the blade is taken to be beside where it is, in cells: so it passes every node on one side, though it be drawn through a layer of them.
const BESIDE: Vec3 = Vec3::new(5.3e-7, 7.1e-7, 6.1e-7);

/// A blade's edge during one step: a polyline at its start and at its end, m, model frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// The points at the start.
    pub from: Vec<Vec3>,
    /// The same points at the end.
    pub to: Vec<Vec3>,
}

/// Where tissue is during one step, m, model frame, by slots.
pub trait Moving {
    /// Where a node was at the start.
    fn from(&self, slot: u32) -> Vec3;
    /// Where it is at the end.
    fn to(&self, slot: u32) -> Vec3;
}

impl Sweep {
    /// The edges of a lattice's nodes that the sweep crosses, and where, as shares from their lower nodes. `is_there` says whether tissue is left along an edge.
    pub fn crossed(
        &self,
        lattice: &Lattice,
        nodes: &impl Moving,
        is_there: impl Fn(LatticeEdge) -> bool,
    ) -> Vec<(LatticeEdge, f64)> {
        let beside = BESIDE * lattice.cell_m();
        let all = || self.from.iter().chain(&self.to);
        let Some(first) = all().next() else { return Vec::new() };
        let (low, high) = all().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
        let mut crossed = Vec::new();
        for brick in 0..lattice.bricks().len() {
            for slot in (brick * BRICK_SLOTS) as u32..((brick + 1) * BRICK_SLOTS) as u32 {
                if lattice.words()[slot as usize] == 0 {
                    continue;
                }
                let a = nodes.to(slot) - beside;
                let node = lattice.node_of(slot);
                for axis in 0..3 {
                    let mut beyond = node;
                    beyond[axis] += 1;
                    let Some(other) = lattice.slot(beyond) else { continue };
                    let b = nodes.to(other) - beside;
                    let moved =
                        0.5 * (nodes.to(slot) - nodes.from(slot) + nodes.to(other) - nodes.from(other));
                    let room = moved.abs();
                    let is_near = (0..3)
                        .all(|c| a[c].max(b[c]) >= low[c] - room[c] && a[c].min(b[c]) <= high[c] + room[c]);
                    let edge = LatticeEdge { slot, axis: axis as u8 };
                    if !is_near || !is_there(edge) {
                        continue;
                    }
                    crossed.extend(self.crossing(a, b, moved).map(|at| (edge, at)));
                }
            }
        }
        crossed
    }

    /// Where the sweep crosses the segment from `a` to `b`, which has moved by `moved` meanwhile: the lowest share of it.
    fn crossing(&self, a: Vec3, b: Vec3, moved: Vec3) -> Option<f64> {
        let segments = self.from.windows(2).zip(self.to.windows(2));
        let triangles = segments.flat_map(|(from, to)| {
            let [p, q] = [from[0] + moved, from[1] + moved];
            [[p, q, to[1]], [p, to[1], to[0]]]
        });
        triangles.filter_map(|triangle| share(a, b, triangle)).min_by(f64::total_cmp)
    }
}

/// Where a triangle crosses the segment from `a` to `b`, as a share of it.
pub fn share(a: Vec3, b: Vec3, [p, q, r]: [Vec3; 3]) -> Option<f64> {
    let (along, u, v) = (b - a, q - p, r - p);
    let normal = u.cross(&v);
    let facing = normal.dot(&along);
    // A segment in the triangle's plane is not crossed; nor does a triangle without an area cross anything.
    if facing.abs() <= f64::EPSILON * normal.norm() * along.norm() {
        return None;
    }
    let at = normal.dot(&(p - a)) / facing;
    if !(0.0..=1.0).contains(&at) {
        return None;
    }
    let there = a + along * at - p;
    let area2 = normal.norm_squared();
    let (s, t) = (normal.dot(&there.cross(&v)) / area2, normal.dot(&u.cross(&there)) / area2);
    (s >= -GAP && t >= -GAP && s + t <= 1.0 + GAP).then_some(at)
}
