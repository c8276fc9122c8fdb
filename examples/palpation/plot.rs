//! Force against indentation.

use std::path::Path;

use plotters::prelude::*;

use super::chart;
use super::press::{Phase, Row};

const WIDTH: u32 = 1000;
const HEIGHT: u32 = 700;

/// Draws and writes the plot.
pub fn write(rows: &[Row], path: &Path) -> anyhow::Result<()> {
    chart::write(path, (WIDTH, HEIGHT), |backend| draw(rows, backend))
}

fn draw(rows: &[Row], backend: BitMapBackend) -> Result<(), Box<dyn std::error::Error>> {
    let point = |row: &Row| (row.indentation_m * 1e3, row.wrench.force_n.norm());
    let deepest = rows.iter().map(|row| point(row).0).fold(0.1, f64::max);
    let strongest = rows.iter().map(|row| point(row).1).fold(1e-3, f64::max);

    let area = backend.into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption("Force on the tool against indentation", ("sans-serif", 44))
        .margin(40)
        .x_label_area_size(90)
        .y_label_area_size(115)
        .build_cartesian_2d(0.0..1.05 * deepest, 0.0..1.08 * strongest)?;
    chart
        .configure_mesh()
        .x_desc("indentation in mm")
        .y_desc("force in N")
        .axis_desc_style(("sans-serif", 34))
        .label_style(("sans-serif", 30))
        .light_line_style(RGBColor(240, 240, 240))
        .bold_line_style(RGBColor(215, 215, 215))
        .draw()?;

    let phases = [
        (Phase::Press, "going in", RGBColor(196, 62, 44)),
        (Phase::Hold, "holding", RGBColor(232, 160, 40)),
        (Phase::Retract, "coming out", RGBColor(40, 98, 168)),
    ];
    for (phase, name, colour) in phases {
        // Each line starts where the one before it ended.
        let steps = rows.windows(2).filter(|pair| pair[1].phase == phase);
        // Piece by piece: where a line goes steeply up and down, its corners would stick out.
        let pieces =
            steps.map(|pair| PathElement::new([point(&pair[0]), point(&pair[1])], colour.stroke_width(5)));
        chart
            .draw_series(pieces)?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 50, y)], colour.stroke_width(6)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .margin(30)
        .legend_area_size(70)
        .label_font(("sans-serif", 32))
        .background_style(WHITE.mix(0.9))
        .border_style(RGBColor(190, 190, 190))
        .draw()?;
    area.present()?;
    Ok(())
}
