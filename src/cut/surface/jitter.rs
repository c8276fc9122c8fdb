//! Exact predicates, and points moved by next to nothing so that no decision is a tie.

use robust::{Coord3D, orient3d};

use crate::math::Vec3;

/// How far decisions take a point to be from where it is, in cells.
const JITTER: f64 = 1e-7;

/// A small displacement in cells, the same whenever a point of this name is asked for with this seed.
pub fn jitter(name: [i64; 4], seed: u64) -> Vec3 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x2545_f491_4f6c_dd1d;
    let mut mix = |x: u64| {
        // The finaliser of SplitMix64.
        state = (state ^ x).wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        state = z ^ z >> 31;
        state
    };
    for part in name {
        mix(part as u64);
    }
    Vec3::from_fn(|_, _| JITTER * ((mix(0) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0))
}

/// Six times the volume between a point and a triangle: positive exactly where the triangle faces the point. Its sign is exact.
pub fn above([a, b, c]: [Vec3; 3], p: Vec3) -> f64 {
    let [a, b, c, p] = [a, b, c, p].map(|v| Coord3D { x: v.x, y: v.y, z: v.z });
    -orient3d(a, b, c, p)
}

/// A tie that the jitter has not broken, or what rounding has made inconsistent: another jitter may do.
#[derive(Debug)]
pub struct Tie;

/// How a segment passes a triangle.
pub struct Passage {
    /// Whether it passes from behind the triangle to its front.
    pub is_upward: bool,
    /// Where, as a share of the segment.
    pub share: f64,
    /// Where, as weights of the triangle's corners.
    pub weights: [f64; 3],
}

/// How the segment from `a` to `b` passes a triangle, if it does.
pub fn passage(triangle: [Vec3; 3], a: Vec3, b: Vec3) -> Result<Option<Passage>, Tie> {
    let (low, high) = (above(triangle, a), above(triangle, b));
    if low == 0.0 || high == 0.0 {
        return Err(Tie);
    }
    if (low > 0.0) == (high > 0.0) {
        return Ok(None);
    }
    let [p, q, r] = triangle;
    let around = [above([a, b, q], r), above([a, b, r], p), above([a, b, p], q)];
    if around.contains(&0.0) {
        return Err(Tie);
    }
    if around.iter().any(|&x| (x > 0.0) != (around[0] > 0.0)) {
        return Ok(None);
    }
    let sum: f64 = around.iter().sum();
    Ok(Some(Passage { is_upward: high > 0.0, share: low / (low - high), weights: around.map(|x| x / sum) }))
}
