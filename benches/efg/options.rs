//! The command line.

use clap::{Parser, ValueEnum};
use serde::Serialize;

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

    /// What is pressed
    #[arg(long, value_enum, default_value_t = Scene::Block)]
    pub scene: Scene,

    /// Edge of a cell
    #[arg(long, value_name = "M", default_value_t = 2e-3)]
    pub cell: f64,

    /// Radius of the ball, as a share of the block's width
    #[arg(long, value_name = "X", default_value_t = 1.0 / 12.0)]
    pub ball: f64,

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

    /// Press the lattice of the same block too, and say how far both are from the same block in finer cells
    #[arg(long)]
    pub beside_lattice: bool,

    /// How many times finer those cells are, and how much shorter their steps at least
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(2..))]
    pub finer: u32,

    /// Print one JSON object per line instead of a table
    #[arg(long)]
    pub json: bool,

    /// What cargo adds to the command line of a bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// A block, and how it begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Scene {
    /// It falls into its shape under gravity; tools meet its smoothed surface.
    Block,
    /// It is at rest under gravity; tools meet its flat top, which is the same in cells of all sizes.
    Flat,
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
