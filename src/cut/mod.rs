//! Cutting: what a blade's way does to the topology of a lattice. Backend-free.
//!
//!
#![doc = include_str!("../../docs/cutting.md")]

mod block;
pub mod cell;
pub mod extents;
pub mod facing;
pub mod inside;
pub mod margin;
pub mod region;
pub mod surface;
pub mod sweep;
pub mod topology;
