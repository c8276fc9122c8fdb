//! The last answer of a handle, for a caller that finds it busy.
//!
//! A servo must not lose its force for a tick because another thread happens to be inside its tool. What the tool answered last stands here,
//! outside the body that the other thread holds. One writer at a time, the holder of the handle; any number of readers; nobody waits.

use std::sync::atomic::{AtomicU64, Ordering};

/// Words of an answer: those of a `plp_servo`, its time stamp, and those of a `plp_servo_statistics`.
pub(super) const WORDS: usize = 33;
/// Looks of a reader. Each but the last fails only if two answers were given during it.
const LOOKS: usize = 4;

/// Two places, written in turns, so that a reader of one is not disturbed by the next answer but by the one after that.
#[derive(Debug)]
pub(super) struct Aside {
    places: [[AtomicU64; WORDS]; 2],
    /// Counts answers; the newest is in the place of its parity. 0 where there is none.
    number: AtomicU64,
}

impl Aside {
    pub const fn new() -> Self {
        Self { places: [const { [const { AtomicU64::new(0) }; WORDS] }; 2], number: AtomicU64::new(0) }
    }

    /// Puts an answer there. The caller holds the handle, so that there is no other writer.
    pub fn put(&self, words: &[u64; WORDS]) {
        // Relaxed: writers follow each other by the handle's state.
        let next = self.number.load(Ordering::Relaxed).wrapping_add(1);
        for (place, word) in self.places[next as usize % 2].iter().zip(words) {
            // Release: a reader that meets a word of this answer in the place of an old one finds the number changed as well.
            place.store(*word, Ordering::Release);
        }
        // Release: who sees the number sees all words.
        self.number.store(next, Ordering::Release);
    }

    /// The newest answer, if there is one, and it could be read whole.
    pub fn get(&self) -> Option<[u64; WORDS]> {
        for _ in 0..LOOKS {
            // Acquire: the words are at least as new as the number.
            let number = self.number.load(Ordering::Acquire);
            if number == 0 {
                return None;
            }
            // Acquire: see `put`; the number is looked at again after all words.
            let words = std::array::from_fn(|i| self.places[number as usize % 2][i].load(Ordering::Acquire));
            if self.number.load(Ordering::Relaxed) == number {
                return Some(words);
            }
        }
        None
    }

    /// Whether no answer was ever put there.
    pub fn is_empty(&self) -> bool {
        // Relaxed: no word is read.
        self.number.load(Ordering::Relaxed) == 0
    }

    /// Forgets what is there. The caller is alone with the handle.
    pub fn clear(&self) {
        // Relaxed: the handle that begins a new life is published after this.
        self.number.store(0, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicBool;

    #[test]
    fn the_newest_answer_is_there_until_it_is_cleared() {
        let aside = Aside::new();
        assert_eq!(aside.get(), None);
        (1..=3).for_each(|n| aside.put(&[n; WORDS]));
        assert_eq!((aside.get(), aside.get()), (Some([3; WORDS]), Some([3; WORDS])));
        aside.clear();
        assert_eq!(aside.get(), None);
    }

    #[test]
    fn answers_are_never_torn_and_never_go_back() {
        let (aside, is_done) = (Aside::new(), AtomicBool::new(false));
        std::thread::scope(|scope| {
            scope.spawn(|| {
                (1..=200_000).for_each(|n| aside.put(&[n; WORDS]));
                is_done.store(true, Ordering::Relaxed);
            });
            let mut last = 0;
            while !is_done.load(Ordering::Relaxed) {
                let Some(words) = aside.get() else { continue };
                assert!(words.iter().all(|word| *word == words[0]), "torn: {words:?}");
                assert!(words[0] >= last, "{} after {last}", words[0]);
                last = words[0];
            }
        });
        assert_eq!(aside.get(), Some([200_000; WORDS]));
    }
}
