//! Lines, areas, words and legends on a finished picture.

use std::path::Path;

use ab_glyph::{Font, FontRef, PxScale, ScaleFont};
use anyhow::Context;
use tiny_skia::{Color, FillRule, Paint, PathBuilder, Pixmap, PremultipliedColorU8, Rect, Stroke, Transform};

use super::colour::{Colour, of_quantity, to_srgb};

/// Ink for words and lines, in sRGB.
pub const INK: [u8; 3] = [34, 38, 44];

/// Which end of a text its position names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// The left end.
    Start,
    /// The middle.
    Middle,
}

/// A picture under work.
#[derive(Debug)]
pub struct Canvas {
    pixmap: Pixmap,
    font: FontRef<'static>,
}

impl Canvas {
    /// A picture from linear light at twice its size: each pixel is the mean of four.
    pub fn from_light(lit: &[Colour], width: usize, height: usize) -> anyhow::Result<Self> {
        let mut pixmap = Pixmap::new(width as u32, height as u32).context("a picture needs a size")?;
        for (index, out) in pixmap.pixels_mut().iter_mut().enumerate() {
            let (column, row) = (index % width, index / width);
            let at = |dx: usize, dy: usize| lit[(2 * row + dy) * 2 * width + 2 * column + dx];
            let four = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
            let [r, g, b] =
                std::array::from_fn(|c| to_srgb(four.iter().map(|f| f[c].min(1.0)).sum::<f32>() / 4.0));
            *out = PremultipliedColorU8::from_rgba(r, g, b, 255).context("an opaque colour")?;
        }
        let font = FontRef::try_from_slice(dejavu::sans::regular()).context("the built-in font")?;
        Ok(Self { pixmap, font })
    }

