//! Figures, as a table or as JSON lines.

use std::process::ExitCode;

use comfy_table::Table;
use serde::Serialize;

use super::beside::Beside;
use super::common::place::Place;
use super::common::table::empty;
use super::options::Scene;

/// What was measured of one block.
#[derive(Debug, Serialize)]
pub struct Figure {
    pub scene: Scene,
    pub cells: usize,
    pub nodes: usize,
    pub dt_s: f64,
    pub young_pa: f64,
    pub poisson: f64,
    pub contrast: f64,
    pub cell_m: f64,
    pub us_per_step: f64,
    pub least_us: f64,
    pub device_us_per_step: f64,
    pub p99_us: f64,
    pub steps_per_s: f64,
    pub rtf: f64,
    pub cg_iterations: f64,
    pub us_per_iteration: f64,
    pub true_residual: f64,
    pub bytes_uploaded: u64,
    pub allocations: u64,
    pub max_force_n: f64,
    pub contact_points: u32,
    #[serde(flatten)]
    pub compared: Option<Compared>,
    #[serde(flatten)]
    pub beside: Option<Beside>,
}

/// What the paper's flow took for the same.
#[derive(Debug, Serialize)]
pub struct Compared {
    pub baseline: &'static str,
    pub baseline_us_per_step: f64,
    pub baseline_cg_iterations: f64,
    pub ratio: f64,
}

/// A figure with where it was taken.
#[derive(Serialize)]
struct Line<'a> {
    #[serde(flatten)]
    place: &'a Place,
    #[serde(flatten)]
    figure: &'a Figure,
}

/// Collects figures.
pub struct Report {
    is_json: bool,
    place: Place,
    table: Table,
    has_failed: bool,
}

impl Report {
    pub fn new(is_json: bool, place: Place) -> Self {
        let table = empty([
            "scene",
            "cells",
            "dt ms",
            "E kPa",
            "ν",
            "contrast",
            "µs/step",
            "on device",
            "p99",
            "iterations",
            "µs/iteration",
            "residual",
            "RTF",
            "peak N",
            "points",
            "allocations",
            "baseline µs/step",
            "its iterations",
            "ratio",
            "lattice µs/step",
            "its substeps",
            "error %",
            "its error %",
            "doubt %",
        ]);
        Self { is_json, place, table, has_failed: false }
    }

    pub fn add(&mut self, figure: &Figure) {
        if self.is_json {
            let line = Line { place: &self.place, figure };
            println!("{}", serde_json::to_string(&line).expect("figures are plain numbers and text"));
            return;
        }
        let f = figure;
        let of_lattice = |show: fn(&Beside) -> String| f.beside.as_ref().map_or_else(String::new, show);
        let of_baseline = |show: fn(&Compared) -> String| f.compared.as_ref().map_or_else(String::new, show);
        self.table.add_row([
            format!("{:?}", f.scene).to_lowercase(),
            f.cells.to_string(),
            format!("{:.2}", f.dt_s * 1e3),
            format!("{:.0}", f.young_pa * 1e-3),
            format!("{:.2}", f.poisson),
            format!("{:.0}", f.contrast),
            format!("{:.0}", f.us_per_step),
            format!("{:.0}", f.device_us_per_step),
            format!("{:.0}", f.p99_us),
            format!("{:.1}", f.cg_iterations),
            format!("{:.1}", f.us_per_iteration),
            format!("{:.1e}", f.true_residual),
            format!("{:.2}", f.rtf),
            format!("{:.2}", f.max_force_n),
            f.contact_points.to_string(),
            f.allocations.to_string(),
            of_baseline(|c| format!("{:.0}", c.baseline_us_per_step)),
            of_baseline(|c| format!("{:.1}", c.baseline_cg_iterations)),
            of_baseline(|c| format!("{:.1}", c.ratio)),
            of_lattice(|b| format!("{:.0}", b.lattice_us_per_step)),
            of_lattice(|b| b.lattice_substeps.to_string()),
            of_lattice(|b| format!("{:.1}", b.error * 1e2)),
            of_lattice(|b| format!("{:.1}", b.lattice_error * 1e2)),
            of_lattice(|b| format!("{:.1}", b.reference_doubt * 1e2)),
        ]);
    }

    /// Notes that a figure could not be taken.
    pub fn fail(&mut self, cells: usize, error: &str) {
        self.has_failed = true;
        eprintln!("FAILED: {cells} cells: {error}");
    }

    /// Prints what has not been printed; gives the exit status.
    pub fn finish(self) -> ExitCode {
        if !self.is_json {
            println!("{}\n{}", self.place.words(), self.table);
        }
        ExitCode::from(u8::from(self.has_failed))
    }
}
