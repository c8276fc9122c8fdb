//! Cells of the meshless model. These laws are templates: in double precision they answer as their twins to the last digit of single, in which they are asked and
//! answer here.

use super::{Case, Laws, rounded};
use crate::math::{Mat3, Quat, Vec3};
use crate::model::efg::law::{
    Matrix, corotated_strain, corotated_stress, deformation, green_strain, hooke, product, rotation_matrix,
    stress_change, transposed_product, turn_towards,
};
use crate::noise::Noise;

/// What double precision's roundings do to sums of terms of this size.
const LEFT: f64 = 1e-13;

/// A case with one rounding to single precision at the end; no term on the way is larger than `scale`.
fn case<const N: usize>(input: Vec<f32>, expected: [f64; N], scale: f64) -> Case<N> {
    Case { input, tolerance: expected.map(|x| rounded(1, x.abs()) + LEFT * scale), expected }
}

/// Random numbers of about a size, in single precision.
fn numbers(noise: &mut Noise, count: usize, size: f64) -> Vec<f32> {
    (0..count).map(|_| (size * noise.next()) as f32).collect()
}

fn wide<const N: usize>(numbers: &[f32]) -> [f64; N] {
    std::array::from_fn(|i| f64::from(numbers[i]))
}

fn matrix(numbers: &[f32]) -> Matrix<f64> {
    std::array::from_fn(|row| wide(&numbers[3 * row..]))
}

fn flat(m: &Matrix<f64>) -> [f64; 9] {
    std::array::from_fn(|i| m[i / 3][i % 3])
}

/// Moduli of tissue.
const MODULI: [f32; 2] = [1.7e3, 1.5e4];

#[test]
fn the_larger_and_the_root_are_those_of_single_numbers() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(11);
    let pairs: Vec<_> = (0..50).map(|_| numbers(&mut noise, 2, 1.0)).collect();
    let larger = |pair: &Vec<f32>| Case {
        input: pair.clone(),
        expected: [f64::from(pair[0].max(pair[1]))],
        tolerance: [0.0],
    };
    let root = |pair: &Vec<f32>| {
        let x = pair[0].abs();
        Case { input: vec![x], expected: [f64::from(x).sqrt()], tolerance: [rounded(1, f64::from(x).sqrt())] }
    };
    for precision in ["float", "double"] {
        laws.check(&format!("{precision} larger"), &pairs.iter().map(larger).collect::<Vec<_>>());
        laws.check(&format!("{precision} root"), &pairs.iter().map(root).collect::<Vec<_>>());
    }
}

#[test]
fn stress_and_strain_of_a_cell_are_those_of_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(12);
    let inputs: Vec<_> = [1e-4, 0.1, 1.0]
        .into_iter()
        .flat_map(|size| [size; 100])
        .map(|size| numbers(&mut noise, 18, size))
        .collect();
    let of_two = |law: fn(&Matrix<f64>, &Matrix<f64>) -> Matrix<f64>| {
        let twin =
            |input: &Vec<f32>| case(input.clone(), flat(&law(&matrix(input), &matrix(&input[9..]))), 10.0);
        inputs.iter().map(twin).collect::<Vec<_>>()
    };
    laws.check("Matrix<R> product", &of_two(product));
    laws.check("Matrix<R> transposed_product", &of_two(transposed_product));
    laws.check("Matrix<R> corotated_strain", &of_two(corotated_strain));
    let of_one = |law: fn(&Matrix<f64>) -> Matrix<f64>| {
        let twin = |input: &Vec<f32>| case(input[..9].to_vec(), flat(&law(&matrix(input))), 10.0);
        inputs.iter().map(twin).collect::<Vec<_>>()
    };
    laws.check("Matrix<R> deformation", &of_one(deformation));
    laws.check("Matrix<R> green_strain", &of_one(green_strain));
    let [mu, lambda] = wide(&MODULI);
    let with_moduli = |matrices: usize, law: &dyn Fn(&[f32]) -> Matrix<f64>| {
        let twin = |input: &Vec<f32>| {
            let input = [&input[..9 * matrices], &MODULI].concat();
            let expected = flat(&law(&input));
            case(input, expected, 100.0 * lambda)
        };
        inputs.iter().map(twin).collect::<Vec<_>>()
    };
    laws.check("Matrix<R> hooke", &with_moduli(1, &|n| hooke(&matrix(n), mu, lambda)));
    let change = |n: &[f32]| stress_change(&matrix(n), &matrix(&n[9..]), mu, lambda);
    laws.check("Matrix<R> stress_change", &with_moduli(2, &change));
    let stress = |n: &[f32]| corotated_stress(&matrix(n), &matrix(&n[9..]), mu, lambda);
    laws.check("Matrix<R> corotated_stress", &with_moduli(2, &stress));
}

