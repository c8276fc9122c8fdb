//! The springs of a column of octets, each evaluated once for both of its ends.

use super::super::lanes::{Lanes, Octet};
use super::sums::{give, load, store};
use super::{Constants, ROW, ROWS, SIDE, Scratch, at, own, owned};
use crate::model::law::squared_change;

/// Which springs of a column of octets exist: those of a whole column, or those that enter the run at its ends.
pub(super) const WHOLE: u8 = 0;
pub(super) const LEFT_HALO: u8 = 1;
pub(super) const RIGHT_HALO: u8 = 2;

/// Row B that A looks forward to: offset along y and z.
const FORWARD: [(isize, isize); 4] = [(1, 0), (-1, 1), (0, 1), (1, 1)];

/// For each staged row A and each of [`FORWARD`]: whether A's force is wanted (1) and whether B's is (2).
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
                wanted[a][f] = owned(y, z) as u8 | (owned(by, bz) as u8) << 1;
            }
            f += 1;
        }
        a += 1;
    }
    wanted
};

/// The springs of one column of octets, each evaluated once.
#[inline(always)]
pub(super) unsafe fn springs<L: Lanes, const COLUMN: u8, const DAMPED: bool>(
    s: &mut Scratch<L::Real>,
    x: usize,
    c: &Constants<L>,
) {
    let here = s.holds[x];
    let around = here | if x > 0 { s.holds[x - 1] } else { 0 } | if x + 1 < ROW { s.holds[x + 1] } else { 0 };
    // SAFETY: a whole octet.
    let strain = &mut unsafe { L::load(s.extremes[0].0.as_ptr()) };
    // Rows of the last z plane look forward to nothing that is wanted.
    for a in (0..ROWS - SIDE).filter(|a| here >> a & 1 != 0) {
        let mut force = [c.zero; 3];
        let own_a = owned((a % SIDE) as isize, (a / SIDE) as isize);

        // SAFETY: as the caller's.
        unsafe {
            if own_a && COLUMN != RIGHT_HALO {
                let k = edge_cells::<L>(&s.spring, a, x);
                let kb = if DAMPED { edge_cells::<L>(&s.damper, a, x) } else { k };
                let f = spring::<L, 1, 0, 0, DAMPED>(s, a, a, x, k, kb, c, strain);
                force = f.on_a(force);
                f.give_a(&mut s.sums[x & 1][own(a)].up);
            }
            // Row B, and the rows of the cells around each spring.
            pair::<L, 1, 0, COLUMN, DAMPED>(s, a, WANTED[a][0], around, x, c, &mut force, strain);
            pair::<L, -1, 1, COLUMN, DAMPED>(s, a, WANTED[a][1], around, x, c, &mut force, strain);
            pair::<L, 0, 1, COLUMN, DAMPED>(s, a, WANTED[a][2], around, x, c, &mut force, strain);
            pair::<L, 1, 1, COLUMN, DAMPED>(s, a, WANTED[a][3], around, x, c, &mut force, strain);
        }
        if own_a && COLUMN == WHOLE {
            give::<L>(&mut s.sums[x & 1][own(a)].at, force);
        }
    }
    // SAFETY: a whole octet.
    unsafe { strain.store(s.extremes[0].0.as_mut_ptr()) };
}

