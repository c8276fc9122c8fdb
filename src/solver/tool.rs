//! Tools: rigid shapes that press tissue, where they are, and what they feel.

use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};

/// A convex primitive, centred at the origin of its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Radius in metres.
        radius_m: f64,
    },
    /// A ball swept along the local z axis.
    Capsule {
        /// Radius in metres.
        radius_m: f64,
        /// Half the length of the swept segment (caps not counted), in metres.
        half_length_m: f64,
    },
    /// A box with rounded edges.
    Box {
        /// Half the edge lengths along local x, y, z, rounding included, in metres.
        half_extents_m: Vec3,
        /// Radius of the rounded edges, above 0 and at most the smallest half extent.
        rounding_m: f64,
    },
}

/// A rigid compound of shapes.
#[derive(Clone, Debug, PartialEq)]
pub struct ToolDesc {
    /// The shapes and their poses in the tool's frame `[1 to 16]`.
    pub parts: Vec<(Pose, Shape)>,
    /// Coulomb friction coefficient between tool and tissue, at least 0.
    pub friction: f64,
}

/// Where a tool is and how it moves. World frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolMotion {
    /// Tool frame to world.
    pub pose: Pose,
    /// Velocity of the tool's origin in m/s.
    pub linear_m_s: Vec3,
    /// Angular velocity in rad/s.
    pub angular_rad_s: Vec3,
}

/// A force and a torque.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Force in N.
    pub force_n: Vec3,
    /// Torque about the tool's origin in N m.
    pub torque_n_m: Vec3,
}

/// What a tool feels: the tissue's reaction averaged over the last step. World frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolForce {
    /// Force and torque that the tissue exerts **on the tool**; the torque is about the tool's origin.
    pub wrench: Wrench,
    /// The motion that the wrench was computed at.
    pub motion: ToolMotion,
    /// Simulated time at the end of that step, in seconds.
    pub time_s: f64,
    /// Counts steps; 0 before the first one.
    pub sequence: u64,
}

/// One touched surface point of the last substep. World frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Where the tissue's surface is touched.
    pub point_m: Vec3,
    /// Unit normal of the tool there, pointing from the tool into the tissue.
    pub normal: Vec3,
    /// How deep the point would have been inside the tool without contact, in metres.
    pub depth_m: f64,
    /// Force on the tissue at this point in N.
    pub force_n: Vec3,
    /// Material index of the tissue, 1 to 15.
    pub material: u8,
}

impl ToolDesc {
    /// A ball-tipped probe.
    pub fn sphere(radius_m: f64) -> Self {
        Self { parts: vec![(Pose::identity(), Shape::Sphere { radius_m })], friction: 0.0 }
    }

    /// Refuses empty compounds and shapes without a size.
    pub fn check(&self) -> Result<()> {
        if self.parts.is_empty() || self.parts.len() > MAX_PARTS {
            return Err(Error::argument(format!(
                "a tool has 1 to {MAX_PARTS} parts, not {}",
                self.parts.len()
            )));
        }
        if !(self.friction.is_finite() && self.friction >= 0.0) {
            return Err(Error::argument(format!("friction {} is not a number of at least 0", self.friction)));
        }
        self.parts.iter().try_for_each(|(pose, shape)| {
            if !finite(pose) {
                return Err(Error::argument("the pose of a tool's part must be finite"));
            }
            shape.check()
        })
    }
}

/// Most shapes in one tool.
pub const MAX_PARTS: usize = 16;

impl ToolMotion {
    /// At rest at a pose.
    pub fn at(pose: Pose) -> Self {
        Self { pose, linear_m_s: Vec3::zeros(), angular_rad_s: Vec3::zeros() }
    }

    /// Refuses anything that is not finite.
    pub fn check(&self) -> Result<()> {
        let vectors = self.linear_m_s.iter().chain(self.angular_rad_s.iter()).all(|x| x.is_finite());
        if !vectors || !finite(&self.pose) {
            return Err(Error::argument("a tool's pose and velocity must be finite"));
        }
        Ok(())
    }
}

impl Shape {
    fn check(&self) -> Result<()> {
        let size = |x: f64| (1e-5..=1.0).contains(&x);
        let good = match *self {
            Self::Sphere { radius_m } => size(radius_m),
            Self::Capsule { radius_m, half_length_m } => {
                size(radius_m) && (0.0..=1.0).contains(&half_length_m)
            }
            Self::Box { half_extents_m, rounding_m } => {
                half_extents_m.iter().all(|&x| size(x))
                    && size(rounding_m)
                    && rounding_m <= half_extents_m.min()
            }
        };
        good.then_some(()).ok_or_else(|| {
            Error::argument(format!(
                "{self:?}: sizes must lie between 1e-5 m and 1 m, a rounding within its box"
            ))
        })
    }
}

fn finite(pose: &Pose) -> bool {
    pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite())
}
