//! Shapes, compounds of them, and points that sweep through.

use super::vectors::{ROTATED, ROTATING, numbers, turn, vector};
use super::{Case, Laws, rounded};
use crate::cuda::layout::Part;
use crate::math::{Pose, Quat, Vec3};
use crate::noise::Noise;
use crate::solver::tool::{Nearest, Shape, ToolDesc};

/// As many parts as the C++ program takes.
const PARTS: usize = 3;

/// How far a point may be off when a law looks at it, and the law's own roundings of a distance and of a normal.
#[derive(Clone, Copy)]
struct Rounding {
    place: f64,
    distance: f64,
    normal: f64,
}

impl Rounding {
    /// In the frame of a shape, where everything is within `reach`.
    fn of_shape(reach: f64) -> Self {
        // A core's size, and the way to it; a length, and the distance that it leaves; a length, its reciprocal, and a product.
        Self { place: rounded(2, reach), distance: rounded(4, reach), normal: rounded(5, 1.0) }
    }

    /// In the frame of a tool: what is seen from a part is turned, and so is the normal.
    fn of_tool(reach: f64) -> Self {
        let shape = Self::of_shape(reach);
        Self {
            place: shape.place + rounded(1 + ROTATING, ROTATED * reach),
            normal: shape.normal + rounded(ROTATING, ROTATED),
            ..shape
        }
    }

    /// What rounding may do to the twin's answer at a point. A jump within reach counts in full.
    fn around<const N: usize>(self, answer: [f64; N], twin: impl Fn(Vec3) -> [f64; N]) -> [f64; N] {
        let mut tolerance = std::array::from_fn(|i| if i == 0 { self.distance } else { self.normal });
        for axis in 0..3 {
            let shift = Vec3::ith(axis, self.place);
            let (there, back) = (twin(shift), twin(-shift));
            for i in 0..N {
                tolerance[i] += (there[i] - answer[i]).abs().max((back[i] - answer[i]).abs());
            }
        }
        tolerance
    }
}

fn as_numbers((distance, normal): (f64, Vec3)) -> [f64; 4] {
    [distance, normal.x, normal.y, normal.z]
}

/// And its part.
fn nearest_as_numbers(nearest: Nearest) -> [f64; 5] {
    let [distance, x, y, z] = as_numbers((nearest.distance, nearest.normal));
    [distance, x, y, z, nearest.part as f64]
}

fn single(x: f64) -> f64 {
    f64::from(x as f32)
}

/// A size in m, anywhere between the smallest and the largest that a shape may have.
fn size(noise: &mut Noise) -> f64 {
    single(10.0_f64.powf(-2.5 + 2.5 * noise.next()))
}

/// A ball, a capsule or a box in turn. Every other box is as round as it may be.
fn shape(noise: &mut Noise, number: usize, size: impl Fn(&mut Noise) -> f64) -> Shape {
    match number % 4 {
        0 => Shape::Sphere { radius_m: size(noise) },
        1 => Shape::Capsule { radius_m: size(noise), half_length_m: size(noise) },
        kind => {
            let half_extents_m = Vec3::from_fn(|_, _| size(noise));
            let round = if kind == 2 { 1.0 } else { 0.5 + 0.499 * noise.next() };
            Shape::Box { half_extents_m, rounding_m: single(round * half_extents_m.min()) }
        }
    }
}

/// Half the edges of the box around a shape.
fn half_extents(shape: &Shape) -> Vec3 {
    match *shape {
        Shape::Sphere { radius_m } => Vec3::repeat(radius_m),
        Shape::Capsule { radius_m, half_length_m } => Vec3::new(radius_m, radius_m, radius_m + half_length_m),
        Shape::Box { half_extents_m, .. } => half_extents_m,
    }
}

fn words(part: &Part) -> [f32; 12] {
    // SAFETY: `repr(C)` numbers of four bytes each, of which any bytes are a value.
    unsafe { std::mem::transmute::<Part, [f32; 12]>(*part) }
}

