//! Which of the models computes the tissue, and how.

use crate::error::{Error, Result};
pub use crate::model::efg::law::Elasticity;

/// What computes the tissue of a model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Method {
    /// The calibrated lattice of springs, by explicit substeps: the cheapest way through a millisecond of soft tissue.
    #[default]
    Lattice,
    /// The meshless model, by implicit steps of any length.
    Efg(EfgDesc),
}

/// How the meshless model is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EfgDesc {
    /// How tissue answers to strain.
    pub elasticity: Elasticity,
    /// How a step is taken.
    pub scheme: Scheme,
    /// A step's solution is good enough when the true residual is this share of what it was before.
    pub tolerance: f64,
    /// Most iterations of a step; what was reached by then stands, and the statistics say so.
    pub max_iterations: u32,
}

/// How velocities at the end of a step follow from those at its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// By the forces at its end, linearised: stable for any step, and damps what swings faster than the step.
    #[default]
    BackwardEuler,
    /// As Magnoux and Ozell (2021) print it: by the forces at its start, on masses that grow with stiffness. Stable for any step, damps nothing, and turns what swings
    /// fast into something that swings six steps long.
    Paper,
}

impl Default for EfgDesc {
    fn default() -> Self {
        Self {
            elasticity: Elasticity::default(),
            scheme: Scheme::default(),
            tolerance: 1e-3,
            max_iterations: 500,
        }
    }
}

impl EfgDesc {
    /// Refuses tolerances and budgets that end nothing.
    pub fn check(&self) -> Result<()> {
        if !(1e-12..1.0).contains(&self.tolerance) {
            return Err(Error::argument(format!(
                "a tolerance of {} is not between 1e-12 and 1",
                self.tolerance
            )));
        }
        if !(1..=100_000).contains(&self.max_iterations) {
            return Err(Error::argument("a step has 1 to 100,000 iterations"));
        }
        Ok(())
    }
}
