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
