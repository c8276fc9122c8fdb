//! What a blade sweeps, and which edges of the tissue that crosses.
//!
//! Edges are looked at where they are now, deformed: trilinear motion keeps them straight, so that a share along the deformed edge is one along the edge at rest, and
//! no point of the blade has to be taken back to the tissue's rest. Nodes and the blade's points move straight from the start to the end of a sweep, and an edge is crossed where and when
//! it meets the blade on that way: where one sweep ends the next begins, and tissue that moves against a blade at rest is cut as well.

use super::block::Block;
use super::extents::Extents;
use super::margin::Margin;
use super::surface::grid::{GridEdge, GridNode, higher_end};
use super::topology::LatticeEdge;
use crate::math::{Bounds, Vec3};
use crate::model::lattice::Lattice;

/// How far beyond the end of a segment, as a share of its length, a meeting still counts: segments of a blade that share a point leave no gap.
const GAP: f64 = 1e-9;
/// Where the blade is taken to be beside where it is, in cells: so it passes every node on one side, though it be drawn through a layer of them.
const BESIDE: Vec3 = Vec3::new(5.3e-7, 7.1e-7, 6.1e-7);

/// A blade's edge during one step: a polyline at its start and at its end, m, model frame.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// The ends of its segments.
    segments: Vec<[Way; 2]>,
    boxes: Vec<Bounds>,
}

/// How tissue moves during one step.
pub trait Moving {
    /// What displaces a node, by its slot, at the start and at the end, m, model frame.
    fn moved(&self, slot: u32) -> [Vec3; 2];
}

impl Sweep {
    /// Of a polyline from one place to another, both of the same points, through a lattice of cells of such a length.
    pub fn new(from: &[Vec3], to: &[Vec3], cell_m: f64) -> Self {
        let segment = |(from, to): (&[Vec3], &[Vec3])| [0, 1].map(|end| Way { from: from[end], to: to[end] });
        let segments: Vec<_> = from.windows(2).zip(to.windows(2)).map(segment).collect();
        let around = |segment: &[Way; 2]| around(segment).widened(BESIDE.norm() * cell_m);
        Self { boxes: segments.iter().map(around).collect(), segments }
    }

    /// Boxes around what its segments sweep: what they do not meet is not crossed.
    pub fn boxes(&self) -> &[Bounds] {
        &self.boxes
    }

    /// The edges of a lattice's nodes that the sweep crosses, and where, as shares from their lower nodes: those of `bricks`, which ascend. `is_there` says whether tissue is left along an edge.
    pub fn crossed(
        &self,
        lattice: &Lattice,
        nodes: &impl Moving,
        extents: &Extents,
        bricks: &[u32],
        is_there: impl Fn(LatticeEdge) -> bool,
    ) -> Vec<(LatticeEdge, f64)> {
        let beside = BESIDE * lattice.cell_m();
        let way = |slot: u32| Way::of(lattice.rest_position(slot) - beside, nodes.moved(slot));
        let mut crossed = Vec::new();
        for &brick in bricks {
            let here = self.near(extents.of_cells(brick));
            let sides = |slot: u32, rest: Vec3| here.sides(&Way::of(rest - beside, nodes.moved(slot)));
            let block = Block::new(lattice, extents, brick, sides);
            for own in block.own() {
                for axis in 0..3 {
                    let Some(other) = block.next(own, axis) else { continue };
                    let edge = LatticeEdge { slot: own.slot, axis: axis as u8 };
                    let at = here.passes([way(own.slot), way(other)], || is_there(edge));
                    crossed.extend(at.map(|at| (edge, at)));
                }
            }
        }
        crossed
    }

    /// The edges of the empty cells around a lattice's tissue that the sweep crosses, and where: of some groups of them. They move as the tissue beside them does.
    pub fn crossed_beyond(
        &self,
        lattice: &Lattice,
        margin: &Margin,
        nodes: &impl Moving,
        extents: &Extents,
        groups: &[u32],
    ) -> Vec<(GridEdge, f64)> {
        let mut crossed = Vec::new();
        for &group in groups {
            let here = self.near(&margin.bounds(extents, group));
            let end = |node: GridNode, slot: u32| {
                let place = Vec3::from(node.map(f64::from)) - BESIDE;
                Way::of(place * lattice.cell_m(), nodes.moved(slot))
            };
            crossed.extend(margin.edges_of(group).filter_map(|&(edge, tissue)| {
                let ends = [end(edge.0, tissue[0]), end(higher_end(edge), tissue[1])];
                let beyond = here.sides(&ends[0]) & here.sides(&ends[1]);
                let at = if beyond == 0 { here.passes(ends, || true) } else { None };
                at.map(|at| (edge, at))
            }));
        }
        crossed.sort_unstable_by_key(|&(edge, _)| edge);
        crossed
    }

