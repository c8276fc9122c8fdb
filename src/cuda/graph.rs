//! Work that is recorded once and asked for as often as wanted, at the price of a single launch.

use std::sync::Arc;

use cudarc::driver::sys::CUgraphExec;

use super::memory::Stream;
use crate::error::Result;

/// Recorded work on a stream.
#[derive(Debug)]
pub struct Graph {
    stream: Arc<Stream>,
    handle: CUgraphExec,
}

// SAFETY: a graph may be launched from any thread that has entered the context.
unsafe impl Send for Graph {}

impl Graph {
    /// Records what `work` asks of the stream; none of it runs.
    pub fn record(stream: &Arc<Stream>, work: impl FnOnce() -> Result<()>) -> Result<Self> {
        /// CU_STREAM_CAPTURE_MODE_THREAD_LOCAL: what other threads do meanwhile is their own business.
        const THREAD_LOCAL: u32 = 1;
        let driver = stream.device.driver;
        let _entered = stream.device.enter()?;
        let (mut graph, mut handle) = (std::ptr::null_mut(), std::ptr::null_mut());
        // SAFETY: an own stream; what is recorded ends below, whatever `work` did.
        unsafe {
            driver.check((driver.stream_begin_capture)(stream.handle, THREAD_LOCAL), "recording a step")?;
            let worked = work();
            let ended =
                driver.check((driver.stream_end_capture)(stream.handle, &mut graph), "recording a step");
            let made = worked.and(ended).and_then(|()| {
                driver.check((driver.graph_instantiate)(&mut handle, graph, 0), "preparing a step")
            });
            if !graph.is_null() {
                (driver.graph_destroy)(graph);
            }
            made?;
        }
        Ok(Self { stream: stream.clone(), handle })
    }

    /// Asks the stream for the work.
    pub fn launch(&self) -> Result<()> {
        let device = &self.stream.device;
        let _entered = device.enter()?;
        // SAFETY: an own graph on its stream.
        device.driver.check(
            unsafe { (device.driver.graph_launch)(self.handle, self.stream.handle) },
            "starting a step",
        )
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        if let Ok(_entered) = self.stream.device.enter() {
            // SAFETY: an own graph; the driver keeps what is still running.
            unsafe { (self.stream.device.driver.graph_exec_destroy)(self.handle) };
        }
    }
}
