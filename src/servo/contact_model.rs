//! What the physics publishes about one tool's contact: enough for a servo loop to know the force at any motion near by.

use super::impedance::{angular, displacement, linear, stacked, velocity, wrench};
use crate::math::{Mat3, Mat6, Pose, Quat, Vec3, Vec6, all_finite};
use crate::solver::tool::{ToolMotion, Wrench};

/// A tool's wrench at one motion, and how it changes around it. World axes, torque and rotation about the tool's origin.
///
/// The law is F = F₀ − K (x − x₀) − B (v − v₀), where x − x₀ is a translation and a rotation vector, but tissue can only push: see
/// [`evaluate`](Self::evaluate).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactModel {
    /// Force and torque that the tissue exerts **on the tool** (F₀).
    pub wrench: Wrench,
    /// The motion that they stand for (x₀, v₀): where the tool was, which in a simulation that runs slower than life is not where it was asked to be; or where it
    /// will be if it goes on so, see [`going_on`](Self::going_on).
    pub motion: ToolMotion,
    /// K `[N/m, N/rad; N m/m, N m/rad]`: symmetric, positive semidefinite, within the coupling's limits; what
    /// [`clamped`](super::impedance::clamped) makes. Zero where nothing is touched. What the tissue's inertia resists with is part of it.
    pub stiffness: Mat6,
    /// B, likewise, per second.
    pub damping: Mat6,
    /// Unit direction in which the tissue pushes the tool away; zero where nothing is touched, or where the tool is held from several
    /// sides and leaving one is entering another. What [`push_direction`] makes.
    pub push: Vec3,
    /// Simulated time, in seconds.
    pub time_s: f64,
    /// Time between the last two solves, in seconds: on the servo's clock where it says the time, on the wall clock otherwise. How long this
    /// model will have to serve.
    pub period_s: f64,
    /// The servo's own time stamp of the motion that the solve took the tool to, or towards, in seconds; NaN if there was none. Tells how old a force is
    /// from end to end.
    pub stamp_s: f64,
    /// Counts the tool's models; 0 before the first.
    pub sequence: u64,
    /// Counts how often the tissue was not the same any more, as after a reset: the tool then engages anew.
    pub epoch: u64,
}

/// Share of the normal force below which a leaving tool's friction and torque fade as well.
const LAST_HOLD: f64 = 0.2;

/// Tissue is taken to surround a tool where less than this share of its pushes is left when they are added up: two equal pushes at
/// more than 120° to each other.
const LEAST_AGREEMENT: f64 = 0.5;

impl ContactModel {
    /// Nothing is touched.
    pub fn none() -> Self {
        Self {
            wrench: Wrench::default(),
            motion: ToolMotion::at(Pose::identity()),
            stiffness: Mat6::zeros(),
            damping: Mat6::zeros(),
            push: Vec3::zeros(),
            time_s: 0.0,
            period_s: 0.0,
            stamp_s: f64::NAN,
            sequence: 0,
            epoch: 0,
        }
    }

    /// The model of a tool that went a way in the last step, and that tissue at its heels resists when it goes another one in the next: by `stopping` when it stops, and by
    /// `inertia`, in N/m and so on, for each way from there. The tissue has the velocity that the tool gave it, and goes on by itself; a tool that stops is left by it.
    ///
    /// That is how a step of the simulation answers: what lies under the tool has to move with it by the step's end, whatever that takes. A servo that knew
    /// the stiffness at rest alone would press far beyond what the next step allows, and feel a blow.
    pub fn going_on(self, way: &Vec6, stopping: &Vec6, inertia: &Mat6) -> Self {
        let stops = stacked(&self.wrench) + stopping;
        let stiffness = self.stiffness + inertia;
        // The line's two ends: a tool that stops, and one that goes on.
        let goes = stops - stiffness * way;
        // A model stands where it pushes more, for where it does not push it says nothing at all.
        if linear(&stops).dot(&self.push) > linear(&goes).dot(&self.push) {
            return Self { wrench: wrench(&stops), stiffness, ..self };
        }
        let (at, turn) = (self.motion.pose, Quat::from_scaled_axis(angular(way)));
        let pose = Pose::from_parts((at.translation.vector + linear(way)).into(), turn * at.rotation);
        Self { wrench: wrench(&goes), motion: ToolMotion { pose, ..self.motion }, stiffness, ..self }
    }