    /// The segments that come into a box.
    fn near(&self, around: &Bounds) -> Here {
        let near = self.segments.iter().zip(&self.boxes).filter(|(_, bounds)| bounds.meets(around, 0.0));
        let segments: Vec<_> = near.map(|(&segment, &bounds)| (segment, bounds)).collect();
        let bounds = segments.iter().fold(Bounds::EMPTY, |all, (_, bounds)| all.union(bounds));
        Here { segments, bounds }
    }
}

/// The segments that come into a box, the boxes around what they sweep, and one around all these.
#[derive(Debug)]
struct Here {
    segments: Vec<([Way; 2], Bounds)>,
    bounds: Bounds,
}

impl Here {
    /// Beyond which sides of what is swept a point stays.
    fn sides(&self, way: &Way) -> u8 {
        self.bounds.sides(way.from) & self.bounds.sides(way.to)
    }

    /// Where they cross an edge whose ends move, if it is there at all: the lowest share of it.
    fn passes(&self, ends: [Way; 2], is_there: impl Fn() -> bool) -> Option<f64> {
        let edge = around(&ends);
        let mut near = self.segments.iter().filter(|(_, bounds)| bounds.meets(&edge, 0.0)).peekable();
        if near.peek().is_none() || !is_there() {
            return None;
        }
        near.filter_map(|&(segment, _)| meeting(ends, segment)).min_by(f64::total_cmp)
    }
}

/// Around a segment wherever it goes.
fn around(ends: &[Way; 2]) -> Bounds {
    Bounds::of(ends.iter().flat_map(|end| [&end.from, &end.to]))
}

/// A point that moves straight.
#[derive(Clone, Copy, Debug)]
struct Way {
    from: Vec3,
    to: Vec3,
}

impl Way {
    fn of(rest: Vec3, moved: [Vec3; 2]) -> Self {
        Self { from: rest + moved[0], to: rest + moved[1] }
    }

    fn at(&self, t: f64) -> Vec3 {
        self.from.lerp(&self.to, t)
    }
}

/// Where two segments with moving ends first meet, as a share of the first.
fn meeting([a, b]: [Way; 2], [p, q]: [Way; 2]) -> Option<f64> {
    // Both lie in one plane when this is zero: a cubic in time.
    let apart = |t: f64| {
        let (a, p) = (a.at(t), p.at(t));
        (b.at(t) - a).cross(&(q.at(t) - p)).dot(&(p - a))
    };
    roots_of_cubic(apart).into_iter().flatten().find_map(|t| {
        let (a, b, p, q) = (a.at(t), b.at(t), p.at(t), q.at(t));
        let (edge, blade, between) = (b - a, q - p, p - a);
        let normal = edge.cross(&blade);
        let area2 = normal.norm_squared();
        // Segments along each other, or without a length, part nothing.
        if area2 <= f64::EPSILON * edge.norm_squared() * blade.norm_squared() {
            return None;
        }
        let share = between.cross(&blade).dot(&normal) / area2;
        let along = between.cross(&edge).dot(&normal) / area2;
        let within = -GAP..=1.0 + GAP;
        (within.contains(&share) && within.contains(&along)).then(|| share.clamp(0.0, 1.0))
    })
}

