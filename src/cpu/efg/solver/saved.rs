//! The meshless model's state as a snapshot has it.

use super::super::cell_rows::CellRows;
use super::super::system::System;
use super::super::system::saved::SavedSystem;
use super::{EfgReal, EfgSolver, Field, Looked};

/// What steps read that steps have written. Lists of triangles near tools are made anew: what tools meet does not depend on them.
#[derive(Debug)]
pub struct SavedEfg<R> {
    flags: Vec<u8>,
    u: Field<R>,
    v: Field<R>,
    system: SavedSystem<R>,
    cell_rows: CellRows,
    fastest: f64,
    looked: Looked<R>,
}

impl<R: EfgReal> EfgSolver<R> {
    pub(super) fn state(&self) -> SavedEfg<R> {
        SavedEfg {
            flags: self.flags.clone(),
            u: self.u.clone(),
            v: self.v.clone(),
            system: self.system.save(),
            cell_rows: self.cell_rows.clone(),
            fastest: self.fastest,
            looked: self.looked.clone(),
        }
    }

    pub(super) fn set_state(&mut self, saved: &SavedEfg<R>) {
        self.flags.clone_from(&saved.flags);
        (self.u, self.v) = (saved.u.clone(), saved.v.clone());
        self.system = System::restored(&saved.system, &self.bricks, self.desc.elasticity, &self.laws);
        self.uploaded += self.system.upload(&self.bricks);
        self.cell_rows.clone_from(&saved.cell_rows);
        self.fastest = saved.fastest;
        self.looked.clone_from(&saved.looked);
        // Stiffness in steps of a length is not saved.
        self.is_stale = true;
        self.contact.clear();
        self.contact.lose_track();
    }
}
