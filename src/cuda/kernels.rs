//! The kernels: found in this library, loaded into a device's context.

use std::ffi::{CStr, c_void};
use std::sync::Arc;

use cudarc::driver::sys::{CUfunction, CUmodule, CUstream};

use super::contact::Room;
use super::device::Device;
use crate::error::Result;

/// Machine code for common GPUs and PTX for the rest, one image for each source file of `kernels/`.
const LATTICE: &[u8] = include_bytes!(concat!(env!("PALPATE_KERNELS"), "/lattice.fatbin"));
const NEAR: &[u8] = include_bytes!(concat!(env!("PALPATE_KERNELS"), "/near.fatbin"));
const CONTACT: &[u8] = include_bytes!(concat!(env!("PALPATE_KERNELS"), "/contact.fatbin"));
const SURFACE: &[u8] = include_bytes!(concat!(env!("PALPATE_KERNELS"), "/surface.fatbin"));
const REPORT: &[u8] = include_bytes!(concat!(env!("PALPATE_KERNELS"), "/report.fatbin"));

/// A module's functions live as long as it does.
#[derive(Debug)]
struct Module {
    device: Arc<Device>,
    handle: CUmodule,
}

impl Module {
    fn load(device: &Arc<Device>, image: &[u8]) -> Result<Self> {
        let mut handle = std::ptr::null_mut();
        let _entered = device.enter()?;
        // The driver reads 64-bit words.
        let mut aligned = vec![0_u64; image.len().div_ceil(8)];
        // SAFETY: both are at least as long as the image, and apart.
        unsafe { std::ptr::copy_nonoverlapping(image.as_ptr(), aligned.as_mut_ptr().cast(), image.len()) };
        // SAFETY: a whole fat binary; the driver copies what it needs.
        let status = unsafe { (device.driver.module_load_data)(&mut handle, aligned.as_ptr().cast()) };
        device.driver.check(status, &format!("loading the kernels on {}", device.name()))?;
        Ok(Self { device: device.clone(), handle })
    }

    /// A kernel that may use up to `shared_bytes` of shared memory beside what it declares.
    fn sharing_function(&self, name: &CStr, shared_bytes: u32) -> Result<Kernel> {
        /// CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES.
        const MAX_DYNAMIC_SHARED: i32 = 8;
        let kernel = self.function(name)?;
        let _entered = self.device.enter()?;
        // SAFETY: an own function.
        let status = unsafe {
            (self.device.driver.func_set_attribute)(kernel.0, MAX_DYNAMIC_SHARED, shared_bytes as i32)
        };
        self.device.driver.check(status, &format!("{shared_bytes} bytes of shared memory"))?;
        Ok(kernel)
    }

    fn function(&self, name: &CStr) -> Result<Kernel> {
        let mut handle = std::ptr::null_mut();
        let _entered = self.device.enter()?;
        // SAFETY: `handle` is written; the name ends.
        let status =
            unsafe { (self.device.driver.module_get_function)(&mut handle, self.handle, name.as_ptr()) };
        self.device.driver.check(status, &format!("finding the kernel {}", name.to_string_lossy()))?;
        Ok(Kernel(handle))
    }
}

impl Drop for Module {
    fn drop(&mut self) {
        if let Ok(_entered) = self.device.enter() {
            // SAFETY: an own module; its owner waits for its work first.
            unsafe { (self.device.driver.module_unload)(self.handle) };
        }
    }
}

/// One kernel.
#[derive(Clone, Copy, Debug)]
pub struct Kernel(CUfunction);

/// All kernels of a simulation.
#[derive(Debug)]
pub struct Kernels {
    /// One substep.
    pub substep: Kernel,
    /// Marks what tools may meet.
    pub contact_near: Kernel,
    /// Lists it.
    pub contact_list: Kernel,
    /// Makes sites of it.
    pub contact_sites: Kernel,
    /// Finds what sites have to do with each other.
    pub contact_couple: Kernel,
    /// Pushes the tissue out of the tools: where sites are vertices, and where they lie inside triangles.
    pub contact_vertices: Kernel,
    pub contact_centres: Kernel,
    /// Moves a surface's vertices.
    pub surface_positions: Kernel,
    /// And its normals.
    pub surface_normals: Kernel,
    /// What the host is told of a step.
    pub report: Kernel,
    _modules: [Module; 5],
}

// SAFETY: functions and modules may be used from any thread that has entered the context.
unsafe impl Send for Kernels {}

impl Kernels {
    /// Loads the kernels for a model with or without volume terms and damped springs.
    pub fn load(device: &Arc<Device>, volumetric: bool, damped: bool, room: Room) -> Result<Self> {
        let lattice = Module::load(device, LATTICE)?;
        let near = Module::load(device, NEAR)?;
        let contact = Module::load(device, CONTACT)?;
        let surface = Module::load(device, SURFACE)?;
        let report = Module::load(device, REPORT)?;
        let substep = match (volumetric, damped) {
            (false, false) => c"lattice_plain",
            (true, false) => c"lattice_volume",
            (false, true) => c"lattice_damped",
            (true, true) => c"lattice_volume_damped",
        };
        Ok(Self {
            substep: lattice.function(substep)?,
            contact_near: near.function(c"contact_near")?,
            contact_list: near.function(c"contact_list")?,
            contact_sites: near.function(c"contact_sites")?,
            contact_couple: near.function(c"contact_couple")?,
            contact_vertices: contact.sharing_function(c"contact_vertices", room.bytes())?,
            contact_centres: contact.sharing_function(c"contact_centres", room.bytes())?,
            surface_positions: surface.function(c"surface_positions")?,
            surface_normals: surface.function(c"surface_normals")?,
            report: report.function(c"report")?,
            _modules: [lattice, near, contact, surface, report],
        })
    }
}

impl Kernel {
    /// Asks a stream, whose context is current, to run the kernel.
    ///
    /// # Safety
    /// `arguments` point to values of the types that the kernel declares, and what those point to on the device outlives the work.
    pub unsafe fn launch(
        self,
        device: &Device,
        stream: CUstream,
        blocks: u32,
        threads: u32,
        shared_bytes: u32,
        arguments: &mut [*mut c_void],
    ) -> Result<()> {
        // SAFETY: as promised.
        let status = unsafe {
            (device.driver.launch_kernel)(
                self.0,
                blocks,
                1,
                1,
                threads,
                1,
                1,
                shared_bytes,
                stream,
                arguments.as_mut_ptr(),
                std::ptr::null_mut(),
            )
        };
        device.driver.check(status, "starting a kernel")
    }
}
