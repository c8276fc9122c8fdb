//! A ray against the deformed contact surface.

use super::state::State;
use crate::math::Vec3;
use crate::model::surface::ROW;

/// What a ray met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// Where, world frame.
    pub point_m: Vec3,
    /// Outward unit normal of the triangle there.
    pub normal: Vec3,
    /// Distance along the ray in metres.
    pub distance_m: f64,
    /// The triangle of the contact surface.
    pub triangle: u32,
    /// Material index of the tissue, 1 to 15.
    pub material: u8,
}

impl State {
    /// The nearest triangle, from either side, along a unit direction. World frame.
    pub(super) fn pick(&self, origin: Vec3, direction: Vec3) -> Option<Pick> {
        let surface = &self.surfaces[self.model.contact_surface()];
        let frame = self.model.frame();
        let vertices: Vec<Vec3> = surface
            .positions
            .iter()
            .zip(&surface.rows)
            .map(|(rest, row)| {
                let moved =
                    (0..ROW).map(|i| self.solver.displacement(row.nodes[i]) * f64::from(row.weights[i]));
                frame.transform_point(&(rest + moved.sum::<Vec3>()).into()).coords
            })
            .collect();

        let mut nearest: Option<Pick> = None;
        for (t, corners) in surface.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(|v| vertices[v as usize]);
            let Some(distance) = meet(origin, direction, a, b, c) else { continue };
            if nearest.is_none_or(|pick| distance < pick.distance_m) {
                nearest = Some(Pick {
                    point_m: origin + direction * distance,
                    normal: (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vec3::z),
                    distance_m: distance,
                    triangle: t as u32,
                    material: surface.materials[corners[0] as usize],
                });
            }
        }
        nearest
    }
}

/// Distance along a ray to a triangle (Möller and Trumbore 1997); an edge belongs to both of its triangles.
fn meet(origin: Vec3, direction: Vec3, a: Vec3, b: Vec3, c: Vec3) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(&ac);
    let determinant = ab.dot(&p);
    if determinant.abs() < 1e-300 {
        return None;
    }
    let to_origin = origin - a;
    let u = to_origin.dot(&p) / determinant;
    let q = to_origin.cross(&ab);
    let v = direction.dot(&q) / determinant;
    let distance = ac.dot(&q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance >= 0.0).then_some(distance)
}
