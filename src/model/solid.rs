//! The inside of a closed surface as a grid of labels.
//!
//! **What is inside.** A voxel belongs to the solid when the surface winds around its centre: when it crosses the ray from there along +x more often outwards than
//! inwards, or more often inwards than outwards. So a mesh whose triangles are all turned round means the same solid, shells that overlap are one
//! solid, and a shell inside another is a cavity when it is turned the other way, as the inner side of a wall is. A centre on the surface itself
//! counts as inside where the solid lies towards +x.
//!
//! **What is closed.** Every edge of a triangle runs against that of another one; vertices at equal positions count as one, as seams of textures and STL files ask
//! for. A mesh with a hole, with a fin, or with a triangle turned round among others is refused.

use std::collections::HashMap;

use super::build::MAX_CELLS;
use super::grid::LabelGrid;
use super::mesh::TriangleMesh;
use super::placement::Placement;
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};

/// Label of the voxels in a solid; around it is label 0.
pub const SOLID: u16 = 1;

impl LabelGrid {
    /// The solid inside a closed mesh (world frame) in voxels of edge `cell_m`, axes along the world's: [`SOLID`] where it is, 0 around it. The grid's middle is that
    /// of the mesh's bounding box.
    ///
    /// Fails where the mesh is not closed, and where no voxel's centre is inside.
    pub fn from_solid(mesh: &TriangleMesh, cell_m: f64) -> Result<Self> {
        mesh.check()?;
        let mesh = welded(mesh);
        check_closed(&mesh)?;
        let first = mesh.positions[0];
        let low = mesh.positions.iter().fold(first, |low, p| low.inf(p));
        let high = mesh.positions.iter().fold(first, |high, p| high.sup(p));
        let dims = (high - low).map(|length| ((length / cell_m).ceil() as usize).max(1));
        let dims: [usize; 3] = dims.into();
        let centre = 0.5 * (low + high) - Vec3::from(dims.map(|n| 0.5 * (n as f64 - 1.0))) * cell_m;
        // Before memory is taken: a cell may be too small for the mesh, or no size at all.
        let placement =
            Placement::new(dims, Vec3::repeat(cell_m), Pose::translation(centre.x, centre.y, centre.z))?;
        if placement.count() > MAX_CELLS {
            return Err(Error::Limit(format!(
                "cells of {cell_m} m would divide the mesh's box into {dims:?}, more than {MAX_CELLS}"
            )));
        }
        let mut labels = vec![0; placement.count()];

        let crossings = crossings(&mesh, &centre, cell_m, dims);
        for (row, mut crossed) in crossings.into_iter().enumerate() {
            crossed.sort_by(|a, b| a.x.total_cmp(&b.x));
            let total: i32 = crossed.iter().map(|c| c.turn).sum();
            let (mut passed, mut next) = (0, 0);
            for i in 0..dims[0] {
                let x = centre.x + i as f64 * cell_m;
                while next < crossed.len() && crossed[next].x <= x {
                    passed += crossed[next].turn;
                    next += 1;
                }
                // What lies ahead along the ray.
                if total != passed {
                    labels[row * dims[0] + i] = SOLID;
                }
            }
        }
        if !labels.contains(&SOLID) {
            return Err(Error::argument(format!(
                "no cell of {cell_m} m has its centre inside the mesh: is it in metres, and thicker than a cell?"
            )));
        }
        Self::from_placement(placement, labels)
    }
}

/// Where a row of voxel centres crosses a surface.
struct Crossing {
    x: f64,
    /// 1 or −1, by the side that it crosses from.
    turn: i32,
}

