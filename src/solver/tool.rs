//! Tools: rigid shapes that press tissue, where they are, and what they feel.

use super::blade::Blade;
use crate::error::{Error, Result};
use crate::math::{FAR_M, Pose, Vec3, all_finite};

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
    /// The shapes and their poses in the tool's frame `[1 to 16]`; a blade may do without.
    pub parts: Vec<(Pose, Shape)>,
    /// Coulomb friction coefficient between tool and tissue, 0 to 100.
    pub friction: f64,
    /// The edge that it cuts with; `None` for a tool that presses alone.
    pub blade: Option<Blade>,
}

/// Where a tool is and how it moves. World frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolMotion {
    /// Tool frame to world.
    pub pose: Pose,
    /// Velocity of the tool's origin in m/s. Contact takes the velocity from successive poses; this one is kept with the force.
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
    /// Vertices of the contact surface between which it lies, and the share of each. A point somewhere in a triangle of which no more is known is told as its middle.
    pub vertices: [u32; 3],
    /// They sum to one.
    pub shares: [f64; 3],
}

impl ToolDesc {
    /// A ball-tipped probe.
    pub fn sphere(radius_m: f64) -> Self {
        Self { parts: vec![(Pose::identity(), Shape::Sphere { radius_m })], friction: 0.0, blade: None }
    }

    /// A bare edge: it cuts, and feels nothing but what that takes.
    pub fn blade(blade: Blade) -> Self {
        Self { parts: Vec::new(), friction: 0.0, blade: Some(blade) }
    }

    /// Refuses empty compounds and shapes without a size.
    pub fn check(&self) -> Result<()> {
        if self.parts.is_empty() && self.blade.is_none() || self.parts.len() > MAX_PARTS {
            return Err(Error::argument(format!(
                "a tool has 1 to {MAX_PARTS} parts, not {}",
                self.parts.len()
            )));
        }
        if !(0.0..=MAX_FRICTION).contains(&self.friction) {
            return Err(Error::argument(format!(
                "friction {} is not between 0 and {MAX_FRICTION}",
                self.friction
            )));
        }
        if let Some(blade) = &self.blade {
            blade.check()?;
        }
        self.parts.iter().try_for_each(|(pose, shape)| {
            if !is_near(pose) {
                return Err(Error::argument(format!(
                    "the pose of a tool's part must be finite and within {FAR_M} m of the tool's origin"
                )));
            }
            shape.check()
        })
    }
}

/// Largest friction coefficient: far beyond any pair of materials.
pub const MAX_FRICTION: f64 = 100.0;

/// Most shapes in one tool.
pub const MAX_PARTS: usize = 16;

/// Most strides in which a point's way is looked at.
const MAX_STRIDES: f64 = 64.0;
/// Finest division of a triangle's edge.
const MAX_DIVISION: u32 = 32;

impl ToolMotion {
    /// At rest at a pose.
    #[inline]
    pub fn at(pose: Pose) -> Self {
        Self { pose, linear_m_s: Vec3::zeros(), angular_rad_s: Vec3::zeros() }
    }

    /// Whether all of it is finite and the tool within [`FAR_M`] of the origin. Allocates nothing.
    #[inline]
    pub fn is_valid(&self) -> bool {
        // Not `&&`: a servo loop asks several times in each tick, and has no time to stop early.
        all_finite(self.linear_m_s.as_slice())
            & all_finite(self.angular_rad_s.as_slice())
            & is_near(&self.pose)
    }

    /// Refuses what is not valid, in words.
    pub fn check(&self) -> Result<()> {
        self.is_valid().then_some(()).ok_or_else(|| {
            Error::argument(format!(
                "a tool's pose and velocity must be finite, and the tool within {FAR_M} m of the origin"
            ))
        })
    }
}

impl Shape {
    /// Refuses sizes that no tool has.
    pub(crate) fn check(&self) -> Result<()> {
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

impl Shape {
    /// Signed distance from a point of the shape's frame (negative inside) and the outward unit normal there.
    pub fn distance(&self, p: Vec3) -> (f64, Vec3) {
        match *self {
            Self::Sphere { radius_m } => from_core(p, radius_m),
            Self::Capsule { radius_m, half_length_m } => {
                from_core(p - Vec3::z() * p.z.clamp(-half_length_m, half_length_m), radius_m)
            }
            Self::Box { half_extents_m, rounding_m } => {
                let core = half_extents_m - Vec3::repeat(rounding_m);
                let outside = p - Vec3::from_fn(|a, _| p[a].clamp(-core[a], core[a]));
                if outside != Vec3::zeros() {
                    return from_core(outside, rounding_m);
                }
                // Inside the core: out through the nearest face.
                let depth = half_extents_m - p.abs();
                let axis = depth.imin();
                let side = if p[axis] < 0.0 { -1.0 } else { 1.0 };
                (-depth[axis], Vec3::from_fn(|a, _| if a == axis { side } else { 0.0 }))
            }
        }
    }

    /// Radius of a ball around the shape's origin that contains it.
    pub fn bounding_radius_m(&self) -> f64 {
        match *self {
            Self::Sphere { radius_m } => radius_m,
            Self::Capsule { radius_m, half_length_m } => radius_m + half_length_m,
            Self::Box { half_extents_m, .. } => half_extents_m.norm(),
        }
    }

    /// The size that contact points must resolve: a radius, or half the thickness of a box.
    pub fn feature_m(&self) -> f64 {
        match *self {
            Self::Sphere { radius_m } | Self::Capsule { radius_m, .. } => radius_m,
            Self::Box { half_extents_m, .. } => half_extents_m.min(),
        }
    }

    /// Into how many parts the edges of a triangle with this longest edge at rest, in m, are divided so that contact points resolve the shape: none
    /// is longer than a third of its size, which leaves room for the tissue to stretch. At most 32. In single
    /// precision, so that all backends agree.
    pub fn division(&self, edge: f32) -> u32 {
        (3.0 * edge / self.feature_m() as f32).ceil().clamp(1.0, MAX_DIVISION as f32) as u32
    }
}

/// Distance to a ball of radius `r` around the nearest core point, `d` away from it.
fn from_core(d: Vec3, r: f64) -> (f64, Vec3) {
    let length = d.norm();
    // At the very centre every direction leads out.
    let normal = if length > 0.0 { d / length } else { Vec3::z() };
    (length - r, normal)
}

/// What of a tool is nearest to a point, tool frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Signed distance in m, negative inside.
    pub distance: f64,
    /// Unit normal, outward.
    pub normal: Vec3,
    /// Which of the tool's parts it is.
    pub part: usize,
}

impl ToolDesc {
    /// Signed distance from a point of the tool's frame to the union of its parts; infinite where it has none.
    pub fn distance(&self, p: Vec3) -> Nearest {
        let to_part = |part: usize| {
            let (pose, shape) = &self.parts[part];
            let (distance, normal) = shape.distance(pose.inverse_transform_point(&p.into()).coords);
            Nearest { distance, normal: pose * normal, part }
        };
        let nowhere = Nearest { distance: f64::INFINITY, normal: Vec3::z(), part: 0 };
        (0..self.parts.len())
            .map(to_part)
            .fold(nowhere, |nearest, other| if other.distance < nearest.distance { other } else { nearest })
    }

