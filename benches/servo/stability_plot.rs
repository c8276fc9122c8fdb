//! The map of stability as a picture: one field for each coupling, four maps.

use std::error::Error;
use std::path::Path;

use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use tiny_skia::{IntSize, Pixmap};

use super::stability::{DAMPINGS, LEAST_J, STIFFNESSES, Stability};

/// Pixels.
const SIZE: (u32, u32) = (1100, 900);
const FONT: &str = "sans";

/// Draws all of them.
pub fn draw(path: &Path, all: &[Stability]) -> Result<(), Box<dyn Error>> {
    register_font(FONT, FontStyle::Normal, dejavu::sans::regular())
        .map_err(|_| "the font that comes with the bench is no font")?;
    let mut pixels = vec![0; (SIZE.0 * SIZE.1 * 3) as usize];
    paint(all, BitMapBackend::with_buffer(&mut pixels, SIZE)).map_err(|error| error.to_string())?;
    let opaque = pixels.chunks_exact(3).flat_map(|pixel| [pixel[0], pixel[1], pixel[2], u8::MAX]).collect();
    let size = IntSize::from_wh(SIZE.0, SIZE.1).ok_or("a picture needs a size")?;
    Ok(Pixmap::from_vec(opaque, size).ok_or("a picture needs its pixels")?.save_png(path)?)
}

fn paint(all: &[Stability], backend: BitMapBackend<'_>) -> Result<(), Box<dyn Error>> {
    let area = backend.into_drawing_area();
    area.fill(&WHITE)?;
    let title = format!("Least energy of the loop, in J; green where it is at least {LEAST_J:.0e} J");
    let area = area.margin(12, 0, 0, 0).titled(&title, (FONT, 26))?;
    let maps = [("none", false), ("none", true), ("loose", false), ("loose", true)];
    for (part, (hand, has_chain)) in area.split_evenly((2, 2)).iter().zip(maps) {
        let hand_words = if hand == "none" { "a weight, no hand" } else { "a loose hand" };
        let chain_words = if has_chain { "with the chain" } else { "law and coupling alone" };
        let mut chart = ChartBuilder::on(part)
            .caption(format!("{hand_words}, {chain_words}"), (FONT, 20))
            .margin(12)
            .x_label_area_size(44)
            .y_label_area_size(60)
            .build_cartesian_2d(
                (0..STIFFNESSES.len() as i32 - 1).into_segmented(),
                (0..DAMPINGS.len() as i32 - 1).into_segmented(),
            )?;
        let of = |values: &'static [f64]| {
            move |at: &SegmentValue<i32>| match at {
                SegmentValue::CenterOf(i) => {
                    values.get(*i as usize).map_or(String::new(), ToString::to_string)
                }
                SegmentValue::Exact(_) | SegmentValue::Last => String::new(),
            }
        };
        chart
            .configure_mesh()
            .disable_mesh()
            .x_labels(STIFFNESSES.len())
            .y_labels(DAMPINGS.len())
            .x_label_formatter(&of(&STIFFNESSES))
            .y_label_formatter(&of(&DAMPINGS))
            .x_desc("K, N/m")
            .y_desc("B, N s/m")
            .label_style((FONT, 16))
            .draw()?;
        for found in all.iter().filter(|found| found.hand == hand && found.has_chain == has_chain) {
            let at = |values: &[f64], value: f64| values.iter().position(|x| *x == value).unwrap_or(0) as i32;
            let (i, j) = (at(&STIFFNESSES, found.stiffness_n_per_m), at(&DAMPINGS, found.damping_n_s_per_m));
            // The field's corner after the last is called that.
            let corner = |at: i32, count: usize| {
                if at as usize == count { SegmentValue::Last } else { SegmentValue::Exact(at) }
            };
            let low = (SegmentValue::Exact(i), SegmentValue::Exact(j));
            let high = (corner(i + 1, STIFFNESSES.len()), corner(j + 1, DAMPINGS.len()));
            let field = [low, high.clone()];
            chart.draw_series([Rectangle::new(field.clone(), colour(found).filled())])?;
            chart.draw_series([Rectangle::new(field, WHITE)])?;
            let words =
                if found.has_diverged { "torn".into() } else { format!("{:.0e}", found.least_energy_j) };
            let text = Text::new(words, (12, 22), (FONT, 15));
            chart.draw_series([EmptyElement::at((SegmentValue::Exact(i), high.1)) + text])?;
        }
    }
    area.present()?;
    Ok(())
}

/// Green where the loop is passive, from yellow to red by how far it is not.
fn colour(found: &Stability) -> RGBColor {
    if found.is_passive {
        return RGBColor(150, 210, 150);
    }
    // Four decades.
    let share = ((found.least_energy_j / LEAST_J).log10() / 4.0).clamp(0.0, 1.0);
    RGBColor(250, (220.0 - 140.0 * share) as u8, (140.0 - 60.0 * share) as u8)
}
