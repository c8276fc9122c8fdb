//! What a cut changes of the nodes on the device: those that it makes start as what they were, and nodes have other cells around them.

use std::collections::BTreeSet;
use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use super::body::Body;
use super::kernels::Kernel;
use super::layout::{self, Birth, Reworded, Turned};
use super::memory::{Buffer, Stream};
use super::pointer;
use crate::cut::topology::Change;
use crate::error::Result;

/// Threads of a block.
const THREADS: u32 = 128;

/// The lists that the device gets of a cut.
#[derive(Debug)]
pub struct Cutter {
    stream: Arc<Stream>,
    born: Buffer<Birth>,
    reworded: Buffer<Reworded>,
    turned: Buffer<Turned>,
}

/// Where nodes lie.
#[derive(Clone, Copy, Debug)]
pub struct Fields {
    /// Displacements and words, and fields of three numbers for each node; 0 where there are fewer.
    pub u: [CUdeviceptr; 2],
    pub vectors: [CUdeviceptr; 2],
    /// Rotations of cells, and of rows.
    pub rotations: CUdeviceptr,
    pub row_rotations: CUdeviceptr,
}

impl Cutter {
    /// Room for so many births, and for as many changes of other kinds: a cut that makes more makes room.
    pub fn new(room: usize, stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            stream: stream.clone(),
            born: Buffer::zeros(stream, room)?,
            reworded: Buffer::zeros(stream, room)?,
            turned: Buffer::zeros(stream, room)?,
        })
    }

    /// Has the device do what a change says that `body` has taken over, with the kernel for the precision of the fields, and turns rows.
    pub fn take(
        &mut self,
        kernel: Kernel,
        change: &Change,
        body: &Body,
        turned: &[Turned],
        fields: Fields,
    ) -> Result<()> {
        let born: Vec<Birth> =
            change.births.iter().map(|birth| Birth { slot: birth.slot, from: birth.from }).collect();
        let lattice = body.bricks.model.lattice();
        let corners: BTreeSet<u32> =
            change.reshaped().flat_map(|cell| lattice.corners(lattice.node_of(cell))).collect();
        let reworded: Vec<Reworded> =
            corners.into_iter().map(|slot| Reworded { slot, word: body.bricks.word(slot) }).collect();
        self.born.replace(&born)?;
        self.reworded.replace(&reworded)?;
        self.turned.replace(turned)?;
        let mut cut = layout::Cut {
            births: born.len() as u32,
            words: reworded.len() as u32,
            turns: turned.len() as u32,
            born: self.born.at(),
            reworded: self.reworded.at(),
            turned: self.turned.at(),
            u: fields.u,
            vectors: fields.vectors,
            rotations: fields.rotations,
            row_rotations: fields.row_rotations,
        };
        let blocks = (cut.births + cut.words + cut.turns).div_ceil(THREADS);
        if blocks == 0 {
            return Ok(());
        }
        let device = &self.stream.device;
        let _entered = device.enter()?;
        // SAFETY: the kernel's argument, as declared, of buffers that are freed only once the device has ended its work.
        unsafe { kernel.launch(device, self.stream.handle, blocks, THREADS, &mut [pointer(&mut cut)]) }
    }
}