    /// How a point that comes from `start` and would end at `end`, tool frame, meets the tool: how far its end lies beyond the plane of the part
    /// that it meets first (negative), and that plane's outward normal. The way is looked at in `strides` equal strides, 64 at most; where it
    /// is one or less, at its end alone.
    ///
    /// At the end alone, a point that went past the middle of a thin tool would be pushed out on the wrong side, and one that went
    /// through would be missed.
    pub fn meet(&self, start: Vec3, end: Vec3, strides: f64) -> Option<Nearest> {
        let count = strides.ceil().clamp(1.0, MAX_STRIDES);
        let first = if strides > 1.0 { 0 } else { count as u32 };
        for stride in first..=count as u32 {
            let at = start + (end - start) * (f64::from(stride) / count);
            let met = self.distance(at);
            if met.distance < 0.0 {
                let distance = met.distance + met.normal.dot(&(end - at));
                return (distance < 0.0).then_some(Nearest { distance, ..met });
            }
        }
        None
    }

    /// Radius of a ball around the tool's origin that contains its parts and its edge.
    pub fn reach_m(&self) -> f64 {
        let edge = self.blade.iter().flat_map(|blade| &blade.edge);
        edge.map(Vec3::norm).fold(self.bounding_radius_m(), f64::max)
    }

    /// Radius of a ball around the tool's origin that contains its parts.
    pub fn bounding_radius_m(&self) -> f64 {
        let reach =
            |(pose, shape): &(Pose, Shape)| pose.translation.vector.norm() + shape.bounding_radius_m();
        self.parts.iter().map(reach).fold(0.0, f64::max)
    }

    /// Into how many parts the edges of a triangle with this longest edge at rest, in m, are divided for the parts of the tool that lie within
    /// `reach` of a point, tool frame: bit n − 1 stands for n.
    pub fn divisions(&self, p: Vec3, reach: f64, edge: f32) -> u32 {
        let is_there = |(pose, shape): &&(Pose, Shape)| {
            shape.distance(pose.inverse_transform_point(&p.into()).coords).0 < reach
        };
        let parts = self.parts.iter().filter(is_there);
        parts.fold(0, |all, (_, shape)| all | 1 << (shape.division(edge) - 1))
    }

    /// The smallest size among the parts that contact points must resolve.
    pub fn feature_m(&self) -> f64 {
        self.parts.iter().map(|(_, shape)| shape.feature_m()).fold(f64::INFINITY, f64::min)
    }
}

/// A tool's way during one step, model or world frame alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolPath {
    /// Where it starts.
    pub from: Pose,
    /// Where it ends.
    pub to: Pose,
}

impl ToolPath {
    /// The pose after a fraction `t` in [0, 1] of the step.
    pub fn at(&self, t: f64) -> Pose {
        if t >= 1.0 {
            return self.to;
        }
        // Opposite orientations have no shortest way; the end then comes at once.
        self.from.try_lerp_slerp(&self.to, t, 1e-9).unwrap_or(self.to)
    }

    /// How far a point within `radius` of the origin moves at most.
    pub fn reach(&self, radius: f64) -> f64 {
        (self.to.translation.vector - self.from.translation.vector).norm()
            + radius * self.from.rotation.angle_to(&self.to.rotation)
    }

    /// Velocity of the material point of the tool at `p`, for a step of `duration` seconds.
    pub fn velocity(&self, pose: &Pose, p: Vec3, duration: f64) -> Vec3 {
        let linear = self.to.translation.vector - self.from.translation.vector;
        let turn = (self.to.rotation * self.from.rotation.inverse()).scaled_axis();
        (linear + turn.cross(&(p - pose.translation.vector))) / duration
    }
}

#[inline]
fn is_near(pose: &Pose) -> bool {
    let is_near = pose.translation.vector.iter().fold(true, |all, x| all & (x.abs() <= FAR_M));
    is_near & all_finite(pose.rotation.coords.as_slice())
}
