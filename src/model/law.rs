//! The laws of the lattice: what a spring and a cell's volume do. Written once, for a single number or a vector register.
//!
//!
#![doc = include_str!("../../docs/lattice.md")]

use super::material::Material;
use crate::math::Num;

/// What a cell of one material contributes, in SI units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CellLaw {
    /// Stiffness of the cell's share of an edge or face-diagonal spring, κ/4, in N/m. A body diagonal has ¾ of it.
    pub spring_n_m: f64,
    /// (λ − μ) h² / 4, in N: the volume force on a corner is minus this times (J − 1) cof F · (±1, ±1, ±1).
    pub volume_n: f64,
    /// An eighth of the cell's mass, in kg.
    pub corner_kg: f64,
    /// Stiffness-proportional damping β, in s.
    pub damping_s: f64,
    /// Shear modulus μ in Pa; 0 of what is rigid.
    pub shear_pa: f64,
    /// Lamé's λ in Pa; 0 of what is rigid.
    pub lambda_pa: f64,
}

impl CellLaw {
    /// The calibrated cell of a material with edge length `h` in metres.
    pub fn of(material: &Material, h: f64) -> Self {
        let (mu, lambda) = (material.shear_modulus_pa(), material.lame_lambda_pa());
        Self {
            spring_n_m: mu * h / 0.75 / 4.0,
            volume_n: (lambda - mu) * h * h / 4.0,
            corner_kg: material.density_kg_m3 * h * h * h / 8.0,
            damping_s: material.damping_s,
            shear_pa: mu,
            lambda_pa: lambda,
        }
    }

    /// A rigid cell: it has a mass, and pushes through the nodes that hold it alone.
    pub fn rigid(material: &Material, h: f64) -> Self {
        let corner_kg = Self::of(material, h).corner_kg;
        Self { corner_kg, ..Self::default() }
    }
}

/// The largest damping among the cells of all materials, in s.
pub fn most_damping(laws: &[CellLaw; 16]) -> f64 {
    laws.iter().map(|law| law.damping_s).fold(0.0, f64::max)
}

/// A spring's direction class: along an edge, a face diagonal or a body diagonal of a cell.
///
/// Body diagonals have a share of w = ¾ of a cell's stiffness, all others w = 1.
#[derive(Clone, Copy, Debug)]
pub struct SpringClass<N> {
    /// L² / w in m², for the rest length L.
    length2: N,
    /// L / √w in m.
    length: N,
    /// 1 / w.
    inverse_share: N,
    /// |l|² − L² of the shortest length that is told apart from none, a thousandth of L, in m².
    shortest: N,
    /// w / L², by which a damper's rate l · dv becomes relative.
    pub damping: N,
}

impl<N: Num> SpringClass<N> {
    /// The class with `diagonal` = 1, 2 or 3 non-zero grid components, for edge length `h`.
    pub fn new(diagonal: u32, h: f64) -> Self {
        let length2 = f64::from(diagonal) * h * h;
        let share = if diagonal == 3 { 0.75 } else { 1.0 };
        Self {
            length2: N::splat(length2 / share),
            length: N::splat((length2 / share).sqrt()),
            inverse_share: N::splat(1.0 / share),
            shortest: N::splat((1e-6 - 1.0) * length2),
            damping: N::splat(share / length2),
        }
    }

    /// w (1 − L/|l|) from `e` = |l|² − L², without cancellation: with q = |l|² / w it is e / (q + L √(q / w)). Finite at any length: a spring whose ends meet has no
    /// direction, and where there is none at all, between a node and an empty place, ends do meet.
    #[inline(always)]
    pub fn elongation(&self, e: N) -> N {
        let e = e.max(self.shortest);
        let q = e.fma(self.inverse_share, self.length2);
        e.div(self.length.fma(q.sqrt(), q))
    }

