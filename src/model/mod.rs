//! WHAT is simulated: immutable, free of any backend, built once in double precision and shared by [`Arc`](std::sync::Arc).

pub mod binding;
pub mod build;
pub mod extract;
pub mod grid;
pub mod lattice;
pub mod material;
pub mod mesh;
pub mod phantom;
pub mod surface;

pub use build::{Build, Fix, LabelUse, Model, SurfaceSource};
