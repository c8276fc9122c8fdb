//! What the host and the kernels share: twins of `kernels/layout.cuh`.

use cudarc::driver::sys::CUdeviceptr;

use crate::model::law::CellLaw;

/// What a cell of one material contributes, SI units.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Law {
    spring: f32,
    volume: f32,
    corner: f32,
    damper: f32,
}

impl Law {
    /// Rounded from double precision.
    pub fn of(law: &CellLaw) -> Self {
        Self {
            spring: law.spring_n_m as f32,
            volume: law.volume_n as f32,
            corner: law.corner_kg as f32,
            damper: (law.spring_n_m * law.damping_s) as f32,
        }
    }
}

/// What is new in each step. Model frame, SI units.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Step {
    pub dt: f32,
    pub keep: f32,
    pub gravity: [f32; 3],
    pub sequence: u32,
}

/// What a substep saw in one brick.
pub const MARK_BYTES: usize = 28;

/// How a step went.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct Report {
    pub diverged_at: u32,
    pub speed2: f32,
    pub strain: f32,
    pub swelling: f32,
    pub shrinking: f32,
    pub displacement2: f32,
    pub vis_viva: f64,
    pub sequence: u32,
}

/// No substep went wrong.
pub const SOUND: u32 = u32::MAX;

/// The fields of one simulation on the device.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Pass {
    pub u: CUdeviceptr,
    pub u_next: CUdeviceptr,
    pub v: CUdeviceptr,
    pub v_next: CUdeviceptr,
    pub neighbours: CUdeviceptr,
    pub flags: CUdeviceptr,
    pub laws: CUdeviceptr,
    pub step: CUdeviceptr,
    pub marks: CUdeviceptr,
    pub diverged_at: CUdeviceptr,
    pub awake: CUdeviceptr,
    pub cell: f32,
    pub substep: u32,
    pub mark: u32,
}
