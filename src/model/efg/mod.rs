//! The meshless model: element-free Galerkin (Belytschko, Lu and Gu 1994) on the cells of a grid, as Magnoux and Ozell (2021) make it fit
//! for a GPU, in corrected form.
//!
//! The cells of the [lattice](super::lattice) are the integration cells, their corners the nodes. One point in each cell integrates it; moving
//! least squares over the nodes that it sees give the deformation there ([`mls`]). A cell that sees its own eight corners has the same shape
//! functions as every other such cell, and nothing is stored for it.
//!
//! One point cannot see eight corners move against each other: on a grid of 4 × 4 × 4 cells 51 patterns of motion meet no resistance. What is left of a
//! corner's motion after the best affine motion of its cell is resisted by a spring ([`law::HOURGLASS`]), which changes no
//! affine motion.

pub mod energy;
pub mod law;
pub mod mls;
