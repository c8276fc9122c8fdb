//! Contact between the two sides of a cut: what has passed through the other side loses the velocity with which it goes on.
//!
//! Pair by pair, once in a substep, by a blow without bounce that moves all nodes of a side alike: equal and opposite, and so weighed that it takes energy and never gives any, whatever single nodes weigh. How deep sides
//! are in each other by then they stay. Sides that have turned away from each other, or slid past each other by more than a cell, do not face each other any more.

use super::lanes::Real;
use super::mobile::Mobile;
use crate::cut::facing::{Facing, Facings};
use crate::math::{Mat3, Vec3};
use crate::model::energy;

/// Length of the sum of both sides' unit normals below which they do not face each other: more than a right angle lies between them.
const LEAST_AGREEMENT: f64 = std::f64::consts::SQRT_2;

/// Keeps all pairs apart, in cells of edge length `h`, at the end of a substep of `dt` seconds. Returns how far a node was put back at most, in m.
pub fn keep_apart<R: Real>(all: &Facings, h: f64, dt: f64, nodes: &mut Mobile<R>) -> f64 {
    let mut furthest = 0.0_f64;
    for facing in all.iter() {
        let at = facing.nodes.map(|side| side.map(|slot| nodes.u.vec3(slot)));
        let of = |side: &[Vec3; 8]| -> Vec3 { side.iter().zip(facing.weights).map(|(u, w)| u * w).sum() };
        let apart = of(&at[0]) - of(&at[1]);
        let [a, b] = at.map(|u| normal(facing, h, &u));
        let Some(normal) = (a + b).try_normalize(LEAST_AGREEMENT) else { continue };
        let gap = apart.dot(&normal);
        if gap >= 0.0 || (apart - normal * gap).norm() > h {
            continue;
        }
        // What nodes can move: their masses, and their momenta, along axes that are free.
        let free = facing.nodes.map(|side| side.map(|slot| nodes.free(slot)));
        let kg = facing.nodes.map(|side| side.map(|slot| (nodes.kg)(slot)));
        let mass = [0, 1].map(|side| {
            let movable = kg[side].iter().zip(free[side]).filter(|(_, free)| *free != Vec3::zeros());
            movable.map(|(kg, _)| kg).sum::<f64>()
        });
        let velocity = |side: usize| -> Vec3 {
            let v = facing.nodes[side].map(|slot| nodes.v.vec3(slot));
            if mass[side] == 0.0 {
                return of(&v);
            }
            let momenta =
                (0..8).map(|corner| v[corner].component_mul(&free[side][corner]) * kg[side][corner]);
            momenta.sum::<Vec3>() / mass[side]
        };
        let closing = (velocity(0) - velocity(1)).dot(&normal);
        let yields = mass.map(|kg| if kg > 0.0 { 1.0 / kg } else { 0.0 });
        if closing >= 0.0 || yields == [0.0; 2] {
            continue;
        }
        let blow = -closing / (yields[0] + yields[1]);
        for (side, sign) in [(0, 1.0), (1, -1.0)] {
            for (slot, free) in facing.nodes[side].into_iter().zip(free[side]) {
                let change = free.component_mul(&normal) * (sign * yields[side] * blow);
                nodes.v.set(slot, nodes.v.vec3(slot) + change);
                nodes.u.set(slot, nodes.u.vec3(slot) + change * dt);
                furthest = furthest.max(change.norm() * dt);
            }
        }
    }
    furthest
}

/// The wall's normal as one of its sides has turned it, whose nodes are displaced by `u`.
fn normal(facing: &Facing, h: f64, u: &[Vec3; 8]) -> Vec3 {
    let gradient = energy::gradient(h, u);
    let deformed = Mat3::identity() + Mat3::from_fn(|row, column| gradient[row][column]);
    let axis = if facing.normal.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
    let across = facing.normal.cross(&axis);
    let turned = (deformed * across).cross(&(deformed * facing.normal.cross(&across)));
    turned.try_normalize(0.0).unwrap_or(facing.normal)
}
