//! What the simulation tells the servo of a device about its tool's contact.

use std::time::Instant;

use crate::math::{Pose, Vec3};
use crate::model::material::Material;
use crate::servo::ServoOptions;
use crate::servo::contact_model::{ContactModel, stiffness_along};
use crate::servo::coupling::Coupling;
use crate::servo::device::DeviceDesc;
use crate::servo::impedance::{BlockLimit, clamped, displacement};
use crate::servo::patch::{Patch, Tissue};
use crate::servo::stiffness::StiffnessEstimator;
use crate::solver::tool::{Contact, ToolForce, ToolMotion};

use super::tool_port::Asked;

/// Tissue that resists a change of way by so many times the stiffest spring holds a proxy still: found by the map of stability (`benches/servo`).
const HEAVY: f64 = 3.0;

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
    /// What models may say to a proxy, which balances forces against them. A device that feels the tissue directly goes where it goes, and is told of nothing that
    /// comes and goes with a step.
    stiffest: Option<BlockLimit>,
    /// The stiffest spring that the device renders.
    spring_n_per_m: f64,
}

impl Haptics {
    /// For a tool in a model with cells of this edge, in m.
    pub fn new(device: &DeviceDesc, options: &ServoOptions, cell_m: f64) -> Self {
        let limits = options.coupling.limits(device);
        Self {
            estimator: StiffnessEstimator::new(&limits),
            sequence: 0,
            epoch: 0,
            solved_at: None,
            stamp_s: f64::NAN,
            cell_m,
            last: None,
            stiffest: matches!(options.coupling, Coupling::Virtual(_)).then_some(limits.stiffness),
            spring_n_per_m: device.max_stiffness.linear,
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
        let patch = Patch::of(contacts, tissue, friction, self.cell_m);
        let found = self.estimator.update(patch.as_ref(), &asked.motion, &felt.wrench, duration);
        let since = self.solved_at.replace(now).map(|last| now.duration_since(last).as_secs_f64());
        // On the servo's own clock where it moves on, because the servo fades and ages by that one: a host may let time pass as it likes.
        let stamped = asked.stamp_s - std::mem::replace(&mut self.stamp_s, asked.stamp_s);
        let period_s = if stamped > 0.0 { Some(stamped) } else { since }.unwrap_or(duration);
        self.sequence += 1;
        let last = self.last.replace(asked.motion.pose);
        let model = ContactModel {
            wrench: felt.wrench,
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
        let (Some(patch), Some(last), Some(stiffest)) = (patch, last, &self.stiffest) else { return model };
        let pose = &asked.motion.pose;
        let inertia = patch.inertia(pose, duration);
        // At life's pace the next step is under way before this model is felt: tissue about as heavy as the spring is stiff would be answered a step too late, and
        // shake; what is far heavier holds the proxy still, late or not.
        let heavy = (stiffness_along(&inertia, patch.normal) / (HEAVY * self.spring_n_per_m)).powi(2);
        let slowness = 1.0 - duration / period_s;
        let inertia = inertia * slowness.max(heavy / (1.0 + heavy));
        let model = model.going_on(&displacement(&last, pose), &inertia);
        ContactModel { stiffness: clamped(&model.stiffness, stiffest), ..model }
    }

    /// Nothing is touched any more, or not what was: the servo engages anew.
    pub fn release(&mut self, motion: &ToolMotion) -> ContactModel {
        self.estimator.reset();
        self.last = None;
        self.sequence += 1;
        self.epoch += 1;
        let (sequence, epoch) = (self.sequence, self.epoch);
        ContactModel { motion: *motion, sequence, epoch, ..ContactModel::none() }
    }
}
