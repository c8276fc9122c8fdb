//! From forces to motion.

use super::super::lanes::{Lanes, Octet, Real};
use super::super::nodes::{BRICK_OCTETS, BRICK_ROWS, Run};
use super::{Mark, Pass, SIDE, Scratch, at};
use crate::model::lattice::{BRICK_SLOTS, flag};

/// Brings home what nodes one back along x gathered for this column.
#[inline(always)]
pub(super) fn take_from_below<L: Lanes>(s: &mut Scratch<L::Real>, x: usize) {
    for row in 0..BRICK_ROWS {
        let below = s.sums[(x - 1) & 1][row].up;
        let sums = &mut s.sums[x & 1][row];
        for comp in 0..3 {
            // SAFETY: whole octets.
            unsafe {
                let shifted = L::load(sums.up[comp].0.as_ptr()).shift_up(L::load(below[comp].0.as_ptr()));
                L::load(sums.at[comp].0.as_ptr()).sub(shifted).store(sums.at[comp].0.as_mut_ptr());
            }
        }
    }
}

/// Moves the nodes of octet column `x` with their forces, now complete.
#[inline(always)]
pub(super) unsafe fn integrate<L: Lanes>(pass: &Pass<L::Real>, run: Run, s: &Scratch<L::Real>, x: usize) {
    let brick = run.first + x - 1;
    let (dt, keep, one) = (L::splat(pass.dt), L::splat(pass.keep), L::splat(1.0));
    let zero = L::splat(0.0);
    let g = pass.gravity;
    let gravity = [L::splat(g[0]), L::splat(g[1]), L::splat(g[2])];
    let (mut speed2, mut acceleration2, mut displacement2, mut vis_viva) = (zero, zero, zero, zero);

    for row in (0..BRICK_ROWS).filter(|row| pass.bricks.rows[brick] >> row & 1 != 0) {
        let staged = (row / 4 + 1) * SIDE + row % 4 + 1;
        // SAFETY: as the caller's; slots and octets of this run's brick, which this thread alone writes.
        unsafe {
            let flags: &[u8; 8] = &*pass.flags.as_ptr().add(brick * BRICK_SLOTS + row * 8).cast();
            let mut mass = zero;
            for r in [staged, staged - 1, staged - SIDE, staged - SIDE - 1] {
                mass = mass.add(at::<L>(&s.corner[r], x, 0).add(at(&s.corner[r], x, -1)));
            }
            // Where there is no node this is infinite, and cleared below with every held axis.
            let inverse = one.div(mass);
            let is_free = *flags == [0; 8];

            let sums = &s.sums[x & 1][row];
            let ahead = &s.sums[(x + 1) & 1][row].down;
            let (mut v2, mut a2, mut u2) = (zero, zero, zero);
            for comp in 0..3 {
                let down = L::load(sums.down[comp].0.as_ptr()).shift_down(L::load(ahead[comp].0.as_ptr()));
                let force = L::load(sums.at[comp].0.as_ptr()).sub(down);
                let bit = flag::FIX_X << comp;
                let mut a = force.fma(inverse, gravity[comp]);
                let octet = brick * BRICK_OCTETS + comp * BRICK_ROWS + row;
                let mut v = a.fma(dt, L::load(pass.v.add(octet).cast())).mul(keep);
                if !is_free {
                    (a, v) = (a.free(flags, bit), v.free(flags, bit));
                }
                let u = v.fma(dt, at::<L>(&s.u[comp][staged], x, 0));
                if !pass.watch {
                    v.store(pass.v_next.add(octet).cast());
                    u.store(pass.u_next.add(octet).cast());
                }
                v2 = v.fma(v, v2);
                a2 = a.fma(a, a2);
                u2 = u.fma(u, u2);
            }
            speed2 = v2.max(speed2);
            acceleration2 = a2.max(acceleration2);
            displacement2 = u2.max(displacement2);
            vis_viva = mass.fma(v2, vis_viva);
        }
    }
    let vis_viva = total::<L>(vis_viva);
    // A maximum may lose a NaN; a sum does not.
    let speed2 = if vis_viva.is_finite() { largest::<L>(speed2) } else { f32::NAN };
    let extreme = |e: usize| s.extremes[e].0.iter().fold(0.0, |most, lane| lane.to_f64().max(most)) as f32;
    // SAFETY: one mark a brick, written by this thread alone.
    unsafe {
        *pass.marks.add(brick) = Mark {
            speed2,
            acceleration2: largest::<L>(acceleration2),
            displacement2: largest::<L>(displacement2),
            vis_viva: vis_viva as f32,
            strain: extreme(0),
            swelling: extreme(1),
            shrinking: extreme(2),
        };
    }
}

/// The sum of the lanes.
#[inline(always)]
fn total<L: Lanes>(x: L) -> f64 {
    let mut lanes = Octet::<L::Real>::default();
    // SAFETY: a whole octet.
    unsafe { x.store(lanes.0.as_mut_ptr()) };
    lanes.0.iter().map(|lane| lane.to_f64()).sum()
}

/// The largest lane of positive numbers.
#[inline(always)]
fn largest<L: Lanes>(x: L) -> f32 {
    let mut lanes = Octet::<L::Real>::default();
    // SAFETY: a whole octet.
    unsafe { x.store(lanes.0.as_mut_ptr()) };
    lanes.0.iter().fold(0.0, |most, lane| lane.to_f64().max(most)) as f32
}