#[test]
fn cells_turn_as_on_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(13);
    let (mut matrices, mut turned) = (Vec::new(), Vec::new());
    for size in [0.01, 0.5, 3.0].into_iter().flat_map(|size| [size; 100]) {
        let turn = Quat::from_scaled_axis(Vec3::from_fn(|_, _| size * noise.next())).coords;
        let mut input = [turn.x, turn.y, turn.z, turn.w].map(|x| x as f32).to_vec();
        matrices.push(case(input.clone(), flat(&rotation_matrix(wide(&input))), 1.0));
        // Stretched, sheared, and now and then turned inside out.
        let g = numbers(&mut noise, 9, 1.2);
        let f = deformation(&matrix(&g));
        input.extend(flat(&f).map(|x| x as f32));
        turned.push(case(input.clone(), turn_towards(wide(&input), &matrix(&input[4..])), 1e3));
    }
    laws.check("Matrix<R> rotation_matrix", &matrices);
    laws.check("Rotation<R> turn_towards", &turned);
}

/// Edge of a cell in m.
const CELL_M: f32 = 2e-3;

/// Corner i of a cell, seen from its middle, in half edges.
fn signs(i: usize) -> Vec3 {
    Vec3::from_fn(|axis, _| if i >> axis & 1 == 1 { 1.0 } else { -1.0 })
}

#[test]
fn what_a_cell_gives_to_its_corners_is_what_its_stress_and_its_hourglass_are() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(14);
    let h = f64::from(CELL_M);
    let (mut gradients, mut answers) = (Vec::new(), Vec::new());
    for _ in 0..200 {
        let mut input = numbers(&mut noise, 24, 1e-3);
        let u: [Vec3; 8] = std::array::from_fn(|i| Vec3::from_fn(|c, _| f64::from(input[8 * c + i])));
        let g: Mat3 = (0..8).map(|i| u[i] * signs(i).transpose() / (4.0 * h)).sum();
        let sums = u.iter().sum::<Vec3>();
        input.push(0.25 / CELL_M);
        let all: [f64; 12] = std::array::from_fn(|n| if n < 9 { g[(n / 3, n % 3)] } else { sums[n - 9] });
        // The quarter of a reciprocal is rounded before it is asked.
        let mut seen = case(input, all, 10.0);
        seen.tolerance.iter_mut().zip(all).for_each(|(t, x)| *t += rounded(1, x.abs()));
        gradients.push(seen);

        let input = [numbers(&mut noise, 12, 1.0), numbers(&mut noise, 9, 1e3), vec![0.9, CELL_M]].concat();
        let (s, g, p) = (f64::from(input[21]), matrix(&input), matrix(&input[12..]));
        let all: [f64; 12] = std::array::from_fn(|n| {
            let (row, column) = (n / 3, n % 3);
            if n < 9 {
                s * h / 2.0 * g[row][column] - h * h / 4.0 * p[row][column]
            } else {
                s * f64::from(input[n]) / 8.0
            }
        });
        answers.push(case(input, all, 1.0));
    }
    laws.check("Gradient<R> gradient", &gradients);
    laws.check("Answer<R> cell_answer", &answers);
}

#[test]
fn the_block_of_a_corner_is_how_its_force_changes_as_it_moves_alone() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(15);
    let h = f64::from(CELL_M);
    let [mu, lambda] = wide(&MODULI);
    let (mut blocks, mut inverses) = (Vec::new(), Vec::new());
    let upper = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
    for round in 0..200 {
        let s = signs(round % 8);
        let hourglass = 0.9_f32;
        let mut input = numbers(&mut noise, 9, 1.0);
        let frame = matrix(&input);
        input.extend(MODULI);
        input.extend([hourglass, CELL_M, s.x as f32, s.y as f32, s.z as f32]);
        // G = p bᵀ, b = s / 4h; half of its own motion is not affine.
        let b = s / (4.0 * h);
        let column = |axis: usize| {
            let p = Vec3::ith(axis, 1.0);
            let g: Matrix<f64> = std::array::from_fn(|i| std::array::from_fn(|j| p[i] * b[j]));
            let stress = stress_change(&frame, &g, mu, lambda);
            let by_stress = Mat3::from_fn(|i, j| stress[i][j]) * b * h.powi(3);
            by_stress + p * (0.5 * f64::from(hourglass))
        };
        let columns = [0, 1, 2].map(column);
        let block = upper.map(|(i, j)| columns[j][i]);
        blocks.push(case(input, block, 1e3));

        let a = Mat3::from_fn(|_, _| noise.next());
        let positive = a * a.transpose() + Mat3::identity() * 0.2;
        let input = upper.map(|place| positive[place] as f32).to_vec();
        let [xx, xy, xz, yy, yz, zz] = wide(&input);
        let inverse = Mat3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).try_inverse().unwrap();
        inverses.push(case(input, upper.map(|place| inverse[place]), 1e3));
    }
    laws.check("Block<R> corner_block", &blocks);
    laws.check("Block<R> inverted", &inverses);
}