    /// w (|l| − L)² from `e` = |l|² − L², without cancellation.
    pub fn squared_stretch(&self, e: N) -> N {
        let stretch = e.div(e.fma(self.inverse_share, self.length2).sqrt().add(self.length));
        stretch.mul(stretch)
    }
}

/// Share of a cell's volume below which a piece of it is a sliver.
const SLIVER: f64 = 0.1;
/// How fast the thinnest sliver's nodes come to move alike, over √(k / m) of its cell's springs and corners: a tenth in a stable step.
const SLIVER_RATE: f64 = 0.2;

/// Damping in N s / m of each node of a piece of `share` of a cell against the mean of all eight, by the cell's spring constant and the mass of its corner.
/// A sliver hangs on nodes of far heavier pieces, and what those do to it would fling its own nodes about; it has next to no part in anything else.
#[inline(always)]
pub fn sliver_damping<N: Num>(spring: N, corner: N, share: N) -> N {
    let thin = N::splat(1.0).sub(share.mul(N::splat(1.0 / SLIVER))).max(N::splat(0.0));
    N::splat(SLIVER_RATE).mul(spring.mul(corner).sqrt()).mul(share).mul(thin.mul(thin))
}

/// |l|² − L² of a spring whose ends moved apart by `d`: 2 r·d + d·d, with `rd` = r·d / h (a signed sum of components) and
/// `h2` = 2 h; or both of opposite sign.
#[inline(always)]
pub fn squared_change<N: Num>(d: [N; 3], rd: N, h2: N) -> N {
    rd.fma(h2, d[0].fma(d[0], d[1].fma(d[1], d[2].mul(d[2]))))
}

/// a d − b c.
#[inline(always)]
fn minor<N: Num>(a: N, d: N, b: N, c: N) -> N {
    a.mul(d).sub(b.mul(c))
}

/// Cofactor matrix and J − 1 of F = I + G, from the displacement gradient `g[row][column]`, without the cancellation of det F − 1.
#[inline(always)]
pub fn volume_change<N: Num>(g: [[N; 3]; 3]) -> ([[N; 3]; 3], N) {
    let one = N::splat(1.0);
    let f = [
        [g[0][0].add(one), g[0][1], g[0][2]],
        [g[1][0], g[1][1].add(one), g[1][2]],
        [g[2][0], g[2][1], g[2][2].add(one)],
    ];
    let cof = [
        [
            minor(f[1][1], f[2][2], f[1][2], f[2][1]),
            minor(f[1][2], f[2][0], f[1][0], f[2][2]),
            minor(f[1][0], f[2][1], f[1][1], f[2][0]),
        ],
        [
            minor(f[0][2], f[2][1], f[0][1], f[2][2]),
            minor(f[0][0], f[2][2], f[0][2], f[2][0]),
            minor(f[0][1], f[2][0], f[0][0], f[2][1]),
        ],
        [
            minor(f[0][1], f[1][2], f[0][2], f[1][1]),
            minor(f[0][2], f[1][0], f[0][0], f[1][2]),
            minor(f[0][0], f[1][1], f[0][1], f[1][0]),
        ],
    ];

    // J − 1 = tr G + (second-order minors of G) + det G, summed from the smallest terms.
    let cof_g0 = [
        minor(g[1][1], g[2][2], g[1][2], g[2][1]),
        minor(g[1][2], g[2][0], g[1][0], g[2][2]),
        minor(g[1][0], g[2][1], g[1][1], g[2][0]),
    ];
    let det = g[0][0].fma(cof_g0[0], g[0][1].fma(cof_g0[1], g[0][2].mul(cof_g0[2])));
    let second = cof_g0[0]
        .add(minor(g[0][0], g[2][2], g[0][2], g[2][0]))
        .add(minor(g[0][0], g[1][1], g[0][1], g[1][0]));
    let trace = g[0][0].add(g[1][1]).add(g[2][2]);
    (cof, trace.add(second.add(det)))
}
