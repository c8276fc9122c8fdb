//! The few mathematical types that every part speaks.

use nalgebra as na;

/// A point or vector in metres (or newtons), double precision.
pub type Vec3 = na::Vector3<f64>;
/// A 3 × 3 matrix.
pub type Mat3 = na::Matrix3<f64>;
/// Three numbers of translation or force, then three of rotation or torque.
pub type Vec6 = na::Vector6<f64>;
/// A 6 × 6 matrix between two [`Vec6`].
pub type Mat6 = na::Matrix6<f64>;
/// A rotation as a unit quaternion.
pub type Quat = na::UnitQuaternion<f64>;
/// A rigid transform: rotation, then translation in metres.
pub type Pose = na::Isometry3<f64>;

/// Farthest from the world's origin, along each axis, that tissue, a tool or a rigid region may be, in m.
pub const FAR_M: f64 = 1e4;

/// A box along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lowest coordinates.
    pub low: Vec3,
    /// Highest coordinates.
    pub high: Vec3,
}

impl Bounds {
    /// Around nothing.
    pub const EMPTY: Self = Self {
        low: Vec3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        high: Vec3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    /// Around some points.
    pub fn of<'a>(points: impl IntoIterator<Item = &'a Vec3>) -> Self {
        let mut bounds = Self::EMPTY;
        points.into_iter().for_each(|&point| bounds.add(point));
        bounds
    }

    /// Around each segment of a polyline; around the point where there is but one.
    pub fn along(points: &[Vec3]) -> Vec<Self> {
        points.windows(points.len().clamp(1, 2)).map(Self::of).collect()
    }

    /// Around two points, this far beyond them.
    pub fn around(p: Vec3, q: Vec3, reach: f64) -> Self {
        Self { low: p.inf(&q), high: p.sup(&q) }.widened(reach)
    }

    /// Around a point as well. What is not a number adds nothing.
    #[inline]
    pub fn add(&mut self, point: Vec3) {
        for axis in 0..3 {
            let (x, low, high) = (point[axis], &mut self.low[axis], &mut self.high[axis]);
            *low = if x < *low { x } else { *low };
            *high = if x > *high { x } else { *high };
        }
    }

    /// Around both.
    #[inline]
    pub fn union(&self, other: &Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    /// This far beyond it.
    #[inline]
    pub fn widened(&self, reach: f64) -> Self {
        let reach = Vec3::repeat(reach);
        Self { low: self.low - reach, high: self.high + reach }
    }

    /// Around all points of it, wherever `by` moves them.
    #[inline]
    pub fn moved(&self, by: &Self) -> Self {
        Self { low: self.low + by.low, high: self.high + by.high }
    }

    /// Whether they meet, or miss each other by no more than `slack` along each axis.
    #[inline]
    pub fn meets(&self, other: &Self, slack: f64) -> bool {
        (0..3).all(|a| self.low[a] - slack <= other.high[a] && other.low[a] - slack <= self.high[a])
    }

    /// Whether it holds a point.
    #[inline]
    pub fn has(&self, point: &Vec3) -> bool {
        (0..3).all(|a| self.low[a] <= point[a] && point[a] <= self.high[a])
    }

    /// Whether it holds another one, with so much to spare.
    pub fn holds(&self, other: &Self, spare: f64) -> bool {
        (0..3).all(|a| self.low[a] + spare <= other.low[a] && other.high[a] + spare <= self.high[a])
    }

    /// Beyond which of its six sides a point lies, a bit for each. Points that share a side lie apart from the box, and so
    /// does all that is between them.
    pub fn sides(&self, p: Vec3) -> u8 {
        (0..3).fold(0, |sides, a| {
            sides | u8::from(p[a] < self.low[a]) << (2 * a) | u8::from(p[a] > self.high[a]) << (2 * a + 1)
        })
    }
}

/// Whether every number is finite: nothing else is zero when taken no times. Looks at all of them, because that is faster than to stop at the first that is not.
#[inline]
pub fn all_finite(numbers: &[f64]) -> bool {
    numbers.iter().fold(0.0, |sum, x| sum + x * 0.0) == 0.0
}

/// Arithmetic that the laws of [`crate::model::law`] are written in: one number, or one vector register of them.
///
/// `fma(a, b)` is `self * a + b`. Whether it rounds once or twice is the implementor's choice, made once for each backend route.
pub trait Num: Copy {
    /// All lanes hold `x`, rounded.
    fn splat(x: f64) -> Self;
    /// `self + b`.
    fn add(self, b: Self) -> Self;
    /// `self - b`.
    fn sub(self, b: Self) -> Self;
    /// `self * b`.
    fn mul(self, b: Self) -> Self;
    /// `self / b`.
    fn div(self, b: Self) -> Self;
    /// `self * a + b`.
    fn fma(self, a: Self, b: Self) -> Self;
    /// The square root.
    fn sqrt(self) -> Self;
    /// The larger; a NaN in `self` gives `b`.
    fn max(self, b: Self) -> Self;
}

macro_rules! scalar_num {
    ($real:ty) => {
        impl Num for $real {
            #[inline(always)]
            fn splat(x: f64) -> Self {
                x as $real
            }
            #[inline(always)]
            fn add(self, b: Self) -> Self {
                self + b
            }
            #[inline(always)]
            fn sub(self, b: Self) -> Self {
                self - b
            }
            #[inline(always)]
            fn mul(self, b: Self) -> Self {
                self * b
            }
            #[inline(always)]
            fn div(self, b: Self) -> Self {
                self / b
            }
            // Two roundings: without hardware support a fused multiply-add is a slow library call.
            #[inline(always)]
            fn fma(self, a: Self, b: Self) -> Self {
                self * a + b
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                <$real>::sqrt(self)
            }
            #[inline(always)]
            fn max(self, b: Self) -> Self {
                if self > b { self } else { b }
            }
        }
    };
}
scalar_num!(f32);
scalar_num!(f64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_along_a_polyline_hold_its_segments_and_a_single_point() {
        let [a, b, c] = [Vec3::zeros(), Vec3::new(1.0, -2.0, 3.0), Vec3::new(4.0, 0.0, 0.0)];
        assert_eq!(Bounds::along(&[a, b, c]), [[a, b], [b, c]].map(|ends| Bounds::of(&ends)));
        assert_eq!(Bounds::along(&[b]), [Bounds { low: b, high: b }]);
        assert!(Bounds::along(&[]).is_empty());
    }
}
