//! The command line.

use clap::{Parser, ValueEnum};
use palpate::sim::SimDesc;
use palpate::solver::method::{EfgDesc, Method};
use serde::Serialize;

use super::common::place::{Backend, Machine};
use super::torus::Torus;

/// Length of a picture, in s.
pub const FRAME_S: f64 = 1.0 / 60.0;
/// A step on a GPU when the command line says nothing, in s.
const CUDA_STEP_S: f64 = 1e-3;
/// The torus of a GPU when the command line says nothing.
const CUDA_CELLS: u32 = 80_000;
const CUDA_TRIANGLES: u32 = 50_000;

/// Measures cuts of a running simulation.
#[derive(Clone, Debug, Parser)]
#[command(name = "cutting")]
pub struct Options {
    #[command(flatten)]
    pub machine: Machine,

    /// Figure to take; may be repeated. All when left out
    #[arg(long = "figure", value_enum, value_name = "NAME")]
    figures: Vec<FigureName>,

    /// Cells of the torus, about; of the first one in `largest`. 6000 on the processor and 80000 on a GPU when left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1500..=i64::from(MOST_CELLS)))]
    cells: Option<u32>,

    /// Triangles of its surface, about; 11520 on the processor and 50000 on a GPU when left out
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1500..=1_000_000))]
    triangles: Option<u32>,

    /// What computes the torus
    #[arg(long, value_enum, default_value_t = ModelName::Efg)]
    pub model: ModelName,

    /// Length of a step; when left out 1/60 on the processor and 1e-3 on a GPU, but 1/60 in `largest` anywhere
    #[arg(long, value_name = "S", value_parser = positive)]
    dt: Option<f64>,

    /// How much of the cut's simulated time is measured, from its start; what follows a cut is left out where that is not all of it. All when left out, but 1 in `largest`
    #[arg(long, value_name = "S", value_parser = positive)]
    pub seconds: Option<f64>,

    /// Print one JSON object per line instead of tables
    #[arg(long)]
    pub json: bool,

    /// What cargo adds to the command line of a bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// Most cells of a torus.
pub const MOST_CELLS: u32 = 4_000_000;

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FigureName {
    Torus,
    Servo,
    Largest,
    Thorax,
    Anew,
}

/// What computes the tissue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum ModelName {
    /// The meshless model, by implicit steps
    Efg,
    /// The lattice of springs, by explicit substeps
    Lattice,
}

impl ModelName {
    /// As the command line has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Efg => "efg",
            Self::Lattice => "lattice",
        }
    }

    /// For a simulation.
    pub fn method(self) -> Method {
        match self {
            Self::Efg => Method::Efg(EfgDesc::default()),
            Self::Lattice => Method::Lattice,
        }
    }
}

impl Options {
    /// The figures asked for.
    pub fn figures(&self) -> Vec<FigureName> {
        if self.figures.is_empty() { FigureName::value_variants().to_vec() } else { self.figures.clone() }
    }

    /// The torus asked for.
    pub fn torus(&self) -> Torus {
        let usual = Torus::default();
        let (cells, triangles) = match self.machine.backend {
            Backend::Cpu => (usual.cells, usual.triangles),
            Backend::Cuda => (CUDA_CELLS, CUDA_TRIANGLES),
        };
        let (cells, triangles) = (self.cells.unwrap_or(cells), self.triangles.unwrap_or(triangles));
        Torus { cells, triangles, ..usual }
    }

    /// Length of a step in s.
    pub fn step_s(&self) -> f64 {
        self.dt.unwrap_or(match self.machine.backend {
            Backend::Cpu => FRAME_S,
            Backend::Cuda => CUDA_STEP_S,
        })
    }

    /// The same where a step is a frame unless the command line says otherwise.
    pub fn frame_s(&self) -> f64 {
        self.dt.unwrap_or(FRAME_S)
    }

    /// A simulation of this model in steps of this length, all else as by default.
    pub fn desc(&self, model: ModelName, step_s: f64) -> SimDesc {
        SimDesc { method: model.method(), step_s, ..self.machine.desc() }
    }
}

/// A time above 0.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(time) if time.is_finite() && time > 0.0 => Ok(time),
        Ok(time) => Err(format!("{time} s is not a time that can be measured")),
        Err(error) => Err(error.to_string()),
    }
}
