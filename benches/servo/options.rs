//! The command line.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};

use super::common::place::Machine;

/// Measures the servo loop of a haptic device.
#[derive(Clone, Debug, Parser)]
#[command(name = "servo")]
pub struct Options {
    #[command(flatten)]
    machine: Machine,

    /// Figure to take; may be repeated. All when left out
    #[arg(long = "figure", value_enum, value_name = "NAME")]
    figures: Vec<FigureName>,

    /// Calls of an exchange that are timed
    #[arg(long, value_name = "N", default_value_t = 10_000_000, value_parser = clap::value_parser!(u32).range(1000..))]
    pub calls: u32,

    /// How long the closed loop runs
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    pub seconds: f64,

    /// A picture of the map of stability, as PNG
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,

    /// Print one JSON object per line instead of tables
    #[arg(long)]
    pub json: bool,

    /// What cargo adds to the command line of a bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FigureName {
    Exchange,
    ClosedLoop,
    Prediction,
    Stability,
    Chest,
}

impl Options {
    /// The figures asked for.
    pub fn figures(&self) -> Vec<FigureName> {
        if self.figures.is_empty() { FigureName::value_variants().to_vec() } else { self.figures.clone() }
    }

    /// Where the simulation runs.
    pub fn machine(&self) -> Machine {
        self.machine.beside_servo()
    }
}
