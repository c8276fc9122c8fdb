//! Local numbers of the nodes that carry contact points.

/// Most nodes that have a number.
pub const MAX_NODES: usize = 8192;

/// Local numbers of slots: open addressing in a table that is never more than half full.
#[derive(Debug)]
pub struct NodeIndex {
    /// Slot and local number; the slot is `u32::MAX` where free.
    table: Vec<(u32, u32)>,
    used: Vec<u32>,
}

impl NodeIndex {
    /// Empty.
    pub fn new() -> Self {
        Self { table: vec![(u32::MAX, 0); 2 * MAX_NODES], used: Vec::with_capacity(MAX_NODES) }
    }

    /// Forgets all slots.
    pub fn clear(&mut self) {
        for &at in &self.used {
            self.table[at as usize].0 = u32::MAX;
        }
        self.used.clear();
    }

    /// The number of a slot, which is `fresh` if it had none.
    pub fn find_or_insert(&mut self, slot: u32, fresh: u32) -> u32 {
        let mask = self.table.len() - 1;
        let mut at = slot.wrapping_mul(2_654_435_769) as usize & mask;
        loop {
            let (found, local) = self.table[at];
            if found == slot {
                return local;
            }
            if found == u32::MAX {
                self.table[at] = (slot, fresh);
                self.used.push(at as u32);
                return fresh;
            }
            at = (at + 1) & mask;
        }
    }
}
