//! The physics that the lattice model claims, each test named by its claim.
//!
//! Every tolerance stands in [`tolerance`] with its reason. `PLP_TOL_SCALE` scales all of them; with 0 every check prints its residual
//! and fails.

mod beside;
mod contact;
mod efg;
mod efg_beams;
mod efg_block;
mod efg_modes;
mod elastic;
mod failure;
mod repeat;
mod scene;
mod shapes;
mod sleep;
mod statistics;
mod tolerance;
mod waves;
