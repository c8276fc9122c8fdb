//! Texture coordinates of walls.

use std::collections::BTreeMap;

use nalgebra as na;

use super::groups::Groups;
use crate::math::{Mat3, Vec3};

/// For each vertex of some walls where it is in the plane that its connected wall lies closest to, in cells; 0 for every other vertex.
pub fn wall_uvs(positions: &[Vec3], triangles: &[[u32; 3]], cell_m: f64) -> Vec<[f32; 2]> {
    let mut groups = Groups::new(positions.len());
    for &[a, b, c] in triangles {
        groups.join(a, b);
        groups.join(a, c);
    }
    // The plane whose normal has the greatest share of all triangles' areas, whichever side they face.
    let mut sums: BTreeMap<u32, Mat3> = BTreeMap::new();
    for corners in triangles {
        let [a, b, c] = corners.map(|v| positions[v as usize] / cell_m);
        let normal = (b - a).cross(&(c - a));
        let length = normal.norm().max(f64::MIN_POSITIVE);
        let sum = sums.entry(groups.of(corners[0])).or_insert_with(Mat3::zeros);
        *sum += normal * normal.transpose() / length;
    }
    let planes: BTreeMap<u32, [Vec3; 2]> = sums.into_iter().map(|(wall, sum)| (wall, axes(&sum))).collect();
    let mut uvs = vec![[0.0; 2]; positions.len()];
    for &v in triangles.iter().flatten() {
        let plane = &planes[&groups.of(v)];
        uvs[v as usize] = plane.map(|axis| (axis.dot(&positions[v as usize]) / cell_m) as f32);
    }
    uvs
}

/// Two axes in the plane, the first as close as can be to the grid's axis that is closest to the plane.
fn axes(sum: &Mat3) -> [Vec3; 2] {
    let eigen = na::SymmetricEigen::new(*sum);
    let normal: Vec3 = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into();
    let u = Vec3::ith(normal.iamin(), 1.0);
    let u = (u - normal * normal.dot(&u)).normalize();
    [u, normal.cross(&u)]
}
