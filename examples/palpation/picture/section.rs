//! A plane through the deformed cells.

use palpate::math::{Mat3, Vec3};
use palpate::model::Model;

use super::drawing::raster::Plane;

/// A point of the cut.
#[derive(Clone, Copy, Debug)]
pub struct CutPoint {
    /// World position.
    pub position: Vec3,
    /// Length of the displacement there, in metres.
    pub displacement_m: f32,
}

/// What the plane leaves of one cell.
#[derive(Clone, Debug)]
pub struct CellCut {
    /// Material index, 1 to 15.
    pub material: u8,
    /// Largest principal strain magnitude of the cell.
    pub strain: f32,
    /// The cut area.
    pub triangles: Vec<[CutPoint; 3]>,
    /// Where the plane crosses the cell's faces.
    pub outline: Vec<[Vec3; 2]>,
}

/// Corner `c` of a cell lies at offset `(c & 1, c >> 1 & 1, c >> 2 & 1)`. The six tetrahedra around its diagonal from 0 to 7: each
/// takes one step along each axis, in each of the six orders.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];
/// Corners around each face.
const FACES: [[usize; 4]; 6] =
    [[0, 2, 6, 4], [1, 3, 7, 5], [0, 1, 5, 4], [2, 3, 7, 6], [0, 1, 3, 2], [4, 5, 7, 6]];

/// Cuts all cells that the plane crosses. `displacements` is `[slot_count]`, world axes.
pub fn cut(model: &Model, displacements: &[Vec3], plane: Plane) -> Vec<CellCut> {
    let lattice = model.lattice();
    let slots = 0..lattice.slot_count() as u32;
    let cells = slots.filter(|&slot| lattice.words()[slot as usize] >> 28 != 0);
    cells.filter_map(|slot| cut_cell(model, displacements, plane, slot)).collect()
}

fn cut_cell(model: &Model, displacements: &[Vec3], plane: Plane, slot: u32) -> Option<CellCut> {
    let lattice = model.lattice();
    let cell = lattice.node_of(slot);
    let mut corners = [CutPoint { position: Vec3::zeros(), displacement_m: 0.0 }; 8];
    let mut moved = [Vec3::zeros(); 8];
    for c in 0..8 {
        let corner = lattice.slot([cell[0] + (c & 1), cell[1] + (c >> 1 & 1), cell[2] + (c >> 2 & 1)])?;
        let rest = model.frame().transform_point(&lattice.rest_position(corner).into()).coords;
        moved[c] = displacements[corner as usize];
        corners[c] = CutPoint { position: rest + moved[c], displacement_m: moved[c].norm() as f32 };
    }
    let sides = corners.map(|corner| plane.distance(corner.position));
    if sides.iter().all(|&s| s >= 0.0) || sides.iter().all(|&s| s < 0.0) {
        return None;
    }

    let crossing =
        |a: usize, b: usize| ((sides[a] < 0.0) != (sides[b] < 0.0)).then(|| between(&corners, &sides, a, b));
    let mut triangles = Vec::with_capacity(12);
    for tetrahedron in TETRAHEDRA {
        triangles.extend(cut_tetrahedron(tetrahedron, &sides, &crossing));
    }
    let mut outline = Vec::with_capacity(6);
    for face in FACES {
        let ends: Vec<CutPoint> = (0..4).filter_map(|e| crossing(face[e], face[(e + 1) % 4])).collect();
        outline.extend(ends.chunks_exact(2).map(|pair| [pair[0].position, pair[1].position]));
    }
    let material = (lattice.words()[slot as usize] >> 28) as u8;
    // Displacements have world axes, so differences along a cell's edges are turned into the model frame's axes first.
    let local = moved.map(|u| model.frame().rotation.inverse() * u);
    Some(CellCut { material, strain: strain(&local, lattice.cell_m()), triangles, outline })
}

/// Three edges cross the plane when one corner is alone on its side, four when two are.
fn cut_tetrahedron(
    corners: [usize; 4],
    sides: &[f64; 8],
    crossing: &dyn Fn(usize, usize) -> Option<CutPoint>,
) -> Vec<[CutPoint; 3]> {
    let (below, above): (Vec<usize>, Vec<usize>) = corners.iter().partition(|&&c| sides[c] < 0.0);
    match (below[..].as_ref(), above[..].as_ref()) {
        (&[a, b], &[c, d]) => match [crossing(a, c), crossing(a, d), crossing(b, d), crossing(b, c)] {
            [Some(p), Some(q), Some(r), Some(s)] => vec![[p, q, r], [p, r, s]],
            _ => Vec::new(),
        },
        (&[alone], &[a, b, c]) | (&[a, b, c], &[alone]) => {
            match [crossing(alone, a), crossing(alone, b), crossing(alone, c)] {
                [Some(p), Some(q), Some(r)] => vec![[p, q, r]],
                _ => Vec::new(),
            }
        }
        _ => Vec::new(),
    }
}

fn between(corners: &[CutPoint; 8], sides: &[f64; 8], a: usize, b: usize) -> CutPoint {
    let share = sides[a] / (sides[a] - sides[b]);
    let [from, to] = [corners[a], corners[b]];
    CutPoint {
        position: from.position.lerp(&to.position, share),
        displacement_m: from.displacement_m + (to.displacement_m - from.displacement_m) * share as f32,
    }
}

/// Largest |stretch - 1| of the cell's mean deformation gradient.
fn strain(moved: &[Vec3; 8], cell_m: f64) -> f32 {
    let mut gradient = Mat3::identity();
    for axis in 0..3 {
        let along: Vec3 = (0..8).map(|c| if c >> axis & 1 == 1 { moved[c] } else { -moved[c] }).sum();
        gradient.set_column(axis, &(gradient.column(axis) + along / (4.0 * cell_m)));
    }
    let stretches = gradient.singular_values();
    stretches.iter().map(|s| (s - 1.0).abs()).fold(0.0, f64::max) as f32
}
