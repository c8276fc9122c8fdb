//! WHERE, on the processor: SIMD over rows of eight nodes, a few persistent threads.

pub mod contact;
pub mod denormal;
pub mod efg;
mod facing;
mod grasp;
mod hold;
pub(crate) mod lanes;
pub mod lattice;
mod looked;
mod mobile;
pub mod nodes;
pub mod sleep;
pub mod solver;
pub mod stability;
pub mod surface;
pub mod workers;
