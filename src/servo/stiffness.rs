//! How stiff the tissue under a tool is, from what is known of the contact and from how the force has changed.
//!
//! The start is the stiffness of a [`Patch`] on a half-space. Real tissue is layered, thin and bounded: what the force does from solve to
//! solve corrects it, by the symmetric rank-one-in-each-direction update of Powell (1970), which changes the matrix least among those that
//! explain the last step.
//!
//! One per tool, beside its solver; one update per solve, which allocates nothing.

use super::impedance::{ImpedanceLimits, clamped, displacement, stacked, velocity};
use super::patch::Patch;
use crate::math::{Mat6, Vec6};
use crate::solver::tool::{ToolMotion, Wrench};

/// A radian is compared with this way, in m: what it moves at the end of a finger's breadth.
const LEVER_M: f64 = 0.01;
/// Shortest way that tells a stiffness, in m: over less, the noise of contact points that come and go is all there is to see.
const STRIDE_M: f64 = 5e-5;
/// Longest time that one way may take, in s; tissue that relaxed meanwhile would be taken for soft.
const STRIDE_S: f64 = 0.1;
/// Time constant with which what was learned is forgotten, in s.
const MEMORY_S: f64 = 1.0;

/// Follows the stiffness and damping of one tool's contact.
#[derive(Clone, Debug)]
pub struct StiffnessEstimator {
    limits: ImpedanceLimits,
    /// What was learned beyond the patch's stiffness, lengths and radians made alike.
    learned: Mat6,
    /// Where the present way began.
    start: Option<Start>,
}

#[derive(Clone, Copy, Debug)]
struct Start {
    motion: ToolMotion,
    wrench: Wrench,
    ago_s: f64,
}

/// What an estimator says: both matrices symmetric, positive semidefinite and within the limits, as a
/// [`ContactModel`](super::contact_model::ContactModel) takes them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// K.
    pub stiffness: Mat6,
    /// B.
    pub damping: Mat6,
}

impl StiffnessEstimator {
    /// For matrices within these limits: those of [`Coupling::limits`](super::coupling::Coupling::limits).
    pub fn new(limits: &ImpedanceLimits) -> Self {
        Self { limits: *limits, learned: Mat6::zeros(), start: None }
    }

    /// Forgets what was learned.
    pub fn reset(&mut self) {
        self.learned = Mat6::zeros();
        self.start = None;
    }

    /// Takes in a solve: the wrench on the tool at a motion, `dt` seconds after the last one, and what is known of the contact: `None`
    /// where nothing is touched, which forgets the rest.
    pub fn update(
        &mut self,
        patch: Option<&Patch>,
        motion: &ToolMotion,
        wrench: &Wrench,
        dt: f64,
    ) -> Estimate {
        let Some(patch) = patch else {
            self.reset();
            return Estimate { stiffness: Mat6::zeros(), damping: Mat6::zeros() };
        };
        self.learned *= (-dt / MEMORY_S).exp();
        let known = alike(&patch.stiffness(&motion.pose));
        self.learn(&known, patch.tissue.relaxation_s, motion, wrench, dt);
        let all = known + self.learned;
        if !all.iter().all(|x| x.is_finite()) {
            self.reset();
        }
        let all = unlike(&all);
        Estimate {
            stiffness: clamped(&all, &self.limits.stiffness),
            damping: clamped(&(all * patch.tissue.relaxation_s), &self.limits.damping),
        }
    }

    /// Explains the change of the wrench since the way began, once the way is long enough.
    fn learn(&mut self, known: &Mat6, relaxation_s: f64, motion: &ToolMotion, wrench: &Wrench, dt: f64) {
        let here = Start { motion: *motion, wrench: *wrench, ago_s: 0.0 };
        let Some(start) = self.start.as_mut() else {
            self.start = Some(here);
            return;
        };
        start.ago_s += dt;
        // Viscosity that goes with stiffness makes a faster tool feel like a deeper one.
        let faster = velocity(motion) - velocity(&start.motion);
        let way = lengths(&(displacement(&start.motion.pose, &motion.pose) + faster * relaxation_s));
        let square = way.norm_squared();
        if square < STRIDE_M * STRIDE_M {
            if start.ago_s > STRIDE_S {
                self.start = Some(here);
            }
            return;
        }
        let change = forces(&(stacked(wrench) - stacked(&start.wrench)));
        let missed = -change - (known + self.learned) * way;
        let across = missed * way.transpose();
        let twice = way * (way.transpose() * (missed.dot(&way) / square));
        self.learned += (across + across.transpose() - twice) / square;
        self.start = Some(here);
    }
}

