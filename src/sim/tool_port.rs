//! A tool, from both sides: the servo thread's port and the simulation's end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::ToolId;
use super::haptics::Haptics;
use super::hearing::{self, Buttons, Hearing};
use crate::channel::latest::{Reader, Writer, latest};
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};
use crate::servo::contact_model::ContactModel;
use crate::servo::{DeviceState, Output, Servo, ServoStatistics};
use crate::solver::tool::{ToolDesc, ToolForce, ToolMotion, Wrench};

/// One tool of a simulation, held by its servo thread.
#[derive(Debug)]
pub struct ToolPort {
    id: ToolId,
    asked: Writer<Option<Asked>>,
    felt: Reader<Felt>,
    /// The loop of its device; `None` where there is none.
    device: Option<(Servo, Buttons)>,
    is_running: Arc<AtomicBool>,
    has_failed: Arc<AtomicBool>,
    has_left: Arc<AtomicBool>,
}

/// What the servo thread asks of the simulation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Asked {
    pub motion: ToolMotion,
    /// When the device was there, on the host's clock; NaN where nobody said.
    pub stamp_s: f64,
}

/// What the simulation answers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Felt {
    pub force: ToolForce,
    pub model: ContactModel,
}

/// The simulation's end of a tool.
#[derive(Debug)]
pub(super) struct ToolEnd {
    pub id: ToolId,
    pub desc: Arc<ToolDesc>,
    pub asked: Reader<Option<Asked>>,
    pub felt: Writer<Felt>,
    /// Where the tool is after the last step, or the one in progress, with the rest of what was asked; world frame; `None` before its first motion.
    pub stands: Option<Asked>,
    /// The same where a tool with a device first was, and where it last touched nothing.
    pub began: Option<Asked>,
    pub entered: Option<Asked>,
    /// Nodes that it holds: slots, and where they are in its frame, in m.
    pub grasped: Arc<[(u32, Vec3)]>,
    /// The model that goes with forces that no device shall feel.
    idle: ContactModel,
    /// What a device's servo needs to know, and what it says; `None` where there is no device.
    pub device: Option<(Haptics, Hearing)>,
    is_running: Arc<AtomicBool>,
    has_failed: Arc<AtomicBool>,
    has_left: Arc<AtomicBool>,
}

/// Both ends of a new tool.
pub(super) fn open(id: ToolId, desc: &ToolDesc, device: Option<(Servo, Haptics)>) -> (ToolPort, ToolEnd) {
    let (asked_writer, asked) = latest(None);
    let (felt, felt_reader) = latest(Felt {
        force: ToolForce {
            wrench: Wrench::default(),
            motion: ToolMotion::at(Pose::identity()),
            time_s: 0.0,
            sequence: 0,
        },
        model: ContactModel::none(),
    });
    let (servo, haptics) = device
        .map(|(servo, haptics)| {
            let (buttons, hearing) = hearing::open();
            ((servo, buttons), (haptics, hearing))
        })
        .unzip();
    let is_running = Arc::new(AtomicBool::new(true));
    let [has_failed, has_left] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
    let end = ToolEnd {
        id,
        desc: Arc::new(desc.clone()),
        asked,
        felt,
        stands: None,
        began: None,
        entered: None,
        grasped: Arc::new([]),
        idle: ContactModel::none(),
        device: haptics,
        is_running: is_running.clone(),
        has_failed: has_failed.clone(),
        has_left: has_left.clone(),
    };
    let port = ToolPort {
        id,
        asked: asked_writer,
        felt: felt_reader,
        device: servo,
        is_running,
        has_failed,
        has_left,
    };
    (port, end)
}

impl ToolPort {
    /// Names the tool to its simulation's owner, who must not touch a port that a servo thread is using.
    pub fn id(&self) -> ToolId {
        self.id
    }

    /// Takes the tool out of its simulation, from its next step on.
    pub fn leave(self) {
        // Relaxed: nothing else is read on the strength of this.
        self.has_left.store(true, Ordering::Relaxed);
    }

    /// Says where the tool is. The simulation moves it there over its next step; that of a device no faster than a metre in a second of the tissue's time,
    /// so that it may take several. Wait-free: no lock, allocation or system call, unless the motion is refused.
    pub fn set_motion(&mut self, motion: &ToolMotion) -> Result<()> {
        self.set_motion_at(motion, f64::NAN)
    }

