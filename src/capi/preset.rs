//! Material presets and their sources.

use std::ffi::c_char;

use super::boundary::{boundary, check_output, fill_text, read_str, write_output};
use super::status::{Fault, PLP_OK, plp_status};
use super::types::{plp_material, plp_preset};
use crate::model::material::{PRESETS, Preset};

/// How many material presets there are.
///
/// @thread any
#[unsafe(no_mangle)]
pub extern "C" fn plp_preset_count() -> u32 {
    PRESETS.len() as u32
}

/// A preset by its number, from 0 to plp_preset_count() - 1. preset_size is sizeof(plp_preset).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_preset_get(index: u32, preset: *mut plp_preset, preset_size: u32) -> plp_status {
    boundary(|| {
        check_output(preset, preset_size)?;
        let found = PRESETS.get(index as usize).ok_or_else(|| {
            Fault::argument(format!("preset {index} does not exist: there are {}", PRESETS.len()))
        })?;
        // SAFETY: checked above; the host offers `preset_size` bytes.
        unsafe { write_output(preset, preset_size, &preset_out(found)) };
        Ok(PLP_OK)
    })
}

/// A preset by its name, such as "lung" or "liver". preset_size is sizeof(plp_preset).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_preset_find(
    name: *const c_char,
    preset: *mut plp_preset,
    preset_size: u32,
) -> plp_status {
    boundary(|| {
        // SAFETY: the host passes NULL or a string that ends in NUL.
        let name = unsafe { read_str(name, "name") }?;
        check_output(preset, preset_size)?;
        let found = PRESETS.iter().find(|preset| preset.name == name).ok_or_else(|| {
            let names: Vec<_> = PRESETS.iter().map(|preset| preset.name).collect();
            Fault::argument(format!("there is no preset '{name}'; there are {}", names.join(", ")))
        })?;
        // SAFETY: checked above; the host offers `preset_size` bytes.
        unsafe { write_output(preset, preset_size, &preset_out(found)) };
        Ok(PLP_OK)
    })
}

fn preset_out(preset: &Preset) -> plp_preset {
    let material = plp_material {
        young_pa: preset.young_pa,
        poisson: preset.poisson,
        density_kg_m3: preset.density_kg_m3,
        damping_s: preset.damping_s,
        name: fill_text(preset.name),
    };
    plp_preset { material, source: fill_text(preset.source) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_sources_fit_their_arrays() {
        for preset in PRESETS {
            assert!(preset.name.len() < 64 && preset.source.len() < 512, "{}", preset.name);
        }
    }
}
