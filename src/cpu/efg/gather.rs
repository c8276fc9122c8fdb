//! How forces of cells come together on nodes: brick by brick, eight cells of a row at a time.
//!
//! A brick's nodes are corners of its own cells, and of those that end at its first nodes. All of these are evaluated for it, in an order fixed by the model alone,
//! so that threads share nothing but what they read. Along x a run of bricks hands on what each brick's cells give to the next one's first nodes;
//! along y and z the cells between two bricks are evaluated by both.

use super::super::lanes::Lanes;
use super::super::nodes::{BRICK_OCTETS, BRICK_ROWS, Bricks, Run};
use crate::model::lattice::BRICK_SLOTS;

/// Rows of nodes that a brick's cells touch along y, and along z: from one before the brick to one behind it.
const SIDE: usize = 6;
const ROWS: usize = SIDE * SIDE;

/// A vector, or what else nodes hold, at the ends of eight cells' edges along x.
pub type Edge<L, const N: usize> = [[L; N]; 2];
/// At the eight corners of eight cells: the edges at (y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1).
pub type Corners<L, const N: usize> = [Edge<L, N>; 4];

/// Eight cells: a row of a brick.
#[derive(Clone, Copy, Debug)]
pub struct CellRow {
    pub brick: usize,
    pub row: usize,
}

impl CellRow {
    /// Where the first number of these cells lies among octets of which every brick has `numbers` for each of its rows; others follow at distances of
    /// [`BRICK_ROWS`].
    #[inline(always)]
    pub fn at(self, numbers: usize) -> usize {
        self.brick * numbers * BRICK_ROWS + self.row
    }
}

/// Where nodes' vectors are read.
pub trait Source<L: Lanes> {
    /// Eight numbers: an octet of a [`Field`](super::super::nodes::Field).
    ///
    /// # Safety
    /// The octet exists and nobody writes it.
    unsafe fn load(&self, octet: usize) -> L;
}

/// What cells give to their corners.
pub trait Law<L: Lanes, const N: usize> {
    /// For eight cells of these materials whose corners hold `u`.
    ///
    /// # Safety
    /// The row exists and nobody writes what is known of its cells.
    unsafe fn give(&self, row: CellRow, materials: &[u8; 8], u: &Corners<L, 3>) -> Corners<L, N>;
}

/// Materials of a row of cells.
#[inline(always)]
pub fn materials(bricks: &Bricks, row: CellRow) -> &[u8; 8] {
    let at = row.brick * BRICK_SLOTS + row.row * 8;
    bricks.cells[at..at + 8].try_into().expect("a row has eight cells")
}

/// The brick and row of a staged row: its y and z count from one before the brick.
#[inline(always)]
fn place(around: &[u32; 27], x: usize, y: usize, z: usize) -> CellRow {
    let (y, z) = (y + 3, z + 3);
    CellRow { brick: around[x + 3 * (y / 4) + 9 * (z / 4)] as usize, row: z % 4 * 4 + y % 4 }
}

/// The nodes around one brick's cells.
pub struct Staged<L> {
    rows: [Edge<L, 3>; ROWS],
}

impl<L: Lanes> Staged<L> {
    /// # Safety
    /// Nobody writes what `source` reads.
    #[inline(always)]
    pub unsafe fn load(bricks: &Bricks, brick: usize, source: &impl Source<L>) -> Self {
        let around = &bricks.neighbours[brick];
        let mut staged = Self { rows: [[[L::splat(0.0); 3]; 2]; ROWS] };
        for z in 0..SIDE {
            for y in 0..SIDE {
                let (here, after) = (place(around, 1, y, z), place(around, 2, y, z));
                if bricks.rows[here.brick] >> here.row & 1 == 0
                    && bricks.rows[after.brick] >> after.row & 1 == 0
                {
                    continue;
                }
                for c in 0..3 {
                    let octet = c * BRICK_ROWS + here.row;
                    // SAFETY: octets of bricks, or of the empty one; the caller promises that nobody writes them.
                    let (low, next) = unsafe {
                        (
                            source.load(here.brick * BRICK_OCTETS + octet),
                            source.load(after.brick * BRICK_OCTETS + octet),
                        )
                    };
                    staged.rows[z * SIDE + y][0][c] = low;
                    staged.rows[z * SIDE + y][1][c] = low.shift_down(next);
                }
            }
        }
        staged
    }

