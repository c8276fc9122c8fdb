//! Draws what the haptics example recorded: `cargo run --release --example haptics_plot -- haptics.csv haptics.png`.
//!
//! How deep the hand is, the force that it gets, how old that is, and what was done to it, over time.

#[path = "../common/chart.rs"]
mod chart;
mod picture;
mod record;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;

/// Draws a record of the haptics example.
#[derive(Parser, Debug)]
struct Options {
    /// The record, as the haptics example writes it.
    csv: PathBuf,
    /// The picture to write.
    #[arg(default_value = "haptics.png")]
    png: PathBuf,
}

fn main() -> ExitCode {
    let options = Options::parse();
    match run(&options.csv, &options.png) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("haptics_plot: {error:#}");
            ExitCode::FAILURE
        }
    }
}

pub use picture::SIZE;

/// Reads a record and writes its picture.
pub fn run(csv: &Path, png: &Path) -> anyhow::Result<()> {
    let ticks = record::read(csv)?;
    chart::write(png, picture::SIZE, |backend| picture::draw(&ticks, backend))
}
