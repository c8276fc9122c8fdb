//! Surfaces: one renderer's view of the moving tissue.

use std::sync::Arc;

use super::boundary::{boundary, check_out, check_output, write_output};
use super::handle::{self, Handle};
use super::sim::{Link, with_sim};
use super::status::{Fault, PLP_ERR_POISONED, PLP_ERR_STATE, PLP_OK, PLP_STOPPED, plp_status};
use super::types::*;
use crate::error::Error;
use crate::sim::{SurfaceField, SurfaceFrame, SurfacePort};

/// What a `plp_surface` stands for.
#[derive(Debug)]
pub(super) struct SurfaceBody {
    port: SurfacePort,
    link: Arc<Link>,
    /// The host holds pointers into the port's frame: the port must not be touched.
    is_mapped: bool,
}

impl Handle for plp_surface {
    const KIND: u32 = 0x504C_5046;
    const NAME: &'static str = "plp_surface";
    type Body = SurfaceBody;
}

fn check_unmapped(body: &SurfaceBody) -> Result<(), Fault> {
    if body.is_mapped {
        return Err(Fault::new(PLP_ERR_STATE, "the plp_surface is mapped; call plp_surface_unmap first"));
    }
    Ok(())
}

/// Opens a port on a surface of the simulation's model, `index` from 0 to plp_model_info.surface_count - 1.
/// Several ports on one surface are fine. The port is the caller's, to be given to plp_surface_destroy,
/// before or after the simulation.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_surface_create(
    sim: *mut plp_sim,
    index: u32,
    surface: *mut *mut plp_surface,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            check_out(surface, "surface")?;
            let port = body.sim.open_surface(index as usize)?;
            let opened = SurfaceBody { port, link: body.link(), is_mapped: false };
            // SAFETY: checked not to be NULL; the host offers a pointer's room.
            unsafe { surface.write_unaligned(handle::create::<plp_surface>(opened, 0, None)) };
            Ok(PLP_OK)
        })
    })
}

/// Closes a port; a mapped view of it ends. NULL is fine.
///
/// @thread port
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_surface_destroy(surface: *mut plp_surface) -> plp_status {
    boundary(|| {
        drop(handle::destroy(surface).map_err(handle::fault::<plp_surface>)?);
        Ok(PLP_OK)
    })
}

/// Chooses the scalar of later frames: PLP_FIELD_DISPLACEMENT (at first) or PLP_FIELD_STRAIN. Not while
/// mapped.
///
/// @thread port
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_surface_set_field(surface: *mut plp_surface, field: u32) -> plp_status {
    boundary(|| {
        let mut body = handle::hold(surface).map_err(handle::fault::<plp_surface>)?;
        check_unmapped(&body)?;
        let field = match field {
            PLP_FIELD_DISPLACEMENT => SurfaceField::Displacement,
            PLP_FIELD_STRAIN => SurfaceField::Strain,
            other => return Err(Fault::argument(format!("field {other} is no PLP_FIELD_ value"))),
        };
        body.port.set_field(field);
        Ok(PLP_OK)
    })
}

/// Takes the newest frame of the surface. Waits for a step or settling in progress; a step that comes
/// meanwhile waits until the arrays are filled, not until they are unmapped. The view's arrays are valid, and
/// do not change, until plp_surface_unmap. When the simulation, or its GPU, is gone it answers PLP_STOPPED with the last frame, or
/// PLP_ERR_STATE where there never was one. After a defect of the library it answers PLP_ERR_POISONED. view_size is sizeof(plp_surface_view).
///
/// @thread port
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_surface_map(
    surface: *mut plp_surface,
    view: *mut plp_surface_view,
    view_size: u32,
) -> plp_status {
    boundary(|| {
        let mut body = handle::hold(surface).map_err(handle::fault::<plp_surface>)?;
        check_output(view, view_size)?;
        check_unmapped(&body)?;
        if body.link.is_poisoned() {
            return Err(Fault::new(PLP_ERR_POISONED, "an earlier call broke the simulation of this surface"));
        }
        let frame = body.port.map().map_err(|error| match error {
            Error::Argument(_) => Fault::new(PLP_ERR_STATE, error.to_string()),
            other => other.into(),
        })?;
        let (frame, is_running) = (view_of(&frame), frame.is_running);
        body.is_mapped = true;
        // SAFETY: checked above; the host offers `view_size` bytes.
        unsafe { write_output(view, view_size, &frame) };
        Ok(if is_running { PLP_OK } else { PLP_STOPPED })
    })
}

/// Ends the view of plp_surface_map: its arrays must not be read any more.
///
/// @thread port
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_surface_unmap(surface: *mut plp_surface) -> plp_status {
    boundary(|| {
        let mut body = handle::hold(surface).map_err(handle::fault::<plp_surface>)?;
        if !body.is_mapped {
            return Err(Fault::new(PLP_ERR_STATE, "the plp_surface is not mapped"));
        }
        body.is_mapped = false;
        Ok(PLP_OK)
    })
}

fn view_of(frame: &SurfaceFrame<'_>) -> plp_surface_view {
    plp_surface_view {
        positions: frame.positions.as_ptr().cast(),
        normals: frame.normals.as_ptr().cast(),
        previous_positions: frame.previous_positions.as_ptr().cast(),
        scalars: frame.scalars.as_ptr(),
        uvs: frame.uvs.as_ptr().cast(),
        materials: frame.materials.as_ptr(),
        triangles: frame.triangles.as_ptr().cast(),
        vertex_count: frame.positions.len() as u64,
        triangle_count: frame.triangles.len() as u64,
        topology_version: frame.topology_version,
        time_s: frame.time_s,
        first_wall_triangle: frame.first_wall as u64,
    }
}