    /// Red, green and blue of every pixel in sRGB `[height × width × 3]`.
    #[allow(dead_code)]
    pub fn rgb(&self) -> Vec<u8> {
        self.pixmap.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]).collect()
    }

    /// Writes a PNG file.
    pub fn save(&self, path: &Path) -> anyhow::Result<()> {
        self.pixmap.save_png(path).with_context(|| format!("cannot write {}", path.display()))
    }

    /// One line of text; `y` is its baseline. Returns its width.
    pub fn text(&mut self, text: &str, [x, y]: [f32; 2], size: f32, anchor: Anchor, ink: [u8; 3]) -> f32 {
        let font = self.font.clone();
        let scaled = font.as_scaled(PxScale::from(size * 1.18));
        let width: f32 = text.chars().map(|c| scaled.h_advance(scaled.glyph_id(c))).sum();
        let mut pen = match anchor {
            Anchor::Start => x,
            Anchor::Middle => x - width / 2.0,
        };
        for character in text.chars() {
            let id = scaled.glyph_id(character);
            let glyph = id.with_scale_and_position(scaled.scale, ab_glyph::point(pen, y));
            if let Some(outline) = font.outline_glyph(glyph) {
                let corner = outline.px_bounds().min;
                outline.draw(|dx, dy, cover| {
                    self.blend(corner.x as i64 + i64::from(dx), corner.y as i64 + i64::from(dy), ink, cover);
                });
            }
            pen += scaled.h_advance(id);
        }
        width
    }

    fn blend(&mut self, x: i64, y: i64, ink: [u8; 3], cover: f32) {
        let (width, height) = (i64::from(self.pixmap.width()), i64::from(self.pixmap.height()));
        if !(0..width).contains(&x) || !(0..height).contains(&y) {
            return;
        }
        let pixel = &mut self.pixmap.pixels_mut()[(y * width + x) as usize];
        let old = [pixel.red(), pixel.green(), pixel.blue()];
        let cover = cover.clamp(0.0, 1.0);
        let [r, g, b] = std::array::from_fn(|c| {
            (f32::from(old[c]) * (1.0 - cover) + f32::from(ink[c]) * cover).round() as u8
        });
        if let Some(mixed) = PremultipliedColorU8::from_rgba(r, g, b, 255) {
            *pixel = mixed;
        }
    }

    /// Lines between pairs of points.
    pub fn lines(&mut self, lines: &[[[f32; 2]; 2]], width: f32, ink: [u8; 3], opacity: u8) {
        let mut path = PathBuilder::new();
        for [from, to] in lines {
            path.move_to(from[0], from[1]);
            path.line_to(to[0], to[1]);
        }
        let Some(path) = path.finish() else { return };
        let stroke = Stroke { width, line_cap: tiny_skia::LineCap::Round, ..Stroke::default() };
        self.pixmap.stroke_path(&path, &paint(ink, opacity), &stroke, Transform::identity(), None);
    }

    /// A filled polygon.
    pub fn polygon(&mut self, corners: &[[f32; 2]], ink: [u8; 3], opacity: u8) {
        let mut path = PathBuilder::new();
        for (index, &[x, y]) in corners.iter().enumerate() {
            if index == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
        }
        path.close();
        let Some(path) = path.finish() else { return };
        self.pixmap.fill_path(&path, &paint(ink, opacity), FillRule::Winding, Transform::identity(), None);
    }

    /// An arrow.
    pub fn arrow(&mut self, from: [f32; 2], to: [f32; 2], width: f32, ink: [u8; 3]) {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let length = dx.hypot(dy).max(1e-3);
        let (ux, uy) = (dx / length, dy / length);
        let head = (5.0 * width).min(length);
        let neck = [to[0] - ux * head, to[1] - uy * head];
        let side = 2.2 * width;
        self.lines(&[[from, neck]], width, ink, 255);
        let barbs = [[neck[0] - uy * side, neck[1] + ux * side], [neck[0] + uy * side, neck[1] - ux * side]];
        self.polygon(&[to, barbs[0], barbs[1]], ink, 255);
    }

    fn rectangle(&mut self, [x, y, width, height]: [f32; 4], ink: [u8; 3]) {
        if let Some(rectangle) = Rect::from_xywh(x, y, width, height) {
            self.pixmap.fill_rect(rectangle, &paint(ink, 255), Transform::identity(), None);
        }
    }

    /// Names of materials beside their colours.
    pub fn legend(&mut self, [x, y]: [f32; 2], entries: &[(String, Colour)]) {
        self.text("Tissue", [x, y], 17.0, Anchor::Start, INK);
        for (row, (name, colour)) in entries.iter().enumerate() {
            let top = y + 16.0 + 27.0 * row as f32;
            self.rectangle([x, top, 18.0, 18.0], INK);
            self.rectangle([x + 1.0, top + 1.0, 16.0, 16.0], colour.map(to_srgb));
            self.text(name, [x + 28.0, top + 15.0], 15.0, Anchor::Start, INK);
        }
    }

    /// A bar of the ramp from 0 to `top_value`.
    pub fn colour_bar(&mut self, [x, y]: [f32; 2], title: &str, unit: &str, top_value: f64) {
        let height = 300_u16;
        self.text(title, [x, y], 17.0, Anchor::Start, INK);
        let top = y + 18.0;
        self.rectangle([x - 1.0, top - 1.0, 26.0, f32::from(height) + 2.0], INK);
        for row in 0..height {
            let value = 1.0 - (f32::from(row) + 0.5) / f32::from(height);
            self.rectangle([x, top + f32::from(row), 24.0, 1.0], of_quantity(value).map(to_srgb));
        }
        for tick in 0..=4_u8 {
            let share = f32::from(tick) / 4.0;
            let at = top + f32::from(height) * (1.0 - share);
            self.lines(&[[[x + 25.0, at], [x + 31.0, at]]], 1.2, INK, 255);
            let value = top_value * f64::from(share);
            let digits = usize::from(top_value < 20.0);
            self.text(&format!("{value:.digits$} {unit}"), [x + 37.0, at + 5.0], 14.0, Anchor::Start, INK);
        }
    }

    /// A bar of `length` pixels with its meaning above it.
    pub fn scale_bar(&mut self, [x, y]: [f32; 2], length: f32, meaning: &str) {
        self.lines(&[[[x, y], [x + length, y]]], 3.0, INK, 255);
        self.lines(
            &[[[x, y - 6.0], [x, y + 6.0]], [[x + length, y - 6.0], [x + length, y + 6.0]]],
            2.0,
            INK,
            255,
        );
        self.text(meaning, [x + length / 2.0, y - 10.0], 15.0, Anchor::Middle, INK);
    }
}

fn paint(ink: [u8; 3], opacity: u8) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color(Color::from_rgba8(ink[0], ink[1], ink[2], opacity));
    paint
}
