//! The newest value from one thread to one other, wait-free on both sides.
//!
//! Three slots: the writer owns one, the reader owns one, and the third floats between them. Publishing swaps the writer's slot with the
//! floating one; reading swaps the reader's with it if it is fresh. Two slots would not do: the writer would have to wait for
//! a reader that is still looking. Neither side loops, waits or allocates, and a value that the reader holds stays whole until its
//! next read.

use super::sync::{Arc, AtomicU8, Ordering, UnsafeCell};

/// Set in `floating` where the floating slot holds a value that the reader has not taken.
const FRESH: u8 = 4;

#[derive(Debug)]
struct Slots<T> {
    slots: [Slot<T>; 3],
    /// The index of the floating slot and [`FRESH`].
    floating: AtomicU8,
}

/// A slot on cache lines of its own, so that writer and reader do not slow each other.
#[derive(Debug)]
#[repr(align(128))]
struct Slot<T>(UnsafeCell<T>);

// SAFETY: at any time a slot belongs to the writer, to the reader, or floats; only its owner touches it, and the swaps of `floating`
// hand it over.
unsafe impl<T: Send> Sync for Slots<T> {}

/// The end that publishes.
#[derive(Debug)]
pub struct Writer<T> {
    shared: Arc<Slots<T>>,
    own: u8,
}

/// The end that reads.
#[derive(Debug)]
pub struct Reader<T> {
    shared: Arc<Slots<T>>,
    own: u8,
}

/// A channel whose reader sees `initial` until something is published.
pub fn latest<T: Clone>(initial: T) -> (Writer<T>, Reader<T>) {
    let slot = || Slot(UnsafeCell::new(initial.clone()));
    let shared = Arc::new(Slots { slots: [slot(), slot(), slot()], floating: AtomicU8::new(1) });
    (Writer { shared: shared.clone(), own: 0 }, Reader { shared, own: 2 })
}

impl<T> Writer<T> {
    /// Makes `value` the newest.
    pub fn publish(&mut self, value: T) {
        // SAFETY: the writer owns this slot, and there is one writer, borrowed mutably.
        self.shared.slots[usize::from(self.own)].0.with_mut(|slot| unsafe { *slot = value });
        // Release: the reader that takes the slot sees the value just written. Acquire: whatever the reader did with the slot that
        // comes back happened before we write to it again.
        let back = self.shared.floating.swap(self.own | FRESH, Ordering::AcqRel);
        self.own = back & !FRESH;
    }
}

impl<T> Reader<T> {
    /// The newest value, and whether it was published since the last call. Stays as it is until the next call.
    pub fn read(&mut self) -> (&T, bool) {
        // Relaxed: only a hint; the swap below orders what is read.
        let is_fresh = self.shared.floating.load(Ordering::Relaxed) & FRESH != 0;
        if is_fresh {
            // Acquire: see the value that the writer released. Release: our reads of the slot that we give away are over before the
            // writer writes to it.
            let taken = self.shared.floating.swap(self.own, Ordering::AcqRel);
            self.own = taken & !FRESH;
        }
        // SAFETY: the reader owns this slot, and there is one reader, borrowed mutably for as long as the value is looked at.
        (self.shared.slots[usize::from(self.own)].0.with(|slot| unsafe { &*slot }), is_fresh)
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn reader_sees_the_initial_value_then_the_newest() {
        let (mut writer, mut reader) = latest(1);
        assert_eq!(reader.read(), (&1, false));
        writer.publish(2);
        writer.publish(3);
        assert_eq!(reader.read(), (&3, true));
        assert_eq!(reader.read(), (&3, false));
        writer.publish(4);
        assert_eq!(reader.read(), (&4, true));
    }

    #[test]
    fn values_are_never_torn_and_never_go_back() {
        let (mut writer, mut reader) = latest([0_u64; 32]);
        let count = 200_000;
        std::thread::scope(|scope| {
            scope.spawn(move || (1..=count).for_each(|n| writer.publish([n; 32])));
            let mut last = 0;
            while last < count {
                let (value, _) = reader.read();
                assert!(value.iter().all(|x| *x == value[0]), "torn: {value:?}");
                assert!(value[0] >= last, "{} after {last}", value[0]);
                last = value[0];
            }
        });
    }
}
