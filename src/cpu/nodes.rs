//! State of the nodes and what the kernel must know about their bricks, in memory order.

use std::collections::HashMap;
use std::sync::Arc;

use super::lanes::{Octet, Real};
use crate::cut::topology::{Change, Topology};
use crate::math::Vec3;
use crate::model::Model;
use crate::model::lattice::{BRICK, BRICK_SLOTS, flag};

/// Rows of eight nodes in a brick.
pub const BRICK_ROWS: usize = BRICK[1] * BRICK[2];
/// Octets of a vector field in a brick: x of all rows, then y, then z.
pub const BRICK_OCTETS: usize = 3 * BRICK_ROWS;

/// A vector for each slot: `[brick][component][row]` octets. Behind the last brick lies one of zeros, which stands for every brick that is
/// not there.
#[derive(Clone, Debug)]
pub struct Field<R>(pub Vec<Octet<R>>);

impl<R: Real> Field<R> {
    /// All zero.
    pub fn zeros(bricks: usize) -> Self {
        Self(vec![Octet::default(); (bricks + 1) * BRICK_OCTETS])
    }

    /// Index of the x component of a slot among single numbers; y and z follow at distances of [`BRICK_SLOTS`].
    fn index(slot: u32) -> usize {
        let (brick, local) = (slot as usize / BRICK_SLOTS, slot as usize % BRICK_SLOTS);
        brick * 3 * BRICK_SLOTS + local
    }

    fn numbers(&self) -> &[R] {
        self.0.as_slice().as_flattened_numbers()
    }

    /// The vector of a slot.
    #[inline]
    pub fn get(&self, slot: u32) -> [R; 3] {
        let at = Self::index(slot);
        let numbers = &self.numbers()[at..=at + 2 * BRICK_SLOTS];
        [numbers[0], numbers[BRICK_SLOTS], numbers[2 * BRICK_SLOTS]]
    }

    /// The vector of a slot, in double precision.
    #[inline]
    pub fn vec3(&self, slot: u32) -> Vec3 {
        let [x, y, z] = self.get(slot);
        Vec3::new(x.to_f64(), y.to_f64(), z.to_f64())
    }

    /// Replaces the vector of a slot, rounding it.
    #[inline]
    pub fn set(&mut self, slot: u32, value: Vec3) {
        let at = Self::index(slot);
        for axis in 0..3 {
            let number = at + axis * BRICK_SLOTS;
            self.0[number / 8].0[number % 8] = R::splat(value[axis]);
        }
    }
}

/// A slice of octets as single numbers.
trait Flattened<R> {
    fn as_flattened_numbers(&self) -> &[R];
}

impl<R: Real> Flattened<R> for [Octet<R>] {
    fn as_flattened_numbers(&self) -> &[R] {
        const { assert!(size_of::<Octet<R>>() == 8 * size_of::<R>()) };
        // SAFETY: an octet is eight numbers and, as just asserted, nothing else.
        unsafe { std::slice::from_raw_parts(self.as_ptr().cast(), 8 * self.len()) }
    }
}

/// What a node does, at one instant. Displacements live twice, so that a substep reads one copy and writes the other.
#[derive(Clone, Debug)]
pub struct Nodes<R> {
    /// Displacement in m.
    pub u: Field<R>,
    /// The copy that the next substep writes.
    pub u_next: Field<R>,
    /// Velocity in m/s, half a substep behind `u`.
    pub v: Field<R>,
    /// The copy that the next substep writes; `None` where no spring is damped, for then nobody reads a neighbour's velocity.
    pub v_next: Option<Field<R>>,
}

impl<R: Real> Nodes<R> {
    /// At rest.
    pub fn at_rest(bricks: usize, damped: bool) -> Self {
        let zeros = || Field::zeros(bricks);
        Self { u: zeros(), u_next: zeros(), v: zeros(), v_next: damped.then(zeros) }
    }

    /// Where springs are damped, those of the last substep are kept while new ones are written.
    pub fn keep_velocities(&mut self, damped: bool) {
        if damped && self.v_next.is_none() {
            self.v_next = Some(self.v.clone());
        }
    }

    /// What was written becomes current.
    pub fn swap(&mut self) {
        std::mem::swap(&mut self.u, &mut self.u_next);
        if let Some(v_next) = &mut self.v_next {
            std::mem::swap(&mut self.v, v_next);
        }
    }
}

/// The bricks of a model as the kernel walks them, and behind them loose ones, which hold the copies of nodes that cuts make and touch no other brick.
#[derive(Debug)]
pub struct Bricks {
    /// The model whose bricks these are.
    pub model: Arc<Model>,
    /// The 27 bricks around each, x fastest, itself at 13; [`Self::count`], an empty brick, where there is none.
    pub neighbours: Vec<[u32; 27]>,
    /// Bit `row` is set where that row of a brick holds a node. The empty brick is the last.
    pub rows: Vec<u16>,
    /// Material of the cell whose lowest corner is in each slot: what the kernel needs of the words, in a quarter of the memory. The empty
    /// brick is the last.
    pub cells: Vec<u8>,
    /// Once cells were divided.
    cut: Option<Cut>,
}

/// What nodes weigh where cells were divided.
#[derive(Debug)]
struct Cut {
    /// [`Lattice::words`] without the divided cells.
    words: Vec<u32>,
    /// For nodes of pieces: materials, and how many corners of whole cells of it the pieces weigh as much as.
    shares: HashMap<u32, Vec<(u8, f64)>>,
}

