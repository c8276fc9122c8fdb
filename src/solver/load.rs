//! Loads that act until they are removed.

use crate::math::{Pose, Vec3};

/// A load on the tissue. World frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Load {
    /// A force at a material point (given by its rest position, inside the tissue), in N.
    Point {
        /// Rest position in metres.
        at_m: Vec3,
        /// Force in N.
        force_n: Vec3,
    },
    /// A force per rest area on the boundary faces of the cells whose centres lie in a box, in Pa. Keeps its direction.
    Traction {
        /// Which boundary faces.
        region: Region,
        /// Force per area in Pa.
        traction_pa: Vec3,
    },
    /// A pressure on those faces, in Pa: pushes against the outward normal and follows the deformed surface.
    Pressure {
        /// Which boundary faces.
        region: Region,
        /// Pressure in Pa; negative pulls.
        pressure_pa: f64,
    },
}

/// Boundary faces (between an occupied and an empty cell) whose rest centre lies in an oriented box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// The box's centre and axes, world frame.
    pub pose: Pose,
    /// Half its edge lengths in metres.
    pub half_extents_m: Vec3,
}
