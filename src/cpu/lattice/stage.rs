//! Staging: a brick and its halo, from the fields to scratch rows.

use super::super::lanes::{Lanes, Octet, Real};
use super::super::nodes::{BRICK_OCTETS, BRICK_ROWS, Run};
use super::{Pass, ROWS, SIDE, Scratch, Window};
use crate::model::lattice::BRICK_SLOTS;

/// A brick before, at or after this one along y or z: the staged rows that lie in it, and which of its rows the first of them is.
#[derive(Clone, Copy)]
struct Side {
    start: usize,
    end: usize,
    first: usize,
}
const SIDES: [Side; 3] = [
    Side { start: 0, end: 1, first: 3 },
    Side { start: 1, end: 5, first: 0 },
    Side { start: 5, end: 6, first: 0 },
];

/// Place among the 27 bricks around one.
const fn place(x: usize, y: usize, z: usize) -> usize {
    x + 3 * y + 9 * z
}

/// Which staged rows hold a node, a bit for each: in the brick itself, and in those before and after it along x.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    pub before: u64,
    pub here: u64,
    pub after: u64,
}

impl Held {
    /// Around a brick.
    #[inline(always)]
    pub fn new<R>(pass: &Pass<R>, brick: usize) -> Self {
        let [before, here, after] = [0, 1, 2].map(|x| held_rows(pass, brick, x));
        Self { before, here, after }
    }

    /// Around the next brick along x.
    #[inline(always)]
    pub fn move_on<R>(&mut self, pass: &Pass<R>, brick: usize) {
        *self = Self { before: self.here, here: self.after, after: held_rows(pass, brick, 2) };
    }

    /// In any of the three.
    #[inline(always)]
    pub fn around(self) -> u64 {
        self.before | self.here | self.after
    }
}

/// Which staged rows hold a node in the column of bricks `x` around one.
#[inline(always)]
fn held_rows<R>(pass: &Pass<R>, brick: usize, x: usize) -> u64 {
    let mut held = 0;
    for (bz, along_z) in SIDES.into_iter().enumerate() {
        for (by, along_y) in SIDES.into_iter().enumerate() {
            let rows = u64::from(pass.bricks.rows[pass.bricks.neighbours[brick][place(x, by, bz)] as usize]);
            let wanted = (1 << (along_y.end - along_y.start)) - 1;
            for z in along_z.start..along_z.end {
                let row = (z - along_z.start + along_z.first) * 4 + along_y.first;
                held |= (rows >> row & wanted) << (z * SIDE + along_y.start);
            }
        }
    }
    held
}

/// A staged row and where it comes from.
#[derive(Clone, Copy)]
struct Source {
    /// The row of its brick.
    row: usize,
    /// Place of its brick, and of the bricks before and behind that along x, among those around the one that is staged.
    before: usize,
    here: usize,
    after: usize,
}

/// For each staged row.
const SOURCES: [Source; ROWS] = {
    let mut sources = [Source { row: 0, before: 0, here: 0, after: 0 }; ROWS];
    let mut staged = 0;
    while staged < ROWS {
        // Rows -1, 0 to 3 and 4 of the brick along y, and so along z.
        let (y, z) = (staged % SIDE + 3, staged / SIDE + 3);
        let place = 3 * (y / 4) + 9 * (z / 4);
        sources[staged] = Source { row: z % 4 * 4 + y % 4, before: place, here: place + 1, after: place + 2 };
        staged += 1;
    }
    sources
};

/// Whether a staged row is the lowest of any cell that is looked at.
const fn has_cells(staged: usize) -> bool {
    staged % SIDE < SIDE - 1 && staged / SIDE < SIDE - 1
}

/// Puts what lies before the run's first brick where [`stage`] expects to find the end of the brick before.
#[inline(always)]
pub(super) unsafe fn enter<L: Lanes, const VOLUME: bool, const DAMPED: bool>(
    pass: &Pass<L::Real>,
    brick: usize,
    s: &mut Scratch<L::Real>,
) {
    let around = &pass.bricks.neighbours[brick];
    for (staged, (to, from)) in s.rows.iter_mut().zip(&SOURCES).enumerate() {
        let before = around[from.before] as usize;
        let octet = before * BRICK_OCTETS + from.row;
        for comp in 0..3 {
            // SAFETY: octets of a brick, or of the empty one; nobody writes `u` during a substep, nor `v` where springs are damped.
            unsafe {
                to.u[comp].set_last((*pass.u.add(octet + comp * BRICK_ROWS)).0[7]);
                if DAMPED {
                    to.v[comp].set_last((*pass.v.add(octet + comp * BRICK_ROWS)).0[7]);
                }
            }
        }
        if has_cells(staged) {
            let material = usize::from(pass.bricks.cells[before * BRICK_SLOTS + from.row * 8 + 7] & 15);
            to.spring.set_last(pass.laws.spring[material]);
            to.corner.set_last(pass.laws.corner[material]);
            if VOLUME {
                to.volume.set_last(pass.laws.volume[material]);
            }
            if DAMPED {
                to.damper.set_last(pass.laws.damper[material]);
            }
        }
    }
}

