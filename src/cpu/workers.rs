//! A few persistent threads that take a step together.
//!
//! A general thread pool wakes its sleepers in 0.1 to 3 ms, which is a whole step. These workers spin for a while after a job and only
//! then park, and a job is a whole step: inside it, threads meet at a spinning barrier.

use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicUsize, Ordering};
use std::thread::{JoinHandle, Thread};
use std::time::{Duration, Instant};

use super::denormal::FlushToZero;
use crate::error::{Error, Result};

/// How long a worker spins for its next job before it parks.
const SPIN: Duration = Duration::from_micros(200);
/// Rounds of a barrier before a thread gives its processor away: there may be fewer processors than threads, or another program may
/// hold up the thread that is waited for. Some ten microseconds; giving way to nobody costs less than one.
const PATIENCE: u32 = 2_000;

/// The threads of one simulation. The thread that calls [`Workers::run`] is one of them.
#[derive(Debug)]
pub struct Workers {
    shared: Arc<Shared>,
    threads: Vec<(JoinHandle<()>, Thread)>,
}

#[derive(Debug)]
struct Shared {
    barrier: Barrier,
    /// Counts jobs; a worker that sees it change has work.
    job_number: AtomicUsize,
    /// The current job: a pointer to a reference on the stack of [`Workers::run`], written before `job_number`.
    job: AtomicPtr<()>,
    finished: AtomicUsize,
    stop: AtomicBool,
    parked: Vec<AtomicBool>,
}

/// One thread's view of a job.
#[derive(Debug)]
pub struct Member<'a> {
    /// 0 is the thread that called [`Workers::run`].
    pub index: usize,
    /// How many threads take part.
    pub count: usize,
    barrier: &'a Barrier,
}

impl Member<'_> {
    /// Waits until all members have come here. What any of them wrote before is then visible to all.
    pub fn meet(&self) {
        self.barrier.wait();
    }

    /// Its part of `count` things in a row, as large as everybody's.
    pub fn share(&self, count: usize) -> Range<usize> {
        count * self.index / self.count..count * (self.index + 1) / self.count
    }
}

impl Workers {
    /// Starts `count - 1` threads; fails, and stops those already started, when the operating system gives no more.
    pub fn new(count: usize) -> Result<Self> {
        let count = count.max(1);
        let barrier = Barrier {
            count,
            arrived: AtomicUsize::new(0),
            round: AtomicUsize::new(0),
            broken: AtomicBool::new(false),
        };
        let shared = Arc::new(Shared {
            barrier,
            job_number: AtomicUsize::new(0),
            job: AtomicPtr::new(std::ptr::null_mut()),
            finished: AtomicUsize::new(0),
            stop: AtomicBool::new(false),
            parked: (0..count).map(|_| AtomicBool::new(false)).collect(),
        });
        let mut workers = Self { shared, threads: Vec::with_capacity(count - 1) };
        for index in 1..count {
            let shared = workers.shared.clone();
            let handle = std::thread::Builder::new()
                .name(format!("palpate-{index}"))
                .spawn(move || serve(&shared, index))
                .map_err(|e| Error::Limit(format!("thread {index} of {count} could not be started: {e}")))?;
            let thread = handle.thread().clone();
            workers.threads.push((handle, thread));
        }
        Ok(workers)
    }

    /// How many threads take part in a job.
    pub fn count(&self) -> usize {
        self.threads.len() + 1
    }

    /// Runs `job` on every thread at once and returns when all have finished. A panic in any of them comes out here.
    pub fn run(&mut self, job: &(dyn Fn(&Member) + Sync)) {
        let shared = &*self.shared;
        // The reference lies on this stack, and this call returns only when no worker looks at it any more.
        shared.job.store((&raw const job).cast_mut().cast(), Ordering::Relaxed);
        shared.finished.store(0, Ordering::Relaxed);
        // Release: a worker that sees the new number sees the job and whatever the caller wrote for it. SeqCst, because this store
        // must not pass the loads of `parked` below: otherwise a worker could park unseen just after we looked.
        shared.job_number.fetch_add(1, Ordering::SeqCst);
        for (index, (_, thread)) in (1..).zip(&self.threads) {
            if shared.parked[index].load(Ordering::SeqCst) {
                thread.unpark();
            }
        }

        let mine = catch_unwind(AssertUnwindSafe(|| call(shared, 0)));
        if mine.is_err() {
            shared.barrier.breach();
        }
        // Acquire: what the workers wrote is visible to the caller.
        let mut rounds = 0;
        while shared.finished.load(Ordering::Acquire) < self.threads.len() {
            pause(&mut rounds);
        }
        let broken = shared.barrier.mend();
        if let Err(panic) = mine {
            resume_unwind(panic);
        }
        assert!(!broken, "a worker thread panicked during a step");
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::SeqCst);
        self.shared.job_number.fetch_add(1, Ordering::SeqCst);
        for (handle, thread) in self.threads.drain(..) {
            thread.unpark();
            // A worker contains its panics, so this cannot fail with one.
            let _ = handle.join();
        }
    }
}

