//! Figures, as a table or as JSON lines.

use std::process::ExitCode;

use comfy_table::{CellAlignment, Table, presets};
use serde::Serialize;

/// The figures of one run. See the head of `main.rs`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    pub scene: String,
    pub backend: &'static str,
    pub device: String,
    pub precision: &'static str,
    pub threads: usize,
    pub sleeping: bool,
    pub nodes: usize,
    pub cells: usize,
    pub triangles: usize,
    pub cell_m: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub young_pa: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub young_cap_pa: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poisson: Option<f64>,
    pub dt_s: f64,
    #[serde(flatten)]
    pub timing: Option<Timing>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// What a run that came to its end has measured.
#[derive(Clone, Debug, Serialize)]
pub struct Timing {
    pub substep_s: f64,
    pub substeps: u32,
    pub us_per_step: f64,
    pub least_us_per_step: f64,
    pub steps_per_s: f64,
    pub p50_us: f64,
    pub p99_us: f64,
    pub p999_us: f64,
    pub rtf: f64,
    pub awake_nodes: u64,
    pub allocations: u64,
    pub bytes_per_node: f64,
    pub max_force_n: f64,
    pub max_strain: f64,
    pub baseline: &'static str,
    pub baseline_us_per_step: f64,
    pub baseline_least_us: f64,
    pub ratio: f64,
}

/// Collects figures.
pub struct Report {
    is_json: bool,
    table: Table,
    device: String,
    has_failed: bool,
}

const HEADER: [&str; 15] = [
    "scene",
    "nodes",
    "E kPa",
    "ν",
    "sleep",
    "substeps × ms",
    "µs/substep (least)",
    "p50 / p99 / p999 step ms",
    "RTF",
    "awake",
    "peak N",
    "allocations",
    "B/node",
    "baseline µs (least)",
    "ratio",
];

impl Report {
    pub fn new(is_json: bool) -> Self {
        let mut table = Table::new();
        table.load_style(presets::UTF8_FULL_CONDENSED);
        table.set_header(HEADER);
        for column in table.column_iter_mut().skip(1) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        Self { is_json, table, device: String::new(), has_failed: false }
    }

    /// Adds the figures of one run.
    pub fn add(&mut self, figures: &Figures) {
        if let Some(error) = &figures.error {
            self.has_failed = true;
            eprintln!("FAILED: {} with {} nodes: {error}", figures.scene, figures.nodes);
        }
        if self.is_json {
            println!("{}", serde_json::to_string(figures).expect("figures are plain numbers and text"));
            return;
        }
        let Figures { device, precision, threads, .. } = figures;
        self.device = format!("{device}, {threads} threads, {precision}");
        let Some(timing) = &figures.timing else { return };
        eprintln!("{} with {} nodes: {:.1} µs per substep", figures.scene, figures.nodes, timing.us_per_step);
        self.table.add_row(row(figures, timing));
    }

    /// Notes that a scene could not be built.
    pub fn fail(&mut self, scene: &str, error: &str) {
        self.add(&Figures {
            scene: scene.into(),
            backend: "cpu",
            error: Some(error.into()),
            ..Figures::default()
        });
    }

    /// Says loudly that a scene was not run.
    pub fn skip(&self, scene: &str, why: &str) {
        eprintln!("SKIPPED: {scene}: {why}");
    }

    /// Prints what has not been printed; gives the exit status.
    pub fn finish(self) -> ExitCode {
        if !self.is_json && !self.table.is_empty() {
            println!("{}\n{}", self.device, self.table);
        }
        ExitCode::from(u8::from(self.has_failed))
    }
}

fn row(figures: &Figures, timing: &Timing) -> [String; 15] {
    let young = match (figures.young_pa, figures.young_cap_pa) {
        (Some(young), None) => format!("{}", young / 1e3),
        (Some(young), Some(cap)) => format!("{}", young.min(cap) / 1e3),
        (None, Some(cap)) => format!("presets ≤ {}", cap / 1e3),
        (None, None) => "presets".into(),
    };
    let ms = |us: f64| format!("{:.2}", us * 1e-3);
    [
        figures.scene.clone(),
        figures.nodes.to_string(),
        young,
        figures.poisson.map_or("presets".into(), |nu| nu.to_string()),
        if figures.sleeping { "on".into() } else { "off".into() },
        format!("{} × {:.3}", timing.substeps, timing.substep_s * 1e3),
        format!("{:.1} ({:.1})", timing.us_per_step, timing.least_us_per_step),
        [timing.p50_us, timing.p99_us, timing.p999_us].map(ms).join(" / "),
        format!("{:.2}", timing.rtf),
        format!("{:.0} %", 100.0 * timing.awake_nodes as f64 / figures.nodes as f64),
        format!("{:.2}", timing.max_force_n),
        timing.allocations.to_string(),
        format!("{:.0}", timing.bytes_per_node),
        format!("{:.0} ({:.0})", timing.baseline_us_per_step, timing.baseline_least_us),
        format!("{:.1}", timing.ratio),
    ]
}
