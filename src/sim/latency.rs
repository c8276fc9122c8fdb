//! How long steps took: counts in fixed buckets, a quarter of an octave wide.

/// Upper end of the first bucket in s.
const FIRST_END_S: f64 = 1e-6;
/// Buckets that double a time.
const PER_OCTAVE: u32 = 4;

/// How many of a simulation's steps took how long, from the call until the forces could be read.
///
/// Bucket 0 counts what took less than 1 µs, bucket i from 1 to 80 what took at least 2^((i − 1) / 4) µs and less than 2^(i / 4) µs, and the
/// last one what took 2²⁰ µs (1.05 s) or longer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Latency {
    counts: [u64; Self::BUCKETS],
    max_s: f64,
}

impl Default for Latency {
    fn default() -> Self {
        Self { counts: [0; Self::BUCKETS], max_s: 0.0 }
    }
}

impl Latency {
    /// How many buckets there are.
    pub const BUCKETS: usize = 2 + 20 * PER_OCTAVE as usize;

    /// Counts a step.
    pub(super) fn note(&mut self, seconds: f64) {
        let after_first = (f64::from(PER_OCTAVE) * (seconds / FIRST_END_S).log2()).floor() + 1.0;
        // A negative number becomes 0.
        self.counts[(after_first as usize).min(Self::BUCKETS - 1)] += 1;
        self.max_s = self.max_s.max(seconds);
    }

    /// Steps in each bucket.
    pub fn counts(&self) -> &[u64; Self::BUCKETS] {
        &self.counts
    }

    /// Steps in all.
    pub fn steps(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// The longest step in seconds; 0 before the first.
    pub fn max_s(&self) -> f64 {
        self.max_s
    }

    /// The time in seconds within which the fraction `q` of all steps was done (0.5: the median): the end of the bucket that the step of
    /// that rank is in, so up to 19 % too long and never too short, but nothing longer than the longest step. 0 before the first.
    pub fn quantile_s(&self, q: f64) -> f64 {
        let rank = ((q * self.steps() as f64).ceil() as u64).max(1);
        let mut within = 0;
        let bucket = self.counts.iter().position(|count| {
            within += count;
            within >= rank
        });
        let end_s = |bucket: usize| FIRST_END_S * (bucket as f64 / f64::from(PER_OCTAVE)).exp2();
        match bucket {
            Some(bucket) if bucket < Self::BUCKETS - 1 => end_s(bucket).min(self.max_s),
            _ => self.max_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Noise;

    /// The width of a bucket.
    const WIDTH: f64 = 1.189_207_115_002_721; // 2^¼

    #[test]
    fn quantiles_are_those_of_the_steps_to_the_end_of_a_bucket() {
        let mut noise = Noise(7);
        for count in [1, 2, 10, 999, 20_000] {
            let mut latency = Latency::default();
            // Spread over the six decades of the buckets.
            let mut times: Vec<f64> = (0..count).map(|_| 10f64.powf(3.0 * noise.next() - 3.0)).collect();
            times.iter().for_each(|&time| latency.note(time));
            times.sort_by(f64::total_cmp);
            assert_eq!(latency.steps(), count as u64);
            assert_eq!(latency.max_s(), times[count - 1]);
            for q in [0.0, 0.1, 0.5, 0.9, 0.99, 0.999, 1.0] {
                let exact = times[((q * count as f64).ceil() as usize).max(1) - 1];
                let found = latency.quantile_s(q);
                assert!(
                    (exact..=exact * WIDTH * (1.0 + 1e-12)).contains(&found),
                    "{q} of {count}: {found} for {exact}"
                );
            }
            assert_eq!(latency.quantile_s(1.0), latency.max_s());
        }
    }

    #[test]
    fn a_step_is_counted_in_the_bucket_that_holds_its_time() {
        let bucket_of = |seconds: f64| {
            let mut latency = Latency::default();
            latency.note(seconds);
            latency.counts().iter().position(|&count| count == 1).unwrap()
        };
        assert_eq!([0.0, 1e-9, 0.999e-6].map(bucket_of), [0; 3]);
        // Just inside both ends of each.
        for bucket in 1..Latency::BUCKETS - 1 {
            let start = 1e-6 * WIDTH.powi(bucket as i32 - 1);
            assert_eq!([start * 1.0001, start * WIDTH * 0.9999].map(bucket_of), [bucket; 2]);
        }
        assert_eq!([1.0486, 3600.0].map(bucket_of), [Latency::BUCKETS - 1; 2]);
    }

    #[test]
    fn times_outside_the_buckets_are_told_by_their_ends_and_the_longest() {
        let mut latency = Latency::default();
        assert_eq!((latency.steps(), latency.quantile_s(0.5), latency.max_s()), (0, 0.0, 0.0));
        [1e-7, 2e-7, 5.0, 7.0].into_iter().for_each(|time| latency.note(time));
        assert_eq!((latency.quantile_s(0.5), latency.quantile_s(0.75)), (1e-6, 7.0));
    }
}
