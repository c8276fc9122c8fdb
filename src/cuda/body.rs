//! What the host keeps of materials, of what is held and of the topology: they may differ from the model's.

use std::sync::Arc;

use crate::cpu::nodes::Bricks;
use crate::model::Model;
use crate::model::lattice::{BRICK_SLOTS, flag};
use crate::model::law::CellLaw;

/// Laws of cells by material, flags of nodes by slot, and bricks, behind which lie loose ones for copies of nodes.
#[derive(Debug)]
pub struct Body {
    pub laws: [CellLaw; 16],
    pub flags: Vec<u8>,
    pub bricks: Bricks,
}

impl Body {
    /// The model's own, with room for so many copies.
    pub fn of(model: &Arc<Model>, copies: usize) -> Self {
        let bricks = Bricks::new(model.clone(), copies.div_ceil(BRICK_SLOTS));
        Self { laws: *model.laws(), flags: bricks.flags(), bricks }
    }

    /// Whether any material asks for volume terms, and whether any damps its springs.
    pub fn asks_for(&self) -> (bool, bool) {
        (self.laws.iter().any(|law| law.volume_n > 0.0), self.laws.iter().any(|law| law.damping_s > 0.0))
    }

    /// What a cell of each material gives to a corner, in kg.
    pub fn corner_kg(&self) -> impl Fn(u8) -> f64 {
        |material| self.laws[usize::from(material)].corner_kg
    }

    /// Mass of the node in a slot, in kg.
    pub fn node_mass(&self, slot: u32) -> f64 {
        self.bricks.node_mass(slot, self.corner_kg())
    }

    /// Words of all slots, and of the empty brick behind them.
    pub fn words(&self) -> impl Iterator<Item = u32> {
        (0..(self.slot_count() + BRICK_SLOTS) as u32).map(|slot| self.bricks.word(slot))
    }

    /// Number of slots, those of loose bricks included.
    pub fn slot_count(&self) -> usize {
        self.bricks.slot_count()
    }

    /// Of those, the lattice's own.
    pub fn own_slots(&self) -> usize {
        self.bricks.model.lattice().slot_count()
    }

    /// Bricks that hold nodes when there are so many copies.
    pub fn bricks_for(&self, copies: usize) -> u32 {
        (self.own_slots().div_ceil(BRICK_SLOTS) + copies.div_ceil(BRICK_SLOTS)) as u32
    }

    /// Makes all cells whole, and forgets all copies.
    pub fn heal(&mut self) {
        self.bricks.heal();
        let own = self.own_slots();
        self.flags[own..].fill(flag::FIX_ALL);
    }
}
