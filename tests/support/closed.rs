//! Whether a surface is closed.

use std::collections::HashMap;

use palpate::math::Vec3;
use palpate::sim::SurfaceFrame;

/// Points that are nearer to each other are one, in m.
const APART_M: f64 = 2e-7;

/// Triangles but for the places kept for others to come.
pub fn there(triangles: &[[u32; 3]]) -> impl Iterator<Item = &[u32; 3]> {
    triangles.iter().filter(|corners| **corners != [0; 3])
}

/// A surface's points, in double precision.
pub fn points(frame: &SurfaceFrame<'_>) -> Vec<Vec3> {
    frame.positions.iter().map(|p| Vec3::new(p[0].into(), p[1].into(), p[2].into())).collect()
}

/// Names points by where they are: a lip has vertices on both of its sides.
pub fn names(points: &[Vec3]) -> Vec<usize> {
    let mut known: HashMap<[i64; 3], usize> = HashMap::new();
    let place = |p: &Vec3| [0, 1, 2].map(|axis| (p[axis] / APART_M).round() as i64);
    points.iter().enumerate().map(|(n, p)| *known.entry(place(p)).or_insert(n)).collect()
}

/// Twice as many directed edges go one way as come back, where the surface is closed; and six times the volume inside.
pub fn check_closed(frame: &SurfaceFrame<'_>, at: &[Vec3]) -> f64 {
    let names = names(at);
    let mut balance: HashMap<(usize, usize), i64> = HashMap::new();
    let mut volume = 0.0;
    for corners in frame.triangles {
        let [a, b, c] = corners.map(|v| v as usize);
        volume += at[a].cross(&at[b]).dot(&at[c]) / 6.0;
        let edges = [(a, b), (b, c), (c, a)].map(|(from, to)| (names[from], names[to]));
        // Points that are too near to each other to be told apart are one.
        for (from, to) in edges.into_iter().filter(|(from, to)| from != to) {
            *balance.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
        }
    }
    assert!(balance.values().all(|&sum| sum == 0), "the surface has a hole");
    volume
}
