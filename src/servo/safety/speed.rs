//! Motion that no hand makes: a lost encoder, a device that was plugged out, a pose of another frame.

use crate::math::Vec3;
use crate::solver::tool::ToolMotion;

/// Watches how fast the device moves, by what it says and by where it is.
#[derive(Clone, Debug)]
pub struct Speed {
    limit_m_s: f64,
    last_m: Option<Vec3>,
}

impl Speed {
    /// With a limit in m/s.
    pub fn new(limit_m_s: f64) -> Self {
        Self { limit_m_s, last_m: None }
    }

    /// Whether the device is too fast, `dt` seconds after the last call. A clock too coarse to see the time between is waited for: the way is
    /// judged when it has moved on.
    pub fn is_over(&mut self, motion: &ToolMotion, dt: f64) -> bool {
        let at = motion.pose.translation.vector;
        let way = self.last_m.map_or(Vec3::zeros(), |last| at - last);
        let has_time = dt > 0.0;
        if has_time || self.last_m.is_none() {
            self.last_m = Some(at);
        }
        let is_within = |way: Vec3, limit: f64| way.norm_squared() <= limit * limit;
        // Written so that a NaN is too fast.
        let is_believed = is_within(motion.linear_m_s, self.limit_m_s)
            && (is_within(way, self.limit_m_s * dt) || !has_time && way.norm_squared().is_finite());
        !is_believed
    }

    /// Forgets where the device was.
    pub fn reset(&mut self) {
        self.last_m = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pose;

    #[test]
    fn both_speeds_are_watched() {
        let at = |x: f64, v: f64| ToolMotion {
            linear_m_s: Vec3::x() * v,
            ..ToolMotion::at(Pose::translation(x, 0.0, 0.0))
        };
        let mut speed = Speed::new(1.0);
        assert!(!speed.is_over(&at(5.0, 0.0), 1e-3), "nothing is known about the first");
        assert!(!speed.is_over(&at(5.0009, 0.9), 1e-3));
        assert!(speed.is_over(&at(5.0009, 1.1), 1e-3), "what the device says");
        assert!(speed.is_over(&at(5.1009, 0.0), 1e-3), "a jump of 10 cm");
        assert!(!speed.is_over(&at(5.1009, 0.0), 1e-3), "the new place is the place");
        assert!(speed.is_over(&at(f64::NAN, 0.0), 1e-3));
        speed.reset();
        assert!(!speed.is_over(&at(0.0, 0.0), 0.0));
        assert!(!speed.is_over(&at(0.0, 0.0), 0.0), "no time and no move");
    }

    #[test]
    fn a_coarse_clock_is_waited_for() {
        let at = |x: f64| ToolMotion::at(Pose::translation(x, 0.0, 0.0));
        for (way, is_over) in [(0.009, false), (0.011, true)] {
            let mut speed = Speed::new(1.0);
            speed.is_over(&at(0.0), 1e-3);
            assert!(!speed.is_over(&at(0.5 * way), 0.0) && !speed.is_over(&at(way), 0.0));
            assert_eq!(speed.is_over(&at(way), 0.01), is_over, "{way} m in 10 ms");
        }
    }
}
