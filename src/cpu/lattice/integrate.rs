//! From forces to motion.

use super::super::lanes::{Lanes, Octet, Real};
use super::super::nodes::{BRICK_OCTETS, BRICK_ROWS};
use super::sums::{complete, load, plus};
use super::{Extremes, Mark, Pass, Scratch, staged};
use crate::model::lattice::{BRICK_SLOTS, flag};

/// What moves all nodes alike, in registers.
pub(super) struct Motion<L> {
    dt: L,
    keep: L,
    gravity: [L; 3],
}

impl<L: Lanes> Motion<L> {
    /// Of a substep.
    #[inline(always)]
    pub fn new(pass: &Pass<L::Real>) -> Self {
        let [x, y, z] = pass.gravity;
        Self {
            dt: L::splat(pass.dt),
            keep: L::splat(pass.keep),
            gravity: [L::splat(x), L::splat(y), L::splat(z)],
        }
    }
}

/// Moves the nodes of a brick, of which the scratch rows hold what comes behind it.
#[inline(always)]
pub(super) unsafe fn integrate<L: Lanes, const COLUMN: u8>(
    pass: &Pass<L::Real>,
    brick: usize,
    s: &Scratch<L::Real>,
    motion: &Motion<L>,
    extremes: &Extremes<L>,
) {
    let (one, zero) = (L::splat(1.0), L::splat(0.0));
    let (mut speed2, mut acceleration2, mut displacement2, mut vis_viva) = (zero, zero, zero, zero);

    let pieces = pass.pieces.place_of(brick);
    for row in (0..BRICK_ROWS).filter(|row| pass.bricks.rows[brick] >> row & 1 != 0) {
        let staged = &s.rows[staged(row)];
        let mut force = complete::<L, COLUMN>(staged);
        // SAFETY: as the caller's; slots and octets of this run's brick, which this thread alone writes.
        unsafe {
            let flags: &[u8; 8] = &*pass.flags.as_ptr().add(brick * BRICK_SLOTS + row * 8).cast();
            let mut mass = L::load(staged.before.mass.0.as_ptr());
            if let Some(place) = pieces {
                let (more, weight) = pass.pieces.gather(place, row);
                force = plus(force, load(&more));
                mass = mass.add(L::load(weight.0.as_ptr()));
            }
            // Where there is no node this is infinite, and cleared below with every held axis.
            let inverse = one.div(mass);
            let is_free = *flags == [0; 8];

            let (mut v2, mut a2, mut u2) = (zero, zero, zero);
            for comp in 0..3 {
                let bit = flag::FIX_X << comp;
                let mut a = force[comp].fma(inverse, motion.gravity[comp]);
                let octet = brick * BRICK_OCTETS + comp * BRICK_ROWS + row;
                let mut v = a.fma(motion.dt, L::load(pass.v.add(octet).cast())).mul(motion.keep);
                if !is_free {
                    (a, v) = (a.free(flags, bit), v.free(flags, bit));
                }
                let u = v.fma(motion.dt, L::load(pass.u.add(octet).cast()));
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
    // SAFETY: one mark a brick, written by this thread alone.
    unsafe {
        *pass.marks.add(brick) = Mark {
            speed2,
            acceleration2: largest::<L>(acceleration2),
            displacement2: largest::<L>(displacement2),
            vis_viva: vis_viva as f32,
            strain: largest::<L>(extremes.strain),
            swelling: largest::<L>(extremes.swelling),
            shrinking: largest::<L>(extremes.shrinking),
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
