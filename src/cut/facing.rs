//! The two sides of a cut, face to face: what contact between them needs to know.
//!
//! One pair for each wall in a divided cell, at the middle of the wall. Both sides have the same weights there, each on the nodes of its own piece; at rest they touch. Pairs
//! come in classes of cells that share no node, so that those of a class can be kept apart side by side.

use super::topology::Topology;
use crate::math::Vec3;
use crate::model::binding::shares;
use crate::model::lattice::BRICK;

/// How many classes there are: cells of one have coordinates that are odd along the same axes.
pub const CLASSES: usize = 8;

/// A wall and the pieces on its two sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facing {
    /// The cell, by the slot of its lowest corner.
    pub cell: u32,
    /// Slots of the nodes of either side; the wall faces the first.
    pub nodes: [[u32; 8]; 2],
    /// Weights of the nodes at the middle of the wall, on both sides.
    pub weights: [f64; 8],
    /// Unit normal at rest, from the second side to the first.
    pub normal: Vec3,
}

impl Facing {
    /// Which class its cell is in.
    pub fn class(&self) -> usize {
        // Bricks have an even number of nodes along each axis.
        let [x, y, _] = BRICK;
        let local = self.cell as usize;
        local & 1 | ((local / x) & 1) << 1 | ((local / (x * y)) & 1) << 2
    }

    /// All of a topology, by classes and in these by cells ascending.
    pub fn all(topology: &Topology) -> Vec<Self> {
        let mut all = Vec::new();
        for (slot, cell) in topology.cells() {
            let mut pairs: Vec<[usize; 2]> = Vec::new();
            let is_left = |&piece: &usize| topology.is_left(&cell.pieces[piece]);
            for wall in cell.walls.iter().filter(|wall| wall.pieces.iter().all(is_left)) {
                if !pairs.contains(&wall.pieces) {
                    pairs.push(wall.pieces);
                }
            }
            for pieces in pairs {
                let (mut area, mut middle) = (Vec3::zeros(), Vec3::zeros());
                let mut size = 0.0;
                for [a, b, c] in
                    cell.walls.iter().filter(|wall| wall.pieces == pieces).map(|wall| wall.corners)
                {
                    let part = 0.5 * (b - a).cross(&(c - a));
                    area += part;
                    middle += (a + b + c) / 3.0 * part.norm();
                    size += part.norm();
                }
                // A wall that closes upon itself faces nobody.
                let Some(normal) = area.try_normalize(1e-9) else { continue };
                all.push(Self {
                    cell: slot,
                    nodes: pieces.map(|piece| cell.pieces[piece].nodes),
                    weights: shares(&(middle / size)),
                    normal,
                });
            }
        }
        all.sort_by_key(Self::class);
        all
    }
}
