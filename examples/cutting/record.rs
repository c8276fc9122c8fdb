//! What each step took, and what it left.

use std::path::Path;

use anyhow::Context;
use comfy_table::Table;
use palpate::model::Model;
use palpate::sim::{Sim, SurfaceFrame};
use palpate::solver::tool::ToolForce;

use super::scene::Phase;

/// One step.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    time_s: f64,
    phase: Phase,
    /// The whole step, and the part of it that the cut took, in s.
    wall_s: f64,
    cut_s: f64,
    iterations: u32,
    residual: f64,
    cells: usize,
    copies: u64,
    vertices: usize,
    triangles: usize,
    uploaded: u64,
    force_n: f64,
}

/// All steps.
#[derive(Debug)]
pub struct Record {
    cells: usize,
    nodes: usize,
    steps: Vec<Step>,
}

impl Step {
    /// What a step left.
    pub fn of(sim: &Sim, force: &ToolForce, frame: &SurfaceFrame<'_>, phase: Phase) -> Self {
        let statistics = sim.statistics();
        Self {
            time_s: statistics.time_s,
            phase,
            wall_s: statistics.step_wall_s,
            cut_s: statistics.cut_wall_s,
            iterations: statistics.cg_iterations,
            residual: statistics.true_residual,
            cells: statistics.divided_cells as usize,
            copies: statistics.copies,
            vertices: frame.positions.len(),
            triangles: frame.triangles.len(),
            uploaded: statistics.copied.to_device,
            force_n: force.wrench.force_n.norm(),
        }
    }
}

impl Record {
    /// Of no step yet.
    pub fn new(model: &Model) -> Self {
        Self { cells: model.lattice().cell_count(), nodes: model.lattice().node_count(), steps: Vec::new() }
    }

    /// Adds a step.
    pub fn note(&mut self, step: Step) {
        self.steps.push(step);
    }

    /// A table: steps before, during and after the cut side by side.
    pub fn table(&self, place: &str) -> Table {
        let all = [Phase::Before, Phase::Cut, Phase::After]
            .map(|phase| self.steps.iter().filter(|step| step.phase == phase).collect::<Vec<_>>());
        let mut table = Table::new();
        table.set_header([
            format!("{} cells, {} nodes, {place}", self.cells, self.nodes),
            "before".into(),
            "while cut".into(),
            "after".into(),
        ]);
        let mut row = |name: &str, show: &dyn Fn(&[&Step]) -> String| {
            let cells = all.iter().map(|steps| if steps.is_empty() { String::new() } else { show(steps) });
            table.add_row(std::iter::once(name.to_owned()).chain(cells));
        };
        let ms = |of: fn(&Step) -> f64| {
            move |steps: &[&Step]| {
                let mut all: Vec<f64> = steps.iter().map(|step| of(step) * 1e3).collect();
                all.sort_by(f64::total_cmp);
                let at = |share: f64| all[((all.len() - 1) as f64 * share).round() as usize];
                format!("{:.2} / {:.2} / {:.2}", at(0.5), at(0.99), at(1.0))
            }
        };
        row("step, ms (p50 / p99 / most)", &ms(|step| step.wall_s));
        row("of it the cut, ms", &ms(|step| step.cut_s));
        row("iterations per step", &|steps| {
            let sum: f64 = steps.iter().map(|step| f64::from(step.iterations)).sum();
            format!("{:.1}", sum / steps.len() as f64)
        });
        row("true residual at most", &|steps| {
            format!("{:.1e}", steps.iter().map(|step| step.residual).fold(0.0, f64::max))
        });
        row("real-time factor", &|steps| {
            let step_s = self.steps[1].time_s - self.steps[0].time_s;
            format!("{:.2}", step_s * steps.len() as f64 / steps.iter().map(|step| step.wall_s).sum::<f64>())
        });
        let last = |of: fn(&Step) -> String| move |steps: &[&Step]| of(steps[steps.len() - 1]);
        row("divided cells, copies of nodes", &last(|step| format!("{}, {}", step.cells, step.copies)));
        row("vertices, triangles", &last(|step| format!("{}, {}", step.vertices, step.triangles)));
        row("force on the blade at most", &|steps| {
            format!("{:.3} N", steps.iter().map(|step| step.force_n).fold(0.0, f64::max))
        });
        table
    }

    /// A line for each step.
    pub fn write(&self, path: &Path) -> anyhow::Result<()> {
        let head = "time_s,is_cutting,step_s,cut_s,iterations,residual,divided_cells,copies,vertices,triangles,\
                    bytes_to_device,force_n";
        let line = |step: &Step| {
            let Step { time_s, wall_s, cut_s, iterations, residual, cells, copies, .. } = step;
            let Step { phase, vertices, triangles, uploaded, force_n, .. } = step;
            format!(
                "{time_s:.6},{},{wall_s:.6},{cut_s:.6},{iterations},{residual:.3e},{cells},{copies},{vertices},\
                 {triangles},{uploaded},{force_n:.6}",
                u8::from(*phase == Phase::Cut)
            )
        };
        let lines: Vec<String> =
            std::iter::once(head.to_owned()).chain(self.steps.iter().map(line)).collect();
        std::fs::write(path, lines.join("\n") + "\n")
            .with_context(|| format!("cannot write {}", path.display()))
    }
}
