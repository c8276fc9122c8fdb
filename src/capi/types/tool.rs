//! What a tool is, where it is, and what it feels.

use std::mem::offset_of;

use super::super::boundary::Desc;
use super::{plp_blade, plp_haptic_desc, plp_pose};

/// A ball of radius_m.
pub const PLP_SHAPE_SPHERE: u32 = 0;
/// A ball of radius_m swept along local z, over half_length_m both ways.
pub const PLP_SHAPE_CAPSULE: u32 = 1;
/// A box of half_extents_m whose edges are rounded by radius_m.
pub const PLP_SHAPE_BOX: u32 = 2;

/// A shape of a tool. Sizes lie between 1e-5 m and 1 m.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_tool_part {
    /// PLP_SHAPE_SPHERE, PLP_SHAPE_CAPSULE or PLP_SHAPE_BOX.
    pub kind: u32,
    /// Must be 0.
    pub reserved: u32,
    /// The shape's place in the tool's frame.
    pub pose: plp_pose,
    /// SPHERE, CAPSULE: the radius in metres. BOX: the radius of its edges, above 0 and at most the smallest
    /// half extent.
    pub radius_m: f64,
    /// CAPSULE: half the length of the swept segment in metres, caps not counted.
    pub half_length_m: f64,
    /// BOX: half the edge lengths in metres, rounding included.
    pub half_extents_m: [f64; 3],
}

/// A tool: a rigid compound of shapes. Fill it with plp_tool_desc_init (or plp_tool_desc_default), then give
/// it parts.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_tool_desc {
    /// The size of this struct as the caller knows it.
    pub struct_size: u32,
    /// Number of parts, 1 to 16; a blade may do without.
    pub part_count: u32,
    /// The shapes [part_count].
    pub parts: *const plp_tool_part,
    /// Coulomb friction coefficient between tool and tissue, 0 to 100 (default 0).
    pub friction: f64,
    /// The haptic device that holds the tool, for plp_tool_exchange; NULL (default) where none does. @nullable
    pub haptic: *const plp_haptic_desc,
    /// The edge that the tool cuts with; NULL (default) for one that presses alone. With a blade part_count may be 0. The simulation needs plp_sim_desc.cut_nodes. @nullable
    pub blade: *const plp_blade,
}

// SAFETY: repr(C), two integers, raw pointers, a double.
unsafe impl Desc for plp_tool_desc {
    const NAME: &'static str = "plp_tool_desc";
    const FIRST_SIZE: usize = offset_of!(Self, haptic) + size_of::<*const plp_haptic_desc>();
    fn with_defaults() -> Self {
        Self {
            struct_size: size_of::<Self>() as u32,
            part_count: 0,
            parts: std::ptr::null(),
            friction: 0.0,
            haptic: std::ptr::null(),
            blade: std::ptr::null(),
        }
    }
}

/// Where a tool is and how it moves.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_motion {
    /// The tool's pose.
    pub pose: plp_pose,
    /// Velocity of the tool's origin in m/s, world frame. Contact takes the velocity from successive poses; this
    /// one and the next are kept with the force.
    pub linear_m_s: [f64; 3],
    /// Angular velocity in rad/s, world frame.
    pub angular_rad_s: [f64; 3],
}

/// What a tool feels: the tissue's reaction, averaged over the last step.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_force {
    /// Force of the tissue on the tool in N, world frame.
    pub force_n: [f64; 3],
    /// Torque of the tissue on the tool about the tool's origin in N m, world frame.
    pub torque_n_m: [f64; 3],
    /// The motion that both were computed at.
    pub motion: plp_motion,
    /// Simulated time at the end of that step in seconds.
    pub time_s: f64,
    /// Counts steps; 0 before the first one and after plp_sim_reset.
    pub sequence: u64,
}

/// A touched point of the tissue's surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_contact {
    /// Where, world frame, metres.
    pub point_m: [f64; 3],
    /// Unit normal of the tool there, pointing into the tissue.
    pub normal: [f64; 3],
    /// How deep the point would have been inside the tool without contact, in metres.
    pub depth_m: f64,
    /// Force on the tissue at this point in N.
    pub force_n: [f64; 3],
    /// Material of the tissue, from 1.
    pub material: u32,
    /// Always 0.
    pub reserved: u32,
}
