//! HOW a step is asked for: what every backend must answer, and what tools, loads and statistics are.

pub mod load;
pub mod statistics;
pub mod tool;
