//! Where a simulation runs, and what figures say of that.

use palpate::cuda::device::Device;
use palpate::error::Result;
use serde::Serialize;

use super::options::{Arithmetic, Backend, Options};

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
    /// The place that the options ask for; an error where there is none.
    pub fn of(options: &Options) -> Result<Self> {
        let precision = if options.precision == Arithmetic::F32 { "f32" } else { "f64" };
        Ok(match options.backend {
            Backend::Cpu => {
                let threads = if options.threads == 0 { cores() } else { options.threads };
                Self { backend: "cpu", device: processor(), precision, threads: Some(threads) }
            }
            Backend::Cuda => {
                let device = Device::open(None)?.info().name.clone();
                Self { backend: "cuda", device, precision, threads: None }
            }
        })
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
