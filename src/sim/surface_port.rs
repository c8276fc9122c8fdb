//! A renderer's view of one surface.

use std::sync::Arc;

use parking_lot::Mutex;

use super::state::State;
use crate::cut::surface::room;
use crate::error::{Error, Result};
use crate::model::surface::Surface;
use crate::solver::{SurfaceArrays, SurfaceField};

/// One renderer's view of one surface.
#[derive(Debug)]
pub struct SurfacePort {
    state: Arc<Mutex<Option<State>>>,
    index: usize,
    /// What cuts alone change, as it was shown last.
    triangles: Vec<[u32; 3]>,
    uvs: Vec<[f32; 2]>,
    materials: Vec<u8>,
    first_wall: usize,
    topology_version: u64,
    /// Vertices of the model's own surface, which keep their numbers.
    own: usize,
    /// The first vertices, of which `positions` holds where they were in the last frame.
    kept: usize,
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
    /// Vertex indices `[triangle_count]`. Once tissue is cut some are `[0, 0, 0]`, places for triangles to come; vertices that no triangle names are such places too.
    pub triangles: &'a [[u32; 3]],
    /// The first of the triangles that cuts have laid open: all after it are. Their vertices are theirs alone.
    pub first_wall: usize,
    /// Counts changes of the arrays' lengths, `triangles`, `uvs` and `materials`; 0 until the first cut. What is there stays valid for the frame.
    pub topology_version: u64,
    /// Simulated time of the frame in seconds.
    pub time_s: f64,
    /// Whether the simulation still existed, and had its device, when this frame was asked for.
    pub is_running: bool,
}

impl SurfacePort {
    /// On a surface of a model that may be cut with room for so many copies of nodes.
    pub(super) fn new(
        surfaces: &[Arc<Surface>],
        copies: usize,
        state: Arc<Mutex<Option<State>>>,
        index: usize,
    ) -> Result<Self> {
        let surface = surfaces.get(index).ok_or_else(|| {
            Error::argument(format!("surface {index} of {} does not exist", surfaces.len()))
        })?;
        let (count, room) = (surface.positions.len(), if copies > 0 { room(surface, copies)[0] } else { 0 });
        let numbers = || {
            let mut numbers = Vec::with_capacity(room.max(count));
            numbers.resize(count, Float4::default());
            numbers
        };
        let mut scalars = Vec::with_capacity(room.max(count));
        scalars.resize(count, 0.0);
        Ok(Self {
            state,
            index,
            triangles: surface.triangles.clone(),
            uvs: surface.uvs.clone(),
            materials: surface.materials.clone(),
            first_wall: surface.first_wall,
            topology_version: 0,
            own: count,
            kept: 0,
            field: SurfaceField::default(),
            positions: numbers(),
            previous: numbers(),
            normals: numbers(),
            scalars,
            time_s: 0.0,
            has_frame: false,
        })
    }

    /// Takes another surface. Vertices that cuts have made were where they are now.
    fn show(&mut self, surface: &Surface, version: u64) {
        if self.topology_version == version {
            return;
        }
        self.triangles.clone_from(&surface.triangles);
        self.uvs.clone_from(&surface.uvs);
        self.materials.clone_from(&surface.materials);
        (self.first_wall, self.topology_version) = (surface.first_wall, version);
        let count = surface.positions.len();
        self.kept = self.kept.min(self.own);
        for array in [&mut self.positions, &mut self.previous, &mut self.normals] {
            array.resize(count, Float4::default());
        }
        self.scalars.resize(count, 0.0);
    }

    /// Takes the newest state of the surface. Waits for a step in progress; a step waits for it no longer than the arrays take to
    /// fill. After the simulation, or its GPU, is gone the last frame stays; after a defect of this library on the simulation's own thread there is an error.
    pub fn map(&mut self) -> Result<SurfaceFrame<'_>> {
        let shared = self.state.clone();
        let mut state = shared.lock();
        let sound = state.as_mut().map(|state| state.check().map(|()| state));
        let is_running = match sound {
            Some(Ok(state)) => {
                let (surface, version) = state.surface(self.index);
                self.show(surface, version);
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
                self.previous[self.kept..].copy_from_slice(&self.positions[self.kept..]);
                self.kept = self.positions.len();
                self.has_frame = true;
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
        Ok(SurfaceFrame {
            positions: numbers(&self.positions),
            normals: numbers(&self.normals),
            previous_positions: numbers(&self.previous),
            scalars: &self.scalars,
            uvs: &self.uvs,
            materials: &self.materials,
            triangles: &self.triangles,
            first_wall: self.first_wall,
            topology_version: self.topology_version,
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
