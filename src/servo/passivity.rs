//! Whether the loop gives energy to the hand, and a damper that takes it back.
//!
//! After Hannaford and Ryu, "Time-domain passivity control of haptic interfaces" (IEEE Transactions on Robotics and Automation, 2002). The
//! force that is sent stays on the motors until the next tick, so the work between two ticks is that force times the way between them,
//! exactly: no velocity has to be estimated for the observer.

use super::impedance::{displacement, stacked, velocity};
use crate::math::{Pose, Vec3};
use crate::solver::tool::{ToolMotion, Wrench};

/// Largest debt that is remembered, in J: what a hand and a device of 0.2 kg hold at 0.3 m/s, faster than hands move on tissue. What was given beyond that has
/// long gone elsewhere; to take it back would damp a hand that does nothing wrong any more.
pub const MOST_DEBT_J: f64 = 1e-2;

/// Adds up the energy that the hand has put into the loop.
#[derive(Clone, Debug, Default)]
pub struct Observer {
    energy_j: f64,
    least_j: f64,
    credit_j: f64,
    /// Where the device was at the last tick, and the wrench that it has rendered since.
    last: Option<(Pose, Wrench)>,
}

impl Observer {
    /// Takes in where the device is now. Poses that are not finite are passed over.
    #[inline]
    pub fn look(&mut self, motion: &ToolMotion) {
        if let Some((from, rendered)) = &self.last {
            // Turning costs nothing where there is no torque, and most of the time otherwise.
            let work = if rendered.torque_n_m == Vec3::zeros() {
                rendered.force_n.dot(&(motion.pose.translation.vector - from.translation.vector))
            } else {
                stacked(rendered).dot(&displacement(from, &motion.pose))
            };
            if work.is_finite() {
                // The device pushed the hand along the way: that energy came from the loop.
                self.energy_j -= work;
                self.least_j = self.least_j.min(self.energy_j);
                self.credit_j = (self.credit_j - work).max(-MOST_DEBT_J);
            }
            self.last = None;
        }
    }

    /// Takes in what the device renders from here on.
    #[inline]
    pub fn render(&mut self, motion: &ToolMotion, rendered: &Wrench) {
        self.last = Some((motion.pose, *rendered));
        // Without a force nothing is held that could come back: what is left was dissipated.
        if *rendered == Wrench::default() {
            self.credit_j = self.credit_j.min(0.0);
        }
    }

    /// Forgets what the device rendered: the loop paused, and the motors were their own.
    pub fn pause(&mut self) {
        self.last = None;
    }

    /// Energy that the loop holds or has dissipated, in J. Below zero, the loop has given more than it got.
    pub fn energy_j(&self) -> f64 {
        self.energy_j
    }

    /// Energy that the loop may still give back, in J, or owes, below zero. Tissue and friction dissipate; that must not pay for shaking
    /// later, so whatever is left when there is no force is not counted on. A debt is at most [`MOST_DEBT_J`].
    pub fn credit_j(&self) -> f64 {
        self.credit_j
    }

    /// The least that the energy ever was, in J: a passive loop stays at or above zero.
    pub fn least_j(&self) -> f64 {
        self.least_j
    }
}