    /// Whether every number that a force could come from is finite.
    pub fn is_finite(&self) -> bool {
        self.motion.is_valid()
            && all_finite(stacked(&self.wrench).as_slice())
            && all_finite(self.push.as_slice())
            && all_finite(self.stiffness.as_slice())
            && all_finite(self.damping.as_slice())
            && self.period_s.is_finite()
    }

    /// The wrench at a motion near the model's own.
    ///
    /// Contact is one-sided, and the line through F₀ is not: followed backwards it would pull a leaving tool into the tissue. So the
    /// part of the force along [`push`](Self::push) never changes its sign. Where it would, the tool has left and there is no
    /// wrench at all; and over the last fifth of it, friction and torque fade too, since what is no longer pressed
    /// cannot hold. Where F₀ itself does not push, the law is zero.
    pub fn evaluate(&self, motion: &ToolMotion) -> Wrench {
        self.one_sided(&self.line(motion)).0
    }

    /// Whether the tool would have left the tissue at a motion: the law is zero there.
    pub fn has_left(&self, motion: &ToolMotion) -> bool {
        self.one_sided(&self.line(motion)).1
    }

    /// What is left of the line once tissue can only push, and whether the tool has left it.
    #[inline]
    fn one_sided(&self, line: &Wrench) -> (Wrench, bool) {
        if self.push == Vec3::zeros() {
            return (*line, false);
        }
        let pressed = self.wrench.force_n.dot(&self.push);
        let pressing = line.force_n.dot(&self.push);
        if pressed <= 0.0 || pressing <= 0.0 {
            return (Wrench::default(), pressing <= 0.0);
        }
        if pressing >= LAST_HOLD * pressed {
            return (*line, false);
        }
        let hold = pressing / (LAST_HOLD * pressed);
        let normal = self.push * pressing;
        let force_n = normal + (line.force_n - normal) * hold;
        (Wrench { force_n, torque_n_m: line.torque_n_m * hold }, false)
    }

    /// The law without its one-sidedness.
    fn line(&self, motion: &ToolMotion) -> Wrench {
        let away = displacement(&self.motion.pose, &motion.pose);
        let faster = velocity(motion) - velocity(&self.motion);
        wrench(&(stacked(&self.wrench) - self.stiffness * away - self.damping * faster))
    }

    /// The law at a motion between this model's (`share` 0) and another's (1), as a model around that motion.
    pub fn between(&self, other: &Self, share: f64, motion: &ToolMotion) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * share;
        let ((a, a_left), (b, b_left)) =
            (self.one_sided(&self.line(motion)), other.one_sided(&other.line(motion)));
        // Beyond the tissue nothing resists.
        let there = |of: &Mat6, has_left: bool| if has_left { Mat6::zeros() } else { *of };
        let force_n = a.force_n.zip_map(&b.force_n, mix);
        Self {
            wrench: Wrench { force_n, torque_n_m: a.torque_n_m.zip_map(&b.torque_n_m, mix) },
            motion: *motion,
            stiffness: there(&self.stiffness, a_left).zip_map(&there(&other.stiffness, b_left), mix),
            damping: there(&self.damping, a_left).zip_map(&there(&other.damping, b_left), mix),
            push: push_between([(a.force_n, self.push), (b.force_n, other.push)], share, &force_n),
            ..*other
        }
    }

    /// The law around a motion, for a tool that turns with its device.
    #[inline(always)]
    pub fn straight(&self, motion: &ToolMotion) -> StraightLaw {
        let block = |of: &Mat6| -> Mat3 { of.fixed_view::<3, 3>(0, 0).into() };
        let (force_n, has_left) = self.pushed(self.standing(&motion.pose) - self.slowed(motion));
        let there = |of: &Mat6| if has_left { Mat3::zeros() } else { block(of) };
        StraightLaw {
            force_n,
            linear_m_s: motion.linear_m_s,
            stiffness: there(&self.stiffness),
            damping: there(&self.damping),
            push: self.push,
        }
    }

    /// The forces of [`evaluate`](Self::evaluate) at a motion, and at rest where it leads through.
    #[inline]
    pub fn forces(&self, motion: &ToolMotion) -> [Vec3; 2] {
        let standing = self.standing(&motion.pose);
        let rest = ToolMotion::at(motion.pose);
        [motion, &rest].map(|motion| self.pushed(standing - self.slowed(motion)).0)
    }

    /// The force of the line at a pose and the model's own velocity.
    #[inline]
    fn standing(&self, pose: &Pose) -> Vec3 {
        let away = displacement(&self.motion.pose, pose);
        self.wrench.force_n - upper(&self.stiffness, &away)
    }

    /// What dampers take of it at another velocity.
    #[inline]
    fn slowed(&self, motion: &ToolMotion) -> Vec3 {
        upper(&self.damping, &(velocity(motion) - velocity(&self.motion)))
    }

    /// As [`Self::one_sided`], where torque is nobody's business.
    #[inline]
    fn pushed(&self, force_n: Vec3) -> (Vec3, bool) {
        let (wrench, has_left) = self.one_sided(&Wrench { force_n, ..Wrench::default() });
        (wrench.force_n, has_left)
    }
}

