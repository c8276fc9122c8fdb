//! The tool: its shape in its own frame, and how it is held along a direction.
//!
//! The tool's frame has its origin at the middle of the tip; the tool presses along local -z and its shaft goes along +z.
//! The shaft is part of the simulated tool: what the pictures show is what touches.

use palpate::math::{Pose, Quat, Vec3};
use palpate::solver::tool::{Shape, ToolDesc};

use super::options::{Options, ToolKind};

/// Length of the shaft behind the tip, in metres.
const SHAFT_M: f64 = 0.05;

/// A tool and what is needed to bring it to a surface.
#[derive(Clone, Debug)]
pub struct Tool {
    /// What the simulation is given.
    pub desc: ToolDesc,
    /// From the origin to the foremost point, in metres.
    pub reach_m: f64,
    /// From the origin to the rear end, in metres.
    pub rear_m: f64,
    /// In words.
    pub name: String,
}

impl Tool {
    /// The tool that the options ask for.
    pub fn new(options: &Options) -> Self {
        let radius_m = options.radius_mm * 1e-3;
        let mm = options.radius_mm;
        let (tip, reach_m, name) = match options.tool {
            ToolKind::Sphere => (Shape::Sphere { radius_m }, radius_m, format!("sphere, radius {mm} mm")),
            ToolKind::Capsule => {
                let tip = Shape::Capsule { radius_m, half_length_m: 0.5 * SHAFT_M };
                (tip, radius_m, format!("capsule, radius {mm} mm"))
            }
            ToolKind::Box => {
                let thickness_m = 0.3 * radius_m;
                let tip = Shape::Box {
                    half_extents_m: Vec3::new(radius_m, radius_m, thickness_m),
                    rounding_m: 0.5 * thickness_m,
                };
                (tip, thickness_m, format!("plate, {0} × {0} mm", 2.0 * mm))
            }
        };

        // The capsule is its own shaft; its frame's origin is the middle of its front cap.
        let half = Pose::translation(0.0, 0.0, 0.5 * SHAFT_M);
        let parts = match options.tool {
            ToolKind::Capsule => vec![(half, tip)],
            ToolKind::Sphere | ToolKind::Box => {
                let shaft = Shape::Capsule { radius_m: 0.3 * radius_m, half_length_m: 0.5 * SHAFT_M };
                vec![(Pose::identity(), tip), (half, shaft)]
            }
        };
        let rear_m = SHAFT_M + if options.tool == ToolKind::Capsule { radius_m } else { 0.3 * radius_m };

        Self { desc: ToolDesc { parts, friction: options.friction, blade: None }, reach_m, rear_m, name }
    }

    /// The pose that presses along the unit vector `direction` with the foremost point at `tip_m`.
    pub fn pose(&self, tip_m: Vec3, direction: Vec3) -> Pose {
        let turn = Quat::rotation_between(&-Vec3::z(), &direction)
            .unwrap_or_else(|| Quat::from_axis_angle(&Vec3::x_axis(), std::f64::consts::PI));
        Pose::from_parts((tip_m - direction * self.reach_m).into(), turn)
    }
}
