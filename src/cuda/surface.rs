//! Moves surfaces' vertices with the nodes, on the device.

use std::sync::Arc;

use super::kept::Kept;
use super::kernels::SurfaceKernels;
use super::layout::{self, Pass};
use super::memory::{Buffer, Stream};
use super::pointer;
use crate::cut::surface::drawn::Redrawn;
use crate::cut::surface::room;
use crate::error::Result;
use crate::math::Pose;
use crate::model::Model;
use crate::model::fans::Fans;
use crate::model::surface::{ROW, Surface};
use crate::solver::{SurfaceArrays, SurfaceField};

/// Threads of a block.
const THREADS: u32 = 256;

/// The surfaces of a simulation. Those that were shown lie on the device.
#[derive(Debug)]
pub struct Surfaces {
    model: Arc<Model>,
    copies: usize,
    shown: Vec<Option<SurfaceOnDevice>>,
}

impl Surfaces {
    /// Of a model, with room for what cuts make of them that copy so many nodes.
    pub fn new(model: &Arc<Model>, copies: usize) -> Self {
        Self { model: model.clone(), copies, shown: model.surfaces().iter().map(|_| None).collect() }
    }

    /// Cuts have changed them.
    pub fn follow(&mut self, surfaces: &[(&Surface, &Redrawn)]) -> Result<()> {
        let frame = self.model.frame();
        for (shown, (surface, redrawn)) in self.shown.iter_mut().zip(surfaces) {
            if let Some(shown) = shown {
                shown.follow(surface, redrawn, &frame)?;
            }
        }
        Ok(())
    }

    /// Moves a surface with the nodes of `pass` and fetches its arrays.
    pub fn publish(
        &mut self,
        index: usize,
        surface: &Surface,
        kernels: &SurfaceKernels,
        stream: &Arc<Stream>,
        pass: &Pass,
        field: SurfaceField,
        arrays: &mut SurfaceArrays,
    ) -> Result<()> {
        let shown = &mut self.shown[index];
        if shown.is_none() {
            let room = room_of(&self.model.surfaces()[index], self.copies);
            *shown = Some(SurfaceOnDevice::new(&self.model, surface, room, stream)?);
        }
        let shown = shown.as_ref().expect("the surface was just made");
        shown.publish(kernels, stream, pass, field, arrays)
    }
}

/// Vertices and triangles for which there is room on the device.
pub fn room_of(surface: &Surface, copies: usize) -> [usize; 2] {
    if copies == 0 { [surface.positions.len(), surface.triangles.len()] } else { room(surface, copies) }
}

/// A surface on the device.
#[derive(Debug)]
struct SurfaceOnDevice {
    vertices: u32,
    frame: layout::Frame,
    rest: Kept<[f32; 3]>,
    row_nodes: Kept<[u32; ROW]>,
    row_weights: Kept<[f32; ROW]>,
    triangles: Kept<[u32; 3]>,
    fans: Kept<[u32; 2]>,
    triangle_of: Kept<u32>,
    positions: Buffer<[f32; 4]>,
    normals: Buffer<[f32; 4]>,
    scalars: Buffer<f32>,
}

impl SurfaceOnDevice {
    fn new(
        model: &Model,
        surface: &Surface,
        [vertices, triangles]: [usize; 2],
        stream: &Arc<Stream>,
    ) -> Result<Self> {
        let frame = model.frame();
        let turn = frame.rotation.to_rotation_matrix();
        let mut all = Self {
            vertices: 0,
            frame: layout::Frame {
                turn: std::array::from_fn(|i| turn[(i / 3, i % 3)] as f32),
                cell: model.lattice().cell_m() as f32,
            },
            rest: Kept::of(stream, Vec::new(), vertices)?,
            row_nodes: Kept::of(stream, Vec::new(), vertices)?,
            row_weights: Kept::of(stream, Vec::new(), vertices)?,
            triangles: Kept::of(stream, Vec::new(), triangles)?,
            fans: Kept::of(stream, Vec::new(), vertices)?,
            triangle_of: Kept::of(stream, Vec::new(), Fans::room(3 * triangles))?,
            positions: Buffer::zeros(stream, vertices)?,
            normals: Buffer::zeros(stream, vertices)?,
            scalars: Buffer::zeros(stream, vertices)?,
        };
        all.renew(surface, &frame)?;
        Ok(all)
    }

