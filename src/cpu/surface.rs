//! Moves a surface's vertices with the nodes and computes its normals.

use super::lanes::Real;
use super::nodes::Field;
use super::workers::Workers;
use crate::math::Vec3;
use crate::model::surface::ROW;
use crate::model::{Model, energy};
use crate::solver::{SurfaceArrays, SurfaceField};

/// Fills a surface's arrays, world frame, from the displacements of the nodes. Threads share the vertices.
pub fn publish<R: Real>(
    model: &Model,
    index: usize,
    u: &Field<R>,
    field: SurfaceField,
    arrays: &mut SurfaceArrays,
    workers: &mut Workers,
) {
    let surface = &model.surfaces()[index];
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
                SurfaceField::Strain => strain_at(model, row.nodes[0], u),
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

/// Largest principal strain magnitude of the mean Green strain of the cell that starts at a slot, or of one beside it.
fn strain_at<R: Real>(model: &Model, slot: u32, u: &Field<R>) -> f64 {
    let lattice = model.lattice();
    let node = lattice.node_of(slot);
    // The first node of a row is the lowest corner of its cell.
    if lattice.cell_material(node) == 0 {
        return 0.0;
    }
    let g = energy::gradient(lattice.cell_m(), &lattice.corners(node).map(|corner| u.vec3(corner)));
    let g = crate::math::Mat3::from_fn(|r, c| g[r][c]);
    let green = 0.5 * (g + g.transpose() + g.transpose() * g);
    green.symmetric_eigenvalues().amax()
}
