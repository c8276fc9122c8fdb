//! The torus at rest and hanging, side by side.

use std::path::Path;

use palpate::math::Vec3;
use palpate::sim::SurfaceFrame;

use super::drawing::camera::{Camera, Window};
use super::drawing::canvas::{Anchor, Canvas, INK};
use super::drawing::colour::of_quantity;
use super::drawing::light::Light;
use super::drawing::raster::{Kind, Mesh, Raster, Vertex};
use super::drawing::solid;

/// Size of the picture in pixels.
pub const SIZE: [usize; 2] = [1400, 900];
/// Distance of both from the middle, in m.
const ASIDE_M: f64 = 0.09;

/// The surface at one moment.
#[derive(Clone, Debug)]
pub struct Moment {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    displacements_m: Vec<f32>,
    triangles: Vec<[u32; 3]>,
}

impl Moment {
    /// What a frame shows.
    pub fn of(frame: &SurfaceFrame) -> Self {
        let vector = |v: &[f32; 4]| Vec3::new(v[0].into(), v[1].into(), v[2].into());
        Self {
            positions: frame.positions.iter().map(vector).collect(),
            normals: frame.normals.iter().map(vector).collect(),
            displacements_m: frame.scalars.to_vec(),
            triangles: frame.triangles.to_vec(),
        }
    }

    /// Height of the lowest vertex in m.
    pub fn lowest(&self) -> f64 {
        self.positions.iter().map(|p| p.z).fold(f64::INFINITY, f64::min)
    }

    /// In colours of its displacement up to `top_m`, moved aside.
    fn mesh(&self, aside_m: f64, top_m: f32) -> Mesh {
        let vertex = |v: usize| Vertex {
            position: self.positions[v] + Vec3::x() * aside_m,
            normal: self.normals[v],
            colour: of_quantity(self.displacements_m[v] / top_m),
        };
        Mesh {
            kind: Kind::Tissue,
            vertices: (0..self.positions.len()).map(vertex).collect(),
            triangles: self.triangles.clone(),
            has_shadow: true,
        }
    }
}

/// Draws and writes the picture.
pub fn write(before: &Moment, after: &Moment, young_kpa: f64, path: &Path) -> anyhow::Result<()> {
    let top_m = after.displacements_m.iter().copied().fold(1e-6, f32::max);
    let meshes = [before.mesh(-ASIDE_M, top_m), after.mesh(ASIDE_M, top_m)];
    let bodies: Vec<Vec3> = meshes.iter().flat_map(|mesh| &mesh.vertices).map(|v| v.position).collect();
    let low = after.lowest() - 0.012;
    let mut meshes = meshes.to_vec();
    meshes.push(solid::floor(Vec3::z() * low, Vec3::z(), 0.4));

    let [width, height] = SIZE;
    let window = Window { left: 120.0, top: 220.0, width: 2120.0, height: 1380.0 };
    let camera = Camera::perspective(Vec3::new(0.35, -1.0, 0.28), Vec3::z(), &bodies, window);
    let mut raster = Raster::new(2 * width, 2 * height);
    meshes.iter().for_each(|mesh| raster.draw(&camera, mesh, None));
    let light = Light::new(&camera, Vec3::z(), &meshes, None, &bodies);
    let mut canvas = Canvas::from_light(&light.shine(&raster, &camera), width, height)?;

    canvas.text("A torus hangs by its top", [34.0, 48.0], 25.0, Anchor::Start, INK);
    let sag_mm = (before.lowest() - after.lowest()) * 1e3;
    let words = format!("left at rest, right under its weight: {young_kpa} kPa, {sag_mm:.1} mm lower");
    canvas.text(&words, [34.0, 76.0], 16.0, Anchor::Start, INK);
    canvas.colour_bar([1210.0, 130.0], "Displacement", "mm", f64::from(top_m) * 1e3);
    canvas.save(path)
}
