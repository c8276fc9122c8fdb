//! A block of soft tissue that a ball presses from above, with or without something in it: held at its bottom, its lowest corner at the world's
//! origin.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::error::Result;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};

/// Whether a cell, counted along x, y, z, is one of a thing's.
pub type IsInside = fn([usize; 3]) -> bool;

/// What it is made of.
pub struct Block {
    /// Cells along x, y, z, and the edge of one in m.
    pub cells: [usize; 3],
    pub cell_m: f64,
    pub soft: Material,
    /// What lies in it, and in which cells.
    pub inclusion: Option<(LabelUse, IsInside)>,
}

/// The block, and where it is touched.
#[derive(Clone, Debug)]
pub struct Pressed {
    pub model: Arc<Model>,
    /// The middle of its top, at the height of the surface that tools meet, which smoothing has moved off the cells' faces.
    pub middle_m: Vec3,
}

/// Soft tissue with a little viscosity.
pub fn tissue(young_pa: f64, poisson: f64, density_kg_m3: f64, damping_s: f64) -> Result<Material> {
    Ok(Material { damping_s, ..Material::new("tissue", young_pa, poisson, density_kg_m3)? })
}

impl Block {
    pub fn build(self) -> Result<Pressed> {
        let ([nx, ny, nz], h) = (self.cells, self.cell_m);
        let is_inside = |cell| self.inclusion.as_ref().is_some_and(|(_, is_inside)| is_inside(cell));
        let label = |n: usize| 1 + u16::from(is_inside([n % nx, n / nx % ny, n / (nx * ny)]));
        let labels = (0..nx * ny * nz).map(label).collect();
        let frame = Pose::translation(0.5 * h, 0.5 * h, 0.5 * h);
        let mut build = Build::new(LabelGrid::new(self.cells, Vec3::repeat(h), frame, labels)?);
        build.cell_m = Some(h);
        build.uses = BTreeMap::from([(1, LabelUse::Tissue(self.soft.clone()))]);
        build.uses.extend(self.inclusion.iter().map(|(use_of, _)| (2, use_of.clone())));
        build.fixes.push(Fix {
            pose: Pose::identity(),
            half_extents: Vec3::new(1.0, 1.0, 0.1 * h),
            axes: [true; 3],
        });
        let model = Arc::new(build.run(&mut |_, _| true)?);
        let surface = model.surfaces()[model.contact_surface()].positions.iter();
        let heights = surface.map(|vertex| model.frame().transform_point(&(*vertex).into()).z);
        let highest = heights.fold(f64::NEG_INFINITY, f64::max);
        Ok(Pressed { middle_m: Vec3::new(0.5 * nx as f64 * h, 0.5 * ny as f64 * h, highest), model })
    }
}

impl Pressed {
    /// Where a ball of this radius is that lies so deep in the top, so far aside from its middle along x and y; all in m.
    pub fn at(&self, radius_m: f64, depth_m: f64, aside_m: [f64; 2]) -> Pose {
        let at = self.middle_m + Vec3::new(aside_m[0], aside_m[1], radius_m) - Vec3::z() * depth_m;
        Pose::translation(at.x, at.y, at.z)
    }
}
