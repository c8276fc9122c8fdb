//! Contact for a solver that finds impulses itself, together with all that tissue does in a step: where points are inside tools, and what they then receive.

use super::super::lanes::Real;
use super::super::nodes::Bricks;
use super::{ContactNodes, ContactSurface, PUSH_LIMIT};
use crate::math::Vec3;
use crate::solver::{ToolStep, ToolSum};

/// Share of a cell within which points are looked at whoever moves.
const NEAR: f64 = 0.05;

/// A point that is inside a tool at the end of a step if it stays where it is, or may come there.
#[derive(Clone, Copy, Debug)]
pub struct Found<'a> {
    /// Out of the tool.
    pub normal: Vec3,
    /// How far it must go to be out, in m, or how far it may be pushed at most, where that is less; below 0, how far it may come nearer.
    pub target_m: f64,
    /// Whether it was inside when the step began: tissue that is pressed follows a tool that leaves it.
    pub was_inside: bool,
    /// How deep it is inside, in m.
    pub depth_m: f64,
    /// Whether anything that carries it can move.
    pub is_movable: bool,
    /// Velocity of the tool there, m/s.
    pub tool_velocity: Vec3,
    /// Friction of the tool.
    pub friction: f64,
    /// Local nodes, and their weights.
    pub carried: &'a [(u32, f64)],
}

/// How far from tools points are looked at whoever moves, in m: tools go the fraction `span` of their ways, tissue `way`, and cells have edges of `h`. Tissue that
/// was pressed follows a tool that leaves it.
pub fn reach(tools: &[ToolStep], span: [f64; 2], way: f64, h: f64) -> f64 {
    let furthest = tools.iter().map(|tool| way_of(tool, span)).fold(0.0, f64::max);
    2.0 * (furthest + way.min(h)) + NEAR * h
}

fn way_of(tool: &ToolStep, span: [f64; 2]) -> f64 {
    tool.path.reach(tool.desc.bounding_radius_m()) * (span[1] - span[0])
}

impl Found<'_> {
    /// Whether it can be moved, and probably has to be.
    pub fn is_touched(&self) -> bool {
        self.is_movable && (self.target_m > 0.0 || self.was_inside)
    }
}

impl ContactSurface {
    /// Looks for points that are inside tools, as these are at the end of a step, or that may come there, nodes being where they are at its start. `span` is the
    /// fraction of the tools' ways in that step, and `moved` bounds how far nodes of a brick are from rest, in m.
    pub fn look_ahead<R: Real>(
        &mut self,
        bricks: &Bricks,
        tools: &[ToolStep],
        span: [f64; 2],
        nodes: &ContactNodes<R>,
        moved: impl Fn(usize) -> f64,
    ) {
        self.points.clear();
        if tools.is_empty() {
            self.near.forget();
            return;
        }
        self.travel(nodes.furthest);
        let follow = tools.iter().any(|tool| way_of(tool, span) > 0.5 * tool.desc.feature_m());
        let reach = reach(tools, span, nodes.fastest * nodes.dt, self.model.lattice().cell_m());
        self.keep_up(bricks, tools, nodes.u, reach, moved);
        if !self.near.triangles().is_empty() {
            self.find_points(tools, span, follow, false, reach, nodes);
        }
    }

    /// How many points, nodes that carry them and weights there can be at most.
    pub fn room(&self) -> [usize; 3] {
        [self.points.capacity(), self.nodes.capacity(), self.carried.capacity()]
    }

    /// The points that were found.
    pub fn found<'a>(&'a self, tools: &'a [ToolStep]) -> impl Iterator<Item = Found<'a>> {
        let limit = PUSH_LIMIT * self.model.lattice().cell_m();
        self.points.iter().map(move |point| Found {
            normal: point.normal,
            target_m: point.depth.min((limit + point.travel) * point.lever),
            was_inside: point.was_inside,
            depth_m: point.depth.max(0.0),
            is_movable: point.is_movable,
            tool_velocity: point.tool_velocity,
            friction: tools[point.tool as usize].desc.friction,
            carried: &self.carried[point.start as usize..point.end as usize],
        })
    }

    /// Slots of the nodes that carry points, by their local numbers.
    pub fn carriers(&self) -> impl Iterator<Item = u32> {
        self.nodes.iter().map(|node| node.slot)
    }

    /// Notes what each point received, along its normal and across it, in N s, and adds it to the sums of the tools, which are at the fraction `t` of their ways.
    pub fn answer(
        &mut self,
        tools: &[ToolStep],
        t: f64,
        impulses: impl Iterator<Item = (f64, Vec3)>,
        sums: &mut [ToolSum],
    ) {
        for (point, (push, drag)) in self.points.iter_mut().zip(impulses) {
            (point.push, point.drag) = (push, drag);
        }
        self.tell(tools, t, sums);
    }
}
