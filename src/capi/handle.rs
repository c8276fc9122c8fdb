//! Opaque handles that answer misuse with a status.
//!
//! ```text
//!  host's pointer ──▶ Shell { kind, state, tag, aside, body } ──▶ Box<Body>
//! ```
//!
//! The host's pointer leads to a small *shell*. Destroying a handle frees its body and marks the shell dead,
//! but shells are never returned to the allocator: the oldest dead ones are used again once [`QUARANTINE`]
//! younger ones are dead. So a stale handle is found out without touching freed memory, and the memory kept
//! is bounded by the most handles that ever lived at once.
//!
//! `state` is the busy word: one thread at a time may be inside a call that changes the body ([`hold`]), or
//! any number inside calls that only read it ([`share`]). Nobody waits: who comes second is told so.

use std::collections::VecDeque;
use std::ffi::c_void;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use parking_lot::Mutex;

use super::aside::{Aside, WORDS};
use super::status::{Fault, PLP_ERR_BUSY, PLP_ERR_INVALID_HANDLE, PLP_ERR_NULL, plp_status};

/// Dead shells that are kept unused, so that this many handles later a stale one is still recognised.
const QUARANTINE: usize = 1024;

const DEAD: u32 = 0xDEAD_5E11;
const FREE: u32 = 0;
const HELD: u32 = u32::MAX;

/// A kind of handle. Implemented by the opaque types of the header.
pub(super) trait Handle: Sized {
    /// Tells the kinds apart in memory; unlikely as anything else.
    const KIND: u32;
    /// The header's name of the type.
    const NAME: &'static str;
    /// What the handle stands for. Calls may come from any thread, one after another.
    type Body: Send;
}

struct Shell {
    kind: AtomicU32,
    state: AtomicU32,
    tag: AtomicU64,
    aside: Aside,
    body: std::cell::UnsafeCell<*mut c_void>,
}

// SAFETY: `body` is only touched by whoever holds `state` exclusively, or read while `state` counts readers.
unsafe impl Sync for Shell {}
// SAFETY: bodies are `Send` (see `Handle::Body`), the other fields are atomics.
unsafe impl Send for Shell {}

static RETIRED: Mutex<VecDeque<&'static Shell>> = Mutex::new(VecDeque::new());

/// A new handle around `body`. `tag` is a number that [`tag`] reads without entering the handle, and `said` what [`aside`] finds before any
/// holder leaves something.
pub(super) fn create<H: Handle>(body: H::Body, tag: u64, said: Option<&[u64; WORDS]>) -> *mut H {
    let reused = {
        let mut retired = RETIRED.lock();
        if retired.len() > QUARANTINE { retired.pop_front() } else { None }
    };
    let shell = reused.unwrap_or_else(|| {
        Box::leak(Box::new(Shell {
            kind: AtomicU32::new(DEAD),
            state: AtomicU32::new(FREE),
            tag: AtomicU64::new(0),
            aside: Aside::new(),
            body: std::cell::UnsafeCell::new(std::ptr::null_mut()),
        }))
    });
    // SAFETY: the shell is dead and out of the queue, so nobody else looks at its body.
    unsafe { *shell.body.get() = Box::into_raw(Box::new(body)).cast() };
    shell.tag.store(tag, Ordering::Relaxed);
    shell.aside.clear();
    if let Some(words) = said {
        shell.aside.put(words);
    }
    // Release: the body and tag above must be seen by a thread that finds the kind right.
    shell.kind.store(H::KIND, Ordering::Release);
    std::ptr::from_ref(shell).cast_mut().cast()
}

/// The shell behind a host's pointer, if it is alive and of kind `H`. Takes no lock, allocates nothing.
fn shell_of<H: Handle>(handle: *const H) -> Result<&'static Shell, plp_status> {
    let shell = handle.cast::<Shell>();
    if shell.is_null() {
        return Err(PLP_ERR_NULL);
    }
    if !shell.is_aligned() {
        return Err(PLP_ERR_INVALID_HANDLE);
    }
    // SAFETY: a pointer that a create call returned leads to a shell, which lives for ever. Anything else
    // that a host passes must at least be readable memory of a shell's size; all of a shell's fields are
    // valid for any bytes.
    let shell = unsafe { &*shell };
    // Acquire: pairs with the Release in `create`, so that what the kind promises is there.
    if shell.kind.load(Ordering::Acquire) == H::KIND { Ok(shell) } else { Err(PLP_ERR_INVALID_HANDLE) }
}