/// The direction in which tissue pushes between two laws, each a force and its direction, where the force is `force_n`: the mean of both; and where that would have the tissue pull, because they push against each
/// other, that of the mean of what they push with.
#[inline]
fn push_between(laws: [(Vec3, Vec3); 2], share: f64, force_n: &Vec3) -> Vec3 {
    let [(force_a, a), (force_b, b)] = laws;
    let mean = |a: Vec3, b: Vec3| (a + (b - a) * share).try_normalize(f64::MIN_POSITIVE).unwrap_or_default();
    let push = mean(a, b);
    if force_n.dot(&push) >= 0.0 {
        return push;
    }
    let pushed = |force: Vec3, along: Vec3| along * force.dot(&along).max(0.0);
    mean(pushed(force_a, a), pushed(force_b, b))
}

/// The force of a wrench: the upper half of a product.
#[inline]
fn upper(matrix: &Mat6, motion: &Vec6) -> Vec3 {
    matrix.fixed_view::<3, 3>(0, 0) * linear(motion) + matrix.fixed_view::<3, 3>(0, 3) * angular(motion)
}

/// A law around one motion for a tool that turns with its device, so that translation is all that it may still choose: a ninth of the numbers. World
/// axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StraightLaw {
    /// The force there, ...
    pub force_n: Vec3,
    /// ... at this velocity.
    pub linear_m_s: Vec3,
    /// Of the force against translation, in N/m.
    pub stiffness: Mat3,
    /// Likewise, in N s/m.
    pub damping: Mat3,
    /// As [`ContactModel::push`].
    pub push: Vec3,
}

impl StraightLaw {
    /// The law between this one (`share` 0) and another around the same motion (1).
    #[inline]
    pub fn between(&self, other: &Self, share: f64) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * share;
        let force_n = self.force_n.zip_map(&other.force_n, mix);
        Self {
            force_n,
            linear_m_s: other.linear_m_s,
            stiffness: self.stiffness.zip_map(&other.stiffness, mix),
            damping: self.damping.zip_map(&other.damping, mix),
            push: push_between([(self.force_n, self.push), (other.force_n, other.push)], share, &force_n),
        }
    }

    /// Whether a tool that goes on at a velocity for `dt` seconds has left the tissue: what [`ContactModel::has_left`] says there.
    #[inline]
    pub fn has_left(&self, linear_m_s: Vec3, dt: f64) -> bool {
        let faster = linear_m_s - self.linear_m_s;
        let line = self.force_n - self.stiffness * (linear_m_s * dt) - self.damping * faster;
        self.push != Vec3::zeros() && line.dot(&self.push) <= 0.0
    }
}

