//! Every value from one thread to one other, in order, wait-free on both sides.
//!
//! A bounded ring. The producer alone moves the tail, the consumer alone the head, so that neither ever retries. A full ring gives the
//! value back: what to do then is the caller's to decide, and never to wait.

use super::sync::{Arc, AtomicUsize, Ordering, UnsafeCell};

/// What both ends share. A position counts from 0 up to twice the capacity and starts again, so that a full ring and an empty one differ.
#[derive(Debug)]
struct Shared<T> {
    slots: Box<[UnsafeCell<Option<T>>]>,
    /// Position of the next value to take; the consumer's.
    head: Line,
    /// Position of the next free slot; the producer's.
    tail: Line,
}

/// A position on a cache line of its own, so that the ends do not slow each other.
#[derive(Debug)]
#[repr(align(128))]
struct Line(AtomicUsize);

// SAFETY: the slots from head to tail belong to the consumer, the others to the producer; only its owner touches a slot, and the stores
// of head and tail hand it over.
unsafe impl<T: Send> Sync for Shared<T> {}

/// The end that puts values in.
#[derive(Debug)]
pub struct Producer<T> {
    shared: Arc<Shared<T>>,
    tail: usize,
    /// The head as last seen: a lower bound, which is looked up again only when the ring seems full.
    head: usize,
}

/// The end that takes values out.
#[derive(Debug)]
pub struct Consumer<T> {
    shared: Arc<Shared<T>>,
    head: usize,
    /// The tail as last seen, looked up again only when the ring seems empty.
    tail: usize,
}

/// A ring that holds up to `capacity` values, at least one. All of its memory is allocated here.
pub fn ring<T>(capacity: usize) -> (Producer<T>, Consumer<T>) {
    let slots = (0..capacity.max(1)).map(|_| UnsafeCell::new(None)).collect();
    let start = || Line(AtomicUsize::new(0));
    let shared = Arc::new(Shared { slots, head: start(), tail: start() });
    (Producer { shared: shared.clone(), tail: 0, head: 0 }, Consumer { shared, head: 0, tail: 0 })
}

impl<T> Shared<T> {
    fn slot(&self, position: usize) -> &UnsafeCell<Option<T>> {
        let count = self.slots.len();
        &self.slots[if position < count { position } else { position - count }]
    }

    fn after(&self, position: usize) -> usize {
        if position + 1 == 2 * self.slots.len() { 0 } else { position + 1 }
    }

    fn is_full(&self, head: usize, tail: usize) -> bool {
        head.abs_diff(tail) == self.slots.len()
    }
}

impl<T> Producer<T> {
    /// Puts `value` behind the others, or gives it back where the ring is full.
    pub fn push(&mut self, value: T) -> Result<(), T> {
        if self.shared.is_full(self.head, self.tail) {
            // Acquire: the consumer took its value out of the slot before we write to it again.
            self.head = self.shared.head.0.load(Ordering::Acquire);
            if self.shared.is_full(self.head, self.tail) {
                return Err(value);
            }
        }
        // SAFETY: the slot at the tail of a ring that is not full belongs to the one producer, borrowed mutably.
        self.shared.slot(self.tail).with_mut(|slot| unsafe { *slot = Some(value) });
        self.tail = self.shared.after(self.tail);
        // Release: a consumer that sees the new tail sees the value as well.
        self.shared.tail.0.store(self.tail, Ordering::Release);
        Ok(())
    }
}

impl<T> Consumer<T> {
    /// Takes the oldest value out.
    pub fn pop(&mut self) -> Option<T> {
        if self.head == self.tail {
            // Acquire: see the values that the producer released.
            self.tail = self.shared.tail.0.load(Ordering::Acquire);
            if self.head == self.tail {
                return None;
            }
        }
        // SAFETY: the slot at the head of a ring that is not empty belongs to the one consumer, borrowed mutably.
        let value = self.shared.slot(self.head).with_mut(|slot| unsafe { (*slot).take() });
        self.head = self.shared.after(self.head);
        // Release: the value is out of the slot before the producer may use it again.
        self.shared.head.0.store(self.head, Ordering::Release);
        value
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn values_come_out_in_order_and_a_full_ring_gives_back() {
        for capacity in 1..5 {
            let (mut producer, mut consumer) = ring(capacity);
            // Several times around, so that every position is full and empty once.
            for round in 0..10 {
                assert_eq!(consumer.pop(), None);
                let at = |i: usize| 100 * round + i;
                (0..capacity).for_each(|i| assert_eq!(producer.push(at(i)), Ok(())));
                assert_eq!(producer.push(at(99)), Err(at(99)));
                (0..capacity).for_each(|i| assert_eq!(consumer.pop(), Some(at(i))));
            }
        }
    }

    #[test]
    fn a_ring_of_none_holds_one() {
        let (mut producer, mut consumer) = ring(0);
        assert_eq!((producer.push(1), producer.push(2)), (Ok(()), Err(2)));
        assert_eq!((consumer.pop(), consumer.pop()), (Some(1), None));
    }

    #[test]
    fn what_was_never_taken_is_dropped_with_the_ring() {
        let value = std::sync::Arc::new(());
        let (mut producer, consumer) = ring(3);
        (0..3).for_each(|_| producer.push(value.clone()).unwrap());
        drop((producer, consumer));
        assert_eq!(std::sync::Arc::strong_count(&value), 1);
    }

    #[test]
    fn nothing_is_lost_torn_or_reordered_between_threads() {
        let (mut producer, mut consumer) = ring(8);
        let count = 200_000;
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for n in 0..count {
                    let mut value = [n; 8];
                    while let Err(back) = producer.push(value) {
                        value = back;
                        std::thread::yield_now();
                    }
                }
            });
            let mut next = 0;
            while next < count {
                match consumer.pop() {
                    Some(value) => {
                        assert_eq!(value, [next; 8]);
                        next += 1;
                    }
                    None => std::thread::yield_now(),
                }
            }
        });
    }
}