/// Exclusive use of a handle's body, until dropped.
pub(super) struct Held<H: Handle> {
    shell: &'static Shell,
    kind: PhantomData<H>,
}

/// Enters a handle alone. Wait-free: at most two reads and one exchange. The error is a status, so that @rt
/// calls can use it.
pub(super) fn hold<H: Handle>(handle: *const H) -> Result<Held<H>, plp_status> {
    let shell = shell_of(handle)?;
    // Acquire: what the previous holder did to the body happens before what this one does.
    if shell.state.compare_exchange(FREE, HELD, Ordering::Acquire, Ordering::Relaxed).is_err() {
        return Err(PLP_ERR_BUSY);
    }
    let held = Held { shell, kind: PhantomData };
    // The handle may have been destroyed, and the shell used again, between the check and the exchange. Acquire:
    // as in `find`, for a new handle's kind.
    if shell.kind.load(Ordering::Acquire) == H::KIND { Ok(held) } else { Err(PLP_ERR_INVALID_HANDLE) }
}

impl<H: Handle> Held<H> {
    /// Where to leave the answer for those who find the handle busy.
    pub fn aside(&self) -> &'static Aside {
        &self.shell.aside
    }
}

impl<H: Handle> Deref for Held<H> {
    type Target = H::Body;
    fn deref(&self) -> &H::Body {
        // SAFETY: `state` is HELD by this guard, and a living shell of kind H has a boxed `H::Body`.
        unsafe { &*(*self.shell.body.get()).cast() }
    }
}

impl<H: Handle> DerefMut for Held<H> {
    fn deref_mut(&mut self) -> &mut H::Body {
        // SAFETY: as above; the guard is borrowed exclusively.
        unsafe { &mut *(*self.shell.body.get()).cast() }
    }
}

impl<H: Handle> Drop for Held<H> {
    fn drop(&mut self) {
        // Release: this holder's changes to the body must not move behind it.
        self.shell.state.store(FREE, Ordering::Release);
    }
}

/// Shared, read-only use of a handle's body, until dropped.
pub(super) struct Shared<H: Handle> {
    shell: &'static Shell,
    kind: PhantomData<H>,
}

/// Enters a handle beside other readers.
pub(super) fn share<H: Handle>(handle: *const H) -> Result<Shared<H>, plp_status>
where
    H::Body: Sync,
{
    let shell = shell_of(handle)?;
    // Acquire: the creator's writes to the body happen before this reader's reads. The count cannot reach
    // HELD: that takes 2³² - 1 threads.
    let counted = shell
        .state
        .fetch_update(Ordering::Acquire, Ordering::Relaxed, |n| if n == HELD { None } else { Some(n + 1) });
    if counted.is_err() {
        return Err(PLP_ERR_BUSY);
    }
    let shared = Shared { shell, kind: PhantomData };
    // As in `hold`.
    if shell.kind.load(Ordering::Acquire) == H::KIND { Ok(shared) } else { Err(PLP_ERR_INVALID_HANDLE) }
}

impl<H: Handle> Deref for Shared<H> {
    type Target = H::Body;
    fn deref(&self) -> &H::Body {
        // SAFETY: `state` counts this reader, so nobody changes or frees the body of this living shell of
        // kind H.
        unsafe { &*(*self.shell.body.get()).cast() }
    }
}

impl<H: Handle> Drop for Shared<H> {
    fn drop(&mut self) {
        // Release: this reader's reads must be finished before a destroyer, who acquires the state, frees the
        // body.
        self.shell.state.fetch_sub(1, Ordering::Release);
    }
}

/// The number given to [`create`], read without entering the handle: other threads may be inside.
pub(super) fn tag<H: Handle>(handle: *const H) -> Result<u64, plp_status> {
    let shell = shell_of(handle)?;
    // Relaxed: the Acquire in `shell_of` already makes the tag of the kind that was seen visible.
    Ok(shell.tag.load(Ordering::Relaxed))
}