/// The three springs from each node of row A to row B at offset (Y, Z).
#[inline(always)]
unsafe fn pair<L: Lanes, const Y: isize, const Z: isize, const COLUMN: u8, const DAMPED: bool>(
    s: &mut Scratch<L::Real>,
    a: usize,
    wanted: u8,
    around: u64,
    x: usize,
    c: &Constants<L>,
    force: &mut [L; 3],
    strain: &mut L,
) {
    let b = a.wrapping_add_signed(Z * SIDE as isize + Y);
    if wanted == 0 || around >> b & 1 == 0 || (COLUMN != WHOLE && wanted & 2 == 0) {
        return;
    }

    // Stiffness: the cells of row `one` and, beside a face between two rows, of row `two`; at x, and at x - 1.
    let one = if Y < 0 { a - 1 } else { a };
    let two = if Z == 0 { a - SIDE } else { a.wrapping_sub(1) };
    // SAFETY: as the caller's.
    unsafe {
        let own_b = if wanted & 2 != 0 { own(b) } else { 0 };

        if COLUMN != RIGHT_HALO {
            let (ahead, damped_ahead) = (
                cells_beside::<L, Y, Z>(&s.spring, one, two, x, 0),
                if DAMPED { cells_beside::<L, Y, Z>(&s.damper, one, two, x, 0) } else { c.h },
            );
            if COLUMN == WHOLE {
                let k = ahead.add(cells_beside::<L, Y, Z>(&s.spring, one, two, x, -1));
                let kb = if DAMPED {
                    damped_ahead.add(cells_beside::<L, Y, Z>(&s.damper, one, two, x, -1))
                } else {
                    c.h
                };
                let f = spring::<L, 0, Y, Z, DAMPED>(s, a, b, x, k, kb, c, strain);
                if wanted & 1 != 0 {
                    *force = f.on_a(*force);
                }
                if wanted & 2 != 0 {
                    f.give_b(&mut s.sums[x & 1][own_b].at);
                }
            }
            let f = spring::<L, 1, Y, Z, DAMPED>(
                s,
                a,
                b,
                x,
                weaken::<L, Y, Z>(ahead, c),
                weaken::<L, Y, Z>(damped_ahead, c),
                c,
                strain,
            );
            if COLUMN == WHOLE && wanted & 1 != 0 {
                *force = f.on_a(*force);
            }
            if wanted & 2 != 0 {
                f.give_a(&mut s.sums[x & 1][own_b].up);
            }
        }
        if COLUMN != LEFT_HALO {
            let behind = weaken::<L, Y, Z>(cells_beside::<L, Y, Z>(&s.spring, one, two, x, -1), c);
            let damped_behind = if DAMPED {
                weaken::<L, Y, Z>(cells_beside::<L, Y, Z>(&s.damper, one, two, x, -1), c)
            } else {
                c.h
            };
            let f = spring::<L, -1, Y, Z, DAMPED>(s, a, b, x, behind, damped_behind, c, strain);
            if COLUMN == WHOLE && wanted & 1 != 0 {
                *force = f.on_a(*force);
            }
            if wanted & 2 != 0 {
                f.give_a(&mut s.sums[x & 1][own_b].down);
            }
        }
    }
}

/// Sum over the four cells ahead along x of the nodes of row A.
#[inline(always)]
unsafe fn edge_cells<L: Lanes>(row: &[[Octet<L::Real>; ROW]; ROWS], a: usize, x: usize) -> L {
    // SAFETY: as the caller's.
    unsafe {
        let near = at::<L>(&row[a], x, 0).add(at(&row[a - 1], x, 0));
        near.add(at::<L>(&row[a - SIDE], x, 0).add(at(&row[a - SIDE - 1], x, 0)))
    }
}

/// Sum over the cells at `x + dx` that lie beside a spring to row (Y, Z): one for a diagonal of rows, else two.
#[inline(always)]
unsafe fn cells_beside<L: Lanes, const Y: isize, const Z: isize>(
    row: &[[Octet<L::Real>; ROW]; ROWS],
    one: usize,
    two: usize,
    x: usize,
    dx: isize,
) -> L {
    // SAFETY: as the caller's.
    unsafe {
        let first = at::<L>(&row[one], x, dx);
        if Y != 0 && Z != 0 { first } else { first.add(at(&row[two], x, dx)) }
    }
}

/// The share of a body diagonal, where the spring to row (Y, Z) is one.
#[inline(always)]
fn weaken<L: Lanes, const Y: isize, const Z: isize>(k: L, c: &Constants<L>) -> L {
    if Y != 0 && Z != 0 { k.mul(c.three_quarters) } else { k }
}

/// Component `comp` of row A minus that of row B, X nodes further.
#[inline(always)]
unsafe fn difference<L: Lanes, const X: isize>(
    field: &[[[Octet<L::Real>; ROW]; ROWS]; 3],
    comp: usize,
    a: usize,
    b: usize,
    x: usize,
) -> L {
    // SAFETY: as the caller's.
    unsafe { at::<L>(&field[comp][a], x, 0).sub(at(&field[comp][b], x, X)) }
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

/// The springs from the nodes of row A to those of row B, one node further by X: stiffness `k`, damper `kb`.
#[inline(always)]
unsafe fn spring<L: Lanes, const X: isize, const Y: isize, const Z: isize, const DAMPED: bool>(
    s: &Scratch<L::Real>,
    a: usize,
    b: usize,
    x: usize,
    k: L,
    kb: L,
    c: &Constants<L>,
    strain: &mut L,
) -> Pull<L> {
    // SAFETY: as the caller's.
    let d = unsafe {
        [
            difference::<L, X>(&s.u, 0, a, b, x),
            difference::<L, X>(&s.u, 1, a, b, x),
            difference::<L, X>(&s.u, 2, a, b, x),
        ]
    };

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
        // SAFETY: as the caller's.
        let dv = unsafe {
            [
                difference::<L, X>(&s.v, 0, a, b, x),
                difference::<L, X>(&s.v, 1, a, b, x),
                difference::<L, X>(&s.v, 2, a, b, x),
            ]
        };
        let rate = l[0].fma(dv[0], l[1].fma(dv[1], l[2].mul(dv[2])));
        scale = kb.mul(class.inverse_length2).fma(rate, scale);
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