/// Radians as ways, so that translation and rotation can be compared.
fn lengths(motion: &Vec6) -> Vec6 {
    motion.component_mul(&levers())
}

/// Torques as forces.
fn forces(wrench: &Vec6) -> Vec6 {
    wrench.component_div(&levers())
}

/// A stiffness between such ways and forces.
fn alike(stiffness: &Mat6) -> Mat6 {
    stiffness.component_div(&(levers() * levers().transpose()))
}

/// Back to radians and torques.
fn unlike(stiffness: &Mat6) -> Mat6 {
    stiffness.component_mul(&(levers() * levers().transpose()))
}

fn levers() -> Vec6 {
    Vec6::new(1.0, 1.0, 1.0, LEVER_M, LEVER_M, LEVER_M)
}

#[cfg(test)]
mod tests {
    use super::super::contact_model::stiffness_along;
    use super::super::coupling::Coupling;
    use super::super::device::DeviceDesc;
    use super::super::impedance::isotropic;
    use super::super::patch::Tissue;
    use super::*;
    use crate::math::{Pose, Quat, Vec3};

    const DT: f64 = 1e-3;

    fn patch() -> Patch {
        Patch {
            point_m: Vec3::zeros(),
            normal: Vec3::z(),
            radius_m: 5e-3,
            tissue: Tissue {
                young_pa: 12.5e3 * 0.75,
                poisson: 0.5,
                relaxation_s: 0.0,
                density_kg_m3: 1000.0,
            },
            sticks: true,
            cell_m: 0.0,
            wall_n_per_m: 0.0,
            wall_share: 0.0,
        }
    }

    fn estimator() -> StiffnessEstimator {
        StiffnessEstimator::new(&Coupling::Direct.limits(&DeviceDesc::touch()))
    }

    /// Moves along a line through springs, and gives the last estimate.
    fn moved(estimator: &mut StiffnessEstimator, springs: &Mat6, way: Vec6, ticks: u32) -> Estimate {
        let mut last = Estimate { stiffness: Mat6::zeros(), damping: Mat6::zeros() };
        for tick in 0..=ticks {
            let at = way * (f64::from(tick) / f64::from(ticks));
            let pose = Pose::new(Vec3::new(at.x, at.y, at.z), Vec3::new(at.w, at.a, at.b));
            let felt = super::super::impedance::wrench(&(-springs * at));
            last = estimator.update(Some(&patch()), &ToolMotion::at(pose), &felt, DT);
        }
        last
    }

    #[test]
    fn a_press_teaches_the_stiffness_along_it_and_leaves_the_rest() {
        let springs = isotropic(400.0, 0.0);
        let found = moved(&mut estimator(), &springs, Vec6::z() * 0.005, 50).stiffness;
        assert!((stiffness_along(&found, Vec3::z()) - 400.0).abs() < 1.0, "{found}");
        let tangential = stiffness_along(&patch().stiffness(&Pose::identity()), Vec3::x());
        assert!((stiffness_along(&found, Vec3::x()) - tangential).abs() < 1.0, "{found}");
    }

    #[test]
    fn springs_that_pull_askew_are_learned_with_their_coupling() {
        // Stiff along one slanted direction, moved along others.
        let slant = Vec3::new(1.0, 0.0, 1.0).normalize();
        let mut springs = isotropic(50.0, 0.0);
        let block = springs.fixed_view::<3, 3>(0, 0) + slant * slant.transpose() * 300.0;
        springs.fixed_view_mut::<3, 3>(0, 0).copy_from(&block);
        let mut estimator = estimator();
        let mut found = Mat6::zeros();
        for tick in 0..2000 {
            let phase = f64::from(tick) * 0.02;
            let at = Vec3::new(phase.sin(), (1.7 * phase).cos(), (2.3 * phase).sin()) * 3e-3;
            let felt = Wrench { force_n: -springs.fixed_view::<3, 3>(0, 0) * at, ..Wrench::default() };
            let motion = ToolMotion::at(Pose::from_parts(at.into(), Quat::identity()));
            found = estimator.update(Some(&patch()), &motion, &felt, DT).stiffness;
        }
        let missed = (found - springs).fixed_view::<3, 3>(0, 0).norm();
        assert!(missed < 0.1 * springs.norm(), "{missed} N/m of {}", springs.norm());
    }