    /// The same for a servo loop of the host's own, which follows [`Self::contact_model`]: with when its device was there, in seconds on the host's clock, from any
    /// start. Contact models then tell the time between solves by that clock, and which motion they go with; by the wall clock where the stamp is NaN, or no later
    /// than that of the last solve.
    pub fn set_motion_at(&mut self, motion: &ToolMotion, stamp_s: f64) -> Result<()> {
        motion.check()?;
        if stamp_s.is_infinite() {
            return Err(Error::argument("a stamp is a time in s, or NaN"));
        }
        self.asked.publish(Some(Asked { motion: *motion, stamp_s }));
        Ok(())
    }

    /// The newest force, or none at all once the simulation or its tool is gone. Wait-free.
    pub fn force(&mut self) -> ToolForce {
        let newest = self.felt.read().0.force;
        if self.is_running() { newest } else { ToolForce { wrench: Wrench::default(), ..newest } }
    }

    /// One tick of a device's servo loop: where the device is goes in, what its motors shall do comes out, and the simulation is told where the
    /// tool is. Every change of `buttons`, a bit each, becomes an event. `None` for a tool without a device. `is_sound` is whether the host, too, believes in the simulation. Wait-free.
    #[inline]
    pub fn exchange(&mut self, device: &DeviceState, buttons: u32, is_sound: bool) -> Option<Exchange> {
        let is_live = self.is_live() && is_sound;
        let (servo, told) = self.device.as_mut()?;
        told.tell(buttons);
        let Felt { force, model } = self.felt.read().0;
        let output = servo.tick(device, model, is_live);
        let exchange = Exchange { output, time_s: force.time_s, sequence: force.sequence, is_live };
        if output.is_placed && output.tool.is_valid() {
            let motion = output.tool;
            self.asked.publish(Some(Asked { motion, stamp_s: device.stamp_s }));
        }
        Some(exchange)
    }

    /// The newest contact model, as a servo loop of the host's own would follow it; `None` for a tool without a device. Wait-free.
    pub fn contact_model(&mut self) -> Option<&ContactModel> {
        let model = &self.felt.read().0.model;
        self.device.is_some().then_some(model)
    }

    /// How the servo loop is doing; `None` for a tool without a device.
    #[inline]
    pub fn servo_statistics(&self) -> Option<ServoStatistics> {
        self.device.as_ref().map(|(servo, _)| servo.statistics())
    }

    /// Whether the simulation still exists and still has this tool. Wait-free.
    pub fn is_running(&self) -> bool {
        // Relaxed: nothing else is read on the strength of this.
        self.is_running.load(Ordering::Relaxed)
    }

    /// Whether the newest force means something: the simulation runs and has not diverged since its last reset. Wait-free.
    pub fn is_live(&self) -> bool {
        // Relaxed: as above.
        self.is_running() && !self.has_failed.load(Ordering::Relaxed)
    }
}

/// What comes of a tick of a servo loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exchange {
    /// Force and torque for the motors, where the tool is, and what happened to the force.
    pub output: Output,
    /// Simulated time of the newest force, in seconds.
    pub time_s: f64,
    /// Counts steps, as [`ToolForce::sequence`].
    pub sequence: u64,
    /// Whether the simulation runs and has not failed.
    pub is_live: bool,
}

impl ToolEnd {
    /// Whether its port has left.
    pub(super) fn has_left(&self) -> bool {
        // Relaxed: as above.
        self.has_left.load(Ordering::Relaxed)
    }

    /// Publishes a force without a contact model: for a tool without a device, or one whose device shall not feel it.
    pub(super) fn publish_force(&mut self, force: ToolForce) {
        self.felt.publish(Felt { force, model: self.idle });
    }

    /// Has a device feel nothing until it engages anew.
    pub(super) fn disengage(&mut self, time_s: f64, sequence: u64) {
        if self.device.is_some() {
            self.release(time_s, sequence, self.has_failed.load(Ordering::Relaxed));
        }
    }

    /// Lets go: publishes no force, and says whether that is because the simulation failed.
    pub(super) fn release(&mut self, time_s: f64, sequence: u64, has_failed: bool) {
        let motion = self.stands.map_or(ToolMotion::at(Pose::identity()), |asked| asked.motion);
        let model =
            self.device.as_mut().map_or(ContactModel::none(), |(haptics, _)| haptics.release(&motion));
        self.idle = model;
        let force = ToolForce { wrench: Wrench::default(), motion, time_s, sequence };
        self.felt.publish(Felt { force, model });
        self.has_failed.store(has_failed, Ordering::Relaxed);
    }
}

impl Drop for ToolEnd {
    fn drop(&mut self) {
        self.is_running.store(false, Ordering::Relaxed);
    }
}