/// The crossings of each row of voxel centres along x, y fastest.
fn crossings(mesh: &TriangleMesh, first: &Vec3, cell_m: f64, dims: [usize; 3]) -> Vec<Vec<Crossing>> {
    let mut rows: Vec<Vec<Crossing>> = (0..dims[1] * dims[2]).map(|_| Vec::new()).collect();
    for triangle in &mesh.triangles {
        let corners = triangle.map(|vertex| mesh.positions[vertex as usize]);
        // One more on each side, whatever is rounded.
        let range = |axis: usize| {
            let index = |x: f64| (x - first[axis]) / cell_m;
            let [a, b, c] = corners.map(|p| index(p[axis]));
            let low = (a.min(b).min(c).floor() - 1.0).max(0.0) as usize;
            low..((a.max(b).max(c).ceil() + 2.0).max(0.0) as usize).min(dims[axis])
        };
        for k in range(2) {
            for j in range(1) {
                let (y, z) = (first.y + j as f64 * cell_m, first.z + k as f64 * cell_m);
                if let Some(crossing) = crossing(mesh, *triangle, y, z) {
                    rows[j + dims[1] * k].push(crossing);
                }
            }
        }
    }
    rows
}

/// Where the line along x through y, z crosses a triangle.
///
/// Edges decide by a half-open rule, each the same way for both of its triangles, so that a line through an edge or a vertex of a closed
/// mesh is crossed as often as one beside it.
fn crossing(mesh: &TriangleMesh, triangle: [u32; 3], y: f64, z: f64) -> Option<Crossing> {
    let turn: i32 = (0..3).map(|n| passes(mesh, triangle[n], triangle[(n + 1) % 3], y, z)).sum();
    if turn == 0 {
        return None;
    }
    let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
    let normal = (b - a).cross(&(c - a));
    let x = a.x - (normal.y * (y - a.y) + normal.z * (z - a.z)) / normal.x;
    // Of a triangle seen from its edge any place is right, to rounding.
    let (low, high) = (a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x));
    Some(Crossing { x: if x.is_finite() { x.clamp(low, high) } else { low }, turn })
}

/// What an edge adds to the winding of its triangle around y, z, seen along x: 1 where it passes the point upwards along z on its right, −1 downwards.
fn passes(mesh: &TriangleMesh, from: u32, to: u32, y: f64, z: f64) -> i32 {
    // Both triangles of an edge compute with the same numbers in the same order.
    let (low, high, sign) = if from < to { (from, to, 1) } else { (to, from, -1) };
    let (a, b) = (mesh.positions[low as usize], mesh.positions[high as usize]);
    let side = (b.y - a.y) * (z - a.z) - (y - a.y) * (b.z - a.z);
    match (a.z <= z, b.z <= z) {
        (true, false) if side > 0.0 => sign,
        (false, true) if side < 0.0 => -sign,
        _ => 0,
    }
}

/// The mesh with one vertex for each position, and without triangles that name a vertex twice.
fn welded(mesh: &TriangleMesh) -> TriangleMesh {
    let mut vertex_at: HashMap<[u64; 3], u32> = HashMap::new();
    let mut positions = Vec::new();
    let number: Vec<u32> = mesh
        .positions
        .iter()
        .map(|p| {
            // Adding 0 makes −0 equal to 0.
            let key = <[f64; 3]>::from(*p).map(|x| (x + 0.0).to_bits());
            *vertex_at.entry(key).or_insert_with(|| {
                positions.push(*p);
                positions.len() as u32 - 1
            })
        })
        .collect();
    let triangles = mesh.triangles.iter().map(|t| t.map(|vertex| number[vertex as usize]));
    let triangles = triangles.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    TriangleMesh { positions, triangles, uvs: Vec::new() }
}