/// That most cases have a tolerance which would notice a mistake.
fn assert_sharp<const N: usize>(cases: &[Case<N>]) {
    let is_sharp = |case: &&Case<N>| case.tolerance.iter().all(|tolerance| *tolerance < 1e-2);
    let sharp = cases.iter().filter(is_sharp).count();
    assert!(10 * sharp > 9 * cases.len(), "only {sharp} of {} cases tell", cases.len());
}

#[test]
fn a_core_is_as_far_away_as_on_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(1);
    let case = |d: Vec3, radius_m: f64| {
        let Rounding { distance, normal, .. } = Rounding::of_shape(d.norm() + radius_m);
        Case {
            input: numbers(d.iter().chain([&radius_m])),
            expected: as_numbers(Shape::Sphere { radius_m }.distance(d)),
            tolerance: [distance, normal, normal, normal],
        }
    };
    let mut cases: Vec<_> = (0..2000)
        .map(|_| {
            let reach = size(&mut noise);
            case(vector(&mut noise, reach), size(&mut noise))
        })
        .collect();
    cases.push(Case { tolerance: [0.0; 4], ..case(Vec3::zeros(), 0.25) });
    laws.check("Distance from_core", &cases);
}

fn shape_input(shape: &Shape, p: Vec3) -> Vec<f32> {
    let part = words(&Part::of(&Pose::identity(), shape));
    part.into_iter().chain(numbers(&p)).collect()
}

#[test]
fn shapes_are_as_far_away_as_on_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(2);
    let cases: Vec<_> = (0..8000)
        .map(|number| {
            let shape = shape(&mut noise, number, size);
            // In, at and around it, however long and thin it is.
            let p = vector(&mut noise, 1.5).component_mul(&half_extents(&shape)).map(single);
            let twin = |p: Vec3| as_numbers(shape.distance(p));
            let rounding = Rounding::of_shape(p.norm() + shape.bounding_radius_m());
            Case {
                input: shape_input(&shape, p),
                expected: twin(p),
                tolerance: rounding.around(twin(p), |shift| twin(p + shift)),
            }
        })
        .collect();
    assert_sharp(&cases);
    laws.check("Distance shape_distance", &cases);
}

#[test]
fn where_every_direction_leads_out_of_a_shape_the_same_one_is_taken() {
    let Some(laws) = Laws::compiled() else { return };
    // Sizes whose differences are exact in single precision.
    let ball = Shape::Sphere { radius_m: 0.25 };
    let capsule = Shape::Capsule { radius_m: 0.125, half_length_m: 0.5 };
    let block = |x, y, z, rounding_m| Shape::Box { half_extents_m: Vec3::new(x, y, z), rounding_m };
    let (cube, plate, needle) =
        (block(0.5, 0.5, 0.5, 0.125), block(0.5, 0.5, 0.25, 0.125), block(0.125, 0.125, 1.0, 0.125));
    let places = [
        (ball, Vec3::zeros()),
        (capsule, Vec3::zeros()),
        (capsule, Vec3::new(0.0, 0.0, -0.5)),
        (cube, Vec3::zeros()),
        (cube, Vec3::repeat(-0.0)),
        (cube, Vec3::new(0.25, 0.25, -0.25)),
        (cube, Vec3::new(0.125, -0.25, 0.25)),
        (plate, Vec3::new(0.0, 0.0, -0.0)),
        (plate, Vec3::new(-0.25, 0.0, 0.0)),
        (block(0.5, 0.25, 0.5, 0.125), Vec3::zeros()),
        (needle, Vec3::zeros()),
        (needle, Vec3::new(0.0, 0.0, -0.875)),
    ];
    let cases = places.map(|(shape, p)| Case {
        input: shape_input(&shape, p),
        expected: as_numbers(shape.distance(p)),
        tolerance: [0.0; 4],
    });
    laws.check("Distance shape_distance", &cases);
}

