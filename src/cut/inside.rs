//! Which cell of deformed tissue a point is in, and where in it.

use super::block::Block;
use super::extents::Extents;
use super::sweep::Moving;
use crate::math::{Bounds, Mat3, Vec3};
use crate::model::binding::shares;
use crate::model::lattice::Lattice;

/// Most steps towards the place of a point in a cell.
const STEPS: usize = 12;
/// How near a place is found, and how far outside of a cell it still counts, in cells.
const NEAR: f64 = 1e-6;

/// A point in a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inside {
    /// Slots of the cell's nodes.
    pub corners: [u32; 8],
    /// The cell's material.
    pub material: u8,
    /// Trilinear weights of the nodes.
    pub weights: [f64; 8],
}

/// The cells that some points, m, model frame, are in at the end of a step; the first that is found where tissue overlaps. `bricks`, which ascend, hold the lowest corners of those that are looked
/// at; `is_whole` says which of these count, by the slots of their lowest corners.
pub fn locate(
    points: &[Vec3],
    lattice: &Lattice,
    nodes: &impl Moving,
    extents: &Extents,
    bricks: &[u32],
    is_whole: impl Fn(u32) -> bool,
) -> Vec<Option<Inside>> {
    let mut found = vec![None; points.len()];
    let mut near = Vec::new();
    for &brick in bricks {
        let around = extents.of_cells(brick);
        near.clear();
        near.extend((0..points.len()).filter(|&n| found[n].is_none() && around.has(&points[n])));
        if near.is_empty() {
            continue;
        }
        let near_points = Bounds::of(near.iter().map(|&n| &points[n]));
        let to = |slot: u32| lattice.rest_position(slot) + nodes.moved(slot)[1];
        let sides = |slot: u32, rest: Vec3| near_points.sides(rest + nodes.moved(slot)[1]);
        let block = Block::new(lattice, extents, brick, sides);
        for own in block.own() {
            let material = (lattice.words()[own.slot as usize] >> 28) as u8;
            let Some(corners) = block.cell(own).filter(|_| material != 0 && is_whole(own.slot)) else {
                continue;
            };
            let at = corners.map(to);
            let bounds = Bounds::of(&at);
            for &n in near.iter().filter(|&&n| bounds.has(&points[n])) {
                if found[n].is_none() {
                    let weights = place(&at, &points[n]).map(|place| shares(&place));
                    found[n] = weights.map(|weights| Inside { corners, material, weights });
                }
            }
        }
    }
    found
}

/// Where in a cell with these corners a point is, from 0 to 1 along each axis; `None` where it is outside. By Newton's method.
fn place(corners: &[Vec3; 8], point: &Vec3) -> Option<Vec3> {
    let mut place = Vec3::repeat(0.5);
    for _ in 0..STEPS {
        let of = |corner: usize, axis: usize| {
            if corner >> axis & 1 == 1 { place[axis] } else { 1.0 - place[axis] }
        };
        let mut gap = *point;
        let mut slopes = Mat3::zeros();
        for (corner, at) in corners.iter().enumerate() {
            let [x, y, z] = [0, 1, 2].map(|axis| of(corner, axis));
            gap -= at * (x * y * z);
            let slope = Vec3::new(y * z, z * x, x * y);
            let sign = Vec3::from_fn(|axis, _| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 });
            slopes += at * slope.component_mul(&sign).transpose();
        }
        let step = slopes.try_inverse()? * gap;
        // No further than a cell at once: a cell that is bent may send the first step far away.
        let length = step.norm();
        place += if length > 1.0 { step / length } else { step };
        if length < NEAR {
            return place.iter().all(|x| (-NEAR..=1.0 + NEAR).contains(x)).then_some(place);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Noise;

    /// Nodes that a bent map of space displaces.
    struct Bent<'a>(&'a Lattice);

    impl Moving for Bent<'_> {
        fn moved(&self, slot: u32) -> [Vec3; 2] {
            let p = self.0.rest_position(slot) / self.0.cell_m();
            [Vec3::new(0.2 * p.y, -0.05 * p.x * p.x, 0.3 * p.z + 0.1 * p.x) * self.0.cell_m(); 2]
        }
    }

    #[test]
    fn a_point_is_found_in_the_cell_and_at_the_place_that_it_was_put_and_nowhere_else() {
        let lattice = Lattice::new([9, 5, 6], 2e-3, &[1; 270]).unwrap();
        let (nodes, mut noise) = (Bent(&lattice), Noise(5));
        let displaced = |slot: u32| nodes.moved(slot)[1];
        let mut extents = Extents::new(&lattice);
        let of_brick =
            |brick: u32| Bounds::of(&lattice.slots_of(&[brick]).map(displaced).collect::<Vec<_>>());
        let bricks: Vec<u32> = (0..lattice.bricks().len() as u32).collect();
        extents.look(|all| all.extend(bricks.iter().map(|&brick| of_brick(brick))), false);
        let locate = |points: &[Vec3], is_whole: fn(u32) -> bool| {
            locate(points, &lattice, &nodes, &extents, &bricks, is_whole)
        };
        let (mut points, mut expected) = (Vec::new(), Vec::new());
        for _ in 0..300 {
            let mut share = || 0.5 + 0.499 * noise.next();
            let cell = lattice.cells().map(|n| (share() * n as f64) as usize);
            let weights = shares(&Vec3::new(share(), share(), share()));
            let corners = lattice.corners(cell);
            points.push(
                corners
                    .iter()
                    .zip(weights)
                    .map(|(&slot, weight)| (lattice.rest_position(slot) + displaced(slot)) * weight)
                    .sum::<Vec3>(),
            );
            expected.push((corners, weights));
        }
        for (found, (corners, weights)) in locate(&points, |_| true).iter().zip(&expected) {
            let found = found.expect("it is inside");
            assert_eq!(found.corners, *corners);
            assert!(found.weights.iter().zip(weights).all(|(a, b)| (a - b).abs() < 1e-5));
        }
        let outside =
            [Vec3::new(-1e-3, 4e-3, 4e-3), Vec3::new(9e-3, 30e-3, 4e-3), Vec3::zeros() - Vec3::z() * 1e-5];
        assert!(locate(&outside, |_| true).iter().all(Option::is_none));
        assert!(locate(&points, |_| false).iter().all(Option::is_none));
    }
}
