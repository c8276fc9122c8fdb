//! Where the bricks of a lattice are, as its nodes move: what a blade is far from need not be looked at.

use super::sweep::Moving;
use crate::math::Vec3;
use crate::model::lattice::{BRICK_SLOTS, Lattice, NO_BRICK};

/// A box along the axes.
type Bounds = (Vec3, Vec3);

/// For each brick a box around its nodes, at the start and at the end of a step, and around those of its cells.
#[derive(Clone, Debug, Default)]
pub struct Extents {
    of_bricks: Vec<Bounds>,
}

impl Extents {
    /// Of a lattice whose nodes move.
    pub fn new(lattice: &Lattice, nodes: &impl Moving) -> Self {
        let mut own =
            vec![(Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY)); lattice.bricks().len()];
        for slot in lattice.slots() {
            let (low, high) = &mut own[slot as usize / BRICK_SLOTS];
            for at in [nodes.from(slot), nodes.to(slot)] {
                (*low, *high) = (low.inf(&at), high.sup(&at));
            }
        }
        // Cells at a brick's high faces reach into the next ones.
        let around = |brick: &[u16; 3]| {
            let next =
                (0..8).map(|n| lattice.brick_at([0, 1, 2].map(|a| i64::from(brick[a]) + (n >> a & 1))));
            let there = next.filter(|&next| next != NO_BRICK).map(|next| own[next as usize]);
            there.reduce(|all, one| (all.0.inf(&one.0), all.1.sup(&one.1))).expect("a brick is there itself")
        };
        Self { of_bricks: lattice.bricks().iter().map(around).collect() }
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
