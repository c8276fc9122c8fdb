//! The largest stable substep of a model, from the highest frequency that it can swing at.
//!
//! Leapfrog is stable up to 2/ω. ω² is the largest eigenvalue of M⁻¹K, found by Lanczos iteration with the very forces of the kernel: a Ritz
//! value never exceeds it and comes within a percent in a few dozen products, whatever the anatomy. Damping with lagged velocities
//! shortens the step to (2/ω)(√(1 + z²) − z), z = β ω / 2.

/// Most products with M⁻¹K.
const MAX_PRODUCTS: usize = 120;
/// Relative change of the Ritz value over [`SETTLED`] products below which it counts as found.
const TOLERANCE: f64 = 2e-4;
/// Products over which that change is taken.
const SETTLED: usize = 5;

/// The highest angular frequency in rad/s.
///
/// `mass` is the mass of each degree of freedom, 0 where it is held; `product` replaces a displacement by M⁻¹K times it.
pub fn highest_frequency(mass: &[f64], mut product: impl FnMut(&mut [f64])) -> f64 {
    // With y = M^½ u the operator is symmetric, and Lanczos needs three vectors.
    let root: Vec<f64> = mass.iter().map(|m| m.sqrt()).collect();
    let mut y: Vec<f64> = (0..mass.len()).map(|i| if mass[i] > 0.0 { start(i) } else { 0.0 }).collect();
    if normalise(&mut y).is_none() {
        return 0.0;
    }
    let mut beta = 0.0;
    let mut before = vec![0.0; y.len()];
    let (mut diagonal, mut side) = (Vec::new(), Vec::new());
    let mut ritz: Vec<f64> = Vec::new();

    for _ in 0..MAX_PRODUCTS {
        let mut w: Vec<f64> = y.iter().zip(&root).map(|(y, r)| if *r > 0.0 { y / r } else { 0.0 }).collect();
        product(&mut w);
        w.iter_mut().zip(&root).for_each(|(w, r)| *w *= r);
        let alpha: f64 = w.iter().zip(&y).map(|(w, y)| w * y).sum();
        for i in 0..w.len() {
            w[i] -= alpha * y[i] + beta * before[i];
        }
        diagonal.push(alpha);
        ritz.push(largest_eigenvalue(&diagonal, &side));

        let found = ritz.len() > SETTLED && {
            let (now, then) = (ritz[ritz.len() - 1], ritz[ritz.len() - 1 - SETTLED]);
            (now - then).abs() <= TOLERANCE * now
        };
        before = y;
        y = w;
        match normalise(&mut y) {
            Some(norm) if !found => beta = norm,
            _ => break,
        }
        side.push(beta);
    }
    ritz.last().copied().unwrap_or(0.0).max(0.0).sqrt()
}

/// The highest frequency in rad/s that a stable step allows: [`stable_dt`] the other way round.
pub fn highest_omega(stable_dt: f64, damping_s: f64) -> f64 {
    1.0 / (0.25 * stable_dt * stable_dt + 0.5 * stable_dt * damping_s).sqrt()
}

/// The largest stable step in s for a highest frequency in rad/s and stiffness-proportional damping in s.
pub fn stable_dt(omega: f64, damping_s: f64) -> f64 {
    if omega <= 0.0 {
        return f64::INFINITY;
    }
    let z = 0.5 * damping_s * omega;
    2.0 / omega * ((1.0 + z * z).sqrt() - z)
}

/// How much of the stable step at rest remains at a strain, where `strain` is the largest |1 − L / l| and `poisson` the largest
/// Poisson's ratio. Interpolates below limits measured on uniaxially stretched lattices, the worse of tension and compression.
pub fn strain_factor(strain: f64, poisson: f64) -> f64 {
    // Compression to .9, .8, .7, .6 of the length for ν = .45, .49; tension to 1.2 and 1.5 is worse for ν = .25.
    const STRAIN: [f64; 5] = [0.0, 0.111, 0.25, 0.4286, 0.6667];
    const FACTOR: [(f64, [f64; 5]); 3] = [
        (0.25, [1.0, 0.94, 0.89, 0.83, 0.76]),
        (0.45, [1.0, 0.94, 0.88, 0.82, 0.75]),
        (0.49, [1.0, 0.91, 0.82, 0.72, 0.63]),
    ];
    let at = |row: &[f64; 5]| {
        let i = (1..4).find(|&i| strain < STRAIN[i]).unwrap_or(4);
        let t = ((strain - STRAIN[i - 1]) / (STRAIN[i] - STRAIN[i - 1])).clamp(0.0, 1.5);
        row[i - 1] + t * (row[i] - row[i - 1])
    };
    let i = (1..2).find(|&i| poisson < FACTOR[i].0).unwrap_or(2);
    let t = ((poisson - FACTOR[i - 1].0) / (FACTOR[i].0 - FACTOR[i - 1].0)).clamp(0.0, 1.2);
    at(&FACTOR[i - 1].1) + t * (at(&FACTOR[i].1) - at(&FACTOR[i - 1].1))
}

