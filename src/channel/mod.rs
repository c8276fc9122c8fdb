//! How threads meet: the newest value through [`latest`], every value through [`ring`].
//!
//! Both are wait-free for exactly two threads, and their endpoints are types that cannot be shared. Nothing here knows what is sent.
//! `tests/channels.sh` proves both under every interleaving of a few operations.

pub mod latest;
#[cfg(all(test, loom))]
mod proofs;
pub mod ring;
mod sync;
