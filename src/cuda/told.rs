//! What the device tells of a step: one record in the host's memory, its number last.

use std::sync::Arc;
use std::sync::atomic::{Ordering, fence};

use cudarc::driver::sys::CUdeviceptr;

use super::layout::Report;
use super::memory::{Pinned, Stream};
use crate::error::{Error, Result};
use crate::trace;

/// Looks at the report between two looks at whether the device still works.
const PATIENCE: u32 = 1000;

/// Where the device writes its reports.
#[derive(Debug)]
pub struct Told(Pinned<Report>);

impl Told {
    /// Nothing yet.
    pub fn new(stream: &Arc<Stream>) -> Result<Self> {
        Pinned::new(stream).map(Self)
    }

    /// Address for the device.
    pub fn device_at(&self) -> CUdeviceptr {
        self.0.device_at()
    }

    /// Waits for the report of the step with a number, the last that was asked of the stream.
    pub fn wait(&self, stream: &Stream, sequence: u32) -> Result<Report> {
        let _range = trace::range(c"wait");
        let report = self.0.host();
        let mut looks = 0;
        // SAFETY: the record lives as long as this; the device writes `sequence` last.
        while unsafe { (&raw const (*report).sequence).read_volatile() } != sequence {
            looks += 1;
            if looks % PATIENCE == 0 {
                let _entered = stream.device.enter()?;
                let is_done = stream.device.driver.is_done(stream.handle)?;
                // SAFETY: as above.
                if is_done && unsafe { (&raw const (*report).sequence).read_volatile() } != sequence {
                    return Err(Error::Device("a step ended without its report".into()));
                }
            }
            std::hint::spin_loop();
        }
        // Acquire: what the device wrote before the number is read after it.
        fence(Ordering::Acquire);
        stream.note_idle();
        // SAFETY: as above; the device writes again only in the next step.
        Ok(unsafe { report.read_volatile() })
    }
}
