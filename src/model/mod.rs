//! WHAT is simulated: immutable, free of any backend, built once in double precision and shared by [`Arc`](std::sync::Arc).

mod archive;
pub mod binding;
pub mod build;
pub mod efg;
pub mod energy;
pub mod extract;
pub mod fans;
mod fix;
pub mod grid;
pub mod import;
pub mod intensity;
pub mod lattice;
pub mod law;
pub mod material;
pub mod mesh;
pub mod phantom;
mod pieces;
mod placement;
mod resample;
pub mod solid;
pub mod surface;

pub use build::{Build, LabelUse, Model, SurfaceSource};
pub use fix::Fix;
