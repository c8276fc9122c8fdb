//! What is left of a run: one table and a CSV file.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context;
use comfy_table::{Table, presets};
use palpate::model::Model;
use palpate::sim::Place;

use super::options::{ModelKind, Options};
use super::press::{Plan, Record, Row};
use super::tool::Tool;

/// Columns of the CSV file, in SI units except for what a reader expects in millimetres.
const COLUMNS: &str = "time_s,phase,tool_x_m,tool_y_m,tool_z_m,indentation_mm,force_x_n,force_y_n,force_z_n,\
torque_x_n_m,torque_y_n_m,torque_z_n_m,contacts,substeps,awake_nodes,real_time_factor,max_strain,min_volume_ratio,\
kinetic_j,elastic_j,tool_work_j";

/// Writes one line for each row.
pub fn write_csv(rows: &[Row], path: &Path) -> anyhow::Result<()> {
    let mut text = format!("{COLUMNS}\n");
    for row in rows {
        let Row { statistics, energy, .. } = row;
        let [at, force, torque] = [row.pose.translation.vector, row.wrench.force_n, row.wrench.torque_n_m]
            .map(|v| format!("{:.6},{:.6},{:.6}", v.x, v.y, v.z));
        writeln!(
            text,
            "{:.6},{:?},{at},{:.4},{force},{torque},{},{},{},{:.3},{:.5},{:.4},{:e},{:e},{:e}",
            statistics.time_s,
            row.phase,
            row.indentation_m * 1e3,
            statistics.contact_points,
            statistics.substeps_per_step,
            statistics.awake_nodes,
            statistics.real_time_factor,
            statistics.max_strain,
            statistics.volume_ratio[0],
            energy.kinetic_j,
            energy.elastic_j,
            energy.tool_work_j,
        )?;
    }
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// The table of a run.
pub fn table(
    options: &Options,
    model: &Model,
    place: &Place,
    tool: &Tool,
    plan: &Plan,
    record: &Record,
) -> Table {
    let lattice = model.lattice();
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    let mut row = |name: &str, value: String| {
        table.add_row([name.to_owned(), value]);
    };

    // The model.
    let source =
        options.labels.as_ref().map_or("generated thorax".to_owned(), |path| path.display().to_string());
    row("anatomy", source);
    row("cells, nodes", format!("{}, {}", grouped(lattice.cell_count()), grouped(lattice.node_count())));
    row("cell size", format!("{:.2} mm", lattice.cell_m() * 1e3));
    row("materials", model.materials().iter().map(|m| m.name.as_str()).collect::<Vec<_>>().join(", "));
    let cap = if options.young_cap_kpa > 0.0 {
        format!("{} kPa", options.young_cap_kpa)
    } else {
        "none".to_owned()
    };
    row("cap on Young's modulus", cap);
    let loose = model.loose_pieces();
    if !loose.is_empty() {
        row("loose pieces", format!("{}, of {} cells in all", loose.len(), grouped(loose.iter().sum())));
    }

    // The computation.
    let last = record.rows.last().map(|r| r.statistics).unwrap_or_default();
    let highest = |value: &dyn Fn(&Row) -> f64| record.rows.iter().map(value).fold(f64::MIN, f64::max);
    row("runs on", place.to_string());
    if let Some(why) = &place.fallback {
        row("not on a GPU", why.clone());
    }
    row("arithmetic", if options.f64 { "64 bit" } else { "32 bit" }.to_owned());
    match options.model {
        ModelKind::Lattice => {
            row("model", "lattice".to_owned());
            row(
                "step, stable substep",
                format!("{:.3} ms, {:.4} ms", plan.step_s * 1e3, last.stable_substep_s * 1e3),
            );
            let mean = last.substeps as f64 / last.steps.max(1) as f64;
            let most = highest(&|r| f64::from(r.statistics.substeps_per_step));
            row("substeps per step", format!("{mean:.1} on average, {most} at most"));
            row("nodes awake at most", grouped(highest(&|r| r.statistics.awake_nodes as f64) as usize));
        }
        ModelKind::Efg => {
            row("model", "EFG".to_owned());
            row("step", format!("{:.3} ms", plan.step_s * 1e3));
            let iterations: u32 = record.rows.iter().map(|r| r.statistics.cg_iterations).sum();
            let mean = f64::from(iterations) / record.rows.len().max(1) as f64;
            let most = highest(&|r| f64::from(r.statistics.cg_iterations));
            row("iterations per step", format!("{mean:.1} on average, {most} at most"));
            row("true residual at most", format!("{:.1e}", highest(&|r| r.statistics.true_residual)));
        }
    }
    row("memory per node", format!("{:.1} bytes", last.node_bytes as f64 / last.node_count.max(1) as f64));
    row(
        "real-time factor",
        format!("{:.2} ({:.2} s in {:.2} s)", last.time_s / record.wall_s, last.time_s, record.wall_s),
    );

    // The press.
    let at = plan.approach.point_m * 1e3;
    row("tool", format!("{}, friction {}", tool.name, options.friction));
    row("pressed at", format!("{:.1}, {:.1}, {:.1} mm", at.x, at.y, at.z));
    row(
        "indentation at most",
        format!("{:.2} mm at {} mm/s", highest(&|r| r.indentation_m) * 1e3, options.speed_mm_s),
    );
    row("force at most", format!("{:.3} N", highest(&|r| r.wrench.force_n.norm())));
    row("force at the end of the hold", format!("{:.3} N", held_force(record)));
    row("elastic energy at most", format!("{:.3} mJ", highest(&|r| r.energy.elastic_j) * 1e3));
    let lost = record.rows.last().map_or(0.0, |r| r.energy.tool_work_j);
    row("work of the tool at most", format!("{:.3} mJ", highest(&|r| r.energy.tool_work_j) * 1e3));
    row("work not given back", format!("{:.3} mJ", lost * 1e3));
    row("strain at most", format!("{:.1} %", highest(&|r| r.statistics.max_strain) * 1e2));
    let squeezed = record.rows.iter().map(|r| r.statistics.volume_ratio[0]).fold(f64::MAX, f64::min);
    let overturned = if squeezed > 0.0 { "" } else { ": cells have turned over, which tissue does not" };
    row("volume ratio at least", format!("{squeezed:.3}{overturned}"));
    row("results", format!("in the folder {}", options.out.display()));
    table
}

fn held_force(record: &Record) -> f64 {
    let held = record.rows.iter().rfind(|r| r.phase == super::press::Phase::Hold);
    held.map_or(0.0, |r| r.wrench.force_n.norm())
}

/// A count with a comma before every third digit from the right.
fn grouped(count: usize) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}
