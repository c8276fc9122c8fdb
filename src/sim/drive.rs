//! The simulation's own thread: steps at the wall clock's pace.
//!
//! Deadlines are absolute, so that no lateness adds up. A step that ends late is made up for by the next ones, which follow without a pause, but never more than
//! [`ThreadDesc::longest_lag_s`] of them: what is beyond is let go, and told. So a model that is too large for its machine runs slower than life, and does not
//! lock the machine up.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::state::State;
use crate::error::{Error, Result};

/// Something that the host does on the simulation's thread.
pub type Hook = Box<dyn FnOnce() + Send>;

/// How the simulation's own thread runs.
pub struct ThreadDesc {
    /// Called first on the thread: the place to set its priority and affinity.
    pub on_start: Option<Hook>,
    /// Called last on it.
    pub on_stop: Option<Hook>,
    /// How much time it makes up for at most, in seconds.
    pub longest_lag_s: f64,
}

impl Default for ThreadDesc {
    fn default() -> Self {
        Self { on_start: None, on_stop: None, longest_lag_s: 0.02 }
    }
}

impl std::fmt::Debug for ThreadDesc {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ThreadDesc").field("longest_lag_s", &self.longest_lag_s).finish_non_exhaustive()
    }
}

/// What the owner wants of the thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    Run,
    Pause,
    Stop,
}

#[derive(Debug)]
struct Control {
    order: Mutex<Order>,
    changed: Condvar,
}

/// A thread that steps a simulation. It ends with this.
#[derive(Debug)]
pub(super) struct Driver {
    control: Arc<Control>,
    thread: Option<JoinHandle<()>>,
}

/// What the thread does next.
enum Turn {
    Step,
    StepAfterPause,
    Stop,
}

impl Control {
    /// Waits until a step is due, and while it is paused.
    fn wait(&self, due: Option<Instant>) -> Turn {
        let mut order = self.order.lock();
        let mut was_paused = false;
        loop {
            match *order {
                Order::Stop => return Turn::Stop,
                Order::Pause => {
                    was_paused = true;
                    self.changed.wait(&mut order);
                }
                Order::Run if was_paused => return Turn::StepAfterPause,
                Order::Run => match due {
                    Some(due) if Instant::now() < due => {
                        self.changed.wait_until(&mut order, due);
                    }
                    _ => return Turn::Step,
                },
            }
        }
    }
}

impl Driver {
    /// Starts stepping.
    pub fn start(state: Arc<Mutex<Option<State>>>, step_s: f64, desc: ThreadDesc) -> Result<Self> {
        if !(0.0..=1e3).contains(&desc.longest_lag_s) {
            return Err(Error::argument(format!(
                "a lag of {} s is not between 0 and 1000",
                desc.longest_lag_s
            )));
        }
        let control = Arc::new(Control { order: Mutex::new(Order::Run), changed: Condvar::new() });
        let (pace, own) = (Pace::new(step_s, desc.longest_lag_s), control.clone());
        let thread = std::thread::Builder::new().name("palpate".into()).spawn(move || {
            let on_start = desc.on_start;
            let work = AssertUnwindSafe(|| {
                if let Some(hook) = on_start {
                    hook();
                }
                run(&own, &state, pace);
            });
            if catch_unwind(work).is_err() {
                let told = catch_unwind(AssertUnwindSafe(|| {
                    if let Some(state) = state.lock().as_mut() {
                        state.give_up();
                    }
                }));
                drop(told);
            }
            if let Some(hook) = desc.on_stop {
                hook();
            }
        });
        let thread = thread.map_err(|why| Error::Limit(format!("no thread for the simulation: {why}")))?;
        Ok(Self { control, thread: Some(thread) })
    }

    /// Stops stepping, or goes on with it. A step in progress ends by itself.
    pub fn set_paused(&self, paused: bool) {
        *self.control.order.lock() = if paused { Order::Pause } else { Order::Run };
        self.control.changed.notify_all();
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        *self.control.order.lock() = Order::Stop;
        self.control.changed.notify_all();
        // A host may end the simulation in a hook, on the thread itself, which ends after that.
        let is_own = |thread: &JoinHandle<()>| thread.thread().id() == std::thread::current().id();
        if let Some(thread) = self.thread.take().filter(|thread| !is_own(thread)) {
            // One that panicked has said so.
            let _ = thread.join();
        }
    }
}

