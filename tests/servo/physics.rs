//! Tissue that needs no solver, solved as late as a solver would.

use palpate::math::{Mat6, Vec3};
use palpate::servo::contact_model::ContactModel;
use palpate::servo::impedance::ImpedanceLimits;
use palpate::servo::patch::{self, Patch};
use palpate::servo::stiffness::StiffnessEstimator;
use palpate::solver::tool::{ToolMotion, Wrench};

/// A half-space below z = 0.
#[derive(Clone, Copy, Debug)]
pub enum Tissue {
    /// Force in proportion to depth: a flat punch of this many N/m, with viscosity as a share of it in s.
    Linear { stiffness_n_per_m: f64, relaxation_s: f64 },
    /// Hertz: a ball of this radius in m on a plane strain modulus in Pa.
    Hertz { radius_m: f64, modulus_pa: f64 },
    /// Soft down to a depth in m, hard below.
    Layered { soft_n_per_m: f64, hard_n_per_m: f64, depth_m: f64 },
}

impl Tissue {
    /// The force on a tool, along z.
    pub fn force_n(&self, motion: &ToolMotion) -> f64 {
        let depth = -motion.pose.translation.z;
        if depth <= 0.0 {
            return 0.0;
        }
        match *self {
            Self::Linear { stiffness_n_per_m, relaxation_s } => {
                (stiffness_n_per_m * (depth - motion.linear_m_s.z * relaxation_s)).max(0.0)
            }
            Self::Hertz { radius_m, modulus_pa } => {
                4.0 / 3.0 * modulus_pa * radius_m.sqrt() * depth.powf(1.5)
            }
            Self::Layered { soft_n_per_m, hard_n_per_m, depth_m } => {
                soft_n_per_m * depth.min(depth_m) + hard_n_per_m * (depth - depth_m).max(0.0)
            }
        }
    }

    /// What a simulation knows of the contact, its modulus wrong by `doubt`.
    fn patch(&self, motion: &ToolMotion, doubt: f64) -> Patch {
        let depth = -motion.pose.translation.z;
        // For a punch, a circle and a modulus that give its stiffness.
        let (radius_m, modulus) = match *self {
            Self::Linear { stiffness_n_per_m, .. } => (5e-3, stiffness_n_per_m / 2.0 / 5e-3),
            Self::Hertz { radius_m, modulus_pa } => ((radius_m * depth).sqrt(), modulus_pa),
            Self::Layered { soft_n_per_m, .. } => (5e-3, soft_n_per_m / 2.0 / 5e-3),
        };
        let poisson = 0.45;
        Patch {
            point_m: motion.pose.translation.vector,
            normal: Vec3::z(),
            radius_m,
            tissue: patch::Tissue {
                young_pa: modulus * (1.0 - poisson * poisson) * doubt,
                poisson,
                relaxation_s: if let Self::Linear { relaxation_s, .. } = *self { relaxation_s } else { 0.0 },
                density_kg_m3: 1000.0,
            },
            sticks: true,
            cell_m: 0.0,
            wall_n_per_m: 0.0,
            wall_share: 0.0,
        }
    }
}

/// How a simulation says what tissue does around its tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Says {
    /// The force alone.
    Force,
    /// With the stiffness of a contact whose modulus is wrong by a factor, corrected from what was seen.
    Stiffness { doubt: f64 },
}

/// A simulation that solves every few ticks, and publishes a solve when the next begins.
#[derive(Debug)]
pub struct Physics {
    tissue: Tissue,
    says: Says,
    ticks_per_solve: u32,
    tick_s: f64,
    estimator: StiffnessEstimator,
    tick: u32,
    solved: ContactModel,
    published: ContactModel,
}

impl Physics {
    pub fn new(
        tissue: Tissue,
        says: Says,
        ticks_per_solve: u32,
        limits: &ImpedanceLimits,
        tick_s: f64,
    ) -> Self {
        Self {
            tissue,
            says,
            ticks_per_solve,
            tick_s,
            estimator: StiffnessEstimator::new(limits),
            tick: 0,
            solved: ContactModel::none(),
            published: ContactModel::none(),
        }
    }

    /// The newest model.
    pub fn newest(&self) -> &ContactModel {
        &self.published
    }

    /// One tick, at the end of which the tool is at `tool`, by the servo's time stamp.
    pub fn advance(&mut self, tool: &ToolMotion, stamp_s: f64) {
        if self.tick.is_multiple_of(self.ticks_per_solve) {
            self.published = self.solved;
            self.solved = self.solve(tool, stamp_s);
        }
        self.tick += 1;
    }

    fn solve(&mut self, tool: &ToolMotion, stamp_s: f64) -> ContactModel {
        let force = self.tissue.force_n(tool);
        let wrench = Wrench { force_n: Vec3::z() * force, ..Wrench::default() };
        let period_s = f64::from(self.ticks_per_solve) * self.tick_s;
        let is_touching = force > 0.0;
        let (stiffness, damping) = match self.says {
            Says::Force => (Mat6::zeros(), Mat6::zeros()),
            Says::Stiffness { doubt } => {
                let patch = is_touching.then(|| self.tissue.patch(tool, doubt));
                let found = self.estimator.update(patch.as_ref(), tool, &wrench, period_s);
                (found.stiffness, found.damping)
            }
        };
        ContactModel {
            wrench,
            motion: *tool,
            stiffness,
            damping,
            push: if is_touching { Vec3::z() } else { Vec3::zeros() },
            time_s: f64::from(self.tick) * self.tick_s,
            period_s,
            stamp_s,
            epoch: 0,
            sequence: self.solved.sequence + 1,
        }
    }
}
