//! Contact inside the implicit step.
//!
//! A point that ends the step inside a tool is pushed out by a spring that is far stiffer than the tissue that carries it, and held back across its normal by
//! Coulomb's law; both are parts of A and b. The spring takes its compliance, a [`STIFFNESS`]th of the tissue's, as depth. A point that would be pulled is let go of,
//! and friction's law is followed by that of the last solution, so that A stays symmetric: a few solutions, each from the one before, until nothing changes. So
//! do the edges of blades, see [`super::edge`].

use super::super::contact::ContactSurface;
use super::super::contact::found::Found;
use super::super::lanes::Real;
use super::block::matrix;
use super::edge::Edges;
use super::system::{Parts, System};
use crate::math::{Mat3, Vec3};
use crate::model::law::CellLaw;
use crate::solver::ToolStep;

/// How much stiffer a contact is than what carries it.
const STIFFNESS: f64 = 50.0;
/// Change of an impulse, as a share of the largest, that asks for another solution.
const SETTLED: f64 = 5e-3;

/// What bone resists by, in N/m, in cells of edge length `h`: it is as much stiffer than the stiffest tissue as contact is.
pub fn wall_n_m(laws: &[CellLaw; 16], h: f64) -> f64 {
    let stiffest = laws.iter().map(|law| law.lambda_pa + 2.0 * law.shear_pa).fold(0.0, f64::max);
    STIFFNESS * stiffest * h
}

/// A point in contact.
#[derive(Clone, Copy, Debug)]
struct Point {
    normal: Vec3,
    /// Range in `carried`.
    start: usize,
    end: usize,
    /// Impulse per velocity along the normal, in kg.
    stiffness: f64,
    /// Velocity along the normal that puts it out.
    wanted: f64,
    tool_velocity: Vec3,
    friction: f64,
    law: Law,
    /// The law that the last solution asks for.
    next: Law,
    /// Whether it has all that it will have: nothing that carries it moves.
    is_wall: bool,
    push: f64,
    drag: Vec3,
}

/// How a point answers.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Law {
    is_pushed: bool,
    /// Impulse per velocity across the normal, in kg.
    grip: f64,
}

/// All points in contact in a step, and those of edges in tissue.
#[derive(Debug)]
pub struct Press {
    pub edges: Edges,
    points: Vec<Point>,
    carried: Vec<(u32, f64)>,
    nodes: Vec<u32>,
    blocks: Vec<Mat3>,
    shares: Vec<f64>,
}

impl Press {
    /// With room for all that a surface finds, so that steps allocate nothing.
    pub fn of(contact: &ContactSurface) -> Self {
        let [points, nodes, carried] = contact.room();
        Self {
            edges: Edges::default(),
            points: Vec::with_capacity(points),
            carried: Vec::with_capacity(carried),
            nodes: Vec::with_capacity(nodes),
            blocks: Vec::with_capacity(nodes),
            shares: Vec::with_capacity(nodes),
        }
    }

