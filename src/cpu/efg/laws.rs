//! The laws of regular cells, eight at a time.

use super::super::lanes::{Lanes, Octet, Real};
use super::super::nodes::BRICK_ROWS;
use super::gather::{CellRow, Corners, Law, Source};
use super::rows::{Place, Table};
use crate::math::Num;
use crate::model::efg::law::{Elasticity, HOURGLASS, Matrix, stress, stress_change, transform};
use crate::model::law::CellLaw;

/// Numbers of a cell's frame.
pub const MATRIX: usize = 9;

/// Moduli of the sixteen materials (0 is empty), each times a factor of its material.
#[derive(Clone, Debug)]
pub struct Moduli<R> {
    mu: [R; 16],
    lambda: [R; 16],
    hourglass: [R; 16],
    quarter_h2: f64,
    half_h: f64,
    inverse_4h: f64,
}

impl<R: Real> Moduli<R> {
    /// For cells of edge length `h`.
    pub fn new(laws: &[CellLaw; 16], h: f64, factor: impl Fn(&CellLaw) -> f64) -> Self {
        let table = |of: &dyn Fn(&CellLaw) -> f64| {
            std::array::from_fn(|material| R::splat(of(&laws[material]) * factor(&laws[material])))
        };
        Self {
            mu: table(&|law| law.shear_pa),
            lambda: table(&|law| law.lambda_pa),
            hourglass: table(&|law| HOURGLASS * law.shear_pa * h),
            quarter_h2: 0.25 * h * h,
            half_h: 0.5 * h,
            inverse_4h: 0.25 / h,
        }
    }
}

/// Nodes' vectors as they are.
pub struct Plain<R>(pub *const Octet<R>);

impl<L: Lanes> Source<L> for Plain<L::Real> {
    #[inline(always)]
    unsafe fn load(&self, octet: usize) -> L {
        // SAFETY: the caller's octet exists.
        unsafe { L::load(self.0.add(octet).cast()) }
    }

    #[inline(always)]
    unsafe fn number(&self, octet: usize, lane: usize) -> L::Real {
        // SAFETY: as above.
        unsafe { (*self.0.add(octet)).0[lane] }
    }
}

/// z + β p: the next direction of a conjugate gradient, before it is written anywhere.
pub struct Onward<R> {
    pub z: *const Octet<R>,
    pub p: *const Octet<R>,
    pub beta: f64,
}

impl<L: Lanes> Source<L> for Onward<L::Real> {
    #[inline(always)]
    unsafe fn load(&self, octet: usize) -> L {
        // SAFETY: the caller's octet exists in both fields.
        unsafe {
            L::load(self.p.add(octet).cast()).fma(L::splat(self.beta), L::load(self.z.add(octet).cast()))
        }
    }

    #[inline(always)]
    unsafe fn number(&self, octet: usize, lane: usize) -> L::Real {
        // SAFETY: as above.
        unsafe { (*self.p.add(octet)).0[lane].fma(L::Real::splat(self.beta), (*self.z.add(octet)).0[lane]) }
    }
}

/// The mean displacement gradient of eight cells, and the sums of their corners' components.
#[inline(always)]
pub fn gradient<L: Lanes>(u: &Corners<L, 3>, inverse_4h: L) -> (Matrix<L>, [L; 3]) {
    let mut sums = u[0][0];
    let mut g = [sums; 3];
    for c in 0..3 {
        let [a, b, d, e] = [u[0], u[1], u[2], u[3]];
        let (sa, sb) = (a[0][c].add(a[1][c]), b[0][c].add(b[1][c]));
        let (sd, se) = (d[0][c].add(d[1][c]), e[0][c].add(e[1][c]));
        let (xa, xb) = (a[1][c].sub(a[0][c]), b[1][c].sub(b[0][c]));
        let (xd, xe) = (d[1][c].sub(d[0][c]), e[1][c].sub(e[0][c]));
        g[c][0] = xa.add(xb).add(xd.add(xe)).mul(inverse_4h);
        g[c][1] = sb.sub(sa).add(se.sub(sd)).mul(inverse_4h);
        g[c][2] = sd.sub(sa).add(se.sub(sb)).mul(inverse_4h);
        sums[c] = sa.add(sb).add(sd.add(se));
    }
    (g, sums)
}

