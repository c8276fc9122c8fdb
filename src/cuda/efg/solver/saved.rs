//! The meshless model's state as a snapshot has it.

use super::{CudaEfgSolver, Look, Number};
use crate::cuda::efg::state::SavedState;
use crate::error::Result;

/// What steps read that steps have written. Sites near tools are listed anew.
#[derive(Debug)]
pub struct SavedEfg<R> {
    flags: Vec<u8>,
    state: SavedState<R>,
    speed: f64,
    looked: Vec<R>,
    last_dt: f64,
}

impl<R: Number> CudaEfgSolver<R> {
    pub(super) fn state(&mut self) -> Result<SavedEfg<R>> {
        // The next step lists sites as one does that follows a restore: it may add up in the order of the list.
        self.contact.lose_track();
        Ok(SavedEfg {
            flags: self.body.flags.clone(),
            state: self.state.save()?,
            speed: self.speed,
            looked: self.look.as_ref().map_or(Ok(Vec::new()), Look::save)?,
            last_dt: self.last_dt,
        })
    }

    pub(super) fn set_state(&mut self, saved: &SavedEfg<R>) -> Result<()> {
        self.body.flags.clone_from(&saved.flags);
        self.state.set_flags(&saved.flags)?;
        self.state.restore(&saved.state, &self.body)?;
        self.look.as_mut().map_or(Ok(()), |look| look.restore(&saved.looked))?;
        self.contact.clear()?;
        self.near.clear()?;
        self.outside.forget_masses();
        self.dropped_before = self.dropped;
        (self.speed, self.last_dt) = (saved.speed, saved.last_dt);
        self.forget_nodes();
        self.stream.wait()
    }
}
