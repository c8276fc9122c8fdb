//! The kernels: found in this library, loaded into a device's context.

use std::borrow::Cow;
use std::ffi::{CStr, c_void};
use std::io::Read;
use std::sync::Arc;

use cudarc::driver::sys::{
    CUfunction, CUlaunchAttribute, CUlaunchAttributeID, CUlaunchAttributeValue, CUlaunchConfig, CUmodule,
    CUstream,
};
use flate2::read::ZlibDecoder;

use super::device::Device;
use super::layout::{CONTACT_SHARED_BYTES, efg_block_bytes, efg_team_bytes};
use crate::error::{Error, Result};
use crate::model::lattice::BRICK_SLOTS;

/// One source file of `kernels/`, compiled twice.
struct Image {
    /// A fat binary: machine code for common GPUs and PTX for the rest.
    fatbin: &'static [u8],
    /// PTX alone, of a version that older drivers know; compressed.
    ptx: &'static [u8],
}

macro_rules! image {
    ($name:literal) => {
        Image {
            fatbin: include_bytes!(concat!(env!("PALPATE_KERNELS"), "/", $name, ".fatbin")),
            ptx: include_bytes!(concat!(env!("OUT_DIR"), "/", $name, ".ptx.z")),
        }
    };
}

const LATTICE: Image = image!("lattice");
const PIECES: Image = image!("pieces");
const SLEEP: Image = image!("sleep");
const NEAR: Image = image!("near");
const CONTACT: Image = image!("contact");
const MOBILE: Image = image!("mobile");
const SURFACE: Image = image!("surface");
const OUTSIDE: Image = image!("outside");
const REPORT: Image = image!("report");
const EFG: Image = image!("efg");
const CUT: Image = image!("cut");
const LOOK: Image = image!("look");

/// The first CUDA version whose drivers read the fat binaries: that of the compiler that wrote them.
const READS_FATBIN: i32 = 13_000;

/// CU_FUNC_ATTRIBUTE_PTX_VERSION: ten times the compute capability that a function was compiled for.
const COMPILED_FOR: i32 = 5;
/// CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES.
const MOST_SHARED: i32 = 8;
/// From this one on, kernels wait for each other themselves where they may overlap; see `kernels/block.cuh`.
const WAITING: i32 = 90;

impl Image {
    /// What a driver of a CUDA version loads.
    fn of_version(&self, version: i32) -> Cow<'static, [u8]> {
        if version >= READS_FATBIN { self.fatbin.into() } else { self.text().into() }
    }

    /// The PTX as text.
    fn text(&self) -> Vec<u8> {
        let mut text = Vec::new();
        ZlibDecoder::new(self.ptx).read_to_end(&mut text).expect("the library holds what its build packed");
        text
    }
}

/// A module's functions live as long as it does.
#[derive(Debug)]
struct Module {
    device: Arc<Device>,
    handle: CUmodule,
}

/// CU_FUNC_ATTRIBUTE_PREFERRED_SHARED_MEMORY_CARVEOUT.
const SHARED_CARVEOUT: i32 = 9;
/// How much of a processor's own memory blocks share. The same for all kernels, for a change between two of them takes time.
const SHARED_PERCENT: i32 = 60;
/// Bytes of that which blocks of the meshless kernel take beside those that they are given.
const RESERVED_BYTES: u32 = 256;

impl Module {
    fn load(device: &Arc<Device>, image: &[u8]) -> Result<Self> {
        let mut handle = std::ptr::null_mut();
        let _entered = device.enter()?;
        // The driver reads a fat binary by 64-bit words, and text up to a zero.
        let mut aligned = vec![0_u64; image.len() / 8 + 1];
        // SAFETY: both are at least as long as the image, and apart.
        unsafe { std::ptr::copy_nonoverlapping(image.as_ptr(), aligned.as_mut_ptr().cast(), image.len()) };
        // SAFETY: a whole fat binary, or text that ends; the driver copies what it needs.
        let status = unsafe { (device.driver.module_load_data)(&mut handle, aligned.as_ptr().cast()) };
        device.driver.check(status, &format!("loading the kernels on {}", device.name()))?;
        Ok(Self { device: device.clone(), handle })
    }