/// Some centimetres of shapes on top of one another.
fn tool(noise: &mut Noise, number: usize) -> ToolDesc {
    let pose = |noise: &mut Noise| Pose::from_parts(vector(noise, 0.02).into(), turn(noise));
    let size = |noise: &mut Noise| single(0.011 + 0.009 * noise.next());
    let parts = (0..PARTS).map(|part| (pose(noise), shape(noise, number + part, size))).collect();
    ToolDesc { parts, friction: 0.0, blade: None }
}

fn part_numbers(tool: &ToolDesc) -> impl Iterator<Item = f32> {
    tool.parts.iter().flat_map(|(pose, shape)| words(&Part::of(pose, shape)))
}

#[test]
fn compounds_are_as_far_away_as_on_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(3);
    let case = |tool: &ToolDesc, p: Vec3| {
        let twin = |p: Vec3| nearest_as_numbers(tool.distance(p));
        let rounding = Rounding::of_tool(p.norm() + tool.bounding_radius_m());
        Case {
            input: part_numbers(tool).chain(numbers(&p)).collect(),
            expected: twin(p),
            tolerance: rounding.around(twin(p), |shift| twin(p + shift)),
        }
    };
    let mut cases: Vec<_> = (0..8000)
        .map(|number| {
            let tool = tool(&mut noise, number);
            case(&tool, vector(&mut noise, 0.06))
        })
        .collect();
    assert_sharp(&cases);
    // Where two parts are equally near, the first one counts.
    let ball = |x: f64| (Pose::translation(x, 0.0, 0.0), Shape::Sphere { radius_m: 0.25 });
    let twins = ToolDesc { parts: vec![ball(-0.5), ball(0.5), ball(4.0)], friction: 0.0, blade: None };
    cases.push(Case { tolerance: [0.0; 5], ..case(&twins, Vec3::zeros()) });
    laws.check("Nearest tool_distance", &cases);
}

#[test]
fn triangles_are_divided_as_on_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(5);
    let (mut inputs, mut expected) = (Vec::new(), Vec::new());
    for number in 0..4000 {
        let shape = shape(&mut noise, number, size);
        // From a small part of what would be divided to more than is; and to the last bit what is not just yet.
        let third = shape.feature_m() as f32 / 3.0;
        let edge = if number % 8 < 4 {
            third * (1 + number % 5) as f32
        } else {
            third * (20.0 + 20.0 * noise.next() as f32)
        };
        inputs.push(
            words(&Part::of(&Pose::identity(), &shape)).into_iter().chain([edge]).collect::<Vec<f32>>(),
        );
        expected.push(shape.division(edge) as f32);
    }
    let answers = laws.answers::<1>("int part_division", &inputs);
    for ((input, expected), [found]) in inputs.iter().zip(&expected).zip(answers) {
        assert_eq!(found, *expected, "{input:?}");
    }
    let ones = expected.iter().filter(|n| **n == 1.0).count();
    let most = expected.iter().filter(|n| **n == 32.0).count();
    assert!(ones > 100 && most > 100, "{ones} undivided, {most} as finely as may be");
}

#[test]
fn the_parts_in_reach_are_those_of_the_processor() {
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(6);
    let places: Vec<_> = (0..4000)
        .map(|number| {
            let reach = single(0.01 + 0.01 * noise.next());
            (tool(&mut noise, number), vector(&mut noise, 0.05), reach)
        })
        .collect();
    let edge = 0.02;
    let input = |(tool, p, reach): &(ToolDesc, Vec3, f64)| {
        part_numbers(tool).chain(numbers(p.iter().chain([reach]))).chain([edge]).collect::<Vec<f32>>()
    };
    let inputs: Vec<_> = places.iter().map(input).collect();
    let answers = laws.answers::<1>("unsigned tool_divisions", &inputs);

    let (mut some, mut none, mut unclear) = (0, 0, 0);
    for ((tool, p, reach), [found]) in places.iter().zip(answers) {
        let rounding = Rounding::of_tool(p.norm() + tool.bounding_radius_m());
        let off = rounding.place + rounding.distance;
        let [more, less] = [reach + off, reach - off].map(|reach| tool.divisions(*p, reach, edge));
        if more != less {
            unclear += 1;
            continue;
        }
        assert_eq!(found.to_bits(), more, "{tool:?} at {p}, {reach}");
        *if more == 0 { &mut none } else { &mut some } += 1;
    }
    println!("{some} in reach, {none} without, {unclear} too close to call");
    assert!(some > places.len() / 10 && none > places.len() / 10 && unclear < places.len() / 100);
}

