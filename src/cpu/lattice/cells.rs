//! The volume terms of a column of octets of cells.

use super::super::lanes::{Lanes, Octet};
use super::sums::{give, minus, plus, take};
use super::{Constants, ROW, ROWS, SIDE, Scratch, at, own, owned};
use crate::model::law::volume_change;

/// The volume terms of one column of octets of cells.
#[inline(always)]
pub(super) unsafe fn cells<L: Lanes>(s: &mut Scratch<L::Real>, x: usize, c: &Constants<L>) {
    let here = s.holds[x];
    let (mut swelling, mut shrinking) = (c.zero, c.zero);
    for z in 0..SIDE - 1 {
        for y in 0..SIDE - 1 {
            let low = z * SIDE + y;
            if here >> low & 1 == 0 {
                continue;
            }
            let rows = [low, low + 1, low + SIDE, low + SIDE + 1];

            // SAFETY: as the caller's; `x` is not the last octet of a row.
            let gradient = unsafe {
                [
                    gradient::<L>(&s.u[0], rows, x, c),
                    gradient::<L>(&s.u[1], rows, x, c),
                    gradient::<L>(&s.u[2], rows, x, c),
                ]
            };
            let (cof, dj) = volume_change(gradient);
            // SAFETY: as the caller's.
            let stiffness = unsafe { at::<L>(&s.volume[low], x, 0) };
            let p = stiffness.mul(dj).mul(c.minus_one);
            let there = dj.magnitude_where(stiffness);
            swelling = there.min(dj).max(swelling);
            shrinking = there.min(c.zero.sub(dj)).max(shrinking);

            // Corner (±, ±, ±) receives ±cx ±cy ±cz.
            let cx = [cof[0][0].mul(p), cof[1][0].mul(p), cof[2][0].mul(p)];
            let cy = [cof[0][1].mul(p), cof[1][1].mul(p), cof[2][1].mul(p)];
            let cz = [cof[0][2].mul(p), cof[1][2].mul(p), cof[2][2].mul(p)];
            let (same, opposite) = (plus(cy, cz), minus(cy, cz));
            for (r, row) in rows.into_iter().enumerate() {
                if !owned((row % SIDE) as isize, (row / SIDE) as isize) {
                    continue;
                }
                let sums = &mut s.sums[x & 1][own(row)];
                // What the node ahead receives is subtracted from what is taken from it.
                match r {
                    0 => {
                        take::<L>(&mut sums.at, plus(same, cx));
                        give::<L>(&mut sums.up, minus(same, cx));
                    }
                    1 => {
                        give::<L>(&mut sums.at, minus(opposite, cx));
                        take::<L>(&mut sums.up, plus(opposite, cx));
                    }
                    2 => {
                        take::<L>(&mut sums.at, plus(opposite, cx));
                        give::<L>(&mut sums.up, minus(opposite, cx));
                    }
                    _ => {
                        give::<L>(&mut sums.at, minus(same, cx));
                        take::<L>(&mut sums.up, plus(same, cx));
                    }
                }
            }
        }
    }
    // SAFETY: whole octets.
    unsafe {
        swelling.store(s.extremes[1].0.as_mut_ptr());
        shrinking.store(s.extremes[2].0.as_mut_ptr());
    }
}

/// One component's gradient in eight cells with corner rows `rows`: sums and differences along x, then along y and z.
#[inline(always)]
unsafe fn gradient<L: Lanes>(
    field: &[[Octet<L::Real>; ROW]; ROWS],
    rows: [usize; 4],
    x: usize,
    c: &Constants<L>,
) -> [L; 3] {
    // SAFETY: as the caller's.
    unsafe {
        let (a, a1) = (at::<L>(&field[rows[0]], x, 0), at::<L>(&field[rows[0]], x, 1));
        let (b, b1) = (at::<L>(&field[rows[1]], x, 0), at::<L>(&field[rows[1]], x, 1));
        let (d, d1) = (at::<L>(&field[rows[2]], x, 0), at::<L>(&field[rows[2]], x, 1));
        let (e, e1) = (at::<L>(&field[rows[3]], x, 0), at::<L>(&field[rows[3]], x, 1));
        let (sa, sb, sd, se) = (a.add(a1), b.add(b1), d.add(d1), e.add(e1));
        let dx = a1.sub(a).add(b1.sub(b)).add(d1.sub(d).add(e1.sub(e)));
        let dy = sb.sub(sa).add(se.sub(sd));
        let dz = sd.sub(sa).add(se.sub(sb));
        [dx.mul(c.inverse_4h), dy.mul(c.inverse_4h), dz.mul(c.inverse_4h)]
    }
}
