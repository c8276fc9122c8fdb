//! Sums of forces, in registers and in scratch rows.

use super::super::lanes::{Lanes, Octet};
use super::super::nodes::BRICK_ROWS;
use super::{RIGHT_END, Row, SIDE, Scratch, staged};

/// `sums -= force`.
#[inline(always)]
pub(super) fn take<L: Lanes>(sums: &mut [Octet<L::Real>; 3], force: [L; 3]) {
    store(sums, minus(load(sums), force));
}

/// `sums += force`.
#[inline(always)]
pub(super) fn give<L: Lanes>(sums: &mut [Octet<L::Real>; 3], force: [L; 3]) {
    store(sums, plus(load(sums), force));
}

#[inline(always)]
pub(super) fn load<L: Lanes>(sums: &[Octet<L::Real>; 3]) -> [L; 3] {
    // SAFETY: whole octets.
    unsafe { [L::load(sums[0].0.as_ptr()), L::load(sums[1].0.as_ptr()), L::load(sums[2].0.as_ptr())] }
}

#[inline(always)]
pub(super) fn store<L: Lanes>(sums: &mut [Octet<L::Real>; 3], values: [L; 3]) {
    // SAFETY: whole octets.
    unsafe {
        values[0].store(sums[0].0.as_mut_ptr());
        values[1].store(sums[1].0.as_mut_ptr());
        values[2].store(sums[2].0.as_mut_ptr());
    }
}

#[inline(always)]
pub(super) fn plus<L: Lanes>(p: [L; 3], q: [L; 3]) -> [L; 3] {
    [p[0].add(q[0]), p[1].add(q[1]), p[2].add(q[2])]
}

#[inline(always)]
pub(super) fn minus<L: Lanes>(p: [L; 3], q: [L; 3]) -> [L; 3] {
    [p[0].sub(q[0]), p[1].sub(q[1]), p[2].sub(q[2])]
}

/// `[low.7, x.0, …, x.6]` of each component.
#[inline(always)]
fn shift_up<L: Lanes>(x: [L; 3], low: [L; 3]) -> [L; 3] {
    [x[0].shift_up(low[0]), x[1].shift_up(low[1]), x[2].shift_up(low[2])]
}

/// `[x.1, …, x.7, high.0]` of each component.
#[inline(always)]
fn shift_down<L: Lanes>(x: [L; 3], high: [L; 3]) -> [L; 3] {
    [x[0].shift_down(high[0]), x[1].shift_down(high[1]), x[2].shift_down(high[2])]
}

/// Forgets what was gathered for the brick's rows.
#[inline(always)]
pub(super) fn clear<L: Lanes>(s: &mut Scratch<L::Real>) {
    let zero = [L::splat(0.0); 3];
    for row in 0..BRICK_ROWS {
        let sums = &mut s.rows[staged(row)].sums;
        store(&mut sums.at, zero);
        store(&mut sums.up, zero);
        store(&mut sums.down, zero);
    }
}

/// Makes of the `up` sums from a run's left end, which belong to its first node, those of the row before.
#[inline(always)]
pub(super) fn turn_left_end<L: Lanes>(s: &mut Scratch<L::Real>) {
    let zero = [L::splat(0.0); 3];
    for row in 0..BRICK_ROWS {
        let Row { sums, before, .. } = &mut s.rows[staged(row)];
        store(&mut before.up, shift_down(zero, load(&sums.up)));
        store(&mut sums.up, zero);
    }
}

/// The forces on a row of the brick before, completed by what this brick's nodes take from its last ones; at the run's right end, by what the
/// nodes behind it take.
#[inline(always)]
pub(super) fn complete<L: Lanes, const COLUMN: u8>(row: &Row<L::Real>) -> [L; 3] {
    let zero = [L::splat(0.0); 3];
    let down = load(&row.sums.down);
    let taken = if COLUMN == RIGHT_END { shift_up(zero, down) } else { down };
    minus(load(&row.before.force), shift_down(zero, taken))
}

/// Keeps the forces and masses of the brick's rows for when the next brick is known.
#[inline(always)]
pub(super) fn keep<L: Lanes>(s: &mut Scratch<L::Real>) {
    let zero = [L::splat(0.0); 3];
    masses::<L>(s);
    for at in (0..BRICK_ROWS).map(staged) {
        let Row { sums, before, .. } = &mut s.rows[at];
        let up = load(&sums.up);
        let force = minus(load(&sums.at), shift_up(up, load(&before.up)));
        store(&mut before.force, minus(force, shift_down(load(&sums.down), zero)));
        store(&mut before.up, up);
    }
}

/// Sums the masses of the brick's nodes from the corners of the cells around them: first along x, then along y, then along z, so that each
/// corner is read twice and not eight times.
#[inline(always)]
fn masses<L: Lanes>(s: &mut Scratch<L::Real>) {
    let mut below = [L::splat(0.0); 4];
    for z in 0..=4 {
        let mut back = beside::<L>(&s.rows[z * SIDE]);
        for y in 0..4 {
            let front = beside::<L>(&s.rows[z * SIDE + y + 1]);
            let pair = back.add(front);
            if z > 0 {
                let mass = below[y].add(pair);
                // SAFETY: a whole octet.
                unsafe { mass.store(s.rows[z * SIDE + y + 1].before.mass.0.as_mut_ptr()) };
            }
            (below[y], back) = (pair, front);
        }
    }
}

/// What the cells before and behind each node of a row weigh at their corners.
#[inline(always)]
fn beside<L: Lanes>(row: &Row<L::Real>) -> L {
    row.corner.at::<L>(0).add(row.corner.at(-1))
}
