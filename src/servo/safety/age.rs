//! What an old contact model may still say.

use crate::servo::flags::Flags;
use crate::solver::tool::Wrench;

/// Age up to which a model is followed, in s and in periods of the solves, whichever is longer.
const FOLLOW: (f64, f64) = (3e-3, 2.0);
/// Age up to which the last force is held, likewise.
const HOLD: (f64, f64) = (10e-3, 4.0);
/// Time constant of the decay afterwards, in s.
const DECAY_S: f64 = 20e-3;
/// Age of a model that says nothing any more, in s.
pub const DEAD_S: f64 = 0.1;

/// Holds the last wrench of a model that grows old, then lets it decay.
///
/// A line through one solve is good for a period or two. Beyond that the tool's motion would be answered by tissue that nobody looked
/// at; a constant force is the safer guess, and no force a safer one than that.
#[derive(Clone, Debug, Default)]
pub struct Age {
    held: Wrench,
}

impl Age {
    /// The wrench that a model of this age stands for; `period_s` is the time between solves. `lasting` is what of the followed wrench may be held: a
    /// damper's share belongs to a velocity that is gone by then.
    pub fn pass(&mut self, followed: Wrench, lasting: Wrench, age_s: f64, period_s: f64) -> (Wrench, Flags) {
        let after = |(least, periods): (f64, f64)| f64::max(least, periods * period_s).min(DEAD_S);
        if age_s <= after(FOLLOW) {
            self.held = lasting;
            return (followed, Flags::NONE);
        }
        // Not below the line above: a NaN must end here, without a force.
        let share = if age_s <= after(HOLD) {
            1.0
        } else if age_s < DEAD_S {
            (-(age_s - after(HOLD)) / DECAY_S).exp()
        } else {
            self.held = Wrench::default();
            0.0
        };
        let held = Wrench { force_n: self.held.force_n * share, torque_n_m: self.held.torque_n_m * share };
        (held, Flags::HELD | Flags::DECAYING.when(share < 1.0))
    }

    /// Forgets what is held.
    pub fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    fn push(force_n: f64) -> Wrench {
        Wrench { force_n: Vec3::z() * force_n, torque_n_m: Vec3::x() * force_n }
    }

    #[test]
    fn a_force_is_followed_then_held_then_decays_then_is_gone() {
        let mut age = Age::default();
        let mut at = |ms: f64, force_n: f64| {
            let (wrench, flags) = age.pass(push(force_n), push(force_n), ms / 1e3, 1e-3);
            assert_eq!(wrench.force_n.z, wrench.torque_n_m.x, "the torque goes the same way");
            (wrench.force_n.z, flags)
        };
        assert_eq!(at(0.0, 1.0), (1.0, Flags::NONE));
        assert_eq!(at(3.0, 2.0), (2.0, Flags::NONE));
        assert_eq!(at(3.1, 5.0), (2.0, Flags::HELD));
        assert_eq!(at(10.0, 9.0), (2.0, Flags::HELD));
        let (decayed, flags) = at(30.0, 9.0);
        assert!((decayed - 2.0 / std::f64::consts::E).abs() < 1e-12, "{decayed}");
        assert_eq!(flags, Flags::HELD | Flags::DECAYING);
        assert_eq!(at(100.0, 9.0), (0.0, Flags::HELD | Flags::DECAYING));
        assert_eq!(at(f64::INFINITY, 9.0).0, 0.0);
        assert_eq!(at(f64::NAN, 9.0).0, 0.0);
    }

    #[test]
    fn slow_solves_are_waited_for_but_not_for_ever() {
        let mut age = Age::default();
        let mut pass = |age_s: f64, period_s: f64| age.pass(push(1.0), push(1.0), age_s, period_s);
        assert_eq!(pass(0.02, 0.01).1, Flags::NONE, "two periods");
        assert_eq!(pass(0.04, 0.01).1, Flags::HELD, "four periods");
        assert_eq!(pass(0.1, 0.2).1, Flags::NONE, "one late solve of a very slow one");
        assert_eq!(pass(0.101, 0.2).0, Wrench::default());
    }

    #[test]
    fn what_a_damper_adds_is_followed_and_not_held() {
        let mut age = Age::default();
        assert_eq!(age.pass(push(1.5), push(1.0), 0.0, 1e-3).0, push(1.5));
        assert_eq!(age.pass(push(1.5), push(1.0), 5e-3, 1e-3).0, push(1.0));
    }
}
