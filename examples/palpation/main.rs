//! Presses a tool into soft tissue: `cargo run --release --example palpation`.
//!
//! With no options a ball is pressed into the front of a generated thorax. `--labels FILE` takes a segmented scan instead. One
//! table goes to the terminal; pictures, a force-indentation plot and the run as CSV go to `--out DIR`.

mod anatomy;
mod approach;
#[path = "../common/chart.rs"]
mod chart;
mod options;
mod picture;
mod plot;
mod press;
mod report;
mod snapshot;
mod tool;

use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context;
use clap::Parser;
use comfy_table::Table;
use indicatif::{ProgressBar, ProgressStyle};
use palpate::math::Vec3;
use palpate::sim::{Precision, Sim, SimDesc};

pub use options::Options;

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(table) => {
            println!("{table}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("palpation: {}", sentence(&error));
            ExitCode::FAILURE
        }
    }
}

/// An error and its causes in one line, without those that the line tells already.
pub fn sentence(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |line, cause| match line.as_str() {
        "" => cause,
        known if known.contains(&cause) => line,
        known => format!("{known}: {cause}"),
    })
}

/// Does the whole job and returns its table.
pub fn run(options: &Options) -> anyhow::Result<Table> {
    options.check()?;
    let out = &options.out;
    std::fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;

    // The tissue. A patient's world has y to the front, so that a press from the front goes along -y.
    let direction = options.direction.map_or(-Vec3::y(), |d| d.normalize());
    let model = Arc::new(anatomy::build(options, direction, &bar("building")?)?);
    let desc = SimDesc {
        backend: options.backend(),
        method: options.method(),
        precision: if options.f64 { Precision::Double } else { Precision::Single },
        threads: options.threads,
        sleeping: !options.no_sleep,
        ..SimDesc::default()
    };
    let mut sim = Sim::new(model.clone(), &desc)?;

    // The press.
    let tool = tool::Tool::new(options);
    let depth_m = options.depth_mm * 1e-3;
    let at_m = options.at.map(|at_mm| at_mm * 1e-3);
    let approach = approach::choose(&sim, at_m, direction, depth_m + options.radius_mm * 1e-3)?;
    let plan = press::Plan { approach, depth_m, speed_m_s: options.speed_mm_s * 1e-3, step_s: desc.step_s };
    let camcorder = if options.no_pictures { None } else { Some(snapshot::Camcorder::new(&mut sim)?) };
    let record = press::run(&mut sim, &tool, &plan, camcorder, &bar("pressing")?)?;

    // What is left of it.
    report::write_csv(&record.rows, &out.join("run.csv"))?;
    plot::write(&record.rows, &out.join("force_indentation.png"))?;
    if let [before, pressed] = &record.snapshots[..] {
        let bar = bar("drawing")?;
        let subject = picture::Subject { model: &model, tool: &tool, direction, before, pressed };
        picture::write_all(&subject, out, &bar)?;
    }
    Ok(report::table(options, &model, sim.place(), &tool, &plan, &record))
}

/// A progress bar, which shows nothing where there is no terminal.
fn bar(what: &'static str) -> anyhow::Result<ProgressBar> {
    let style = ProgressStyle::with_template("{prefix:9} {bar:36} {percent:3} %  {elapsed_precise}  {msg}")?;
    Ok(ProgressBar::no_length().with_style(style).with_prefix(what))
}
