//! Figure `anew`: what a step that cuts takes, against all of the simulation made anew.
//!
//! The baseline is the flow of data of a simulation whose topology the host has: after a cut it makes all that follows from it anew, and uploads all of it.
//! Here a second simulation of the same model is created, opens the same surface, and is restored from a snapshot of the first right after a step that has
//! divided cells. Creating uploads the state, masses, words and rows of all nodes, the lists of contact and the surface; restoring makes bricks, masses, sides
//! and lists of contact for the cuts, and uploads them. In favour of the baseline, what a blade crosses, the pieces and the cut surface are not found again:
//! the snapshot has them. To its disadvantage, creating sets up what a simulation keeps besides, such as memory and kernels; so both parts are told.

use std::time::Instant;

use comfy_table::Table;
use palpate::error::{Error, Result};
use palpate::sim::Sim;
use serde::Serialize;

use super::common::place::Backend;
use super::common::report::{Figure, Report, columns};
use super::common::table::quantile;
use super::hanging;
use super::options::{ModelName, Options};
use super::take::Take;

/// How often all is made anew, about, over the blade's way.
const TIMES: f64 = 16.0;

/// Times in ms: the least, the median, and the most.
#[derive(Debug, Serialize)]
pub struct Anew {
    model: ModelName,
    cells: usize,
    triangles: usize,
    dt_s: f64,
    /// Steps that have divided cells, and what cutting took in these.
    dividing_steps: usize,
    cut_ms: [f64; 3],
    /// How often all was made anew, and what that took.
    times: usize,
    anew_ms: [f64; 3],
    created_ms: [f64; 3],
    restored_ms: [f64; 3],
    /// What creating copied to the GPU at each of these times, and creating and restoring together.
    #[serde(skip_serializing_if = "Option::is_none")]
    created_bytes: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    anew_bytes: Option<u64>,
    /// Between the medians.
    ratio: f64,
}

impl Figure for Anew {
    const NAME: &'static str = "anew";

    fn header() -> Table {
        columns([
            "model",
            "cells",
            "triangles",
            "dt ms",
            "cut that divides: least / p50 / max ms (steps)",
            "all anew ms (times)",
            "of it created ms",
            "restored ms",
            "MB to GPU",
            "ratio",
        ])
    }

    fn row(&self) -> Vec<String> {
        let three = |all: [f64; 3]| all.map(|x| format!("{x:.2}")).join(" / ");
        vec![
            self.model.name().into(),
            self.cells.to_string(),
            self.triangles.to_string(),
            format!("{:.2}", self.dt_s * 1e3),
            format!("{} ({})", three(self.cut_ms), self.dividing_steps),
            format!("{} ({})", three(self.anew_ms), self.times),
            three(self.created_ms),
            three(self.restored_ms),
            self.anew_bytes.map_or(String::new(), |bytes| format!("{:.2}", bytes as f64 * 1e-6)),
            format!("{:.1}", self.ratio),
        ]
    }
}

/// Takes it.
pub fn run(options: &Options, report: &mut Report) {
    match measure(options) {
        Ok(figure) => report.add(&figure),
        Err(error) => report.fail("anew", &error.to_string()),
    }
}

fn measure(options: &Options) -> Result<Anew> {
    let scene = hanging::scene(&options.torus())?;
    let mut take = Take::new(scene, &options.desc(options.model, options.step_s()), options.seconds)?;
    let (mut cut_ms, mut created_ms, mut restored_ms, mut anew_ms) = (vec![], vec![], vec![], vec![]);
    let (mut created_bytes, mut anew_bytes, mut next) = (0, 0, 0.0);
    while let Some(sample) = take.step()? {
        if !sample.has_divided {
            continue;
        }
        cut_ms.push(sample.statistics.cut_wall_s * 1e3);
        if sample.share < next {
            continue;
        }
        next = sample.share + 1.0 / TIMES;
        let stage = &take.stage;
        let snapshot = stage.sim.snapshot()?;
        let begun = Instant::now();
        let mut other = Sim::new(stage.scene.model.clone(), &stage.desc)?;
        let _shown = other.open_surface(0)?;
        let created = begun.elapsed().as_secs_f64() * 1e3;
        created_bytes = other.statistics().copied.to_device;
        other.restore(&snapshot)?;
        let all = begun.elapsed().as_secs_f64() * 1e3;
        anew_bytes = other.statistics().copied.to_device;
        created_ms.push(created);
        restored_ms.push(all - created);
        anew_ms.push(all);
    }
    if anew_ms.is_empty() {
        return Err(Error::argument("no cell was divided in the time that was measured"));
    }
    let of_gpu = options.machine.backend == Backend::Cuda;
    let three = |all: &mut Vec<f64>| [0.0, 0.5, 1.0].map(|q| quantile(all, q));
    let model = &take.stage.scene.model;
    let (cut, anew) = (three(&mut cut_ms), three(&mut anew_ms));
    Ok(Anew {
        model: options.model,
        cells: model.lattice().cell_count(),
        triangles: model.surfaces()[0].triangles.len(),
        dt_s: take.stage.desc.step_s,
        dividing_steps: cut_ms.len(),
        cut_ms: cut,
        times: anew_ms.len(),
        anew_ms: anew,
        created_ms: three(&mut created_ms),
        restored_ms: three(&mut restored_ms),
        created_bytes: of_gpu.then_some(created_bytes),
        anew_bytes: of_gpu.then_some(anew_bytes),
        ratio: anew[1] / cut[1],
    })
}
