//! Texture coordinates of walls.

use nalgebra as na;

use crate::math::{Mat3, Vec3};

/// For each vertex of some walls where it is in the plane that its connected wall lies closest to, in cells; 0 for every other vertex.
pub fn wall_uvs(positions: &[Vec3], triangles: &[[u32; 3]], cell_m: f64) -> Vec<[f32; 2]> {
    let mut group: Vec<u32> = (0..positions.len() as u32).collect();
    fn root(group: &mut [u32], mut n: u32) -> u32 {
        while group[n as usize] != n {
            group[n as usize] = group[group[n as usize] as usize];
            n = group[n as usize];
        }
        n
    }
    for &[a, b, c] in triangles {
        for other in [b, c] {
            let (a, b) = (root(&mut group, a), root(&mut group, other));
            group[a.max(b) as usize] = a.min(b);
        }
    }
    // The plane whose normal has the greatest share of all triangles' areas, whichever side they face.
    let mut sums: std::collections::BTreeMap<u32, Mat3> = std::collections::BTreeMap::new();
    for corners in triangles {
        let [a, b, c] = corners.map(|v| positions[v as usize] / cell_m);
        let normal = (b - a).cross(&(c - a));
        let length = normal.norm().max(f64::MIN_POSITIVE);
        let sum = sums.entry(root(&mut group, corners[0])).or_insert_with(Mat3::zeros);
        *sum += normal * normal.transpose() / length;
    }
    let planes: std::collections::BTreeMap<u32, [Vec3; 2]> =
        sums.into_iter().map(|(wall, sum)| (wall, axes(&sum))).collect();
    let mut uvs = vec![[0.0; 2]; positions.len()];
    for &v in triangles.iter().flatten() {
        let plane = &planes[&root(&mut group, v)];
        uvs[v as usize] = plane.map(|axis| (axis.dot(&positions[v as usize]) / cell_m) as f32);
    }
    uvs
}

/// Two axes in a plane, the first across the grid axis that is closest to its normal's smallest component.
fn axes(sum: &Mat3) -> [Vec3; 2] {
    let eigen = na::SymmetricEigen::new(*sum);
    let normal: Vec3 = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into();
    let u = Vec3::ith(normal.iamin(), 1.0);
    let u = (u - normal * normal.dot(&u)).normalize();
    [u, normal.cross(&u)]
}
