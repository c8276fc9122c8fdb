//! The servo's view of the newest contact model: a law that changes without a jump when a model arrives.

use super::contact_model::{ContactModel, StraightLaw};
use crate::math::Vec3;
use crate::solver::tool::{ToolMotion, Wrench};

/// Longest fade, for a simulation that hardly gets on, in s: the hand should not feel old tissue.
const LONGEST_FADE_S: f64 = 0.05;

/// Fades from the law that was felt to the newest one over one period of the solves.
///
/// What fades is the law, not its value: while it does, both laws follow the tool, and neither pulls. A model that arrives before the last has
/// faded in starts from what is felt then.
#[derive(Clone, Debug)]
pub struct Follower {
    from: ContactModel,
    to: ContactModel,
    /// When `to` arrived, on the servo's clock; `None` before any did.
    since_s: Option<f64>,
    /// Time between two evaluations, in s.
    tick_s: f64,
}

impl Follower {
    /// Follows nothing yet, for a loop that evaluates every `tick_s` seconds.
    pub fn new(tick_s: f64) -> Self {
        Self { from: ContactModel::none(), to: ContactModel::none(), since_s: None, tick_s }
    }

    /// Forgets every model; the next one counts at once.
    pub fn reset(&mut self) {
        *self = Self::new(self.tick_s);
    }

    /// Takes the newest model, and says whether it is one that was not seen before. `motion` is where the tool is now.
    pub fn accept(&mut self, newest: &ContactModel, motion: &ToolMotion, now_s: f64) -> bool {
        if !self.is_news(newest) {
            return false;
        }
        if self.since_s.is_none() {
            self.from = *newest;
        } else if self.share(now_s) < 1.0 {
            self.from = self.law(motion, now_s);
        } else {
            self.from = self.to;
        }
        self.to = *newest;
        self.since_s = Some(now_s);
        true
    }

    /// Whether a model was not seen before.
    pub fn is_news(&self, newest: &ContactModel) -> bool {
        self.since_s.is_none() || newest.sequence != self.to.sequence
    }

    /// The law at a motion, as a model around it. What [`evaluate`](Self::evaluate) gives there is its wrench.
    pub fn law(&self, motion: &ToolMotion, now_s: f64) -> ContactModel {
        self.from.between(&self.to, self.share(now_s), motion)
    }

    /// The same for a tool that turns with its device.
    #[inline]
    pub fn straight(&self, motion: &ToolMotion, now_s: f64) -> StraightLaw {
        let (share, to) = (self.share(now_s), self.to.straight(motion));
        // What has faded is not looked at any more.
        if share < 1.0 { self.from.straight(motion).between(&to, share) } else { to }
    }

    /// The forces of [`evaluate`](Self::evaluate) at a motion, and at rest where it leads through.
    #[inline]
    pub fn forces(&self, motion: &ToolMotion, now_s: f64) -> [Vec3; 2] {
        let (share, to) = (self.share(now_s), self.to.forces(motion));
        if share >= 1.0 {
            return to;
        }
        let from = self.from.forces(motion);
        [0, 1].map(|i| from[i].zip_map(&to[i], |a, b| a + (b - a) * share))
    }

    /// The wrench at a motion.
    pub fn evaluate(&self, motion: &ToolMotion, now_s: f64) -> Wrench {
        let (share, to) = (self.share(now_s), self.to.evaluate(motion));
        if share >= 1.0 {
            return to;
        }
        let from = self.from.evaluate(motion);
        let mix = |a: f64, b: f64| a + (b - a) * share;
        Wrench {
            force_n: from.force_n.zip_map(&to.force_n, mix),
            torque_n_m: from.torque_n_m.zip_map(&to.torque_n_m, mix),
        }
    }

    /// How long ago the newest model arrived, in seconds; infinite before the first.
    pub fn age_s(&self, now_s: f64) -> f64 {
        self.since_s.map_or(f64::INFINITY, |since| now_s - since)
    }

    /// The newest model.
    pub fn newest(&self) -> &ContactModel {
        &self.to
    }

