//! What the simulation tells the servo of a device about its tool's contact.

use std::time::Instant;

use crate::math::Vec3;
use crate::model::Model;
use crate::model::material::Material;
use crate::servo::ServoOptions;
use crate::servo::contact_model::ContactModel;
use crate::servo::device::DeviceDesc;
use crate::servo::patch::Patch;
use crate::servo::stiffness::StiffnessEstimator;
use crate::solver::tool::{Contact, ToolForce};

use super::tool_port::Asked;

/// A servo that has said nothing for so long is taken for gone, in s: a hundred ticks of a slow one.
const SILENCE_S: f64 = 0.2;

/// Makes the contact models of one tool.
#[derive(Debug)]
pub(super) struct Haptics {
    estimator: StiffnessEstimator,
    /// Counts models over resets: one that begins anew would be taken for an old one.
    sequence: u64,
    epoch: u64,
    solved_at: Option<Instant>,
    /// The servo's time of the motion that the last model was made with; NaN before the first.
    stamp_s: f64,
    heard_at: Option<Instant>,
    is_silent: bool,
    buttons: u32,
}

impl Haptics {
    /// For a tool in a model.
    pub fn new(device: &DeviceDesc, options: &ServoOptions, model: &Model) -> Self {
        let relaxation_s = model.materials().iter().map(|material| material.damping_s).fold(0.0, f64::max);
        Self {
            estimator: StiffnessEstimator::new(&options.coupling.limits(device), relaxation_s),
            sequence: 0,
            epoch: 0,
            solved_at: None,
            stamp_s: f64::NAN,
            heard_at: None,
            is_silent: false,
            buttons: 0,
        }
    }

    /// The model after a step that took `duration` of simulated time and ended `now`. `contacts` are the tool's, world frame.
    pub fn model(
        &mut self,
        asked: &Asked,
        felt: &ToolForce,
        contacts: &[Contact],
        friction: f64,
        duration: f64,
        now: Instant,
        materials: &[Material],
    ) -> ContactModel {
        let elasticity = |material: u8| {
            let found = usize::from(material).checked_sub(1).and_then(|index| materials.get(index));
            found.map_or((0.0, 0.25), |material| (material.young_pa, material.poisson))
        };
        let patch = Patch::of(contacts, elasticity, friction);
        let found = self.estimator.update(patch.as_ref(), &asked.motion, &felt.wrench, duration);
        let since = self.solved_at.replace(now).map(|last| now.duration_since(last).as_secs_f64());
        // On the servo's own clock where it moves on, because the servo fades and ages by that one: a host may let time pass as it likes.
        let stamped = asked.stamp_s - std::mem::replace(&mut self.stamp_s, asked.stamp_s);
        let since = if stamped > 0.0 { Some(stamped) } else { since };
        self.sequence += 1;
        ContactModel {
            wrench: felt.wrench,
            motion: asked.motion,
            stiffness: found.stiffness,
            damping: found.damping,
            push: patch.map_or(Vec3::zeros(), |patch| patch.normal),
            time_s: felt.time_s,
            period_s: since.unwrap_or(duration),
            stamp_s: asked.stamp_s,
            sequence: self.sequence,
            epoch: self.epoch,
        }
    }

    /// Nothing is touched any more, or not what was: the servo engages anew.
    pub fn release(&mut self, motion: &crate::solver::tool::ToolMotion) -> ContactModel {
        self.estimator.reset();
        self.sequence += 1;
        self.epoch += 1;
        let (sequence, epoch) = (self.sequence, self.epoch);
        ContactModel { motion: *motion, sequence, epoch, ..ContactModel::none() }
    }

    /// Listens to the servo at a step: whether it has just fallen silent, and buttons that have changed.
    pub fn listen(&mut self, is_news: bool, buttons: u32, now: Instant) -> (bool, Option<u32>) {
        if is_news || self.heard_at.is_none() {
            self.heard_at = Some(now);
        }
        let silence = self.heard_at.map_or(0.0, |heard| now.duration_since(heard).as_secs_f64());
        let fell_silent = silence > SILENCE_S && !self.is_silent;
        self.is_silent = silence > SILENCE_S;
        let changed = buttons != std::mem::replace(&mut self.buttons, buttons);
        (fell_silent, changed.then_some(buttons))
    }
}
