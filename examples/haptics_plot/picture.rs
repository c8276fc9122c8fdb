//! Panels above each other, over one time: depth, force, age, and a row for each flag that was ever set.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::record::Tick;

/// Width and height in pixels.
pub const SIZE: (u32, u32) = (1400, 1000);

type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;
/// A name, a colour, and values over time in s.
type Line = (&'static str, RGBColor, Vec<(f64, f64)>);
type Drawn = Result<(), Box<dyn std::error::Error>>;

const DEVICE: RGBColor = RGBColor(40, 98, 168);
const TOOL: RGBColor = RGBColor(232, 140, 40);
const FORCE: RGBColor = RGBColor(196, 62, 44);
const AGE: RGBColor = RGBColor(70, 130, 70);
const LATENCY: RGBColor = RGBColor(130, 90, 160);

/// What was done to a force: the bit of PLP_SERVO_, what to call it, and the colour of its time.
const FLAGS: [(u32, &str, RGBColor); 13] = [
    (1 << 6, "waiting", RGBColor(150, 150, 150)),
    (1 << 7, "ramping", RGBColor(120, 170, 215)),
    (1 << 12, "damped", RGBColor(150, 120, 200)),
    (1 << 8, "averaged", RGBColor(240, 190, 70)),
    (1 << 9, "clamped", RGBColor(230, 130, 50)),
    (1 << 10, "slewed", RGBColor(230, 90, 70)),
    (1 << 3, "held", RGBColor(70, 170, 170)),
    (1 << 4, "decaying", RGBColor(30, 120, 130)),
    (1 << 11, "released", RGBColor(110, 110, 110)),
    (1 << 1, "paused", RGBColor(90, 90, 90)),
    (1 << 5, "too fast", RGBColor(190, 40, 120)),
    (1 << 2, "stopped", RGBColor(170, 30, 30)),
    (1, "not finite", RGBColor(110, 0, 0)),
];

/// Heights of the panels at twice the picture's size; the flags get the rest.
const DEPTH_HEIGHT: u32 = 560;
const FORCE_HEIGHT: u32 = 560;
const AGE_HEIGHT: u32 = 400;
const LEFT: u32 = 210;

/// Draws all panels.
pub fn draw(ticks: &[Tick], backend: BitMapBackend) -> Drawn {
    let area = backend.into_drawing_area();
    area.fill(&WHITE)?;
    let area = area.margin(20, 10, 10, 40);
    let (depth, rest) = area.split_vertically(DEPTH_HEIGHT);
    let (force, rest) = rest.split_vertically(FORCE_HEIGHT);
    let (age, flags) = rest.split_vertically(AGE_HEIGHT);

    let device = ("device", DEVICE, line(ticks, |t| Some(1e3 * t.depth_m)));
    let tool = ("tool that hangs on it", TOOL, line(ticks, |t| Some(1e3 * t.tool_m)));
    panel(&depth, ticks, "depth in mm", &[device, tool])?;
    panel(&force, ticks, "force in N", &[("on the hand", FORCE, line(ticks, |t| Some(t.force_n)))])?;
    let age_ms = line(ticks, |t| (t.age_s >= 0.0).then_some(1e3 * t.age_s));
    let latency_ms = line(ticks, |t| (t.latency_s > 0.0).then_some(1e3 * t.latency_s));
    let old = ("age of the force", AGE, highest(&age_ms));
    let late = ("from pose to force", LATENCY, highest(&latency_ms));
    panel(&age, ticks, "age in ms", &[late, old])?;
    flag_rows(&flags, ticks)?;
    area.present()?;
    Ok(())
}

/// One quantity over time.
fn line(ticks: &[Tick], of: impl Fn(&Tick) -> Option<f64>) -> Vec<(f64, f64)> {
    ticks.iter().filter_map(|t| of(t).map(|value| (t.time_s, value))).collect()
}

/// The largest of each few: what changes with every tick would be a block of colour, and the worst is what matters.
fn highest(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let few = points.len().div_ceil(SIZE.0 as usize / 2).max(1);
    let most = |some: &[(f64, f64)]| some.iter().map(|p| p.1).fold(f64::MIN, f64::max);
    points.chunks(few).map(|some| (some[0].0, most(some))).collect()
}

fn times(ticks: &[Tick]) -> std::ops::Range<f64> {
    ticks[0].time_s..ticks[ticks.len() - 1].time_s
}

/// Lines over the times of flags as shades.
fn panel(area: &Area, ticks: &[Tick], name: &str, lines: &[Line]) -> Drawn {
    let values = || lines.iter().flat_map(|(_, _, points)| points.iter().map(|p| p.1));
    let (low, high) = values().fold((0.0_f64, 1e-3_f64), |(low, high), v| (low.min(v), high.max(v)));
    let room = 0.06 * (high - low);
    let low = if low < -room { low - room } else { low.min(0.0) };
    let mut chart = ChartBuilder::on(area)
        .margin_top(10)
        .x_label_area_size(14)
        .y_label_area_size(LEFT)
        .build_cartesian_2d(times(ticks), low..high + room)?;
    for (bit, _, colour) in FLAGS {
        for (from, to) in spans(ticks, bit) {
            chart
                .plotting_area()
                .draw(&Rectangle::new([(from, low), (to, high + room)], colour.mix(0.16).filled()))?;
        }
    }
    chart
        .configure_mesh()
        .x_labels(11)
        .x_label_formatter(&|_| String::new())
        .y_labels(6)
        .y_desc(name)
        .axis_desc_style(("sans-serif", 36))
        .label_style(("sans-serif", 30))
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(205, 205, 205).mix(0.6))
        .draw()?;
    for (name, colour, points) in lines {
        let colour = *colour;
        // Piece by piece: where a line goes steeply up and down, its corners would stick out.
        let pieces =
            points.windows(2).map(|pair| PathElement::new([pair[0], pair[1]], colour.stroke_width(4)));
        chart
            .draw_series(pieces)?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 50, y)], colour.stroke_width(6)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .margin(20)
        .legend_area_size(70)
        .label_font(("sans-serif", 30))
        .background_style(WHITE.mix(0.85))
        .border_style(RGBColor(200, 200, 200))
        .draw()?;
    Ok(())
}

