//! What steps leave in the system that later ones go on from.

use super::{Octet, Real, Rotation, System};
use crate::cpu::nodes::Bricks;
use crate::model::efg::law::Elasticity;
use crate::model::efg::rows::RowTable;
use crate::model::law::CellLaw;

/// Rows in the order that cuts have given them, by which nodes gather, and how all cells are turned.
#[derive(Debug)]
pub struct SavedSystem<R> {
    rows: RowTable,
    rotations: Vec<Octet<R>>,
    row_rotations: Vec<Rotation<R>>,
}

impl<R: Real> System<R> {
    pub fn save(&self) -> SavedSystem<R> {
        SavedSystem {
            rows: self.rows.clone(),
            rotations: self.rotations.clone(),
            row_rotations: self.turned.rotations.clone(),
        }
    }

    /// The system that goes on from there.
    pub fn restored(
        saved: &SavedSystem<R>,
        bricks: &Bricks,
        elasticity: Elasticity,
        laws: &[CellLaw; 16],
    ) -> Self {
        let mut rows = saved.rows.clone();
        rows.touch_all();
        let mut system = Self::new(bricks, rows, elasticity, laws);
        system.rotations.clone_from(&saved.rotations);
        system.turned.rotations.clone_from(&saved.row_rotations);
        system
    }
}
