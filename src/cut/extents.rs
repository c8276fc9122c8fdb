//! Where the bricks of a lattice are, as its nodes move: what a blade is far from need not be looked at.

use crate::math::Vec3;
use crate::model::lattice::{BRICK, BRICK_SLOTS, Lattice, NO_BRICK};

/// A box along the axes.
type Bounds = (Vec3, Vec3);

/// For each brick a box around its nodes, at the start and at the end of a step, and around those of its cells.
#[derive(Clone, Debug, Default)]
pub struct Extents {
    of_bricks: Vec<Bounds>,
    /// What displaces nodes of each brick at the end: least and most along each axis.
    displaced: Vec<Bounds>,
}

impl Extents {
    /// Of a lattice whose nodes are `displaced` so far at the end, by their slots, in m; at the start as they were at the end of the step `before`, if there was one. Boxes are those of
    /// bricks at rest, widened and moved by what displaces their nodes: no smaller than they need be.
    pub fn new(lattice: &Lattice, displaced: impl Fn(u32) -> Vec3, before: Option<&Self>) -> Self {
        let now: Vec<Bounds> = (0..lattice.bricks().len())
            .map(|brick| {
                let (mut low, mut high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
                for slot in brick * BRICK_SLOTS..(brick + 1) * BRICK_SLOTS {
                    if lattice.words()[slot] == 0 {
                        continue;
                    }
                    let u = displaced(slot as u32);
                    for axis in 0..3 {
                        low[axis] = if u[axis] < low[axis] { u[axis] } else { low[axis] };
                        high[axis] = if u[axis] > high[axis] { u[axis] } else { high[axis] };
                    }
                }
                (low, high)
            })
            .collect();
        let size = Vec3::from(BRICK.map(|n| (n - 1) as f64)) * lattice.cell_m();
        let own = |brick: usize| {
            let corner = lattice.rest_position((brick * BRICK_SLOTS) as u32);
            let then = before.map_or(now[brick], |before| before.displaced[brick]);
            let (low, high) = (now[brick].0.inf(&then.0), now[brick].1.sup(&then.1));
            (corner + low, corner + size + high)
        };
        let own: Vec<Bounds> = (0..lattice.bricks().len()).map(own).collect();
        // Cells at a brick's high faces reach into the next ones.
        let around = |brick: &[u16; 3]| {
            let next =
                (0..8).map(|n| lattice.brick_at([0, 1, 2].map(|a| i64::from(brick[a]) + (n >> a & 1))));
            let there = next.filter(|&next| next != NO_BRICK).map(|next| own[next as usize]);
            there.reduce(|all, one| (all.0.inf(&one.0), all.1.sup(&one.1))).expect("a brick is there itself")
        };
        Self { of_bricks: lattice.bricks().iter().map(around).collect(), displaced: now }
    }

    /// Whether a brick comes within `reach` of a box.
    pub fn is_near(&self, brick: usize, (low, high): Bounds, reach: f64) -> bool {
        let (from, to) = self.of_bricks[brick];
        (0..3).all(|c| to[c] + reach >= low[c] && from[c] - reach <= high[c])
    }

    /// Slots of the bricks near a box that hold nodes, ascending.
    pub fn slots_near<'a>(&'a self, lattice: &'a Lattice, bounds: Bounds) -> impl Iterator<Item = u32> + 'a {
        let near = (0..self.of_bricks.len()).filter(move |&brick| self.is_near(brick, bounds, 0.0));
        near.flat_map(|brick| brick * BRICK_SLOTS..(brick + 1) * BRICK_SLOTS)
            .filter(|&slot| lattice.words()[slot] != 0)
            .map(|slot| slot as u32)
    }
}