    /// Those of the row of cells whose lowest corners are staged at y, z.
    #[inline(always)]
    pub fn corners(&self, y: usize, z: usize) -> Corners<L, 3> {
        let at = z * SIDE + y;
        [self.rows[at], self.rows[at + 1], self.rows[at + SIDE], self.rows[at + SIDE + 1]]
    }
}

/// What the rows of a brick receive: from cells that begin at them, and from those that begin one node before.
struct Received<L, const N: usize> {
    rows: [Edge<L, N>; BRICK_ROWS],
}

impl<L: Lanes, const N: usize> Received<L, N> {
    #[inline(always)]
    fn nothing() -> Self {
        Self { rows: [[[L::splat(0.0); N]; 2]; BRICK_ROWS] }
    }

    /// From all cells whose lowest corners have the brick's x.
    #[inline(always)]
    unsafe fn of(bricks: &Bricks, brick: usize, staged: &Staged<L>, law: &impl Law<L, N>) -> Self {
        let around = &bricks.neighbours[brick];
        let mut received = Self::nothing();
        for z in 0..SIDE - 1 {
            for y in 0..SIDE - 1 {
                let row = place(around, 1, y, z);
                let materials = materials(bricks, row);
                if u64::from_le_bytes(*materials) == 0 {
                    continue;
                }
                // SAFETY: as the caller promises.
                let given = unsafe { law.give(row, materials, &staged.corners(y, z)) };
                for (r, edge) in given.into_iter().enumerate() {
                    // Row y, z of the brick is staged at y + 1, z + 1.
                    let (y, z) = (y + (r & 1), z + (r >> 1));
                    if !(1..5).contains(&y) || !(1..5).contains(&z) {
                        continue;
                    }
                    let to = &mut received.rows[(z - 1) * 4 + y - 1];
                    for end in 0..2 {
                        for n in 0..N {
                            to[end][n] = to[end][n].add(edge[end][n]);
                        }
                    }
                }
            }
        }
        received
    }
}

/// Sums up what the nodes of a run's bricks receive from all their cells, and hands each row on: its brick, its number in it, the sum and what it holds itself.
///
/// # Safety
/// What `source` and `law` read exists, and nobody writes it meanwhile.
#[inline(always)]
pub unsafe fn gather<L: Lanes, const N: usize>(
    bricks: &Bricks,
    run: Run,
    source: &impl Source<L>,
    law: &impl Law<L, N>,
    mut finish: impl FnMut(usize, usize, [L; N], [L; 3]),
) {
    let before = bricks.neighbours[run.first][12] as usize;
    let mut last = if before < bricks.count() {
        // SAFETY: as the caller promises.
        unsafe { Received::of(bricks, before, &Staged::load(bricks, before, source), law) }
    } else {
        Received::nothing()
    };
    for brick in run.first..run.end() {
        // SAFETY: as above.
        let staged = unsafe { Staged::load(bricks, brick, source) };
        // SAFETY: as above.
        let received: Received<L, N> = unsafe { Received::of(bricks, brick, &staged, law) };
        for row in 0..BRICK_ROWS {
            if bricks.rows[brick] >> row & 1 == 0 {
                continue;
            }
            let [low, high] = received.rows[row];
            let mut sum = low;
            for n in 0..N {
                sum[n] = low[n].add(high[n].shift_up(last.rows[row][1][n]));
            }
            finish(brick, row, sum, staged.rows[(row / 4 + 1) * SIDE + row % 4 + 1][0]);
        }
        last = received;
    }
}