#[test]
fn sweeping_points_meet_the_tools_that_they_meet_on_the_processor() {
    /// A point's way.
    struct Sweep {
        tool: ToolDesc,
        start: Vec3,
        end: Vec3,
        strides: f64,
    }
    let Some(laws) = Laws::compiled() else { return };
    let mut noise = Noise(4);
    let mut sweeps: Vec<_> = (0..8000)
        .map(|number| Sweep {
            tool: tool(&mut noise, number),
            start: vector(&mut noise, 0.08),
            end: vector(&mut noise, 0.03),
            // From less than one to more than are taken.
            strides: single((40.0 + 42.0 * noise.next()).max(0.5)),
        })
        .collect();
    // Through a thin plate and out again; along its face; and standing still inside.
    let plate = Shape::Box { half_extents_m: Vec3::new(0.25, 0.25, 0.0625), rounding_m: 0.03125 };
    let far = (Pose::from_parts(Vec3::repeat(8.0).into(), Quat::identity()), plate);
    let plate = ToolDesc { parts: vec![(Pose::identity(), plate), far, far], friction: 0.0, blade: None };
    let ways = [
        ([0.0, 0.0, 0.5], [0.0, 0.0, -0.5]),
        ([-0.5, 0.0, 0.125], [0.5, 0.0, 0.125]),
        ([0.01; 3], [0.01; 3]),
    ];
    sweeps.extend(ways.map(|(start, end)| {
        let (start, end) = (Vec3::from(start).map(single), Vec3::from(end).map(single));
        Sweep { tool: plate.clone(), start, end, strides: 17.0 }
    }));

    let inputs: Vec<Vec<f32>> = sweeps
        .iter()
        .map(|Sweep { tool, start, end, strides }| {
            let way = numbers(start.iter().chain(end).chain([strides]));
            part_numbers(tool).chain(way).collect()
        })
        .collect();
    let answers = laws.answers::<5>("Nearest meet", &inputs);

    let (mut met, mut missed, mut unclear) = (0, 0, 0);
    for (Sweep { tool, start, end, strides }, answer) in sweeps.iter().zip(answers) {
        let reach = start.norm() + end.norm() + tool.bounding_radius_m();
        let mut rounding = Rounding::of_tool(reach);
        // A place on the way: a fraction, a difference, a product and a sum. What lies beyond: a difference, a product and three sums.
        rounding.place += rounded(4, reach);
        rounding.distance += rounded(5, reach);
        let twin = |shift: Vec3| tool.meet(start + shift, end + shift, *strides);
        let shifts = (0..6).map(|i| Vec3::ith(i / 2, if i % 2 == 0 { 1.0 } else { -1.0 } * rounding.place));
        match (twin(Vec3::zeros()), shifts.filter(|shift| twin(*shift).is_some()).count()) {
            (Some(expected), 6) => {
                met += 1;
                let expected = nearest_as_numbers(expected);
                let shifted = |shift| nearest_as_numbers(twin(shift).expect("met wherever it was shifted"));
                let tolerance = rounding.around(expected, shifted);
                for i in 0..5 {
                    let found = f64::from(answer[i]);
                    assert!(
                        (found - expected[i]).abs() <= tolerance[i],
                        "{answer:?} is not {expected:?} within {tolerance:?}: {tool:?} from {start} to {end}"
                    );
                }
            }
            (None, 0) => {
                missed += 1;
                assert!(answer[0] >= 0.0, "{answer:?} where nothing is met: {tool:?} from {start} to {end}");
            }
            _ => unclear += 1,
        }
    }
    println!("{met} met, {missed} missed, {unclear} too close to call");
    assert!(met > sweeps.len() / 10 && missed > sweeps.len() / 10 && unclear < sweeps.len() / 100);
}
