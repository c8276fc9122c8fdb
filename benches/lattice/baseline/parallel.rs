//! Algorithm 3, "extended CUDA implementation", with the arrays of the paper's section 4.5; the kernel is `baseline.cu`.
//!
//! One thread for each mass. Positions are four floats, of this and of the last step; for each of 26 neighbours a mass has that one's index and
//! the spring's rest length; each mass has flags and a material, each material one stiffness. Damping and gravity are in the force (equation 4),
//! the vector of gravity being 0, for the rest shape is in balance with it. The tool is a sphere: masses in it are displaced to its surface, and
//! the spring forces on them are summed, which is what it feels. Its way is written before a graph of [`STEPS`] steps, the sum read after it.
//!
//! Beyond the paper: a mass may be held, as the model says. All others are active. In favour of the baseline, held masses compute nothing; the
//! spring data lie neighbour by neighbour, so that threads read side by side; and the barriers in lines 4 and 21, which were to help memory of
//! that time, are left out.

use std::sync::Arc;

use cudarc::driver::sys::{CUgraphInstantiate_flags, CUstreamCaptureMode};
use cudarc::driver::{
    CudaContext, CudaFunction, CudaGraph, CudaSlice, CudaStream, DeviceRepr, DriverError, LaunchConfig,
    PushKernelArg,
};
use cudarc::nvrtc::Ptx;
use palpate::error::{Error, Result};
use palpate::math::Vec3;

use super::Baseline;
use super::masses::{Masses, offsets};

/// Steps of one graph; even, so that it ends in the buffer that it starts in.
pub const STEPS: u32 = 100;
/// Threads of a block, as in the paper.
const THREADS: u32 = 256;
/// The kernel, compiled by `kernels/build.rs`.
const IMAGE: &[u8] = include_bytes!(concat!(env!("PALPATE_BASELINE"), "/baseline.fatbin"));

/// Flags of a mass, and where its material is.
const ACTIVE: u32 = 1;
const HELD: u32 = 2;
const MATERIAL_SHIFT: u32 = 8;
/// "No mass there".
pub const NO_MASS: u32 = u32::MAX;

/// Spring data.
#[repr(C, align(8))]
#[derive(Clone, Copy, Debug)]
pub struct Spring {
    /// The neighbour, or [`NO_MASS`].
    pub other: u32,
    /// Rest length in m.
    pub rest_m: f32,
}

/// A sphere, centre and radius, at the start of a graph, its way in a step, in m, and the sum of forces that it felt.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
struct Tool {
    sphere: [f32; 4],
    way: [f32; 4],
    felt: [f32; 4],
}

/// What all masses share.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
struct Setting {
    masses: u32,
    dt: f32,
    damping: f32,
    gravity: [f32; 3],
}

// SAFETY: `repr(C)` numbers, laid out as in `baseline.cu`.
unsafe impl DeviceRepr for Spring {}
// SAFETY: see above.
unsafe impl DeviceRepr for Tool {}
// SAFETY: see above.
unsafe impl DeviceRepr for Setting {}

/// A sphere that moves as it is told.
pub struct Sphere {
    /// In m.
    pub radius_m: f64,
    /// Where its centre is at a time in s, model frame.
    pub centre_m: Box<dyn Fn(f64) -> Vec3>,
}

/// A mass–spring system on the GPU, as the paper lays it out.
pub struct Parallel {
    stream: Arc<CudaStream>,
    graph: CudaGraph,
    positions: [CudaSlice<[f32; 4]>; 2],
    tool: CudaSlice<Tool>,
    sphere: Sphere,
    felt: [f32; 4],
    time_s: f64,
    dt: f64,
    /// The graph runs this, and reads these.
    _kept: (CudaFunction, CudaSlice<Spring>, CudaSlice<u32>, CudaSlice<f32>),
}

impl Parallel {
    /// The masses at the start on the first GPU, with a step of `dt` seconds, damping in 1/s and a tool. There must be a driver.
    pub fn new(masses: &Masses, dt: f64, damping_per_s: f64, sphere: Sphere) -> Result<Self> {
        let setting = Setting {
            masses: masses.count() as u32,
            dt: dt as f32,
            damping: damping_per_s as f32,
            gravity: [0.0; 3],
        };
        Self::record(masses, setting, dt, sphere).map_err(failed)
    }

