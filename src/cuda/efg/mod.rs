//! The meshless model on a GPU: implicit steps by conjugate gradients, each step one kernel whose blocks are all at work at the same time.

mod rows;
pub mod solver;
mod state;

use super::kernels::{DOUBLE, Precision, SINGLE};
use super::memory::Plain;
use crate::cpu::lanes::Real;

/// Numbers in which the state is kept.
pub trait Number: Plain + Real {
    /// The kernels for them.
    const PRECISION: Precision;
}

impl Number for f32 {
    const PRECISION: Precision = SINGLE;
}

impl Number for f64 {
    const PRECISION: Precision = DOUBLE;
}
