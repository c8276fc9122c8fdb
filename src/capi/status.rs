//! Status codes, the one table from errors to codes, and the last error of a thread.

use std::borrow::Cow;
use std::cell::UnsafeCell;
use std::ffi::c_char;

use crate::error::Error;

/// What a call answers: 0 on success, negative on error, positive on success with a remark.
/// A call that answers an error has written none of its outputs, and changed nothing unless it was the
/// simulation that failed: PLP_ERR_DIVERGED, PLP_ERR_DEVICE, PLP_ERR_PANIC.
pub type plp_status = i32;

/// The call did what was asked.
pub const PLP_OK: plp_status = 0;
/// The simulation (or its tool) behind a port is gone or failed; the call answered with the last known
/// values, forces with zero.
pub const PLP_STOPPED: plp_status = 1;
/// The call worked and found nothing; outputs are untouched.
pub const PLP_NOTHING: plp_status = 2;
/// The caller's array was shorter than the list; as much as fits was written.
pub const PLP_TRUNCATED: plp_status = 3;

/// A pointer that must not be NULL is NULL.
pub const PLP_ERR_NULL: plp_status = -101;
/// A handle of another kind, one that was destroyed, or no handle at all.
pub const PLP_ERR_INVALID_HANDLE: plp_status = -102;
/// A struct size that no version of this library knows; use the init function or sizeof.
pub const PLP_ERR_STRUCT_SIZE: plp_status = -103;
/// A value that the call cannot accept: not finite, out of range, unknown.
pub const PLP_ERR_ARGUMENT: plp_status = -104;
/// The call does not fit the handle's state, such as mapping a surface twice.
pub const PLP_ERR_STATE: plp_status = -105;
/// Another thread is inside a call on the same handle.
pub const PLP_ERR_BUSY: plp_status = -106;
/// Something that a newer header or a file may ask for, which this library does not do.
pub const PLP_ERR_UNSUPPORTED: plp_status = -107;

/// A file or buffer that does not follow its format, or promises more than it holds.
pub const PLP_ERR_FORMAT: plp_status = -201;
/// A file that cannot be opened or read.
pub const PLP_ERR_IO: plp_status = -202;
/// More than the library's stated limits: voxels, cells, materials, tools, memory.
pub const PLP_ERR_LIMIT: plp_status = -203;
/// The progress callback asked to stop.
pub const PLP_ERR_CANCELLED: plp_status = -204;

/// The simulation's state stopped being finite; it is frozen at its last good state. Reset it, or destroy it.
pub const PLP_ERR_DIVERGED: plp_status = -301;

/// No GPU that can be used, or no driver for it. The message says why.
pub const PLP_ERR_NO_DEVICE: plp_status = -401;
/// The GPU or its driver failed. A simulation that ran on it is lost and can only be destroyed; a new one may run
/// on the processor.
pub const PLP_ERR_DEVICE: plp_status = -402;

/// A defect of the library, contained. The message says where; please report it.
pub const PLP_ERR_PANIC: plp_status = -901;
/// An earlier call on this simulation answered PLP_ERR_PANIC; it can only be destroyed.
pub const PLP_ERR_POISONED: plp_status = -902;

/// Names of all codes. Numbers are never used again; none is retired yet.
const NAMES: &[(plp_status, &std::ffi::CStr)] = &[
    (PLP_OK, c"PLP_OK"),
    (PLP_STOPPED, c"PLP_STOPPED"),
    (PLP_NOTHING, c"PLP_NOTHING"),
    (PLP_TRUNCATED, c"PLP_TRUNCATED"),
    (PLP_ERR_NULL, c"PLP_ERR_NULL"),
    (PLP_ERR_INVALID_HANDLE, c"PLP_ERR_INVALID_HANDLE"),
    (PLP_ERR_STRUCT_SIZE, c"PLP_ERR_STRUCT_SIZE"),
    (PLP_ERR_ARGUMENT, c"PLP_ERR_ARGUMENT"),
    (PLP_ERR_STATE, c"PLP_ERR_STATE"),
    (PLP_ERR_BUSY, c"PLP_ERR_BUSY"),
    (PLP_ERR_UNSUPPORTED, c"PLP_ERR_UNSUPPORTED"),
    (PLP_ERR_FORMAT, c"PLP_ERR_FORMAT"),
    (PLP_ERR_IO, c"PLP_ERR_IO"),
    (PLP_ERR_LIMIT, c"PLP_ERR_LIMIT"),
    (PLP_ERR_CANCELLED, c"PLP_ERR_CANCELLED"),
    (PLP_ERR_DIVERGED, c"PLP_ERR_DIVERGED"),
    (PLP_ERR_NO_DEVICE, c"PLP_ERR_NO_DEVICE"),
    (PLP_ERR_DEVICE, c"PLP_ERR_DEVICE"),
    (PLP_ERR_PANIC, c"PLP_ERR_PANIC"),
    (PLP_ERR_POISONED, c"PLP_ERR_POISONED"),
];

