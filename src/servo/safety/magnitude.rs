//! Limits of a vector's length and of its change. They shorten; they never turn a force or drop one of its components.

use crate::math::{Vec3, all_finite};

/// A square that is less than this share of the limit's is less whatever the rounding.
const ALMOST: f64 = 1.0 - 1e-12;

/// The vector, no longer than `limit`, and whether that made it shorter. What is not finite becomes zero.
#[inline]
pub fn at_most(v: Vec3, limit: f64) -> (Vec3, bool) {
    // Most are short, and a NaN is not.
    if v.norm_squared() < limit * limit * ALMOST {
        return (v, false);
    }
    let share = share_within(v, limit);
    (if share > 0.0 { v * share } else { Vec3::zeros() }, share < 1.0)
}

/// What share of a vector is no longer than `limit`; none of one that is not finite.
#[cold]
fn share_within(v: Vec3, limit: f64) -> f64 {
    if !all_finite(v.as_slice()) {
        return 0.0;
    }
    // The largest component first: a square of 1e200 is not finite, but its direction is known.
    let scale = v.amax();
    if scale <= f64::MIN_POSITIVE {
        return 1.0;
    }
    let length = (v / scale).norm() * scale;
    if length <= limit { 1.0 } else { limit / length }
}

/// Follows a vector no faster than its slew limit.
#[derive(Clone, Debug, Default)]
pub struct Slew {
    last: Vec3,
}

impl Slew {
    /// One step towards `wanted`, of at most `most`, and whether it did not arrive.
    #[inline]
    pub fn step(&mut self, wanted: Vec3, most: f64) -> (Vec3, bool) {
        let (change, is_short) = at_most(wanted - self.last, most);
        self.last = if is_short { self.last + change } else { wanted };
        (self.last, is_short)
    }

    /// Goes to zero at once.
    pub fn drop_to_zero(&mut self) {
        self.last = Vec3::zeros();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clamp_keeps_the_direction() {
        let wanted = Vec3::new(3.0, -4.0, 12.0);
        let (clamped, is_shorter) = at_most(wanted, 3.3);
        assert!(is_shorter && (clamped.norm() - 3.3).abs() < 1e-12);
        assert!(clamped.cross(&wanted).norm() < 1e-12 && clamped.iter().all(|x| *x != 0.0));
        assert_eq!(at_most(wanted, 13.0), (wanted, false));
        assert_eq!(at_most(Vec3::zeros(), 0.0), (Vec3::zeros(), false));
        assert_eq!(at_most(wanted, 0.0), (Vec3::zeros(), true));
    }

    #[test]
    fn huge_forces_are_clamped_and_infinite_ones_dropped() {
        let (clamped, _) = at_most(Vec3::repeat(1e300), 3.0);
        assert!((clamped - Vec3::repeat(3.0_f64.sqrt())).norm() < 1e-12, "{clamped}");
        assert_eq!(at_most(Vec3::new(f64::INFINITY, 0.0, 0.0), 3.0), (Vec3::zeros(), true));
        assert_eq!(at_most(Vec3::new(0.0, f64::NAN, 0.0), 3.0), (Vec3::zeros(), true));
    }

    #[test]
    fn a_slewed_force_arrives_along_a_straight_line() {
        let mut slew = Slew::default();
        let wanted = Vec3::new(3.0, 4.0, 0.0);
        for step in 1..5 {
            let (now, is_short) = slew.step(wanted, 1.0);
            assert!(is_short && (now - wanted * 0.2 * f64::from(step)).norm() < 1e-12);
        }
        assert_eq!(slew.step(wanted, 1.01), (wanted, false));
        assert_eq!(slew.step(wanted, 0.0), (wanted, false), "no time, no change wanted");
        assert_eq!(slew.step(Vec3::zeros(), 0.0), (wanted, true), "no time, no change");
        slew.drop_to_zero();
        assert_eq!(slew.step(Vec3::zeros(), 0.0), (Vec3::zeros(), false));
    }
}