/// The forces on the corners of eight cells by stress and by what affine motion leaves: see [`crate::model::efg::law`].
#[inline(always)]
fn corner_forces<L: Lanes>(
    u: &Corners<L, 3>,
    g: &Matrix<L>,
    sums: [L; 3],
    stress: &Matrix<L>,
    hourglass: L,
    (half_h, quarter_h2): (L, L),
) -> Corners<L, 3> {
    let mut forces = *u;
    let pull = hourglass.mul(half_h);
    let zero = L::splat(0.0);
    for c in 0..3 {
        let (x, y, z) = (
            g[c][0].mul(pull).sub(stress[c][0].mul(quarter_h2)),
            g[c][1].mul(pull).sub(stress[c][1].mul(quarter_h2)),
            g[c][2].mul(pull).sub(stress[c][2].mul(quarter_h2)),
        );
        let mean = sums[c].mul(hourglass.mul(L::splat(0.125)));
        let (same, opposite) = (y.add(z), y.sub(z));
        let sides = [zero.sub(same), opposite, zero.sub(opposite), same];
        for (r, side) in sides.into_iter().enumerate() {
            let middle = mean.add(side);
            forces[r][0][c] = hourglass.take_from(u[r][0][c], middle.sub(x));
            forces[r][1][c] = hourglass.take_from(u[r][1][c], middle.add(x));
        }
    }
    forces
}

/// What cells know of their own frame: a rotation, the identity, or a deformation gradient.
#[inline(always)]
pub unsafe fn frame<L: Lanes>(frames: *const Octet<L::Real>, row: CellRow) -> Matrix<L> {
    let at = row.at(MATRIX);
    // SAFETY: the caller's row exists, and nobody writes it.
    let load = |n: usize| unsafe { L::load(frames.add(at + n * BRICK_ROWS).cast()) };
    [[load(0), load(1), load(2)], [load(3), load(4), load(5)], [load(6), load(7), load(8)]]
}

/// What a cell with a row of its own knows.
#[inline(always)]
unsafe fn row_frame<R: Copy>(frames: *const Matrix<R>, row: u32) -> Matrix<R> {
    // SAFETY: the caller's row exists, and nobody writes it.
    unsafe { *frames.add(row as usize) }
}

/// Inner forces.
pub struct Forces<'a, R> {
    pub moduli: &'a Moduli<R>,
    pub frames: *const Octet<R>,
    pub row_frames: *const Matrix<R>,
    pub elasticity: Elasticity,
}

impl<L: Lanes> Law<L, 3> for Forces<'_, L::Real> {
    #[inline(always)]
    unsafe fn give(&self, row: CellRow, materials: &[u8; 8], u: &Corners<L, 3>) -> Corners<L, 3> {
        let m = self.moduli;
        let (mu, lambda) = (L::look_up(&m.mu, materials), L::look_up(&m.lambda, materials));
        let (g, sums) = gradient(u, L::splat(m.inverse_4h));
        // SAFETY: as the caller promises.
        let stress = stress(self.elasticity, &unsafe { frame::<L>(self.frames, row) }, &g, mu, lambda);
        let lengths = (L::splat(m.half_h), L::splat(m.quarter_h2));
        corner_forces(u, &g, sums, &stress, L::look_up(&m.hourglass, materials), lengths)
    }

    unsafe fn give_one(&self, rows: &Table<L::Real>, place: Place, source: &impl Source<L>) -> [L::Real; 3] {
        let m = rows.cell(place.row).material as usize;
        let (mu, lambda) = (self.moduli.mu[m], self.moduli.lambda[m]);
        // SAFETY: as the caller promises.
        unsafe {
            let motion = rows.motion::<L>(place.row, source);
            let turned = row_frame(self.row_frames, place.row);
            let stress = stress(self.elasticity, &turned, &motion.gradient, mu, lambda);
            rows.force::<L>(place, source, &motion, &stress, self.moduli.hourglass[m])
        }
    }
}

/// How inner forces change with displacements, frames standing still.
pub struct Changes<'a, R> {
    pub moduli: &'a Moduli<R>,
    pub frames: *const Octet<R>,
    pub row_frames: *const Matrix<R>,
}

impl<L: Lanes> Law<L, 3> for Changes<'_, L::Real> {
    #[inline(always)]
    unsafe fn give(&self, row: CellRow, materials: &[u8; 8], u: &Corners<L, 3>) -> Corners<L, 3> {
        let m = self.moduli;
        let (mu, lambda) = (L::look_up(&m.mu, materials), L::look_up(&m.lambda, materials));
        let (g, sums) = gradient(u, L::splat(m.inverse_4h));
        // SAFETY: as the caller promises.
        let stress = stress_change(&unsafe { frame::<L>(self.frames, row) }, &g, mu, lambda);
        let lengths = (L::splat(m.half_h), L::splat(m.quarter_h2));
        corner_forces(u, &g, sums, &stress, L::look_up(&m.hourglass, materials), lengths)
    }

    unsafe fn give_one(&self, rows: &Table<L::Real>, place: Place, source: &impl Source<L>) -> [L::Real; 3] {
        let m = rows.cell(place.row).material as usize;
        let (mu, lambda) = (self.moduli.mu[m], self.moduli.lambda[m]);
        // SAFETY: as the caller promises.
        unsafe {
            let motion = rows.motion::<L>(place.row, source);
            let stress = stress_change(&row_frame(self.row_frames, place.row), &motion.gradient, mu, lambda);
            rows.force::<L>(place, source, &motion, &stress, self.moduli.hourglass[m])
        }
    }
}

