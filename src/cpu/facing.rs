//! Contact between the two sides of a cut: what has passed through the other side is put back, and loses the velocity with which it went.
//!
//! Pair by pair, once in a substep: positions without velocity, and velocities by an impulse that leaves none along the normal, so that a pair never gives energy back. Equal and opposite, whatever
//! the masses. Sides that have slid past each other by more than a cell do not face each other any more.

use super::lanes::Real;
use super::mobile::Mobile;
use crate::cut::facing::Facing;
use crate::math::{Mat3, Vec3};
use crate::model::energy;

/// Share of a cell by which a side is put back in one substep at most.
const PUSH_LIMIT: f64 = 0.25;

/// Keeps all pairs apart, in cells of edge length `h`. Returns how far a node was put back at most, in m.
pub fn keep_apart<R: Real>(all: &[Facing], h: f64, nodes: &mut Mobile<R>) -> f64 {
    let mut furthest = 0.0_f64;
    for facing in all {
        let at = facing.nodes.map(|side| side.map(|slot| nodes.u.vec3(slot)));
        let of = |side: &[Vec3; 8]| -> Vec3 { side.iter().zip(facing.weights).map(|(u, w)| u * w).sum() };
        let apart = of(&at[0]) - of(&at[1]);
        // Before all else: most pairs gape.
        let normal = normal(facing, h, &at);
        let gap = apart.dot(&normal);
        if gap >= 0.0 || (apart - normal * gap).norm() > h {
            continue;
        }
        // Each side goes as one, whatever single nodes weigh: a copy may weigh next to nothing.
        let masks = facing.nodes.map(|side| side.map(|slot| nodes.free(slot)));
        let mass = [0, 1].map(|side| {
            facing.nodes[side]
                .iter()
                .zip(masks[side])
                .filter(|(_, free)| *free != Vec3::zeros())
                .map(|(&slot, _)| (nodes.kg)(slot))
                .sum::<f64>()
        });
        let along = |free: &Vec3| free.component_mul(&normal).dot(&normal);
        let carried =
            masks.map(|side| side.iter().zip(facing.weights).map(|(free, w)| along(free) * w).sum::<f64>());
        let give =
            [0, 1].map(|side| if mass[side] > 0.0 { carried[side].max(0.0) / mass[side] } else { 0.0 });
        if give[0] + give[1] <= 0.0 {
            continue;
        }
        let velocities = facing.nodes.map(|side| side.map(|slot| nodes.v.vec3(slot)));
        let closing = (of(&velocities[0]) - of(&velocities[1])).dot(&normal).min(0.0);
        let total = give[0] + give[1];
        let (push, blow) = ((-gap).min(PUSH_LIMIT * h) / total, -closing / total);
        for (side, sign) in [(0, 1.0), (1, -1.0)].into_iter().filter(|&(side, _)| give[side] > 0.0) {
            for (slot, free) in facing.nodes[side].into_iter().zip(masks[side]) {
                let share = free.component_mul(&normal) * (sign / mass[side]);
                nodes.u.set(slot, nodes.u.vec3(slot) + share * push);
                nodes.v.set(slot, nodes.v.vec3(slot) + share * blow);
                furthest = furthest.max((share * push).norm());
            }
        }
    }
    furthest
}

/// The wall's normal as both sides have turned it in the mean.
fn normal(facing: &Facing, h: f64, u: &[[Vec3; 8]; 2]) -> Vec3 {
    let mean: [Vec3; 8] = std::array::from_fn(|corner| 0.5 * (u[0][corner] + u[1][corner]));
    let gradient = energy::gradient(h, &mean);
    let deformed = Mat3::identity() + Mat3::from_fn(|row, column| gradient[row][column]);
    let axis = if facing.normal.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
    let across = facing.normal.cross(&axis);
    let turned = (deformed * across).cross(&(deformed * facing.normal.cross(&across)));
    turned.try_normalize(0.0).unwrap_or(facing.normal)
}
