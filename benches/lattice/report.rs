//! Figures, as a table or as JSON lines.

use std::process::ExitCode;

use comfy_table::Table;
use serde::Serialize;

use super::common::place::Place;
use super::common::table::empty;

/// The figures of one run. See the head of `main.rs`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    pub scene: String,
    /// Filled in by the report.
    #[serde(flatten)]
    pub place: Place,
    pub sleeping: bool,
    pub nodes: usize,
    pub cells: usize,
    pub triangles: usize,
    pub cell_m: f64,
    pub tool_radius_m: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub young_pa: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub young_cap_pa: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poisson: Option<f64>,
    pub dt_s: f64,
    #[serde(flatten)]
    pub timing: Option<Timing>,
    #[serde(flatten)]
    pub latency: Option<Latency>,
    #[serde(flatten)]
    pub still: Option<Still>,
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
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device_us_per_step: Option<f64>,
    pub steps_per_s: f64,
    pub p50_us: f64,
    pub p99_us: f64,
    pub p999_us: f64,
    pub rtf: f64,
    pub awake_nodes: u64,
    pub allocations: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes_uploaded: Option<u64>,
    pub bytes_per_node: f64,
    pub max_force_n: f64,
    pub max_strain: f64,
    pub contact_points: u32,
    pub dropped_points: u64,
    pub baseline: &'static str,
    pub baseline_us_per_step: f64,
    pub baseline_least_us: f64,
    pub ratio: f64,
}

/// What a servo loop has waited for.
#[derive(Clone, Debug, Serialize)]
pub struct Latency {
    pub ticks: usize,
    pub substep_s: f64,
    pub substeps: u32,
    pub p50_us: f64,
    pub p99_us: f64,
    pub p999_us: f64,
    pub max_us: f64,
    pub step_p50_us: f64,
    pub step_p99_us: f64,
    pub step_p999_us: f64,
    pub awake_nodes: u64,
    pub allocations: u64,
    pub min_force_n: f64,
    pub max_force_n: f64,
    pub contact_points: u32,
    pub dropped_points: u64,
}

/// What substeps without a tool have taken.
#[derive(Clone, Debug, Serialize)]
pub struct Still {
    pub substep_s: f64,
    pub substeps: u32,
    pub us_per_step: f64,
    pub least_us_per_step: f64,
    pub awake_nodes: u64,
}

/// Collects figures.
pub struct Report {
    is_json: bool,
    place: Place,
    scenes: Table,
    latencies: Table,
    stills: Table,
    has_failed: bool,
}

const SCENES: [&str; 16] = [
    "scene",
    "nodes",
    "E kPa",
    "ν",
    "sleep",
    "substeps × ms",
    "µs/substep (least)",
    "on the GPU",
    "p50 / p99 / p999 step ms",
    "RTF",
    "awake",
    "peak N",
    "allocations",
    "B/node",
    "baseline µs (least)",
    "ratio",
];

const LATENCIES: [&str; 10] = [
    "scene",
    "nodes",
    "E kPa",
    "ν",
    "substep ms",
    "ticks",
    "p50 / p99 / p999 µs",
    "most µs",
    "least / peak N",
    "allocations",
];

const STILLS: [&str; 6] = ["scene", "nodes", "ν", "awake", "substeps × ms", "µs/substep (least)"];

impl Report {
    pub fn new(is_json: bool, place: Place) -> Self {
        let (scenes, latencies, stills) = (empty(SCENES), empty(LATENCIES), empty(STILLS));
        Self { is_json, place, scenes, latencies, stills, has_failed: false }
    }

    /// Adds the figures of one run.
    pub fn add(&mut self, mut figures: Figures) {
        figures.place = self.place.clone();
        if let Some(error) = &figures.error {
            self.has_failed = true;
            eprintln!("FAILED: {} with {} nodes: {error}", figures.scene, figures.nodes);
        }
        if self.is_json {
            println!("{}", serde_json::to_string(&figures).expect("figures are plain numbers and text"));
            return;
        }
        if let Some(timing) = &figures.timing {
            let Figures { scene, nodes, .. } = &figures;
            eprintln!("{scene} with {nodes} nodes: {:.1} µs per substep", timing.us_per_step);
            self.scenes.add_row(row(&figures, timing));
        }
        if let Some(latency) = &figures.latency {
            self.latencies.add_row(latency_row(&figures, latency));
        }
        if let Some(still) = &figures.still {
            self.stills.add_row(still_row(&figures, still));
        }
    }

    /// Notes that a scene could not be built.
    pub fn fail(&mut self, scene: &str, error: &str) {
        self.add(Figures { scene: scene.into(), error: Some(error.into()), ..Figures::default() });
    }

    /// Says loudly that a scene was not run.
    pub fn skip(&self, scene: &str, why: &str) {
        eprintln!("SKIPPED: {scene}: {why}");
    }

    /// Prints what has not been printed; gives the exit status.
    pub fn finish(self) -> ExitCode {
        for table in
            [&self.scenes, &self.latencies, &self.stills].into_iter().filter(|table| !table.is_empty())
        {
            println!("{}\n{table}", self.place.words());
        }
        ExitCode::from(u8::from(self.has_failed))
    }
}

/// Young's modulus in kPa, and Poisson's ratio.
fn material(figures: &Figures) -> [String; 2] {
    let young = match (figures.young_pa, figures.young_cap_pa) {
        (Some(young), None) => format!("{}", young / 1e3),
        (Some(young), Some(cap)) => format!("{}", young.min(cap) / 1e3),
        (None, Some(cap)) => format!("presets ≤ {}", cap / 1e3),
        (None, None) => "presets".into(),
    };
    [young, figures.poisson.map_or("presets".into(), |nu| nu.to_string())]
}

fn row(figures: &Figures, timing: &Timing) -> [String; 16] {
    let [young, poisson] = material(figures);
    let ms = |us: f64| format!("{:.2}", us * 1e-3);
    [
        figures.scene.clone(),
        figures.nodes.to_string(),
        young,
        poisson,
        if figures.sleeping { "on".into() } else { "off".into() },
        format!("{} × {:.3}", timing.substeps, timing.substep_s * 1e3),
        format!("{:.1} ({:.1})", timing.us_per_step, timing.least_us_per_step),
        timing.device_us_per_step.map_or(String::new(), |us| format!("{us:.1}")),
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

fn latency_row(figures: &Figures, latency: &Latency) -> [String; 10] {
    let [young, poisson] = material(figures);
    [
        figures.scene.clone(),
        figures.nodes.to_string(),
        young,
        poisson,
        format!("{:.3}", latency.substep_s * 1e3),
        latency.ticks.to_string(),
        [latency.p50_us, latency.p99_us, latency.p999_us].map(|us| format!("{us:.1}")).join(" / "),
        format!("{:.1}", latency.max_us),
        format!("{:.2} / {:.2}", latency.min_force_n, latency.max_force_n),
        latency.allocations.to_string(),
    ]
}

fn still_row(figures: &Figures, still: &Still) -> [String; 6] {
    let [_, poisson] = material(figures);
    [
        figures.scene.clone(),
        figures.nodes.to_string(),
        poisson,
        still.awake_nodes.to_string(),
        format!("{} × {:.3}", still.substeps, still.substep_s * 1e3),
        format!("{:.2} ({:.2})", still.us_per_step, still.least_us_per_step),
    ]
}
