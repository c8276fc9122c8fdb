//! The meshless model on the processor: implicit steps by matrix-free conjugate gradients, eight cells at a time.

mod block;
pub(crate) mod cell_rows;
mod conjugate;
mod edge;
mod gather;
mod laws;
pub(crate) mod press;
pub mod route;
pub(crate) mod rows;
pub mod solver;
mod system;
mod turn;
