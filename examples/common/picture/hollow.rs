//! How open each point is to its surroundings: hollows are darker than ridges.

use palpate::math::Vec3;

use super::camera::Camera;
use super::raster::{Kind, Raster, in_bands};

/// Radius within which neighbours darken a point, in metres.
const RADIUS_M: f64 = 0.022;
/// Neighbours looked at for each pixel.
const SAMPLES: usize = 16;
/// The spiral of samples repeats after this many pixels each way, and so do the means that hide it.
const TILE: usize = 4;

/// Openness at half the resolution of a raster.
#[derive(Debug)]
pub struct Hollows {
    width: usize,
    open: Vec<f32>,
}

impl Hollows {
    /// Judged from the depths around each pixel.
    pub fn new(raster: &Raster, view: &Camera) -> Self {
        let (width, height) = (raster.width / 2, raster.height / 2);
        let pixel = |index: usize| &raster.pixels[2 * (index / width) * raster.width + 2 * (index % width)];
        let depths: Vec<f32> = (0..width * height).map(|index| pixel(index).depth).collect();

        let mut rough = vec![1.0; width * height];
        in_bands(&mut rough, width, |first_row, band| {
            for (offset, open) in band.iter_mut().enumerate() {
                let index = first_row * width + offset;
                if pixel(index).kind != Kind::Empty {
                    let stored = pixel(index).normal.map(f64::from);
                    *open = openness(&depths, width, view, index, Vec3::from(stored));
                }
            }
        });

        let mut open = vec![1.0; width * height];
        in_bands(&mut open, width, |first_row, band| {
            for (offset, open) in band.iter_mut().enumerate() {
                *open = mean(&rough, &depths, width, first_row * width + offset);
            }
        });
        Self { width, open }
    }

    /// Openness, 0 to 1, at a pixel of the raster.
    pub fn at(&self, column: usize, row: usize) -> f32 {
        self.open[row / 2 * self.width + column / 2]
    }
}

fn openness(depths: &[f32], width: usize, view: &Camera, index: usize, stored: Vec3) -> f32 {
    let (column, row) = (index % width, index / width);
    let depth = f64::from(depths[index]);
    let centre = [2.0 * column as f64 + 1.0, 2.0 * row as f64 + 1.0];
    let point = view.point(centre[0], centre[1], depth);
    let normal = if stored.dot(&view.towards(point)) < 0.0 { -stored } else { stored };

    // A spiral, turned from pixel to pixel so that its arms do not show.
    let radius = view.pixels_per_metre(depth) * RADIUS_M / 2.0;
    let turn = (column % TILE + TILE * (row % TILE)) as f64 / (TILE * TILE) as f64 * std::f64::consts::TAU;
    let (mut sine, mut cosine) = turn.sin_cos();
    let (step_sine, step_cosine) = 2.4_f64.sin_cos();
    let mut hidden = 0.0;
    for sample in 0..SAMPLES {
        let share = (sample as f64 + 0.5) / SAMPLES as f64;
        let (x, y) = (column as f64 + cosine * radius * share, row as f64 + sine * radius * share);
        (sine, cosine) = (sine * step_cosine + cosine * step_sine, cosine * step_cosine - sine * step_sine);
        if x < 0.0 || y < 0.0 || x as usize >= width {
            continue;
        }
        let Some(&other) = depths.get(y as usize * width + x as usize) else { continue };
        if other == f32::INFINITY {
            continue;
        }
        let way = view.point(2.0 * x.floor() + 1.0, 2.0 * y.floor() + 1.0, other.into()) - point;
        let length = way.norm();
        let rise = (way.dot(&normal) / length.max(1e-9) - 0.08).max(0.0);
        hidden += rise / (1.0 + (length / RADIUS_M).powi(2));
    }
    (1.0 - 1.7 * hidden / SAMPLES as f64).clamp(0.0, 1.0) as f32
}

/// The mean over one tile around a pixel, of what lies at about its depth.
fn mean(rough: &[f32], depths: &[f32], width: usize, index: usize) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for neighbour in 0..TILE * TILE {
        let at = (index + neighbour % TILE + width * (neighbour / TILE)).wrapping_sub(TILE / 2 * (width + 1));
        if let Some(depth) = depths.get(at)
            && (depth - depths[index]).abs() < 0.3 * RADIUS_M as f32
        {
            sum += rough[at];
            count += 1.0;
        }
    }
    if count > 0.0 { sum / count } else { rough[index] }
}