    /// A kernel that waits for what came before it on its stream, if it is compiled for devices that can.
    fn overlapping_function(&self, name: &CStr) -> Result<Kernel> {
        let kernel = self.function(name)?;
        let _entered = self.device.enter()?;
        let mut compiled_for = 0;
        // SAFETY: an own function; `compiled_for` is written.
        let status = unsafe {
            (self.device.driver.func_get_attribute)(&mut compiled_for, COMPILED_FOR, kernel.function)
        };
        self.device.driver.check(status, "asking about a kernel")?;
        Ok(Kernel { overlaps: compiled_for >= WAITING, ..kernel })
    }

    fn function(&self, name: &CStr) -> Result<Kernel> {
        let mut handle = std::ptr::null_mut();
        let _entered = self.device.enter()?;
        // SAFETY: `handle` is written; the name ends.
        let status =
            unsafe { (self.device.driver.module_get_function)(&mut handle, self.handle, name.as_ptr()) };
        self.device.driver.check(status, &format!("finding the kernel {}", name.to_string_lossy()))?;
        // SAFETY: an own function.
        let status =
            unsafe { (self.device.driver.func_set_attribute)(handle, SHARED_CARVEOUT, SHARED_PERCENT) };
        self.device.driver.check(status, "dividing a processor's memory")?;
        Ok(Kernel { function: handle, overlaps: false, is_together: false, shared_bytes: 0 })
    }

