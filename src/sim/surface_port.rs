//! A renderer's view of one surface.

use std::sync::Arc;

use parking_lot::Mutex;

use super::state::State;
use crate::error::{Error, Result};
use crate::model::Model;
use crate::solver::{SurfaceArrays, SurfaceField};

/// One renderer's view of one surface.
#[derive(Debug)]
pub struct SurfacePort {
    model: Arc<Model>,
    state: Arc<Mutex<Option<State>>>,
    index: usize,
    field: SurfaceField,
    positions: Vec<Float4>,
    previous: Vec<Float4>,
    normals: Vec<Float4>,
    scalars: Vec<f32>,
    time_s: f64,
    has_frame: bool,
}

/// Four floats, aligned as graphics interfaces like them.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(16))]
struct Float4([f32; 4]);

/// One frame of a surface, valid until the port takes the next one. World frame. Arrays are `[vertex_count]`, 16-byte aligned.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceFrame<'a> {
    /// x, y, z in metres and 1.
    pub positions: &'a [[f32; 4]],
    /// Unit normals and 0.
    pub normals: &'a [[f32; 4]],
    /// The positions of the frame that this port took before, for motion vectors; the same as `positions` in the first frame.
    pub previous_positions: &'a [[f32; 4]],
    /// The field chosen with [`SurfacePort::set_field`].
    pub scalars: &'a [f32],
    /// Texture coordinates.
    pub uvs: &'a [[f32; 2]],
    /// Material indices, 1 to 15.
    pub materials: &'a [u8],
    /// Vertex indices `[triangle_count]`.
    pub triangles: &'a [[u32; 3]],
    /// Counts changes of `triangles`; 0 until the first cut.
    pub topology_version: u64,
    /// Simulated time of the frame in seconds.
    pub time_s: f64,
    /// Whether the simulation still existed, and had its device, when this frame was asked for.
    pub is_running: bool,
}

impl SurfacePort {
    pub(super) fn new(model: Arc<Model>, state: Arc<Mutex<Option<State>>>, index: usize) -> Result<Self> {
        let surface = model.surfaces().get(index).ok_or_else(|| {
            Error::argument(format!("surface {index} of {} does not exist", model.surfaces().len()))
        })?;
        let count = surface.positions.len();
        Ok(Self {
            state,
            index,
            field: SurfaceField::default(),
            positions: vec![Float4::default(); count],
            previous: vec![Float4::default(); count],
            normals: vec![Float4::default(); count],
            scalars: vec![0.0; count],
            time_s: 0.0,
            has_frame: false,
            model,
        })
    }

    /// Takes the newest state of the surface. Waits for a step in progress; a step waits for it no longer than the arrays take to
    /// fill. After the simulation, or its GPU, is gone the last frame stays; after a defect of this library on the simulation's own thread there is an error.
    pub fn map(&mut self) -> Result<SurfaceFrame<'_>> {
        let mut state = self.state.lock();
        let sound = state.as_mut().map(|state| state.check().map(|()| state));
        let is_running = match sound {
            Some(Ok(state)) => {
                std::mem::swap(&mut self.positions, &mut self.previous);
                let mut arrays = SurfaceArrays {
                    positions: numbers_mut(&mut self.positions),
                    normals: numbers_mut(&mut self.normals),
                    scalars: &mut self.scalars,
                };
                match state.publish(self.index, self.field, &mut arrays) {
                    Ok(time_s) => self.time_s = time_s,
                    Err(error) => {
                        std::mem::swap(&mut self.positions, &mut self.previous);
                        return Err(error);
                    }
                }
                if !std::mem::replace(&mut self.has_frame, true) {
                    self.previous.copy_from_slice(&self.positions);
                }
                true
            }
            Some(Err(defect @ Error::Defect(_))) => return Err(defect),
            Some(Err(_)) | None => false,
        };
        drop(state);
        Ok(SurfaceFrame { is_running, ..self.last()? })
    }

    /// The frame that was taken last.
    pub fn last(&self) -> Result<SurfaceFrame<'_>> {
        if !self.has_frame {
            return Err(Error::argument(
                "the simulation ended before this surface was mapped for the first time",
            ));
        }
        let surface = &self.model.surfaces()[self.index];
        Ok(SurfaceFrame {
            positions: numbers(&self.positions),
            normals: numbers(&self.normals),
            previous_positions: numbers(&self.previous),
            scalars: &self.scalars,
            uvs: &surface.uvs,
            materials: &surface.materials,
            triangles: &surface.triangles,
            topology_version: 0,
            time_s: self.time_s,
            is_running: false,
        })
    }

    /// Chooses the scalar of later frames.
    pub fn set_field(&mut self, field: SurfaceField) {
        self.field = field;
    }
}

fn numbers(array: &[Float4]) -> &[[f32; 4]] {
    // SAFETY: a transparent view: same size, weaker alignment.
    unsafe { std::slice::from_raw_parts(array.as_ptr().cast(), array.len()) }
}

fn numbers_mut(array: &mut [Float4]) -> &mut [[f32; 4]] {
    // SAFETY: as above, borrowed mutably.
    unsafe { std::slice::from_raw_parts_mut(array.as_mut_ptr().cast(), array.len()) }
}
