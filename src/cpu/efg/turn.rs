//! What cells know of their own frame: how far they are turned, or deformed.

use super::super::lanes::{Lanes, Octet, Real};
use super::super::nodes::{BRICK_ROWS, Bricks};
use super::gather::{CellRow, Staged, materials};
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

/// Writes the frames of eight cells.
#[inline(always)]
unsafe fn write<L: Lanes>(frames: *mut Octet<L::Real>, at: CellRow, matrix: &Matrix<L>) {
    let first = at.at(MATRIX);
    for i in 0..3 {
        for j in 0..3 {
            // SAFETY: the caller's row exists and is its own.
            unsafe { matrix[i][j].store(frames.add(first + (3 * i + j) * BRICK_ROWS).cast()) };
        }
    }
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
    let mut is_there = [L::Real::splat(1.0); 16];
    is_there[0] = L::Real::splat(0.0);
    // SAFETY: as the caller promises.
    let staged = unsafe { Staged::<L>::load(bricks, brick, u) };
    for row in 0..BRICK_ROWS {
        let at = CellRow { brick, row };
        let materials = materials(bricks, at);
        if u64::from_le_bytes(*materials) == 0 {
            continue;
        }
        let (g, _) = gradient::<L>(&staged.corners(row % 4 + 1, row / 4 + 1), L::splat(inverse_4h));
        let (there, f) = (L::look_up(&is_there, materials), deformation(&g));
        let stretch = match elasticity {
            Elasticity::Linear => g,
            Elasticity::StVenantKirchhoff => {
                // SAFETY: this brick's cells are this thread's.
                unsafe { write(frames, at, &f) };
                green_strain(&g)
            }
            Elasticity::Corotated => {
                // SAFETY: as above.
                unsafe {
                    let first = rotations.add(at.at(QUATERNION));
                    let mut q = [zero; QUATERNION];
                    for n in 0..QUATERNION {
                        q[n] = L::load(first.add(n * BRICK_ROWS).cast());
                    }
                    for _ in 0..TURNS {
                        q = turn_towards(q, &f);
                    }
                    for n in 0..QUATERNION {
                        q[n].store(first.add(n * BRICK_ROWS).cast());
                    }
                    let r = rotation_matrix(q);
                    write(frames, at, &r);
                    corotated_strain(&r, &g)
                }
            }
        };
        for axis in 0..3 {
            strain = stretch[axis][axis].magnitude_where(there).max(strain);
        }
        let dj = volume_change(g).1;
        let change = dj.magnitude_where(there);
        swelling = change.min(dj).max(swelling);
        shrinking = change.min(zero.sub(dj)).max(shrinking);
    }
    let most = |eight: L| {
        let mut numbers = [L::Real::default(); 8];
        // SAFETY: eight numbers.
        unsafe { eight.store(numbers.as_mut_ptr()) };
        numbers.iter().map(|x| x.to_f64() as f32).fold(0.0, f32::max)
    };
    Deformed { strain: most(strain), swelling: most(swelling), shrinking: most(shrinking) }
}