/// Refuses a mesh with an edge that is not run through as often one way as the other.
fn check_closed(mesh: &TriangleMesh) -> Result<()> {
    let mut open: HashMap<(u32, u32), i32> = HashMap::new();
    for t in &mesh.triangles {
        for (from, to) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *open.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
        }
    }
    let edges: Vec<(u32, u32)> =
        open.into_iter().filter(|(_, count)| *count != 0).map(|(edge, _)| edge).collect();
    let Some(&(from, to)) = edges.iter().min() else { return Ok(()) };
    let [a, b] = [from, to].map(|vertex| mesh.positions[vertex as usize]);
    Err(Error::argument(format!(
        "the mesh is not closed: {} edges lack a triangle on one side, or have one that is turned round, such as the edge from ({}, {}, {}) \
         to ({}, {}, {}) m",
        edges.len(),
        a.x,
        a.y,
        a.z,
        b.x,
        b.y,
        b.z
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball of radius `r` around `middle`: a box's faces in squares, pushed out to the sphere.
    fn ball(r: f64, middle: Vec3) -> TriangleMesh {
        let n = 12_u32;
        let mut mesh = TriangleMesh::default();
        for face in 0..6 {
            let (axis, sign) = (face / 2, if face % 2 == 0 { -1.0 } else { 1.0 });
            let first = mesh.positions.len() as u32;
            for row in 0..=n {
                for column in 0..=n {
                    let mut p = Vec3::zeros();
                    p[axis] = sign;
                    p[(axis + 1) % 3] = 2.0 * f64::from(column) / f64::from(n) - 1.0;
                    p[(axis + 2) % 3] = 2.0 * f64::from(row) / f64::from(n) - 1.0;
                    mesh.positions.push(middle + p.normalize() * r);
                }
            }
            for row in 0..n {
                for column in 0..n {
                    let v = first + column + row * (n + 1);
                    let (right, up) = (v + 1, v + n + 1);
                    let two = [[v, right, up], [right, up + 1, up]];
                    mesh.triangles
                        .extend(two.map(|[a, b, c]| if sign > 0.0 { [a, b, c] } else { [a, c, b] }));
                }
            }
        }
        mesh
    }

    /// Volume by the divergence theorem.
    fn volume(mesh: &TriangleMesh) -> f64 {
        let six = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            a.dot(&b.cross(&c))
        };
        mesh.triangles.iter().map(six).sum::<f64>() / 6.0
    }

    fn turned_round(mut mesh: TriangleMesh) -> TriangleMesh {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        mesh
    }

    fn together(a: TriangleMesh, b: &TriangleMesh) -> TriangleMesh {
        let mut both = a;
        let first = both.positions.len() as u32;
        both.positions.extend(&b.positions);
        both.triangles.extend(b.triangles.iter().map(|t| t.map(|v| v + first)));
        both
    }

    fn count(grid: &LabelGrid) -> usize {
        grid.labels().iter().filter(|&&label| label == SOLID).count()
    }

    const R: f64 = 0.02;
    const H: f64 = 1e-3;

    #[test]
    fn a_balls_voxels_have_its_volume_and_their_centres_inside_it() {
        let middle = Vec3::new(0.013, -0.4, 7.0);
        let mesh = ball(R, middle);
        let grid = LabelGrid::from_solid(&mesh, H).unwrap();
        // Each voxel that the surface cuts is wrong by half of one at most, as often one way as the other: of about 1.5 times the area of such voxels the root.
        let cut = 1.5 * 4.0 * std::f64::consts::PI * (R / H).powi(2);
        let expected = volume(&mesh) / H.powi(3);
        assert!((count(&grid) as f64 - expected).abs() < 2.0 * cut.sqrt(), "{} of {expected}", count(&grid));
        // Facets lie within a hundredth of the radius below the sphere.
        for (n, &label) in grid.labels().iter().enumerate() {
            let [nx, ny, _] = grid.dims();
            let index = Vec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / (nx * ny)) as f64);
            let from = (grid.frame().translation.vector + index * H - middle).norm() / R;
            assert!(
                label
                    == if from < 0.99 {
                        SOLID
                    } else if from > 1.0 {
                        0
                    } else {
                        label
                    },
                "at {from} radii"
            );
        }
    }

    #[test]
    fn orientation_changes_nothing() {
        let mesh = ball(R, Vec3::zeros());
        let grid = LabelGrid::from_solid(&mesh, H).unwrap();
        let turned = LabelGrid::from_solid(&turned_round(mesh), H).unwrap();
        assert!(grid.labels() == turned.labels());
    }

    #[test]
    fn a_shell_turned_round_inside_another_is_a_cavity_and_overlapping_ones_are_one_solid() {
        let (outer, inner) = (ball(R, Vec3::zeros()), ball(0.5 * R, Vec3::zeros()));
        let whole = LabelGrid::from_solid(&outer, H).unwrap();
        let hollow = together(outer.clone(), &turned_round(inner.clone()));
        let hollow = LabelGrid::from_solid(&hollow, H).unwrap();
        let hole = whole.labels().iter().zip(hollow.labels()).filter(|(a, b)| a != b).count();
        let expected = volume(&inner) / H.powi(3);
        assert!((hole as f64 / expected - 1.0).abs() < 0.05, "{hole} of {expected}");
        let doubled = LabelGrid::from_solid(&together(outer, &inner), H).unwrap();
        assert!(doubled.labels() == whole.labels());
    }

    #[test]
    fn a_hole_a_fin_and_a_turned_triangle_are_refused() {
        let mut holed = ball(R, Vec3::zeros());
        holed.triangles.pop();
        let mut finned = ball(R, Vec3::zeros());
        finned.positions.push(Vec3::repeat(R));
        finned.triangles.push([0, 1, finned.positions.len() as u32 - 1]);
        let mut turned = ball(R, Vec3::zeros());
        turned.triangles[5].swap(0, 1);
        for mesh in [holed, finned, turned] {
            let message = LabelGrid::from_solid(&mesh, H).unwrap_err().to_string();
            assert!(message.starts_with("the mesh is not closed: 3 edges lack"), "{message}");
        }
    }

    #[test]
    fn rays_through_vertices_and_along_faces_are_counted_once() {
        // A box whose corners and edges lie on rays, and whose sides lie along them.
        let corner = |n: usize| Vec3::from_fn(|axis, _| if n >> axis & 1 == 1 { 4.0 } else { 0.0 });
        let triangles = [
            [0, 2, 1],
            [1, 2, 3],
            [4, 5, 6],
            [5, 7, 6],
            [0, 1, 4],
            [1, 5, 4],
            [2, 6, 3],
            [3, 6, 7],
            [0, 4, 2],
            [2, 4, 6],
            [1, 3, 5],
            [3, 7, 5],
        ];
        let mesh = TriangleMesh {
            positions: (0..8).map(|n| corner(n) * 0.01).collect(),
            triangles: triangles.to_vec(),
            uvs: Vec::new(),
        };
        // Rays at 0, 1, … 4 along y and z, of which one of both ends counts.
        let rows = crossings(&mesh, &Vec3::zeros(), 0.01, [5, 5, 5]);
        let crossed = rows.iter().filter(|row| row.iter().map(|c| c.turn.abs()).sum::<i32>() == 2).count();
        assert_eq!(crossed, 16);
        assert!(rows.iter().all(|row| row.iter().map(|c| c.turn).sum::<i32>() == 0));
        assert_eq!(count(&LabelGrid::from_solid(&mesh, 0.01).unwrap()), 64);
    }

    #[test]
    fn cells_that_are_no_size_or_too_large_or_too_many_are_refused() {
        let mesh = ball(R, Vec3::zeros());
        for cell_m in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-9, 5e-5, 2.0] {
            assert!(LabelGrid::from_solid(&mesh, cell_m).is_err(), "{cell_m}");
        }
        let flat = ball(1e-5, Vec3::zeros());
        assert!(LabelGrid::from_solid(&flat, 0.9e-5).is_ok());
        assert!(LabelGrid::from_solid(&TriangleMesh::default(), H).is_err());
    }
}
