//! Moves a surface's vertices with the nodes and computes its normals.

use super::lanes::Real;
use super::nodes::Field;
use super::workers::Workers;
use crate::math::Vec3;
use crate::model::surface::{ROW, Surface};
use crate::model::{Model, energy};
use crate::solver::{SurfaceArrays, SurfaceField};

/// Fills a surface's arrays, world frame, from the displacements of the nodes. Threads share the vertices.
pub fn publish<R: Real>(
    model: &Model,
    surface: &Surface,
    u: &Field<R>,
    field: SurfaceField,
    arrays: &mut SurfaceArrays,
    workers: &mut Workers,
) {
    let frame = model.frame();
    let count = surface.positions.len();
    let positions = Chunks(arrays.positions.as_mut_ptr());
    let normals = Chunks(arrays.normals.as_mut_ptr());
    let scalars = Chunks(arrays.scalars.as_mut_ptr());
    assert!(
        arrays.positions.len() == count && arrays.normals.len() == count && arrays.scalars.len() == count
    );

    workers.run(&|member| {
        let (positions, normals, scalars) = (&positions, &normals, &scalars);
        let mine = member.share(count);
        for v in mine.clone() {
            let row = &surface.rows[v];
            let moved: Vec3 = (0..ROW).map(|i| u.vec3(row.nodes[i]) * f64::from(row.weights[i])).sum();
            let p = frame.transform_point(&(surface.positions[v] + moved).into());
            let scalar = match field {
                SurfaceField::Displacement => moved.norm(),
                SurfaceField::Strain => strain_at(model.lattice().cell_m(), &row.nodes, u),
            };
            // SAFETY: vertex ranges of the members are disjoint, and inside the arrays as asserted.
            unsafe {
                *positions.0.add(v) = [p.x as f32, p.y as f32, p.z as f32, 1.0];
                *scalars.0.add(v) = scalar as f32;
            }
        }
        member.meet();
        // SAFETY: after the meeting nobody writes positions.
        let at =
            |v: u32| unsafe { Vec3::from_column_slice(&(*positions.0.add(v as usize)).map(f64::from)[..3]) };
        for v in mine {
            let n = surface.vertex_normal(v, at);
            // SAFETY: as above.
            unsafe { *normals.0.add(v) = [n.x as f32, n.y as f32, n.z as f32, 0.0] };
        }
    });
}

/// An array that members write in disjoint parts.
struct Chunks<T>(*mut T);
// SAFETY: see its uses.
unsafe impl<T> Sync for Chunks<T> {}

/// Largest principal strain magnitude of the mean Green strain of a cell, or of a piece of one, with these nodes.
fn strain_at<R: Real>(cell_m: f64, nodes: &[u32; ROW], u: &Field<R>) -> f64 {
    let g = energy::gradient(cell_m, &nodes.map(|slot| u.vec3(slot)));
    let g = crate::math::Mat3::from_fn(|r, c| g[r][c]);
    let green = 0.5 * (g + g.transpose() + g.transpose() * g);
    green.symmetric_eigenvalues().amax()
}
