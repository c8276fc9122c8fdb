//! Springs and volumes.

use super::{Case, Laws, rounded};
use crate::model::law::{SpringClass, sliver_damping, volume_change};
use crate::noise::Noise;

/// From strains that single precision hardly sees to large ones.
const STRAINS: [f64; 5] = [1e-7, 1e-5, 1e-3, 0.1, 1.0];

#[test]
fn springs_stretch_as_on_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(1);
    let case = |diagonal: u32, rest: f32, length2: f32| {
        let (length, squared) = (f64::from(rest), f64::from(length2));
        let class = SpringClass::<f64>::new(diagonal, length / f64::from(diagonal).sqrt());
        let share = if diagonal == 3 { 0.75 } else { 1.0 };
        // Root, reciprocal and product; then the difference. The shortest length that counts is a product.
        let ratio = length / squared.sqrt().max(1e-3 * length);
        Case {
            input: vec![length2, rest],
            expected: [class.elongation(squared - length * length) / share],
            tolerance: [rounded(5, ratio + 1.0)],
        }
    };
    let mut cases = Vec::new();
    for strain in STRAINS {
        for diagonal in 1..=3 {
            for _ in 0..500 {
                let rest = 1e-3 * (1.5 + noise.next());
                let length = rest * (1.0 + strain * noise.next());
                cases.push(case(diagonal, rest as f32, (length * length) as f32));
            }
        }
    }
    // At rest; with both ends in one place; torn apart.
    let rest = 2.0_f32.powi(-9);
    cases.extend([0.0, rest * rest, 1.0, 1e8].map(|length2| case(1, rest, length2)));
    assert!((cases[cases.len() - 4].expected[0] + 999.0).abs() < 1e-6);
    laws.check("float elongation", &cases);
}

#[test]
fn slivers_are_damped_as_on_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(4);
    let case = |spring: f32, corner: f32, share: f32| {
        let [k, m, share64] = [spring, corner, share].map(f64::from);
        // What is left of one without a tenth of itself is rounded as one is; then a root and products.
        let most = 0.2 * (k * m).sqrt() * share64;
        Case {
            input: vec![spring, corner, share],
            expected: [sliver_damping(k, m, share64)],
            tolerance: [rounded(12, most)],
        }
    };
    let mut cases: Vec<_> = (0..500)
        .map(|_| {
            let [k, m, share] = [(); 3].map(|()| 0.5 + 0.5 * noise.next());
            case((10.0 * k) as f32, (1e-6 * m) as f32, (0.15 * share) as f32)
        })
        .collect();
    // Bone has no springs; a whole cell is no sliver.
    cases.extend([case(0.0, 1e-6, 0.01), case(4.0, 1e-6, 1.0), case(4.0, 1e-6, 0.0)]);
    assert!(cases[500..].iter().all(|case| case.expected == [0.0]));
    laws.check("float sliver_damping", &cases);
}

#[test]
fn minors_are_differences_of_products() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(2);
    let cases: Vec<_> = (0..500)
        .map(|_| {
            let input: Vec<_> = (0..4).map(|_| noise.next() as f32).collect();
            let [a, d, b, c] = std::array::from_fn(|i| f64::from(input[i]));
            let tolerance = rounded(2, (a * d).abs() + (b * c).abs());
            Case { input, expected: [a * d - b * c], tolerance: [tolerance] }
        })
        .collect();
    laws.check("float minor", &cases);
}

#[test]
fn volumes_change_as_on_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(3);
    let gradients = STRAINS.iter().flat_map(|strain| [*strain; 500]);
    let mut cases: Vec<_> = gradients
        .map(|strain| volume_case(std::array::from_fn(|_| (strain * noise.next()) as f32)))
        .collect();
    // At rest, crushed to a point, turned inside out, and stretched without an end.
    cases.extend(
        [0.0, -1.0, -2.0, 1e6]
            .map(|stretch| volume_case(std::array::from_fn(|i| if i % 4 == 0 { stretch } else { 0.0 }))),
    );
    laws.check("float volume_change", &cases);
}

fn volume_case(gradient: [f32; 9]) -> Case<10> {
    let g: [[f64; 3]; 3] =
        std::array::from_fn(|row| std::array::from_fn(|column| f64::from(gradient[3 * row + column])));
    let (cof, change) = volume_change(g);
    let f: [[f64; 3]; 3] =
        std::array::from_fn(|row| std::array::from_fn(|column| g[row][column] + f64::from(row == column)));

    // The two products of a cofactor without their signs.
    let magnitude = |m: &[[f64; 3]; 3], row: usize, column: usize| {
        let at = |i: usize, j: usize| m[(row + i) % 3][(column + j) % 3].abs();
        at(1, 1) * at(2, 2) + at(1, 2) * at(2, 1)
    };
    let first: f64 = (0..3).map(|i| g[i][i].abs()).sum();
    let second: f64 = (0..3).map(|i| magnitude(&g, i, i)).sum();
    let third: f64 = (0..3).map(|column| g[0][column].abs() * magnitude(&g, 0, column)).sum();
    let place = |i: usize| (i / 3, i % 3);
    Case {
        input: gradient.to_vec(),
        expected: std::array::from_fn(|i| if i == 9 { change } else { cof[i / 3][i % 3] }),
        tolerance: std::array::from_fn(|i| {
            if i == 9 {
                // The determinant's terms go through most: a minor, a product, and four sums.
                rounded(7, first + second + third)
            } else {
                // Two diagonal elements, a product, and a difference.
                let (row, column) = place(i);
                rounded(4, magnitude(&f, row, column))
            }
        }),
    }
}
