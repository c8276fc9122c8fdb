//! A block of soft tissue that a ball presses from above, with and without a stiff inclusion.

use std::sync::{Arc, OnceLock};

use palpate::error::Result;
use palpate::math::Vec3;
use palpate::model::{LabelUse, Model};
use palpate::solver::tool::{ToolDesc, ToolMotion};

use super::pressed_block::{Block, Pressed, tissue};

/// Cells along x, y, z and their edge in m: 60 mm square, 40 mm high.
pub const CELLS: [usize; 3] = [12, 12, 8];
pub const CELL_M: f64 = 5e-3;
/// Soft tissue with a little viscosity.
pub const YOUNG_PA: f64 = 5e3;
pub const POISSON: f64 = 0.45;
pub const DENSITY_KG_M3: f64 = 1060.0;
pub const RELAXATION_S: f64 = 2e-4;
/// The ball.
pub const RADIUS_M: f64 = 10e-3;
pub const FRICTION: f64 = 0.3;
/// A tumour of 12 mm, ten times as stiff, 6 mm below the surface.
const TUMOUR_PA: f64 = 50e3;
const TUMOUR_RADIUS_M: f64 = 6e-3;
const TUMOUR_DEPTH_M: f64 = 12e-3;

/// The block, held at its bottom.
pub fn model(has_tumour: bool) -> Result<Arc<Model>> {
    model_with(has_tumour, RELAXATION_S)
}

/// The same with another viscosity, in s.
pub fn model_with(has_tumour: bool, damping_s: f64) -> Result<Arc<Model>> {
    build(has_tumour, damping_s).map(|pressed| pressed.model)
}

fn build(has_tumour: bool, damping_s: f64) -> Result<Pressed> {
    let of = |young_pa: f64| tissue(young_pa, POISSON, DENSITY_KG_M3, damping_s);
    let tumour = LabelUse::Tissue(of(TUMOUR_PA)?);
    let inclusion = has_tumour.then_some((tumour, is_tumour as fn(_) -> _));
    Block { cells: CELLS, cell_m: CELL_M, soft: of(YOUNG_PA)?, inclusion }.build()
}

fn is_tumour(cell: [usize; 3]) -> bool {
    let at = Vec3::from_fn(|a, _| (cell[a] as f64 + 0.5) * CELL_M);
    let [nx, ny, nz] = CELLS.map(|n| n as f64 * CELL_M);
    (at - Vec3::new(0.5 * nx, 0.5 * ny, nz - TUMOUR_DEPTH_M)).norm() < TUMOUR_RADIUS_M
}

/// The ball.
pub fn ball() -> ToolDesc {
    ToolDesc { friction: FRICTION, ..ToolDesc::sphere(RADIUS_M) }
}

/// The ball so deep in the middle of the top, and so far aside along x and y, at a velocity.
pub fn pressed(depth_m: f64, aside_m: [f64; 2], linear_m_s: Vec3) -> ToolMotion {
    static PLAIN: OnceLock<Pressed> = OnceLock::new();
    let plain = PLAIN.get_or_init(|| build(false, RELAXATION_S).expect("a block of sound tissue"));
    ToolMotion { linear_m_s, ..ToolMotion::at(plain.at(RADIUS_M, depth_m, aside_m)) }
}
