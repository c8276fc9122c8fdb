//! Twins of the meshless model.

use std::mem::offset_of;

use cudarc::driver::sys::CUdeviceptr;

use super::Step;
use crate::model::efg::law::HOURGLASS;
use crate::model::law::CellLaw;

/// What meshless cells of one material resist by: μ, λ and the stiffness of an hourglass.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct EfgLaw {
    pub(super) forces: [f64; 3],
    pub(super) changes: [f64; 3],
}

impl EfgLaw {
    /// Of cells of edge length `h`; `factor` is what a step makes of them.
    pub fn of(law: &CellLaw, h: f64, factor: f64) -> Self {
        let forces = [law.shear_pa, law.lambda_pa, HOURGLASS * law.shear_pa * h];
        Self { forces, changes: forces.map(|modulus| modulus * factor) }
    }
}

/// What is new in each implicit step. Model frame, SI units. The device reads as many tools as there are.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct EfgStep {
    pub dt: f64,
    pub inertia: f64,
    pub gravity: [f64; 3],
    pub tolerance: f64,
    pub furthest: f64,
    pub wall: f64,
    pub from: f32,
    pub to: f32,
    pub reach: f32,
    pub max_iterations: u32,
    pub elasticity: u32,
    pub is_paper: u32,
    pub only_forces: u32,
    pub substep: u32,
    pub step: Step,
}

impl EfgStep {
    /// Those that a step with so many tools needs.
    pub fn bytes(tools: usize) -> usize {
        offset_of!(Self, step) + Step::bytes(tools)
    }
}

/// How many numbers of each node a field has.
pub mod numbers {
    pub const VECTOR: usize = 3;
    pub const BLOCK: usize = 6;
    pub const ROTATION: usize = 4;
    pub const FRAME: usize = 9;
}

/// How many numbers contact keeps of each of its points.
pub const PRESS_FIELDS: usize = 12;
/// Most numbers that blocks sum up at once.
pub const GRID_NUMBERS: usize = 4;

/// Bytes that a block of the step's kernel shares, by those of a number, and those that each of its teams adds.
pub const fn efg_block_bytes(number: usize) -> usize {
    GRID_NUMBERS * 33 * 8 + 96 * number
}
pub const fn efg_team_bytes(number: usize) -> usize {
    3780 * number
}

/// The meshless state and its system.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Efg {
    pub bricks: u32,
    pub starts: u32,
    pub row_count: u32,
    pub is_followed: u32,
    pub cell: f64,
    pub step: CUdeviceptr,
    pub laws: CUdeviceptr,
    pub neighbours: CUdeviceptr,
    pub flags: CUdeviceptr,
    pub cells: CUdeviceptr,
    pub shown: CUdeviceptr,
    pub mass: CUdeviceptr,
    pub heavy: CUdeviceptr,
    pub inverse: CUdeviceptr,
    pub rotations: CUdeviceptr,
    pub frames: CUdeviceptr,
    pub u: CUdeviceptr,
    pub v: CUdeviceptr,
    pub x: CUdeviceptr,
    pub b: CUdeviceptr,
    pub r: CUdeviceptr,
    pub z: CUdeviceptr,
    pub p: CUdeviceptr,
    pub w: CUdeviceptr,
    pub s: CUdeviceptr,
    pub ax: CUdeviceptr,
    pub touched: CUdeviceptr,
    pub shares: CUdeviceptr,
    pub press: CUdeviceptr,
    pub meetings: CUdeviceptr,
    pub arrived: CUdeviceptr,
    pub partials: CUdeviceptr,
    pub seen: CUdeviceptr,
    pub is_settled: CUdeviceptr,
    pub near_tools: CUdeviceptr,
    pub started: CUdeviceptr,
    pub row_cells: CUdeviceptr,
    pub row_entries: CUdeviceptr,
    pub row_bricks: CUdeviceptr,
    pub row_starts: CUdeviceptr,
    pub row_places: CUdeviceptr,
    pub row_rotations: CUdeviceptr,
    pub row_frames: CUdeviceptr,
    pub row_given: CUdeviceptr,
    pub report: CUdeviceptr,
}
