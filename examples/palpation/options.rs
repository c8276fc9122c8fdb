//! The command line.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::{Parser, ValueEnum};
use palpate::math::Vec3;
use palpate::sim::Backend;
use palpate::solver::method::{EfgDesc, Method};

/// Presses a tool into soft tissue, prints one table and writes pictures, a plot and the run as CSV.
#[derive(Clone, Debug, Parser)]
#[command(name = "palpation", allow_negative_numbers = true)]
pub struct Options {
    /// Label map to press (.nii, .nii.gz, .nrrd); a generated thorax when left out. Labels 0 to 10 are taken for those of a segmented chest:
    /// outside, lung, its vessels, airways, muscle and liver, heart, fat, aorta, airway wall, bone, spleen
    #[arg(long, value_name = "FILE")]
    pub labels: Option<PathBuf>,

    /// What a label becomes: empty, rigid or a tissue such as liver; may be repeated
    #[arg(long = "material", value_name = "LABEL=USE", requires = "labels")]
    pub materials: Vec<String>,

    /// Edge length of a cell
    #[arg(long, value_name = "MM", default_value_t = 4.5)]
    pub cell_mm: f64,

    /// Cap on Young's modulus, so that stiff walls do not dictate the time step; 0 for none
    #[arg(long, value_name = "KPA", default_value_t = 20.0)]
    pub young_cap_kpa: f64,

    /// Shape of the tool
    #[arg(long, value_enum, default_value_t = ToolKind::Sphere)]
    pub tool: ToolKind,

    /// Radius of the tool's tip (half the edge of the box)
    #[arg(long, value_name = "MM", default_value_t = 15.0)]
    pub radius_mm: f64,

    /// How deep to press, from first contact
    #[arg(long, value_name = "MM", default_value_t = 20.0)]
    pub depth_mm: f64,

    /// How fast the tool moves
    #[arg(long, value_name = "MM/S", default_value_t = 60.0)]
    pub speed_mm_s: f64,

    /// A point of the world in mm that the tool's axis goes through; chosen over soft tissue when left out
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub at: Option<Vec3>,

    /// Direction of the press in the world; from the front of the body to its back when left out
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    pub direction: Option<Vec3>,

    /// Coulomb friction between tool and tissue
    #[arg(long, value_name = "MU", default_value_t = 0.2)]
    pub friction: f64,

    /// What computes the tissue
    #[arg(long, value_enum, default_value_t = ModelKind::Lattice)]
    pub model: ModelKind,

    /// Where the tissue is computed
    #[arg(long, value_enum, default_value_t = BackendKind::Cpu)]
    pub backend: BackendKind,

    /// Threads that compute; 0 for one on each core
    #[arg(long, value_name = "COUNT", default_value_t = 0)]
    pub threads: usize,

    /// Compute in double precision
    #[arg(long)]
    pub f64: bool,

    /// Keep all tissue awake
    #[arg(long)]
    pub no_sleep: bool,

    /// Write the CSV and the plot only
    #[arg(long)]
    pub no_pictures: bool,

    /// Where results go
    #[arg(long, value_name = "DIR", default_value = "out/palpation")]
    pub out: PathBuf,
}

/// Shapes of the tool.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ToolKind {
    /// A ball on a thin shaft
    Sphere,
    /// A finger: a ball swept along the direction of the press
    Capsule,
    /// A square plate with rounded edges on a thin shaft
    Box,
}

/// What computes the tissue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ModelKind {
    /// A lattice of springs, by explicit substeps
    Lattice,
    /// The meshless model, by implicit steps; on the processor
    Efg,
}

/// Where the tissue is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BackendKind {
    /// On a GPU that can, or else on the processor
    Auto,
    /// On the processor
    Cpu,
    /// On an NVIDIA GPU
    Cuda,
}

impl Options {
    /// The library's word for what computes.
    pub fn method(&self) -> Method {
        match self.model {
            ModelKind::Lattice => Method::Lattice,
            ModelKind::Efg => Method::Efg(EfgDesc::default()),
        }
    }

    /// The library's word for where to compute.
    pub fn backend(&self) -> Backend {
        match self.backend {
            BackendKind::Auto => Backend::Auto,
            BackendKind::Cpu => Backend::Cpu,
            BackendKind::Cuda => Backend::Cuda { index: None },
        }
    }

    /// Refuses sizes that make no sense before anything is built.
    pub fn check(&self) -> anyhow::Result<()> {
        let positive = [
            ("--cell-mm", self.cell_mm),
            ("--radius-mm", self.radius_mm),
            ("--depth-mm", self.depth_mm),
            ("--speed-mm-s", self.speed_mm_s),
        ];
        for (name, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                bail!("{name} must be a number above 0, not {value}");
            }
        }
        if !(self.young_cap_kpa.is_finite() && self.young_cap_kpa >= 0.0) {
            bail!("--young-cap-kpa must be a number of at least 0, not {}", self.young_cap_kpa);
        }
        if self.direction.is_some_and(|d| d.norm() < 1e-9) {
            bail!("--direction must not be zero");
        }
        Ok(())
    }
}

/// Three numbers with commas between them.
fn vector(text: &str) -> anyhow::Result<Vec3> {
    let numbers = text
        .split(',')
        .map(|part| part.trim().parse::<f64>().with_context(|| format!("'{part}' is not a number")))
        .collect::<anyhow::Result<Vec<f64>>>()?;
    match numbers[..] {
        [x, y, z] if numbers.iter().all(|n| n.is_finite()) => Ok(Vec3::new(x, y, z)),
        _ => bail!("three finite numbers such as 0,-1,0 are needed"),
    }
}
