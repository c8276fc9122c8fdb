//! GPUs, and where a simulation runs.

use std::ffi::c_char;
use std::mem::offset_of;

use super::super::boundary::Output;

/// A simulation runs on the processor, which does all that the library can do.
pub const PLP_BACKEND_CPU: u32 = 0;
/// A simulation runs on an NVIDIA GPU, the lattice in single precision, or is not created.
pub const PLP_BACKEND_CUDA: u32 = 1;
/// A simulation runs on the first NVIDIA GPU that can run it, otherwise on the processor; plp_sim_get_place says why.
/// This is decided once, by plp_sim_create.
pub const PLP_BACKEND_AUTO: u32 = 2;

/// A GPU as its driver describes it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_device_info {
    /// Its name, UTF-8, ended by NUL.
    pub name: [c_char; 128],
    /// Its memory in bytes, in use or not.
    pub memory_bytes: u64,
    /// Its compute capability, the number before the point.
    pub capability_major: u32,
    /// Its compute capability, the number behind the point.
    pub capability_minor: u32,
    /// 1 where simulations can run on it; 0 where its compute capability is too low.
    pub is_supported: u32,
    /// Always 0.
    pub reserved: u32,
}

// SAFETY: repr(C), 128 characters, one 8-byte field, 4-byte fields in pairs.
unsafe impl Output for plp_device_info {
    const NAME: &'static str = "plp_device_info";
    const FIRST_SIZE: usize = offset_of!(Self, reserved) + size_of::<u32>();
}

/// Where a simulation runs.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_place {
    /// PLP_BACKEND_CPU or PLP_BACKEND_CUDA.
    pub backend: u32,
    /// The GPU's number, as for plp_device_get; -1 on the processor.
    pub device: i32,
    /// The GPU's name; on the processor, how many threads compute. UTF-8, ended by NUL.
    pub name: [c_char; 128],
    /// Why PLP_BACKEND_AUTO took the processor: a sentence in UTF-8, ended by NUL. Empty where it did not.
    pub fallback: [c_char; 1024],
}

// SAFETY: repr(C), a pair of 4-byte fields, 128 + 1024 characters.
unsafe impl Output for plp_place {
    const NAME: &'static str = "plp_place";
    const FIRST_SIZE: usize = offset_of!(Self, fallback) + size_of::<[c_char; 1024]>();
}
