//! Memory on the device, and records of the host's that the device sees.

use std::ffi::c_void;
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use cudarc::driver::sys::{CUdeviceptr, CUstream};
use parking_lot::Mutex;

use super::device::Device;
use crate::cpu::efg::rows::{Cell, Entry, Place};
use crate::error::Result;
use crate::solver::statistics::Copied;

/// Numbers and structures without pointers or padding that matters: any bytes are a value.
///
/// # Safety
/// The type is `repr(C)` or a primitive, holds numbers alone and is valid for all bit patterns.
pub unsafe trait Plain: Copy {}
// SAFETY: primitives and arrays of them.
unsafe impl Plain for u8 {}
// SAFETY: see above.
unsafe impl Plain for u32 {}
// SAFETY: see above.
unsafe impl Plain for u64 {}
// SAFETY: see above.
unsafe impl Plain for f32 {}
// SAFETY: see above.
unsafe impl Plain for f64 {}
// SAFETY: see above.
unsafe impl<T: Plain, const N: usize> Plain for [T; N] {}
// SAFETY: `repr(C)` numbers.
unsafe impl Plain for super::layout::Law {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Part {}
// SAFETY: see above.
unsafe impl Plain for super::layout::ToolSum {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Carrier {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Load {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Pushed {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Pressed {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Driven {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Motion {}
// SAFETY: see above.
unsafe impl Plain for super::layout::EfgLaw {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Held {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Piece {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Pieces {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Facing {}
// SAFETY: see above; what pads it does not matter.
unsafe impl Plain for super::layout::Stuck {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Pull {}
// SAFETY: see above.
unsafe impl Plain for super::layout::EdgePoint {}
// SAFETY: see above.
unsafe impl Plain for super::layout::EdgeCarrier {}
// SAFETY: see above.
unsafe impl Plain for super::layout::EdgeLoad {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Birth {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Reworded {}
// SAFETY: see above.
unsafe impl Plain for super::layout::Turned {}

// SAFETY: see above.
unsafe impl<R: Plain> Plain for Cell<R> {}
// SAFETY: see above.
unsafe impl<R: Plain> Plain for Entry<R> {}
// SAFETY: see above.
unsafe impl Plain for Place {}

/// A stream of work on a device: what is asked of it happens in order.
#[derive(Debug)]
pub struct Stream {
    pub device: Arc<Device>,
    pub handle: CUstream,
    /// What was copied through it.
    pub traffic: Traffic,
    staged: Mutex<Staged>,
}

/// Bytes for which there is room on their way to the device, and most of a copy that goes that way: longer ones would soon fill it.
const STAGED_BYTES: usize = 1 << 20;
const MOST_STAGED: usize = 1 << 16;

/// Memory of the host's that the device copies from when it comes to it: nobody waits for that.
#[derive(Debug)]
struct Staged {
    host: *mut u8,
    /// How much of it the device may have yet to copy.
    used: usize,
}

// SAFETY: plain memory, which goes where the stream goes.
unsafe impl Send for Staged {}

/// Bytes that were copied between host and device.
#[derive(Debug, Default)]
pub struct Traffic {
    to_device: AtomicU64,
    to_host: AtomicU64,
}

/// ORDERING: mere counts, which order nothing.
impl Traffic {
    /// Notes bytes that were written to the device.
    pub fn add_to_device(&self, bytes: usize) {
        self.to_device.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Notes bytes that were read from it, or that it wrote into the host's memory.
    pub fn add_to_host(&self, bytes: usize) {
        self.to_host.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// All so far.
    pub fn total(&self) -> Copied {
        let [to_device, to_host] = [&self.to_device, &self.to_host].map(|n| n.load(Ordering::Relaxed));
        Copied { to_device, to_host }
    }
}

// SAFETY: streams may be used from any thread that has entered the context.
unsafe impl Send for Stream {}
// SAFETY: see above.
unsafe impl Sync for Stream {}

impl Stream {
    /// A stream that does not wait for the host's own default stream.
    pub fn new(device: Arc<Device>) -> Result<Self> {
        /// CU_STREAM_NON_BLOCKING.
        const NON_BLOCKING: u32 = 1;
        let (mut handle, mut host) = (std::ptr::null_mut(), std::ptr::null_mut());
        {
            let _entered = device.enter()?;
            // SAFETY: `host` is written, and then `handle`.
            let status = unsafe { (device.driver.mem_host_alloc)(&mut host, STAGED_BYTES, 0) };
            device.driver.check(status, "memory that the GPU copies from")?;
            // SAFETY: as above.
            let status = unsafe { (device.driver.stream_create)(&mut handle, NON_BLOCKING) };
            device.driver.check(status, "a stream on the GPU").inspect_err(|_| {
                // SAFETY: own memory, which nobody has used.
                unsafe { (device.driver.mem_free_host)(host) };
            })?;
        }
        let staged = Mutex::new(Staged { host: host.cast(), used: 0 });
        Ok(Self { device, handle, traffic: Traffic::default(), staged })
    }

    /// All that was asked of the stream has been done, as a report has told that came last.
    pub fn note_idle(&self) {
        self.staged.lock().used = 0;
    }

    /// Asks for a copy of the host's values to the device. Where these are few they may change as soon as this returns; otherwise, which it says, only after [`Self::wait`].
    ///
    /// # Safety
    /// There is room for the values at `at`, and those that it says so of stay until the wait.
    unsafe fn copy<T: Plain>(&self, values: &[T], at: CUdeviceptr) -> Result<bool> {
        let bytes = size_of_val(values);
        let mut from = values.as_ptr().cast::<c_void>();
        let is_staged = bytes <= MOST_STAGED;
        if is_staged {
            if self.staged.lock().used + bytes > STAGED_BYTES {
                self.wait()?;
            }
            let mut staged = self.staged.lock();
            // SAFETY: inside the memory as just made sure of, in a part that the device does not copy from; one thread asks at a time.
            unsafe {
                let place = staged.host.add(staged.used);
                std::ptr::copy_nonoverlapping(from.cast(), place, bytes);
                from = place.cast_const().cast();
            }
            staged.used += bytes;
        }
        let _entered = self.device.enter()?;
        // SAFETY: as promised; what was staged stays until the stream is known to have come so far.
        let status = unsafe { (self.device.driver.memcpy_to_device)(at, from, bytes, self.handle) };
        self.device.driver.check(status, "writing to the GPU")?;
        self.traffic.add_to_device(bytes);
        Ok(is_staged)
    }

    /// Waits until all is done.
    pub fn wait(&self) -> Result<()> {
        let _entered = self.device.enter()?;
        // SAFETY: an own stream.
        let status = unsafe { (self.device.driver.stream_synchronize)(self.handle) };
        self.device.driver.check(status, "waiting for the GPU")?;
        self.note_idle();
        Ok(())
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        if let Ok(_entered) = self.device.enter() {
            // SAFETY: an own stream, used no more; pending work is finished first, and then nothing copies from the memory.
            unsafe {
                (self.device.driver.stream_synchronize)(self.handle);
                (self.device.driver.stream_destroy)(self.handle);
                (self.device.driver.mem_free_host)(self.staged.get_mut().host.cast());
            }
        }
    }
}

/// `count` values of `T` on the device.
#[derive(Debug)]
pub struct Buffer<T> {
    stream: Arc<Stream>,
    at: CUdeviceptr,
    count: usize,
    of: PhantomData<T>,
}

impl<T: Plain> Buffer<T> {
    /// Zeroed memory; its size in bytes must be a multiple of four.
    pub fn zeros(stream: &Arc<Stream>, count: usize) -> Result<Self> {
        let device = &stream.device;
        let bytes = count.max(1) * size_of::<T>();
        let mut at = 0;
        let _entered = device.enter()?;
        // SAFETY: `at` is written.
        let status = unsafe { (device.driver.mem_alloc)(&mut at, bytes.next_multiple_of(4)) };
        device.driver.check(status, &format!("{bytes} bytes on the GPU"))?;
        let buffer = Self { stream: stream.clone(), at, count, of: PhantomData };
        buffer.clear()?;
        Ok(buffer)
    }

    /// A copy of the host's values.
    pub fn of(stream: &Arc<Stream>, values: &[T]) -> Result<Self> {
        let buffer = Self::zeros(stream, values.len())?;
        buffer.write(0, values)?;
        Ok(buffer)
    }

    /// Address on the device.
    pub fn at(&self) -> CUdeviceptr {
        self.at
    }

    /// How many values there is room for.
    pub fn room(&self) -> usize {
        self.count
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        (self.count * size_of::<T>()) as u64
    }

    /// Makes all bytes zero, in the stream's order.
    pub fn clear(&self) -> Result<()> {
        self.fill(0)
    }

    /// Fills with a 32-bit word, in the stream's order.
    pub fn fill(&self, word: u32) -> Result<()> {
        let device = &self.stream.device;
        let words = (self.count.max(1) * size_of::<T>()).div_ceil(4);
        let _entered = device.enter()?;
        // SAFETY: own memory, rounded up to whole words.
        let status = unsafe { (device.driver.memset_words)(self.at, word, words, self.stream.handle) };
        device.driver.check(status, "clearing memory of the GPU")
    }

    /// Writes values from `first` on, and returns when the host's copy is no longer needed.
    pub fn write(&self, first: usize, values: &[T]) -> Result<()> {
        self.write_ranges(values, [(first, 0..values.len())])
    }

    /// Writes ranges of values, each to a place of its own, and returns when the host's copy is no longer needed.
    pub fn write_ranges(
        &self,
        values: &[T],
        ranges: impl IntoIterator<Item = (usize, Range<usize>)>,
    ) -> Result<()> {
        let mut are_staged = true;
        for (first, range) in ranges.into_iter().filter(|(_, range)| !range.is_empty()) {
            let values = &values[range];
            assert!(first + values.len() <= self.count, "a write stays inside its buffer");
            let at = self.at + (first * size_of::<T>()) as u64;
            // SAFETY: inside the buffer as asserted; the host's values live until the wait below.
            are_staged &= unsafe { self.stream.copy(values, at)? };
        }
        if are_staged { Ok(()) } else { self.stream.wait() }
    }

    /// Writes values from the first on; where there is no room for them, to another place.
    pub fn replace(&mut self, values: &[T]) -> Result<()> {
        self.make_room(values.len())?;
        self.write(0, values)
    }

    /// Has room for so many values; where there was none they are zeros, at another place.
    pub fn make_room(&mut self, count: usize) -> Result<()> {
        if count > self.count {
            *self = Self::zeros(&self.stream, count.next_power_of_two())?;
        }
        Ok(())
    }

    /// Copies the first `count` values of a record, in the stream's order.
    ///
    /// # Safety
    /// The record stays as it is until the stream has come to the copy.
    pub unsafe fn send(&self, from: &Pinned<T>, count: usize) -> Result<()> {
        assert!(count <= self.count.min(from.count), "a copy stays inside its buffers");
        let device = &self.stream.device;
        let _entered = device.enter()?;
        // SAFETY: inside both as asserted; the record stays, as promised.
        let status = unsafe {
            (device.driver.memcpy_to_device)(
                self.at,
                from.host.cast_const().cast(),
                count * size_of::<T>(),
                self.stream.handle,
            )
        };
        device.driver.check(status, "writing to the GPU")?;
        self.stream.traffic.add_to_device(count * size_of::<T>());
        Ok(())
    }

    /// Reads all values.
    pub fn all(&self) -> Result<Vec<T>>
    where
        T: Default,
    {
        let mut values = vec![T::default(); self.count];
        if !values.is_empty() {
            self.read(0, &mut values)?;
        }
        Ok(values)
    }

    /// Reads values from `first` on.
    pub fn read(&self, first: usize, values: &mut [T]) -> Result<()> {
        assert!(first + values.len() <= self.count, "a read stays inside its buffer");
        let device = &self.stream.device;
        {
            let _entered = device.enter()?;
            let at = self.at + (first * size_of::<T>()) as u64;
            // SAFETY: inside the buffer as asserted; any bytes are a value of a plain type.
            let status = unsafe {
                (device.driver.memcpy_to_host)(
                    values.as_mut_ptr().cast(),
                    at,
                    size_of_val(values),
                    self.stream.handle,
                )
            };
            device.driver.check(status, "reading from the GPU")?;
            self.stream.traffic.add_to_host(size_of_val(values));
        }
        self.stream.wait()
    }
}

impl<T> Drop for Buffer<T> {
    fn drop(&mut self) {
        if let Ok(_entered) = self.stream.device.enter() {
            // SAFETY: own memory; the driver waits for work that uses it.
            unsafe { (self.stream.device.driver.mem_free)(self.at) };
        }
    }
}

/// A record, or an array of them, in the host's memory that stays in place and that the device sees.
#[derive(Debug)]
pub struct Pinned<T> {
    stream: Arc<Stream>,
    host: *mut T,
    count: usize,
    device_at: CUdeviceptr,
}

// SAFETY: plain memory; who may touch it when is the owner's business, as with a Box.
unsafe impl<T: Send> Send for Pinned<T> {}

impl<T: Copy + Default> Pinned<T> {
    /// A default value.
    pub fn new(stream: &Arc<Stream>) -> Result<Self> {
        Self::array(stream, 1)
    }

    /// `count` default values, at least one.
    pub fn array(stream: &Arc<Stream>, count: usize) -> Result<Self> {
        /// CU_MEMHOSTALLOC_PORTABLE | CU_MEMHOSTALLOC_DEVICEMAP.
        const PORTABLE_AND_MAPPED: u32 = 3;
        let device = &stream.device;
        let mut host: *mut c_void = std::ptr::null_mut();
        let _entered = device.enter()?;
        // SAFETY: `host` is written, with memory as large as the records.
        let status =
            unsafe { (device.driver.mem_host_alloc)(&mut host, count * size_of::<T>(), PORTABLE_AND_MAPPED) };
        device.driver.check(status, "memory that the GPU sees")?;
        for place in 0..count {
            // SAFETY: memory of that size, suitably aligned: the driver gives whole pages.
            unsafe { host.cast::<T>().add(place).write(T::default()) };
        }
        let mut pinned = Self { stream: stream.clone(), host: host.cast(), count, device_at: 0 };
        // SAFETY: `device_at` is written.
        let status = unsafe { (device.driver.mem_host_get_device_pointer)(&mut pinned.device_at, host, 0) };
        device.driver.check(status, "memory that the GPU sees")?;
        Ok(pinned)
    }

    /// Address for the device.
    pub fn device_at(&self) -> CUdeviceptr {
        self.device_at
    }

    /// Address for the host; the device may write there at any time.
    pub fn host(&self) -> *mut T {
        self.host
    }
}

impl<T> Drop for Pinned<T> {
    fn drop(&mut self) {
        if let Ok(_entered) = self.stream.device.enter() {
            // SAFETY: own memory; work that uses it is finished first, for the owner waits for its steps.
            unsafe { (self.stream.device.driver.mem_free_host)(self.host.cast()) };
        }
    }
}
