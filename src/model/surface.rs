//! A render surface bound to the nodes of a model: fixed-row weights that move each vertex with the tissue.

use super::binding::{CellSpace, bind};
use super::extract;
use super::fans::Fans;
use super::lattice::Lattice;
use super::mesh::TriangleMesh;
use crate::error::{Error, Result};
use crate::math::Vec3;

/// Nodes in a vertex's row.
pub const ROW: usize = 8;

/// Twice the area in m² below which a vertex's triangles count as having no direction.
const NO_AREA_M2: f64 = 1e-30;

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
    /// Vertex indices `[triangle_count]`, counter-clockwise seen from outside. A host's mesh keeps all its
    /// triangles, those without area too.
    pub triangles: Vec<[u32; 3]>,
    /// The first of the triangles that cuts have laid open, all after it being so too; their number where nothing is cut. Their vertices are theirs alone.
    pub first_wall: usize,
    /// Texture coordinates `[vertex_count]`.
    pub uvs: Vec<[f32; 2]>,
    /// Material index of the tissue under each vertex `[vertex_count]`, 1 to 15.
    pub materials: Vec<u8>,
    /// The nodes that move each vertex `[vertex_count]`.
    pub rows: Vec<Row>,
    /// The triangles at each vertex, ascending: normals are gathered over them, in this order.
    pub fans: Fans,
}

/// Gives a list room for so many in all.
pub fn grow<T>(list: &mut Vec<T>, room: usize) {
    list.reserve_exact(room.saturating_sub(list.len()));
}

/// Lengths of a surface's triangles at rest, in m.
#[derive(Clone, Debug)]
pub struct Edges {
    /// The longest edge of each triangle `[triangle_count]`.
    pub of_triangles: Vec<f32>,
    /// The least of those around each vertex `[vertex_count]`; infinite where there is no triangle.
    pub of_vertices: Vec<f32>,
}

impl Edges {
    /// Takes over what has changed of a surface: `triangles` have other corners, or corners elsewhere, and `vertices` have other triangles around them. Gives the
    /// vertices at which lengths may have changed, ascending.
    pub fn follow(&mut self, surface: &Surface, triangles: &[u32], vertices: &[u32]) -> Vec<u32> {
        self.of_triangles.resize(surface.triangles.len(), 0.0);
        self.of_vertices.resize(surface.positions.len(), f32::INFINITY);
        for &t in triangles {
            self.of_triangles[t as usize] = surface.longest_edge(&surface.triangles[t as usize]);
        }
        let corners = triangles.iter().flat_map(|&t| surface.triangles[t as usize]);
        let mut around: Vec<u32> = corners.chain(vertices.iter().copied()).collect();
        around.sort_unstable();
        around.dedup();
        for &vertex in &around {
            self.of_vertices[vertex as usize] = self.around(surface, vertex as usize);
        }
        around
    }

    /// The least of the longest edges of the triangles at a vertex.
    fn around(&self, surface: &Surface, vertex: usize) -> f32 {
        let lengths =
            surface.triangles_at(vertex).iter().map(|&triangle| self.of_triangles[triangle as usize]);
        lengths.fold(f32::INFINITY, f32::min)
    }
}

impl Surface {
    /// The same with room for so many vertices and triangles, so that what is added moves nothing.
    pub fn with_room(&self, [vertices, triangles]: [usize; 2]) -> Self {
        let mut surface = self.clone();
        grow(&mut surface.positions, vertices);
        grow(&mut surface.uvs, vertices);
        grow(&mut surface.materials, vertices);
        grow(&mut surface.rows, vertices);
        grow(&mut surface.triangles, triangles);
        surface.fans.reserve(vertices, triangles);
        surface
    }

    /// Binds a mesh to the tissue. The mesh is in the **model frame**; its texture coordinates are kept, or
    /// made by [`mirrored_cylinder`] when it has none.
    ///
    /// Fails when the mesh is not sound (see [`TriangleMesh::check`]) or a vertex lies more than
    /// [`HOST_REACH_CELLS`](super::binding::HOST_REACH_CELLS) cells from all tissue.
    pub fn from_mesh(mesh: TriangleMesh, lattice: &Lattice) -> Result<Self> {
        Self::from_preferred_cells(mesh, lattice, |_| true)
    }

