//! The springs of a brick, each evaluated once for both of its ends.

use super::super::lanes::{Lanes, Octet};
use super::stage::Held;
use super::sums::{give, load, store};
use super::{Constants, LEFT_END, RIGHT_END, ROWS, SIDE, Scratch, WHOLE, Window, owned};
use crate::model::law::squared_change;

/// Row B that A looks forward to: offset along y and z.
const FORWARD: [(isize, isize); 4] = [(1, 0), (-1, 1), (0, 1), (1, 1)];

/// Whose forces are wanted of the springs between rows A and B.
const ON_A: u8 = 1;
const ON_B: u8 = 2;
const ON_BOTH: u8 = 3;

/// For each staged row A and each of [`FORWARD`]: whose forces are wanted.
const WANTED: [[u8; 4]; ROWS] = {
    let mut wanted = [[0; 4]; ROWS];
    let side = SIDE as isize;
    let mut a = 0;
    while a < ROWS {
        let (y, z) = (a as isize % side, a as isize / side);
        let mut f = 0;
        while f < 4 {
            let (by, bz) = (y + FORWARD[f].0, z + FORWARD[f].1);
            if by >= 0 && by < side && bz < side {
                wanted[a][f] = (owned(y, z) as u8 * ON_A) | (owned(by, bz) as u8 * ON_B);
            }
            f += 1;
        }
        a += 1;
    }
    wanted
};

/// The springs that begin in a brick or its halo, or those that enter the run at one of its ends.
#[inline(always)]
pub(super) unsafe fn springs<L: Lanes, const COLUMN: u8, const DAMPED: bool>(
    s: &mut Scratch<L::Real>,
    held: Held,
    c: &Constants<L>,
    strain: &mut L,
) {
    let (of_a, of_b) = match COLUMN {
        LEFT_END => (held.before, held.here),
        RIGHT_END => (held.after, held.here),
        _ => (held.here, held.around()),
    };
    // Rows of the last z plane look forward to nothing that is wanted.
    for a in (0..ROWS - SIDE).filter(|a| of_a >> a & 1 != 0) {
        let mut force = [c.zero; 3];
        let own_a = owned((a % SIDE) as isize, (a / SIDE) as isize);
        // SAFETY: A looks forward only to staged rows, where that is wanted.
        unsafe {
            if own_a && COLUMN != RIGHT_END && of_b >> a & 1 != 0 {
                let shift = if COLUMN == LEFT_END { -1 } else { 0 };
                let [b, d, e] = [s.row(a - 1), s.row(a - SIDE), s.row(a - SIDE - 1)];
                let a_row = s.row(a);
                let k = sum_of_four::<L>([&a_row.spring, &b.spring, &d.spring, &e.spring], shift);
                let kb = if DAMPED {
                    sum_of_four::<L>([&a_row.damper, &b.damper, &d.damper, &e.damper], shift)
                } else {
                    k
                };
                let f = spring::<L, COLUMN, 1, 0, 0, DAMPED>(s, a, a, k, kb, c, strain);
                force = f.on_a(force);
                f.give_a(&mut s.row_mut(a).sums.up);
            }
            pairs::<L, 1, 0, COLUMN, DAMPED>(s, a, WANTED[a][0], of_b, c, &mut force, strain);
            pairs::<L, -1, 1, COLUMN, DAMPED>(s, a, WANTED[a][1], of_b, c, &mut force, strain);
            pairs::<L, 0, 1, COLUMN, DAMPED>(s, a, WANTED[a][2], of_b, c, &mut force, strain);
            pairs::<L, 1, 1, COLUMN, DAMPED>(s, a, WANTED[a][3], of_b, c, &mut force, strain);
        }
        if own_a && COLUMN == WHOLE {
            // SAFETY: a staged row.
            give::<L>(unsafe { &mut s.row_mut(a).sums.at }, force);
        }
    }
}

/// The springs from each node of row A to row B at offset (Y, Z), where they exist and a force of theirs is wanted.
#[inline(always)]
unsafe fn pairs<L: Lanes, const Y: isize, const Z: isize, const COLUMN: u8, const DAMPED: bool>(
    s: &mut Scratch<L::Real>,
    a: usize,
    wanted: u8,
    of_b: u64,
    c: &Constants<L>,
    force: &mut [L; 3],
    strain: &mut L,
) {
    let b = a.wrapping_add_signed(Z * SIDE as isize + Y);
    // SAFETY: as the caller's; what is not wanted may not be staged.
    unsafe {
        match wanted {
            _ if wanted == 0 || of_b >> b & 1 == 0 => {}
            ON_A if COLUMN != WHOLE => {}
            ON_A => pair::<L, Y, Z, COLUMN, ON_A, DAMPED>(s, a, b, c, force, strain),
            ON_B => pair::<L, Y, Z, COLUMN, ON_B, DAMPED>(s, a, b, c, force, strain),
            _ => pair::<L, Y, Z, COLUMN, ON_BOTH, DAMPED>(s, a, b, c, force, strain),
        }
    }
}