/// The roots of a cubic from 0 to 1 at which it changes its sign, ascending.
fn roots_of_cubic(f: impl Fn(f64) -> f64) -> [Option<f64>; 3] {
    // c0 + c1 t + c2 t² + c3 t³ through four of its points.
    let [f0, f1, f2, f3] = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0].map(&f);
    let (c1, c2, c3) = (
        -5.5 * f0 + 9.0 * f1 - 4.5 * f2 + f3,
        9.0 * f0 - 22.5 * f1 + 18.0 * f2 - 4.5 * f3,
        4.5 * (f3 - f0) + 13.5 * (f1 - f2),
    );
    // It is monotone between these.
    let turn = (c2 * c2 - 3.0 * c1 * c3).max(0.0).sqrt();
    let mut bends = if c3.abs() > 1e-12 * (c1.abs() + c2.abs()) {
        [(-c2 - turn) / (3.0 * c3), (-c2 + turn) / (3.0 * c3)]
    } else {
        [-0.5 * c1 / c2; 2]
    };
    bends = bends.map(|t| if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.0 });
    bends.sort_by(f64::total_cmp);
    let ends = [0.0, bends[0], bends[1], 1.0];
    std::array::from_fn(|n| {
        let (mut low, mut high) = (ends[n], ends[n + 1]);
        let (at_low, at_high) = (f(low), f(high));
        if (at_low > 0.0) == (at_high > 0.0) || low == high {
            return None;
        }
        for _ in 0..52 {
            let middle = 0.5 * (low + high);
            if (f(middle) > 0.0) == (at_low > 0.0) { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    })
}

/// Where a triangle crosses the segment from `a` to `b`, as a share of it: a cut for tests.
#[cfg(test)]
pub(crate) fn share(a: Vec3, b: Vec3, [p, q, r]: [Vec3; 3]) -> Option<f64> {
    let (along, u, v) = (b - a, q - p, r - p);
    let normal = u.cross(&v);
    let at = normal.dot(&(p - a)) / normal.dot(&along);
    let there = a + along * at - p;
    let (s, t) = (normal.dot(&there.cross(&v)), normal.dot(&u.cross(&there)));
    let is_inside = s >= 0.0 && t >= 0.0 && s + t <= normal.norm_squared();
    ((0.0..=1.0).contains(&at) && is_inside).then_some(at)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::noise::Noise;

    const H: f64 = 2e-3;

    /// Tissue that is displaced as a whole.
    struct Displaced([Vec3; 2]);

    impl Moving for Displaced {
        fn moved(&self, _: u32) -> [Vec3; 2] {
            self.0
        }
    }

    #[test]
    fn beside_the_tissue_a_blade_crosses_what_lies_in_its_way_wherever_the_tissue_has_moved() {
        let lattice = Lattice::new([4, 3, 2], H, &[1; 24]).unwrap();
        let margin = Margin::new(&lattice, 2);
        let height = |x: f64| 0.7 + 0.2 * x;
        let point = |x: f64, y: f64| Vec3::new(x, y, height(x)) * H;
        let (start, end) = (Vec3::new(3.0, -1.0, 2.0) * H, Vec3::new(2.5, 0.5, 1.5) * H);
        let from = [point(-9.0, -9.0) + start, point(9.0, -9.0) + start];
        let to = [point(-9.0, 9.0) + end, point(9.0, 9.0) + end];
        let sweep = Sweep::new(&from, &to, H);
        let nodes = Displaced([start, end]);
        let mut extents = Extents::new(&lattice);
        // As a device that is lost leaves it.
        extents.look(|_| (), true);
        assert!(margin.near(&extents, sweep.boxes()).is_empty() && extents.near(sweep.boxes()).is_empty());
        for u in [start, end] {
            extents.look(|all| all.resize(lattice.bricks().len(), Bounds { low: u, high: u }), true);
        }
        let groups = margin.near(&extents, sweep.boxes());
        let crossed: BTreeMap<GridEdge, f64> =
            sweep.crossed_beyond(&lattice, &margin, &nodes, &extents, &groups).into_iter().collect();
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

    fn point(noise: &mut Noise) -> Vec3 {
        Vec3::from_fn(|_, _| noise.next())
    }

    #[test]
    fn moving_segments_meet_where_they_were_made_to() {
        let mut noise = Noise(17);
        for _ in 0..2000 {
            // Through a point at a moment, with ends that go anywhere.
            let (t, share, along) = (noise.next().abs(), noise.next().abs(), noise.next().abs());
            let mut ways = [(); 4].map(|()| Way { from: point(&mut noise), to: point(&mut noise) });
            let [a, b, p, q] = ways.map(|way| way.at(t));
            let off = a.lerp(&b, share) - p.lerp(&q, along);
            for way in &mut ways[2..] {
                (way.from, way.to) = (way.from + off, way.to + off);
            }
            let met = meeting([ways[0], ways[1]], [ways[2], ways[3]]).expect("they meet");
            // They may have met before: then there too both are at one place, which a search in small steps finds.
            let first = (0..=200_000).map(|n| f64::from(n) / 200_000.0).take_while(|&s| s <= t);
            let nearest = |s: f64| {
                let (e, m) = (ways[0].at(s).lerp(&ways[1].at(s), met), (ways[2].at(s), ways[3].at(s)));
                let along = ((e - m.0).dot(&(m.1 - m.0)) / (m.1 - m.0).norm_squared()).clamp(0.0, 1.0);
                (e - m.0.lerp(&m.1, along)).norm()
            };
            if (met - share).abs() > 1e-6 {
                assert!(first.map(nearest).fold(f64::INFINITY, f64::min) < 1e-4);
            }
        }
    }

    #[test]
    fn an_edge_that_turns_or_is_held_at_one_end_is_met_by_a_blade_at_rest() {
        let blade = [Vec3::new(0.8, -1.0, 0.1), Vec3::new(0.8, 1.0, 0.1)].map(|p| Way { from: p, to: p });
        let still = |p: Vec3| Way { from: p, to: p };
        let rises = |p: Vec3, by: f64| Way { from: p, to: p + Vec3::z() * by };
        let held = [still(Vec3::zeros()), rises(Vec3::x(), 0.2)];
        assert!((meeting(held, blade).unwrap() - 0.8).abs() < 1e-12);
        let turning = [rises(Vec3::zeros(), -0.4), rises(Vec3::x(), 0.4)];
        assert!((meeting(turning, blade).unwrap() - 0.8).abs() < 1e-12);
        // Beside the blade, short of it, and with it: not at all.
        assert!(meeting([held[0], rises(Vec3::x() * 0.7, 0.2)], blade).is_none());
        assert!(meeting([held[0], rises(Vec3::x(), 0.12)], blade).is_none());
        let along = Vec3::z() * 0.3;
        let carried = blade.map(|way| Way { to: way.to + along, ..way });
        assert!(meeting([rises(Vec3::zeros(), 0.3), rises(Vec3::x(), 0.3)], carried).is_none());
    }
}
