//! Elastic energy of a displaced lattice, summed over cells in double precision: the potential of the kernels' forces.

use super::lattice::Lattice;
use super::law::{CellLaw, SpringClass, squared_change, volume_change};
use crate::math::Vec3;

/// Energy in J of all springs and volume terms, for the displacement `u` of each slot in m.
pub fn elastic_j(lattice: &Lattice, laws: &[CellLaw; 16], u: impl Fn(u32) -> Vec3) -> f64 {
    lattice
        .occupied()
        .map(|(cell, material)| {
            cell_j(&laws[usize::from(material)], lattice.cell_m(), &lattice.corners(cell).map(&u))
        })
        .sum()
}

/// Energy in J of one cell whose corners moved by `u`.
pub fn cell_j(law: &CellLaw, h: f64, u: &[Vec3; 8]) -> f64 {
    let classes = [1, 2, 3].map(|diagonal| SpringClass::new(diagonal, h));
    let mut springs = 0.0;
    for a in 0..8_usize {
        for b in a + 1..8 {
            // Corners differ in one, two or three bits: an edge, a face diagonal or a body diagonal.
            let diagonal = (a ^ b).count_ones();
            let d = u[b] - u[a];
            let along = |axis: usize| f64::from((b >> axis & 1) as i32 - (a >> axis & 1) as i32);
            let rd = along(0) * d.x + along(1) * d.y + along(2) * d.z;

            let class = &classes[diagonal as usize - 1];
            let e = squared_change([d.x, d.y, d.z], rd, 2.0 * h);
            springs += 0.5 * law.spring_n_m * class.squared_stretch(e);
        }
    }

    let (_, dj) = volume_change(gradient(h, u));
    // volume_n = (λ - μ) h² / 4, so the energy density times h³ is 2 h volume_n (J - 1)².
    springs + 2.0 * h * law.volume_n * dj * dj
}

/// Displacement gradient of a cell at a point in it, from 0 to 1 along each axis, `[component][direction]`.
pub fn gradient_at(h: f64, at: Vec3, u: &[Vec3; 8]) -> [[f64; 3]; 3] {
    let share = |corner: usize, axis: usize| if corner >> axis & 1 == 1 { at[axis] } else { 1.0 - at[axis] };
    std::array::from_fn(|comp| {
        std::array::from_fn(|axis| {
            let beside = |corner: usize| share(corner, (axis + 1) % 3) * share(corner, (axis + 2) % 3);
            let signed = |corner: usize| {
                if corner >> axis & 1 == 0 { -u[corner][comp] } else { u[corner][comp] }
            };
            (0..8).map(|corner| signed(corner) * beside(corner)).sum::<f64>() / h
        })
    })
}

/// Mean displacement gradient of a cell, `[component][direction]`.
pub fn gradient(h: f64, u: &[Vec3; 8]) -> [[f64; 3]; 3] {
    std::array::from_fn(|comp| {
        std::array::from_fn(|axis| {
            let signed =
                |corner: usize| if corner >> axis & 1 == 0 { -u[corner][comp] } else { u[corner][comp] };
            (0..8).map(signed).sum::<f64>() / (4.0 * h)
        })
    })
}
