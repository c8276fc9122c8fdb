//! Looks at where nodes are on the device: bounds of all bricks, and the nodes of those that the host asks for. Neither is a copy of all nodes.

use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use super::efg::Number;
use super::kernels::{Kernel, LookKernels};
use super::layout::{self, Places};
use super::memory::{Buffer, Pinned, Stream};
use super::pointer;
use crate::error::Result;
use crate::math::{Bounds, Vec3};
use crate::model::lattice::{BRICK_SLOTS, Lattice};
use crate::solver::SeenBrick;

/// Numbers of a brick that is shown.
const NUMBERS: usize = 2 * 3 * BRICK_SLOTS;
/// Bricks for which there is room at first.
const ROOM: usize = 256;
/// Words with a bit for each node of a brick.
const WORDS: usize = BRICK_SLOTS / 32;

/// What the host sees of the nodes of a lattice.
#[derive(Debug)]
pub struct Look<R> {
    stream: Arc<Stream>,
    kernels: LookKernels,
    count: usize,
    nodes: Buffer<[u32; WORDS]>,
    /// Displacements at two looks, and which is the last one.
    seen: [Buffer<R>; 2],
    last: usize,
    /// Whether there was one.
    has_looked: bool,
    bounds: Pinned<[R; 6]>,
    bricks: Pinned<u32>,
    shown: Pinned<R>,
    room: usize,
}

impl<R: Number> Look<R> {
    /// Of a lattice.
    pub fn new(lattice: &Lattice, stream: &Arc<Stream>) -> Result<Self> {
        let count = lattice.bricks().len();
        let mut nodes = vec![[0; WORDS]; count];
        for slot in lattice.slots() {
            let (brick, place) = (slot as usize / BRICK_SLOTS, slot as usize % BRICK_SLOTS);
            nodes[brick][place / 32] |= 1 << (place % 32);
        }
        let seen = || Buffer::zeros(stream, count * 3 * BRICK_SLOTS);
        let room = ROOM.min(count);
        Ok(Self {
            kernels: LookKernels::load(&stream.device, R::PRECISION)?,
            count,
            nodes: Buffer::of(stream, &nodes)?,
            seen: [seen()?, seen()?],
            last: 0,
            has_looked: false,
            bounds: Pinned::array(stream, count)?,
            bricks: Pinned::array(stream, count)?,
            shown: Pinned::array(stream, room * NUMBERS)?,
            room,
            stream: stream.clone(),
        })
    }

    /// Looks at displacements; see [`crate::solver::Solver::look`].
    pub fn look(&mut self, u: CUdeviceptr, places: Places, displaced: &mut Vec<Bounds>) -> Result<()> {
        self.last = 1 - self.last;
        let mut record = layout::Look {
            places,
            u,
            nodes: self.nodes.at(),
            seen: self.seen[self.last].at(),
            bounds: self.bounds.device_at(),
        };
        self.run(self.kernels.look, self.count, pointer(&mut record))?;
        self.has_looked = true;
        self.stream.traffic.add_to_host(self.count * size_of::<[R; 6]>());
        // SAFETY: the kernel has written all of them, and nothing writes there before the next look.
        let bounds = unsafe { std::slice::from_raw_parts(self.bounds.host(), self.count) };
        displaced.extend(bounds.iter().map(|bounds| {
            let [low, high] = [0, 3].map(|at| Vec3::from_fn(|axis, _| bounds[at + axis].to_f64()));
            Bounds { low, high }
        }));
        Ok(())
    }

    /// Shows bricks; see [`crate::solver::Solver::seen`].
    pub fn show(&mut self, bricks: &[u32], nodes: &mut Vec<SeenBrick>) -> Result<()> {
        if bricks.len() > self.room {
            self.room = bricks.len().next_power_of_two().min(self.count);
            self.shown = Pinned::array(&self.stream, self.room * NUMBERS)?;
        }
        assert!(bricks.len() <= self.count && bricks.iter().all(|&brick| (brick as usize) < self.count));
        // SAFETY: room for one of each; the kernel that has read the last list has ended.
        unsafe { std::ptr::copy_nonoverlapping(bricks.as_ptr(), self.bricks.host(), bricks.len()) };
        let [before, now] = [1 - self.last, self.last].map(|look| self.seen[look].at());
        let mut record = layout::Shown {
            bricks: self.bricks.device_at(),
            seen: [before, now],
            nodes: self.shown.device_at(),
        };
        self.run(self.kernels.show, bricks.len(), pointer(&mut record))?;
        self.stream.traffic.add_to_device(size_of_val(bricks));
        self.stream.traffic.add_to_host(bricks.len() * NUMBERS * size_of::<R>());
        // SAFETY: the kernel has written so many, and nothing writes there before the next call.
        let shown = unsafe { std::slice::from_raw_parts(self.shown.host(), bricks.len() * NUMBERS) };
        nodes.extend(shown.chunks(NUMBERS).map(|shown| {
            [0, 1].map(|look| {
                let at = |axis: usize, place: usize| shown[(3 * look + axis) * BRICK_SLOTS + place].to_f64();
                std::array::from_fn(|place| Vec3::from_fn(|axis, _| at(axis, place)))
            })
        }));
        Ok(())
    }

    /// Has a kernel do so many bricks, and waits for it.
    fn run(&self, kernel: Kernel, bricks: usize, record: *mut std::ffi::c_void) -> Result<()> {
        let device = &self.stream.device;
        {
            let _entered = device.enter()?;
            // SAFETY: the kernel's argument, as declared, of memory that outlives the wait below.
            unsafe {
                kernel.launch(
                    device,
                    self.stream.handle,
                    bricks as u32,
                    BRICK_SLOTS as u32,
                    &mut [record],
                )?;
            }
        }
        self.stream.wait()
    }

    /// Copies the last look, if there was one.
    pub fn save(&self) -> Result<Vec<R>> {
        if self.has_looked { self.seen[self.last].all() } else { Ok(Vec::new()) }
    }

    /// Goes on from there.
    pub fn restore(&mut self, saved: &[R]) -> Result<()> {
        self.has_looked = !saved.is_empty();
        self.seen[self.last].write(0, saved)
    }
}
