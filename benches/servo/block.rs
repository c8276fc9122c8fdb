//! A block of soft tissue that a ball presses from above, with and without a stiff inclusion.

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use palpate::error::Result;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::solver::tool::{ToolDesc, ToolMotion};

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

/// Where the top is, world frame, in m: the lowest corner is the origin.
pub const TOP_M: f64 = CELLS[2] as f64 * CELL_M;

/// The middle of the top.
pub fn middle() -> Vec3 {
    Vec3::new(0.5 * CELLS[0] as f64 * CELL_M, 0.5 * CELLS[1] as f64 * CELL_M, TOP_M)
}

/// The block, held at its bottom.
pub fn model(has_tumour: bool) -> Result<Arc<Model>> {
    model_with(has_tumour, RELAXATION_S)
}

/// The same with another viscosity, in s.
pub fn model_with(has_tumour: bool, damping_s: f64) -> Result<Arc<Model>> {
    let centre = middle() - Vec3::z() * TUMOUR_DEPTH_M;
    let label = |n: usize| {
        let cell = [n % CELLS[0], n / CELLS[0] % CELLS[1], n / (CELLS[0] * CELLS[1])];
        let at = Vec3::from_fn(|a, _| (cell[a] as f64 + 0.5) * CELL_M);
        if has_tumour && (at - centre).norm() < TUMOUR_RADIUS_M { 2 } else { 1 }
    };
    let labels = (0..CELLS.iter().product()).map(label).collect();
    let frame = Pose::translation(0.5 * CELL_M, 0.5 * CELL_M, 0.5 * CELL_M);
    let mut build = Build::new(LabelGrid::new(CELLS, Vec3::repeat(CELL_M), frame, labels)?);
    build.uses = BTreeMap::from([
        (1, LabelUse::Tissue(tissue("tissue", YOUNG_PA, damping_s)?)),
        (2, LabelUse::Tissue(tissue("tumour", TUMOUR_PA, damping_s)?)),
    ]);
    build.fixes.push(Fix {
        pose: Pose::identity(),
        half_extents: Vec3::new(1.0, 1.0, 0.1 * CELL_M),
        axes: [true; 3],
    });
    Ok(Arc::new(build.run(&mut |_, _| true)?))
}

fn tissue(name: &str, young_pa: f64, damping_s: f64) -> Result<Material> {
    let elastic = Material::new(name, young_pa, POISSON, DENSITY_KG_M3)?;
    Ok(Material { damping_s, ..elastic })
}

/// The ball.
pub fn ball() -> ToolDesc {
    ToolDesc { friction: FRICTION, ..ToolDesc::sphere(RADIUS_M) }
}

/// Height of the surface that tools meet, which smoothing has moved off the cells' faces, in m.
fn highest(model: &Model) -> f64 {
    let vertices = model.surfaces()[model.contact_surface()].positions.iter();
    let heights = vertices.map(|vertex| model.frame().transform_point(&(*vertex).into()).z);
    heights.fold(f64::NEG_INFINITY, f64::max)
}

/// The ball so deep in the middle of the top, and so far aside along x and y, at a velocity.
pub fn pressed(depth_m: f64, aside_m: [f64; 2], linear_m_s: Vec3) -> ToolMotion {
    static SURFACE_M: OnceLock<f64> = OnceLock::new();
    let surface = *SURFACE_M.get_or_init(|| model(false).map_or(TOP_M, |model| highest(&model)));
    let mut at = middle() + Vec3::new(aside_m[0], aside_m[1], 0.0);
    at.z = surface + RADIUS_M - depth_m;
    ToolMotion { linear_m_s, ..ToolMotion::at(Pose::translation(at.x, at.y, at.z)) }
}
