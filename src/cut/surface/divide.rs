//! Division of a triangle along segments in it.

use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};

use super::jitter::Tie;

/// A triangle with points on its edges and inside, and segments between them.
#[derive(Clone, Debug, Default)]
pub struct Divided {
    /// Points on each edge, from corner i to corner i + 1: shares of the edge, ascending, and names.
    pub on_edges: [Vec<(f64, u32)>; 3],
    /// Points inside: weights of the corners, and names.
    pub inside: Vec<([f64; 3], u32)>,
    /// Segments between points, by names.
    pub segments: Vec<[u32; 2]>,
}

impl Divided {
    /// Whether nothing divides the triangle.
    pub fn is_whole(&self) -> bool {
        self.inside.is_empty() && self.segments.is_empty() && self.on_edges.iter().all(Vec::is_empty)
    }

    /// The triangles, of the same orientation, that the points and segments divide a triangle with these corners into.
    pub fn triangles(&self, corners: [u32; 3]) -> Result<Vec<[u32; 3]>, Tie> {
        let mut names: Vec<u32> = corners.to_vec();
        let mut places = vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        for (edge, on_edge) in self.on_edges.iter().enumerate() {
            for &(share, name) in on_edge {
                // On the slanted edge both coordinates sum to one exactly.
                let rest = 1.0 - share;
                places.push([[share, 0.0], [rest, 1.0 - rest], [0.0, rest]][edge]);
                names.push(name);
            }
        }
        let boundary = names.len();
        for &([_, u, v], name) in &self.inside {
            if !(u > 0.0 && v > 0.0 && u + v < 1.0) {
                return Err(Tie);
            }
            places.push([u, v]);
            names.push(name);
        }

        let mut mesh: ConstrainedDelaunayTriangulation<Point2<f64>> = ConstrainedDelaunayTriangulation::new();
        let mut handles = Vec::with_capacity(names.len());
        for (n, [u, v]) in places.into_iter().enumerate() {
            let handle = mesh.insert(Point2::new(u, v)).map_err(|_| Tie)?;
            if handle.index() != n {
                return Err(Tie);
            }
            handles.push(handle);
        }
        for segment in &self.segments {
            let ends = segment.map(|name| names.iter().position(|&n| n == name));
            let [Some(a), Some(b)] = ends else { return Err(Tie) };
            let (a, b) = (handles[a], handles[b]);
            if !mesh.can_add_constraint(a, b) {
                return Err(Tie);
            }
            mesh.add_constraint(a, b);
            // A point between the ends would have divided the segment.
            if mesh.get_edge_from_neighbors(a, b).is_none() {
                return Err(Tie);
            }
        }
        let triangles: Vec<[u32; 3]> =
            mesh.inner_faces().map(|face| face.vertices().map(|v| names[v.index()])).collect();
        let expected = 2 * self.inside.len() + boundary - 2;
        if triangles.len() == expected { Ok(triangles) } else { Err(Tie) }
    }
}