/// A row for each flag that was set, and the time below.
fn flag_rows(area: &Area, ticks: &[Tick]) -> Drawn {
    let seen: Vec<_> = FLAGS.iter().filter(|(bit, ..)| ticks.iter().any(|t| t.flags & bit != 0)).collect();
    let rows = seen.len().max(1) as f64;
    let mut chart = ChartBuilder::on(area)
        .margin_top(10)
        .x_label_area_size(90)
        .y_label_area_size(LEFT)
        .build_cartesian_2d(times(ticks), 0.0..rows)?;
    chart
        .configure_mesh()
        .x_labels(11)
        .x_desc("time in s")
        .disable_y_mesh()
        .disable_y_axis()
        .axis_desc_style(("sans-serif", 36))
        .label_style(("sans-serif", 30))
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(205, 205, 205).mix(0.6))
        .draw()?;
    let plot = chart.plotting_area();
    for (row, (bit, _, colour)) in seen.iter().enumerate() {
        let (below, above) = (rows - row as f64 - 0.85, rows - row as f64 - 0.15);
        for (from, to) in spans(ticks, *bit) {
            plot.draw(&Rectangle::new([(from, below), (to, above)], colour.filled()))?;
        }
    }
    // Beside the rows, in pixels: names are no numbers of an axis.
    let base = area.get_base_pixel();
    let text = ("sans-serif", 28).into_font().color(&RGBColor(60, 60, 60));
    for (row, (_, name, _)) in seen.iter().enumerate() {
        let (_, y) = plot.map_coordinate(&(ticks[0].time_s, rows - row as f64 - 0.5));
        let (width, height) = area.estimate_text_size(name, &text)?;
        let at = (LEFT as i32 - width as i32 - 16, y - base.1 - height as i32 / 2);
        area.draw_text(name, &text, at)?;
    }
    Ok(())
}

/// The times while a bit was set: whole ticks, and never less than a line that can be seen.
fn spans(ticks: &[Tick], bit: u32) -> Vec<(f64, f64)> {
    let all = times(ticks);
    let least = (all.end - all.start) / f64::from(SIZE.0);
    let mut found: Vec<(f64, f64)> = Vec::new();
    for (tick, next) in ticks.iter().zip(ticks.iter().skip(1)) {
        if tick.flags & bit == 0 {
            continue;
        }
        let end = next.time_s.max(tick.time_s + least).min(all.end);
        match found.last_mut() {
            Some(last) if tick.time_s <= last.1 => last.1 = last.1.max(end),
            _ => found.push((tick.time_s, end)),
        }
    }
    found
}
