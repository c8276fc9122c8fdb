//! The lattice: occupied cells of a cubic grid, their corner nodes in bricks, and what each node needs to know.
//!
//! **Model frame.** The lattice lives in its own axis-aligned frame: cell `(i, j, k)` fills
//! `[i, i+1] × [j, j+1] × [k, k+1]` times the cell size, and node `(i, j, k)` is its lowest corner, at `(i, j, k) * h`.
//!
//! **Bricks and slots.** Nodes are stored in bricks of 8 × 4 × 4 (x fastest). A node's *slot* is
//! `brick * 128 + (k % 4) * 32 + (j % 4) * 8 + i % 8`. Only bricks that contain a node exist; they are sorted by
//! (z, y, x), so that neighbours along x follow each other in memory.

use crate::error::{Error, Result};
use crate::math::Vec3;

/// Nodes of a brick along x, y, z.
pub const BRICK: [usize; 3] = [8, 4, 4];
/// Slots of a brick.
pub const BRICK_SLOTS: usize = BRICK[0] * BRICK[1] * BRICK[2];
/// "No such brick" in a neighbour table.
pub const NO_BRICK: u32 = u32::MAX;

/// Flag bits of a node.
pub mod flag {
    /// Displacement along the model's x axis is held.
    pub const FIX_X: u8 = 1;
    /// Displacement along the model's y axis is held.
    pub const FIX_Y: u8 = 2;
    /// Displacement along the model's z axis is held.
    pub const FIX_Z: u8 = 4;
    /// All three axes.
    pub const FIX_ALL: u8 = FIX_X | FIX_Y | FIX_Z;
    /// The node belongs to a rigid region that the host may drive.
    pub const DRIVEN: u8 = 8;
    /// The node is held by a tool.
    pub const GRASPED: u8 = 16;
}

/// Occupied cells and their nodes. Immutable.
#[derive(Clone, Debug)]
pub struct Lattice {
    pub(crate) cell_m: f64,
    pub(crate) cells: [usize; 3],
    pub(crate) bricks: Vec<[u16; 3]>,
    pub(crate) brick_table: Vec<u32>,
    pub(crate) words: Vec<u32>,
    pub(crate) flags: Vec<u8>,
    pub(crate) node_count: usize,
    pub(crate) cell_count: usize,
}

impl Lattice {
    /// The lattice of the occupied cells of a grid.
    ///
    /// `materials` holds a material index for each cell, x fastest: 0 is empty, 1 to 15 are occupied. Nothing is held.
    pub fn new(cells: [usize; 3], cell_m: f64, materials: &[u8]) -> Result<Self> {
        let table_dims = [0, 1, 2].map(|a| cells[a] / BRICK[a] + 1);
        if table_dims.iter().any(|&n| n > usize::from(u16::MAX)) {
            return Err(Error::Limit(format!("a lattice of {cells:?} cells is too large")));
        }
        let cell_count = materials.iter().filter(|&&m| m != 0).count();
        if cell_count == 0 {
            return Err(Error::argument("no cell of the model is occupied: nothing to simulate"));
        }

        // Each occupied cell marks the bricks of its eight corners.
        let mut brick_table = vec![NO_BRICK; table_dims.iter().product()];
        let table_index = |b: [usize; 3]| b[0] + table_dims[0] * (b[1] + table_dims[1] * b[2]);
        for_each_cell(cells, materials, |cell, _| {
            for corner in 0..8 {
                let node = corner_node(cell, corner);
                brick_table[table_index([0, 1, 2].map(|a| node[a] / BRICK[a]))] = 0;
            }
        });

        // Bricks are numbered along x first, so that a row of bricks is a row in memory.
        let mut bricks = Vec::new();
        for (index, brick) in brick_table.iter_mut().enumerate().filter(|(_, b)| **b != NO_BRICK) {
            *brick = bricks.len() as u32;
            let (x, rest) = (index % table_dims[0], index / table_dims[0]);
            bricks.push([x, rest % table_dims[1], rest / table_dims[1]].map(|c| c as u16));
        }
        if bricks.len() > (u32::MAX as usize) / BRICK_SLOTS {
            return Err(Error::Limit(format!("a lattice of {} bricks is too large", bricks.len())));
        }

        // Each cell writes its material into the words of its corners: for corner c it is the cell at the opposite offset.
        let mut words = vec![0_u32; bricks.len() * BRICK_SLOTS];
        for_each_cell(cells, materials, |cell, material| {
            for corner in 0..8 {
                let node = corner_node(cell, corner);
                let brick = brick_table[table_index([0, 1, 2].map(|a| node[a] / BRICK[a]))];
                words[slot_in(brick, node)] |= u32::from(material) << (4 * (7 - corner));
            }
        });

        // A slot without a node is held, so that no kernel has to ask whether it exists.
        let flags = words.iter().map(|&w| if w == 0 { flag::FIX_ALL } else { 0 }).collect();
        let node_count = words.iter().filter(|&&w| w != 0).count();
        Ok(Self { cell_m, cells, bricks, brick_table, words, flags, node_count, cell_count })
    }

