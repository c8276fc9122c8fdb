//! What steps took before, while and after tissue was cut.

use comfy_table::Table;
use palpate::error::Result;
use serde::Serialize;

use super::common::place::Backend;
use super::common::report::{Figure, columns};
use super::common::table::quantile;
use super::options::{ModelName, Options};
use super::scene::{Phase, Scene};
use super::take::{Sample, Take};

/// Parts of the blade's way for which the time of steps is told.
const PARTS: usize = 5;

/// What is measured.
#[derive(Clone, Debug, Serialize)]
pub struct Setting {
    pub scene: &'static str,
    pub model: ModelName,
    pub cells: usize,
    pub nodes: usize,
    /// Triangles of the surface before it is cut.
    pub triangles: usize,
    pub dt_s: f64,
    pub toughness_j_m2: f64,
    /// What a full upload copies, on a GPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub full_bytes: Option<u64>,
}

/// What the steps of a phase took. Of three numbers the first is the median, the second the 99th percentile, the third the most.
#[derive(Clone, Debug, Serialize)]
pub struct PhaseFigure {
    #[serde(flatten)]
    pub setting: Setting,
    pub phase: Phase,
    pub steps: usize,
    pub step_ms: [f64; 3],
    pub map_ms: Option<[f64; 3]>,
    pub cut_ms: [f64; 3],
    /// Steps that divided a cell, and what cutting took in these.
    pub dividing_steps: usize,
    pub dividing_cut_ms: Option<[f64; 3]>,
    pub device_ms: [f64; 3],
    pub iterations: f64,
    pub true_residual: f64,
    pub substeps_per_step: u32,
    pub awake_nodes: f64,
    pub rtf: f64,
    /// Whether half of the steps took no longer than what they simulate.
    pub keeps_up: bool,
    pub divided_cells: u64,
    pub copies: u64,
    pub drawn_vertices: usize,
    pub drawn_triangles: usize,
    /// Copied to the GPU in a step on average, and at most; and as a share of a full upload.
    #[serde(flatten)]
    pub copied: Option<CopiedBytes>,
    /// Medians of steps by where the blade was: the first fifth of its way to the last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_ms_along_the_way: Option<[Option<f64>; PARTS]>,
}

/// Bytes that went to a GPU.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct CopiedBytes {
    pub bytes_per_step: f64,
    pub most_bytes: u64,
    pub share_of_full: f64,
    pub most_share_of_full: f64,
}

/// The median, the 99th percentile and the most of times in s, in ms; nothing of none.
fn spread_ms(seconds: impl Iterator<Item = f64>) -> Option<[f64; 3]> {
    let mut all: Vec<f64> = seconds.map(|s| s * 1e3).collect();
    (!all.is_empty()).then(|| [0.5, 0.99, 1.0].map(|q| quantile(&mut all, q)))
}

impl Setting {
    /// Of a scene that is about to be taken.
    fn of(scene: &'static str, model: ModelName, take: &Take, backend: Backend) -> Self {
        let simulated = &take.stage.scene.model;
        Self {
            scene,
            model,
            cells: simulated.lattice().cell_count(),
            nodes: simulated.lattice().node_count(),
            triangles: simulated.surfaces()[0].triangles.len(),
            dt_s: take.stage.desc.step_s,
            toughness_j_m2: take.stage.scene.blade.toughness_j_m2,
            full_bytes: (backend == Backend::Cuda).then_some(take.full_bytes),
        }
    }
}

/// Takes a scene, and says what each phase took.
pub fn measure(
    name: &'static str,
    scene: Scene,
    (model, step_s, seconds): (ModelName, f64, Option<f64>),
    options: &Options,
) -> Result<Vec<PhaseFigure>> {
    let mut take = Take::new(scene, &options.desc(model, step_s), seconds)?;
    let setting = Setting::of(name, model, &take, options.machine.backend);
    let mut samples = Vec::new();
    while let Some(sample) = take.step()? {
        samples.push(sample);
    }
    let phases = [Phase::Before, Phase::Cut, Phase::After];
    Ok(phases.into_iter().filter_map(|phase| PhaseFigure::of(&setting, phase, &samples)).collect())
}