/// Copies a brick and its halo into scratch rows, which hold the brick before it.
#[inline(always)]
pub(super) unsafe fn stage<L: Lanes, const VOLUME: bool, const DAMPED: bool>(
    pass: &Pass<L::Real>,
    brick: usize,
    s: &mut Scratch<L::Real>,
) {
    let around = &pass.bricks.neighbours[brick];
    for (staged, (to, from)) in s.rows.iter_mut().zip(&SOURCES).enumerate() {
        let (here, after) = (around[from.here] as usize, around[from.after] as usize);
        // SAFETY: octets and slots of a brick, or of the empty one; nobody writes `u` during a substep, nor `v` where springs are damped.
        unsafe {
            for comp in 0..3 {
                let octet = comp * BRICK_ROWS + from.row;
                let (octet, next) = (here * BRICK_OCTETS + octet, after * BRICK_OCTETS + octet);
                bring::<L>(&mut to.u[comp], pass.u.add(octet), pass.u.add(next));
                if DAMPED {
                    bring::<L>(&mut to.v[comp], pass.v.add(octet), pass.v.add(next));
                }
            }
            if has_cells(staged) {
                let cells: &[u8; 8] =
                    &*pass.bricks.cells.as_ptr().add(here * BRICK_SLOTS + from.row * 8).cast();
                look_up::<L>(&mut to.spring, &pass.laws.spring, cells);
                look_up::<L>(&mut to.corner, &pass.laws.corner, cells);
                if VOLUME {
                    look_up::<L>(&mut to.volume, &pass.laws.volume, cells);
                }
                if DAMPED {
                    look_up::<L>(&mut to.damper, &pass.laws.damper, cells);
                }
            }
        }
    }
}

/// Moves a window on to what a table says of eight cells.
#[inline(always)]
fn look_up<L: Lanes>(window: &mut Window<L::Real>, table: &[L::Real; 16], cells: &[u8; 8]) {
    window.pass_last();
    window.put(L::look_up(table, cells));
}

/// Moves a window on to a row and the number behind it.
#[inline(always)]
unsafe fn bring<L: Lanes>(
    window: &mut Window<L::Real>,
    row: *const Octet<L::Real>,
    next: *const Octet<L::Real>,
) {
    window.pass_last();
    // SAFETY: the caller's rows exist and nobody writes them.
    unsafe {
        window.put(L::load(row.cast()));
        window.0[Window::<L::Real>::FIRST + 8] = *next.cast();
    }
}

/// Asks for memory that will be needed two bricks further on and that nobody has read yet: the brick itself, and the sides of those that
/// follow along y and z.
#[inline(always)]
pub(super) fn fetch<R: Real>(pass: &Pass<R>, run: Run, next: Option<Run>, brick: usize) {
    /// How many bricks ahead.
    const AHEAD: usize = 2;
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_ET0, _MM_HINT_T0, _mm_prefetch};
        /// Octets in 64 bytes.
        const fn line<R>() -> usize {
            if size_of::<R>() == 4 { 2 } else { 1 }
        }
        let wanted = brick + AHEAD;
        let wanted = match next {
            _ if wanted < run.end() => wanted,
            Some(next) if wanted - run.end() < next.bricks => next.first + wanted - run.end(),
            _ => return,
        };
        let around = &pass.bricks.neighbours[wanted];
        let octet = |brick: usize, comp: usize, row: usize| brick * BRICK_OCTETS + comp * BRICK_ROWS + row;
        for at in (0..BRICK_OCTETS).step_by(line::<R>()) {
            // SAFETY: a prefetch changes nothing that the program can see; the octets exist.
            unsafe {
                _mm_prefetch::<_MM_HINT_T0>(pass.u.add(octet(wanted, 0, 0) + at).cast());
                _mm_prefetch::<_MM_HINT_T0>(pass.v.add(octet(wanted, 0, 0) + at).cast());
                _mm_prefetch::<_MM_HINT_ET0>(pass.u_next.add(octet(wanted, 0, 0) + at).cast());
            }
        }
        let (above, behind) = (around[place(1, 1, 2)] as usize, around[place(1, 2, 1)] as usize);
        for comp in 0..3 {
            for row in (0..4).step_by(line::<R>()) {
                // SAFETY: as above.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(pass.u.add(octet(above, comp, row)).cast()) };
            }
            for row in [0, 4, 8, 12] {
                // SAFETY: as above.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(pass.u.add(octet(behind, comp, row)).cast()) };
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (pass, run, next, brick, AHEAD);
}
