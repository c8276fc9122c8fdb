//! Moves a surface's vertices with the nodes, on the device.

use std::sync::Arc;

use super::kernels::SurfaceKernels;
use super::layout::{self, Pass};
use super::memory::{Buffer, Stream};
use super::pointer;
use crate::error::Result;
use crate::model::Model;
use crate::model::surface::ROW;
use crate::solver::{SurfaceArrays, SurfaceField};

/// Threads of a block.
const THREADS: u32 = 256;
/// "No cell there" among the corners of a cell.
const NO_CELL: u32 = u32::MAX;

/// A surface of the model on the device.
#[derive(Debug)]
pub struct SurfaceOnDevice {
    vertices: u32,
    frame: layout::Frame,
    rest: Buffer<[f32; 3]>,
    row_nodes: Buffer<[u32; ROW]>,
    row_weights: Buffer<[f32; ROW]>,
    /// The corners of the cell under each vertex.
    cells: Buffer<[u32; 8]>,
    triangles: Buffer<[u32; 3]>,
    triangle_starts: Buffer<u32>,
    triangle_of: Buffer<u32>,
    positions: Buffer<[f32; 4]>,
    normals: Buffer<[f32; 4]>,
    scalars: Buffer<f32>,
}

impl SurfaceOnDevice {
    /// Copies what never changes.
    pub fn new(model: &Arc<Model>, index: usize, stream: &Arc<Stream>) -> Result<Self> {
        let surface = &model.surfaces()[index];
        let (lattice, frame) = (model.lattice(), model.frame());
        let count = surface.positions.len();
        // World frame: rest positions are turned here, displacements there.
        let rest: Vec<[f32; 3]> = surface
            .positions
            .iter()
            .map(|p| frame.transform_point(&(*p).into()).coords)
            .map(|p| [p.x, p.y, p.z].map(|x| x as f32))
            .collect();
        let cells: Vec<[u32; 8]> = surface
            .rows
            .iter()
            .map(|row| {
                // The first node of a row is the lowest corner of its cell.
                let cell = lattice.node_of(row.nodes[0]);
                if lattice.cell_material(cell) == 0 { [NO_CELL; 8] } else { lattice.corners(cell) }
            })
            .collect();
        let rows = surface.rows.iter();
        let turn = frame.rotation.to_rotation_matrix();
        Ok(Self {
            vertices: count as u32,
            frame: layout::Frame {
                turn: std::array::from_fn(|i| turn[(i / 3, i % 3)] as f32),
                cell: lattice.cell_m() as f32,
            },
            rest: Buffer::of(stream, &rest)?,
            row_nodes: Buffer::of(stream, &rows.clone().map(|row| row.nodes).collect::<Vec<_>>())?,
            row_weights: Buffer::of(stream, &rows.map(|row| row.weights).collect::<Vec<_>>())?,
            cells: Buffer::of(stream, &cells)?,
            triangles: Buffer::of(stream, &surface.triangles)?,
            triangle_starts: Buffer::of(stream, &surface.triangle_starts)?,
            triangle_of: Buffer::of(stream, &surface.triangle_of)?,
            positions: Buffer::zeros(stream, count)?,
            normals: Buffer::zeros(stream, count)?,
            scalars: Buffer::zeros(stream, count)?,
        })
    }

    /// Moves the surface with the nodes of `pass` and fetches its arrays.
    pub fn publish(
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
            cells: self.cells.at(),
            triangles: self.triangles.at(),
            triangle_starts: self.triangle_starts.at(),
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
