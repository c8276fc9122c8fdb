//! How threads meet: the newest value through [`latest`].

pub mod latest;
