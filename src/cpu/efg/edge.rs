//! Edges of blades inside the implicit step.
//!
//! In a long step tissue springs back within the step: an impulse on the masses of nodes alone, once it has ended, would throw them far along for next to no force. So what sticks to an edge is part of A and b: a
//! spring that is far stiffer than the tissue gives a point the edge's velocity, across the edge; and where that takes more than the tissue's toughness, the tissue receives that, in the direction in which the edge
//! goes on, and slips. Which of the two a point does follows from the solution before. What springs leave of the slip is taken by [`Hold`](super::super::hold::Hold) when all has moved, which goes on
//! from the impulses that are found here.

use super::super::lanes::{Octet, Real};
use super::super::mobile::free;
use super::block::matrix;
use super::system::{Parts, System};
use crate::math::{Mat3, Vec3};
use crate::solver::ToolStep;

/// How much stiffer a point that sticks is than the tissue: with what contact has, a solution would take three times as many iterations, and what is missing is made up for afterwards.
const STIFFNESS: f64 = 10.0;
/// Change of an impulse, as a share of what the point takes at most, that asks for another solution; and how much more than that a point may have taken that sticks.
const SETTLED: f64 = 0.1;
const EXCESS: f64 = 0.01;
/// Solutions after which only what has taken too much asks for another one.
const MOST_SOLUTIONS: usize = 2;

/// A point of an edge in tissue.
#[derive(Clone, Copy, Debug)]
struct Point {
    nodes: [u32; 8],
    weights: [f64; 8],
    /// Of the edge: tissue slides along it.
    along: Vec3,
    /// Of the edge there, m/s.
    velocity: Vec3,
    /// Impulse per slip of a point that sticks, in kg.
    stiffness: f64,
    /// Above this impulse tissue gives way, in N s.
    most: f64,
    answer: Answer,
    /// What the last solution asks for.
    next: Answer,
    /// What the tissue received in it, in N s.
    impulse: Vec3,
}

/// How tissue answers at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Answer {
    Sticks,
    /// It slips, and receives this impulse.
    Gives(Vec3),
}

/// All points of edges in tissue in a step. Keeps its memory.
#[derive(Debug, Default)]
pub struct Edges {
    points: Vec<Point>,
}

impl Edges {
    /// Whether none sticks: then A is what it is without edges.
    pub fn are_free(&self) -> bool {
        self.points.iter().all(|point| point.answer != Answer::Sticks)
    }

    /// Takes the points of all edges, which are at the fraction `t` of their tools' ways, in a step of `dt` seconds of `step`, of nodes with these flags; and adds what sticks to the system's blocks. Velocities at the
    /// start of the step are in x.
    pub fn begin<R: Real>(
        &mut self,
        tools: &[ToolStep],
        t: f64,
        [dt, step]: [f64; 2],
        flags: &[u8],
        system: &mut System<R>,
    ) {
        self.points.clear();
        for tool in tools.iter().filter(|tool| !tool.held.is_empty()) {
            let pose = tool.path.at(t);
            for held in tool.held.iter() {
                let arm = pose.rotation * held.at;
                let give = |(slot, weight): (u32, f64)| {
                    let inverse = matrix(&system.inverse(slot)).diagonal();
                    weight * weight * inverse.dot(&free(flags[slot as usize])) / 3.0
                };
                let give: f64 = held.nodes.into_iter().zip(held.weights).map(give).sum();
                let mut point = Point {
                    nodes: held.nodes,
                    weights: held.weights,
                    along: pose.rotation * held.along,
                    velocity: tool.path.velocity(&pose, pose.translation.vector + arm, step),
                    // What cannot move does not stick.
                    stiffness: if give > 0.0 { STIFFNESS / give } else { 0.0 },
                    most: held.limit_n * dt,
                    answer: Answer::Sticks,
                    next: Answer::Sticks,
                    impulse: Vec3::zeros(),
                };
                // Tissue that went along goes on to stick; what it would take is guessed without the spring's stiffness.
                let slip = point.slip(|slot| system.x.vec3(slot));
                point.answer = point.limited(slip * (point.stiffness / STIFFNESS));
                self.points.push(point);
            }
        }
        for point in self.points.iter().filter(|point| point.answer == Answer::Sticks) {
            let law = point.across() * point.stiffness;
            for (slot, weight) in point.carriers() {
                system.stiffen(slot, &(law * (weight * weight)));
            }
        }
    }

