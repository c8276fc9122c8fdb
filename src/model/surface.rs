//! A render surface bound to the nodes of a model: fixed-row weights that move each vertex with the tissue.

use crate::math::Vec3;

/// Nodes in a vertex's row.
pub const ROW: usize = 8;

/// The nodes that carry one surface vertex. Weights sum to one and reproduce the vertex's rest position:
/// Σ wᵢ = 1 and Σ wᵢ Xᵢ = X. Unused entries have weight 0 and repeat the first node.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Node slots (see [`super::lattice::Lattice`]).
    pub nodes: [u32; ROW],
    /// Weights; slightly negative where the vertex lies outside every occupied cell.
    pub weights: [f32; ROW],
}

/// A triangle surface of a model. Positions are in the **model frame** (see [`super::Model::frame`]).
#[derive(Clone, Debug)]
pub struct Surface {
    /// Rest positions `[vertex_count]`, model frame, metres.
    pub positions: Vec<Vec3>,
    /// Vertex indices `[triangle_count]`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Texture coordinates `[vertex_count]`.
    pub uvs: Vec<[f32; 2]>,
    /// Material index of the tissue under each vertex `[vertex_count]`, 1 to 15.
    pub materials: Vec<u8>,
    /// The nodes that move each vertex `[vertex_count]`.
    pub rows: Vec<Row>,
}
