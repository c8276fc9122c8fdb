//! What can go wrong, in words a host's user can act on.
//!
//! Errors are values up to the C border, where `capi::status` maps each variant to one status code.

use std::path::PathBuf;

/// The result of every fallible call in this crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A reason why a call did nothing. Every failing call leaves its arguments and the simulation as they were.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value that the call cannot accept: not finite, out of range, wrong length.
    #[error("{0}")]
    Argument(String),

    /// A file or buffer that does not follow its format, or promises more than it holds.
    #[error("{what}: {reason}")]
    Format {
        /// The file, or the name of the buffer.
        what: String,
        /// What is wrong with it.
        reason: String,
    },

    /// A file that cannot be opened or read.
    #[error("{}: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        reason: std::io::Error,
    },

    /// Something a format or a host may ask for, which this build does not do.
    #[error("{0}")]
    Unsupported(String),

    /// More than the library's stated limits: cells, materials, tools, memory.
    #[error("{0}")]
    Limit(String),

    /// No GPU that can be used, or no driver for it.
    #[error("no GPU: {0}")]
    NoDevice(String),

    /// The GPU or its driver failed; the simulation on it is lost.
    #[error("the GPU failed: {0}")]
    Device(String),

    /// A call that does not fit what the simulation is doing.
    #[error("{0}")]
    State(String),

    /// A defect of this library ended the simulation.
    #[error("{0}")]
    Defect(String),

    /// The progress callback asked to stop.
    #[error("cancelled by the host")]
    Cancelled,

    /// The state stopped being finite; the simulation is frozen at its last good state.
    #[error("the simulation diverged at t = {time_s:.6} s: {reason}")]
    Diverged {
        /// Simulated time at which it was noticed.
        time_s: f64,
        /// What was seen.
        reason: String,
    },
}

impl Error {
    /// An [`Error::Argument`] from anything printable.
    pub fn argument(message: impl Into<String>) -> Self {
        Self::Argument(message.into())
    }

    /// An [`Error::Format`] about `what`.
    pub fn format(what: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Format { what: what.into(), reason: reason.into() }
    }
}
