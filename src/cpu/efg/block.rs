//! The 3 × 3 blocks on A's diagonal, which precondition it.

use super::super::lanes::Lanes;
use crate::math::Mat3;

/// Numbers of a block on A's diagonal: xx, xy, xz, yy, yz, zz.
pub const BLOCK: usize = 6;
/// Such a block.
pub type Block = [f64; BLOCK];

/// A symmetric matrix times a vector.
#[inline(always)]
pub fn applied<L: Lanes>(m: &[L; BLOCK], v: [L; 3]) -> [L; 3] {
    let [xx, xy, xz, yy, yz, zz] = *m;
    [
        xx.fma(v[0], xy.fma(v[1], xz.mul(v[2]))),
        xy.fma(v[0], yy.fma(v[1], yz.mul(v[2]))),
        xz.fma(v[0], yz.fma(v[1], zz.mul(v[2]))),
    ]
}

/// The inverse of a symmetric matrix; of nothing, nothing that is finite and wrong.
#[inline(always)]
pub fn inverted<L: Lanes>(m: [L; BLOCK]) -> [L; BLOCK] {
    let [xx, xy, xz, yy, yz, zz] = m;
    let minor = |a: L, d: L, b: L, c: L| a.mul(d).sub(b.mul(c));
    let (cxx, cxy, cxz) = (minor(yy, zz, yz, yz), minor(xz, yz, xy, zz), minor(xy, yz, xz, yy));
    let determinant = xx.fma(cxx, xy.fma(cxy, xz.mul(cxz)));
    // Places without a node have a matrix of zeros; what they hold is nothing before and after.
    let least = if size_of::<L::Real>() == 4 { f64::from(f32::MIN_POSITIVE) } else { f64::MIN_POSITIVE };
    let scale = L::splat(1.0).div(determinant.max(L::splat(least)));
    [cxx, cxy, cxz, minor(xx, zz, xz, xz), minor(xy, xz, xx, yz), minor(xx, yy, xy, xy)].map(|c| c.mul(scale))
}

/// A symmetric block as a matrix.
pub fn matrix(b: &Block) -> Mat3 {
    Mat3::new(b[0], b[1], b[2], b[1], b[3], b[4], b[2], b[4], b[5])
}