/// The blocks on the diagonal of −[`Changes`], as xx, xy, xz, yy, yz, zz.
pub struct Diagonal<'a, R> {
    pub moduli: &'a Moduli<R>,
    pub frames: *const Octet<R>,
    pub row_frames: *const Matrix<R>,
}

/// Which components a block's numbers belong to.
const PAIRS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

impl<L: Lanes> Law<L, 6> for Diagonal<'_, L::Real> {
    #[inline(always)]
    unsafe fn give(&self, row: CellRow, materials: &[u8; 8], _: &Corners<L, 3>) -> Corners<L, 6> {
        let m = self.moduli;
        let (mu, lambda) = (L::look_up(&m.mu, materials), L::look_up(&m.lambda, materials));
        let hourglass = L::look_up(&m.hourglass, materials);
        // SAFETY: as the caller promises.
        let a = unsafe { frame::<L>(self.frames, row) };
        // Corner i moving by p makes G = p bᵀ, b = s / (4 h): the force −h³ A C:(Aᵀ p bᵀ) b, with t = A b,
        // is −h³ (μ |b|² A Aᵀ p + (λ + μ) t tᵀ p), and for a rotation A Aᵀ = I.
        let column = |k: usize| [a[0][k], a[1][k], a[2][k]];
        let (x, y, z) = (column(0), column(1), column(2));
        // h³ / (16 h²) = h / 16.
        let share = L::splat(m.half_h / 8.0);
        let (straight, along) = (mu.mul(share).mul(L::splat(3.0)), lambda.add(mu).mul(share));
        // One corner's own motion is its own mean by an eighth, and three parts of its gradient by an eighth each.
        let unseen = hourglass.mul(L::splat(0.5));
        let mut given = [[[L::splat(0.0); 6]; 2]; 4];
        for (n, (i, j)) in PAIRS.into_iter().enumerate() {
            let gram = x[i].fma(x[j], y[i].fma(y[j], z[i].mul(z[j])));
            let cross = |p: [L; 3], q: [L; 3]| p[i].fma(q[j], q[i].mul(p[j])).mul(along);
            let (xy, xz, yz) = (cross(x, y), cross(x, z), cross(y, z));
            let mut same = gram.mul(straight.add(along));
            if i == j {
                same = same.add(unseen);
            }
            // Signs of the products sx sy, sx sz, sy sz at the low end of each edge; sy sz is that of the edge.
            for r in 0..4 {
                let (up_y, up_z) = (r & 1 == 1, r >> 1 == 1);
                let middle = if up_y == up_z { same.add(yz) } else { same.sub(yz) };
                let signed = |term: L, up: bool| if up { term } else { L::splat(0.0).sub(term) };
                let ahead = signed(xy, up_y).add(signed(xz, up_z));
                given[r][0][n] = middle.sub(ahead);
                given[r][1][n] = middle.add(ahead);
            }
        }
        given
    }

    unsafe fn give_one(&self, rows: &Table<L::Real>, place: Place, _: &impl Source<L>) -> [L::Real; 6] {
        let (cell, entry) = (rows.cell(place.row), rows.entry(place));
        let m = cell.material as usize;
        let (mu, lambda) = (self.moduli.mu[m], self.moduli.lambda[m]);
        let dot = |a: [L::Real; 3], b: [L::Real; 3]| a[0].fma(b[0], a[1].fma(b[1], a[2].mul(b[2])));
        // SAFETY: as the caller promises.
        let a = unsafe { row_frame(self.row_frames, place.row) };
        // As for a corner above, with b = ∇φ.
        let t = transform(&a, entry.gradient);
        let straight = cell.volume.mul(mu).mul(dot(entry.gradient, entry.gradient));
        let along = cell.volume.mul(lambda.add(mu));
        let hold = self.moduli.hourglass[m].mul(cell.fill).mul(entry.share);
        let seen = entry.share.fma(dot(entry.arm, entry.arm), entry.share);
        let unseen = L::Real::splat(1.0).sub(seen);
        PAIRS.map(|(i, j)| {
            let block = straight.fma(dot(a[i], a[j]), along.mul(t[i].mul(t[j])));
            if i == j { hold.fma(unseen, block) } else { block }
        })
    }
}
