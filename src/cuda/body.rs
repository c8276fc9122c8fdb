//! What the host keeps of materials and of what is held: they may differ from the model's.

use crate::model::Model;
use crate::model::law::CellLaw;

/// Laws of cells by material, and flags of nodes by slot.
#[derive(Debug)]
pub struct Body {
    pub laws: [CellLaw; 16],
    pub flags: Vec<u8>,
}

impl Body {
    /// The model's own.
    pub fn of(model: &Model) -> Self {
        Self { laws: *model.laws(), flags: model.lattice().flags().to_vec() }
    }

    /// Whether any material asks for volume terms, and whether any damps its springs.
    pub fn asks_for(&self) -> (bool, bool) {
        (self.laws.iter().any(|law| law.volume_n > 0.0), self.laws.iter().any(|law| law.damping_s > 0.0))
    }
}