impl Bricks {
    /// Neighbours and row masks of a model's bricks, and so many loose ones.
    pub fn new(model: Arc<Model>, loose: usize) -> Self {
        let lattice = model.lattice();
        let own = lattice.bricks().len() as u32;
        let count = own + loose as u32;
        // The empty brick comes behind the loose ones.
        let at_home = |around: [u32; 27]| around.map(|brick| if brick == own { count } else { brick });
        let alone = |brick: u32| std::array::from_fn(|n| if n == 13 { brick } else { count });
        let neighbours = lattice.surroundings().map(at_home).chain((own..count).map(alone)).collect();
        let rows = lattice
            .words()
            .chunks_exact(BRICK_SLOTS)
            .map(|brick| {
                let holds = |row: &[u32]| row.iter().any(|&word| word != 0);
                brick.chunks_exact(8).enumerate().fold(0, |mask, (r, row)| mask | u16::from(holds(row)) << r)
            })
            .chain(std::iter::repeat_n(0, loose + 1))
            .collect();
        let empty = std::iter::repeat_n(0, (loose + 1) * BRICK_SLOTS);
        let cells = lattice.words().iter().map(|word| (word >> 28) as u8).chain(empty).collect();
        Self { neighbours, rows, cells, model, cut: None }
    }

    /// Number of bricks.
    pub fn count(&self) -> usize {
        self.neighbours.len()
    }

    /// Flags of all slots at first; those without a node are held.
    pub fn flags(&self) -> Vec<u8> {
        let mut flags = self.model.lattice().flags().to_vec();
        flags.resize(self.slot_count(), flag::FIX_ALL);
        flags
    }

    /// Number of slots: 128 for each brick.
    pub fn slot_count(&self) -> usize {
        self.count() * BRICK_SLOTS
    }

    /// Notes that a slot of a loose brick holds a node.
    pub fn hold(&mut self, slot: u32) {
        let (brick, local) = (slot as usize / BRICK_SLOTS, slot as usize % BRICK_SLOTS);
        self.rows[brick] |= 1 << (local / 8);
    }

    /// Makes all cells whole again.
    pub fn heal(&mut self) {
        let loose = self.count() - self.model.lattice().bricks().len();
        *self = Self::new(self.model.clone(), loose);
    }

    /// Divides and removes cells: they are no brick's own any more, and nodes weigh what is left of all pieces.
    pub fn divide(&mut self, topology: &Topology, change: &Change) {
        for birth in &change.births {
            self.hold(birth.slot);
        }
        let lattice = self.model.lattice();
        let cut =
            self.cut.get_or_insert_with(|| Cut { words: lattice.words().to_vec(), shares: HashMap::new() });
        for cell in change.reshaped() {
            self.cells[cell as usize] = 0;
            for (corner, slot) in lattice.corners(lattice.node_of(cell)).into_iter().enumerate() {
                cut.words[slot as usize] &= !(15 << (4 * (7 - corner)));
            }
        }
        for slot in topology.nodes_of(lattice, change) {
            cut.shares.insert(slot, topology.hung_on(lattice, slot));
        }
    }

    /// Materials of the whole cells around the node in a slot, as in [`Lattice::words`](crate::model::lattice::Lattice::words); 0 for copies.
    pub fn word(&self, slot: u32) -> u32 {
        let words = self.cut.as_ref().map_or_else(|| self.model.lattice().words(), |cut| &cut.words);
        words.get(slot as usize).copied().unwrap_or_default()
    }

    /// What those weigh at it, given the corner mass of each material.
    pub fn whole_mass(&self, slot: u32, corner_kg: impl Fn(u8) -> f64) -> f64 {
        let word = self.word(slot);
        (0..8).map(|c| (word >> (4 * c) & 15) as u8).filter(|&m| m != 0).map(corner_kg).sum()
    }

    /// Mass of the node in a slot, given the corner mass of each material.
    pub fn node_mass(&self, slot: u32, corner_kg: impl Fn(u8) -> f64) -> f64 {
        let pieces = self.cut.as_ref().and_then(|cut| cut.shares.get(&slot)).into_iter().flatten();
        self.whole_mass(slot, &corner_kg)
            + pieces.map(|&(material, share)| corner_kg(material) * share).sum::<f64>()
    }

    /// The bricks around one that are there, itself among them.
    pub fn around(&self, brick: usize) -> impl Iterator<Item = usize> {
        self.neighbours[brick].iter().map(|&near| near as usize).filter(|&near| near < self.count())
    }

    /// Lists rows of consecutive bricks along x that satisfy `wanted`, none longer than `longest`.
    pub fn list_runs(&self, longest: usize, wanted: impl Fn(usize) -> bool, runs: &mut Vec<Run>) {
        runs.clear();
        for brick in (0..self.count()).filter(|&b| wanted(b)) {
            match runs.last_mut() {
                Some(run)
                    if run.end() == brick
                        && run.bricks < longest
                        && self.neighbours[brick][12] as usize == brick - 1 =>
                {
                    run.bricks += 1;
                }
                _ => runs.push(Run { first: brick, bricks: 1 }),
            }
        }
    }
}

/// Consecutive bricks along x.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// The first brick.
    pub first: usize,
    /// How many.
    pub bricks: usize,
}

impl Run {
    /// One past the last brick.
    pub fn end(&self) -> usize {
        self.first + self.bricks
    }
}
