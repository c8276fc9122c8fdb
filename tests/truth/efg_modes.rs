//! Natural frequencies and zero-energy modes of the meshless model, from its own forces.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::{DMatrix, SymmetricEigen};
use palpate::cpu::efg::solver::EfgSolver;
use palpate::math::Vec3;
use palpate::model::Model;
use palpate::model::lattice::flag;
use palpate::solver::Solver;
use palpate::solver::method::{EfgDesc, Elasticity};

use super::elastic::cantilever;
use super::scene::{Noise, block, exact, hold, material, roller};
use super::tolerance::{self as tol, Claim};
use super::waves::timoshenko_frequency;

const H: f64 = 0.01;
const YOUNG: f64 = 1e4;
const DENSITY: f64 = 1000.0;

/// Stiffness within a band along the diagonal, and masses, of what is free to move.
struct Stiffness {
    mass: Vec<f64>,
    band: usize,
    /// Entries left of the diagonal and on it, `[row][band + 1]`; the diagonal is the last.
    lower: Vec<f64>,
}

impl Stiffness {
    /// Found by moving nodes: as many at once as share no neighbour.
    fn of(model: &Arc<Model>) -> Self {
        let lattice = model.lattice();
        let desc = EfgDesc { elasticity: Elasticity::Linear, ..EfgDesc::default() };
        let mut solver = EfgSolver::<f64>::new(model, &desc, 1, 0).unwrap();
        let mut nodes: Vec<[usize; 3]> = lattice.slots().map(|slot| lattice.node_of(slot)).collect();
        nodes.sort_unstable();
        let (mut number, mut mass) = (HashMap::new(), Vec::new());
        for &node in &nodes {
            let slot = lattice.slot(node).unwrap();
            for axis in 0..3 {
                if lattice.flags()[slot as usize] & (flag::FIX_X << axis) == 0 {
                    number.insert((node, axis), mass.len());
                    mass.push(lattice.node_mass(slot, |m| model.laws()[usize::from(m)].corner_kg));
                }
            }
        }
        // The nodes after a node are at most one further along each axis.
        let [_, ny, nz] = lattice.cells().map(|n| n + 1);
        let band = 3 * ((ny + 1) * nz + 2);
        let mut lower = vec![0.0; mass.len() * (band + 1)];
        for colour in 0..27 {
            let colour = [colour % 3, colour / 3 % 3, colour / 9];
            let moved = |node: [usize; 3]| (0..3).all(|a| node[a] % 3 == colour[a]);
            for axis in 0..3 {
                for &node in nodes.iter().filter(|&&node| moved(node)) {
                    let is_free = number.contains_key(&(node, axis));
                    let way = if is_free { Vec3::ith(axis, 1.0) } else { Vec3::zeros() };
                    solver.set_node(lattice.slot(node).unwrap(), way, Vec3::zeros());
                }
                let accelerations = solver.accelerations();
                for (&(node, along), &row) in &number {
                    // The one node of this colour that is at most one away along each axis.
                    let near = [0, 1, 2].map(|a| (node[a] + 1).wrapping_sub((node[a] + 4 - colour[a]) % 3));
                    let Some(&column) = number.get(&(near, axis)) else { continue };
                    if column <= row {
                        let slot = lattice.slot(node).unwrap();
                        lower[row * (band + 1) + band - (row - column)] =
                            -mass[row] * accelerations[slot as usize][along];
                    }
                }
                for &node in nodes.iter().filter(|&&node| moved(node)) {
                    solver.set_node(lattice.slot(node).unwrap(), Vec3::zeros(), Vec3::zeros());
                }
            }
        }
        Self { mass, band, lower }
    }

