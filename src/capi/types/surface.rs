//! A frame of a surface.

use std::mem::offset_of;

use super::super::boundary::Output;

/// A surface's scalar is the length of the displacement in metres.
pub const PLP_FIELD_DISPLACEMENT: u32 = 0;
/// A surface's scalar is the largest principal strain under the vertex.
pub const PLP_FIELD_STRAIN: u32 = 1;

/// One frame of a surface, world frame. The arrays belong to the library and are valid until
/// plp_surface_unmap; positions, normals and previous positions are aligned to 16 bytes. Vertex streams are
/// float, because renderers take float; poses and forces are double.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_surface_view {
    /// x, y, z in metres and 1 [vertex_count * 4].
    pub positions: *const f32,
    /// Unit normals and 0 [vertex_count * 4].
    pub normals: *const f32,
    /// The positions of the frame that this port mapped before, for motion vectors [vertex_count * 4].
    pub previous_positions: *const f32,
    /// The field chosen with plp_surface_set_field [vertex_count].
    pub scalars: *const f32,
    /// Texture coordinates u, v [vertex_count * 2].
    pub uvs: *const f32,
    /// Materials, from 1 [vertex_count].
    pub materials: *const u8,
    /// Vertex indices, counter-clockwise seen from outside [triangle_count * 3]. Once tissue is cut some triangles are 0, 0, 0: places for others to come.
    pub triangles: *const u32,
    /// Number of vertices.
    pub vertex_count: u64,
    /// Number of triangles.
    pub triangle_count: u64,
    /// Changes whenever anything but positions, normals and scalars does; 0 until the first cut.
    pub topology_version: u64,
    /// Simulated time of the frame in seconds.
    pub time_s: f64,
    /// The first of the triangles that cuts have laid open: all after it are. Their vertices are theirs alone, so that they can have a normal and a texture of their own; texture
    /// coordinates are lengths in metres there. triangle_count where nothing is cut.
    pub first_wall_triangle: u64,
}

// SAFETY: repr(C), pointers and 8-byte numbers.
unsafe impl Output for plp_surface_view {
    const NAME: &'static str = "plp_surface_view";
    const FIRST_SIZE: usize = offset_of!(Self, time_s) + size_of::<f64>();
}
