//! The lattice's state as a snapshot has it.

use super::{CudaSolver, Look, SOUND};
use crate::cuda::sleep::Sleepers;
use crate::error::Result;

/// What steps read that steps have written. Sites near tools are listed anew.
#[derive(Debug)]
pub struct SavedLattice {
    flags: Vec<u8>,
    u: Vec<[f32; 4]>,
    v: Vec<f32>,
    marks: Vec<u8>,
    sleepers: Sleepers,
    speed: f64,
    looked: Vec<f32>,
    vis_viva: f32,
    stable_dt: f64,
}

impl CudaSolver {
    pub(super) fn state(&mut self) -> Result<SavedLattice> {
        // The next step lists sites as one does that follows a restore: it may add up in the order of the list.
        self.contact.lose_track();
        Ok(SavedLattice {
            flags: self.body.flags.clone(),
            u: self.state.u[self.state.current].all()?,
            v: self.state.velocities().all()?,
            marks: self.state.marks.all()?,
            sleepers: self.sleep.sleepers()?,
            speed: self.speed,
            looked: self.look.as_ref().map_or(Ok(Vec::new()), Look::save)?,
            vis_viva: self.vis_viva,
            stable_dt: self.stable_dt,
        })
    }

    pub(super) fn set_state(&mut self, saved: &SavedLattice) -> Result<()> {
        self.body.flags.clone_from(&saved.flags);
        self.state.flags.set(saved.flags.clone())?;
        // Held nodes, and those that sleep, are the same in both copies.
        self.state.u.iter().try_for_each(|copy| copy.write(0, &saved.u))?;
        self.state.v.iter().try_for_each(|copy| copy.write(0, &saved.v))?;
        self.state.marks.write(0, &saved.marks)?;
        self.state.diverged_at.fill(SOUND)?;
        self.sleep.set_sleepers(&saved.sleepers)?;
        self.look.as_mut().map_or(Ok(()), |look| look.restore(&saved.looked))?;
        self.contact.clear()?;
        self.near.clear()?;
        self.outside.forget_masses();
        self.dropped_before = self.dropped;
        (self.speed, self.vis_viva, self.stable_dt) = (saved.speed, saved.vis_viva, saved.stable_dt);
        self.forget_nodes();
        self.stream.wait()
    }
}
