//! Staging: a column of octets of the run and its halo, from bricks to scratch rows.

use super::super::lanes::{Lanes, Octet, Real};
use super::super::nodes::{BRICK_OCTETS, BRICK_ROWS, Run};
use super::{Pass, SIDE, Scratch};
use crate::model::lattice::{BRICK_SLOTS, NO_BRICK};

/// For the brick before, at and after along y or z: the staged rows on it, and its first row.
const SIDES: [(usize, usize, usize); 3] = [(0, 1, 3), (1, 5, 0), (5, 6, 0)];

/// The nearest brick of the run to octet column `x`, and that column's place beside it (0, 1, 2).
#[inline(always)]
fn near(run: Run, x: usize) -> (usize, usize) {
    let near = (run.first + x).clamp(run.first + 1, run.end()) - 1;
    (near, run.first + x - near)
}

/// Asks for memory that a column will need and nobody has read yet: the brick itself, and the sides of those that follow along y and z.
#[inline(always)]
pub(super) fn fetch<R: Real>(pass: &Pass<R>, run: Run, x: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_ET0, _MM_HINT_T0, _mm_prefetch};
        /// Octets in 64 bytes.
        const fn line<R>() -> usize {
            if size_of::<R>() == 4 { 2 } else { 1 }
        }
        let (near, dx) = near(run, x);
        let brick = |by: usize, bz: usize| pass.bricks.neighbours[near][dx + 3 * by + 9 * bz];
        let octet =
            |brick: u32, comp: usize, row: usize| brick as usize * BRICK_OCTETS + comp * BRICK_ROWS + row;
        if brick(1, 1) != NO_BRICK {
            for at in (0..BRICK_OCTETS).step_by(line::<R>()) {
                // SAFETY: a prefetch changes nothing that the program can see; the octets exist.
                unsafe {
                    _mm_prefetch::<_MM_HINT_T0>(pass.u.add(octet(brick(1, 1), 0, 0) + at).cast());
                    _mm_prefetch::<_MM_HINT_T0>(pass.v.add(octet(brick(1, 1), 0, 0) + at).cast());
                    _mm_prefetch::<_MM_HINT_ET0>(pass.u_next.add(octet(brick(1, 1), 0, 0) + at).cast());
                }
            }
        }
        for comp in 0..3 {
            if brick(1, 2) != NO_BRICK {
                for row in (0..4).step_by(line::<R>()) {
                    // SAFETY: as above.
                    unsafe { _mm_prefetch::<_MM_HINT_T0>(pass.u.add(octet(brick(1, 2), comp, row)).cast()) };
                }
            }
            if brick(2, 1) != NO_BRICK {
                for row in [0, 4, 8, 12] {
                    // SAFETY: as above.
                    unsafe { _mm_prefetch::<_MM_HINT_T0>(pass.u.add(octet(brick(2, 1), comp, row)).cast()) };
                }
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (pass, run, x);
}

/// Copies one octet column of the run and its halo into scratch rows.
#[inline(always)]
pub(super) unsafe fn stage<L: Lanes, const VOLUME: bool, const DAMPED: bool>(
    pass: &Pass<L::Real>,
    run: Run,
    s: &mut Scratch<L::Real>,
    x: usize,
) {
    let (near, dx) = near(run, x);
    let mut holds = 0_u64;
    for (bz, (z_start, z_end, z_first)) in SIDES.into_iter().enumerate() {
        for (by, (y_start, y_end, y_first)) in SIDES.into_iter().enumerate() {
            let brick = pass.bricks.neighbours[near][dx + 3 * by + 9 * bz];
            for z in z_start..z_end {
                for y in y_start..y_end {
                    let row = z * SIDE + y;
                    // The last rows are no lowest corner of any cell that is looked at.
                    let has_cells = y < SIDE - 1 && z < SIDE - 1;
                    if brick == NO_BRICK {
                        clear_row::<L, VOLUME, DAMPED>(s, row, x);
                        continue;
                    }
                    let local = (z - z_start + z_first) * 4 + y - y_start + y_first;
                    // SAFETY: a row of an existing brick; as the caller's.
                    unsafe {
                        copy_row::<L, VOLUME, DAMPED>(pass, s, row, x, brick as usize, local, has_cells);
                    }
                    holds |= u64::from(pass.bricks.rows[brick as usize] >> local & 1) << row;
                }
            }
        }
    }
    s.holds[x] = holds;
}

#[inline(always)]
fn clear_row<L: Lanes, const VOLUME: bool, const DAMPED: bool>(
    s: &mut Scratch<L::Real>,
    row: usize,
    x: usize,
) {
    for comp in 0..3 {
        s.u[comp][row][x] = Octet::default();
        if DAMPED {
            s.v[comp][row][x] = Octet::default();
        }
    }
    s.spring[row][x] = Octet::default();
    s.corner[row][x] = Octet::default();
    if VOLUME {
        s.volume[row][x] = Octet::default();
    }
    if DAMPED {
        s.damper[row][x] = Octet::default();
    }
}

#[inline(always)]
unsafe fn copy_row<L: Lanes, const VOLUME: bool, const DAMPED: bool>(
    pass: &Pass<L::Real>,
    s: &mut Scratch<L::Real>,
    row: usize,
    x: usize,
    brick: usize,
    local: usize,
    has_cells: bool,
) {
    let octet = brick * BRICK_OCTETS + local;
    // SAFETY: octets and slots of an existing brick; nobody writes `u` during a substep, nor `v` where springs are damped.
    unsafe {
        for comp in 0..3 {
            s.u[comp][row][x] = *pass.u.add(octet + comp * BRICK_ROWS);
            if DAMPED {
                s.v[comp][row][x] = *pass.v.add(octet + comp * BRICK_ROWS);
            }
        }
        if !has_cells {
            return;
        }
        let cells: &[u8; 8] = &*pass.bricks.cells.as_ptr().add(brick * BRICK_SLOTS + local * 8).cast();
        L::look_up(&pass.laws.spring, cells).store(s.spring[row][x].0.as_mut_ptr());
        L::look_up(&pass.laws.corner, cells).store(s.corner[row][x].0.as_mut_ptr());
        if VOLUME {
            L::look_up(&pass.laws.volume, cells).store(s.volume[row][x].0.as_mut_ptr());
        }
        if DAMPED {
            L::look_up(&pass.laws.damper, cells).store(s.damper[row][x].0.as_mut_ptr());
        }
    }
}
