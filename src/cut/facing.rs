//! The two sides of a cut, face to face: what contact between them needs to know.
//!
//! One pair for each wall in a divided cell, at the middle of the wall. Both sides have the same weights there, each on the nodes of its own piece; at rest they touch. Pairs
//! come in classes of cells that share no node, so that those of a class can be kept apart side by side.

use std::collections::BTreeMap;

use super::topology::{Change, DividedCell, Topology};
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
    /// Those of a divided cell, by its slot.
    fn of_cell(topology: &Topology, slot: u32, cell: &DividedCell) -> Vec<Self> {
        let mut pairs: Vec<[usize; 2]> = Vec::new();
        let is_left = |&piece: &usize| topology.is_left(&cell.pieces[piece]);
        for wall in cell.walls.iter().filter(|wall| wall.pieces.iter().all(is_left)) {
            if !pairs.contains(&wall.pieces) {
                pairs.push(wall.pieces);
            }
        }
        let facing = |pieces: [usize; 2]| {
            let (mut area, mut middle) = (Vec3::zeros(), Vec3::zeros());
            let mut size = 0.0;
            for [a, b, c] in cell.walls.iter().filter(|wall| wall.pieces == pieces).map(|wall| wall.corners) {
                let part = 0.5 * (b - a).cross(&(c - a));
                area += part;
                middle += (a + b + c) / 3.0 * part.norm();
                size += part.norm();
            }
            // A wall that closes upon itself faces nobody.
            let normal = area.try_normalize(1e-9)?;
            let nodes = pieces.map(|piece| cell.pieces[piece].nodes);
            Some(Self { cell: slot, nodes, weights: shares(&(middle / size)), normal })
        };
        pairs.into_iter().filter_map(facing).collect()
    }
}

/// All pairs, by classes and in these by cells ascending.
#[derive(Clone, Debug, Default)]
pub struct Facings(BTreeMap<(usize, u32), Vec<Facing>>);

impl Facings {
    /// Takes over what a cut has changed.
    pub fn follow(&mut self, topology: &Topology, change: &Change) {
        for slot in change.reshaped().chain(change.rehung.iter().copied()) {
            let facing = topology.cell(slot).map_or(Vec::new(), |cell| Facing::of_cell(topology, slot, cell));
            let key = (class(slot), slot);
            if facing.is_empty() {
                self.0.remove(&key)
            } else {
                self.0.insert(key, facing)
            };
        }
    }

    /// All cells are whole again.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The pairs.
    pub fn iter(&self) -> impl Iterator<Item = &Facing> {
        self.0.values().flatten()
    }

    /// The classes, each with its cells' pairs.
    pub fn cells(&self) -> impl Iterator<Item = (usize, &[Facing])> {
        self.0.iter().map(|(&(class, _), facing)| (class, facing.as_slice()))
    }
}

/// Which class a cell is in, by the slot of its lowest corner.
fn class(cell: u32) -> usize {
    // Bricks have an even number of nodes along each axis.
    let [x, y, _] = BRICK;
    let local = cell as usize;
    local & 1 | ((local / x) & 1) << 1 | ((local / (x * y)) & 1) << 2
}
