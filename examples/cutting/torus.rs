//! The torus, cut through at its side.

use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::solver::blade::Blade;

#[path = "../torus/body.rs"]
mod body;

use super::scene::{Scene, View};
pub use body::{RING_M, TUBE_M};

/// Room beside the tissue, in m.
const ASIDE_M: f64 = 0.012;
/// How far the middle of the edge is ahead of its ends, in m.
const BOW_M: f64 = 0.006;
/// Segments of the edge.
const SEGMENTS: u32 = 6;

/// From where it is seen.
pub const VIEW: View = View {
    title: "A torus hangs by its top and is cut",
    back: Vec3::new(0.55, -1.0, 0.3),
    up: Vec3::new(0.0, 0.0, 1.0),
};

/// What the torus is made of, and how tough that is.
#[derive(Clone, Copy, Debug)]
pub struct Torus {
    /// About so many.
    pub cells: u32,
    pub triangles: u32,
    pub young_kpa: f64,
    pub toughness_j_m2: f64,
}

impl Default for Torus {
    fn default() -> Self {
        Self { cells: 6000, triangles: 11_520, young_kpa: 8.0, toughness_j_m2: 1.0 }
    }
}

/// The scene.
pub fn scene(torus: &Torus) -> anyhow::Result<Scene> {
    let cell_m = body::cell_m(torus.cells);
    let model = Arc::new(body::build(cell_m, torus.triangles, torus.young_kpa * 1e3)?);
    let half = TUBE_M + ASIDE_M;
    let point = |n: u32| {
        let across = 2.0 * f64::from(n) / f64::from(SEGMENTS) - 1.0;
        Vec3::new(BOW_M * (across * across - 1.0), half * across, 0.0)
    };
    let blade = Blade { edge: (0..=SEGMENTS).map(point).collect(), toughness_j_m2: torus.toughness_j_m2 };
    // From outside towards the middle of the ring, falling a little.
    let (from, to) = (RING_M + TUBE_M + ASIDE_M, RING_M - TUBE_M - ASIDE_M);
    let way = move |share: f64| {
        let x = from + (to - from) * share;
        Pose::new(Vec3::new(x, 0.0, -0.012 - 0.1 * (from - x)), Vec3::new(0.0, 0.1, 0.0))
    };
    // The cut has some four cells of tissue on each of its edges' cells: a disc, and its rim.
    let across = 2.0 * TUBE_M / cell_m;
    Ok(Scene {
        model,
        gravity_m_s2: Vec3::new(0.0, 0.0, -9.81),
        rests_under_gravity: false,
        cut_nodes: (8.0 * across * across) as usize + 256,
        blade,
        way: Box::new(way),
        rest_s: 1.5,
        cut_s: 2.0,
        after_s: 2.0,
        lift: None,
    })
}
