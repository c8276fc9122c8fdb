//! The volume terms of a brick's cells.

use super::super::lanes::Lanes;
use super::stage::Held;
use super::sums::{give, minus, plus, take};
use super::{Constants, Extremes, LEFT_END, SIDE, Scratch, WHOLE, Window, owned};
use crate::model::law::volume_change;

/// The volume terms of a brick's cells, or of those that end at its first nodes.
#[inline(always)]
pub(super) unsafe fn cells<L: Lanes, const COLUMN: u8>(
    s: &mut Scratch<L::Real>,
    held: Held,
    c: &Constants<L>,
    extremes: &mut Extremes<L>,
) {
    let here = if COLUMN == LEFT_END { held.before } else { held.here };
    let shift = if COLUMN == LEFT_END { -1 } else { 0 };
    for z in 0..SIDE - 1 {
        for y in 0..SIDE - 1 {
            let low = z * SIDE + y;
            if here >> low & 1 == 0 {
                continue;
            }
            let rows = [low, low + 1, low + SIDE, low + SIDE + 1];
            let [a, b, d, e] =
                [&s.rows[rows[0]].u, &s.rows[rows[1]].u, &s.rows[rows[2]].u, &s.rows[rows[3]].u];
            let gradient = [
                gradient::<L>([&a[0], &b[0], &d[0], &e[0]], shift, c),
                gradient::<L>([&a[1], &b[1], &d[1], &e[1]], shift, c),
                gradient::<L>([&a[2], &b[2], &d[2], &e[2]], shift, c),
            ];
            let (cof, dj) = volume_change(gradient);
            let stiffness = s.rows[low].volume.at::<L>(shift);
            let p = stiffness.mul(dj).mul(c.minus_one);
            let there = dj.magnitude_where(stiffness);
            extremes.swelling = there.min(dj).max(extremes.swelling);
            extremes.shrinking = there.min(c.zero.sub(dj)).max(extremes.shrinking);

            // Corner (±, ±, ±) receives ±cx ±cy ±cz.
            let cx = [cof[0][0].mul(p), cof[1][0].mul(p), cof[2][0].mul(p)];
            let cy = [cof[0][1].mul(p), cof[1][1].mul(p), cof[2][1].mul(p)];
            let cz = [cof[0][2].mul(p), cof[1][2].mul(p), cof[2][2].mul(p)];
            let (same, opposite) = (plus(cy, cz), minus(cy, cz));
            for (r, row) in rows.into_iter().enumerate() {
                if !owned((row % SIDE) as isize, (row / SIDE) as isize) {
                    continue;
                }
                let sums = &mut s.rows[row].sums;
                // What the node ahead receives is subtracted from what is taken from it.
                match r {
                    0 => give::<L>(&mut sums.up, minus(same, cx)),
                    1 => take::<L>(&mut sums.up, plus(opposite, cx)),
                    2 => give::<L>(&mut sums.up, minus(opposite, cx)),
                    _ => take::<L>(&mut sums.up, plus(same, cx)),
                }
                if COLUMN == WHOLE {
                    match r {
                        0 => take::<L>(&mut sums.at, plus(same, cx)),
                        1 => give::<L>(&mut sums.at, minus(opposite, cx)),
                        2 => take::<L>(&mut sums.at, plus(opposite, cx)),
                        _ => give::<L>(&mut sums.at, minus(same, cx)),
                    }
                }
            }
        }
    }
}

/// One component's gradient in eight cells with corner rows `rows`: sums and differences along x, then along y and z.
#[inline(always)]
fn gradient<L: Lanes>(rows: [&Window<L::Real>; 4], shift: isize, c: &Constants<L>) -> [L; 3] {
    let [a, b, d, e] = [rows[0].at::<L>(shift), rows[1].at(shift), rows[2].at(shift), rows[3].at(shift)];
    let next = shift + 1;
    let [a1, b1, d1, e1] = [rows[0].at::<L>(next), rows[1].at(next), rows[2].at(next), rows[3].at(next)];
    let (sa, sb, sd, se) = (a.add(a1), b.add(b1), d.add(d1), e.add(e1));
    let dx = a1.sub(a).add(b1.sub(b)).add(d1.sub(d).add(e1.sub(e)));
    let dy = sb.sub(sa).add(se.sub(sd));
    let dz = sd.sub(sa).add(se.sub(sb));
    [dx.mul(c.inverse_4h), dy.mul(c.inverse_4h), dz.mul(c.inverse_4h)]
}
