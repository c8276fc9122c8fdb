//! GPUs: which there are, and one in use.

use std::ffi::{CStr, c_int};
use std::marker::PhantomData;
use std::sync::Arc;

use cudarc::driver::sys::{CUcontext, CUdevice};

use super::driver::{Driver, NO_GPU};
use crate::error::{Error, Result};

/// Oldest compute capability that the kernels run on.
const OLDEST: (u32, u32) = (7, 5);

/// Attributes of a device, by their numbers in cuda.h.
const MAJOR: c_int = 75;
const MINOR: c_int = 76;
const PROCESSORS: c_int = 16;
const SHARED_BYTES: c_int = 97;

/// How many GPUs the driver finds: at least one, or [`Error::NoDevice`] with the reason. From any thread.
pub fn count() -> Result<u32> {
    let driver = Driver::get()?;
    let mut count = 0;
    // SAFETY: `count` is written.
    driver.check(unsafe { (driver.device_get_count)(&mut count) }, "counting GPUs")?;
    match u32::try_from(count) {
        Ok(count @ 1..) => Ok(count),
        _ => Err(Error::NoDevice(NO_GPU.into())),
    }
}

/// A GPU as its driver describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceInfo {
    /// Its number among the driver's, from 0.
    pub index: u32,
    /// Its own name.
    pub name: String,
    /// Its compute capability, major and minor.
    pub capability: (u32, u32),
    /// Its memory in bytes, in use or not.
    pub memory_bytes: u64,
}

impl DeviceInfo {
    /// Describes the GPU with an index below [`count`]. Nothing is taken up on it. From any thread.
    pub fn of(index: u32) -> Result<Self> {
        let count = count()?;
        if index >= count {
            return Err(Error::argument(format!("there is no GPU {index}: the driver finds {count}")));
        }
        let driver = Driver::get()?;
        let handle = handle(driver, index)?;
        let mut name = [0_u8; 128];
        let mut bytes = 0;
        // SAFETY: the name and the size are written, the name up to the length that is told.
        unsafe {
            let status = (driver.device_get_name)(name.as_mut_ptr().cast(), name.len() as c_int, handle);
            driver.check(status, "naming a GPU")?;
            driver.check((driver.device_total_mem)(&mut bytes, handle), "asking a GPU")?;
        }
        let [major, minor] = [MAJOR, MINOR].map(|number| attribute(driver, handle, number));
        let name = CStr::from_bytes_until_nul(&name).unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self { index, name, capability: (major?, minor?), memory_bytes: bytes as u64 })
    }

    /// Whether the kernels run on it; [`Error::NoDevice`] says what they need.
    pub fn check(&self) -> Result<()> {
        let (major, minor) = self.capability;
        if self.capability >= OLDEST {
            return Ok(());
        }
        Err(Error::NoDevice(format!(
            "{} has compute capability {major}.{minor}; the kernels need {}.{}",
            self.name, OLDEST.0, OLDEST.1
        )))
    }
}

/// The driver's name for a GPU.
fn handle(driver: &Driver, index: u32) -> Result<CUdevice> {
    let mut handle = 0;
    // SAFETY: `handle` is written.
    driver.check(unsafe { (driver.device_get)(&mut handle, index as c_int) }, "opening a GPU")?;
    Ok(handle)
}

/// An attribute of a GPU; all that are asked for count something.
fn attribute(driver: &Driver, handle: CUdevice, number: c_int) -> Result<u32> {
    let mut value = 0;
    // SAFETY: `value` is written.
    driver.check(unsafe { (driver.device_get_attribute)(&mut value, number, handle) }, "asking a GPU")?;
    Ok(u32::try_from(value).unwrap_or(0))
}

/// A GPU whose primary context is held as long as this lives.
#[derive(Debug)]
pub struct Device {
    pub(super) driver: &'static Driver,
    handle: CUdevice,
    context: CUcontext,
    info: DeviceInfo,
}

// SAFETY: a device and its context may be used from any thread; a thread makes the context current through [`Device::enter`].
unsafe impl Send for Device {}
// SAFETY: see above.
unsafe impl Sync for Device {}

impl Device {
    /// The device with an index, or the first that the kernels run on.
    pub fn open(index: Option<u32>) -> Result<Arc<Self>> {
        if let Some(index) = index {
            return Self::take(index);
        }
        let mut why = None;
        for index in 0..count()? {
            match Self::take(index) {
                Ok(device) => return Ok(device),
                Err(error) => why = why.or(Some(error)),
            }
        }
        Err(why.expect("at least one GPU was tried"))
    }

    fn take(index: u32) -> Result<Arc<Self>> {
        let info = DeviceInfo::of(index)?;
        info.check()?;
        let driver = Driver::get()?;
        let handle = handle(driver, index)?;
        let mut context = std::ptr::null_mut();
        // SAFETY: `context` is written; it is released when the device is dropped.
        driver.check(unsafe { (driver.primary_ctx_retain)(&mut context, handle) }, "a context on the GPU")?;
        Ok(Arc::new(Self { driver, handle, context, info }))
    }

    /// What the driver says about it.
    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }

    /// How many processors it has, and how many bytes of its own memory each has for one block.
    pub(super) fn processors(&self) -> Result<[u32; 2]> {
        let [count, bytes] =
            [PROCESSORS, SHARED_BYTES].map(|number| attribute(self.driver, self.handle, number));
        Ok([count?, bytes?])
    }

    /// Its name.
    pub(super) fn name(&self) -> &str {
        &self.info.name
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