    /// Bricks `[brick_count]`: their coordinates, in units of bricks.
    pub fn bricks(&self) -> &[[u16; 3]] {
        &self.bricks
    }

    /// The 27 bricks around each brick, x fastest, itself at 13; the number of bricks where there is none.
    pub fn surroundings(&self) -> impl Iterator<Item = [u32; 27]> + '_ {
        self.bricks.iter().map(|brick| {
            std::array::from_fn(|n| {
                let offset = [n % 3, n / 3 % 3, n / 9].map(|c| c as i64 - 1);
                let near = self.brick_at([0, 1, 2].map(|a| i64::from(brick[a]) + offset[a]));
                near.min(self.bricks.len() as u32)
            })
        })
    }

    /// The brick at brick coordinates, or [`NO_BRICK`].
    pub fn brick_at(&self, brick: [i64; 3]) -> u32 {
        let dims = self.table_dims();
        if (0..3).any(|a| brick[a] < 0 || brick[a] >= dims[a] as i64) {
            return NO_BRICK;
        }
        self.brick_table[self.table_index(brick.map(|c| c as usize))]
    }

    /// The occupied cells in a fixed order: coordinates and material index.
    pub fn occupied(&self) -> impl Iterator<Item = ([usize; 3], u8)> + '_ {
        self.words.iter().enumerate().filter(|(_, word)| **word >> 28 != 0).map(|(slot, word)| {
            // The slot of a cell's lowest corner; no lattice has more than 2³² slots.
            (self.node_of(slot as u32), (word >> 28) as u8)
        })
    }

    /// The slots of a cell's corners; corner c is at offset `(c & 1, c >> 1 & 1, c >> 2 & 1)`. The cell must be occupied.
    pub fn corners(&self, cell: [usize; 3]) -> [u32; 8] {
        std::array::from_fn(|corner| {
            let node = corner_node(cell, corner);
            let brick = self.brick_table[self.table_index([0, 1, 2].map(|a| node[a] / BRICK[a]))];
            slot_in(brick, node) as u32
        })
    }

    /// Mass of the node in a slot, given the corner mass of each material.
    pub fn node_mass(&self, slot: u32, corner_kg: impl Fn(u8) -> f64) -> f64 {
        let word = self.words[slot as usize];
        (0..8).map(|c| (word >> (4 * c) & 15) as u8).filter(|&m| m != 0).map(corner_kg).sum()
    }

    /// Edge length h of a cell, in metres.
    pub fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// Cells of the bounding grid along x, y, z.
    pub fn cells(&self) -> [usize; 3] {
        self.cells
    }

    /// Material of cell `(i, j, k)`: 0 where empty or outside the grid.
    pub fn cell_material(&self, cell: [usize; 3]) -> u8 {
        // A cell is the nibble 7 of the word of its lowest corner, which exists where the cell does.
        self.slot(cell).map_or(0, |slot| (self.words[slot as usize] >> 28) as u8)
    }

    /// The slot of node `(i, j, k)`, if that node exists (touches an occupied cell).
    pub fn slot(&self, node: [usize; 3]) -> Option<u32> {
        if (0..3).any(|a| node[a] > self.cells[a]) {
            return None;
        }
        let brick =
            self.brick_table[self.table_index([node[0] / BRICK[0], node[1] / BRICK[1], node[2] / BRICK[2]])];
        if brick == NO_BRICK {
            return None;
        }
        let local = node[0] % BRICK[0] + BRICK[0] * (node[1] % BRICK[1] + BRICK[1] * (node[2] % BRICK[2]));
        let slot = brick as usize * BRICK_SLOTS + local;
        (self.words[slot] != 0).then_some(slot as u32)
    }

    /// Grid coordinates of the node in a slot.
    pub fn node_of(&self, slot: u32) -> [usize; 3] {
        let (brick, local) = (slot as usize / BRICK_SLOTS, slot as usize % BRICK_SLOTS);
        let [bx, by, bz] = self.bricks[brick].map(usize::from);
        [bx * BRICK[0] + local % 8, by * BRICK[1] + local / 8 % 4, bz * BRICK[2] + local / 32]
    }

    /// Rest position of the node in a slot, model frame, metres.
    pub fn rest_position(&self, slot: u32) -> Vec3 {
        let [i, j, k] = self.node_of(slot);
        Vec3::new(i as f64, j as f64, k as f64) * self.cell_m
    }

    /// Number of nodes (slots whose word is not 0).
    pub fn node_count(&self) -> usize {
        self.node_count
    }

    /// Number of occupied cells.
    pub fn cell_count(&self) -> usize {
        self.cell_count
    }

    /// Number of slots, used or not: 128 for each brick.
    pub fn slot_count(&self) -> usize {
        self.words.len()
    }

    /// The slots that hold a node, ascending `[node_count]`.
    pub fn slots(&self) -> impl Iterator<Item = u32> + '_ {
        self.words.iter().enumerate().filter(|(_, word)| **word != 0).map(|(slot, _)| slot as u32)
    }

    /// The slots of some bricks that hold a node, brick by brick, ascending in each.
    pub fn slots_of<'a>(&'a self, bricks: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
        let slots = bricks.iter().flat_map(|&brick| {
            let first = brick as usize * BRICK_SLOTS;
            first..first + BRICK_SLOTS
        });
        slots.filter(|&slot| self.words[slot] != 0).map(|slot| slot as u32)
    }

    /// The eight cell materials around each node `[slot_count]`, four bits each: bits 4c to 4c + 3 hold the cell at offset
    /// `(c & 1, c >> 1 & 1, c >> 2 & 1) - 1`, so nibble 7 is the node's own cell `(i, j, k)`. 0 where there is no node.
    pub fn words(&self) -> &[u32] {
        &self.words
    }

    /// Flag bits of each node `[slot_count]`, see [`flag`].
    pub fn flags(&self) -> &[u8] {
        &self.flags
    }

    fn table_dims(&self) -> [usize; 3] {
        [self.cells[0] / BRICK[0] + 1, self.cells[1] / BRICK[1] + 1, self.cells[2] / BRICK[2] + 1]
    }

    fn table_index(&self, brick: [usize; 3]) -> usize {
        let dims = self.table_dims();
        brick[0] + dims[0] * (brick[1] + dims[1] * brick[2])
    }
}

/// Slot of a node in its brick.
fn slot_in(brick: u32, node: [usize; 3]) -> usize {
    let local = node[0] % BRICK[0] + BRICK[0] * (node[1] % BRICK[1] + BRICK[1] * (node[2] % BRICK[2]));
    brick as usize * BRICK_SLOTS + local
}

/// Corner c of a cell is at offset `(c & 1, c >> 1 & 1, c >> 2 & 1)`.
fn corner_node(cell: [usize; 3], corner: usize) -> [usize; 3] {
    [cell[0] + (corner & 1), cell[1] + (corner >> 1 & 1), cell[2] + (corner >> 2 & 1)]
}

/// Visits the occupied cells, x fastest.
fn for_each_cell(cells: [usize; 3], materials: &[u8], mut visit: impl FnMut([usize; 3], u8)) {
    let mut index = 0;
    for k in 0..cells[2] {
        for j in 0..cells[1] {
            for i in 0..cells[0] {
                if materials[index] != 0 {
                    visit([i, j, k], materials[index]);
                }
                index += 1;
            }
        }
    }
}