    /// Adds to b what points want, or receive.
    pub fn load<R: Real>(&self, sign: f64, system: &mut System<R>) {
        for point in &self.points {
            let wanted = match point.answer {
                Answer::Sticks => point.across() * point.velocity * point.stiffness,
                Answer::Gives(impulse) => impulse,
            };
            for (slot, weight) in point.carriers() {
                system.b.set(slot, system.b.vec3(slot) + wanted * (sign * weight));
            }
        }
    }

    /// Adds their part of A times `of` to q. Gives that part of p·A p. Alone.
    pub unsafe fn multiply<R: Real>(&self, parts: &Parts<R>, of: *const Octet<R>) -> f64 {
        let mut work = 0.0;
        for point in self.points.iter().filter(|point| point.answer == Answer::Sticks) {
            // SAFETY: the caller is alone, and nodes have slots.
            let moving: Vec3 = point.carriers().map(|(slot, w)| unsafe { parts.vec3(of, slot) } * w).sum();
            let answer = point.across() * moving * point.stiffness;
            work += moving.dot(&answer);
            for (slot, weight) in point.carriers() {
                // SAFETY: as above.
                unsafe { parts.set(parts.q, slot, parts.vec3(parts.q, slot) + answer * weight) };
            }
        }
        work
    }

    /// Reads impulses from the step's `solution`th solution, and the answers that it asks for. Gives the largest of all, and by how much one is wrong, as far as that asks for another one.
    pub fn judge<R: Real>(&mut self, solution: usize, system: &System<R>) -> [f64; 2] {
        let (mut largest, mut wrong) = (0.0_f64, 0.0_f64);
        for point in &mut self.points {
            let slip = point.slip(|slot| system.x.vec3(slot));
            (point.impulse, point.next) = match point.answer {
                Answer::Sticks => {
                    let impulse = slip * point.stiffness;
                    (impulse, point.limited(impulse))
                }
                // It has gone ahead of the edge: that would have taken less.
                Answer::Gives(impulse) if slip.dot(&impulse) < 0.0 => (impulse, Answer::Sticks),
                Answer::Gives(impulse) => {
                    (impulse, point.limited(impulse + slip * (point.stiffness / STIFFNESS)))
                }
            };
            largest = largest.max(point.impulse.norm());
            let takes_too_much = point.answer == Answer::Sticks && point.next != Answer::Sticks;
            let change = match (point.answer, point.next) {
                (Answer::Sticks, Answer::Sticks) => 0.0,
                (Answer::Gives(_), Answer::Sticks) => point.most,
                (_, Answer::Gives(next)) => (next - point.impulse).norm(),
            };
            let settled = if takes_too_much { EXCESS } else { SETTLED };
            if change > settled * point.most && (takes_too_much || solution < MOST_SOLUTIONS) {
                wrong = wrong.max(change);
            }
            // What has slipped goes on to, so that this comes to an end.
            if solution >= MOST_SOLUTIONS && point.answer != Answer::Sticks {
                point.next = point.answer;
            }
        }
        [largest, wrong]
    }

    /// Takes the answers that the last solution asks for.
    pub fn mend(&mut self) {
        self.points.iter_mut().for_each(|point| point.answer = point.next);
    }

    /// What the tissue received at each point in the last solution, tool by tool, in N s.
    pub fn impulses(&self) -> impl Iterator<Item = Vec3> {
        self.points.iter().map(|point| point.impulse)
    }
}

impl Point {
    fn carriers(&self) -> impl Iterator<Item = (u32, f64)> {
        self.nodes.into_iter().zip(self.weights)
    }

    /// Takes the part of a vector across the edge.
    fn across(&self) -> Mat3 {
        Mat3::identity() - self.along * self.along.transpose()
    }

    /// How fast the edge moves ahead of the tissue, m/s.
    fn slip(&self, velocity: impl Fn(u32) -> Vec3) -> Vec3 {
        self.across()
            * (self.velocity - self.carriers().map(|(slot, weight)| velocity(slot) * weight).sum::<Vec3>())
    }

    /// What comes of an impulse that would make it stick.
    fn limited(&self, impulse: Vec3) -> Answer {
        let size = impulse.norm();
        if size <= self.most { Answer::Sticks } else { Answer::Gives(impulse * (self.most / size)) }
    }
}
