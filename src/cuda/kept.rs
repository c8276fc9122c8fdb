//! Values on the device of which the host has a copy, so that what changes alone is written.

use std::ops::Range;
use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use super::memory::{Buffer, Plain, Stream};
use crate::error::Result;
use crate::model::surface::grow;

/// Bytes that are compared, and written, together.
const BLOCK_BYTES: usize = 512;
/// What is the same is written too where a gap is no longer than this: a copy more takes as long.
const GAP_BYTES: usize = 8192;

/// Values that change now and then.
#[derive(Debug)]
pub struct Kept<T> {
    stream: Arc<Stream>,
    host: Vec<T>,
    buffer: Buffer<T>,
}

impl<T: Plain + PartialEq> Kept<T> {
    /// Those values, and room for `room` at least.
    pub fn of(stream: &Arc<Stream>, mut values: Vec<T>, room: usize) -> Result<Self> {
        grow(&mut values, room);
        let buffer = Buffer::zeros(stream, room.max(values.len()))?;
        buffer.write(0, &values)?;
        Ok(Self { stream: stream.clone(), host: values, buffer })
    }

    /// Replaces all of them. Where there is no room they go to another place.
    pub fn set(&mut self, values: Vec<T>) -> Result<()> {
        let changed = changed(&self.host, &values);
        self.write(values, changed)
    }

    /// Replaces them by values that differ in these ranges.
    fn write(&mut self, values: Vec<T>, mut changed: Vec<Range<usize>>) -> Result<()> {
        if values.len() > self.buffer.room() {
            self.buffer = Buffer::zeros(&self.stream, values.len().next_power_of_two())?;
            changed = std::iter::once(0..values.len()).collect();
        }
        // Should a write fail, nobody knows what has arrived.
        self.host.clear();
        self.buffer.write_ranges(&values, changed.into_iter().map(|range| (range.start, range)))?;
        self.host = values;
        Ok(())
    }

    /// Makes it so many values: those at `places`, which ascend, are what `value` says, and others what they were, or, where there were none, what it says too.
    pub fn edit(&mut self, count: usize, places: &[u32], value: impl Fn(usize) -> T) -> Result<()> {
        let before = self.host.len().min(count);
        let mut host = std::mem::take(&mut self.host);
        host.truncate(count);
        host.extend((before..count).map(&value));
        let places = places.iter().map(|&place| place as usize).filter(|&place| place < before);
        let mut ranges: Vec<Range<usize>> = Vec::new();
        for place in places.inspect(|&place| host[place] = value(place)) {
            add(&mut ranges, place..place + 1, GAP_BYTES / size_of::<T>());
        }
        if before < count {
            add(&mut ranges, before..count, GAP_BYTES / size_of::<T>());
        }
        self.write(host, ranges)
    }

    /// The values.
    pub fn host(&self) -> &[T] {
        &self.host
    }

    /// Address on the device.
    pub fn at(&self) -> CUdeviceptr {
        self.buffer.at()
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        self.buffer.bytes()
    }
}

/// Ranges in which `new` differs from `old`, or goes on behind it.
fn changed<T: PartialEq>(old: &[T], new: &[T]) -> Vec<Range<usize>> {
    let [block, gap] = [BLOCK_BYTES, GAP_BYTES].map(|bytes| (bytes / size_of::<T>()).max(1));
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for (start, values) in (0..).step_by(block).zip(new.chunks(block)) {
        let end = start + values.len();
        if old.get(start..end) == Some(values) {
            continue;
        }
        add(&mut ranges, start..end, gap);
    }
    ranges
}

/// Adds a range behind others; one that is no further than `gap` from the last one goes together with it.
fn add(ranges: &mut Vec<Range<usize>>, range: Range<usize>, gap: usize) {
    match ranges.last_mut() {
        Some(last) if range.start - last.end <= gap => last.end = range.end,
        _ => ranges.push(range),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_is_found_in_blocks_and_near_ones_go_together() {
        let old: Vec<u32> = (0..100_000).collect();
        assert!(changed(&old, &old).is_empty() && changed(&old, &old[..77]).is_empty());
        let with = |at: &[usize]| {
            let mut new = old.clone();
            at.iter().for_each(|&at| new[at] = 0);
            new
        };
        assert_eq!(changed(&old, &with(&[1000])), vec![896..1024]);
        assert_eq!(changed(&old, &with(&[1000, 1025, 3000])), vec![896..3072]);
        assert_eq!(changed(&old, &with(&[1000, 50_000])), vec![896..1024, 49_920..50_048]);
        let mut longer = old.clone();
        longer.push(7);
        assert_eq!(changed(&old, &longer), vec![99_968..100_001]);
        assert_eq!(changed(&[], &longer), vec![0..100_001]);
    }
}
