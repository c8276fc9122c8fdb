//! What cells know of their own frame: how far they are turned, or deformed.

use super::super::lanes::{Lanes, Octet, Real};
use super::super::nodes::{BRICK_ROWS, Bricks};
use super::gather::{CellRow, for_each_row};
use super::laws::{MATRIX, Plain, gradient};
use crate::math::Num;
use crate::model::efg::law::{
    Elasticity, Matrix, corotated_strain, deformation, green_strain, rotation_matrix, turn_towards,
};
use crate::model::law::volume_change;

/// Numbers of a cell's rotation.
pub const QUATERNION: usize = 4;
/// Steps of Newton's method for a rotation in each step of time: each squares what is left to turn.
const TURNS: usize = 3;

/// What the cells of a brick see of their own deformation.
#[derive(Clone, Copy, Debug, Default)]
pub struct Deformed {
    /// Largest strain along a cell's own axes.
    pub strain: f32,
    /// Largest J − 1.
    pub swelling: f32,
    /// Largest 1 − J.
    pub shrinking: f32,
}

impl Deformed {
    /// The larger of each.
    pub fn max(&self, other: &Self) -> Self {
        Self {
            strain: self.strain.max(other.strain),
            swelling: self.swelling.max(other.swelling),
            shrinking: self.shrinking.max(other.shrinking),
        }
    }
}

/// Rotations and frames of all cells of so many bricks, and of the empty one behind them, at rest.
pub fn at_rest<R: Real>(bricks: usize) -> (Vec<Octet<R>>, Vec<Octet<R>>) {
    let one = Octet([R::splat(1.0); 8]);
    let unit = |numbers: usize, is_one: fn(usize) -> bool| {
        let brick = (0..numbers * BRICK_ROWS)
            .map(move |at| if is_one(at / BRICK_ROWS) { one } else { Octet::default() });
        std::iter::repeat_n(brick, bricks + 1).flatten().collect()
    };
    (unit(QUATERNION, |n| n == 3), unit(MATRIX, |n| n % 4 == 0))
}

/// Finds the frames of a brick's cells under displacements `u`.
///
/// # Safety
/// The brick's own part of `rotations` and `frames` is touched by nobody else meanwhile, and nobody writes `u`.
#[inline(always)]
pub unsafe fn turn<L: Lanes>(
    bricks: &Bricks,
    brick: usize,
    elasticity: Elasticity,
    u: &Plain<L::Real>,
    inverse_4h: f64,
    rotations: *mut Octet<L::Real>,
    frames: *mut Octet<L::Real>,
) -> Deformed {
    let zero = L::splat(0.0);
    let (mut strain, mut swelling, mut shrinking) = (zero, zero, zero);
    let is_there = |materials: &[u8; 8]| {
        let table = std::array::from_fn(|m| L::Real::splat(if m == 0 { 0.0 } else { 1.0 }));
        L::look_up(&table, materials)
    };
    let visit = |at: CellRow, materials: &[u8; 8], corners: &_| {
        let (g, _) = gradient::<L>(corners, L::splat(inverse_4h));
        let (there, f) = (is_there(materials), deformation(&g));
        let write = |to: *mut Octet<L::Real>, numbers: usize, values: &[L]| {
            let first = at.at(numbers);
            for (n, value) in values.iter().enumerate() {
                // SAFETY: the numbers of this row of cells.
                unsafe { value.store(to.add(first + n * BRICK_ROWS).cast()) };
            }
        };
        let flat = |m: &Matrix<L>| [m[0][0], m[0][1], m[0][2], m[1][0], m[1][1], m[1][2], m[2][0], m[2][1], m[2][2]];
        let stretch = match elasticity {
            Elasticity::Linear => g,
            Elasticity::StVenantKirchhoff => {
                write(frames, MATRIX, &flat(&f));
                green_strain(&g)
            }
            Elasticity::Corotated => {
                let first = at.at(QUATERNION);
                // SAFETY: as above.
                let old = [0, 1, 2, 3].map(|n| unsafe { L::load(rotations.add(first + n * BRICK_ROWS).cast()) });
                let q = (0..TURNS).fold(old, |q, _| turn_towards(q, &f, L::max));
                let r = rotation_matrix(q);
                write(rotations, QUATERNION, &q);
                write(frames, MATRIX, &flat(&r));
                corotated_strain(&r, &g)
            }
        };
        for axis in 0..3 {
            strain = stretch[axis][axis].magnitude_where(there).max(strain);
        }
        let dj = volume_change(g).1;
        let change = dj.magnitude_where(there);
        swelling = change.min(dj).max(swelling);
        shrinking = change.min(zero.sub(dj)).max(shrinking);
    };
    // SAFETY: as the caller promises.
    unsafe { for_each_row(bricks, brick, u, visit) };
    let most = |eight: L| {
        let mut numbers = [L::Real::default(); 8];
        // SAFETY: eight numbers.
        unsafe { eight.store(numbers.as_mut_ptr()) };
        numbers.iter().map(|x| x.to_f64() as f32).fold(0.0, f32::max)
    };
    Deformed { strain: most(strain), swelling: most(swelling), shrinking: most(shrinking) }
}