/// The direction in which tissue pushes a tool that it touches in many points, from the normal force on the tool at each (friction left
/// out): [`ContactModel::push`].
pub fn push_direction(pushes: impl IntoIterator<Item = Vec3>) -> Vec3 {
    let (sum, total) =
        pushes.into_iter().fold((Vec3::zeros(), 0.0), |(sum, total), push| (sum + push, total + push.norm()));
    let agrees = sum.norm() >= LEAST_AGREEMENT * total;
    sum.try_normalize(f64::MIN_POSITIVE).filter(|_| agrees).unwrap_or_default()
}

/// The rate at which a model says that force along a direction falls with motion along it, in N/m.
pub fn stiffness_along(stiffness: &Mat6, direction: Vec3) -> f64 {
    let mut way = stacked(&Wrench::default());
    way.fixed_rows_mut::<3>(0).copy_from(&direction);
    linear(&(stiffness * way)).dot(&direction)
}

#[cfg(test)]
mod tests {
    use super::super::impedance::isotropic;
    use super::*;

    /// Pushed along z by 1 N, dragged along x by 0.3 N, turned by a torque.
    fn pressed() -> ContactModel {
        ContactModel {
            wrench: Wrench { force_n: Vec3::new(0.3, 0.0, 1.0), torque_n_m: Vec3::new(0.0, 0.02, 0.0) },
            motion: ToolMotion::at(Pose::translation(0.1, 0.2, 0.3)),
            stiffness: isotropic(500.0, 0.2),
            damping: isotropic(2.0, 0.0),
            push: Vec3::z(),
            period_s: 0.001,
            sequence: 1,
            ..ContactModel::none()
        }
    }

    fn lifted(by_m: f64) -> ToolMotion {
        ToolMotion::at(Pose::translation(0.1, 0.2, 0.3 + by_m))
    }

    #[test]
    fn forces_alone_are_those_of_the_whole_wrench_moving_and_at_rest() {
        let mut noise = crate::noise::Noise(11);
        for _ in 0..200 {
            let root = Mat6::from_fn(|_, _| 10.0 * noise.next());
            let (stiffness, damping) = (root * root.transpose(), root * root.transpose() * 1e-2);
            let law = ContactModel { stiffness, damping, ..pressed() };
            let mut three = |size: f64| Vec3::from_fn(|_, _| size * noise.next());
            let pose = Pose::new(Vec3::new(0.1, 0.2, 0.3) + three(2e-3), three(5e-3));
            let motion = ToolMotion { pose, linear_m_s: three(0.1), angular_rad_s: three(0.5) };
            let expected = [motion, ToolMotion::at(pose)].map(|motion| law.evaluate(&motion).force_n);
            for (found, expected) in law.forces(&motion).iter().zip(expected) {
                assert!((found - expected).norm() < 1e-12, "{found} {expected}");
            }
        }
    }

    #[test]
    fn force_follows_stiffness_and_damping_around_its_motion() {
        let model = pressed();
        assert_eq!(model.evaluate(&model.motion), model.wrench);
        let turn = Vec3::new(0.0, 0.1, 0.0);
        let mut motion = ToolMotion::at(Pose::new(Vec3::new(0.101, 0.2, 0.299), turn));
        motion.linear_m_s = Vec3::new(0.0, 0.05, 0.0);
        let felt = model.evaluate(&motion);
        assert!((felt.force_n - Vec3::new(0.3 - 0.5, -0.1, 1.5)).norm() < 1e-12, "{felt:?}");
        assert!((felt.torque_n_m - Vec3::new(0.0, 0.02 - 0.02, 0.0)).norm() < 1e-12, "{felt:?}");
    }

    #[test]
    fn tissue_that_moves_resists_another_way_than_the_tools_last() {
        let inertia = isotropic(2000.0, 0.0);
        for z in [-1e-4, 1e-4, 1e-2] {
            let before = pressed();
            let way = Vec6::new(0.0, 0.0, z, 0.0, 0.0, 0.0);
            let model = before.going_on(&way, &(inertia * way), &inertia);
            // On the same way again what lasts alone has changed; where the tool stops the tissue that came with it is left or left behind.
            let on = before.wrench.force_n.z - 500.0 * z;
            let stopped = before.wrench.force_n.z + 2000.0 * z;
            assert!((model.evaluate(&lifted(z)).force_n.z - on.max(0.0)).abs() < 1e-9, "{z}");
            assert!((model.evaluate(&lifted(0.0)).force_n.z - stopped.max(0.0)).abs() < 1e-9, "{z}");
        }
    }