/// The force of a damper that keeps a loop from owing energy at the end of the next `dt` seconds, and whether there is any. Zero torque.
///
/// `wrench` is what the loop would render, `credit_j` what it may give. E is what would be left of that, should the device keep its velocity; where that is below zero, the
/// damping is α = −E ÷ (dt v²), at most `most_n_s_per_m`, beyond which the damper itself would not be passive at this rate.
#[inline]
pub fn control(
    credit_j: f64,
    wrench: &Wrench,
    motion: &ToolMotion,
    dt: f64,
    most_n_s_per_m: f64,
) -> (Wrench, bool) {
    let square = motion.linear_m_s.norm_squared();
    let then_j = credit_j - stacked(wrench).dot(&velocity(motion)) * dt;
    // Written so that a NaN adds nothing.
    let is_owing = then_j < 0.0 && square > 0.0 && dt > 0.0;
    if !is_owing {
        return (Wrench::default(), false);
    }
    let damping = (-then_j / (dt * square)).min(most_n_s_per_m);
    (Wrench { force_n: -motion.linear_m_s * damping, ..Wrench::default() }, true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> ToolMotion {
        ToolMotion::at(Pose::translation(x, 0.0, 0.0))
    }

    fn push(force_n: f64) -> Wrench {
        Wrench { force_n: Vec3::x() * force_n, ..Wrench::default() }
    }

    #[test]
    fn energy_is_force_times_way_and_comes_back_from_a_spring() {
        let mut observer = Observer::default();
        // Into a spring of 100 N/m by 10 mm and out again, 0.1 mm a tick. A held force lags by half a tick: in, each tick misses ½ K d²,
        // and out it gives as much too much.
        let positions = (0..=100).chain((0..100).rev()).map(|i| 1e-4 * f64::from(i));
        let mut most = 0.0_f64;
        for x in positions {
            observer.look(&at(x));
            observer.render(&at(x), &push(-100.0 * x));
            most = most.max(observer.energy_j());
        }
        let (stored, lag) = (0.5 * 100.0 * 0.01_f64.powi(2), 100.0 * 0.5 * 100.0 * 1e-4_f64.powi(2));
        assert!((most - (stored - lag)).abs() < 1e-12, "{most}");
        assert!((observer.energy_j() + 2.0 * lag).abs() < 1e-12, "{}", observer.energy_j());
        assert_eq!(observer.least_j(), observer.energy_j());
    }

    #[test]
    fn torque_works_too_and_pauses_do_not() {
        let mut observer = Observer::default();
        let turned = |angle: f64| ToolMotion::at(Pose::rotation(Vec3::z() * angle));
        observer.render(&turned(0.0), &Wrench { torque_n_m: Vec3::z() * -0.5, ..Wrench::default() });
        observer.look(&turned(0.2));
        assert!((observer.energy_j() - 0.1).abs() < 1e-12);
        observer.render(&turned(0.2), &Wrench { torque_n_m: Vec3::z() * -0.5, ..Wrench::default() });
        observer.pause();
        observer.look(&turned(1.0));
        assert!((observer.energy_j() - 0.1).abs() < 1e-12);
        observer.render(&at(0.0), &push(1.0));
        observer.look(&at(f64::NAN));
        assert!(observer.energy_j().is_finite());
    }

    #[test]
    fn what_was_dissipated_pays_for_nothing_later() {
        let mut observer = Observer::default();
        let mut drag = |from: f64, to: f64, force_n: f64| {
            observer.render(&at(from), &push(force_n));
            observer.look(&at(to));
            observer.credit_j()
        };
        // To and fro against friction of 0.05 N, 10 mm each way.
        drag(0.0, 0.01, -0.05);
        assert!((drag(0.01, 0.0, 0.05) - 1e-3).abs() < 1e-12, "as long as it lasts, it may be a spring's");
        assert_eq!(drag(0.0, 0.01, 0.0), 0.0, "in the air it is gone");
        assert!((drag(0.01, 0.0, -0.05) + 5e-4).abs() < 1e-12);
        assert!((drag(0.0, 0.01, 0.0) + 5e-4).abs() < 1e-12, "a debt stays");
        assert!((observer.energy_j() - 5e-4).abs() < 1e-12, "and the statistic counts all");
    }

    #[test]
    fn a_debt_has_a_bound_and_the_statistic_has_none() {
        let mut observer = Observer::default();
        observer.render(&at(0.0), &push(1.0));
        observer.look(&at(0.5));
        assert_eq!((observer.credit_j(), observer.energy_j()), (-MOST_DEBT_J, -0.5));
        observer.render(&at(0.5), &push(-1.0));
        observer.look(&at(0.5 + 2.0 * MOST_DEBT_J));
        assert!((observer.credit_j() - MOST_DEBT_J).abs() < 1e-12, "what is paid back counts at once");
    }

    #[test]
    fn the_controller_takes_back_what_is_owed_within_its_bound() {
        let none = Wrench::default();
        let moving = ToolMotion { linear_m_s: Vec3::new(0.0, 0.1, 0.0), ..at(0.0) };
        let taken = |force_n: Vec3| -force_n.dot(&moving.linear_m_s) * 1e-3;
        let (damper, is_acting) = control(-1e-5, &none, &moving, 1e-3, 5.0);
        assert!(is_acting && (taken(damper.force_n) - 1e-5).abs() < 1e-15, "{damper:?}");
        // A force that is about to give 3e-5 J where only 1e-5 J are left.
        let giving = Wrench { force_n: Vec3::y() * 0.3, ..none };
        let (damper, _) = control(1e-5, &giving, &moving, 1e-3, 5.0);
        assert!((taken(damper.force_n) - 2e-5).abs() < 1e-15, "{damper:?}");
        let (damper, _) = control(-1.0, &none, &moving, 1e-3, 5.0);
        assert!((damper.force_n - Vec3::new(0.0, -0.5, 0.0)).norm() < 1e-12);
        for (energy, motion, dt) in
            [(1.0, &moving, 1e-3), (-1.0, &at(0.0), 1e-3), (-1.0, &moving, 0.0), (f64::NAN, &moving, 1e-3)]
        {
            assert_eq!(control(energy, &none, motion, dt, 5.0), (none, false));
        }
    }
}
