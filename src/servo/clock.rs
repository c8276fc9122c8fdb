//! The servo's time: taken from the stamps that come with the motions, so that no clock is read on the servo thread.

/// Longest time between two ticks that still counts as one loop, in s. Operating systems make a loop miss a few milliseconds; a force that stood
/// still for longer is no longer an answer to the hand.
pub const LONGEST_GAP_S: f64 = 0.05;

/// Longest time that one stamp adds, in s: long after it no force is left, and a stamp that is no time must not stop the clock for ever.
const MOST_ADDED_S: f64 = 1.0;

/// Follows the time stamps of one loop.
#[derive(Clone, Debug)]
pub struct Clock {
    last_s: Option<f64>,
    now_s: f64,
    /// Ticks on end with the same stamp, and how many of them are too many.
    still: u32,
    most_still: u32,
}

/// The time from one tick to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tick {
    /// The loop goes on, after so many seconds: 0 where two ticks have the same stamp.
    Steady(f64),
    /// It starts, or starts again after a pause.
    Fresh,
    /// The stamp is not a time, one before the last, or has stood still for as long as a pause: the clock failed, though the loop may well go on.
    Unknown,
}

impl Clock {
    /// For a loop that ticks every `tick_s` seconds.
    pub fn new(tick_s: f64) -> Self {
        Self { last_s: None, now_s: 0.0, still: 0, most_still: (LONGEST_GAP_S / tick_s).ceil() as u32 }
    }

    /// The time since the last stamp, in seconds.
    pub fn tick(&mut self, stamp_s: f64) -> Tick {
        if !stamp_s.is_finite() {
            return Tick::Unknown;
        }
        let since = self.last_s.replace(stamp_s).map(|last| stamp_s - last);
        self.now_s += since.unwrap_or(0.0).clamp(0.0, MOST_ADDED_S);
        self.still = if since == Some(0.0) { self.still.saturating_add(1) } else { 0 };
        match since {
            Some(since) if since < 0.0 || self.still > self.most_still => Tick::Unknown,
            Some(since) if since <= LONGEST_GAP_S => Tick::Steady(since),
            Some(_) | None => Tick::Fresh,
        }
    }

    /// Time since the first stamp, in seconds, without the steps back: it never runs backwards, whatever the stamps do.
    pub fn now_s(&self) -> f64 {
        self.now_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steady_stamps_give_their_differences() {
        let mut clock = Clock::new(1e-3);
        assert_eq!(clock.tick(7.0), Tick::Fresh);
        assert_eq!(clock.tick(7.0), Tick::Steady(0.0));
        assert_eq!(clock.tick(7.03125), Tick::Steady(0.03125));
    }

    #[test]
    fn a_pause_starts_afresh_and_a_clock_that_fails_does_not() {
        let mut clock = Clock::new(1e-3);
        clock.tick(1.0);
        assert_eq!(clock.tick(1.0625), Tick::Fresh);
        assert_eq!(clock.tick(f64::NAN), Tick::Unknown);
        assert_eq!(clock.tick(1.09375), Tick::Steady(0.03125), "since the last time that was one");
        assert_eq!(clock.tick(0.5), Tick::Unknown, "a step back");
        assert_eq!(clock.tick(0.53125), Tick::Steady(0.03125));
        assert_eq!(clock.now_s(), 0.0625 + 0.03125 + 0.03125, "the pause counts, the step back does not");
    }

    #[test]
    fn stamps_that_stand_still_are_a_clock_that_failed() {
        let mut clock = Clock::new(1e-3);
        clock.tick(1.0);
        // A coarse clock gives the same time more than once.
        for tick in 0..50 {
            assert_eq!(clock.tick(1.0), Tick::Steady(0.0), "tick {tick}");
        }
        assert_eq!(clock.tick(1.0), Tick::Unknown);
        assert_eq!(clock.tick(1.03125), Tick::Steady(0.03125), "and goes on");
    }

    #[test]
    fn a_stamp_that_is_no_time_does_not_stop_the_clock() {
        let mut clock = Clock::new(1e-3);
        clock.tick(1.0);
        assert_eq!(clock.tick(1e18), Tick::Fresh);
        assert_eq!(clock.tick(1.03125), Tick::Unknown);
        let before = clock.now_s();
        clock.tick(1.0625);
        assert_eq!(clock.now_s() - before, 0.03125);
    }
}
