//! What can be chosen.

use std::path::PathBuf;

use anyhow::bail;
use clap::{Parser, ValueEnum};
use palpate::sim::{Backend, SimDesc};
use palpate::solver::method::{EfgDesc, Method};

use super::torus::Torus;

/// What is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Subject {
    /// A torus that hangs by its top
    Torus,
    /// A tumour under the skin of a chest
    Tumour,
}

/// What computes the tissue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Model {
    /// The meshless model, by implicit steps
    Efg,
    /// The lattice of springs, by explicit substeps
    Lattice,
}

/// Where it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Runs {
    /// The processor
    Cpu,
    /// A GPU
    Cuda,
    /// A GPU where there is one that can
    Auto,
}

/// Cuts soft tissue with a blade of several segments on a fixed path.
#[derive(Clone, Debug, Parser)]
#[command(name = "cutting")]
pub struct Options {
    /// What is cut
    #[arg(long, value_enum, default_value_t = Subject::Torus)]
    pub scene: Subject,

    /// How many cells the torus has, about
    #[arg(long, value_name = "N", default_value_t = Torus::default().cells)]
    pub cells: u32,

    /// How many triangles its surface has, about
    #[arg(long, value_name = "N", default_value_t = Torus::default().triangles)]
    pub triangles: u32,

    /// Edge length of a cell of the chest
    #[arg(long, value_name = "MM", default_value_t = 3.0)]
    pub cell_mm: f64,

    /// What computes the tissue
    #[arg(long, value_enum, default_value_t = Model::Efg)]
    model: Model,

    /// Where it runs
    #[arg(long, value_enum, default_value_t = Runs::Auto)]
    backend: Runs,

    /// Length of a step
    #[arg(long, value_name = "MS", default_value_t = 1e3 / 60.0)]
    pub step_ms: f64,

    /// Young's modulus of the torus
    #[arg(long, value_name = "KPA", default_value_t = Torus::default().young_kpa)]
    pub young_kpa: f64,

    /// The tissue's toughness
    #[arg(long, value_name = "J/M2", default_value_t = Torus::default().toughness_j_m2)]
    pub toughness: f64,

    /// Pictures of the animation; 0 for none
    #[arg(long, value_name = "N", default_value_t = 48)]
    pub frames: u32,

    /// Folder for pictures and numbers
    #[arg(long, value_name = "DIR", default_value = "out/cutting")]
    pub out: PathBuf,
}

impl Options {
    /// Refuses what cannot be.
    pub fn check(&self) -> anyhow::Result<()> {
        if !(1500..=4_000_000).contains(&self.cells) {
            bail!("--cells {}: 1500 to 4000000 are possible", self.cells);
        }
        if !(1500..=1_000_000).contains(&self.triangles) {
            bail!("--triangles {}: 1500 to 1000000 are possible", self.triangles);
        }
        if !(0.1..=50.0).contains(&self.step_ms) {
            bail!("--step-ms {}: 0.1 to 50 are possible", self.step_ms);
        }
        if !(1.0..=10.0).contains(&self.cell_mm) {
            bail!("--cell-mm {}: 1 to 10 are possible", self.cell_mm);
        }
        Ok(())
    }

    /// Length of a step in s.
    pub fn step_s(&self) -> f64 {
        self.step_ms * 1e-3
    }

    /// The torus.
    pub fn torus(&self) -> Torus {
        let Self { cells, triangles, young_kpa, toughness: toughness_j_m2, .. } = *self;
        Torus { cells, triangles, young_kpa, toughness_j_m2 }
    }

    /// Where and how it runs.
    pub fn desc(&self) -> SimDesc {
        let backend = match self.backend {
            Runs::Cpu => Backend::Cpu,
            Runs::Cuda => Backend::Cuda { index: None },
            Runs::Auto => Backend::Auto,
        };
        let method = match self.model {
            Model::Efg => Method::Efg(EfgDesc::default()),
            Model::Lattice => Method::Lattice,
        };
        SimDesc { method, backend, step_s: self.step_s(), ..SimDesc::default() }
    }
}
