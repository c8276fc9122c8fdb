//! Everything between a computed force and the motors.
//!
//! One chain, always in this order: finite, age, speed, engage and ramp, average, clamp, slew, dead-man switch. Whatever fails before the slew
//! limit is withdrawn at the slew limit, which by [`DeviceDesc::check`] takes 30 ms at most; the dead-man switch alone steps to zero, and a loop that begins anew after a gap in its times begins there.
//! What the chain does not believe (a motion, a time, a simulation that failed) makes the tool engage anew: it gives no force until the force that is
//! asked for has been small for a while, as it is where the tool has left the tissue (and in tissue that has come to rest around it).
//!
//! Time comes in; no clock is read. Nothing allocates, waits or panics.

mod age;
mod average;
mod engage;
mod magnitude;
mod speed;

pub use age::{Age, DEAD_S};
pub use average::Average;
pub use engage::{Engage, QUIET_S, RAMP_S, SMALL};
pub use magnitude::{Slew, at_most};
pub use speed::Speed;

use super::clock::Tick;
use super::device::DeviceDesc;
use super::flags::Flags;
use super::impedance::stacked;
use crate::math::{Vec3, all_finite};
use crate::solver::tool::{ToolMotion, Wrench};

/// What one tick asks of the device, and how far that is to be believed.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// The computed wrench.
    pub wrench: Wrench,
    /// What of it lasts when device and tool come to rest: all but the dampers' share. Only that may be held.
    pub lasting: Wrench,
    /// The device's motion.
    pub motion: ToolMotion,
    /// Time since the last tick.
    pub tick: Tick,
    /// Time since the newest contact model arrived, in s.
    pub age_s: f64,
    /// Time between the solves that contact models come from, in s.
    pub period_s: f64,
    /// Whether all that the wrench was computed from was finite.
    pub is_finite: bool,
    /// Whether the simulation runs and has not failed.
    pub is_live: bool,
    /// Whether the dead-man switch is held, for a device that has one; `true` for others.
    pub is_held: bool,
}

/// The stages and what they remember.
#[derive(Clone, Debug)]
pub struct SafetyChain {
    desc: DeviceDesc,
    age: Age,
    speed: Speed,
    engage: Engage,
    force_average: Average,
    torque_average: Average,
    force_slew: Slew,
    torque_slew: Slew,
}

/// Longest step of the slew limit, in ticks: a loop that missed some does not jump as far as it could have gone.
const MOST_TICKS: f64 = 2.0;

impl SafetyChain {
    /// For a device that was checked.
    pub fn new(desc: &DeviceDesc) -> Self {
        Self {
            desc: *desc,
            age: Age::default(),
            speed: Speed::new(desc.max_speed_m_s),
            engage: Engage::new(),
            force_average: Average::new(desc.continuous_force_n, desc.max_force_n, desc.window_s),
            torque_average: Average::new(desc.continuous_torque_n_m, desc.max_torque_n_m, desc.window_s),
            force_slew: Slew::default(),
            torque_slew: Slew::default(),
        }
    }

    /// The wrench that goes to the device. Always finite and within the device's limits.
    #[inline(always)]
    pub fn pass(&mut self, asked: &Asked) -> (Wrench, Flags) {
        let (dt, clock) = self.time(asked.tick);
        let is_finite = is_finite(asked);
        let finite = Flags::NOT_FINITE.when(!is_finite);
        let only_finite = |wrench: Wrench| if is_finite { wrench } else { Wrench::default() };
        let (wrench, lasting) = (only_finite(asked.wrench), only_finite(asked.lasting));
        let (wrench, age) = self.age.pass(wrench, lasting, asked.age_s, asked.period_s);
        let speed = Flags::TOO_FAST.when(self.speed.is_over(&asked.motion, dt));

        let running = Flags::STOPPED.when(!asked.is_live) | Flags::RELEASED.when(!asked.is_held);
        let mut flags = clock | finite | age | speed | running;
        let is_dead = asked.age_s >= DEAD_S || asked.age_s.is_nan();
        let (share, engaging) = if is_dead || flags.intersects(DISENGAGING) {
            self.engage.reset();
            (0.0, Flags::WAITING)
        } else {
            // Once a device is engaged, nobody asks how much it gives.
            let load = if self.engage.is_waiting() { self.load(&wrench) } else { 0.0 };
            self.engage.share(load, dt)
        };
        flags |= engaging;

        let (force, force_flags) =
            bounded(wrench.force_n * share, &self.force_average, self.desc.max_force_n);
        // A device without torque is not told at every touch that it has none.
        let (torque, torque_flags) = if self.desc.has_torque() {
            bounded(wrench.torque_n_m * share, &self.torque_average, self.desc.max_torque_n_m)
        } else {
            (Vec3::zeros(), Flags::NONE)
        };
        flags |= force_flags | torque_flags;

        // A force that is withdrawn takes all the time that passed, and a tick's at least: a clock that stands still must not hold it.
        let step_s =
            if share == 0.0 { dt.max(self.desc.tick_s()) } else { dt.min(MOST_TICKS * self.desc.tick_s()) };
        let (force, is_force_short) = self.force_slew.step(force, self.desc.slew_n_per_s * step_s);
        let (torque, is_torque_short) = if self.desc.has_torque() {
            self.torque_slew.step(torque, self.desc.slew_n_m_per_s * step_s)
        } else {
            (torque, false)
        };
        flags |= Flags::SLEWED.when(is_force_short || is_torque_short);

        let given = if flags.intersects(Flags::RELEASED) {
            self.drop_to_zero();
            Wrench::default()
        } else {
            Wrench { force_n: force, torque_n_m: torque }
        };
        self.force_average.note(given.force_n, dt);
        self.torque_average.note(given.torque_n_m, dt);
        (given, flags)
    }

