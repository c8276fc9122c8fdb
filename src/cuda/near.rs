//! Bricks near tools: they may not sleep, and in a large model they advance apart from the rest, so that contact need not wait for it.

use std::sync::Arc;

use super::layout::{self, Pass, sleepers};
use super::memory::{Buffer, Stream};
use crate::error::Result;

/// Which bricks are near tools, on the device: those with nodes that carry listed sites.
#[derive(Debug)]
pub struct NearTools {
    is_near: Buffer<u32>,
    bricks: Buffer<u32>,
    counts: Buffer<u32>,
    had_tools: bool,
}

impl NearTools {
    /// None of so many.
    pub fn new(bricks: usize, stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            is_near: Buffer::zeros(stream, bricks + 1)?,
            bricks: Buffer::zeros(stream, bricks)?,
            counts: Buffer::zeros(stream, sleepers::COUNTS)?,
            had_tools: false,
        })
    }

    /// A step has so many tools. Where it has none, no brick is near one.
    pub fn prepare(&mut self, tools: usize) -> Result<()> {
        if tools == 0 && self.had_tools {
            self.clear()?;
        }
        self.had_tools = tools > 0;
        Ok(())
    }

    /// No brick is near a tool.
    pub fn clear(&self) -> Result<()> {
        self.is_near.clear()?;
        self.counts.clear()
    }

    /// Tells a pass where they are noted.
    pub fn note_in(&self, pass: &mut Pass) {
        pass.near_tools = self.is_near.at();
        pass.near_bricks = self.bricks.at();
        pass.near_counts = self.counts.at();
    }

    /// The list, in place of that of the bricks that are awake.
    pub fn as_awake(&self, sleep: layout::Sleep) -> layout::Sleep {
        layout::Sleep { awake: self.bricks.at(), counts: self.counts.at(), ..sleep }
    }
}