    fn full(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.mass.len(), self.mass.len(), |i, j| {
            let (row, left) = (i.max(j), i.abs_diff(j));
            if left > self.band { 0.0 } else { self.lower[row * (self.band + 1) + self.band - left] }
        })
    }

    /// The Cholesky factor of K + σ M, in the same places.
    fn factor(&self, sigma: f64) -> Vec<f64> {
        let (band, width) = (self.band, self.band + 1);
        let mut l = self.lower.clone();
        for row in 0..self.mass.len() {
            l[row * width + band] += sigma * self.mass[row];
            for column in row.saturating_sub(band)..=row {
                let first = row.saturating_sub(band).max(column.saturating_sub(band));
                let (a, b) = (row * width + band - row, column * width + band - column);
                let known: f64 = (first..column).map(|k| l[a + k] * l[b + k]).sum();
                let left = l[a + column] - known;
                l[a + column] = if column == row { left.sqrt() } else { left / l[b + column] };
            }
        }
        l
    }

    /// The lowest `count` values of ω², by iteration on a subspace with K + σ M.
    fn lowest(&self, count: usize, sigma: f64) -> Vec<f64> {
        let (n, width, size) = (self.mass.len(), self.band + 1, count + 6);
        let l = self.factor(sigma);
        let mut noise = Noise(17);
        let mut x: Vec<Vec<f64>> = (0..size).map(|_| (0..n).map(|_| noise.next()).collect()).collect();
        let mut found = Vec::new();
        for _ in 0..12 {
            let pushed: Vec<Vec<f64>> =
                x.iter().map(|x| x.iter().zip(&self.mass).map(|(x, m)| x * m).collect()).collect();
            let y: Vec<Vec<f64>> = pushed
                .iter()
                .map(|f| {
                    let mut y = f.clone();
                    for row in 0..n {
                        let a = row * width + self.band - row;
                        let known: f64 = (row.saturating_sub(self.band)..row).map(|k| l[a + k] * y[k]).sum();
                        y[row] = (y[row] - known) / l[a + row];
                    }
                    for row in (0..n).rev() {
                        let a = row * width + self.band - row;
                        y[row] /= l[a + row];
                        for k in row.saturating_sub(self.band)..row {
                            y[k] -= l[a + k] * y[row];
                        }
                    }
                    y
                })
                .collect();
            // Rayleigh and Ritz: K + σ M and M between the vectors found, of which the former gives back what was pushed with.
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let stiff = DMatrix::from_fn(size, size, |i, j| dot(&y[i], &pushed[j]));
            let heavy: DMatrix<f64> = DMatrix::from_fn(size, size, |i, j| {
                y[i].iter().zip(&y[j]).zip(&self.mass).map(|((a, b), m)| a * b * m).sum()
            });
            let root: DMatrix<f64> = heavy.cholesky().expect("vectors are independent").l();
            let inverse: DMatrix<f64> = root.try_inverse().expect("as above");
            let symmetric: DMatrix<f64> = (&stiff + stiff.transpose()) * 0.5;
            let reduced: DMatrix<f64> = &inverse * symmetric * inverse.transpose();
            let SymmetricEigen { eigenvalues, eigenvectors } = reduced.symmetric_eigen();
            let mix: DMatrix<f64> = inverse.transpose() * eigenvectors;
            x = (0..size)
                .map(|mode| (0..n).map(|i| (0..size).map(|j| y[j][i] * mix[(j, mode)]).sum()).collect())
                .collect();
            found = eigenvalues.iter().map(|value| value - sigma).collect();
            found.sort_by(f64::total_cmp);
        }
        found.truncate(count);
        found
    }
}

/// Stiffness of a free block of cubes with trilinear displacements and eight points in each cell, as any finite element code has it.
fn hexahedra(cells: usize, h: f64, mu: f64, lambda: f64) -> DMatrix<f64> {
    let sign = |n: usize| Vec3::from_fn(|a, _| if n >> a & 1 == 1 { 1.0 } else { -1.0 });
    let slope = |point: usize, corner: usize| {
        let (at, s) = (sign(point) / 3.0_f64.sqrt(), sign(corner));
        let along = |a: usize| 1.0 + s[a] * at[a];
        Vec3::from_fn(|a, _| s[a] * along((a + 1) % 3) * along((a + 2) % 3) / (4.0 * h))
    };
    let side = cells + 1;
    let mut k = DMatrix::zeros(3 * side.pow(3), 3 * side.pow(3));
    for cell in 0..cells.pow(3) {
        let low = [cell % cells, cell / cells % cells, cell / (cells * cells)];
        let node =
            |c: usize| low[0] + (c & 1) + side * (low[1] + (c >> 1 & 1) + side * (low[2] + (c >> 2 & 1)));
        for point in 0..8 {
            for (a, b) in (0..8).flat_map(|a| (0..8).map(move |b| (a, b))) {
                let (p, q) = (slope(point, a), slope(point, b));
                for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
                    let straight = if i == j { mu * p.dot(&q) } else { 0.0 };
                    k[(3 * node(a) + i, 3 * node(b) + j)] +=
                        (straight + lambda * p[i] * q[j] + mu * p[j] * q[i]) * h.powi(3) / 8.0;
                }
            }
        }
    }
    k
}

#[test]
fn a_block_has_six_modes_without_energy_and_no_more() {
    for poisson in [0.3, 0.49] {
        let tissue = material(YOUNG, poisson, DENSITY);
        let (mu, lambda) = (tissue.shear_modulus_pa(), tissue.lame_lambda_pa());
        let model = Arc::new(block([4; 3], H, tissue).run(&mut |_, _| true).unwrap());
        let sorted = |k: DMatrix<f64>| {
            let mut values: Vec<f64> = k.symmetric_eigenvalues().iter().copied().collect();
            values.sort_by(f64::total_cmp);
            values
        };
        // One point in each cell and nothing else would leave 51 more.
        let elastic = sorted(hexahedra(4, H, mu, lambda))[6];
        let found = sorted(Stiffness::of(&model).full());
        let weak = found.iter().filter(|value| **value < 1e-3 * elastic).count();
        assert_eq!(weak, 6, "nu {poisson}: {:?} of {elastic}", &found[..8]);
        assert!(found[6] > 0.5 * elastic, "nu {poisson}: {} of {elastic}", found[6]);
    }
}

