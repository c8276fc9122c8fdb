//! On a GPU: small kernels one after the other, `baseline.cu`, and after each sum a number that the host waits for.

use std::sync::Arc;

use cudarc::driver::{
    CudaContext, CudaFunction, CudaSlice, CudaStream, DeviceRepr, DriverError, LaunchConfig, PushKernelArg,
};
use cudarc::nvrtc::Ptx;
use palpate::error::{Error, Result};
use palpate::math::Vec3;

use super::{Baseline, Body, ROW, Setting, Stiffness};

/// Threads of a block.
const THREADS: u32 = 256;
/// The kernels, compiled by `kernels/build.rs`.
const IMAGE: &[u8] = include_bytes!(concat!(env!("PALPATE_EFG_BASELINE"), "/baseline.fatbin"));

/// A sphere, what it pushes by, and what it felt.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
struct Tool {
    centre: [f32; 3],
    radius: f32,
    stiffness: f32,
    felt: [f32; 3],
}

// SAFETY: `repr(C)` numbers, laid out as in `baseline.cu`.
unsafe impl DeviceRepr for Tool {}
// SAFETY: see above.
unsafe impl DeviceRepr for Stiffness {}

/// A body on the first GPU.
pub struct Parallel {
    stream: Arc<CudaStream>,
    kernels: Kernels,
    elements: u32,
    nodes: u32,
    setting: Setting,
    lengths: CudaSlice<u8>,
    connectivity: CudaSlice<u32>,
    gradients: CudaSlice<f32>,
    stiffness: CudaSlice<Stiffness>,
    mass: CudaSlice<f32>,
    rest: CudaSlice<f32>,
    is_held: CudaSlice<u8>,
    u: CudaSlice<f32>,
    v: CudaSlice<f32>,
    x: CudaSlice<f32>,
    r: CudaSlice<f32>,
    p: CudaSlice<f32>,
    q: CudaSlice<f32>,
    /// r·r and p·q.
    sums: CudaSlice<f64>,
    tool: CudaSlice<Tool>,
    felt: [f32; 3],
}

struct Kernels {
    distribute: CudaFunction,
    push: CudaFunction,
    begin: CudaFunction,
    multiply: CudaFunction,
    descend: CudaFunction,
    turn: CudaFunction,
    go: CudaFunction,
}

/// As many threads as `count`, at least.
fn threads(count: u32) -> LaunchConfig {
    LaunchConfig {
        grid_dim: (count.div_ceil(THREADS), 1, 1),
        block_dim: (THREADS, 1, 1),
        shared_mem_bytes: 0,
    }
}

/// `[place][element]` of `[element][ROW]`.
fn side_by_side<T: Copy>(rows: &[T]) -> Vec<T> {
    (0..ROW).flat_map(|place| rows.iter().skip(place).step_by(ROW).copied()).collect()
}

impl Parallel {
    /// At rest. There must be a driver.
    pub fn new(body: &Body, setting: Setting) -> Result<Self> {
        Self::send(body, setting).map_err(failed)
    }

    fn send(body: &Body, setting: Setting) -> Result<Self, DriverError> {
        let context = CudaContext::new(0)?;
        let stream = context.new_stream()?;
        let module = context.load_module(Ptx::from_binary(IMAGE.to_vec()))?;
        let kernel = |name| module.load_function(name);
        let zeros = || stream.alloc_zeros::<f32>(3 * body.mass_kg.len());
        let along = |axis: usize| body.gradients.iter().map(move |gradient| gradient[axis]);
        let by_axis: [Vec<f32>; 3] = [0, 1, 2].map(|axis| side_by_side(&along(axis).collect::<Vec<_>>()));
        let elements = body.lengths.len();
        // [place][axis][element].
        let gradients: Vec<f32> = (0..ROW)
            .flat_map(|place| by_axis.iter().map(move |all| &all[place * elements..(place + 1) * elements]))
            .flatten()
            .copied()
            .collect();
        Ok(Self {
            kernels: Kernels {
                distribute: kernel("distribute")?,
                push: kernel("push")?,
                begin: kernel("begin")?,
                multiply: kernel("multiply")?,
                descend: kernel("descend")?,
                turn: kernel("turn")?,
                go: kernel("go")?,
            },
            elements: elements as u32,
            nodes: body.mass_kg.len() as u32,
            setting,
            lengths: stream.clone_htod(&body.lengths)?,
            connectivity: stream.clone_htod(&side_by_side(&body.nodes))?,
            gradients: stream.clone_htod(&gradients)?,
            stiffness: stream.clone_htod(&body.stiffness)?,
            mass: stream.clone_htod(&body.mass_kg)?,
            rest: stream.clone_htod(body.rest_m.as_flattened())?,
            is_held: stream.clone_htod(&body.is_held.iter().map(|&held| held.into()).collect::<Vec<u8>>())?,
            u: zeros()?,
            v: zeros()?,
            x: zeros()?,
            r: zeros()?,
            p: zeros()?,
            q: zeros()?,
            sums: stream.alloc_zeros(2)?,
            tool: stream.clone_htod(&[Tool::default()])?,
            felt: [0.0; 3],
            stream,
        })
    }

