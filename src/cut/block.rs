//! The nodes of the cells of one brick, and which of them are so far to one side of a box that nothing between them meets it.

use super::extents::Extents;
use crate::model::lattice::{BRICK, BRICK_SLOTS, Lattice};

/// Nodes of the cells along each axis: one more than the brick's own.
const ALONG: [usize; 3] = [BRICK[0] + 1, BRICK[1] + 1, BRICK[2] + 1];
/// How far apart neighbours along each axis are.
const APART: [usize; 3] = [1, ALONG[0], ALONG[0] * ALONG[1]];
/// All of them.
const NODES: usize = ALONG[0] * ALONG[1] * ALONG[2];
/// No node, or beyond all sides of a box.
const NOTHING: u8 = !0;

/// The nodes of a brick's cells.
#[derive(Debug)]
pub struct Block {
    /// By their places, x fastest.
    slots: [u32; NODES],
    /// Beyond which sides of a box each is, see [`Bounds::sides`].
    sides: [u8; NODES],
}

/// A node that is a brick's own, and where it is in the block.
#[derive(Clone, Copy, Debug)]
pub struct Own {
    pub slot: u32,
    place: usize,
}

impl Block {
    /// Of a brick; `sides` says beyond which sides of a box a node stays.
    pub fn new(lattice: &Lattice, extents: &Extents, brick: u32, sides: impl Fn(u32) -> u8) -> Self {
        let mut block = Self { slots: [0; NODES], sides: [NOTHING; NODES] };
        let bricks = extents.nodes_of(brick);
        for place in 0..NODES {
            let at = [place % ALONG[0], place / APART[1] % ALONG[1], place / APART[2]];
            let beyond = [0, 1, 2].map(|axis| at[axis] / BRICK[axis]);
            let next = beyond[0] | beyond[1] << 1 | beyond[2] << 2;
            let [x, y, z] = [0, 1, 2].map(|axis| at[axis] % BRICK[axis]);
            let slot = bricks[next] as usize * BRICK_SLOTS + x + BRICK[0] * (y + BRICK[1] * z);
            // The brick itself stands for those that are not there.
            if (next == 0 || bricks[next] != brick) && lattice.words()[slot] != 0 {
                block.slots[place] = slot as u32;
                block.sides[place] = sides(slot as u32);
            }
        }
        block
    }

    /// The brick's own nodes, ascending.
    pub fn own(&self) -> impl Iterator<Item = Own> {
        let places = (0..BRICK_SLOTS).map(|n| {
            let [x, y, z] = [n % BRICK[0], n / BRICK[0] % BRICK[1], n / (BRICK[0] * BRICK[1])];
            x + y * APART[1] + z * APART[2]
        });
        places.filter(|&place| self.is_there(place)).map(|place| Own { slot: self.slots[place], place })
    }

    /// The node beyond a node along an axis, unless both are beyond one side of the box.
    pub fn next(&self, own: Own, axis: usize) -> Option<u32> {
        let next = own.place + APART[axis];
        (self.is_there(next) && self.sides[own.place] & self.sides[next] == 0).then(|| self.slots[next])
    }

    /// The nodes of the cell that starts at a node, unless one is missing or all are beyond one side of the box.
    pub fn cell(&self, own: Own) -> Option<[u32; 8]> {
        let corner =
            |c: usize| own.place + (c & 1) * APART[0] + (c >> 1 & 1) * APART[1] + (c >> 2) * APART[2];
        let corners: [usize; 8] = std::array::from_fn(corner);
        let beyond = corners.iter().fold(NOTHING, |all, &corner| all & self.sides[corner]);
        let are_there = corners.iter().all(|&corner| self.is_there(corner));
        (beyond == 0 && are_there).then(|| corners.map(|corner| self.slots[corner]))
    }

    fn is_there(&self, place: usize) -> bool {
        self.sides[place] != NOTHING
    }
}