    /// The smoothed boundary of all cells whose label is in a set, bound to the tissue.
    ///
    /// `labels` are those of the lattice's cells `[cells.x × cells.y × cells.z]`, x fastest. Vertices hang on
    /// cells of the set, so that an organ's surface moves with the organ and not with what lies against it;
    /// where the set is empty space, such as an airway's lumen, they hang on the nearest tissue.
    pub fn from_labels(labels: &[u16], is_in_set: impl Fn(u16) -> bool, lattice: &Lattice) -> Result<Self> {
        Self::from_cells(labels, is_in_set, lattice)
    }

    fn from_cells<S: CellSpace>(labels: &[u16], is_in_set: impl Fn(u16) -> bool, space: &S) -> Result<Self> {
        let cells = space.cells();
        if labels.len() != cells.iter().product::<usize>() {
            return Err(Error::argument(format!("{} labels for a lattice of {cells:?} cells", labels.len())));
        }
        let inside = |[i, j, k]: [usize; 3]| is_in_set(labels[i + cells[0] * (j + cells[1] * k)]);
        let mesh = extract::boundary(cells, space.cell_m(), inside)?;
        Self::from_preferred_cells(mesh, space, inside)
    }

    fn from_preferred_cells<S: CellSpace>(
        mesh: TriangleMesh,
        space: &S,
        is_preferred: impl Fn([usize; 3]) -> bool,
    ) -> Result<Self> {
        mesh.check()?;
        let (rows, materials) = bind(&mesh.positions, space, is_preferred)?;
        Self::bound(mesh, rows, materials)
    }

    /// A sound mesh with the rows and materials of its vertices.
    pub(crate) fn bound(mesh: TriangleMesh, rows: Vec<Row>, materials: Vec<u8>) -> Result<Self> {
        let count = mesh.positions.len();
        if rows.len() != count || materials.len() != count {
            return Err(Error::argument(format!(
                "{} rows and {} materials for {count} vertices",
                rows.len(),
                materials.len()
            )));
        }
        let fans = Fans::new(count, &mesh.triangles)?;
        let TriangleMesh { positions, triangles, mut uvs } = mesh;
        if uvs.is_empty() {
            uvs = mirrored_cylinder(&positions);
        }
        let first_wall = triangles.len();
        Ok(Self { positions, triangles, first_wall, uvs, materials, rows, fans })
    }

    /// Loses the triangles of vertices that hang on what is gone; all others keep their numbers.
    pub fn lose(&mut self, is_lost: impl Fn(&Row) -> bool) -> Result<()> {
        let is_lost: Vec<bool> = self.rows.iter().map(is_lost).collect();
        let lost = |corners: &&mut [u32; 3]| corners.iter().any(|&vertex| is_lost[vertex as usize]);
        self.triangles.iter_mut().filter(lost).for_each(|corners| *corners = [0; 3]);
        self.fans = Fans::new(self.positions.len(), &self.triangles)?;
        Ok(())
    }

    /// How long triangles are at rest: what contact goes by.
    pub fn edges(&self) -> Edges {
        let of_triangles: Vec<f32> =
            self.triangles.iter().map(|corners| self.longest_edge(corners)).collect();
        let mut edges = Edges { of_vertices: vec![f32::INFINITY; self.positions.len()], of_triangles };
        for vertex in 0..self.positions.len() {
            edges.of_vertices[vertex] = edges.around(self, vertex);
        }
        edges
    }

    /// At rest, in m.
    fn longest_edge(&self, corners: &[u32; 3]) -> f32 {
        let p = corners.map(|vertex| self.positions[vertex as usize]);
        (0..3).map(|i| (p[i] - p[(i + 1) % 3]).norm()).fold(0.0, f64::max) as f32
    }

    /// The triangles at a vertex, ascending.
    pub fn triangles_at(&self, vertex: usize) -> &[u32] {
        self.fans.at(vertex)
    }

