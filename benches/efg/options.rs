//! The command line.

use clap::Parser;

use super::common::place::Machine;

/// Measures implicit steps of the meshless model with a tool in contact.
#[derive(Clone, Debug, Parser)]
#[command(name = "efg")]
pub struct Options {
    #[command(flatten)]
    pub machine: Machine,

    /// Cells of the block, as near as it can be; several sizes when left out
    #[arg(long, value_name = "N")]
    cells: Vec<usize>,

    /// Length of a step; 1e-3 when left out
    #[arg(long, value_name = "S")]
    dt: Vec<f64>,

    /// Poisson's ratio
    #[arg(long, value_name = "V", default_value_t = 0.45)]
    pub nu: f64,

    /// Young's modulus
    #[arg(long, value_name = "PA", default_value_t = 5e3)]
    pub young: f64,

    /// How many times as stiff a ball in the middle of the block is
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub contrast: f64,

    /// Share of a step's first residual that may be left
    #[arg(long, value_name = "X", default_value_t = 1e-3)]
    pub tolerance: f64,

    /// Tissue time that is measured
    #[arg(long, value_name = "S", default_value_t = 0.2)]
    pub seconds: f64,

    /// Leave out what it is compared with, which takes its time where steps are long or stiffness varies
    #[arg(long)]
    pub no_baseline: bool,

    /// Press the lattice of the same block too
    #[arg(long)]
    pub beside_lattice: bool,

    /// Print one JSON object per line instead of a table
    #[arg(long)]
    pub json: bool,

    /// What cargo adds to the command line of a bench
    #[arg(long, hide = true)]
    bench: bool,
}

impl Options {
    /// Sizes.
    pub fn cells(&self) -> Vec<usize> {
        if self.cells.is_empty() { vec![1_000, 6_000, 80_000] } else { self.cells.clone() }
    }

    /// How many steps of a length are taken.
    pub fn steps(&self, dt: f64) -> usize {
        (self.seconds / dt).ceil().max(4.0) as usize
    }

    /// Lengths of a step.
    pub fn dt(&self) -> Vec<f64> {
        if self.dt.is_empty() { vec![1e-3] } else { self.dt.clone() }
    }
}
