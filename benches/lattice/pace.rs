//! How long a step is, and of how many substeps.

use palpate::model::Model;

use super::common::place::Backend;
use super::options::Options;

/// A step on the processor when the command line says nothing, in s.
const CPU_STEP_S: f64 = 1e-3;
/// Substeps of a step on a GPU when the command line says nothing.
const CUDA_SUBSTEPS: u32 = 100;
/// A substep whose number is given takes this share of the time in which a pressure wave crosses a cell of the fastest tissue. The lattice
/// is stable up to 0.81 to 0.96 of it at rest, and to three quarters of that under the strain of a press.
const COURANT: f64 = 0.5;

/// A step's length in s and its substeps; as many as the model needs where that is left open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    pub step_s: f64,
    pub substeps: Option<u32>,
}

impl Pace {
    /// What the options ask for. A number of substeps without a length makes steps of stable substeps.
    pub fn of(options: &Options, model: &Model) -> Self {
        match (options.dt, options.substeps, options.machine.backend) {
            (Some(step_s), substeps, _) => Self { step_s, substeps },
            (None, Some(substeps), _) => Self::stable(substeps, model),
            (None, None, Backend::Cpu) => Self { step_s: CPU_STEP_S, substeps: None },
            (None, None, Backend::Cuda) => Self::stable(CUDA_SUBSTEPS, model),
        }
    }

    /// So many substeps that are stable.
    pub fn stable(substeps: u32, model: &Model) -> Self {
        // A rigid material has no springs.
        let soft = model.materials().iter().zip(&model.laws()[1..]).filter(|(_, law)| law.spring_n_m > 0.0);
        let fastest = soft.map(|(material, _)| material.longitudinal_speed_m_s()).fold(0.0, f64::max);
        let substep_s = COURANT * model.lattice().cell_m() / fastest;
        Self { step_s: f64::from(substeps) * substep_s, substeps: Some(substeps) }
    }

    /// How many steps a time takes, at least one.
    pub fn steps(&self, time_s: f64) -> usize {
        (time_s / self.step_s).ceil().max(1.0) as usize
    }
}
