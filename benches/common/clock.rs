//! Waiting, as exactly as a program can.

use std::time::{Duration, Instant};

/// The clock is waited for by sleeping up to so long before a time, and by looking at it from then on.
const AWAKE: Duration = Duration::from_micros(200);

/// Waits for a time on the clock.
fn wait_until(due: Instant) {
    let left = due.saturating_duration_since(Instant::now());
    if left > AWAKE {
        std::thread::sleep(left - AWAKE);
    }
    while Instant::now() < due {
        std::hint::spin_loop();
    }
}

/// The ticks of a loop that keeps to the clock.
#[derive(Debug)]
pub struct Ticks {
    every: Duration,
    start: Instant,
    due: Instant,
    before: Instant,
}

impl Ticks {
    /// From now on, so far apart in s.
    pub fn every(seconds: f64) -> Self {
        let start = Instant::now();
        Self { every: Duration::from_secs_f64(seconds), start, due: start, before: start }
    }

    /// Waits for the next one. Gives when it came, since the start, and since the one before, in s.
    pub fn wait(&mut self) -> [f64; 2] {
        wait_until(self.due);
        let now = Instant::now();
        let period_s = now.duration_since(self.before).as_secs_f64();
        self.before = now;
        // What was missed is missed: a loop that hurried to make up for it would take one step of an encoder for a leap.
        self.due = (self.due + self.every).max(now + self.every / 2);
        [now.duration_since(self.start).as_secs_f64(), period_s]
    }

    /// Since the start, in s.
    pub fn elapsed_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}
