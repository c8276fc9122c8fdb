//! Where a simulation runs: what is asked for, and what comes of it.

use std::fmt;
use std::sync::Arc;

use super::{MAX_THREADS, Precision, SimDesc};
use crate::cpu::efg::solver::EfgSolver;
use crate::cpu::solver::CpuSolver;
use crate::cuda::device::Device;
use crate::cuda::efg::solver::CudaEfgSolver;
use crate::cuda::solver::CudaSolver;
use crate::error::{Error, Result};
use crate::model::Model;
use crate::solver::Solver;
use crate::solver::method::Method;

/// Where a simulation shall run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// On the first GPU that can run it, otherwise on the processor; [`Sim::place`](super::Sim::place) says why. This is decided once,
    /// when the simulation is created.
    Auto,
    /// On the processor, which does all that this library can do.
    #[default]
    Cpu,
    /// On a GPU, the lattice in single precision, or not at all.
    Cuda {
        /// Which one; `None` takes the first that the kernels run on.
        index: Option<u32>,
    },
}

/// Where a simulation runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// [`Backend::Cpu`], or [`Backend::Cuda`] with the GPU's index.
    pub backend: Backend,
    /// The GPU's name; the number of threads on the processor.
    pub device: String,
    /// Why [`Backend::Auto`] took the processor.
    pub fallback: Option<String>,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.device)?;
        match self.backend {
            Backend::Cuda { index: Some(index) } => write!(f, " (GPU {index})"),
            _ => Ok(()),
        }
    }
}

/// A model at rest on the backend of a desc.
pub(super) fn open(model: &Arc<Model>, desc: &SimDesc) -> Result<(Box<dyn Solver>, Place)> {
    match desc.backend {
        Backend::Cpu => on_cpu(model, desc, None),
        Backend::Cuda { index } => on_gpu(model, desc, index),
        Backend::Auto => on_gpu(model, desc, None).or_else(|why| on_cpu(model, desc, Some(why.to_string()))),
    }
}

fn on_cpu(model: &Arc<Model>, desc: &SimDesc, fallback: Option<String>) -> Result<(Box<dyn Solver>, Place)> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = if desc.threads == 0 { cores.min(MAX_THREADS) } else { desc.threads };
    let solver: Box<dyn Solver> = match (&desc.method, desc.precision) {
        (Method::Lattice, Precision::Single) => {
            Box::new(CpuSolver::<f32>::new(model, threads, desc.cut_nodes)?)
        }
        (Method::Lattice, Precision::Double) => {
            Box::new(CpuSolver::<f64>::new(model, threads, desc.cut_nodes)?)
        }
        (Method::Efg(efg), Precision::Single) => {
            Box::new(EfgSolver::<f32>::new(model, efg, threads, desc.cut_nodes)?)
        }
        (Method::Efg(efg), Precision::Double) => {
            Box::new(EfgSolver::<f64>::new(model, efg, threads, desc.cut_nodes)?)
        }
    };
    let device = format!("CPU, {threads} thread{}", if threads == 1 { "" } else { "s" });
    Ok((solver, Place { backend: Backend::Cpu, device, fallback }))
}

fn on_gpu(model: &Arc<Model>, desc: &SimDesc, index: Option<u32>) -> Result<(Box<dyn Solver>, Place)> {
    if desc.method == Method::Lattice && desc.precision == Precision::Double {
        return Err(Error::Unsupported("the lattice runs in single precision on a GPU".into()));
    }
    let device = Device::open(index)?;
    let info = device.info().clone();
    let solver: Box<dyn Solver> = match (&desc.method, desc.precision) {
        (Method::Lattice, _) => Box::new(CudaSolver::new(model, device, desc.cut_nodes)?),
        (Method::Efg(efg), Precision::Single) => {
            Box::new(CudaEfgSolver::<f32>::new(model, efg, device, desc.cut_nodes)?)
        }
        (Method::Efg(efg), Precision::Double) => {
            Box::new(CudaEfgSolver::<f64>::new(model, efg, device, desc.cut_nodes)?)
        }
    };
    let backend = Backend::Cuda { index: Some(info.index) };
    Ok((solver, Place { backend, device: info.name, fallback: None }))
}
