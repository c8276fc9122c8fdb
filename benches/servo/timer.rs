//! Times of tens of nanoseconds.

use std::time::Instant;

use super::common::table::rank;

/// The processor's counter, as nothing before it is still under way and nothing after it has begun.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn count() -> u64 {
    use std::arch::x86_64::{_mm_lfence, _rdtsc};
    // SAFETY: every x86-64 has both.
    unsafe {
        _mm_lfence();
        let now = _rdtsc();
        _mm_lfence();
        now
    }
}

/// The system's clock in ns, where the processor has no counter that programs may read.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
fn count() -> u64 {
    use std::sync::OnceLock;
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_nanos() as u64
}

/// A counter whose rate is known.
#[derive(Clone, Copy, Debug)]
pub struct Timer {
    start: u64,
    count_s: f64,
}

/// How long the rate is measured.
const CALIBRATION_S: f64 = 0.2;

impl Timer {
    pub fn new() -> Self {
        let (clock, start) = (Instant::now(), count());
        while clock.elapsed().as_secs_f64() < CALIBRATION_S {
            std::hint::spin_loop();
        }
        let counted = (count() - start) as f64;
        Self { start, count_s: clock.elapsed().as_secs_f64() / counted }
    }

    /// The counter now.
    #[inline(always)]
    pub fn now(&self) -> u64 {
        count()
    }

    /// When a count was, in s from any start.
    pub fn stamp_s(&self, count: u64) -> f64 {
        count.saturating_sub(self.start) as f64 * self.count_s
    }

    /// A difference of counts in µs.
    pub fn us(&self, counts: u64) -> f64 {
        counts as f64 * self.count_s * 1e6
    }

    /// What two readings take that follow each other: sorted, in counts.
    pub fn itself(&self, readings: usize) -> Vec<u32> {
        let mut taken = vec![1_u32; readings];
        for slot in &mut taken {
            let before = count();
            *slot = short(count() - before);
        }
        taken.sort_unstable();
        taken
    }
}

/// A difference of counts in half the room; what takes seconds is as long as can be said.
pub fn short(counts: u64) -> u32 {
    u32::try_from(counts).unwrap_or(u32::MAX)
}

/// The nearest-rank quantile of sorted counts.
pub fn quantile(sorted: &[u32], q: f64) -> u32 {
    sorted[rank(sorted.len(), q)]
}