    /// Root of the mean square of the force rendered, over the device's window, in N.
    pub fn average_force_n(&self) -> f64 {
        self.force_average.rms()
    }

    /// The time that a tick stands for. A loop that starts or starts again has nothing to go on from: what the device did meanwhile is not known,
    /// and after a gap any force has had the time to fall to zero.
    fn time(&mut self, tick: Tick) -> (f64, Flags) {
        match tick {
            Tick::Steady(dt) => (dt, Flags::NONE),
            Tick::Fresh => {
                self.age.reset();
                self.speed.reset();
                self.drop_to_zero();
                (self.desc.tick_s(), Flags::PAUSED)
            }
            // The loop may well go on: the force is withdrawn as after any other failure.
            Tick::Unknown => (self.desc.tick_s(), Flags::NOT_FINITE),
        }
    }

    fn drop_to_zero(&mut self) {
        self.force_slew.drop_to_zero();
        self.torque_slew.drop_to_zero();
    }

    /// The wanted wrench as a share of the device's largest.
    fn load(&self, wrench: &Wrench) -> f64 {
        let force = wrench.force_n.norm() / self.desc.max_force_n;
        let torque =
            if self.desc.has_torque() { wrench.torque_n_m.norm() / self.desc.max_torque_n_m } else { 0.0 };
        force.max(torque)
    }
}

/// After any of these the tool engages anew.
pub const DISENGAGING: Flags =
    Flags(Flags::NOT_FINITE.0 | Flags::PAUSED.0 | Flags::STOPPED.0 | Flags::TOO_FAST.0 | Flags::RELEASED.0);

/// What the first stage asks: there is nothing where anything is not finite.
#[inline]
fn is_finite(asked: &Asked) -> bool {
    let is_finite = |wrench: &Wrench| all_finite(stacked(wrench).as_slice());
    asked.is_finite & asked.motion.is_valid() & is_finite(&asked.wrench) & is_finite(&asked.lasting)
}

