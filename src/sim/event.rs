//! What a simulation tells its owner unasked.

use std::time::{Duration, Instant};

use super::ToolId;
use crate::channel::ring::Producer;

/// Events that wait to be read.
pub(super) const EVENTS: usize = 256;

/// Something that happened while the simulation ran.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The state stopped being finite; see [`Error::Diverged`](crate::error::Error::Diverged).
    Diverged {
        /// Simulated time, in seconds.
        time_s: f64,
    },
    /// The GPU was lost.
    DeviceLost {
        /// Simulated time, in seconds.
        time_s: f64,
    },
    /// The simulation's own thread fell so far behind the clock that it let time go.
    FellBehind {
        /// Simulated time, in seconds.
        time_s: f64,
        /// How much time was let go since that was last told, in seconds.
        dropped_s: f64,
    },
    /// The servo of a device has not been heard of for a while: the tool stands where it was.
    ServoSilent {
        /// Simulated time, in seconds.
        time_s: f64,
        /// Its tool.
        tool: ToolId,
    },
    /// A surface does not show the last cuts: it is not closed where they meet it, or there is no room for it. Told once, until it follows.
    SurfaceBehind {
        /// Simulated time, in seconds.
        time_s: f64,
        /// Which surface of the model.
        surface: usize,
    },
    /// A cut was refused: there is no room for the copies of nodes that it takes. Told once for each tool, until a reset.
    CutRefused {
        /// Simulated time, in seconds.
        time_s: f64,
        /// The blade.
        tool: ToolId,
    },
    /// The buttons of a device have changed: one event for each change, also of clicks that are over before the step that tells them.
    Buttons {
        /// Simulated time, in seconds.
        time_s: f64,
        /// Its tool.
        tool: ToolId,
        /// All buttons now, a bit each.
        buttons: u32,
    },
}

/// Where a simulation puts its events.
#[derive(Debug)]
pub(super) struct Events {
    ring: Producer<Event>,
    /// Those that found no room.
    pub dropped: u64,
    /// When falling behind was told last, and time that was let go since.
    told_at: Option<Instant>,
    let_go_s: f64,
}

/// Falling behind is told no more often than this.
const BETWEEN: Duration = Duration::from_millis(500);

impl Events {
    pub fn new(ring: Producer<Event>) -> Self {
        Self { ring, dropped: 0, told_at: None, let_go_s: 0.0 }
    }

    /// Tells an event, or counts it where nobody has read the others.
    pub fn tell(&mut self, event: Event) {
        self.dropped += u64::from(self.ring.push(event).is_err());
    }

    /// Tells that time was let go, with what was let go since that was told last.
    pub fn fell_behind(&mut self, time_s: f64, dropped_s: f64) {
        self.let_go_s += dropped_s;
        let now = Instant::now();
        if self.told_at.is_none_or(|told| now.duration_since(told) >= BETWEEN) {
            self.told_at = Some(now);
            let dropped_s = std::mem::take(&mut self.let_go_s);
            self.tell(Event::FellBehind { time_s, dropped_s });
        }
    }
}
