//! The meshless model on the processor: implicit steps by matrix-free conjugate gradients, eight cells at a time.

mod conjugate;
mod gather;
mod laws;
mod press;
pub mod route;
pub mod solver;
mod system;
mod turn;