/// The average limit, then the clamp.
#[inline(always)]
fn bounded(wanted: Vec3, average: &Average, largest: f64) -> (Vec3, Flags) {
    let allowed = average.allowed();
    // While the motors are cool they may do all they can, and that is the clamp's to say.
    let (lowered, is_warm) = if allowed < largest { at_most(wanted, allowed) } else { (wanted, false) };
    let (clamped, is_over) = at_most(lowered, largest);
    (clamped, Flags::AVERAGED.when(is_warm) | Flags::CLAMPED.when(is_over))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pose;
    use crate::servo::device::{LONGEST_FALL_S, SLOWEST_SERVO_HZ};
    use crate::servo::impedance::BlockLimit;

    const DT: f64 = 1e-3;

    fn push(force_n: f64) -> Wrench {
        Wrench { force_n: Vec3::new(0.6, 0.0, 0.8) * force_n, ..Wrench::default() }
    }

    /// What a sound loop asks.
    fn asked(force_n: f64) -> Asked {
        Asked {
            wrench: push(force_n),
            lasting: push(force_n),
            motion: ToolMotion::at(Pose::identity()),
            tick: Tick::Steady(DT),
            age_s: 0.0,
            period_s: DT,
            is_finite: true,
            is_live: true,
            is_held: true,
        }
    }

    /// A chain that is engaged and renders 0.8 N.
    fn engaged() -> SafetyChain {
        engaged_with(&DeviceDesc::touch())
    }

    fn engaged_with(desc: &DeviceDesc) -> SafetyChain {
        let mut chain = SafetyChain::new(desc);
        (0..700).for_each(|_| _ = chain.pass(&asked(0.0)));
        (0..10).for_each(|_| _ = chain.pass(&asked(0.8)));
        let (wrench, flags) = chain.pass(&asked(0.8));
        assert_eq!((wrench, flags), (push(0.8), Flags::NONE));
        chain
    }

    #[test]
    fn an_engaged_chain_lets_sound_forces_through_untouched() {
        let mut chain = engaged();
        for tick in 0..2000 {
            let wanted = asked(0.4 + 0.4 * (f64::from(tick) * 0.03).cos());
            assert_eq!(chain.pass(&wanted), (wanted.wrench, Flags::NONE));
        }
    }

    #[test]
    fn every_failure_withdraws_the_force_in_30_ms_and_it_stays_away_until_the_tool_engages_again() {
        let far = ToolMotion::at(Pose::translation(0.1, 0.0, 0.0));
        let nan = ToolMotion::at(Pose::translation(f64::NAN, 0.0, 0.0));
        let fast = ToolMotion { linear_m_s: Vec3::x() * 1.5, ..ToolMotion::at(Pose::identity()) };
        let nothing = Wrench { force_n: Vec3::repeat(f64::NAN), ..Wrench::default() };
        let failures = [
            (Flags::NOT_FINITE, Asked { motion: nan, ..asked(0.8) }),
            (Flags::NOT_FINITE, Asked { wrench: nothing, ..asked(0.8) }),
            (Flags::NOT_FINITE, Asked { is_finite: false, ..asked(0.8) }),
            (Flags::NOT_FINITE, Asked { tick: Tick::Unknown, ..asked(0.8) }),
            (Flags::PAUSED, Asked { tick: Tick::Fresh, ..asked(0.8) }),
            (Flags::STOPPED, Asked { is_live: false, ..asked(0.8) }),
            (Flags::TOO_FAST, Asked { motion: far, ..asked(0.8) }),
            (Flags::TOO_FAST, Asked { motion: fast, ..asked(0.8) }),
            (Flags::RELEASED, Asked { is_held: false, ..asked(0.8) }),
            (Flags::DECAYING, Asked { age_s: 0.1, ..asked(0.8) }),
        ];
        // As slow as may be, so that withdrawing takes a while.
        let step_n = 3.3 / LONGEST_FALL_S * DT;
        let desc = DeviceDesc { slew_n_per_s: step_n / DT, ..DeviceDesc::touch() };
        for (flag, failure) in failures {
            let mut chain = engaged_with(&desc);
            let (first, flags) = chain.pass(&failure);
            assert!(flags.contains(flag | Flags::WAITING), "{flags:?} for {failure:?}");
            let steps = flags.intersects(Flags::RELEASED | Flags::PAUSED);
            assert_eq!(first == Wrench::default(), steps, "{first:?} for {failure:?}");
            let mut last = first.force_n.norm();
            assert!(steps || (last - (0.8 - step_n)).abs() < 1e-9, "{last} N for {failure:?}");
            // One bad tick is enough; what follows is sound, but for a jump, after which the device is where it is.
            let there =
                Asked { motion: if failure.motion == far { far } else { asked(0.0).motion }, ..asked(0.8) };
            for tick in 1..2000 {
                let (now, flags) = chain.pass(&there);
                assert!(now.force_n.norm() <= last + 1e-12 && flags.contains(Flags::WAITING));
                last = now.force_n.norm();
                assert!(tick < 30 || last == 0.0, "{last} N after {tick} ms of {flag:?}");
            }
            // Out of the tissue, and in again.
            (0..103).for_each(|_| _ = chain.pass(&Asked { wrench: push(0.0), ..there }));
            let (risen, flags) = chain.pass(&there);
            assert!(risen.force_n.norm() < 0.01 && flags == Flags::RAMPING, "{risen:?} {flags:?}");
            (0..510).for_each(|_| _ = chain.pass(&there));
            assert_eq!(chain.pass(&there), (push(0.8), Flags::NONE));
        }
    }

    #[test]
    fn the_slowest_device_that_passes_its_check_is_without_force_in_35_ms() {
        let desc = DeviceDesc {
            slew_n_per_s: 3.3 / LONGEST_FALL_S,
            servo_rate_hz: SLOWEST_SERVO_HZ,
            continuous_force_n: 3.3,
            ..DeviceDesc::touch()
        };
        desc.check().unwrap();
        let slow = |force_n: f64| Asked { tick: Tick::Steady(desc.tick_s()), ..asked(force_n) };
        let mut chain = SafetyChain::new(&desc);
        (0..200).for_each(|_| _ = chain.pass(&slow(0.0)));
        (0..200).for_each(|_| _ = chain.pass(&slow(3.3)));
        assert!((chain.pass(&slow(3.3)).0.force_n.norm() - 3.3).abs() < 1e-9);
        // It fails right after a tick: the next sees it a tick later.
        let ticks = (0.035 / desc.tick_s()).floor() as u32;
        let last = (0..ticks).map(|_| chain.pass(&Asked { is_live: false, ..slow(3.3) }).0).last().unwrap();
        assert!(last.force_n.norm() < 1e-9, "{last:?} after {ticks} ticks");
    }

    #[test]
    fn the_largest_force_is_clamped_along_its_direction() {
        let mut chain = engaged();
        let (mut most, mut all) = (0.0_f64, Flags::NONE);
        // Less than the 70 ms that the motors bear it.
        for _ in 0..60 {
            let (given, flags) = chain.pass(&asked(50.0));
            assert!(given.force_n.cross(&push(1.0).force_n).norm() < 1e-9, "{given:?}");
            most = most.max(given.force_n.norm());
            all |= flags;
        }
        assert!((most - 3.3).abs() < 1e-9, "{most}");
        assert!(all.contains(Flags::CLAMPED | Flags::SLEWED) && !all.contains(Flags::AVERAGED));
    }

    #[test]
    fn a_long_press_comes_down_to_the_continuous_force() {
        let mut chain = engaged();
        let (mut given, mut flags) = (Wrench::default(), Flags::NONE);
        for _ in 0..20_000 {
            (given, flags) = chain.pass(&asked(3.0));
            assert!(chain.average_force_n() <= 0.88 + 1e-3, "{}", chain.average_force_n());
        }
        assert!((given.force_n.norm() - 0.88).abs() < 0.01, "{given:?}");
        assert_eq!(flags, Flags::AVERAGED);
    }

    #[test]
    fn a_jump_of_the_computed_force_is_slewed() {
        let mut chain = engaged();
        let (given, flags) = chain.pass(&asked(3.0));
        assert!((given.force_n.norm() - 1.8).abs() < 1e-9 && flags == Flags::SLEWED, "{given:?} {flags:?}");
        // A loop that missed some ticks does not jump as far as it could have.
        let (given, _) = chain.pass(&Asked { tick: Tick::Steady(0.02), ..asked(-3.0) });
        assert!((given.force_n - push(-0.2).force_n).norm() < 1e-9, "{given:?}");
        // But it is withdrawn as fast as it could have been.
        let mut chain =
            engaged_with(&DeviceDesc { slew_n_per_s: 3.3 / LONGEST_FALL_S, ..DeviceDesc::touch() });
        let (given, _) = chain.pass(&Asked { tick: Tick::Steady(0.02), is_live: false, ..asked(0.8) });
        assert_eq!(given, Wrench::default());
    }

    #[test]
    fn a_device_without_torque_gets_none_and_is_not_told_at_every_touch() {
        let mut chain = engaged();
        let turned = Wrench { torque_n_m: Vec3::x(), ..push(0.8) };
        assert_eq!(chain.pass(&Asked { wrench: turned, ..asked(0.8) }), (push(0.8), Flags::NONE));
    }

    #[test]
    fn torque_is_bounded_like_force() {
        let desc = DeviceDesc {
            max_torque_n_m: 0.2,
            continuous_torque_n_m: 0.1,
            slew_n_m_per_s: 50.0,
            max_stiffness: BlockLimit { linear: 700.0, angular: 1.0 },
            ..DeviceDesc::touch()
        };
        desc.check().unwrap();
        let mut chain = SafetyChain::new(&desc);
        let turned = Asked {
            wrench: Wrench { torque_n_m: Vec3::new(3.0, 4.0, 0.0), ..Wrench::default() },
            ..asked(0.0)
        };
        assert_eq!(
            (0..1000).map(|_| chain.pass(&turned).0).last(),
            Some(Wrench::default()),
            "a torque is not small"
        );
        (0..700).for_each(|_| _ = chain.pass(&asked(0.0)));
        let (first, flags) = chain.pass(&turned);
        assert!((first.torque_n_m - Vec3::new(0.03, 0.04, 0.0)).norm() < 1e-9, "{first:?}");
        assert!(flags.contains(Flags::CLAMPED | Flags::SLEWED));
        let most = (0..10).map(|_| chain.pass(&turned).0.torque_n_m.norm()).fold(0.0, f64::max);
        assert!((most - 0.2).abs() < 1e-9, "{most}");
    }
}
