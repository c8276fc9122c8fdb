//! A cut surface as renderers and tools take it.

use super::CutSurface;
use super::store::NONE;
use crate::error::Result;
use crate::model::mesh::TriangleMesh;
use crate::model::surface::Surface;

impl CutSurface {
    /// One list of triangles, walls last. Walls have vertices of their own where they share them with the outer surface: a lip is an edge, with a normal and texture coordinates on
    /// either side. These follow all others; those of walls have texture coordinates in m, in cells of edge length `cell_m`.
    pub fn drawn(&self, cell_m: f64) -> Result<Surface> {
        let (mut positions, mut materials, mut rows) =
            (self.positions.clone(), self.materials.clone(), self.rows.clone());
        let (mut uvs, mut triangles) = (self.uvs.clone(), self.triangles.clone());
        let first_wall = triangles.len();
        let mut is_outer = vec![false; positions.len()];
        for &v in triangles.iter().flatten() {
            is_outer[v as usize] = true;
        }
        let mut doubles = vec![NONE; positions.len()];
        triangles.extend(self.walls.iter().map(|wall| {
            wall.map(|v| {
                let original = v as usize;
                let uv = self.wall_uvs[original].map(|x| (f64::from(x) * cell_m) as f32);
                if !is_outer[original] {
                    uvs[original] = uv;
                    return v;
                }
                if doubles[original] == NONE {
                    doubles[original] = positions.len() as u32;
                    positions.push(positions[original]);
                    uvs.push(uv);
                    materials.push(materials[original]);
                    rows.push(rows[original]);
                }
                doubles[original]
            })
        }));
        let surface = Surface::bound(TriangleMesh { positions, triangles, uvs }, rows, materials)?;
        Ok(Surface { first_wall, ..surface })
    }
}
