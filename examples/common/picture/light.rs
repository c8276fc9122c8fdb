//! Light: a key light with shadows, the sky and the floor, and a rim.

use palpate::math::Vec3;

use super::camera::{Camera, Window};
use super::colour::{Colour, mix, to_linear};
use super::hollow::Hollows;
use super::raster::{Kind, Mesh, Plane, Raster, in_bands};

/// Edge of the shadow picture in pixels.
const SHADOW_EDGE: usize = 1400;

/// The light of a scene.
#[derive(Debug)]
pub struct Light {
    towards: Vec3,
    up: Vec3,
    camera: Camera,
    /// Distances from the light `[SHADOW_EDGE²]`.
    shadow: Vec<f32>,
}

impl Light {
    /// A light from the viewer's upper left that shines on `meshes`; `points` bound what may throw shadows.
    pub fn new(view: &Camera, up: Vec3, meshes: &[Mesh], cut: Option<Plane>, points: &[Vec3]) -> Self {
        let front = view.back - up * view.back.dot(&up);
        let towards = (up - view.right * 0.55 + front * 0.35).normalize();
        let edge = SHADOW_EDGE as f64;
        let window = Window { left: 2.0, top: 2.0, width: edge - 4.0, height: edge - 4.0 };
        let camera = Camera::parallel(towards, view.right, points, window);
        let mut shadow = Raster::new(SHADOW_EDGE, SHADOW_EDGE);
        meshes.iter().filter(|mesh| mesh.has_shadow).for_each(|mesh| shadow.draw(&camera, mesh, cut));
        let shadow = shadow.pixels.iter().map(|pixel| pixel.depth).collect();
        Self { towards, up, camera, shadow }
    }

    /// The picture in linear light, `[height × width]`.
    pub fn shine(&self, raster: &Raster, view: &Camera) -> Vec<Colour> {
        let hollows = Hollows::new(raster, view);
        let mut lit = vec![[0.0; 3]; raster.pixels.len()];
        in_bands(&mut lit, raster.width, |first_row, band| {
            for (index, colour) in band.iter_mut().enumerate() {
                let (column, row) = (index % raster.width, first_row + index / raster.width);
                *colour = self.pixel(raster, &hollows, view, column, row);
            }
        });
        lit
    }

    fn pixel(&self, raster: &Raster, hollows: &Hollows, view: &Camera, column: usize, row: usize) -> Colour {
        let backdrop = backdrop(row as f32 / raster.height as f32);
        let pixel = &raster.pixels[row * raster.width + column];
        if pixel.kind == Kind::Empty {
            return backdrop;
        }

        // Surfaces seen from behind, inside a body that is cut open, are lit as if they faced the viewer.
        let point = view.point(column as f64 + 0.5, row as f64 + 0.5, pixel.depth.into());
        let viewer = view.towards(point);
        let stored = Vec3::new(pixel.normal[0].into(), pixel.normal[1].into(), pixel.normal[2].into());
        let unit = stored.try_normalize(1e-9).unwrap_or(viewer);
        let normal = if unit.dot(&viewer) < 0.0 { -unit } else { unit };

        let sun = self.sun(point + normal * 0.0015);
        let open = hollows.at(column, row);
        match pixel.kind {
            Kind::Empty => backdrop,
            Kind::Floor => backdrop.map(|c| c * (0.62 + 0.38 * sun) * (0.5 + 0.5 * open)),
            Kind::Tissue => self.surface(pixel.colour, normal, viewer, sun, open, 0.10),
            Kind::Solid => self.surface(pixel.colour, normal, viewer, sun, open, 0.35),
            Kind::Cut => pixel.colour.map(|c| c * (0.80 + 0.12 * sun) * (0.55 + 0.45 * open)),
        }
    }

    fn surface(&self, colour: Colour, normal: Vec3, viewer: Vec3, sun: f32, open: f32, gloss: f32) -> Colour {
        let key = ((normal.dot(&self.towards) as f32 + 0.12) / 1.12).max(0.0) * sun;
        let sky = 0.5 + 0.5 * normal.dot(&self.up) as f32;
        let half = (self.towards + viewer).normalize();
        let shine = (normal.dot(&half).max(0.0) as f32).powi(36) * sun * gloss;
        let rim = (1.0 - normal.dot(&viewer) as f32).powi(3) * open * 0.16;

        let fill = 0.20 * normal.dot(&viewer) as f32;
        let ambient = mix([0.21, 0.18, 0.16], [0.36, 0.39, 0.43], sky);
        std::array::from_fn(|c| {
            let warm = [0.74, 0.70, 0.65][c] * key;
            colour[c] * ((ambient[c] + fill) * open + warm * (0.35 + 0.65 * open))
                + shine
                + rim * 0.5 * (colour[c] + 0.5)
        })
    }

    /// How much of the key light reaches a point, from nine looks at the shadow picture.
    fn sun(&self, point: Vec3) -> f32 {
        let [x, y, depth] = self.camera.project(point);
        let mut lit = 0.0;
        for look in 0..9 {
            let spread = 1.6;
            let [column, row] = [x + f64::from(look % 3 - 1) * spread, y + f64::from(look / 3 - 1) * spread];
            let edge = SHADOW_EDGE as f64;
            let is_inside = (0.0..edge).contains(&column) && (0.0..edge).contains(&row);
            let index = row.max(0.0) as usize * SHADOW_EDGE + column.max(0.0) as usize;
            if !is_inside || f64::from(self.shadow[index]) > depth - 0.0015 {
                lit += 1.0;
            }
        }
        lit / 9.0
    }
}

/// The colour behind everything.
fn backdrop(down: f32) -> Colour {
    mix([246, 247, 248].map(to_linear), [206, 210, 214].map(to_linear), down)
}
