//! Where a simulation runs: the part of a command line that says so, and what figures say of it.

use clap::{Args, ValueEnum};
use palpate::cuda::device::Device;
use palpate::error::Result;
use palpate::sim::{self, Precision, SimDesc};
use serde::Serialize;

/// Where a simulation runs, and in what arithmetic.
#[derive(Clone, Debug, Args)]
pub struct Machine {
    /// Where the simulation runs
    #[arg(long, value_enum, default_value_t = Backend::Cpu)]
    pub backend: Backend,

    /// Arithmetic of a step
    #[arg(long, value_enum, default_value_t = Arithmetic::F32)]
    pub precision: Arithmetic,

    /// Threads that compute; 0 for one on each core
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub threads: usize,
}

/// Where a simulation runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    Cpu,
    Cuda,
}

/// The arithmetic of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Arithmetic {
    F32,
    F64,
}

impl Machine {
    /// Beside a servo thread: on the processor, all cores but the one that it needs where the command line says nothing.
    pub fn beside_servo(&self) -> Self {
        let threads = if self.threads == 0 { (cores() - 1).max(1) } else { self.threads };
        Self { threads, ..self.clone() }
    }

    /// A simulation there, all else as by default.
    pub fn desc(&self) -> SimDesc {
        SimDesc {
            backend: match self.backend {
                Backend::Cpu => sim::Backend::Cpu,
                Backend::Cuda => sim::Backend::Cuda { index: None },
            },
            precision: match self.precision {
                Arithmetic::F32 => Precision::Single,
                Arithmetic::F64 => Precision::Double,
            },
            threads: self.threads,
            ..SimDesc::default()
        }
    }
}

/// What all figures of a run share.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Place {
    pub backend: &'static str,
    pub device: String,
    pub precision: &'static str,
    /// Threads that compute, on the processor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threads: Option<usize>,
}

impl Place {
    /// The place that the command line asks for; an error where there is none.
    pub fn of(machine: &Machine) -> Result<Self> {
        let precision = if machine.precision == Arithmetic::F32 { "f32" } else { "f64" };
        Ok(match machine.backend {
            Backend::Cpu => {
                let threads = if machine.threads == 0 { cores() } else { machine.threads };
                Self { backend: "cpu", device: processor(), precision, threads: Some(threads) }
            }
            Backend::Cuda => {
                let device = Device::open(None)?.info().name.clone();
                Self { backend: "cuda", device, precision, threads: None }
            }
        })
    }

    /// In words.
    pub fn words(&self) -> String {
        let threads = self.threads.map_or(String::new(), |threads| format!(", {threads} threads"));
        format!("{}{threads}, {}", self.device, self.precision)
    }
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The processor's own name where the system tells it.
fn processor() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let line = told.lines().find_map(|line| line.strip_prefix("model name"));
    let name = line.and_then(|line| line.split_once(':')).map(|(_, name)| name.trim().to_owned());
    name.unwrap_or_else(|| std::env::consts::ARCH.to_owned())
}
