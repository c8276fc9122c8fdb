//! What a blade sweeps, and which edges of the tissue that crosses.
//!
//! Edges are looked at where they are now, deformed: trilinear motion keeps them straight, so that a share along the deformed edge is one along the edge at rest, and
//! no point of the blade has to be taken back to the tissue's rest. The blade's way is seen from each edge, whose own motion is taken from it: where one step ends the
//! next begins, and tissue that moves against a blade at rest is cut as well.

use super::margin::Margin;
use super::surface::grid::{GridEdge, GridNode};
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
        let Some(bounds) = self.bounds() else { return Vec::new() };
        let mut crossed = Vec::new();
        for brick in 0..lattice.bricks().len() {
            for slot in (brick * BRICK_SLOTS) as u32..((brick + 1) * BRICK_SLOTS) as u32 {
                if lattice.words()[slot as usize] == 0 {
                    continue;
                }
                let node = lattice.node_of(slot);
                for axis in 0..3 {
                    let mut beyond = node;
                    beyond[axis] += 1;
                    let Some(other) = lattice.slot(beyond) else { continue };
                    let edge = LatticeEdge { slot, axis: axis as u8 };
                    let ends = [slot, other].map(|slot| [nodes.from(slot), nodes.to(slot)]);
                    let at = self.passes(bounds, ends, lattice.cell_m(), || is_there(edge));
                    crossed.extend(at.map(|at| (edge, at)));
                }
            }
        }
        crossed
    }

    /// The edges of the empty cells around a lattice's tissue that the sweep crosses, and where. They move as the tissue beside them does.
    pub fn crossed_beyond(
        &self,
        lattice: &Lattice,
        margin: &Margin,
        nodes: &impl Moving,
    ) -> Vec<(GridEdge, f64)> {
        let Some(bounds) = self.bounds() else { return Vec::new() };
        let passed = |&(edge, tissue): &(GridEdge, [u32; 2])| {
            let high = std::array::from_fn(|axis| edge.0[axis] + i32::from(axis == edge.1));
            let end = |node: GridNode, slot: u32| {
                let beside = Vec3::from(node.map(f64::from)) * lattice.cell_m() - lattice.rest_position(slot);
                [nodes.from(slot) + beside, nodes.to(slot) + beside]
            };
            let ends = [end(edge.0, tissue[0]), end(high, tissue[1])];
            self.passes(bounds, ends, lattice.cell_m(), || true).map(|at| (edge, at))
        };
        margin.edges().iter().filter_map(passed).collect()
    }

    /// Where the sweep crosses an edge whose ends move from one place to another, if it is there at all.
    fn passes(
        &self,
        (low, high): (Vec3, Vec3),
        ends: [[Vec3; 2]; 2],
        cell_m: f64,
        is_there: impl Fn() -> bool,
    ) -> Option<f64> {
        let [a, b] = ends.map(|[_, to]| to - BESIDE * cell_m);
        let moved = ends.iter().map(|[from, to]| 0.5 * (to - from)).sum::<Vec3>();
        let room = moved.abs();
        let is_near =
            (0..3).all(|c| a[c].max(b[c]) >= low[c] - room[c] && a[c].min(b[c]) <= high[c] + room[c]);
        if is_near && is_there() { self.crossing(a, b, moved) } else { None }
    }

    /// Lowest and highest coordinates of the blade's edge.
    fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let mut all = self.from.iter().chain(&self.to);
        let first = *all.next()?;
        Some(all.fold((first, first), |(low, high), p| (low.inf(p), high.sup(p))))
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    const H: f64 = 2e-3;

    /// Tissue that is displaced as a whole.
    struct Displaced<'a>(&'a Lattice, [Vec3; 2]);

    impl Moving for Displaced<'_> {
        fn from(&self, slot: u32) -> Vec3 {
            self.0.rest_position(slot) + self.1[0]
        }

        fn to(&self, slot: u32) -> Vec3 {
            self.0.rest_position(slot) + self.1[1]
        }
    }

    #[test]
    fn beside_the_tissue_a_blade_crosses_what_lies_in_its_way_wherever_the_tissue_has_moved() {
        let lattice = Lattice::new([4, 3, 2], H, &[1; 24]).unwrap();
        let margin = Margin::new(&lattice, 2);
        let height = |x: f64| 0.7 + 0.2 * x;
        let point = |x: f64, y: f64| Vec3::new(x, y, height(x)) * H;
        let (start, end) = (Vec3::new(3.0, -1.0, 2.0) * H, Vec3::new(2.5, 0.5, 1.5) * H);
        let sweep = Sweep {
            from: vec![point(-9.0, -9.0) + start, point(9.0, -9.0) + start],
            to: vec![point(-9.0, 9.0) + end, point(9.0, 9.0) + end],
        };
        let crossed: BTreeMap<GridEdge, f64> =
            sweep.crossed_beyond(&lattice, &margin, &Displaced(&lattice, [start, end])).into_iter().collect();
        let mut expected = 0;
        for &((low, axis), _) in margin.edges() {
            let [x, z] = [low[0], low[2]].map(f64::from);
            let at = match axis {
                0 => (z - 0.7) / 0.2 - x,
                1 => -1.0,
                _ => height(x) - z,
            };
            if (0.01..0.99).contains(&at) {
                expected += 1;
                assert!((crossed[&(low, axis)] - at).abs() < 1e-5);
            }
        }
        // Those that the blade passes at a node are on one side or the other.
        assert!(expected > 20 && crossed.len() <= expected + 8, "{expected} {}", crossed.len());
    }
}