/// The life of a worker.
fn serve(shared: &Shared, index: usize) {
    let mut seen = 0;
    loop {
        seen = next_job(shared, index, seen);
        if shared.stop.load(Ordering::SeqCst) {
            return;
        }
        if catch_unwind(AssertUnwindSafe(|| call(shared, index))).is_err() {
            shared.barrier.breach();
        }
        // Release: see `run`.
        shared.finished.fetch_add(1, Ordering::Release);
    }
}

fn call(shared: &Shared, index: usize) {
    // Relaxed: who sees the job's number sees the job.
    let job = shared.job.load(Ordering::Relaxed).cast_const().cast::<&(dyn Fn(&Member) + Sync)>();
    // SAFETY: `run` stored a pointer to such a reference, has not returned yet, and nothing else writes `job` meanwhile.
    let job = unsafe { *job };
    let _mode = FlushToZero::new();
    job(&Member { index, count: shared.barrier.count, barrier: &shared.barrier });
}

/// Spins, then parks, until the job number differs from `seen`; gives the new number.
fn next_job(shared: &Shared, index: usize, seen: usize) -> usize {
    let start = Instant::now();
    loop {
        for _ in 0..64 {
            // Acquire: the job and its data are visible once the number is.
            let number = shared.job_number.load(Ordering::Acquire);
            if number != seen {
                return number;
            }
            std::hint::spin_loop();
        }
        if start.elapsed() > SPIN {
            // SeqCst on both sides: either `run` sees the flag and unparks, or this load sees the new number.
            shared.parked[index].store(true, Ordering::SeqCst);
            while shared.job_number.load(Ordering::SeqCst) == seen {
                std::thread::park();
            }
            shared.parked[index].store(false, Ordering::Relaxed);
        }
    }
}

/// All threads of a job wait for each other, spinning.
#[derive(Debug)]
struct Barrier {
    count: usize,
    arrived: AtomicUsize,
    round: AtomicUsize,
    /// A member panicked and will not come.
    broken: AtomicBool,
}

impl Barrier {
    fn wait(&self) {
        if self.count == 1 {
            return;
        }
        let round = self.round.load(Ordering::Relaxed);
        // AcqRel: the last to arrive has seen what all others wrote, and passes it on with `round`.
        if self.arrived.fetch_add(1, Ordering::AcqRel) + 1 == self.count {
            self.arrived.store(0, Ordering::Relaxed);
            self.round.store(round.wrapping_add(1), Ordering::Release);
            return;
        }
        let mut rounds = 0;
        // Acquire: pairs with the store above.
        while self.round.load(Ordering::Acquire) == round {
            assert!(!self.broken.load(Ordering::Relaxed), "another thread of this step panicked");
            pause(&mut rounds);
        }
    }

    fn breach(&self) {
        self.broken.store(true, Ordering::Relaxed);
    }

    /// After a job: whether it was breached; ready for the next one either way.
    fn mend(&self) -> bool {
        self.arrived.store(0, Ordering::Relaxed);
        self.broken.swap(false, Ordering::Relaxed)
    }
}

fn pause(rounds: &mut u32) {
    *rounds += 1;
    if *rounds > PATIENCE { std::thread::yield_now() } else { std::hint::spin_loop() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_see_each_others_writes_after_they_meet() {
        for count in 1..=3 {
            let mut workers = Workers::new(count).unwrap();
            let cells: Vec<AtomicUsize> = (0..count).map(|_| AtomicUsize::new(0)).collect();
            for _ in 0..50 {
                let start = cells[0].load(Ordering::Relaxed);
                workers.run(&|member| {
                    for phase in 1..=20 {
                        cells[member.index].store(start + phase, Ordering::Relaxed);
                        member.meet();
                        assert!(cells.iter().all(|c| c.load(Ordering::Relaxed) == start + phase));
                        member.meet();
                    }
                });
            }
            assert_eq!(cells[count - 1].load(Ordering::Relaxed), 1000);
        }
    }

    #[test]
    fn parked_workers_wake_for_the_next_job() {
        let mut workers = Workers::new(2).unwrap();
        let total = AtomicUsize::new(0);
        for _ in 0..5 {
            std::thread::sleep(SPIN * 5);
            workers.run(&|_| {
                total.fetch_add(1, Ordering::Relaxed);
            });
        }
        assert_eq!(total.load(Ordering::Relaxed), 10);
    }

    #[test]
    fn a_panic_in_one_member_reaches_the_caller_and_spares_the_threads() {
        let mut workers = Workers::new(2).unwrap();
        for guilty in 0..2 {
            let outcome = catch_unwind(AssertUnwindSafe(|| {
                workers.run(&|member| {
                    assert!(member.index != guilty, "on purpose");
                    member.meet();
                });
            }));
            assert!(outcome.is_err());
            let total = AtomicUsize::new(0);
            workers.run(&|member| {
                member.meet();
                total.fetch_add(1, Ordering::Relaxed);
            });
            assert_eq!(total.load(Ordering::Relaxed), 2);
        }
    }
}
