//! The command line.

use clap::{Parser, ValueEnum};

use super::common::place::{Backend, Machine};

/// Measures steps of the lattice with a tool in contact.
#[derive(Clone, Debug, Parser)]
#[command(name = "lattice")]
pub struct Options {
    #[command(flatten)]
    pub machine: Machine,

    /// Scene to run; may be repeated. All when left out, thorax-1.5mm on a GPU only
    #[arg(long = "scene", value_enum, value_name = "NAME")]
    pub scenes: Vec<SceneName>,

    /// Nodes of the ellipsoid, as near as it can be; several sizes when left out
    #[arg(long, value_name = "N")]
    pub nodes: Option<usize>,

    /// Simulated length of a step; 1e-3 on the processor, 100 stable substeps on a GPU when left out
    #[arg(long, value_name = "S")]
    pub dt: Option<f64>,

    /// Substeps of a step; as many as the model needs when left out, but 100 on a GPU where --dt is left out too
    #[arg(long, value_name = "N", conflicts_with = "latency")]
    pub substeps: Option<u32>,

    /// Poisson's ratio of all tissue; 0.25 and 0.45 in the ellipsoid, presets in the thorax when left out
    #[arg(long, value_name = "V")]
    pub nu: Option<f64>,

    /// Young's modulus of all tissue; 3 kPa (on a GPU 20 kPa) in the ellipsoid, presets in the thorax when left out
    #[arg(long, value_name = "PA")]
    pub young: Option<f64>,

    /// Cap on Young's modulus in the thorax
    #[arg(long, value_name = "PA", default_value_t = 20e3)]
    pub young_cap: f64,

    /// Simulated time that is measured in each scene
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    pub seconds: f64,

    /// Measure tissue at rest without a tool instead, awake and asleep
    #[arg(long, conflicts_with_all = ["scenes", "latency"])]
    pub still: bool,

    /// Measure what a servo loop waits for instead: pose in, a step of one substep, force out, in the ellipsoid
    #[arg(long, conflicts_with = "scenes")]
    pub latency: bool,

    /// Ticks of that loop
    #[arg(long, value_name = "N", default_value_t = 100_000, requires = "latency", value_parser = positive)]
    pub ticks: usize,

    /// Print one JSON object per line instead of a table
    #[arg(long)]
    pub json: bool,

    /// What cargo adds to the command line of a bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// What is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SceneName {
    /// Axes 1 : 0.7 : 0.5, one material, a sphere pressed in.
    Ellipsoid,
    /// The thorax at a third of its resolution.
    #[value(name = "thorax-4.5mm")]
    Thorax45,
    /// The thorax at half its resolution.
    #[value(name = "thorax-3mm")]
    Thorax3,
    /// The thorax at its full resolution.
    #[value(name = "thorax-1.5mm")]
    Thorax15,
    /// The lungs alone, with their vessels and airway walls.
    #[value(name = "lung-4.5mm")]
    Lung45,
}

impl Options {
    /// The scenes asked for.
    pub fn scenes(&self) -> Vec<SceneName> {
        if !self.scenes.is_empty() {
            return self.scenes.clone();
        }
        let takes_minutes = |scene| scene == SceneName::Thorax15 && self.machine.backend == Backend::Cpu;
        SceneName::value_variants().iter().copied().filter(|&scene| !takes_minutes(scene)).collect()
    }
}

/// A count that is not 0.
fn positive(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(0) => Err("must be at least 1".into()),
        Ok(count) => Ok(count),
        Err(error) => Err(format!("{error}")),
    }
}