/// The springs from each node of row A to row B at offset (Y, Z), and the forces on ON.
#[inline(always)]
unsafe fn pair<
    L: Lanes,
    const Y: isize,
    const Z: isize,
    const COLUMN: u8,
    const ON: u8,
    const DAMPED: bool,
>(
    s: &mut Scratch<L::Real>,
    a: usize,
    b: usize,
    c: &Constants<L>,
    force: &mut [L; 3],
    strain: &mut L,
) {
    // Stiffness: the cells of row `one` and, beside a face between two rows, of row `two`; at x, and at x - 1.
    let one = if Y < 0 { a - 1 } else { a };
    let two = match (Y, Z) {
        (_, 0) => a - SIDE,
        (0, _) => a - 1,
        _ => one,
    };
    // SAFETY: both rows are staged.
    unsafe {
        let (cells_one, cells_two) = (s.row(one), s.row(two));
        let ahead = cells_beside::<L, Y, Z>(&cells_one.spring, &cells_two.spring, 0);
        let behind = cells_beside::<L, Y, Z>(&cells_one.spring, &cells_two.spring, -1);
        let (damper_ahead, damper_behind) = if DAMPED {
            (
                cells_beside::<L, Y, Z>(&cells_one.damper, &cells_two.damper, 0),
                cells_beside::<L, Y, Z>(&cells_one.damper, &cells_two.damper, -1),
            )
        } else {
            (c.zero, c.zero)
        };
        match COLUMN {
            LEFT_END => {
                let up = spring::<L, COLUMN, 1, Y, Z, DAMPED>(s, a, b, behind, damper_behind, c, strain);
                up.give_a(&mut s.row_mut(b).sums.up);
            }
            RIGHT_END => {
                let down = spring::<L, COLUMN, -1, Y, Z, DAMPED>(s, a, b, ahead, damper_ahead, c, strain);
                down.give_a(&mut s.row_mut(b).sums.down);
            }
            _ => {
                let (k, kb) = (ahead.add(behind), damper_ahead.add(damper_behind));
                let straight = spring::<L, COLUMN, 0, Y, Z, DAMPED>(s, a, b, k, kb, c, strain);
                if ON & ON_A != 0 {
                    *force = straight.on_a(*force);
                }
                if ON & ON_B != 0 {
                    straight.give_b(&mut s.row_mut(b).sums.at);
                }
                let up = spring::<L, COLUMN, 1, Y, Z, DAMPED>(s, a, b, ahead, damper_ahead, c, strain);
                if ON & ON_A != 0 {
                    *force = up.on_a(*force);
                }
                if ON & ON_B != 0 {
                    up.give_a(&mut s.row_mut(b).sums.up);
                }
                let down = spring::<L, COLUMN, -1, Y, Z, DAMPED>(s, a, b, behind, damper_behind, c, strain);
                if ON & ON_A != 0 {
                    *force = down.on_a(*force);
                }
                if ON & ON_B != 0 {
                    down.give_a(&mut s.row_mut(b).sums.down);
                }
            }
        }
    }
}

/// Sum of four windows, moved by `shift`.
#[inline(always)]
fn sum_of_four<L: Lanes>(windows: [&Window<L::Real>; 4], shift: isize) -> L {
    let [a, b, d, e] = windows;
    a.at::<L>(shift).add(b.at(shift)).add(d.at::<L>(shift).add(e.at(shift)))
}

/// Sum over the cells at `x + dx` that lie beside a spring to row (Y, Z): one for a diagonal of rows, else two.
#[inline(always)]
fn cells_beside<L: Lanes, const Y: isize, const Z: isize>(
    one: &Window<L::Real>,
    two: &Window<L::Real>,
    dx: isize,
) -> L {
    let first = one.at::<L>(dx);
    if Y != 0 && Z != 0 { first } else { first.add(two.at(dx)) }
}