    /// A kernel whose blocks are all at work at the same time, each with so many bytes to share.
    fn function_together(&self, name: &CStr, shared_bytes: u32) -> Result<Kernel> {
        Ok(Kernel { is_together: true, ..self.function(name)?.sharing(&self.device, shared_bytes)? })
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
pub struct Kernel {
    function: CUfunction,
    /// Whether it may start before what came before it on its stream has ended: it then waits itself, see `kernels/block.cuh`.
    overlaps: bool,
    /// Whether all its blocks are at work at the same time, so that they can wait for each other.
    is_together: bool,
    shared_bytes: u32,
}

/// What knows no model: which sites tools may meet, and surfaces that are shown.
#[derive(Debug)]
pub struct SurfaceKernels {
    /// Marks what tools may meet.
    pub contact_near: Kernel,
    /// Lists it.
    pub contact_list: Kernel,
    /// Makes sites of it.
    pub contact_sites: Kernel,
    /// Finds what nodes carry.
    pub contact_carry: Kernel,
    /// Finds what sites have to do with each other.
    pub contact_couple: Kernel,
    /// Moves a surface's vertices.
    pub surface_positions: Kernel,
    /// And its normals.
    pub surface_normals: Kernel,
    _modules: [Module; 2],
}

// SAFETY: functions and modules may be used from any thread that has entered the context.
unsafe impl Send for SurfaceKernels {}

/// What the host sees of nodes.
#[derive(Debug)]
pub struct LookKernels {
    /// Bounds of all bricks.
    pub look: Kernel,
    /// Nodes of some of them.
    pub show: Kernel,
    _module: Module,
}

// SAFETY: functions and modules may be used from any thread that has entered the context.
unsafe impl Send for LookKernels {}

/// All kernels of the meshless model.
#[derive(Debug)]
pub struct EfgKernels {
    /// What knows no model.
    pub surfaces: SurfaceKernels,
    /// One implicit step, and impulses after it, which end it.
    pub step: Kernel,
    pub mobile: Kernel,
    /// What a cut changes of the nodes.
    pub cut: Kernel,
    /// Its blocks and their threads.
    pub blocks: u32,
    pub threads: u32,
    _modules: [Module; 3],
}

// SAFETY: functions and modules may be used from any thread that has entered the context.
unsafe impl Send for EfgKernels {}

/// All kernels of the lattice.
#[derive(Debug)]
pub struct Kernels {
    /// What knows no model.
    pub surfaces: SurfaceKernels,
    /// One substep, of all bricks and of those that are awake.
    pub substep: Kernel,
    pub substep_awake: Kernel,
    /// Pieces of divided cells, before it; and what a cut changes of the nodes.
    pub pieces: Kernel,
    pub cut: Kernel,
    /// Who sleeps, and the list of those who do not.
    pub doze: Kernel,
    pub muster: Kernel,
    /// Impulses at the end of a substep, before contact; and that, which pushes the tissue out of the tools.
    pub mobile: Kernel,
    pub contact: Kernel,
    /// Pushes what is loaded, drives rigid regions, and carries what tools hold.
    pub push: Kernel,
    pub drive: Kernel,
    pub hold: Kernel,
    /// Whether velocities shall be cleared, and clears them.
    pub judge: Kernel,
    pub halt: Kernel,
    /// What the host is told of a step.
    pub report: Kernel,
    _modules: [Module; 8],
}

// SAFETY: functions and modules may be used from any thread that has entered the context.
unsafe impl Send for Kernels {}

impl Kernels {
    /// Loads the kernels for a model with or without volume terms and damped springs.
    pub fn load(device: &Arc<Device>, volumetric: bool, damped: bool) -> Result<Self> {
        Self::load_as(device.driver.version()?, device, volumetric, damped)
    }

    /// Loads what a driver of a CUDA version takes.
    fn load_as(version: i32, device: &Arc<Device>, volumetric: bool, damped: bool) -> Result<Self> {
        let module = |image: Image| Module::load(device, &image.of_version(version));
        let (lattice, sleep, contact) = (module(LATTICE)?, module(SLEEP)?, module(CONTACT)?);
        let (outside, report) = (module(OUTSIDE)?, module(REPORT)?);
        let (pieces, cut, mobile) = (module(PIECES)?, module(CUT)?, module(MOBILE)?);
        let [substep, substep_awake] = match (volumetric, damped) {
            (false, false) => [c"lattice_plain", c"lattice_plain_awake"],
            (true, false) => [c"lattice_volume", c"lattice_volume_awake"],
            (false, true) => [c"lattice_damped", c"lattice_damped_awake"],
            (true, true) => [c"lattice_volume_damped", c"lattice_volume_damped_awake"],
        };
        Ok(Self {
            substep: lattice.overlapping_function(substep)?,
            substep_awake: lattice.overlapping_function(substep_awake)?,
            pieces: pieces.overlapping_function(c"pieces")?,
            cut: cut.function(c"cut_single")?,
            doze: sleep.function(c"doze")?,
            muster: sleep.function(c"muster")?,
            mobile: mobile.function(c"mobile")?,
            contact: contact.overlapping_function(c"contact")?.sharing(device, CONTACT_SHARED_BYTES)?,
            push: outside.function(c"push")?,
            drive: outside.function(c"drive")?,
            hold: outside.function(c"hold")?,
            judge: outside.function(c"judge")?,
            halt: outside.function(c"halt")?,
            report: report.function(c"report")?,
            surfaces: SurfaceKernels::load(version, device)?,
            _modules: [lattice, pieces, sleep, contact, outside, report, cut, mobile],
        })
    }
}

impl SurfaceKernels {
    fn load(version: i32, device: &Arc<Device>) -> Result<Self> {
        let module = |image: Image| Module::load(device, &image.of_version(version));
        let (near, surface) = (module(NEAR)?, module(SURFACE)?);
        Ok(Self {
            contact_near: near.function(c"contact_near")?,
            contact_list: near.function(c"contact_list")?,
            contact_sites: near.function(c"contact_sites")?,
            contact_carry: near.function(c"contact_carry")?,
            contact_couple: near.function(c"contact_couple")?,
            surface_positions: surface.function(c"surface_positions")?,
            surface_normals: surface.function(c"surface_normals")?,
            _modules: [near, surface],
        })
    }
}

impl LookKernels {
    /// Loads them for nodes of a precision.
    pub fn load(device: &Arc<Device>, precision: Precision) -> Result<Self> {
        let module = Module::load(device, &LOOK.of_version(device.driver.version()?))?;
        Ok(Self {
            look: module.function(precision.look)?,
            show: module.function(precision.show)?,
            _module: module,
        })
    }
}

/// A precision in which the meshless model runs on a GPU: its kernels, and the fewest and the most teams of threads in its blocks.
#[derive(Clone, Copy, Debug)]
pub struct Precision {
    pub number_bytes: usize,
    pub kernel: &'static CStr,
    pub cut: &'static CStr,
    pub mobile: &'static CStr,
    pub look: &'static CStr,
    pub show: &'static CStr,
    pub teams: [u32; 2],
}

/// Single and double.
pub const SINGLE: Precision = Precision {
    number_bytes: 4,
    kernel: c"efg_single",
    cut: c"cut_single",
    mobile: c"mobile_single",
    look: c"look_single",
    show: c"show_single",
    teams: [4, 6],
};
pub const DOUBLE: Precision = Precision {
    number_bytes: 8,
    kernel: c"efg_double",
    cut: c"cut_double",
    mobile: c"mobile_double",
    look: c"look_double",
    show: c"show_double",
    teams: [2, 4],
};

impl Precision {
    /// Bytes that a block of so many teams is given to share.
    const fn shared_bytes(self, teams: u32) -> u32 {
        (efg_block_bytes(self.number_bytes) + teams as usize * efg_team_bytes(self.number_bytes)) as u32
    }
}

impl EfgKernels {
    /// Loads the kernels for a model of so many bricks.
    pub fn load(device: &Arc<Device>, precision: Precision, bricks: u32) -> Result<Self> {
        Self::load_as(device.driver.version()?, device, precision, bricks)
    }

    /// Loads what a driver of a CUDA version takes.
    fn load_as(version: i32, device: &Arc<Device>, precision: Precision, bricks: u32) -> Result<Self> {
        let [processors, most_bytes] = device.processors()?;
        let [fewest, most] = precision.teams;
        // As many as there is memory for.
        let teams = (fewest..=most)
            .rev()
            .find(|&teams| precision.shared_bytes(teams) + RESERVED_BYTES <= most_bytes)
            .ok_or_else(|| {
                Error::Unsupported(format!("{} has too little memory in its processors", device.name()))
            })?;
        let load = |image: Image| Module::load(device, &image.of_version(version));
        let (module, cut, mobile) = (load(EFG)?, load(CUT)?, load(MOBILE)?);
        Ok(Self {
            cut: cut.function(precision.cut)?,
            mobile: mobile.function(precision.mobile)?,
            step: module.function_together(precision.kernel, precision.shared_bytes(teams))?,
            // One beside those that work on bricks.
            blocks: processors.min(bricks + 1).max(2),
            threads: teams * BRICK_SLOTS as u32,
            surfaces: SurfaceKernels::load(version, device)?,
            _modules: [module, cut, mobile],
        })
    }
}

impl Kernel {
    /// The kernel with so many bytes for each block to share beside what it declares.
    fn sharing(self, device: &Device, shared_bytes: u32) -> Result<Self> {
        let _entered = device.enter()?;
        // SAFETY: an own function.
        let status =
            unsafe { (device.driver.func_set_attribute)(self.function, MOST_SHARED, shared_bytes as i32) };
        device.driver.check(status, "dividing a processor's memory")?;
        Ok(Self { shared_bytes, ..self })
    }

    /// Whether it may start before what came before it on its stream has ended.
    pub fn overlaps(self) -> bool {
        self.overlaps
    }

    /// The kernel where it must not start before all has ended that came before it.
    pub fn alone(self) -> Self {
        Self { overlaps: false, ..self }
    }

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
        arguments: &mut [*mut c_void],
    ) -> Result<()> {
        let (id, value) = if self.is_together {
            (CUlaunchAttributeID::CU_LAUNCH_ATTRIBUTE_COOPERATIVE, CUlaunchAttributeValue { cooperative: 1 })
        } else {
            (
                CUlaunchAttributeID::CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION,
                CUlaunchAttributeValue { programmaticStreamSerializationAllowed: 1 },
            )
        };
        let mut attribute = CUlaunchAttribute { id, pad: [0; 4], value };
        let config = CUlaunchConfig {
            gridDimX: blocks,
            gridDimY: 1,
            gridDimZ: 1,
            blockDimX: threads,
            blockDimY: 1,
            blockDimZ: 1,
            sharedMemBytes: self.shared_bytes,
            hStream: stream,
            attrs: &mut attribute,
            numAttrs: (self.overlaps || self.is_together).into(),
        };
        // SAFETY: as promised.
        let status = unsafe {
            (device.driver.launch_kernel_ex)(
                &config,
                self.function,
                arguments.as_mut_ptr(),
                std::ptr::null_mut(),
            )
        };
        device.driver.check(status, "starting a kernel")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IMAGES: [Image; 12] =
        [LATTICE, PIECES, SLEEP, NEAR, CONTACT, OUTSIDE, MOBILE, SURFACE, REPORT, EFG, CUT, LOOK];
    /// The newest driver that gets text.
    const OLDER: i32 = READS_FATBIN - 1;

    fn text_of(image: &Image) -> String {
        String::from_utf8(image.text()).expect("PTX is text")
    }

    /// Shared memory that a piece of PTX declares, in bytes.
    fn shared_bytes(ptx: &str) -> u32 {
        let sized = ptx.lines().filter_map(|line| line.trim_start().strip_prefix(".shared .align "));
        sized
            .map(|line| match line.split_once('[') {
                Some((_, count)) => count.trim_end_matches("];").parse().expect("a count of bytes"),
                None => {
                    assert!(line.contains(" .u32 "), "of what size is {line}?");
                    4
                }
            })
            .sum()
    }

    /// The kernels of an image's PTX, each with the shared memory that it declares.
    fn kernels_of(text: &str) -> Vec<(&str, u32)> {
        let (head, kernels) = text.split_once(".entry ").expect("an image holds kernels");
        let of_all = shared_bytes(head);
        let of_kernel = |kernel: &str| of_all + shared_bytes(kernel);
        kernels
            .split(".entry ")
            .map(|kernel| (kernel.split_once('(').unwrap().0, of_kernel(kernel)))
            .collect()
    }

    #[test]
    fn drivers_older_than_the_compiler_get_text_of_a_version_that_they_know() {
        for image in IMAGES {
            let text = text_of(&image);
            assert!(*image.of_version(READS_FATBIN) == *image.fatbin);
            assert!(*image.of_version(OLDER) == *text.as_bytes());
            assert!(text.lines().take(2).eq([".version 7.0", ".target sm_75"]), "{}", &text[..80]);
            assert!(!text.contains('\0'), "a zero would end it");
        }
    }

    #[test]
    fn the_oldest_gpu_has_the_shared_memory_that_kernels_want() {
        /// What a block may declare on any device.
        const MOST_DECLARED: u32 = 48 << 10;
        let texts = IMAGES.each_ref().map(text_of);
        let kernels: Vec<_> = texts.iter().flat_map(|text| kernels_of(text)).collect();
        for (kernel, declared) in &kernels {
            assert!(*declared <= MOST_DECLARED, "{kernel} declares {declared} bytes");
        }
        /// What a block may share on a device of compute capability 7.5.
        const MOST_SHARED: u32 = 64 << 10;
        let (_, declared) = kernels.iter().find(|(kernel, _)| *kernel == "contact").unwrap();
        assert!(*declared > 0, "it is found");
        assert!(*declared + CONTACT_SHARED_BYTES <= MOST_SHARED, "contact declares {declared} bytes");
        for precision in [SINGLE, DOUBLE] {
            let given = precision.shared_bytes(precision.teams[0]);
            assert!(given + RESERVED_BYTES <= MOST_SHARED, "{:?} is given {given} bytes", precision.kernel);
        }
        for (kernel, declared) in kernels.iter().filter(|(kernel, _)| kernel.starts_with("efg_")) {
            assert!(*declared <= RESERVED_BYTES, "{kernel} declares {declared} bytes");
        }
    }

    #[test]
    fn a_gpu_takes_both_images() {
        let device = match Device::open(None) {
            Ok(device) => device,
            Err(error) => {
                assert!(std::env::var_os("PALPATE_GPU").is_none(), "{error}");
                return eprintln!("SKIPPED without a GPU: a_gpu_takes_both_images ({error})");
            }
        };
        for version in [OLDER, READS_FATBIN] {
            for (volumetric, damped) in [(false, false), (true, false), (false, true), (true, true)] {
                Kernels::load_as(version, &device, volumetric, damped).unwrap();
            }
            for precision in [SINGLE, DOUBLE] {
                EfgKernels::load_as(version, &device, precision, 1).unwrap();
            }
        }
    }
}
