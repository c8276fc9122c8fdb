//! Vectors and rotations.

use nalgebra::Quaternion;

use super::{Case, Laws, rounded};
use crate::math::{Quat, Vec3};
use crate::noise::Noise;

/// How many inputs each law gets, at each size.
const COUNT: usize = 200;
/// Sizes of vectors: from a micrometre to far away, and none.
const SIZES: [f64; 5] = [0.0, 1e-6, 1e-3, 1.0, 1e3];
/// More than the sum of the magnitudes in a rotated vector of length 1: v + 2 w (q × v) + q × (2 q × v).
pub const ROTATED: f64 = 6.5;
/// Roundings in each: three for 2 q × v, two for the product with it, and two for the sums.
pub const ROTATING: u32 = 7;

/// A vector of single precision with components up to `size`.
pub fn vector(noise: &mut Noise, size: f64) -> Vec3 {
    Vec3::from_fn(|_, _| f64::from((size * noise.next()) as f32))
}

/// A rotation that single precision holds, and which is of length 1 as nearly as that allows.
pub fn turn(noise: &mut Noise) -> Quat {
    let any = Quat::from_scaled_axis(vector(noise, 3.0));
    Quat::new_unchecked(any.coords.map(|x| f64::from(x as f32)).into())
}

/// As a law takes it: nothing is rounded.
pub fn numbers<'a>(values: impl IntoIterator<Item = &'a f64>) -> Vec<f32> {
    values.into_iter().map(|x| *x as f32).collect()
}

fn components(q: &Quaternion<f64>) -> [f64; 4] {
    q.coords.into()
}

/// Cases of a law of two vectors.
fn of_pairs<const N: usize>(
    seed: u64,
    mut twin: impl FnMut(Vec3, Vec3) -> ([f64; N], [f64; N]),
) -> Vec<Case<N>> {
    let mut noise = Noise(seed);
    let sizes = SIZES.iter().flat_map(|size| [*size; COUNT]);
    sizes
        .map(|size| {
            let (a, b) = (vector(&mut noise, size), vector(&mut noise, 1.0));
            let (expected, tolerance) = twin(a, b);
            Case { input: numbers(a.iter().chain(&b)), expected, tolerance }
        })
        .collect()
}

/// Once rounded.
fn once(v: Vec3) -> ([f64; 3], [f64; 3]) {
    (v.into(), v.map(|x| rounded(1, x.abs())).into())
}

#[test]
fn sums_and_products_of_vectors_are_right_to_their_roundings() {
    let Some(laws) = Laws::compiled() else { return };
    laws.check("Vec operator+", &of_pairs(1, |a, b| once(a + b)));
    laws.check("Vec operator-", &of_pairs(2, |a, b| once(a - b)));
    let dot = |a: Vec3, b: Vec3| ([a.dot(&b)], [rounded(3, a.abs().dot(&b.abs()))]);
    laws.check("float dot", &of_pairs(3, dot));
    let cross = |a: Vec3, b: Vec3| {
        let (p, q) = (a.abs(), b.abs());
        let scale = Vec3::from_fn(|i, _| p[(i + 1) % 3] * q[(i + 2) % 3] + p[(i + 2) % 3] * q[(i + 1) % 3]);
        (a.cross(&b).into(), scale.map(|x| rounded(2, x)).into())
    };
    laws.check("Vec cross", &of_pairs(4, cross));

    let scaled = of_pairs(5, |a, b| once(a * b.x));
    let scaled = scaled.into_iter().map(|case| Case { input: case.input[..4].to_vec(), ..case });
    laws.check("Vec operator*", &scaled.collect::<Vec<_>>());
    // The root halves what three roundings do to the square.
    let norm = of_pairs(6, |a, _| ([a.norm()], [rounded(3, a.norm())]));
    let norm = norm.into_iter().map(|case| Case { input: case.input[..3].to_vec(), ..case });
    laws.check("float norm", &norm.collect::<Vec<_>>());
}

#[test]
fn a_number_is_clamped_to_a_range() {
    let Some(laws) = Laws::compiled() else { return };
    let clamped =
        [[-3.0_f32, -1.0, 2.0], [0.5, -1.0, 2.0], [3.0, -1.0, 2.0], [3.0, 0.0, 0.0], [-1.0, -1.0, 1.0]].map(
            |[x, low, high]| Case {
                input: vec![x, low, high],
                expected: [f64::from(x.clamp(low, high))],
                tolerance: [0.0],
            },
        );
    laws.check("float clamp", &clamped);
}

#[test]
fn rotations_turn_and_combine_as_on_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(7);
    let turned: Vec<_> = SIZES
        .iter()
        .flat_map(|size| [*size; COUNT])
        .map(|size| {
            let (q, v) = (turn(&mut noise), vector(&mut noise, size));
            Case {
                input: numbers(q.coords.iter().chain(&v)),
                expected: (q * v).into(),
                tolerance: [rounded(ROTATING, ROTATED * v.norm()); 3],
            }
        })
        .collect();
    laws.check("Vec rotate", &turned);

    let mut conjugates = Vec::new();
    let mut products = Vec::new();
    for _ in 0..COUNT {
        let (a, b) = (turn(&mut noise), turn(&mut noise));
        conjugates.push(Case {
            input: numbers(&a.coords),
            expected: components(&a.inverse()),
            tolerance: [0.0; 4],
        });
        products.push(Case {
            input: numbers(a.coords.iter().chain(&b.coords)),
            expected: components(&(a * b)),
            // Four products and three sums; together they are no longer than the factors.
            tolerance: [rounded(4, a.norm() * b.norm()); 4],
        });
    }
    laws.check("Quat conjugate", &conjugates);
    laws.check("Quat operator*", &products);
}

#[test]
fn a_rotation_vector_becomes_the_processors_quaternion() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(8);
    let case = |v: Vec3| {
        let half = 0.5 * v.norm();
        // A length, what it does to the sine, the sine itself to a unit in the last place, and three more.
        let axis = rounded(10, half);
        Case {
            input: numbers(&v),
            expected: components(&Quat::from_scaled_axis(v)),
            tolerance: [axis, axis, axis, rounded(3, half) + rounded(2, 1.0)],
        }
    };
    // On both sides of where the sine's quotient is replaced by its limit, and up to more than a full turn.
    let angles = [1e-8, 5e-7, 2e-6, 1e-3, 5e-3, 1.0, 4.0].iter().flat_map(|size| [*size; COUNT]);
    let mut cases: Vec<_> = angles.map(|size| case(vector(&mut noise, size))).collect();
    cases.push(Case { tolerance: [0.0; 4], ..case(Vec3::zeros()) });
    laws.check("Quat turn_by", &cases);
}
