//! What the simulation tells the servo of a device about its tool's contact.

use std::time::Instant;

use crate::math::{Pose, Vec3, Vec6};
use crate::model::material::Material;
use crate::servo::ServoOptions;
use crate::servo::contact_model::ContactModel;
use crate::servo::coupling::Coupling;
use crate::servo::device::DeviceDesc;
use crate::servo::impedance::{displacement, linear, stacked, wrench};
use crate::servo::lead::Lead;
use crate::servo::patch::{Patch, Tissue};
use crate::servo::stiffness::StiffnessEstimator;
use crate::solver::tool::{Contact, ToolForce, ToolMotion, Wrench};

use super::tool_port::Asked;

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
    cell_m: f64,
    /// Where the tool was at the end of the last step.
    last: Option<Pose>,
    /// Of a tool on a spring. A device that feels the tissue directly goes where it goes, and is told of nothing that comes and goes with a step.
    lead: Option<Lead>,
}

impl Haptics {
    /// For a tool in a model with cells of this edge, in m.
    pub fn new(device: &DeviceDesc, options: &ServoOptions, cell_m: f64) -> Self {
        let lead = match &options.coupling {
            Coupling::Direct => None,
            Coupling::Virtual(coupling) => Some(Lead::new(coupling)),
        };
        Self {
            estimator: StiffnessEstimator::new(&options.coupling.limits(device)),
            sequence: 0,
            epoch: 0,
            solved_at: None,
            stamp_s: f64::NAN,
            cell_m,
            last: None,
            lead,
        }
    }

    /// The model after a step that took `duration` of simulated time and ended `now`. `contacts` are the tool's, world frame; those
    /// that `is_held` says are on what cannot move, and the others move `mass_kg` at once.
    pub fn model(
        &mut self,
        asked: &Asked,
        felt: &ToolForce,
        contacts: &[Contact],
        friction: f64,
        duration: f64,
        now: Instant,
        materials: &[Material],
        is_held: impl Fn(&Contact) -> bool,
        mass_kg: impl FnOnce() -> f64,
    ) -> ContactModel {
        let tissue = |material: u8| {
            let found = usize::from(material).checked_sub(1).and_then(|index| materials.get(index));
            let none = Tissue { young_pa: 0.0, poisson: 0.25, relaxation_s: 0.0, density_kg_m3: 1000.0 };
            found.map_or(none, |material| Tissue {
                young_pa: material.young_pa,
                poisson: material.poisson,
                relaxation_s: material.damping_s,
                density_kg_m3: material.density_kg_m3,
            })
        };
        let patch = Patch::of(contacts, tissue, is_held, friction, self.cell_m);
        let last = self.last.replace(asked.motion.pose);
        let way = last.map(|last| displacement(&last, &asked.motion.pose));
        let pose = &asked.motion.pose;
        let wrench = match (&mut self.lead, &patch, &way) {
            (Some(lead), Some(patch), Some(way)) => {
                let felt = if patch.is_wall() { pressed(contacts, pose) } else { felt.wrench };
                let inertia = patch.inertia(pose, duration, mass_kg());
                lasting(&felt, &lead.touch(&inertia, way), &patch.normal)
            }
            (Some(lead), ..) => {
                lead.let_go();
                felt.wrench
            }
            (None, ..) => felt.wrench,
        };
        let found = self.estimator.update(patch.as_ref(), &asked.motion, &wrench, duration);
        let since = self.solved_at.replace(now).map(|last| now.duration_since(last).as_secs_f64());
        // On the servo's own clock where it moves on, because the servo fades and ages by that one: a host may let time pass as it likes.
        let stamped = asked.stamp_s - std::mem::replace(&mut self.stamp_s, asked.stamp_s);
        let period_s = if stamped > 0.0 { Some(stamped) } else { since }.unwrap_or(duration);
        self.sequence += 1;
        let model = ContactModel {
            wrench,
            motion: asked.motion,
            stiffness: found.stiffness,
            damping: found.damping,
            push: patch.as_ref().map_or(Vec3::zeros(), |patch| patch.normal),
            time_s: felt.time_s,
            period_s,
            stamp_s: asked.stamp_s,
            sequence: self.sequence,
            epoch: self.epoch,
        };
        match self.lead.as_ref().and_then(Lead::resistance) {
            Some((way, stopping, resistance)) => model.going_on(&way, &stopping, &resistance),
            None => model,
        }
    }

    /// Where the tool ends a step of `step_s` seconds that begins at `from`.
    pub fn led(&self, from: &Pose, asked: &ToolMotion, step_s: f64) -> ToolMotion {
        self.lead.as_ref().map_or(*asked, |lead| lead.end(from, &asked.pose, step_s))
    }

    /// Nothing is touched any more, or not what was: the servo engages anew.
    pub fn release(&mut self, motion: &ToolMotion) -> ContactModel {
        self.estimator.reset();
        self.last = None;
        if let Some(lead) = &mut self.lead {
            lead.let_go();
        }
        self.sequence += 1;
        self.epoch += 1;
        let (sequence, epoch) = (self.sequence, self.epoch);
        ContactModel { motion: *motion, sequence, epoch, ..ContactModel::none() }
    }
}

/// What is left of a wrench once the tissue under the tool goes as the tool does: never a pull.
fn lasting(felt: &Wrench, blow: &Vec6, push: &Vec3) -> Wrench {
    let felt = stacked(felt);
    let (pushed, struck) = (linear(&felt).dot(push), -linear(blow).dot(push));
    let share = if struck > pushed { (pushed / struck).max(0.0) } else { 1.0 };
    wrench(&(felt + blow * share))
}

/// The wrench at the step's end, on a tool at a pose, of what answers to where the tool is and to nothing else: a step's mean is late by half the tool's way.
fn pressed(contacts: &[Contact], pose: &Pose) -> Wrench {
    contacts.iter().fold(Wrench::default(), |sum, contact| Wrench {
        force_n: sum.force_n - contact.force_n,
        torque_n_m: sum.torque_n_m - (contact.point_m - pose.translation.vector).cross(&contact.force_n),
    })
}
