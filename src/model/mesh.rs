//! A triangle mesh as hosts and files give it.

use crate::error::{Error, Result};
use crate::math::Vec3;

/// Triangles in the world frame, metres, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default)]
pub struct TriangleMesh {
    /// Vertex positions `[vertex_count]`.
    pub positions: Vec<Vec3>,
    /// Vertex indices `[triangle_count]`.
    pub triangles: Vec<[u32; 3]>,
    /// Texture coordinates `[vertex_count]`, or empty.
    pub uvs: Vec<[f32; 2]>,
}

impl TriangleMesh {
    /// Refuses empty meshes, indices out of range, positions that are not finite and wrong lengths.
    pub fn check(&self) -> Result<()> {
        let count = self.positions.len();
        if count == 0 || self.triangles.is_empty() {
            return Err(Error::argument("a mesh needs vertices and triangles"));
        }
        if u32::try_from(count).is_err() {
            return Err(Error::Limit(format!("a mesh of {count} vertices is too large")));
        }
        if let Some(v) = self.positions.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return Err(Error::argument(format!("vertex {v} of the mesh is not finite")));
        }
        if let Some(t) = self.triangles.iter().position(|t| t.iter().any(|&v| v as usize >= count)) {
            return Err(Error::argument(format!(
                "triangle {t} of the mesh names vertex {:?} of {count}",
                self.triangles[t]
            )));
        }
        if !self.uvs.is_empty() && self.uvs.len() != count {
            return Err(Error::argument(format!(
                "{} texture coordinates for {count} vertices",
                self.uvs.len()
            )));
        }
        Ok(())
    }
}
