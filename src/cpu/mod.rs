//! WHERE, on the processor: SIMD over rows of eight nodes, a few persistent threads.

pub mod lanes;
pub mod lattice;
pub mod nodes;
pub mod workers;
