//! Figures, as tables or as JSON lines.

use std::process::ExitCode;

use comfy_table::Table;
use serde::Serialize;

use super::place::Place;
use super::table::empty;

/// One kind of figures.
pub trait Figure: Serialize {
    /// Names the kind, and each of its columns.
    const NAME: &'static str;
    /// What stands above the columns.
    fn header() -> Table;
    /// A line of its table.
    fn row(&self) -> Vec<String>;
}

/// A figure with where it was taken.
#[derive(Serialize)]
struct Line<'a, F> {
    figure: &'static str,
    #[serde(flatten)]
    place: &'a Place,
    #[serde(flatten)]
    values: &'a F,
}

/// Collects figures.
pub struct Report {
    is_json: bool,
    place: Place,
    tables: Vec<(&'static str, Table)>,
    has_failed: bool,
}

impl Report {
    pub fn new(is_json: bool, place: Place) -> Self {
        Self { is_json, place, tables: Vec::new(), has_failed: false }
    }

    /// Adds a figure.
    pub fn add<F: Figure>(&mut self, values: &F) {
        if self.is_json {
            let line = Line { figure: F::NAME, place: &self.place, values };
            println!("{}", serde_json::to_string(&line).expect("figures are plain numbers and text"));
            return;
        }
        if self.tables.last().is_none_or(|(name, _)| *name != F::NAME) {
            self.tables.push((F::NAME, F::header()));
        }
        if let Some((_, table)) = self.tables.last_mut() {
            table.add_row(values.row());
        }
    }

    /// Notes that a figure could not be taken.
    pub fn fail(&mut self, what: &str, error: &str) {
        self.has_failed = true;
        eprintln!("FAILED: {what}: {error}");
    }

    /// Says loudly that a figure was not taken.
    pub fn skip(&self, what: &str, why: &str) {
        eprintln!("SKIPPED: {what}: {why}");
    }

    /// Prints what has not been printed; gives the exit status.
    pub fn finish(self) -> ExitCode {
        for (name, table) in &self.tables {
            println!("{name}: {}\n{table}", self.place.words());
        }
        ExitCode::from(u8::from(self.has_failed))
    }
}

/// A table with these columns.
pub fn columns<const N: usize>(header: [&str; N]) -> Table {
    empty(header)
}
