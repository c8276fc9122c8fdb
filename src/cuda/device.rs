//! GPUs: which there are, and one in use.

use std::ffi::{CStr, c_int};
use std::marker::PhantomData;
use std::sync::Arc;

use cudarc::driver::sys::{CUcontext, CUdevice};

use super::driver::Driver;
use crate::error::{Error, Result};

/// Oldest compute capability that the kernels run on.
const OLDEST: (i32, i32) = (7, 5);

/// Attributes of a device, by their numbers in cuda.h.
const MAJOR: c_int = 75;
const MINOR: c_int = 76;
const SHARED_BYTES_OF_A_BLOCK: c_int = 97;

/// A GPU whose primary context is held as long as this lives.
#[derive(Debug)]
pub struct Device {
    pub(super) driver: &'static Driver,
    handle: CUdevice,
    context: CUcontext,
    name: String,
    capability: (i32, i32),
}

// SAFETY: a device and its context may be used from any thread; a thread makes the context current through [`Device::enter`].
unsafe impl Send for Device {}
// SAFETY: see above.
unsafe impl Sync for Device {}

impl Device {
    /// The device with an index, or the first that the kernels run on.
    pub fn open(index: Option<u32>) -> Result<Arc<Self>> {
        let driver = Driver::get()?;
        let mut count = 0;
        // SAFETY: `count` is written.
        driver.check(unsafe { (driver.device_get_count)(&mut count) }, "counting GPUs")?;
        if count <= 0 {
            return Err(Error::NoDevice("the CUDA driver finds no GPU".into()));
        }
        match index {
            Some(index) if index >= count as u32 => {
                Err(Error::argument(format!("there is no GPU {index}: the driver finds {count}")))
            }
            Some(index) => Self::take(driver, index as c_int),
            None => {
                let mut why = None;
                for index in 0..count {
                    match Self::take(driver, index) {
                        Ok(device) => return Ok(device),
                        Err(error) => why = why.or(Some(error)),
                    }
                }
                Err(why.expect("at least one GPU was tried"))
            }
        }
    }

    fn take(driver: &'static Driver, index: c_int) -> Result<Arc<Self>> {
        let mut handle = 0;
        let mut name = [0; 128];
        let (mut major, mut minor) = (0, 0);
        // SAFETY: each call writes what it is given a pointer to; the name is cut to fit, with its end.
        unsafe {
            driver.check((driver.device_get)(&mut handle, index), "opening a GPU")?;
            driver.check(
                (driver.device_get_name)(name.as_mut_ptr(), name.len() as c_int, handle),
                "naming a GPU",
            )?;
            for (value, attribute) in [(&mut major, MAJOR), (&mut minor, MINOR)] {
                driver.check((driver.device_get_attribute)(value, attribute, handle), "asking a GPU")?;
            }
        }
        // SAFETY: the driver ended the name inside the array.
        let name = unsafe { CStr::from_ptr(name.as_ptr()) }.to_string_lossy().into_owned();
        if (major, minor) < OLDEST {
            return Err(Error::NoDevice(format!(
                "{name} has compute capability {major}.{minor}; the kernels need {}.{}",
                OLDEST.0, OLDEST.1
            )));
        }
        let mut context = std::ptr::null_mut();
        // SAFETY: `context` is written; it is released when the device is dropped.
        driver.check(unsafe { (driver.primary_ctx_retain)(&mut context, handle) }, "a context on the GPU")?;
        Ok(Arc::new(Self { driver, handle, context, name, capability: (major, minor) }))
    }

    /// The GPU's own name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its compute capability.
    pub fn capability(&self) -> (i32, i32) {
        self.capability
    }

    /// Shared memory that a block may ask for, in bytes.
    pub(super) fn shared_bytes(&self) -> Result<u32> {
        let mut bytes = 0;
        // SAFETY: `bytes` is written.
        let status =
            unsafe { (self.driver.device_get_attribute)(&mut bytes, SHARED_BYTES_OF_A_BLOCK, self.handle) };
        self.driver.check(status, "asking a GPU")?;
        Ok(bytes as u32)
    }

    /// Makes the context current on this thread until the guard is dropped; the host's own context is then current again.
    pub(super) fn enter(&self) -> Result<Entered<'_>> {
        // SAFETY: the context is held.
        let status = unsafe { (self.driver.ctx_push_current)(self.context) };
        self.driver.check(status, "entering the GPU's context")?;
        Ok(Entered { device: self, here: PhantomData })
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: retained in `take`. A driver that fails here has nothing left to give back.
        unsafe { (self.driver.primary_ctx_release)(self.handle) };
    }
}

/// The context is current on this thread.
pub(super) struct Entered<'a> {
    device: &'a Device,
    /// Stays on the thread that entered.
    here: PhantomData<*const ()>,
}

impl Drop for Entered<'_> {
    fn drop(&mut self) {
        let mut context = std::ptr::null_mut();
        // SAFETY: undoes `enter` on the same thread.
        unsafe { (self.device.driver.ctx_pop_current)(&mut context) };
    }
}