    #[test]
    fn what_is_learned_fades_at_rest_and_goes_with_the_contact() {
        let mut estimator = estimator();
        moved(&mut estimator, &isotropic(400.0, 0.0), Vec6::z() * 0.005, 50);
        let still = ToolMotion::at(Pose::translation(0.0, 0.0, 0.005));
        let mut found = Mat6::zeros();
        for _ in 0..1000 {
            found = estimator.update(Some(&patch()), &still, &Wrench::default(), DT).stiffness;
        }
        // A second later, a share of exp(−1 s ÷ 1 s) of 275 N/m is left.
        assert!((stiffness_along(&found, Vec3::z()) - 125.0 - 275.0 * (-1.0 / MEMORY_S).exp()).abs() < 2.0);
        let away = estimator.update(None, &still, &Wrench::default(), DT);
        assert_eq!((away.stiffness, away.damping), (Mat6::zeros(), Mat6::zeros()));
        let back = estimator.update(Some(&patch()), &still, &Wrench::default(), DT).stiffness;
        assert!((stiffness_along(&back, Vec3::z()) - 125.0).abs() < 1e-9);
    }

    #[test]
    fn noise_at_rest_and_wild_forces_keep_it_within_the_device() {
        let mut noise = crate::noise::Noise(3);
        let mut estimator = estimator();
        for _ in 0..2000 {
            let mut three = |size: f64| Vec3::from_fn(|_, _| size * noise.next());
            let motion = ToolMotion::at(Pose::new(three(1e-4), three(1e-3)));
            let felt = Wrench { force_n: three(3.0), torque_n_m: three(0.1) };
            let found = estimator.update(Some(&patch()), &motion, &felt, DT).stiffness;
            let values = found.symmetric_eigenvalues();
            assert!(values.min() > -1e-9 * values.max(), "{values}");
            let block = found.fixed_view::<3, 3>(0, 0).into_owned();
            assert!(block.symmetric_eigenvalues().max() < 700.0 + 1e-6);
        }
        let nonsense = Wrench { force_n: Vec3::repeat(f64::NAN), ..Wrench::default() };
        let far = ToolMotion::at(Pose::translation(1.0, 0.0, 0.0));
        estimator.update(Some(&patch()), &far, &nonsense, DT);
        let found = estimator.update(Some(&patch()), &far, &Wrench::default(), DT).stiffness;
        assert!((stiffness_along(&found, Vec3::z()) - 125.0).abs() < 1e-9, "it starts again");
    }

    #[test]
    fn viscosity_is_not_taken_for_stiffness() {
        // 200 N/m with a relaxation of 5 ms: 1 N s/m, pressed by a sinusoid of 5 Hz.
        let mut estimator = estimator();
        let viscous = Patch { tissue: Tissue { relaxation_s: 5e-3, ..patch().tissue }, ..patch() };
        let pace = 2.0 * std::f64::consts::PI * 5.0;
        for tick in 0..400 {
            let t = DT * f64::from(tick);
            let (z, v) = (-5e-3 * (1.0 - (pace * t).cos()), -5e-3 * pace * (pace * t).sin());
            let mut motion = ToolMotion::at(Pose::translation(0.0, 0.0, z));
            motion.linear_m_s.z = v;
            let felt = Wrench { force_n: Vec3::z() * (-200.0 * z - 1.0 * v), ..Wrench::default() };
            let found = estimator.update(Some(&viscous), &motion, &felt, DT);
            if tick > 60 {
                let stiffness = stiffness_along(&found.stiffness, Vec3::z());
                assert!((stiffness - 200.0).abs() < 2.0, "{stiffness} N/m at {t} s");
                assert!((stiffness_along(&found.damping, Vec3::z()) - 1.0).abs() < 0.01);
            }
        }
    }
}