    /// The unit normal at a vertex, its triangles weighted by their areas, when vertex `v` is at `position(v)`. A vertex without triangles, or whose triangles have no area or cancel,
    /// gets +z.
    pub fn vertex_normal(&self, vertex: usize, position: impl Fn(u32) -> Vec3) -> Vec3 {
        let mut sum = Vec3::zeros();
        for &triangle in self.triangles_at(vertex) {
            let [a, b, c] = self.triangles[triangle as usize].map(&position);
            sum += (b - a).cross(&(c - a));
        }
        let length = sum.norm();
        if length.is_finite() && length > NO_AREA_M2 { sum / length } else { Vec3::z() }
    }

    /// All vertex normals at rest `[vertex_count]`, see [`Self::vertex_normal`].
    pub fn rest_normals(&self) -> Vec<Vec3> {
        (0..self.positions.len()).map(|v| self.vertex_normal(v, |w| self.positions[w as usize])).collect()
    }
}

/// Texture coordinates without a seam, in metres: a cylinder around the z axis through the middle of the
/// bounding box.
///
/// u is the angle from the +y direction times the mean distance from the axis, the same on the left and on
/// the right, so that it never jumps; v is z. A texture is therefore mirrored at the plane x = middle, and
/// smeared where a surface is perpendicular to z.
pub fn mirrored_cylinder(positions: &[Vec3]) -> Vec<[f32; 2]> {
    let Some(&first) = positions.first() else { return Vec::new() };
    let low = positions.iter().fold(first, |low, p| low.inf(p));
    let high = positions.iter().fold(first, |high, p| high.sup(p));
    let middle = (low + high) / 2.0;

    let from_axis = |p: &Vec3| (p.x - middle.x).hypot(p.y - middle.y);
    let radius = positions.iter().map(from_axis).sum::<f64>() / positions.len() as f64;
    positions
        .iter()
        .map(|p| [((p.x - middle.x).abs().atan2(p.y - middle.y) * radius) as f32, p.z as f32])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::binding::tests::{Dense, H};
    use super::*;

    const ORGAN: u16 = 7;

    /// Material 2 with label 7 inside a ball, material 1 and label 3 around it.
    fn ball_in_a_block() -> (Dense, Vec<u16>) {
        let is_organ = |cell: [usize; 3]| Vec3::from(cell.map(|x| x as f64 - 7.5)).norm() < 5.0;
        let space = Dense::new([16; 3], |cell| if is_organ(cell) { 2 } else { 1 });
        let labels = space.materials.iter().map(|&m| if m == 2 { ORGAN } else { 3 }).collect();
        (space, labels)
    }

    fn tetrahedron(extra: &[[u32; 3]]) -> TriangleMesh {
        let corner = |x: f64, y: f64, z: f64| Vec3::new(4.0 + x, 4.0 + y, 4.0 + z) * H;
        let positions =
            vec![corner(0.0, 0.0, 0.0), corner(3.0, 0.0, 0.0), corner(0.0, 3.0, 0.0), corner(0.0, 0.0, 3.0)];
        let mut triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        triangles.extend_from_slice(extra);
        TriangleMesh { positions, triangles, uvs: Vec::new() }
    }

    fn block() -> Dense {
        Dense::new([16; 3], |_| 1)
    }

    #[test]
    fn an_organs_surface_hangs_on_the_organ() {
        let (space, labels) = ball_in_a_block();
        let surface = Surface::from_cells(&labels, |label| label == ORGAN, &space).unwrap();
        assert!(surface.materials.iter().all(|&m| m == 2));

        // Hosts are within half a cell, so a weight stays within (1.5)^3 and above -(0.5 × 1.5²).
        assert!(surface.rows.iter().flat_map(|r| r.weights).all(|w| (-1.125..=3.375).contains(&w)));
    }

    #[test]
    fn the_wall_of_an_empty_space_hangs_on_the_tissue_around_it() {
        let (mut space, labels) = ball_in_a_block();
        for material in space.materials.iter_mut().filter(|m| **m == 2) {
            *material = 0;
        }
        let surface = Surface::from_cells(&labels, |label| label == ORGAN, &space).unwrap();
        assert!(surface.materials.iter().all(|&m| m == 1));
    }

    #[test]
    fn normals_of_a_ball_point_along_its_radius() {
        let (space, labels) = ball_in_a_block();
        let surface = Surface::from_cells(&labels, |label| label == ORGAN, &space).unwrap();
        let middle = Vec3::repeat(8.0 * H);
        for (normal, x) in surface.rest_normals().iter().zip(&surface.positions) {
            assert!((normal.norm() - 1.0).abs() < 1e-12);
            assert!(normal.dot(&(x - middle).normalize()) > 0.9);
        }
    }

    #[test]
    fn a_vertex_normal_weighs_its_triangles_by_area() {
        let surface = Surface::from_preferred_cells(tetrahedron(&[]), &block(), |_| true).unwrap();
        // At the right-angled corner three equal triangles look along −x, −y and −z.
        let expected = -Vec3::repeat(1.0 / 3.0_f64.sqrt());
        assert!((surface.vertex_normal(0, |v| surface.positions[v as usize]) - expected).norm() < 1e-12);
        // At corner 1 the slanted face (9, 9, 9) outweighs those along −z and −y (9 each), which it cancels.
        assert!((surface.vertex_normal(1, |v| surface.positions[v as usize]) - Vec3::x()).norm() < 1e-12);
    }

    #[test]
    fn triangles_without_area_are_kept_and_leave_normals_finite() {
        let mut mesh = tetrahedron(&[[1, 1, 2], [3, 3, 3], [4, 4, 4]]);
        mesh.positions.push(mesh.positions[0]);
        let surface = Surface::from_preferred_cells(mesh, &block(), |_| true).unwrap();
        let sound = Surface::from_preferred_cells(tetrahedron(&[]), &block(), |_| true).unwrap();

        assert_eq!(surface.triangles.len(), 7);
        assert_eq!(surface.rest_normals()[..4], sound.rest_normals());
        assert_eq!(surface.rest_normals()[4], Vec3::z());
        let flattened = [Vec3::zeros(); 5];
        assert_eq!(surface.vertex_normal(0, |v| flattened[v as usize]), Vec3::z());
    }

    #[test]
    fn every_corner_of_every_triangle_stands_in_its_vertexs_row() {
        let (space, labels) = ball_in_a_block();
        let surface = Surface::from_cells(&labels, |label| label == ORGAN, &space).unwrap();
        let listed: usize = (0..surface.positions.len()).map(|v| surface.triangles_at(v).len()).sum();
        assert_eq!(listed, 3 * surface.triangles.len());
        for v in 0..surface.positions.len() {
            let row = surface.triangles_at(v);
            assert!(row.is_sorted());
            assert!(row.iter().all(|&t| surface.triangles[t as usize].contains(&(v as u32))));
        }
    }

    #[test]
    fn a_hosts_texture_coordinates_are_kept_and_missing_ones_are_made() {
        let mut mesh = tetrahedron(&[]);
        let made = Surface::from_preferred_cells(mesh.clone(), &block(), |_| true).unwrap();
        assert_eq!(made.uvs.len(), 4);

        mesh.uvs = vec![[0.0, 0.5], [1.0, 0.0], [0.25, 1.0], [0.0, 0.0]];
        let kept = Surface::from_preferred_cells(mesh.clone(), &block(), |_| true).unwrap();
        assert_eq!(kept.uvs, mesh.uvs);
    }

    #[test]
    fn texture_coordinates_of_a_cylinder_are_arc_lengths_without_a_jump() {
        let (radius, count) = (0.1, 360);
        let ring: Vec<Vec3> = (0..count)
            .map(|n| f64::from(n) * std::f64::consts::TAU / f64::from(count))
            .map(|angle| Vec3::new(radius * angle.sin(), radius * angle.cos(), 0.02))
            .collect();
        let uvs = mirrored_cylinder(&ring);
        let step = std::f64::consts::TAU * radius / f64::from(count);
        for n in 0..uvs.len() {
            let next = uvs[(n + 1) % uvs.len()];
            assert!((f64::from((uvs[n][0] - next[0]).abs()) - step).abs() < 1e-6);
            assert_eq!(uvs[n][1], 0.02);
        }
    }

    #[test]
    fn labels_of_another_size_are_refused() {
        let (space, labels) = ball_in_a_block();
        assert!(Surface::from_cells(&labels[1..], |_| true, &space).is_err());
    }
}
