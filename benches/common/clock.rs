//! Waiting, as exactly as a program can.

use std::time::{Duration, Instant};

/// The clock is waited for by sleeping up to so long before a time, and by looking at it from then on.
const AWAKE: Duration = Duration::from_micros(200);

/// Waits for a time on the clock.
pub fn wait_until(due: Instant) {
    let left = due.saturating_duration_since(Instant::now());
    if left > AWAKE {
        std::thread::sleep(left - AWAKE);
    }
    while Instant::now() < due {
        std::hint::spin_loop();
    }
}