/// Steps until it is told to stop.
fn run(control: &Control, state: &Mutex<Option<State>>, mut pace: Pace) {
    pace.begin(Instant::now());
    let mut was_held = false;
    loop {
        was_held |= match control.wait(pace.due()) {
            Turn::Step => false,
            Turn::StepAfterPause => true,
            Turn::Stop => return,
        };
        let mut guard = state.lock();
        // Who has paused it, and then asked it something, knows that no step follows.
        if *control.order.lock() != Order::Run {
            continue;
        }
        let Some(sim) = guard.as_mut() else { return };
        if std::mem::take(&mut was_held) {
            pace.begin(Instant::now());
            sim.forget_ways();
        }
        if sim.step(Instant::now()).is_err() {
            // What went wrong was told; the owner resets it and goes on, or gives it up.
            let mut order = control.order.lock();
            if *order == Order::Run {
                *order = Order::Pause;
            }
        }
        match pace.after_step(Instant::now()) {
            Lag::Early => {}
            Lag::Late => sim.note_late(None),
            Lag::Lost(dropped) => sim.note_late(Some(dropped.as_secs_f64())),
        }
        // The owner and renderers get their turn between two steps even where there is no pause.
        MutexGuard::unlock_fair(guard);
    }
}

/// When steps are due.
#[derive(Debug)]
struct Pace {
    step: Duration,
    longest_lag: Duration,
    due: Option<Instant>,
}

/// How a step ended.
#[derive(Debug, PartialEq, Eq)]
enum Lag {
    /// Before the next one is due.
    Early,
    /// After that: the next follows at once.
    Late,
    /// So late that this much time was let go.
    Lost(Duration),
}

impl Pace {
    fn new(step_s: f64, longest_lag_s: f64) -> Self {
        Self {
            step: Duration::from_secs_f64(step_s),
            longest_lag: Duration::from_secs_f64(longest_lag_s),
            due: None,
        }
    }

    /// The first step is due now.
    fn begin(&mut self, now: Instant) {
        self.due = Some(now);
    }

    fn after_step(&mut self, now: Instant) -> Lag {
        let due = self.due.unwrap_or(now) + self.step;
        let late = now.saturating_duration_since(due);
        if late > self.longest_lag {
            self.due = Some(now);
            return Lag::Lost(late);
        }
        self.due = Some(due);
        if now < due { Lag::Early } else { Lag::Late }
    }

    /// When the next step begins.
    fn due(&self) -> Option<Instant> {
        self.due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lateness_is_made_up_for_and_never_adds_up() {
        let ms = Duration::from_millis;
        let start = Instant::now();
        let mut pace = Pace::new(1e-3, 20e-3);
        pace.begin(start);
        assert_eq!(pace.after_step(start + ms(1) / 4), Lag::Early);
        assert_eq!(pace.due(), Some(start + ms(1)));
        // Ten milliseconds go by: the next steps follow without a pause until the clock is caught up with.
        assert_eq!(pace.after_step(start + ms(12)), Lag::Late);
        for step in 3..12 {
            assert_eq!(pace.after_step(start + ms(12)), Lag::Late, "step {step}");
        }
        assert_eq!(pace.after_step(start + ms(12)), Lag::Late, "on the very deadline");
        assert_eq!((pace.after_step(start + ms(12)), pace.due()), (Lag::Early, Some(start + ms(13))));
    }

    #[test]
    fn what_cannot_be_made_up_for_is_let_go() {
        let ms = Duration::from_millis;
        let start = Instant::now();
        let mut pace = Pace::new(1e-3, 20e-3);
        pace.begin(start);
        assert_eq!(pace.after_step(start + ms(50)), Lag::Lost(ms(49)));
        assert_eq!(pace.after_step(start + ms(50)), Lag::Early, "from here on as if nothing had been");
    }
}
