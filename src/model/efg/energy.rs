//! Elastic energy of displaced cells, in double precision: the potential of the forces that [`super::law`] says.

use super::law::{
    Elasticity, HOURGLASS, Matrix, corotated_strain, deformation, green_strain, rotation_matrix, turn_towards,
};
use crate::math::Vec3;
use crate::model::energy::{gradient, gradient_at};
use crate::model::lattice::Lattice;
use crate::model::law::CellLaw;

/// Steps of Newton's method for a rotation that nothing is known of.
const TURNS: usize = 40;

/// Energy in J of all cells, for the displacement `u` of each slot in m. All cells see their eight corners.
pub fn elastic_j(
    lattice: &Lattice,
    laws: &[CellLaw; 16],
    elasticity: Elasticity,
    u: impl Fn(u32) -> Vec3,
) -> f64 {
    let h = lattice.cell_m();
    lattice
        .occupied()
        .map(|(cell, material)| {
            let moved = lattice.corners(cell).map(&u);
            cell_j(&laws[usize::from(material)], h, elasticity, Vec3::repeat(0.5), &moved)
        })
        .sum()
}

/// Energy in J of one cell whose corners moved by `u`, with its integration point at `at`, from 0 to 1 along each axis. A piece of a cell has its share of this, its point
/// at its centroid.
pub fn cell_j(law: &CellLaw, h: f64, elasticity: Elasticity, at: Vec3, u: &[Vec3; 8]) -> f64 {
    let (g, fit): (Matrix<f64>, _) = (gradient_at(h, at, u), gradient(h, u));
    let strain = match elasticity {
        Elasticity::Linear => g,
        Elasticity::StVenantKirchhoff => green_strain(&g),
        Elasticity::Corotated => {
            let f = deformation(&g);
            let q = (0..TURNS).fold([0.0, 0.0, 0.0, 1.0], |q, _| turn_towards(q, &f));
            corotated_strain(&rotation_matrix(q), &g)
        }
    };
    let trace = strain[0][0] + strain[1][1] + strain[2][2];
    let symmetric = |i: usize, j: usize| 0.5 * (strain[i][j] + strain[j][i]);
    let squares: f64 = (0..9).map(|n| symmetric(n / 3, n % 3).powi(2)).sum();
    let density = law.shear_pa * squares + 0.5 * law.lambda_pa * trace * trace;

    let mean = u.iter().sum::<Vec3>() / 8.0;
    let unseen: f64 = (0..8)
        .map(|i| {
            let sign = |axis: usize| if i >> axis & 1 == 1 { 0.5 * h } else { -0.5 * h };
            let affine =
                Vec3::from_fn(|c, _| fit[c][0] * sign(0) + fit[c][1] * sign(1) + fit[c][2] * sign(2));
            (u[i] - mean - affine).norm_squared()
        })
        .sum();
    density * h * h * h + 0.5 * HOURGLASS * law.shear_pa * h * unseen
}