impl PhaseFigure {
    /// Of the steps of a phase; nothing of none.
    pub fn of(setting: &Setting, phase: Phase, all: &[Sample]) -> Option<Self> {
        let steps: Vec<&Sample> = all.iter().filter(|sample| sample.phase == phase).collect();
        let last = &steps.last()?.statistics;
        let count = steps.len() as f64;
        let sum = |of: &dyn Fn(&Sample) -> f64| steps.iter().map(|&sample| of(sample)).sum::<f64>();
        let pictures = || steps.iter().filter_map(|sample| sample.picture);
        let dividing: Vec<&Sample> = steps.iter().copied().filter(|sample| sample.has_divided).collect();
        let wall_s = sum(&|sample| sample.statistics.step_wall_s)
            + pictures().map(|picture| picture.map_s).sum::<f64>();
        let copied = setting.full_bytes.map(|full| {
            let bytes_per_step = sum(&|sample| sample.to_device as f64) / count;
            let most_bytes = steps.iter().map(|sample| sample.to_device).max().unwrap_or_default();
            CopiedBytes {
                bytes_per_step,
                most_bytes,
                share_of_full: bytes_per_step / full as f64,
                most_share_of_full: most_bytes as f64 / full as f64,
            }
        });
        let along = |part: usize| {
            let there =
                steps.iter().filter(|sample| ((sample.share * PARTS as f64) as usize).min(PARTS - 1) == part);
            spread_ms(there.map(|sample| sample.statistics.step_wall_s)).map(|[p50, ..]| p50)
        };
        let shown = pictures().next_back();
        let step_ms = spread_ms(steps.iter().map(|sample| sample.statistics.step_wall_s))?;
        Some(Self {
            setting: setting.clone(),
            phase,
            steps: steps.len(),
            step_ms,
            map_ms: spread_ms(pictures().map(|picture| picture.map_s)),
            cut_ms: spread_ms(steps.iter().map(|sample| sample.statistics.cut_wall_s))?,
            dividing_steps: dividing.len(),
            dividing_cut_ms: spread_ms(dividing.iter().map(|sample| sample.statistics.cut_wall_s)),
            device_ms: spread_ms(steps.iter().map(|sample| sample.statistics.step_device_s))?,
            iterations: sum(&|sample| sample.statistics.cg_iterations.into()) / count,
            true_residual: steps.iter().map(|sample| sample.statistics.true_residual).fold(0.0, f64::max),
            substeps_per_step: last.substeps_per_step,
            awake_nodes: sum(&|sample| sample.statistics.awake_nodes as f64) / count,
            rtf: setting.dt_s * count / wall_s,
            keeps_up: step_ms[0] <= setting.dt_s * 1e3,
            divided_cells: last.divided_cells,
            copies: last.copies,
            drawn_vertices: shown.map_or(0, |picture| picture.vertices),
            drawn_triangles: shown.map_or(0, |picture| picture.triangles),
            copied,
            step_ms_along_the_way: (phase == Phase::Cut).then(|| std::array::from_fn(along)),
        })
    }
}

impl Figure for PhaseFigure {
    const NAME: &'static str = "phases";

    fn header() -> Table {
        columns([
            "scene",
            "cells",
            "dt ms",
            "phase",
            "step p50 / p99 / max ms",
            "map ms",
            "cut ms",
            "cut that divides ms (steps)",
            "device ms",
            "iterations, residual",
            "RTF",
            "divided, copies",
            "vertices, triangles",
            "KB to GPU a step, most (of full)",
            "step p50 ms along the way",
        ])
    }

    fn row(&self) -> Vec<String> {
        let three = |values: Option<[f64; 3]>| {
            values.map_or(String::new(), |all| all.map(|x| format!("{x:.2}")).join(" / "))
        };
        let along = self.step_ms_along_the_way.iter().flatten();
        let along: Vec<String> = along.map(|p50| p50.map_or("–".into(), |p50| format!("{p50:.2}"))).collect();
        vec![
            format!("{} {}", self.setting.scene, self.setting.model.name()),
            self.setting.cells.to_string(),
            format!("{:.2}", self.setting.dt_s * 1e3),
            format!("{:?}", self.phase).to_lowercase(),
            three(Some(self.step_ms)),
            three(self.map_ms),
            three(Some(self.cut_ms)),
            format!("{} ({})", three(self.dividing_cut_ms), self.dividing_steps),
            three(Some(self.device_ms)),
            format!("{:.1}, {:.1e}", self.iterations, self.true_residual),
            format!("{:.2}", self.rtf),
            format!("{}, {}", self.divided_cells, self.copies),
            format!("{}, {}", self.drawn_vertices, self.drawn_triangles),
            self.copied.map_or(String::new(), |copied| {
                let CopiedBytes { bytes_per_step, most_bytes, most_share_of_full, .. } = copied;
                format!(
                    "{:.1}, {:.1} ({:.2} %)",
                    bytes_per_step * 1e-3,
                    most_bytes as f64 * 1e-3,
                    most_share_of_full * 1e2
                )
            }),
            along.join(" / "),
        ]
    }
}