    /// Whether nothing of it is part of A.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty() && self.edges.are_free()
    }

    /// Takes the points that were found, and adds them to the system's blocks. What nothing carries that moves resists by `wall_n_m`.
    pub fn begin<R: Real>(
        &mut self,
        contact: &ContactSurface,
        tools: &[ToolStep],
        dt: f64,
        wall_n_m: f64,
        system: &mut System<R>,
    ) {
        self.points.clear();
        self.carried.clear();
        self.nodes.clear();
        self.blocks.clear();
        self.shares.clear();
        self.nodes.extend(contact.carriers());
        self.blocks.resize(self.nodes.len(), Mat3::zeros());
        // How much all points together put on a node: as many as share it share the stiffness that it takes.
        self.shares.resize(self.nodes.len(), 0.0);
        for found in contact.found(tools).filter(Found::is_touched) {
            for &(node, weight) in found.carried {
                self.shares[node as usize] += weight.abs();
            }
        }
        for found in contact.found(tools) {
            let yielding = |&(node, weight): &(u32, f64)| {
                let inverse = matrix(&system.inverse(self.nodes[node as usize]));
                let shared = self.shares[node as usize].max(weight.abs());
                weight.abs() * shared * found.normal.dot(&(inverse * found.normal))
            };
            let stiffness = STIFFNESS / found.carried.iter().map(yielding).sum::<f64>();
            // At first everything in contact sticks.
            let law = Law {
                is_pushed: found.is_touched(),
                grip: if found.friction > 0.0 { stiffness } else { 0.0 },
            };
            let start = self.carried.len();
            self.carried.extend_from_slice(found.carried);
            self.points.push(Point {
                normal: found.normal,
                start,
                end: self.carried.len(),
                stiffness,
                wanted: found.target_m / dt,
                tool_velocity: found.tool_velocity,
                friction: found.friction,
                law,
                next: law,
                is_wall: !found.is_movable,
                push: if found.is_movable { 0.0 } else { wall_n_m * found.depth_m * dt },
                drag: Vec3::zeros(),
            });
        }
        for point in self.points.iter().filter(|point| point.law.is_pushed) {
            let law = point.matrix();
            for &(node, weight) in &self.carried[point.start..point.end] {
                self.blocks[node as usize] += law * (weight * weight);
            }
        }
        for (&slot, more) in self.nodes.iter().zip(&self.blocks) {
            system.stiffen(slot, more);
        }
    }

    /// Adds what points in contact want to b.
    pub fn load<R: Real>(&self, sign: f64, system: &mut System<R>) {
        for point in self.points.iter().filter(|point| point.law.is_pushed) {
            let wanted = point.normal * (point.stiffness * point.wanted)
                + point.across(point.tool_velocity) * point.law.grip;
            for &(node, weight) in &self.carried[point.start..point.end] {
                let slot = self.nodes[node as usize];
                system.b.set(slot, system.b.vec3(slot) + wanted * (sign * weight));
            }
        }
        self.edges.load(sign, system);
    }

    /// Adds their part of A times `of` to q. Gives that part of p·A p. Alone.
    pub unsafe fn multiply<R: Real>(
        &self,
        parts: &Parts<R>,
        of: *const super::super::lanes::Octet<R>,
    ) -> f64 {
        // SAFETY: as the caller promises.
        let mut work = unsafe { self.edges.multiply(parts, of) };
        for point in self.points.iter().filter(|point| point.law.is_pushed) {
            let carried = &self.carried[point.start..point.end];
            // SAFETY: the caller is alone, and nodes have slots.
            let moving: Vec3 =
                carried.iter().map(|&(n, w)| unsafe { parts.vec3(of, self.nodes[n as usize]) } * w).sum();
            let answer = point.normal * (point.stiffness * moving.dot(&point.normal))
                + point.across(moving) * point.law.grip;
            work += moving.dot(&answer);
            for &(node, weight) in carried {
                let slot = self.nodes[node as usize];
                // SAFETY: as above.
                unsafe { parts.set(parts.q, slot, parts.vec3(parts.q, slot) + answer * weight) };
            }
        }
        work
    }

    /// Reads impulses from the step's `solution`th solution, and the laws that it asks for. Whether it was found with those.
    pub fn judge<R: Real>(&mut self, solution: usize, system: &System<R>) -> bool {
        let [mut largest, mut wrong] = self.edges.judge(solution, system);
        for point in self.points.iter_mut().filter(|point| !point.is_wall) {
            let carried = &self.carried[point.start..point.end];
            let moving: Vec3 = carried.iter().map(|&(n, w)| system.x.vec3(self.nodes[n as usize]) * w).sum();
            let push = point.stiffness * (point.wanted - moving.dot(&point.normal));
            let slip = point.across(point.tool_velocity - moving);
            let gives = point.law.is_pushed;
            (point.push, point.drag) =
                if gives { (push, slip * point.law.grip) } else { (0.0, Vec3::zeros()) };
            largest = largest.max(push);

            let cone = point.friction * push.max(0.0);
            let grip = point.stiffness.min(cone / slip.norm().max(f64::MIN_POSITIVE));
            point.next = Law { is_pushed: push > 0.0, grip };
            if gives != point.next.is_pushed {
                wrong = wrong.max(push.abs());
            }
            wrong = wrong.max((grip - point.law.grip).abs() * slip.norm());
        }
        wrong <= SETTLED * largest
    }

    /// Takes the laws that the last solution asks for.
    pub fn mend(&mut self) {
        self.points.iter_mut().for_each(|point| point.law = point.next);
        self.edges.mend();
    }

    /// What each point received in the last solution: along its normal, and across it.
    pub fn impulses(&self) -> impl Iterator<Item = (f64, Vec3)> {
        self.points.iter().map(|point| (point.push, point.drag))
    }
}

impl Point {
    fn across(&self, v: Vec3) -> Vec3 {
        v - self.normal * v.dot(&self.normal)
    }

    fn matrix(&self) -> Mat3 {
        let along = self.normal * self.normal.transpose();
        along * self.stiffness + (Mat3::identity() - along) * self.law.grip
    }
}