    fn record(masses: &Masses, setting: Setting, dt: f64, sphere: Sphere) -> Result<Self, DriverError> {
        let context = CudaContext::new(0)?;
        // SAFETY: all work is in one stream, in order; nothing needs events, which no graph could record.
        unsafe { context.disable_event_tracking() };
        let stream = context.new_stream()?;
        let kernel = context.load_module(Ptx::from_binary(IMAGE.to_vec()))?.load_function("algorithm3")?;

        let start = masses.positions();
        let mut positions = [stream.clone_htod(&start)?, stream.clone_htod(&start)?];
        // SAFETY: every element is written below.
        let mut springs = unsafe { stream.alloc::<Spring>(26 * masses.count())? };
        for k in 0..26 {
            let first = k * masses.count();
            let mut part = springs.slice_mut(first..first + masses.count());
            stream.memcpy_htod(&springs_at(masses, k), &mut part)?;
        }
        let properties = stream.clone_htod(&properties(masses))?;
        let stiffness = stream.clone_htod(masses.stiffness())?;
        let mut tool = stream.clone_htod(&[Tool::default()])?;
        stream.synchronize()?;

        let blocks = LaunchConfig {
            grid_dim: (setting.masses.div_ceil(THREADS), 1, 1),
            block_dim: (THREADS, 1, 1),
            shared_mem_bytes: 0,
        };
        stream.begin_capture(CUstreamCaptureMode::CU_STREAM_CAPTURE_MODE_THREAD_LOCAL)?;
        for step in 1..=STEPS {
            let [now, before] = &mut positions;
            let mut launch = stream.launch_builder(&kernel);
            launch.arg(&setting).arg(&step).arg(&*now).arg(&mut *before);
            launch.arg(&springs).arg(&properties).arg(&stiffness).arg(&mut tool);
            // SAFETY: the kernel's arguments, as declared; what they point to lives as long as the graph.
            unsafe { launch.launch(blocks)? };
            positions.swap(0, 1);
        }
        let graph = stream.end_capture(CUgraphInstantiate_flags(0))?.expect("steps were recorded");
        Ok(Self {
            stream,
            graph,
            positions,
            tool,
            sphere,
            felt: [0.0; 4],
            time_s: 0.0,
            dt,
            _kept: (kernel, springs, properties, stiffness),
        })
    }

    /// Where the masses are.
    pub fn positions(&self) -> Result<Vec<[f32; 4]>> {
        let found = self.stream.clone_dtoh(&self.positions[0]);
        found.and_then(|found| self.stream.synchronize().map(|()| found)).map_err(failed)
    }

    fn run(&mut self) -> Result<(), DriverError> {
        let end_s = self.time_s + f64::from(STEPS) * self.dt;
        let [from, to] = [self.time_s, end_s].map(|time_s| (self.sphere.centre_m)(time_s));
        let numbers = |v: Vec3, last: f64| [v.x, v.y, v.z, last].map(|x| x as f32);
        let mut tool = [Tool {
            sphere: numbers(from, self.sphere.radius_m),
            way: numbers((to - from) / f64::from(STEPS), 0.0),
            felt: [0.0; 4],
        }];
        self.stream.memcpy_htod(&tool, &mut self.tool)?;
        self.graph.launch()?;
        self.stream.memcpy_dtoh(&self.tool, &mut tool)?;
        self.stream.synchronize()?;
        self.felt = tool[0].felt;
        self.time_s = end_s;
        Ok(())
    }
}

impl Baseline for Parallel {
    fn name(&self) -> &'static str {
        "etheredge-2011-algorithm-3"
    }

    fn advance(&mut self) -> Result<u32> {
        self.run().map_err(failed)?;
        Ok(STEPS)
    }

    fn check(&self) -> Result<()> {
        if !self.positions()?.iter().flatten().all(|x| x.is_finite()) {
            return Err(Error::argument("the baseline diverged"));
        }
        if self.felt[..3].iter().all(|&f| f == 0.0) {
            return Err(Error::argument("the baseline's tool touches nothing"));
        }
        Ok(())
    }
}

/// The spring data of all masses for neighbour `k`.
pub fn springs_at(masses: &Masses, k: usize) -> Vec<Spring> {
    let offset = offsets()[k];
    let spring = |mass| match masses.link(mass, offset) {
        Some(link) => Spring { other: link.other, rest_m: link.rest_m },
        None => Spring { other: NO_MASS, rest_m: 0.0 },
    };
    (0..masses.count()).map(spring).collect()
}

/// The mass data.
pub fn properties(masses: &Masses) -> Vec<u32> {
    let property = |mass| {
        let held = if masses.is_held(mass) { HELD } else { 0 };
        ACTIVE | held | u32::from(masses.material(mass)) << MATERIAL_SHIFT
    };
    (0..masses.count()).map(property).collect()
}

fn failed(error: DriverError) -> Error {
    Error::Device(format!("in the baseline, {error:?}"))
}
