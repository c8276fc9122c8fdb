//! A tool, from both sides: the servo thread's port and the simulation's end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::ToolId;
use crate::channel::latest::{Reader, Writer, latest};
use crate::error::Result;
use crate::math::Pose;
use crate::solver::tool::{ToolDesc, ToolForce, ToolMotion, Wrench};

/// One tool of a simulation, held by its servo thread.
#[derive(Debug)]
pub struct ToolPort {
    id: ToolId,
    motion: Writer<Option<ToolMotion>>,
    force: Reader<ToolForce>,
    is_running: Arc<AtomicBool>,
    has_failed: Arc<AtomicBool>,
}

/// The simulation's end of a tool.
#[derive(Debug)]
pub(super) struct ToolEnd {
    pub id: ToolId,
    pub desc: Arc<ToolDesc>,
    pub motion: Reader<Option<ToolMotion>>,
    pub force: Writer<ToolForce>,
    /// Where the tool stands, world frame; `None` before its first motion.
    pub stands: Option<ToolMotion>,
    is_running: Arc<AtomicBool>,
    has_failed: Arc<AtomicBool>,
}

/// Both ends of a new tool.
pub(super) fn open(id: ToolId, desc: &ToolDesc) -> (ToolPort, ToolEnd) {
    let (motion_writer, motion) = latest(None);
    let (force, force_reader) = latest(ToolForce {
        wrench: Wrench::default(),
        motion: ToolMotion::at(Pose::identity()),
        time_s: 0.0,
        sequence: 0,
    });
    let is_running = Arc::new(AtomicBool::new(true));
    let has_failed = Arc::new(AtomicBool::new(false));
    let end = ToolEnd {
        id,
        desc: Arc::new(desc.clone()),
        motion,
        force,
        stands: None,
        is_running: is_running.clone(),
        has_failed: has_failed.clone(),
    };
    (ToolPort { id, motion: motion_writer, force: force_reader, is_running, has_failed }, end)
}

impl ToolPort {
    /// Names the tool to its simulation's owner, who must not touch a port that a servo thread is using.
    pub fn id(&self) -> ToolId {
        self.id
    }

    /// Says where the tool is. The simulation moves it there over its next step. Wait-free: no lock, allocation or system call, unless
    /// the motion is refused.
    pub fn set_motion(&mut self, motion: &ToolMotion) -> Result<()> {
        motion.check()?;
        self.motion.publish(Some(*motion));
        Ok(())
    }

    /// The newest force, or none at all once the simulation or its tool is gone. Wait-free.
    pub fn force(&mut self) -> ToolForce {
        let newest = *self.force.read().0;
        if self.is_running() { newest } else { ToolForce { wrench: Wrench::default(), ..newest } }
    }

    /// Whether the simulation still exists and still has this tool. Wait-free.
    pub fn is_running(&self) -> bool {
        // Relaxed: nothing else is read on the strength of this.
        self.is_running.load(Ordering::Relaxed)
    }
}

impl ToolPort {
    /// Whether the newest force means something: the simulation runs and has not diverged since its last reset. Wait-free.
    pub fn is_live(&self) -> bool {
        // Relaxed: as above.
        self.is_running() && !self.has_failed.load(Ordering::Relaxed)
    }
}

impl ToolEnd {
    /// Lets go: publishes no force, and says whether that is because the simulation failed.
    pub(super) fn release(&mut self, time_s: f64, sequence: u64, has_failed: bool) {
        let motion = self.stands.unwrap_or(ToolMotion::at(Pose::identity()));
        self.force.publish(ToolForce { wrench: Wrench::default(), motion, time_s, sequence });
        self.has_failed.store(has_failed, Ordering::Relaxed);
    }
}

impl Drop for ToolEnd {
    fn drop(&mut self) {
        self.is_running.store(false, Ordering::Relaxed);
    }
}
