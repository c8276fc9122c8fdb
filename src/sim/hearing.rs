//! What the simulation hears of a device's servo besides where its tool is: whether it is still there, and its buttons.

use std::time::Instant;

use crate::channel::ring::{Consumer, Producer, ring};

/// A servo that has said nothing for so long is taken for gone, in s: a hundred ticks of a slow one.
const SILENCE_S: f64 = 0.2;
/// Changes of buttons that wait for a step. A finger clicks ten times in a second.
const CHANGES: usize = 64;

/// The servo's end: tells how the buttons change.
#[derive(Debug)]
pub(super) struct Buttons {
    changes: Producer<u32>,
    told: u32,
}

/// The simulation's end.
#[derive(Debug)]
pub(super) struct Hearing {
    changes: Consumer<u32>,
    heard_at: Option<Instant>,
    is_silent: bool,
}

/// Both ends, with no button pressed.
pub(super) fn open() -> (Buttons, Hearing) {
    let (producer, consumer) = ring(CHANGES);
    (Buttons { changes: producer, told: 0 }, Hearing { changes: consumer, heard_at: None, is_silent: false })
}

impl Buttons {
    /// Tells how the buttons are, where they have changed: every change comes out, also those that are over before the next step. While too many wait,
    /// later changes are told as one. Wait-free.
    #[inline]
    pub fn tell(&mut self, buttons: u32) {
        if buttons != self.told && self.changes.push(buttons).is_ok() {
            self.told = buttons;
        }
    }
}

impl Hearing {
    /// The next change of the buttons: all of them, a bit each.
    pub fn next_change(&mut self) -> Option<u32> {
        self.changes.pop()
    }

    /// Whether the servo has just fallen silent. `is_news` is whether it has said anything since it was last asked for.
    pub fn falls_silent(&mut self, is_news: bool, now: Instant) -> bool {
        if is_news || self.heard_at.is_none() {
            self.heard_at = Some(now);
        }
        let silence = self.heard_at.map_or(0.0, |heard| now.duration_since(heard).as_secs_f64());
        let was_silent = std::mem::replace(&mut self.is_silent, silence > SILENCE_S);
        self.is_silent && !was_silent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn every_click_comes_out_in_order_and_the_last_state_even_after_too_many() {
        let (mut buttons, mut hearing) = open();
        for state in [0, 1, 1, 0, 2, 0] {
            buttons.tell(state);
        }
        assert_eq!(std::iter::from_fn(|| hearing.next_change()).collect::<Vec<_>>(), [1, 0, 2, 0]);
        // Twice as many as there is room for, and the button stays pressed.
        for state in (0..2 * CHANGES as u32).map(|i| 1 - i % 2) {
            buttons.tell(state);
        }
        buttons.tell(1);
        let told: Vec<_> = std::iter::from_fn(|| hearing.next_change()).collect();
        assert_eq!((told.len(), told[0]), (CHANGES, 1));
        buttons.tell(1);
        let left: Vec<_> = std::iter::from_fn(|| hearing.next_change()).collect();
        assert_eq!(left, [1]);
    }

    #[test]
    fn a_servo_that_says_nothing_for_a_while_is_told_of_once() {
        let (_, mut hearing) = open();
        let start = Instant::now();
        let mut at =
            |ms: u64, is_news: bool| hearing.falls_silent(is_news, start + Duration::from_millis(ms));
        assert!(!at(0, true) && !at(199, false));
        assert!(at(201, false) && !at(300, false));
        assert!(!at(301, true) && !at(400, false) && at(502, false), "and again after it was back");
    }
}
