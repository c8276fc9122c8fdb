//! Tables of figures, and quantiles to put into them.

use comfy_table::{CellAlignment, Table, presets};

/// A table without rows: the first column is text, the others are numbers.
pub fn empty<const N: usize>(header: [&str; N]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    table.set_header(header);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// The nearest-rank quantile; sorts.
pub fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[rank(values.len(), q)]
}

/// The index of the nearest-rank quantile of so many values, of which there must be one.
pub fn rank(count: usize, q: f64) -> usize {
    ((q * count as f64).ceil() as usize).clamp(1, count) - 1
}
