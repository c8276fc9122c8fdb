//! The nodes of the cells of one brick, and which of them are so far to one side of a box that nothing between them meets it.

use super::extents::Extents;
use crate::math::Vec3;
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
    /// Of a brick; `sides` says beyond which sides of a box a node stays, by its slot and where it is at rest, m, model frame.
    pub fn new(lattice: &Lattice, extents: &Extents, brick: u32, sides: impl Fn(u32, Vec3) -> u8) -> Self {
        let mut block = Self { slots: [0; NODES], sides: [NOTHING; NODES] };
        let (bricks, words, h) = (extents.nodes_of(brick), lattice.words(), lattice.cell_m());
        let first = lattice.node_of(brick * BRICK_SLOTS as u32);
        let mut place = 0;
        for z in 0..ALONG[2] {
            for y in 0..ALONG[1] {
                for x in 0..ALONG[0] {
                    let next = (x / BRICK[0]) | ((y / BRICK[1]) << 1) | ((z / BRICK[2]) << 2);
                    let node = x % BRICK[0] + BRICK[0] * (y % BRICK[1] + BRICK[1] * (z % BRICK[2]));
                    let slot = bricks[next] as usize * BRICK_SLOTS + node;
                    // The brick itself stands for those that are not there.
                    if (next == 0 || bricks[next] != brick) && words[slot] != 0 {
                        let at = [first[0] + x, first[1] + y, first[2] + z].map(|n| n as f64 * h);
                        block.slots[place] = slot as u32;
                        block.sides[place] = sides(slot as u32, at.into());
                    }
                    place += 1;
                }
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
