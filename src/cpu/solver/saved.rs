//! The lattice's state as a snapshot has it.

use super::{Core, CpuReal, Looked, Mark, Nodes};
use crate::cpu::sleep::Sleepers;

/// What substeps read that substeps have written. Lists of triangles near tools are made anew: what tools meet does not depend on them.
#[derive(Debug)]
pub struct SavedLattice<R> {
    flags: Vec<u8>,
    nodes: Nodes<R>,
    looked: Looked<R>,
    marks: Vec<Mark>,
    sleepers: Sleepers,
    stable_dt: f64,
    vis_viva: f64,
    is_cleared: bool,
}

impl<R: CpuReal> Core<R> {
    pub(super) fn save(&self) -> SavedLattice<R> {
        SavedLattice {
            flags: self.flags.clone(),
            nodes: self.nodes.clone(),
            looked: self.looked.clone(),
            marks: self.marks.clone(),
            sleepers: self.sleep.sleepers(),
            stable_dt: self.stable_dt,
            vis_viva: self.vis_viva,
            is_cleared: self.is_cleared,
        }
    }

    pub(super) fn restore(&mut self, saved: &SavedLattice<R>) {
        self.flags.clone_from(&saved.flags);
        self.nodes = saved.nodes.clone();
        self.looked.clone_from(&saved.looked);
        self.marks.clone_from(&saved.marks);
        self.sleep.set_sleepers(&self.bricks, &saved.sleepers);
        self.stable_dt = saved.stable_dt;
        (self.vis_viva, self.is_cleared) = (saved.vis_viva, saved.is_cleared);
        self.contact.clear();
        self.contact.lose_track();
    }
}
