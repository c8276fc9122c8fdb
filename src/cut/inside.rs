//! Which cell of deformed tissue a point is in, and where in it.

use super::extents::Extents;
use super::sweep::Moving;
use crate::math::{Mat3, Vec3};
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

/// The cells that some points, m, model frame, are in at the end of a step; the first that is found where tissue overlaps. `is_whole` says of which cells points are asked for, by the slots of their lowest corners.
pub fn locate(
    points: &[Vec3],
    lattice: &Lattice,
    nodes: &impl Moving,
    extents: &Extents,
    is_whole: impl Fn(u32) -> bool,
) -> Vec<Option<Inside>> {
    let mut found = vec![None; points.len()];
    let Some(&first) = points.first() else { return found };
    let bounds = points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    for slot in extents.slots_near(lattice, bounds) {
        let node = lattice.node_of(slot);
        let material = (lattice.words()[slot as usize] >> 28) as u8;
        if material == 0 || !is_whole(slot) {
            continue;
        }
        let corners = lattice.corners(node);
        let at = corners.map(|corner| nodes.to(corner));
        let (low, high) = at.iter().fold((at[0], at[0]), |(low, high), p| (low.inf(p), high.sup(p)));
        for (point, found) in points.iter().zip(&mut found).filter(|(_, found)| found.is_none()) {
            if (0..3).all(|c| low[c] <= point[c] && point[c] <= high[c]) {
                let weights = place(&at, point).map(|place| shares(&place));
                *found = weights.map(|weights| Inside { corners, material, weights });
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
        fn from(&self, slot: u32) -> Vec3 {
            self.to(slot)
        }

        fn to(&self, slot: u32) -> Vec3 {
            let p = self.0.rest_position(slot) / self.0.cell_m();
            Vec3::new(p.x + 0.2 * p.y, p.y - 0.05 * p.x * p.x, 1.3 * p.z + 0.1 * p.x) * self.0.cell_m()
        }
    }

    #[test]
    fn a_point_is_found_in_the_cell_and_at_the_place_that_it_was_put_and_nowhere_else() {
        let lattice = Lattice::new([9, 5, 6], 2e-3, &[1; 270]).unwrap();
        let (nodes, mut noise) = (Bent(&lattice), Noise(5));
        let extents = Extents::new(&lattice, |slot| nodes.to(slot) - lattice.rest_position(slot), None);
        let (mut points, mut expected) = (Vec::new(), Vec::new());
        for _ in 0..300 {
            let mut share = || 0.5 + 0.499 * noise.next();
            let cell = lattice.cells().map(|n| (share() * n as f64) as usize);
            let weights = shares(&Vec3::new(share(), share(), share()));
            let corners = lattice.corners(cell);
            points.push(
                corners.iter().zip(weights).map(|(&slot, weight)| nodes.to(slot) * weight).sum::<Vec3>(),
            );
            expected.push((corners, weights));
        }
        for (found, (corners, weights)) in
            locate(&points, &lattice, &nodes, &extents, |_| true).iter().zip(&expected)
        {
            let found = found.expect("it is inside");
            assert_eq!(found.corners, *corners);
            assert!(found.weights.iter().zip(weights).all(|(a, b)| (a - b).abs() < 1e-5));
        }
        let outside =
            [Vec3::new(-1e-3, 4e-3, 4e-3), Vec3::new(9e-3, 30e-3, 4e-3), Vec3::zeros() - Vec3::z() * 1e-5];
        assert!(locate(&outside, &lattice, &nodes, &extents, |_| true).iter().all(Option::is_none));
        assert!(locate(&points, &lattice, &nodes, &extents, |_| false).iter().all(Option::is_none));
    }
}
