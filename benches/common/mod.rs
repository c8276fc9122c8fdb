//! What benches share: where they run, what they count and how it is told, and the anatomy that they press.

pub mod allocations;
pub mod anatomy;
pub mod clock;
pub mod place;
pub mod report;
pub mod table;
