//! The block and its ball through the C interface, as a host in C has them.

use std::ptr::{null, null_mut};

use palpate::capi::drive::plp_sim_start;
use palpate::capi::model::{plp_model_create, plp_model_desc_init, plp_model_destroy};
use palpate::capi::sim::{plp_sim_create, plp_sim_desc_init, plp_sim_destroy};
use palpate::capi::status::{PLP_OK, plp_status};
use palpate::capi::tool::{
    plp_haptic_desc_init, plp_tool_create, plp_tool_desc_init, plp_tool_destroy, plp_tool_exchange,
};
use palpate::capi::types::*;
use palpate::error::{Error, Result};
use palpate::servo::DeviceState;

use super::block::{CELL_M, CELLS, DENSITY_KG_M3, FRICTION, POISSON, RADIUS_M, RELAXATION_S, YOUNG_PA};
use super::common::place::{Backend, Machine};

/// A simulation with one tool.
pub struct CTool {
    model: *mut plp_model,
    sim: *mut plp_sim,
    tool: *mut plp_tool,
}

/// The tool, for its servo thread. Lives no longer than the [`CTool`] that it came from.
pub struct ServoEnd {
    tool: *mut plp_tool,
    servo: plp_servo,
}

// SAFETY: the interface lets any one thread be a tool's servo thread.
unsafe impl Send for ServoEnd {}

/// A desc with its defaults.
fn desc_of<T>(init: unsafe extern "C" fn(*mut T, u32) -> plp_status) -> Result<T> {
    let mut desc = std::mem::MaybeUninit::<T>::zeroed();
    // SAFETY: there is room for as many bytes as are named.
    let status = unsafe { init(desc.as_mut_ptr(), size_of::<T>() as u32) };
    must(status, "a desc")?;
    // SAFETY: the function has filled it.
    Ok(unsafe { desc.assume_init() })
}

fn must(status: plp_status, what: &str) -> Result<()> {
    if status == PLP_OK { Ok(()) } else { Err(Error::argument(format!("{what} was answered with {status}"))) }
}

impl CTool {
    /// The same as [`super::block`] makes in Rust.
    pub fn new(machine: &Machine, is_direct: bool) -> Result<Self> {
        let labels = vec![1_u8; CELLS.iter().product()];
        let middle = 0.5 * CELL_M;
        let grid = plp_label_grid {
            labels: labels.as_ptr().cast(),
            label_bytes: 1,
            voxels: CELLS.map(|n| n as u32),
            spacing_m: [CELL_M; 3],
            frame: plp_pose { position_m: [middle; 3], rotation: [0.0, 0.0, 0.0, 1.0] },
            index_to_world: null(),
        };
        let material = plp_material {
            young_pa: YOUNG_PA,
            poisson: POISSON,
            density_kg_m3: DENSITY_KG_M3,
            damping_s: RELAXATION_S,
            name: [0; 64],
        };
        let uses = plp_label_use { label: 1, kind: PLP_USE_TISSUE, material };
        let mut model_desc = desc_of(plp_model_desc_init)?;
        model_desc.grid = &raw const grid;
        model_desc.uses = &raw const uses;
        model_desc.use_count = 1;
        model_desc.fix_faces = PLP_FACE_Z_LOW;

        let mut sim_desc = desc_of(plp_sim_desc_init)?;
        sim_desc.backend = match machine.backend {
            Backend::Cpu => PLP_BACKEND_CPU,
            Backend::Cuda => PLP_BACKEND_CUDA,
        };
        sim_desc.threads = machine.threads as u32;

        let mut haptic = desc_of(plp_haptic_desc_init)?;
        haptic.coupling = if is_direct { PLP_COUPLING_DIRECT } else { PLP_COUPLING_VIRTUAL };
        let part = plp_tool_part {
            kind: PLP_SHAPE_SPHERE,
            reserved: 0,
            pose: plp_pose { position_m: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] },
            radius_m: RADIUS_M,
            half_length_m: 0.0,
            half_extents_m: [0.0; 3],
        };
        let mut tool_desc = desc_of(plp_tool_desc_init)?;
        tool_desc.parts = &raw const part;
        tool_desc.part_count = 1;
        tool_desc.friction = FRICTION;
        tool_desc.haptic = &raw const haptic;

        let mut made = Self { model: null_mut(), sim: null_mut(), tool: null_mut() };
        // SAFETY: descs and what they point to live until the calls return, and there is room for the handles.
        unsafe {
            must(plp_model_create(&raw const model_desc, &raw mut made.model), "a model")?;
            must(plp_sim_create(made.model, &raw const sim_desc, &raw mut made.sim), "a simulation")?;
            must(plp_tool_create(made.sim, &raw const tool_desc, &raw mut made.tool), "a tool")?;
        }
        Ok(made)
    }

    /// Has the simulation step on its own thread.
    pub fn start(&mut self) -> Result<()> {
        // SAFETY: the handle is this one's, and defaults are asked for.
        must(unsafe { plp_sim_start(self.sim, null()) }, "a thread")
    }

    /// The tool for its servo thread.
    pub fn servo_end(&self) -> ServoEnd {
        // SAFETY: plain numbers.
        ServoEnd { tool: self.tool, servo: unsafe { std::mem::zeroed() } }
    }
}

impl ServoEnd {
    /// One tick, as a host in C makes it from what its device says.
    pub fn exchange(&mut self, device: &DeviceState) -> Option<&plp_servo> {
        let at = &device.motion;
        let state = plp_haptic_state {
            motion: plp_motion {
                pose: plp_pose {
                    position_m: at.pose.translation.vector.into(),
                    rotation: at.pose.rotation.coords.into(),
                },
                linear_m_s: at.linear_m_s.into(),
                angular_rad_s: at.angular_rad_s.into(),
            },
            stamp_s: device.stamp_s,
            flags: if device.is_held { 0 } else { PLP_HAPTIC_RELEASED },
            buttons: 0,
        };
        // SAFETY: the handle is one, and both structs are this thread's.
        let status = unsafe { plp_tool_exchange(self.tool, &raw const state, &raw mut self.servo) };
        (status == PLP_OK).then_some(&self.servo)
    }
}

impl Drop for CTool {
    fn drop(&mut self) {
        // SAFETY: the handles are this one's; NULL is fine.
        unsafe {
            plp_tool_destroy(self.tool);
            plp_sim_destroy(self.sim);
            plp_model_destroy(self.model);
        }
    }
}