/// Row A minus the nodes of row B that lie X further.
#[inline(always)]
fn difference<L: Lanes, const COLUMN: u8, const X: isize>(
    a: &[Window<L::Real>; 3],
    b: &[Window<L::Real>; 3],
) -> [L; 3] {
    let shift = if COLUMN == WHOLE { 0 } else { -X };
    let other = shift + X;
    [
        a[0].at::<L>(shift).sub(b[0].at(other)),
        a[1].at::<L>(shift).sub(b[1].at(other)),
        a[2].at::<L>(shift).sub(b[2].at(other)),
    ]
}

/// `d` minus the rest vector's component, `r` cells.
#[inline(always)]
fn along<L: Lanes>(r: isize, d: L, c: &Constants<L>) -> L {
    match r {
        0 => d,
        1 => d.sub(c.h),
        _ => d.add(c.h),
    }
}

/// A force along a spring: `-size * way` on the node in row A, and its opposite on the one in row B. Kept as factors, so that sums take
/// it in by fused multiply-adds.
struct Pull<L> {
    size: L,
    /// From B to A as they are now.
    way: [L; 3],
}

impl<L: Lanes> Pull<L> {
    /// Adds the force on A to a sum.
    #[inline(always)]
    fn on_a(&self, sum: [L; 3]) -> [L; 3] {
        [
            self.size.take_from(self.way[0], sum[0]),
            self.size.take_from(self.way[1], sum[1]),
            self.size.take_from(self.way[2], sum[2]),
        ]
    }

    /// Adds the force on A to stored sums.
    #[inline(always)]
    fn give_a(&self, sums: &mut [Octet<L::Real>; 3]) {
        store(sums, self.on_a(load(sums)));
    }

    /// Adds the force on B to stored sums.
    #[inline(always)]
    fn give_b(&self, sums: &mut [Octet<L::Real>; 3]) {
        let sum = load::<L>(sums);
        let [x, y, z] = self.way;
        store(sums, [self.size.fma(x, sum[0]), self.size.fma(y, sum[1]), self.size.fma(z, sum[2])]);
    }
}

/// The springs from the nodes of row A to those of row B, one node further by X: stiffness `k`, damper `kb`. At a run's end they lie one node
/// aside, so that their other end is in the brick.
#[inline(always)]
unsafe fn spring<
    L: Lanes,
    const COLUMN: u8,
    const X: isize,
    const Y: isize,
    const Z: isize,
    const DAMPED: bool,
>(
    s: &Scratch<L::Real>,
    a: usize,
    b: usize,
    k: L,
    kb: L,
    c: &Constants<L>,
    strain: &mut L,
) -> Pull<L> {
    // SAFETY: as the caller's.
    let (row_a, row_b) = unsafe { (s.row(a), s.row(b)) };
    let d = difference::<L, COLUMN, X>(&row_a.u, &row_b.u);

    // -r·d / h, for `d` is taken from B to A: a signed sum of the components along the spring.
    let rd = match (X != 0, Y != 0, Z != 0) {
        (true, false, false) => d[0],
        (false, true, false) => d[1],
        (false, false, true) => d[2],
        (true, true, false) => signed(X, d[0], Y, d[1], c),
        (true, false, true) => signed(X, d[0], Z, d[2], c),
        (false, true, true) => signed(Y, d[1], Z, d[2], c),
        _ => signed(1, signed(X, d[0], Y, d[1], c), Z, d[2], c),
    };
    let class = match X.abs() + Y.abs() + Z.abs() {
        1 => &c.edge,
        2 => &c.face,
        _ => &c.body,
    };
    let l = [along(X, d[0], c), along(Y, d[1], c), along(Z, d[2], c)];

    let elongation = class.elongation(squared_change(d, rd, c.minus_2h));
    // Edges alone are watched: a body diagonal hardly stretches without one.
    if X.abs() + Y.abs() + Z.abs() == 1 {
        *strain = elongation.magnitude_where(k).max(*strain);
    }
    let mut scale = k.mul(elongation);
    if DAMPED {
        let dv = difference::<L, COLUMN, X>(&row_a.v, &row_b.v);
        let rate = l[0].fma(dv[0], l[1].fma(dv[1], l[2].mul(dv[2])));
        scale = kb.mul(class.damping).fma(rate, scale);
    }
    Pull { size: scale, way: l }
}

/// ±p ± q.
#[inline(always)]
fn signed<L: Lanes>(sp: isize, p: L, sq: isize, q: L, c: &Constants<L>) -> L {
    match (sp, sq) {
        (1, 1) => p.add(q),
        (1, _) => p.sub(q),
        (_, 1) => q.sub(p),
        _ => p.add(q).mul(c.minus_one),
    }
}
