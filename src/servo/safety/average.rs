//! What motors bear for long.

use crate::math::Vec3;

/// Share of the heat that is allowed, above which the force comes down towards the continuous limit: gradually, so that the hand feels tissue
/// soften and not a switch.
const WARM: f64 = 0.5;

/// Keeps the mean square of a force, or of a torque, within what the motors bear.
///
/// The mean is exponential, with the window as its time constant, like the temperature of a winding. The largest force allowed falls from the
/// device's to the continuous one while the mean rises from half to all of what is allowed, and where it is all, nothing above the
/// continuous limit passes: so the mean never exceeds it.
#[derive(Clone, Debug)]
pub struct Average {
    continuous: f64,
    largest: f64,
    window_s: f64,
    mean_square: f64,
}

impl Average {
    /// Of a force or torque with these limits.
    pub fn new(continuous: f64, largest: f64, window_s: f64) -> Self {
        Self { continuous, largest, window_s, mean_square: 0.0 }
    }

    /// The largest magnitude that may be rendered now.
    #[inline]
    pub fn allowed(&self) -> f64 {
        let limit = self.continuous * self.continuous;
        if limit <= 0.0 {
            return self.largest;
        }
        if self.mean_square <= WARM * limit {
            return self.largest;
        }
        let room = ((1.0 - self.mean_square / limit) / (1.0 - WARM)).max(0.0);
        (limit + (self.largest * self.largest - limit) * room).max(0.0).sqrt()
    }

    /// The root of the mean square.
    pub fn rms(&self) -> f64 {
        self.mean_square.sqrt()
    }

    /// Takes in what was rendered for `dt` seconds.
    #[inline]
    pub fn note(&mut self, rendered: Vec3, dt: f64) {
        // A device without torque has no motors that could get warm.
        if self.largest <= 0.0 {
            return;
        }
        self.mean_square += (rendered.norm_squared() - self.mean_square) * gone(dt / self.window_s);
    }
}

/// Largest share of a window for which the series below is exact to rounding.
const SHORT: f64 = 2e-3;

/// 1 − exp(−x). A tick is short, and gets it from the series, as the exponential would take a good part of it.
#[inline]
fn gone(x: f64) -> f64 {
    if x < SHORT {
        x * (1.0 - x * (1.0 / 2.0 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0)))))
    } else {
        -(-x).exp_m1()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::safety::magnitude::at_most;

    #[test]
    fn a_press_is_let_through_and_comes_down_to_the_continuous_force() {
        let mut average = Average::new(0.88, 3.3, 2.0);
        let (mut last, mut full_s, mut worst) = (3.3, 0.0, 0.0_f64);
        for _ in 0..20_000 {
            let (force, _) = at_most(Vec3::new(0.0, 4.0, 3.0), average.allowed());
            average.note(force, 1e-3);
            full_s += if force.norm() > 3.29 { 1e-3 } else { 0.0 };
            assert!(last - force.norm() < 0.05, "no switch");
            last = force.norm();
            worst = worst.max(average.rms());
        }
        // Half of the allowed heat at full force: 2 s × −ln(1 − 0.5 × 0.88² ÷ 3.3²).
        let expected = -2.0 * (1.0_f64 - 0.5 * (0.88 / 3.3_f64).powi(2)).ln();
        assert!((full_s - expected).abs() < 2e-3, "{full_s} s, not {expected} s");
        assert!((last - 0.88).abs() < 0.01, "{last}");
        assert!(worst <= 0.88 + 1e-9, "{worst}");
    }

    #[test]
    fn what_motors_bear_is_never_lowered() {
        let mut average = Average::new(0.88, 3.3, 2.0);
        for _ in 0..20_000 {
            let (force, is_lowered) = at_most(Vec3::z() * 0.87, average.allowed());
            assert!(!is_lowered);
            average.note(force, 1e-3);
        }
    }

    #[test]
    fn what_is_gone_after_a_tick_is_what_the_exponential_says() {
        for x in (0..60).map(|i| 1e-6 * 1.3_f64.powi(i)) {
            let expected = -(-x).exp_m1();
            assert!((gone(x) / expected - 1.0).abs() < 4.0 * f64::EPSILON, "{x}: {} {expected}", gone(x));
        }
    }

    #[test]
    fn a_rest_gives_the_full_force_back() {
        let mut average = Average::new(0.88, 3.3, 2.0);
        average.note(Vec3::z() * 0.88, 100.0);
        assert!(average.allowed() < 0.89);
        average.note(Vec3::zeros(), 2.0);
        assert!((average.allowed() - 3.3).abs() < 1e-9, "{}", average.allowed());
    }
}