/// The code of an error: the only place where the two meet.
fn code_of(error: &Error) -> plp_status {
    match error {
        Error::Argument(_) => PLP_ERR_ARGUMENT,
        Error::Format { .. } => PLP_ERR_FORMAT,
        Error::Io { .. } => PLP_ERR_IO,
        Error::Unsupported(_) => PLP_ERR_UNSUPPORTED,
        Error::Limit(_) => PLP_ERR_LIMIT,
        Error::State(_) => PLP_ERR_STATE,
        Error::Defect(_) => PLP_ERR_POISONED,
        Error::Cancelled => PLP_ERR_CANCELLED,
        Error::Diverged { .. } => PLP_ERR_DIVERGED,
        Error::NoDevice(_) => PLP_ERR_NO_DEVICE,
        Error::Device(_) => PLP_ERR_DEVICE,
    }
}

/// A status below 0 and its message, on the way to the border.
#[derive(Debug)]
pub(super) struct Fault {
    pub status: plp_status,
    pub message: Cow<'static, str>,
}

impl Fault {
    pub fn new(status: plp_status, message: impl Into<Cow<'static, str>>) -> Self {
        Self { status, message: message.into() }
    }

    /// A `PLP_ERR_ARGUMENT`.
    pub fn argument(message: impl Into<Cow<'static, str>>) -> Self {
        Self::new(PLP_ERR_ARGUMENT, message)
    }

    /// A `PLP_ERR_NULL` about the parameter or field `what`.
    pub fn null(what: &str) -> Self {
        Self::new(PLP_ERR_NULL, format!("{what} is NULL"))
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        Self::new(code_of(&error), error.to_string())
    }
}

/// The name of a status code, such as "PLP_ERR_BUSY"; "PLP_?" for a number that is none. Static memory.
///
/// @thread any
#[unsafe(no_mangle)]
pub extern "C" fn plp_status_name(status: plp_status) -> *const c_char {
    NAMES.iter().find(|(code, _)| *code == status).map_or(c"PLP_?", |(_, name)| name).as_ptr()
}

const MESSAGE_BYTES: usize = 1024;

thread_local! {
    // Fixed size and no destructor: setting a message never fails and works while a thread ends.
    static LAST: UnsafeCell<[u8; MESSAGE_BYTES]> = const { UnsafeCell::new([0; MESSAGE_BYTES]) };
}

/// What went wrong in the last failing call on this thread: a sentence in UTF-8, at most 1023 bytes, never
/// NULL, empty before the first failure. Valid until the next failing call on the same thread. Successful
/// calls leave it alone, and so do the @rt functions.
///
/// @thread any
#[unsafe(no_mangle)]
pub extern "C" fn plp_last_error() -> *const c_char {
    LAST.with(|last| last.get().cast::<c_char>().cast_const())
}

/// Sets this thread's message, cut at a character where it is too long.
pub(super) fn set_last_error(message: &str) {
    let text = super::boundary::fitting(message, MESSAGE_BYTES - 1);
    LAST.with(|last| {
        // SAFETY: the buffer belongs to this thread and no reference to it outlives this closure; a pointer
        // that the host got from `plp_last_error` is documented to change here.
        let buffer = unsafe { &mut *last.get() };
        buffer[..text.len()].copy_from_slice(text.as_bytes());
        buffer[text.len()] = 0;
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    fn last_error() -> String {
        // SAFETY: the pointer is this thread's own buffer, which always ends in a zero.
        unsafe { CStr::from_ptr(plp_last_error()) }.to_str().expect("valid UTF-8").to_owned()
    }

    #[test]
    fn every_status_has_its_own_number_in_the_right_group() {
        for (i, (code, _)) in NAMES.iter().enumerate() {
            assert!(NAMES[..i].iter().all(|(earlier, _)| earlier != code), "{code} occurs twice");
            assert!((-999..100).contains(code) && !(-100..0).contains(code));
        }
    }

    #[test]
    fn a_long_message_is_cut_between_characters() {
        // 'ä' takes two bytes and 1023 is odd, so the last one does not fit.
        set_last_error(&"ä".repeat(2000));
        assert_eq!(last_error(), "ä".repeat(511));
        set_last_error("short");
        assert_eq!(last_error(), "short");
    }

    #[test]
    fn each_thread_has_its_own_message() {
        set_last_error("mine");
        std::thread::spawn(|| assert_eq!(last_error(), "")).join().unwrap();
        assert_eq!(last_error(), "mine");
    }
}
