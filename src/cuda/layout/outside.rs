//! Twins of what acts on nodes from outside: loads, driven regions, tools that hold tissue.

use cudarc::driver::sys::CUdeviceptr;

use crate::math::{Mat3, Pose, Vec3};

/// A node that loads push.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Pushed {
    pub slot: u32,
    pub start: u32,
    pub count: u32,
    pub force: [f64; 3],
    pub mobility: [f64; 3],
}

/// A pressed face.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Pressed {
    pub(super) corners: [u32; 4],
    pub diagonals: [[f64; 3]; 2],
    pub pressure: f64,
}

impl Pressed {
    /// A face between corners that lie `at` rest positions, counter-clockwise seen from outside.
    pub fn of(corners: [u32; 4], at: [Vec3; 4], pressure: f64) -> Self {
        Self { corners, diagonals: [at[2] - at[0], at[3] - at[1]].map(Into::into), pressure }
    }
}

/// All loads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(C)]
pub struct Push {
    pub count: u32,
    pub nodes: CUdeviceptr,
    pub faces: CUdeviceptr,
}

/// A node of a region that is driven.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Driven {
    pub(super) rest: [f64; 3],
    pub(super) slot: u32,
    pub(super) region: u32,
}

impl Driven {
    /// The node in a slot, and its region's place.
    pub fn of(slot: u32, rest: Vec3, region: u32) -> Self {
        Self { rest: rest.into(), slot, region }
    }
}

/// What makes a displacement of a rest position.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Motion {
    pub(super) turn: [f64; 9],
    pub(super) way: [f64; 3],
}

impl Motion {
    /// Of a region at a pose.
    pub fn of(pose: &Pose) -> Self {
        // Rounded after the difference: a small turn stays as precise as it is.
        let turn = pose.rotation.to_rotation_matrix().into_inner() - Mat3::identity();
        Self { turn: std::array::from_fn(|i| turn[(i / 3, i % 3)]), way: pose.translation.vector.into() }
    }
}

/// All regions that are driven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(C)]
pub struct Drive {
    pub count: u32,
    pub regions: u32,
    pub nodes: CUdeviceptr,
    pub motions: CUdeviceptr,
}

/// A node that a tool holds.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Held {
    pub(super) rest: [f64; 3],
    pub(super) place: [f32; 3],
    pub(super) mass: f32,
    pub(super) slot: u32,
}

impl Held {
    /// The node in a slot, and where it is in the tool's frame.
    pub fn of(slot: u32, rest: Vec3, place: Vec3, mass: f64) -> Self {
        Self { rest: rest.into(), place: place.map(|x| x as f32).into(), mass: mass as f32, slot }
    }
}

/// All nodes that tools hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(C)]
pub struct Hold {
    pub count: u32,
    pub substeps: u32,
    pub nodes: CUdeviceptr,
    pub starts: CUdeviceptr,
    pub sums: CUdeviceptr,
}