#[test]
fn a_cantilever_swings_at_the_frequency_of_timoshenko() {
    let mut claim = Claim::new("EFG bending frequency");
    for poisson in [0.25, 0.45, 0.49] {
        let expected = timoshenko_frequency(poisson);
        for cells in [4, 8] {
            let body = cantilever(cells, poisson, &exact());
            let found = Stiffness::of(body.sim.model()).lowest(1, 0.0)[0].sqrt();
            let name = format!("nu {poisson}, {cells} cells, ratio {:.4}", found / expected);
            let limit = if cells == 8 { tol::EFG_FREQUENCY_8 } else { tol::EFG_FREQUENCY_4 };
            claim.check(limit, &name, found / expected - 1.0);
        }
    }
}

/// How the edges of a plate are held.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Edges {
    /// Vertically, along the lines where they meet the lower side.
    Lines,
    /// As plate theory has it: the whole sides vertically and along themselves.
    Sides,
}

/// The lowest frequencies in Hz of a plate of 10 × 10 × 1 m with E = 200 GPa, ν = 0.3, ρ = 8000 kg/m³, computed on a smaller and softer one: of those
/// modes that are odd or even about the two planes that cut it into quarters.
fn plate(edges: Edges, odd: [bool; 2]) -> Vec<f64> {
    let (cells, thick) = (20, 4);
    let edge = cells as f64 * H;
    let scale = 10.0 / (2.0 * edge) * (YOUNG / DENSITY / (200e9 / 8000.0)).sqrt();
    let mut build = block([cells, cells, thick], H, material(YOUNG, 0.3, DENSITY));
    for axis in 0..2 {
        if odd[axis] {
            let flat = |side: f64| Vec3::from_fn(|a, _| if a == axis { 0.0 } else { side });
            hold(&mut build, flat(-1.0), flat(1.0), std::array::from_fn(|a| a != axis));
        } else {
            roller(&mut build, axis);
        }
        let top = if edges == Edges::Sides { 1.0 } else { 0.0 };
        let at = |side: f64, z: f64| {
            Vec3::from_fn(|a, _| {
                if a == axis {
                    edge
                } else if a == 2 {
                    z
                } else {
                    side
                }
            })
        };
        let axes = std::array::from_fn(|a| a == 2 || (a == 1 - axis && edges == Edges::Sides));
        hold(&mut build, at(-1.0, 0.0), at(1.0, top), axes);
    }
    let model = Arc::new(build.run(&mut |_, _| true).unwrap());
    let found = Stiffness::of(&model).lowest(3, (2.0 * PI * 20.0 * scale).powi(2));
    found.iter().map(|omega2| omega2.max(0.0).sqrt() / (2.0 * PI) / scale).collect()
}

// NAFEMS's plate FV52 stands on lines. In three dimensions a plate sinks into a line, the further the finer the cells are: quadratic hexahedra of the
// same size give 43.1 Hz where the benchmark, by plate theory, has 45.897. So bending is compared on edges that are held as in plate theory.
#[test]
fn a_thick_plate_swings_at_the_frequencies_of_nafems_fv52() {
    let mut claim = Claim::new("EFG plate");
    let [even, mixed, odd] = [[false, false], [true, false], [true, true]];
    for (name, found, expected) in [
        ("1", plate(Edges::Sides, even)[0], 45.897),
        ("2 and 3", plate(Edges::Sides, mixed)[0], 109.44),
        ("4", plate(Edges::Sides, odd)[0], 167.89),
    ] {
        claim.check(tol::PLATE, &format!("mode {name}, {found:.3} Hz"), found / expected - 1.0);
    }
    // On lines it is free to move in its plane: two translations, one of each mixed kind, and a turn; then it swings there.
    let (mixed, odd) = (plate(Edges::Lines, mixed), plate(Edges::Lines, odd));
    assert!(mixed[0] < 0.01 && odd[0] < 0.01, "rigid modes: {mixed:?}, {odd:?}");
    claim.check(tol::PLATE, &format!("mode 5, {:.3} Hz", odd[2]), odd[2] / 193.59 - 1.0);
    claim.check(tol::PLATE, &format!("modes 6 and 7, {:.3} Hz", mixed[2]), mixed[2] / 206.19 - 1.0);
}