    /// Copies what changes only by cuts.
    fn renew(&mut self, surface: &Surface, frame: &Pose) -> Result<()> {
        self.vertices = surface.positions.len() as u32;
        let count = surface.positions.len();
        self.rest.set((0..count).map(|v| rest(surface, frame, v)).collect())?;
        self.row_nodes.set(surface.rows.iter().map(|row| row.nodes).collect())?;
        self.row_weights.set(surface.rows.iter().map(|row| row.weights).collect())?;
        self.triangles.set(surface.triangles.clone())?;
        self.fans.set(surface.fans.spans().to_vec())?;
        self.triangle_of.set(surface.fans.lists().to_vec())
    }

    /// Copies what a cut has changed.
    fn follow(&mut self, surface: &Surface, redrawn: &Redrawn, frame: &Pose) -> Result<()> {
        if redrawn.is_all || redrawn.is_tidied {
            return self.renew(surface, frame);
        }
        let count = surface.positions.len();
        let Redrawn { vertices, triangles, fans, .. } = redrawn;
        self.vertices = count as u32;
        self.rest.edit(count, vertices, |v| rest(surface, frame, v))?;
        self.row_nodes.edit(count, vertices, |v| surface.rows[v].nodes)?;
        self.row_weights.edit(count, vertices, |v| surface.rows[v].weights)?;
        self.triangles.edit(surface.triangles.len(), triangles, |t| surface.triangles[t])?;
        self.fans.edit(count, fans, |v| surface.fans.spans()[v])?;
        let lists = surface.fans.lists();
        let spans = fans.iter().map(|&v| surface.fans.spans()[v as usize]);
        let mut places: Vec<u32> = spans.flat_map(|[start, end]| start..end).collect();
        places.sort_unstable();
        self.triangle_of.edit(lists.len(), &places, |at| lists[at])
    }

    fn publish(
        &self,
        kernels: &SurfaceKernels,
        stream: &Stream,
        pass: &Pass,
        field: SurfaceField,
        arrays: &mut SurfaceArrays,
    ) -> Result<()> {
        let mut surface = layout::Surface {
            vertices: self.vertices,
            strain: u32::from(field == SurfaceField::Strain),
            frame: self.frame,
            u: pass.u,
            rest: self.rest.at(),
            row_nodes: self.row_nodes.at(),
            row_weights: self.row_weights.at(),
            triangles: self.triangles.at(),
            fans: self.fans.at(),
            triangle_of: self.triangle_of.at(),
            positions: self.positions.at(),
            normals: self.normals.at(),
            scalars: self.scalars.at(),
        };
        let blocks = self.vertices.div_ceil(THREADS);
        {
            let device = &stream.device;
            let _entered = device.enter()?;
            let arguments = &mut [pointer(&mut surface)];
            // SAFETY: the kernels' argument, as declared, of buffers that outlive the wait below.
            unsafe {
                kernels.surface_positions.launch(device, stream.handle, blocks, THREADS, arguments)?;
                kernels.surface_normals.launch(device, stream.handle, blocks, THREADS, arguments)?;
            }
        }
        self.positions.read(0, arrays.positions)?;
        self.normals.read(0, arrays.normals)?;
        self.scalars.read(0, arrays.scalars)
    }
}

/// Where a vertex is at rest, in the world's frame: rest positions are turned here, displacements there.
fn rest(surface: &Surface, frame: &Pose, vertex: usize) -> [f32; 3] {
    let p = frame.transform_point(&surface.positions[vertex].into());
    [p.x, p.y, p.z].map(|x| x as f32)
}
