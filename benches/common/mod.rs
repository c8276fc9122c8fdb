//! What benches share: where they run, what they count, and the anatomy that they press.

pub mod allocations;
pub mod anatomy;
pub mod place;
pub mod table;
