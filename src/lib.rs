//! palpate: soft tissue that can be seen, touched and cut in real time.

pub mod capi;
pub mod channel;
pub mod cpu;
pub mod error;
pub mod log;
pub mod math;
pub mod model;
pub mod sim;
pub mod solver;