    /// Adds what elements answer to nodes: to the residual by where they are, or to A p.
    fn distribute(&mut self, of_step: bool) -> Result<(), DriverError> {
        let dt = self.setting.dt;
        let (factor, from, to) =
            if of_step { (-dt, &self.u, &mut self.r) } else { (dt * dt, &self.p, &mut self.q) };
        let mut launch = self.stream.launch_builder(&self.kernels.distribute);
        launch.arg(&self.elements).arg(&self.lengths).arg(&self.connectivity).arg(&self.gradients);
        launch.arg(&self.stiffness).arg(&factor).arg(from).arg(to);
        // SAFETY: the kernel's arguments, as declared.
        unsafe { launch.launch(threads(self.elements))? };
        Ok(())
    }

    /// Waits for a sum, and clears both.
    fn sum(&mut self, which: usize) -> Result<f64, DriverError> {
        let mut sums = [0.0; 2];
        self.stream.memcpy_dtoh(&self.sums, &mut sums)?;
        self.stream.memset_zeros(&mut self.sums)?;
        self.stream.synchronize()?;
        Ok(sums[which])
    }

    fn run(&mut self, centre_m: Vec3) -> Result<u32, DriverError> {
        let Setting { dt, gravity_m_s2, tolerance, radius_m, push_n_m } = self.setting;
        let mut tool = [Tool {
            centre: centre_m.map(|x| x as f32).into(),
            radius: radius_m,
            stiffness: push_n_m,
            felt: [0.0; 3],
        }];
        self.stream.memcpy_htod(&tool, &mut self.tool)?;
        let each = threads(self.nodes);
        let stream = self.stream.clone();
        // SAFETY: the kernels' arguments, as declared, here and below.
        unsafe {
            let mut launch = stream.launch_builder(&self.kernels.push);
            launch.arg(&self.nodes).arg(&self.mass).arg(&self.rest).arg(&self.u).arg(&gravity_m_s2).arg(&dt);
            launch.arg(&mut self.tool).arg(&mut self.r).launch(each)?;
        }
        self.distribute(true)?;
        // SAFETY: as above.
        unsafe {
            let mut launch = stream.launch_builder(&self.kernels.begin);
            launch.arg(&self.nodes).arg(&self.mass).arg(&self.is_held).arg(&mut self.r).arg(&mut self.x);
            launch.arg(&mut self.p).arg(&mut self.q).arg(&mut self.sums).launch(each)?;
        }
        let mut rr = self.sum(0)?;
        let enough = rr * tolerance.powi(2);
        let mut iterations = 0;
        while rr > enough {
            self.distribute(false)?;
            // SAFETY: as above.
            unsafe {
                let mut launch = stream.launch_builder(&self.kernels.multiply);
                launch.arg(&self.nodes).arg(&self.p).arg(&self.q).arg(&mut self.sums).launch(each)?;
            }
            let alpha = (rr / self.sum(1)?) as f32;
            // SAFETY: as above.
            unsafe {
                let mut launch = stream.launch_builder(&self.kernels.descend);
                launch.arg(&self.nodes).arg(&self.is_held).arg(&alpha).arg(&self.p).arg(&self.q);
                launch.arg(&mut self.x).arg(&mut self.r).arg(&mut self.sums).launch(each)?;
            }
            let left = self.sum(0)?;
            let beta = (left / rr) as f32;
            rr = left;
            // SAFETY: as above.
            unsafe {
                let mut launch = stream.launch_builder(&self.kernels.turn);
                launch.arg(&self.nodes).arg(&self.mass).arg(&beta).arg(&self.r).arg(&mut self.p);
                launch.arg(&mut self.q).launch(each)?;
            }
            iterations += 1;
        }
        // SAFETY: as above.
        unsafe {
            let mut launch = stream.launch_builder(&self.kernels.go);
            launch.arg(&self.nodes).arg(&dt).arg(&self.x).arg(&mut self.v).arg(&mut self.u).launch(each)?;
        }
        self.stream.memcpy_dtoh(&self.tool, &mut tool)?;
        self.stream.synchronize()?;
        self.felt = tool[0].felt;
        Ok(iterations)
    }
}

impl Baseline for Parallel {
    fn step(&mut self, centre_m: Vec3) -> Result<u32> {
        self.run(centre_m).map_err(failed)
    }

    fn displacements(&self) -> Result<Vec<[f32; 3]>> {
        let found = self.stream.clone_dtoh(&self.u);
        let found = found.and_then(|found| self.stream.synchronize().map(|()| found)).map_err(failed)?;
        Ok(found.chunks_exact(3).map(|node| [node[0], node[1], node[2]]).collect())
    }

    fn felt_n(&self) -> [f32; 3] {
        self.felt
    }
}

fn failed(error: DriverError) -> Error {
    Error::Device(format!("in the baseline, {error:?}"))
}