    /// How far the newest model has faded in, 0 to 1. The tick that sees it first takes the first step, so that solves at the servo's own rate are
    /// not a tick late.
    fn share(&self, now_s: f64) -> f64 {
        let fade = self.to.period_s.min(LONGEST_FADE_S).max(self.tick_s);
        let gone = self.age_s(now_s) + self.tick_s;
        if gone >= fade { 1.0 } else { (gone / fade).max(0.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::impedance::isotropic;
    use super::*;
    use crate::math::Pose;

    const TICK_S: f64 = 1e-3;

    fn pushing(sequence: u64, force_n: f64, period_s: f64) -> ContactModel {
        ContactModel {
            wrench: Wrench { force_n: Vec3::z() * force_n, ..Wrench::default() },
            stiffness: isotropic(300.0, 0.0),
            push: Vec3::z(),
            period_s,
            sequence,
            ..ContactModel::none()
        }
    }

    fn height(z: f64) -> ToolMotion {
        ToolMotion::at(Pose::translation(0.0, 0.0, z))
    }

    #[test]
    fn a_new_model_fades_in_over_one_period() {
        let mut follower = Follower::new(TICK_S);
        assert!(follower.accept(&pushing(1, 1.0, 0.01), &height(0.0), 5.0));
        assert_eq!(follower.evaluate(&height(0.0), 5.0).force_n.z, 1.0, "the first counts at once");
        assert!(follower.accept(&pushing(2, 2.0, 0.01), &height(0.0), 6.0));
        assert!(!follower.accept(&pushing(2, 9.0, 0.01), &height(0.0), 6.0), "the same again is not news");
        for tick in 0..20 {
            let felt = follower.evaluate(&height(0.0), 6.0 + TICK_S * f64::from(tick)).force_n.z;
            let expected = 1.0 + (f64::from(tick + 1) / 10.0).min(1.0);
            assert!((felt - expected).abs() < 1e-9, "{felt} at tick {tick}");
        }
    }

    #[test]
    fn models_at_the_servos_own_rate_are_not_delayed() {
        let mut follower = Follower::new(TICK_S);
        follower.accept(&pushing(1, 1.0, TICK_S), &height(0.0), 0.0);
        follower.accept(&pushing(2, 2.0, TICK_S), &height(0.0), 1e-3);
        assert_eq!(follower.evaluate(&height(0.0), 1e-3).force_n.z, 2.0);
    }

    #[test]
    fn models_that_come_too_early_do_not_jump_either() {
        let mut follower = Follower::new(TICK_S);
        follower.accept(&pushing(1, 1.0, 0.01), &height(0.0), 0.0);
        let mut last = 1.0;
        for tick in 1..200_u64 {
            let now = TICK_S * tick as f64;
            let at = height(-1e-5 * tick as f64);
            // Every third tick, alternating by 1 N, though said to come every ten.
            if tick % 3 == 0 {
                let news = ContactModel { motion: at, ..pushing(tick, 1.0 + (tick % 2) as f64, 0.01) };
                assert!(follower.accept(&news, &at, now));
            }
            let felt = follower.evaluate(&at, now).force_n.z;
            assert!((felt - last).abs() < 0.1 + 0.01, "{felt} after {last}");
            last = felt;
        }
    }

    #[test]
    fn a_fading_law_pulls_no_more_than_the_laws_it_is_made_of() {
        let mut follower = Follower::new(TICK_S);
        follower.accept(&pushing(1, 2.0, 0.02), &height(0.0), 0.0);
        follower.accept(&pushing(2, 0.5, 0.02), &height(0.0), 0.01);
        for tick in 0..30 {
            let (now, up) = (0.01 + TICK_S * f64::from(tick), height(5e-4 * f64::from(tick)));
            assert!(follower.evaluate(&up, now).force_n.z >= 0.0);
        }
        assert_eq!(follower.evaluate(&height(0.1), 0.02), Wrench::default());
    }

    #[test]
    fn age_counts_from_the_arrival_on_the_servos_clock() {
        let mut follower = Follower::new(TICK_S);
        assert_eq!(follower.age_s(3.0), f64::INFINITY);
        follower.accept(&pushing(1, 1.0, 0.01), &height(0.0), 3.0);
        assert_eq!(follower.age_s(3.5), 0.5);
        follower.reset();
        assert_eq!(follower.age_s(3.5), f64::INFINITY);
        assert_eq!(follower.evaluate(&height(0.0), 3.5), Wrench::default());
    }
}
