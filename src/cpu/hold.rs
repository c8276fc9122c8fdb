//! Tissue ahead of a blade's edge: it sticks to the edge until that takes more than its toughness.

use super::lanes::Real;
use super::mobile::Mobile;
use crate::math::Vec3;
use crate::solver::{ToolStep, ToolSum};

/// Most sweeps of the Gauss–Seidel iteration.
const SWEEPS: usize = 32;
/// A sweep is the last when it changes no impulse by more than this share of the largest.
const CONVERGED: f64 = 1e-3;

/// A point of an edge in tissue, in a substep.
#[derive(Clone, Copy, Debug)]
struct Point {
    arm: Vec3,
    along: Vec3,
    velocity: Vec3,
    mobilities: [Vec3; 8],
    /// Velocity across the edge that an impulse gives the point at most, in 1/kg.
    give: f64,
    /// What the tissue has received in the substep, of that what it had before, in N s.
    impulse: Vec3,
    begun: Vec3,
}

/// The points of one tool's edge. Keeps its memory.
#[derive(Debug, Default)]
pub struct Hold {
    points: Vec<Point>,
}

impl Hold {
    /// Gives tissue that a tool's edge holds at the fraction `t` of the step the velocity of the edge, across it, by impulses that are limited by its toughness; what they take
    /// is the tool's. `begun` says what each point has received in the substep before, if anything. A substep takes `dt`, the tool's whole way `step`, in s. Returns how far a node went by that at most, in m.
    ///
    /// By projected Gauss–Seidel over all points: none is pushed beyond the edge's velocity, so that no energy comes of it.
    pub fn hold<R: Real>(
        &mut self,
        tool: &ToolStep,
        t: f64,
        [dt, step]: [f64; 2],
        begun: &mut impl Iterator<Item = Vec3>,
        nodes: &mut Mobile<R>,
        sum: &mut ToolSum,
    ) -> f64 {
        let pose = tool.path.at(t);
        self.points.clear();
        self.points.extend(tool.held.iter().map(|held| {
            let arm = pose.rotation * held.at;
            let mobilities = held.nodes.map(|slot| nodes.mobility(slot));
            // By the most mobile axis of each node: no impulse overshoots.
            let give = mobilities.iter().zip(held.weights).map(|(m, weight)| m.max() * weight * weight).sum();
            let velocity = tool.path.velocity(&pose, pose.translation.vector + arm, step);
            let begun = begun.next().unwrap_or_default();
            Point {
                arm,
                along: pose.rotation * held.along,
                velocity,
                mobilities,
                give,
                impulse: begun,
                begun,
            }
        }));
        let mut furthest = 0.0_f64;
        for _ in 0..SWEEPS {
            let (mut largest, mut change_of_any) = (0.0_f64, 0.0_f64);
            for (point, held) in
                self.points.iter_mut().zip(tool.held.iter()).filter(|(point, _)| point.give > 0.0)
            {
                let pairs = || held.nodes.into_iter().zip(held.weights);
                let slip =
                    point.velocity - pairs().map(|(slot, weight)| nodes.v.vec3(slot) * weight).sum::<Vec3>();
                let slip = slip - point.along * slip.dot(&point.along);
                let wanted = point.impulse + slip / point.give;
                let (size, most) = (wanted.norm(), held.limit_n * dt);
                let wanted = if size > most { wanted * (most / size) } else { wanted };
                let impulse = wanted - point.impulse;
                point.impulse = wanted;
                largest = largest.max(wanted.norm());
                change_of_any = change_of_any.max(impulse.norm());
                for ((slot, weight), mobility) in pairs().zip(&point.mobilities) {
                    let change = mobility.component_mul(&impulse) * weight;
                    nodes.v.set(slot, nodes.v.vec3(slot) + change);
                    nodes.u.set(slot, nodes.u.vec3(slot) + change * dt);
                }
            }
            if change_of_any <= CONVERGED * largest {
                break;
            }
        }
        for (point, held) in self.points.iter().zip(tool.held.iter()) {
            sum.impulse.force_n -= point.impulse;
            sum.impulse.torque_n_m -= point.arm.cross(&point.impulse);
            sum.work_j += point.impulse.dot(&point.velocity);
            let fastest = point.mobilities.iter().zip(held.weights).map(|(m, weight)| m.max() * weight);
            furthest += fastest.fold(0.0, f64::max) * (point.impulse - point.begun).norm() * dt;
        }
        furthest
    }
}
