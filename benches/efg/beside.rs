//! The lattice of the same block, and how true both models are: their forces beside those of the block in finer cells.

use std::sync::Arc;

use palpate::error::Result;
use palpate::math::Vec3;
use palpate::model::Model;
use palpate::sim::{Sim, SimDesc};
use palpate::solver::method::{EfgDesc, Method};
use serde::Serialize;

use super::common::table::quantile;
use super::options::Options;
use super::press::{Press, block};

/// Tolerance of solutions in finer cells, and most of a step, in s.
const FINE_TOLERANCE: f64 = 1e-5;
const FINE_STEP_S: f64 = 5e-4;

/// The lattice of the same block, a step of as many substeps as are stable, and errors: the root mean square of the difference in force, over the largest force.
#[derive(Debug, Serialize)]
pub struct Beside {
    pub lattice_us_per_step: f64,
    pub lattice_least_us: f64,
    pub lattice_substeps: u32,
    pub lattice_rtf: f64,
    /// Of the meshless model, and of the lattice, against the mean of both in finer cells.
    pub error: f64,
    pub lattice_error: f64,
    /// Of each of these two against their mean: smaller errors mean nothing.
    pub reference_doubt: f64,
}

impl Beside {
    /// Presses as `desc` says, which felt `felt`.
    pub fn of(
        options: &Options,
        side: usize,
        model: &Arc<Model>,
        press: Press,
        desc: &SimDesc,
        felt: &[Vec3],
    ) -> Result<Self> {
        let lattice = SimDesc { method: Method::Lattice, sleeping: false, ..desc.clone() };
        let mut coarse = Pressed::of(model, press, &lattice, felt.len())?;

        let finer = options.finer as usize;
        let model = block(options, side * finer, options.cell / finer as f64)?;
        let parts = finer.max((desc.step_s / FINE_STEP_S).ceil() as usize);
        let step_s = desc.step_s / parts as f64;
        let efg = EfgDesc { tolerance: FINE_TOLERANCE, max_iterations: 20_000, ..EfgDesc::default() };
        let fine = [Method::Efg(efg), Method::Lattice].map(|method| {
            let desc = SimDesc { method, step_s, ..lattice.clone() };
            Pressed::of(&model, press, &desc, felt.len() * parts).map(|pressed| means(&pressed.felt, parts))
        });
        let [one, other] = fine;
        let (one, other) = (one?, other?);
        let reference: Vec<Vec3> = one.iter().zip(&other).map(|(one, other)| 0.5 * (one + other)).collect();

        let us_per_step = quantile(&mut coarse.times, 0.5);
        Ok(Self {
            lattice_us_per_step: us_per_step,
            lattice_least_us: coarse.times[0],
            lattice_substeps: coarse.substeps,
            lattice_rtf: desc.step_s * 1e6 / us_per_step,
            error: error(felt, &reference),
            lattice_error: error(&coarse.felt, &reference),
            reference_doubt: error(&one, &reference),
        })
    }
}

/// What a press took and felt.
struct Pressed {
    /// µs of each step of the second half.
    times: Vec<f64>,
    substeps: u32,
    felt: Vec<Vec3>,
}

impl Pressed {
    fn of(model: &Arc<Model>, press: Press, desc: &SimDesc, steps: usize) -> Result<Self> {
        let mut sim = Sim::new(model.clone(), desc)?;
        let mut tool = sim.add_tool(&press.tool())?;
        let (mut times, mut felt) = (Vec::new(), Vec::new());
        for step in 0..steps {
            tool.set_motion(&press.motion(step, desc.step_s))?;
            sim.step()?;
            felt.push(tool.force().wrench.force_n);
            if step > steps / 2 {
                times.push(sim.statistics().step_wall_s * 1e6);
            }
        }
        Ok(Self { times, substeps: sim.statistics().substeps_per_step, felt })
    }
}

/// Of each `count` that follow one another: a tool's force is the mean of its step's.
fn means(felt: &[Vec3], count: usize) -> Vec<Vec3> {
    felt.chunks(count).map(|chunk| chunk.iter().sum::<Vec3>() / count as f64).collect()
}

fn error(felt: &[Vec3], reference: &[Vec3]) -> f64 {
    let largest = reference.iter().map(Vec3::norm).fold(f64::MIN_POSITIVE, f64::max);
    let sum: f64 = felt.iter().zip(reference).map(|(felt, wanted)| (felt - wanted).norm_squared()).sum();
    (sum / reference.len() as f64).sqrt() / largest
}
