//! The torus: a closed mesh, and the tissue inside it.

use std::f64::consts::TAU;

use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::mesh::TriangleMesh;
use palpate::model::{Build, Fix, LabelUse, Model, SurfaceSource, solid};

/// Radius of the circle in the middle of the ring, in m. It stands upright, around the y axis.
pub const RING_M: f64 = 0.05;
/// Radius of the ring itself.
pub const TUBE_M: f64 = 0.02;
/// Quadrilaterals along the ring, for each around it.
const SLENDER: f64 = 2.5;

/// The mesh, seen from outside, of about so many triangles.
fn mesh(triangles: u32) -> TriangleMesh {
    let around = (f64::from(triangles) / (2.0 * SLENDER)).sqrt().round();
    let [along, around] = [(SLENDER * around).round(), around].map(|n| n as u32);
    let place = |n: u32| {
        let (u, v) =
            (f64::from(n / around) / f64::from(along) * TAU, f64::from(n % around) / f64::from(around) * TAU);
        let out = RING_M + TUBE_M * v.cos();
        Vec3::new(out * u.cos(), TUBE_M * v.sin(), out * u.sin())
    };
    let vertex = |u: u32, v: u32| u % along * around + v % around;
    let faces = (0..along).flat_map(|u| (0..around).map(move |v| (u, v)));
    let triangles = faces.flat_map(|(u, v)| {
        let [a, b, c, d] = [vertex(u, v), vertex(u, v + 1), vertex(u + 1, v + 1), vertex(u + 1, v)];
        [[a, b, d], [b, c, d]]
    });
    TriangleMesh {
        positions: (0..along * around).map(place).collect(),
        triangles: triangles.collect(),
        uvs: Vec::new(),
    }
}

/// The edge length, in m, of as many cells as fill the torus.
#[allow(dead_code)]
pub fn cell_m(cells: u32) -> f64 {
    (TAU * std::f64::consts::PI * RING_M * TUBE_M * TUBE_M / f64::from(cells)).cbrt()
}

/// The torus in cells, with a surface of about so many triangles, held by the uppermost part of the ring.
pub fn build(cell_m: f64, triangles: u32, young_pa: f64) -> anyhow::Result<Model> {
    let mesh = mesh(triangles);
    let mut build = Build::new(LabelGrid::from_solid(&mesh, cell_m)?);
    build.uses.insert(0, LabelUse::Empty);
    build.uses.insert(solid::SOLID, LabelUse::Tissue(Material::new("tissue", young_pa, 0.45, 1000.0)?));
    build.surfaces = vec![SurfaceSource::Mesh(mesh)];
    let (low, high) = (RING_M + 0.3 * TUBE_M, RING_M + 2.0 * TUBE_M);
    build.fixes = vec![Fix {
        pose: Pose::translation(0.0, 0.0, 0.5 * (low + high)),
        half_extents: Vec3::new(1.0, 1.0, 0.5 * (high - low)),
        axes: [true; 3],
    }];
    Ok(build.run(&mut |_, _| true)?)
}
