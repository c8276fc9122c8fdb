//! A chart as a picture file.

use std::path::Path;

use anyhow::{Context, anyhow};
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use tiny_skia::{IntSize, Pixmap};

/// Draws a chart at twice its size and writes it at half of that, which smooths its lines.
pub fn write(
    path: &Path,
    (width, height): (u32, u32),
    draw: impl FnOnce(BitMapBackend) -> Result<(), Box<dyn std::error::Error>>,
) -> anyhow::Result<()> {
    register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular())
        .map_err(|_| anyhow!("the built-in font"))?;
    let twice = (2 * width, 2 * height);
    let mut pixels = vec![0; (twice.0 * twice.1 * 3) as usize];
    draw(BitMapBackend::with_buffer(&mut pixels, twice))
        .map_err(|error| anyhow!("the plot cannot be drawn: {error}"))?;

    let size = IntSize::from_wh(width, height).context("a plot needs a size")?;
    let picture =
        Pixmap::from_vec(halved(&pixels, width, height), size).context("a plot needs its pixels")?;
    picture.save_png(path).with_context(|| format!("cannot write {}", path.display()))
}

/// Mean of each 2 × 2 pixels, with an opaque fourth channel.
fn halved(pixels: &[u8], width: u32, height: u32) -> Vec<u8> {
    let row_bytes = 2 * width as usize * 3;
    let mut half = Vec::with_capacity((width * height * 4) as usize);
    for row in 0..height as usize {
        for column in 0..width as usize {
            let at = |dx: usize, dy: usize, c: usize| {
                u16::from(pixels[(2 * row + dy) * row_bytes + (2 * column + dx) * 3 + c])
            };
            half.extend(
                (0..3).map(|c| ((at(0, 0, c) + at(1, 0, c) + at(0, 1, c) + at(1, 1, c) + 2) / 4) as u8),
            );
            half.push(255);
        }
    }
    half
}