/// A fixed start vector without symmetry: the fractional parts of multiples of the golden ratio.
fn start(i: usize) -> f64 {
    (i as f64 * 0.618_033_988_749_895).fract() - 0.5
}

/// Scales to length 1 and gives the former length; `None` where that is 0.
fn normalise(y: &mut [f64]) -> Option<f64> {
    let norm = y.iter().map(|y| y * y).sum::<f64>().sqrt();
    if norm.is_nan() || norm < 1e-200 {
        return None;
    }
    y.iter_mut().for_each(|y| *y /= norm);
    Some(norm)
}

/// Largest eigenvalue of a symmetric tridiagonal matrix, by bisection on the number of eigenvalues above a value.
fn largest_eigenvalue(diagonal: &[f64], side: &[f64]) -> f64 {
    let n = diagonal.len();
    let reach = |i: usize| {
        let (left, right) =
            (if i > 0 { side[i - 1].abs() } else { 0.0 }, if i + 1 < n { side[i].abs() } else { 0.0 });
        (diagonal[i] - left - right, diagonal[i] + left + right)
    };
    let (mut low, mut high) =
        (0..n).map(reach).fold((f64::INFINITY, f64::NEG_INFINITY), |b, r| (b.0.min(r.0), b.1.max(r.1)));
    let has_above = |x: f64| {
        let mut d = diagonal[0] - x;
        let mut above = d > 0.0;
        for i in 1..n {
            let pivot = if d == 0.0 { f64::MIN_POSITIVE } else { d };
            d = diagonal[i] - x - side[i - 1] * side[i - 1] / pivot;
            above |= d > 0.0;
        }
        above
    };
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if has_above(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn highest_frequency_of_a_chain_is_the_analytic_one() {
        // Fixed-fixed chain of unit masses and springs: ω = 2 sin(n π / (2 (n + 1))).
        let n = 200;
        let omega = highest_frequency(&vec![1.0; n], |u| {
            let old = u.to_vec();
            for i in 0..n {
                let left = if i > 0 { old[i - 1] } else { 0.0 };
                let right = if i + 1 < n { old[i + 1] } else { 0.0 };
                u[i] = 2.0 * old[i] - left - right;
            }
        });
        let expected = 2.0 * (n as f64 * std::f64::consts::PI / (2.0 * (n as f64 + 1.0))).sin();
        assert!(omega <= expected * (1.0 + 1e-12) && omega > 0.995 * expected, "{omega} against {expected}");
    }

    #[test]
    fn strain_shortens_the_step_and_rest_does_not() {
        for poisson in [0.25, 0.4, 0.45, 0.49, 0.499] {
            assert!((strain_factor(0.0, poisson) - 1.0).abs() < 1e-12);
            let mut last = 1.0;
            for i in 1..20 {
                let factor = strain_factor(0.05 * f64::from(i), poisson);
                assert!(factor <= last && factor > 0.2, "{factor} at {i}, ν = {poisson}");
                last = factor;
            }
        }
    }

    #[test]
    fn damping_shortens_the_step_as_lagged_velocities_demand() {
        assert_eq!(stable_dt(100.0, 0.0), 0.02);
        // z = 1: 2/ω (√2 − 1).
        assert!((stable_dt(100.0, 0.02) - 0.02 * (2.0_f64.sqrt() - 1.0)).abs() < 1e-15);
        for damping in [0.0, 0.02] {
            assert!((highest_omega(stable_dt(100.0, damping), damping) - 100.0).abs() < 1e-9);
        }
    }
}