    #[test]
    fn a_leaving_tool_is_never_pulled_back() {
        let model = pressed();
        let mut last = model.wrench.force_n;
        // The line reaches zero after 1 N / 500 N/m = 2 mm.
        for step in 1..=400 {
            let felt = model.evaluate(&lifted(1e-5 * f64::from(step)));
            assert!(felt.force_n.z >= 0.0, "{felt:?}");
            assert!((felt.force_n - last).norm() < 0.02, "no jump: {felt:?} after {last:?}");
            last = felt.force_n;
            if step >= 200 {
                assert_eq!(felt, Wrench::default(), "neither drag nor torque in the air");
            }
        }
        let mut withdrawn = lifted(0.0);
        withdrawn.linear_m_s = Vec3::z() * 0.6;
        assert_eq!(model.evaluate(&withdrawn), Wrench::default(), "damping does not hold it either");
    }

    #[test]
    fn a_tool_held_from_both_sides_is_pushed_back_either_way() {
        let held = ContactModel { push: push_direction([Vec3::z(), -Vec3::z() * 0.9]), ..pressed() };
        assert_eq!(held.push, Vec3::zeros());
        assert!(held.evaluate(&lifted(4e-3)).force_n.z < -0.9);
    }

    #[test]
    fn pushes_that_agree_have_a_direction() {
        let at = |angle: f64| Vec3::new(angle.sin(), 0.0, angle.cos());
        assert!((push_direction([at(1.0), at(-1.0)]) - Vec3::z()).norm() < 1e-12);
        assert_eq!(push_direction([at(1.1), at(-1.1)]), Vec3::zeros());
        assert_eq!(push_direction([]), Vec3::zeros());
        assert_eq!(push_direction([Vec3::zeros()]), Vec3::zeros());
    }

    #[test]
    fn nothing_touched_is_no_wrench_anywhere() {
        assert_eq!(ContactModel::none().evaluate(&lifted(5.0)), Wrench::default());
        assert!(ContactModel::none().is_finite());
    }

    #[test]
    fn a_law_between_two_is_their_mean_and_starts_at_the_first() {
        let (a, mut b) = (pressed(), pressed());
        b.wrench.force_n.z = 3.0;
        b.stiffness *= 3.0;
        let at = lifted(-1e-3);
        for share in [0.0, 0.25, 1.0] {
            let mean = a.between(&b, share, &at);
            let expected = a.evaluate(&at).force_n * (1.0 - share) + b.evaluate(&at).force_n * share;
            assert!((mean.evaluate(&at).force_n - expected).norm() < 1e-12);
            let stiffness = stiffness_along(&mean.stiffness, Vec3::z());
            assert!((stiffness - 500.0 * (1.0 + 2.0 * share)).abs() < 1e-9, "{stiffness}");
        }
    }

    #[test]
    fn between_laws_that_push_against_each_other_tissue_still_pushes() {
        let (a, mut b) = (pressed(), pressed());
        (b.wrench.force_n, b.push) = (-3.0 * a.wrench.force_n, -a.push);
        let at = a.motion;
        for share in [0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 1.0] {
            let expected = a.wrench.force_n * (1.0 - share) + b.wrench.force_n * share;
            let mean = a.between(&b, share, &at);
            assert!((mean.evaluate(&at).force_n - expected).norm() < 1e-12, "{share}");
            let straight = a.straight(&at).between(&b.straight(&at), share);
            assert!(!straight.has_left(at.linear_m_s, 0.0), "{share}");
        }
    }

    #[test]
    fn a_law_in_the_air_resists_nothing() {
        let (model, above) = (pressed(), lifted(3e-3));
        let law = model.between(&model, 0.5, &above);
        assert_eq!((law.stiffness, law.damping), (Mat6::zeros(), Mat6::zeros()));
        assert_eq!(law.evaluate(&lifted(0.0)), Wrench::default());
    }
}
