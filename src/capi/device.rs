//! The GPUs of this machine.

use super::boundary::{boundary, check_output, fill_text, write_output};
use super::status::{PLP_OK, plp_status};
use super::types::plp_device_info;
use crate::cuda::device::{self, DeviceInfo};

/// How many NVIDIA GPUs there are. 0 where there is none, or no driver that works; plp_last_error() then says
/// why. The driver is looked for once in the life of a program, by the first call that needs it.
///
/// @thread any
#[unsafe(no_mangle)]
pub extern "C" fn plp_device_count() -> u32 {
    let mut count = 0;
    boundary(|| {
        count = device::count()?;
        Ok(PLP_OK)
    });
    count
}

/// Describes a GPU by its number, from 0 to plp_device_count() - 1; nothing is taken up on it. Answers
/// PLP_ERR_NO_DEVICE where there is none at all. info_size is sizeof(plp_device_info).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_device_get(
    index: u32,
    info: *mut plp_device_info,
    info_size: u32,
) -> plp_status {
    boundary(|| {
        check_output(info, info_size)?;
        let found = DeviceInfo::of(index)?;
        let found = plp_device_info {
            name: fill_text(&found.name),
            memory_bytes: found.memory_bytes,
            capability_major: found.capability.0,
            capability_minor: found.capability.1,
            is_supported: found.check().is_ok().into(),
            reserved: 0,
        };
        // SAFETY: checked above; the host offers `info_size` bytes.
        unsafe { write_output(info, info_size, &found) };
        Ok(PLP_OK)
    })
}