/// What a holder left for those who do not enter the handle.
pub(super) fn aside<H: Handle>(handle: *const H) -> Result<&'static Aside, plp_status> {
    shell_of(handle).map(|shell| &shell.aside)
}

/// Ends a handle and returns its body; nothing for NULL.
pub(super) fn destroy<H: Handle>(handle: *mut H) -> Result<Option<Box<H::Body>>, plp_status> {
    if handle.is_null() {
        return Ok(None);
    }
    let held = hold(handle)?;
    let shell = held.shell;
    // SAFETY: `held` is exclusive and the kind is H, so the pointer is the `Box<H::Body>` of `create`; it is
    // replaced, so that it is taken only once.
    let body =
        unsafe { Box::from_raw(std::mem::replace(&mut *shell.body.get(), std::ptr::null_mut()).cast()) };
    // Relaxed: the Release of the state in `held`'s drop orders it for whoever enters next.
    shell.kind.store(DEAD, Ordering::Relaxed);
    drop(held);
    RETIRED.lock().push_back(shell);
    Ok(Some(body))
}

/// A status from this file in words.
pub(super) fn fault<H: Handle>(status: plp_status) -> Fault {
    let name = H::NAME;
    Fault::new(
        status,
        match status {
            PLP_ERR_NULL => format!("the {name} is NULL"),
            PLP_ERR_BUSY => format!("another thread is inside a call on this {name}"),
            _ => format!("this is not a living {name}: destroyed, of another kind, or no handle"),
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug)]
    struct Apple;
    impl Handle for Apple {
        const KIND: u32 = 0x4150_504C;
        const NAME: &'static str = "apple";
        type Body = Vec<u32>;
    }
    struct Pear;
    impl Handle for Pear {
        const KIND: u32 = 0x5045_4152;
        const NAME: &'static str = "pear";
        type Body = Vec<u32>;
    }

    #[test]
    fn null_wrong_kind_and_stale_handles_are_refused() {
        let apple = create::<Apple>(vec![1], 7, None);
        assert_eq!(hold::<Apple>(std::ptr::null()).err(), Some(PLP_ERR_NULL));
        assert_eq!(hold(apple.cast::<Pear>()).err(), Some(PLP_ERR_INVALID_HANDLE));
        assert_eq!(hold(apple.wrapping_byte_add(1)).err(), Some(PLP_ERR_INVALID_HANDLE));
        assert_eq!(tag(apple), Ok(7));
        assert_eq!(*destroy(apple).unwrap().unwrap(), [1]);
        assert_eq!(hold(apple).err(), Some(PLP_ERR_INVALID_HANDLE));
        assert_eq!(tag(apple), Err(PLP_ERR_INVALID_HANDLE));
        assert!(matches!(destroy(apple), Err(PLP_ERR_INVALID_HANDLE)));
        assert!(matches!(destroy::<Apple>(std::ptr::null_mut()), Ok(None)));
    }

    #[test]
    fn a_second_caller_is_told_that_the_handle_is_busy() {
        let apple = create::<Apple>(vec![], 0, None);
        let held = hold(apple).unwrap();
        assert_eq!(hold(apple).err(), Some(PLP_ERR_BUSY));
        assert_eq!(share(apple).err(), Some(PLP_ERR_BUSY));
        assert!(matches!(destroy(apple), Err(PLP_ERR_BUSY)));
        drop(held);
        let (one, two) = (share(apple).unwrap(), share(apple).unwrap());
        assert!(matches!(destroy(apple), Err(PLP_ERR_BUSY)));
        drop((one, two));
        destroy(apple).unwrap();
    }

    #[test]
    fn a_stale_handle_is_recognised_many_handles_later() {
        let stale = create::<Apple>(vec![], 0, None);
        destroy(stale).unwrap();
        for _ in 0..QUARANTINE / 2 {
            let next = create::<Apple>(vec![], 0, None);
            assert_ne!(next, stale);
            destroy(next).unwrap();
        }
        assert_eq!(hold(stale).err(), Some(PLP_ERR_INVALID_HANDLE));
    }
}
