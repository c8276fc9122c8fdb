//! Twins of what cuts are on the device: pieces, sides, edges, and what a cut changes.

use cudarc::driver::sys::CUdeviceptr;

/// A piece of a divided cell.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Piece {
    pub nodes: [u32; 8],
    pub material: u32,
    pub volume: f32,
}

/// Bricks on which no piece hangs, and those with no node in a row, among places of those with one.
pub const NO_PLACE: u32 = u32::MAX;

/// Pieces of divided cells.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Pieces {
    pub count: u32,
    pub all: CUdeviceptr,
    pub given: CUdeviceptr,
    pub starts: CUdeviceptr,
    pub hung: CUdeviceptr,
    pub kg: CUdeviceptr,
}

/// Two pieces face to face across a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Facing {
    pub nodes: [[u32; 8]; 2],
    pub weights: [f64; 8],
    pub inverse_kg: [[f64; 8]; 2],
    pub normal: [f64; 3],
}

/// The sides of cuts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(C)]
pub struct Sides {
    pub all: CUdeviceptr,
    pub cells: CUdeviceptr,
    pub classes: CUdeviceptr,
}

/// A point of a blade's edge in tissue.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Stuck {
    pub nodes: [u32; 8],
    pub weights: [f64; 8],
    pub inverse_kg: [f64; 8],
    pub limit: f64,
    pub at: [f32; 3],
    pub along: [f32; 3],
    pub tool: u32,
}

/// What happens to one in a substep.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Pull {
    pub by: [[f64; 3]; 8],
    pub u: [[f64; 3]; 8],
    pub v: [[f64; 3]; 8],
    pub arm: [f64; 3],
    pub along: [f64; 3],
    pub goes: [f64; 3],
    pub gives: f64,
    pub impulse: [f64; 3],
}

/// What one does inside an implicit step.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct EdgePoint {
    pub along: [f64; 3],
    pub velocity: [f64; 3],
    pub stiffness: f64,
    pub most: f64,
    pub impulse: [f64; 3],
    pub next: [f64; 3],
    pub moving: [f64; 3],
    pub answer: [f64; 3],
    pub sticks: u32,
    pub next_sticks: u32,
}

/// A node that carries points of edges.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct EdgeCarrier {
    pub slot: u32,
    pub start: u32,
    pub count: u32,
}

/// A point that a node carries.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct EdgeLoad {
    pub weight: f64,
    pub point: u32,
}

/// All of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(C)]
pub struct Sticks {
    pub all: CUdeviceptr,
    pub pulls: CUdeviceptr,
    pub count: CUdeviceptr,
    pub sums: CUdeviceptr,
    pub points: CUdeviceptr,
    pub carriers: CUdeviceptr,
    pub carrier_count: CUdeviceptr,
    pub loads: CUdeviceptr,
    pub carrier_at: CUdeviceptr,
    pub substeps: u32,
    pub begins: u32,
}

/// A node that a cut has made, and the one that it was.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Birth {
    pub slot: u32,
    pub from: u32,
}

/// A node that has other whole cells around it.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Reworded {
    pub slot: u32,
    pub word: u32,
}

/// A row that is turned as another one, or as the cell that starts at a slot.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Turned {
    pub row: u32,
    pub from: u32,
    pub is_row: u32,
}

/// What a cut changes of the nodes.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Cut {
    pub births: u32,
    pub words: u32,
    pub turns: u32,
    pub born: CUdeviceptr,
    pub reworded: CUdeviceptr,
    pub turned: CUdeviceptr,
    pub u: [CUdeviceptr; 2],
    pub vectors: [CUdeviceptr; 2],
    pub rotations: CUdeviceptr,
    pub row_rotations: CUdeviceptr,
}
