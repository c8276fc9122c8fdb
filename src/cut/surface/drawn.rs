//! A cut surface as renderers and tools take it.

use std::collections::HashMap;

use super::CutSurface;
use crate::error::Result;
use crate::model::mesh::TriangleMesh;
use crate::model::surface::Surface;

impl CutSurface {
    /// One list of triangles, walls last. Walls have vertices of their own where they share them with the outer surface: a lip is an edge, with a normal and texture coordinates on
    /// either side. These follow all others; those of walls have texture coordinates in m, in cells of edge length `cell_m`.
    pub fn drawn(self, cell_m: f64) -> Result<Surface> {
        let Self { mut positions, mut triangles, mut walls, mut uvs, wall_uvs, mut materials, mut rows } =
            self;
        let mut is_outer = vec![false; positions.len()];
        for &v in triangles.iter().flatten() {
            is_outer[v as usize] = true;
        }
        let mut doubles: HashMap<u32, u32> = HashMap::new();
        for v in walls.iter_mut().flatten() {
            let original = *v as usize;
            let uv = wall_uvs[original].map(|x| (f64::from(x) * cell_m) as f32);
            if !is_outer[original] {
                uvs[original] = uv;
                continue;
            }
            *v = *doubles.entry(*v).or_insert_with(|| {
                positions.push(positions[original]);
                uvs.push(uv);
                materials.push(materials[original]);
                rows.push(rows[original]);
                positions.len() as u32 - 1
            });
        }
        let first_wall = triangles.len();
        triangles.append(&mut walls);
        let surface = Surface::bound(TriangleMesh { positions, triangles, uvs }, rows, materials)?;
        Ok(Surface { first_wall, ..surface })
    }
}
