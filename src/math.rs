//! The few mathematical types that every part speaks.

use nalgebra as na;

/// A point or vector in metres (or newtons), double precision.
pub type Vec3 = na::Vector3<f64>;
/// A 3 × 3 matrix.
pub type Mat3 = na::Matrix3<f64>;
/// A rotation as a unit quaternion.
pub type Quat = na::UnitQuaternion<f64>;
/// A rigid transform: rotation, then translation in metres.
pub type Pose = na::Isometry3<f64>;
