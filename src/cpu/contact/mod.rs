//! Contact of tools with the tissue's surface, by projection.
//!
//! Contact points are the vertices near a tool; where a triangle is longer at rest than a third of the size of a part of the tool, the centres of
//! small triangles into which it is divided meet that part in their stead, so that a tip smaller than a cell glides over the cells. By its length
//! at rest, for points that came and went with the strain would make the force jump. A point that the free
//! motion has put inside a tool is put back on its surface within the same substep. The impulse for that
//! is found by projected Gauss–Seidel over all points and tools together (normal impulses push only, tangential ones stay in
//! Coulomb's cone), on the masses of the nodes that carry the points. Because the tool receives exactly what the nodes receive,
//! Newton's third law holds to rounding.
//!
//! A tool that moves more than half its feature size in a substep is taken there in several smaller moves, each with its own
//! projection; a point that itself moves that far (stretched tissue springs back fast) is followed along its way. So neither can
//! pass through the other.
//!
//! A point carried by held nodes alone (bone) cannot move. It answers with the impulse that would have moved its masses: a stiff wall
//! without friction.

mod awake;
pub mod found;
mod near;
mod node_index;

use std::sync::Arc;

use self::awake::{Awake, Ball};
use self::near::{Listed, Near, position};
use self::node_index::{MAX_NODES, NodeIndex};
use super::lanes::Real;
use super::nodes::{Bricks, Field};
use crate::cut::surface::drawn::Redrawn;
use crate::math::{Pose, Vec3};
use crate::model::Model;
use crate::model::lattice::{BRICK_SLOTS, flag};
use crate::model::surface::{Edges, ROW, Surface};
use crate::solver::tool::{Contact, Nearest};
use crate::solver::{ToolStep, ToolSum};

/// Most points in contact at once; the first that are found are kept, and what is dropped is counted.
const MAX_POINTS: usize = 4096;
/// Most sweeps of the Gauss–Seidel iteration: a few do, but where many points hang on few nodes.
const SWEEPS: usize = 64;
/// A sweep is the last when it changes no impulse by more than this share of the largest.
const CONVERGED: f64 = 1e-3;
/// Most moves of a tool in a substep.
const MAX_MOVES: f64 = 64.0;
/// Share of a cell by which a node may be pushed in one substep, besides the tool's own motion.
const PUSH_LIMIT: f64 = 0.25;
/// Of a point's mobility, how much must belong to free nodes for the point to count as movable.
const MOVABLE: f64 = 1e-3;

/// What contact may read and write of the nodes.
#[derive(Debug)]
pub struct ContactNodes<'a, R> {
    /// Displacement at the start of the substep.
    pub u_before: &'a Field<R>,
    /// Displacement at the end of the substep.
    pub u: &'a mut Field<R>,
    /// Velocity.
    pub v: &'a mut Field<R>,
    /// Flag bits.
    pub flags: &'a [u8],
    /// The bricks that the nodes are in.
    pub bricks: &'a Bricks,
    /// Corner mass of each material in kg.
    pub corner_kg: &'a [f64; 16],
    /// Substep in s.
    pub dt: f64,
    /// Step in s: the time that the tools' paths take.
    pub step: f64,
    /// The fastest node in this substep, in m/s.
    pub fastest: f64,
    /// How far a node has moved in this substep at most, in m.
    pub furthest: f64,
}

/// Contact with one model's contact surface. Everything is allocated once.
#[derive(Debug)]
pub struct ContactSurface {
    model: Arc<Model>,
    surface: Arc<Surface>,
    near: Near,
    edges: Edges,
    awake: Awake,
    /// Which of the listed vertices a tool has been asked about.
    probed: Vec<bool>,
    points: Vec<Point>,
    carried: Vec<(u32, f64)>,
    nodes: Vec<TouchedNode>,
    index: NodeIndex,
    /// Bricks of nodes that were pushed in the last substep, each once.
    touched_bricks: Vec<u32>,
    dropped: u64,
}

#[derive(Clone, Copy, Debug)]
struct Point {
    tool: u32,
    triangle: u32,
    /// Of the triangle's corners in it.
    shares: [f64; 3],
    /// Range in `carried`: local nodes and weights.
    start: u32,
    end: u32,
    position: Vec3,
    /// Out of the tool.
    normal: Vec3,
    depth: f64,
    /// Velocity of the tool there.
    tool_velocity: Vec3,
    /// How far the point came, seen from the tool, in this move.
    travel: f64,
    /// Whether it was inside the tool when the move began.
    was_inside: bool,
    /// 1 / Σ w²/m over free nodes, or over all nodes where none is free.
    mass: f64,
    /// How far the point may be pushed for each metre that its fastest node moves: below 1 where held nodes carry most of it.
    lever: f64,
    is_movable: bool,
    /// Impulse on the tissue in N s: along the normal, and across it.
    push: f64,
    drag: Vec3,
}

#[derive(Clone, Copy, Debug)]
struct TouchedNode {
    slot: u32,
    /// 1 / mass along each free axis, else 0.
    mobility: Vec3,
    inverse_mass: f64,
    velocity: Vec3,
    change: Vec3,
}

/// A tool at the end of a move.
struct View<'a> {
    number: u32,
    tool: &'a ToolStep,
    pose: Pose,
    to_tool: Pose,
    /// From where the tool was when the move began to where it is.
    carry_over: Pose,
    /// How far a point may come before its way matters.
    stride: f64,
    ball: Ball,
    /// How far from the tool a point may be.
    reach: f64,
}

/// Which parts of tools a point of the surface meets: those that divide triangles with this longest edge so.
#[derive(Clone, Copy)]
struct Fit {
    edge: f32,
    division: u32,
}

impl View<'_> {
    /// How the parts of the tool that may be at a triangle divide it. Where ways matter, all of them may be.
    fn divisions(&self, corners: [Vec3; 3], edge: f32, follow: bool) -> u32 {
        if let [(_, shape)] = self.tool.desc.parts[..] {
            return 1 << (shape.division(edge) - 1);
        }
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let size = corners.map(|corner| (corner - middle).norm()).into_iter().fold(0.0, f64::max);
        let reach = if follow { f64::INFINITY } else { size };
        self.tool.desc.divisions(self.to_tool.transform_point(&middle.into()).coords, reach, edge)
    }

    /// Where a point was when the move began, seen from the tool.
    fn start(&self, before: Vec3) -> Vec3 {
        self.carry_over.transform_point(&before.into()).coords
    }
}

impl ContactSurface {
    /// Prepares the contact surface of a model.
    pub fn new(model: Arc<Model>) -> Self {
        let surface = model.surfaces()[model.contact_surface()].clone();
        let vertices = surface.positions.len();
        Self {
            near: Near::new(&surface, model.lattice()),
            awake: Awake::new(surface.triangles.len(), vertices),
            probed: Vec::with_capacity(vertices),
            edges: surface.edges(),
            surface,
            points: Vec::with_capacity(MAX_POINTS),
            carried: Vec::with_capacity(MAX_POINTS * 3 * ROW),
            nodes: Vec::with_capacity(MAX_NODES),
            index: NodeIndex::new(),
            touched_bricks: Vec::with_capacity(MAX_NODES),
            dropped: 0,
            model,
        }
    }

    /// A cut has made another surface of it.
    pub fn follow(&mut self, surface: &Surface, redrawn: &Redrawn) {
        self.clear();
        if redrawn.is_empty() {
            return;
        }
        let own = Arc::make_mut(&mut self.surface);
        redrawn.copy(surface, own);
        if redrawn.is_all {
            self.renew();
            return;
        }
        let moved = redrawn.moved(own);
        self.near.follow(own, self.model.lattice(), &moved, &redrawn.vertices);
        self.edges.follow(own, &moved, &redrawn.fans);
        self.awake.reserve(own.triangles.len(), own.positions.len());
        self.probed.clear();
        self.probed.reserve(own.positions.len());
    }

    /// The tissue is whole again.
    pub fn heal(&mut self) {
        self.surface = self.model.surfaces()[self.model.contact_surface()].clone();
        self.clear();
        self.renew();
    }

    /// The surface may be another one altogether.
    fn renew(&mut self) {
        let vertices = self.surface.positions.len();
        self.near = Near::new(&self.surface, self.model.lattice());
        self.awake = Awake::new(self.surface.triangles.len(), vertices);
        self.probed = Vec::with_capacity(vertices);
        self.edges = self.surface.edges();
    }

    /// Bricks whose nodes were pushed in the last substep.
    pub fn touched_bricks(&self) -> &[u32] {
        &self.touched_bricks
    }

    /// Points in contact in the last substep.
    pub fn point_count(&self) -> usize {
        self.points.iter().filter(|p| p.push > 0.0).count()
    }

    /// Points that found no room since creation.
    pub fn dropped_points(&self) -> u64 {
        self.dropped
    }

    /// Forgets all contacts.
    pub fn clear(&mut self) {
        self.points.clear();
        self.touched_bricks.clear();
    }

    /// Nodes have been moved otherwise than by substeps.
    pub fn lose_track(&mut self) {
        self.near.forget();
    }

    /// Pushes the tissue out of the tools at the end of a substep that spans the fractions `from` to `to` of the step, and adds to
    /// each tool's sum. `moved` bounds how far nodes of a brick were from rest at its start, in m.
    pub fn resolve<R: Real>(
        &mut self,
        bricks: &Bricks,
        tools: &[ToolStep],
        span: [f64; 2],
        nodes: &mut ContactNodes<R>,
        moved: impl Fn(usize) -> f64,
        sums: &mut [ToolSum],
    ) {
        self.points.clear();
        self.touched_bricks.clear();
        if tools.is_empty() {
            self.near.forget();
            return;
        }
        self.travel(nodes.furthest);
        let way = |tool: &ToolStep| tool.path.reach(tool.desc.bounding_radius_m()) * (span[1] - span[0]);
        let moves = tools
            .iter()
            .map(|tool| (way(tool) / (0.5 * tool.desc.feature_m())).ceil())
            .fold(1.0, f64::max)
            .min(MAX_MOVES);
        // Where a point came from matters only if it may have come far.
        let is_fast = |tool: &ToolStep| {
            let feature = tool.desc.feature_m();
            nodes.fastest * nodes.dt > 0.25 * feature || way(tool) > 0.5 * feature * moves
        };
        let follow = tools.iter().any(is_fast);
        let mut pushed = 0.0;
        for step in 1..=moves as u32 {
            let t = span[0] + (span[1] - span[0]) * f64::from(step) / moves;
            let before = span[0] + (span[1] - span[0]) * f64::from(step - 1) / moves;
            self.keep_up(bricks, tools, nodes.u, 0.0, |brick| moved(brick) + nodes.furthest + pushed);
            if self.near.triangles().is_empty() {
                continue;
            }
            // The tissue's own motion belongs to the first move.
            self.find_points(tools, [before, t], follow, step == 1, 0.0, nodes);
            if self.points.is_empty() {
                continue;
            }
            self.project(tools, nodes.dt, step == moves as u32);
            let push = self.apply(tools, t, nodes, sums);
            self.travel(push);
            pushed += push;
        }
    }

    /// No node has moved further than this since the last call, but for the rounding of its displacement.
    fn travel(&mut self, distance: f64) {
        self.near.travel(distance);
        self.awake.travel(distance);
    }

    /// Lists the triangles anew that tools may meet, where the list is no longer good.
    fn keep_up<R: Real>(
        &mut self,
        bricks: &Bricks,
        tools: &[ToolStep],
        u: &Field<R>,
        reach: f64,
        moved: impl Fn(usize) -> f64,
    ) {
        if self.near.keep_up(&self.surface, bricks, tools, u, reach, moved) {
            self.awake.restart();
        }
    }

    /// The contacts of one tool in the last substep, model frame; forces are those of that substep.
    pub fn contacts_of(&self, tool: u32, dt: f64) -> impl Iterator<Item = Contact> + '_ {
        let surface = &self.surface;
        self.points.iter().filter(move |p| p.tool == tool && p.push > 0.0).map(move |p| Contact {
            point_m: p.position,
            normal: p.normal,
            depth_m: p.depth,
            force_n: (p.normal * p.push + p.drag) / dt,
            material: surface.materials[surface.triangles[p.triangle as usize][0] as usize],
            vertices: surface.triangles[p.triangle as usize],
            shares: p.shares,
        })
    }

    /// Finds the contact points inside tools, or as near to them as `reach`, and the nodes that carry them.
    /// `span` is the move that the tools make; the tissue moves with it, from where it was before the substep, if `tissue_moves`. Points are
    /// followed along their ways, not looked at where they end alone, if `follow`.
    fn find_points<R: Real>(
        &mut self,
        tools: &[ToolStep],
        span: [f64; 2],
        follow: bool,
        tissue_moves: bool,
        reach: f64,
        nodes: &ContactNodes<R>,
    ) {
        self.points.clear();
        self.carried.clear();
        self.nodes.clear();
        self.index.clear();
        let surface = self.surface.clone();
        let ball = |tool: &ToolStep| Ball {
            centre: tool.path.at(span[1]).translation.vector,
            radius: tool.desc.bounding_radius_m() + reach,
        };
        self.awake.sort_out(&self.near, tools.iter().map(ball), follow, |vertex| {
            let after = position(&surface, vertex, nodes.u);
            (if follow && tissue_moves { position(&surface, vertex, nodes.u_before) } else { after }, after)
        });

        for (number, tool) in tools.iter().enumerate() {
            let pose = tool.path.at(span[1]);
            let view = View {
                number: number as u32,
                tool,
                to_tool: pose.inverse(),
                stride: 0.5 * tool.desc.feature_m(),
                ball: ball(tool),
                reach,
                carry_over: pose * tool.path.at(span[0]).inverse(),
                pose,
            };
            self.probed.clear();
            self.probed.resize(self.near.vertices().len(), false);
            for at in 0..self.awake.triangles().len() {
                let listed = self.awake.triangles()[at];
                let corners = self.awake.corners(&listed);
                let [(a0, a), (b0, b), (c0, c)] = corners;
                let gap = if follow {
                    view.ball.gap(&[a, b, c, view.start(a0), view.start(b0), view.start(c0)])
                } else {
                    view.ball.gap(&[a, b, c])
                };
                if gap > 0.0 {
                    continue;
                }
                let Listed { triangle, places } = listed;
                let edge = self.edges.of_triangles[triangle as usize];
                let divisions = view.divisions(corners.map(|c| c.1), edge, follow);
                for (c, place) in places.into_iter().enumerate().filter(|_| divisions & 1 != 0) {
                    // A corner once for all triangles around it.
                    if !std::mem::replace(&mut self.probed[place as usize], true) {
                        let vertex = surface.triangles[triangle as usize][c];
                        let fit = Fit { edge: self.edges.of_vertices[vertex as usize], division: 1 };
                        let weights = std::array::from_fn(|i| if i == c { 1.0 } else { 0.0 });
                        self.probe(&view, triangle, fit, weights, corners[c], nodes);
                    }
                }
                for division in (2..=u32::BITS).filter(|n| divisions >> (n - 1) & 1 != 0) {
                    for_each_centre(division, |weights| {
                        let between =
                            |p: [Vec3; 3]| p[0] * weights[0] + p[1] * weights[1] + p[2] * weights[2];
                        let way = (between(corners.map(|c| c.0)), between(corners.map(|c| c.1)));
                        self.probe(&view, triangle, Fit { edge, division }, weights, way, nodes);
                    });
                }
            }
        }
    }

    /// Makes a contact point of a point of the surface that moves from `before` to `p`, if it meets the tool.
    fn probe<R: Real>(
        &mut self,
        view: &View,
        triangle: u32,
        fit: Fit,
        weights: [f64; 3],
        (before, p): (Vec3, Vec3),
        nodes: &ContactNodes<R>,
    ) {
        let local = |p: Vec3| view.to_tool.transform_point(&p.into()).coords;
        let start = view.start(before);
        let travel = (p - start).norm();
        let met = if travel <= view.stride {
            if (p - view.ball.centre).norm_squared() >= view.ball.radius * view.ball.radius {
                return;
            }
            Some(view.tool.desc.distance(local(p))).filter(|met| met.distance < view.reach)
        } else {
            view.tool.desc.meet(local(start), local(p), travel / view.stride)
        };
        let is_fit = |met: &Nearest| view.tool.desc.parts[met.part].1.division(fit.edge) == fit.division;
        let Some(Nearest { distance, normal, .. }) = met.filter(is_fit) else { return };
        let point = Point {
            tool: view.number,
            triangle,
            shares: weights,
            start: self.carried.len() as u32,
            end: self.carried.len() as u32,
            position: p,
            normal: view.pose * normal,
            depth: -distance,
            tool_velocity: view.tool.path.velocity(&view.pose, p, nodes.step),
            travel,
            was_inside: view.reach > 0.0 && view.tool.desc.distance(local(start)).distance < 0.0,
            mass: 0.0,
            lever: 1.0,
            is_movable: false,
            push: 0.0,
            drag: Vec3::zeros(),
        };
        if !self.carry(point, nodes) && distance < 0.0 {
            self.dropped += 1;
        }
    }

    /// Adds a point and the nodes of its row; false where there is no room.
    fn carry<R: Real>(&mut self, mut point: Point, nodes: &ContactNodes<R>) -> bool {
        if self.points.len() == MAX_POINTS || self.nodes.len() + 3 * ROW > MAX_NODES {
            return false;
        }
        let surface = self.surface.clone();
        let start = point.start as usize;
        let vertices = surface.triangles[point.triangle as usize];
        for (vertex, share) in vertices.into_iter().zip(point.shares).filter(|(_, share)| *share != 0.0) {
            let row = &surface.rows[vertex as usize];
            for i in (0..ROW).filter(|&i| row.weights[i] != 0.0) {
                let weight = share * f64::from(row.weights[i]);
                let local = self.local_node(row.nodes[i], nodes);
                match self.carried[start..].iter_mut().find(|(node, _)| *node == local) {
                    Some((_, sum)) => *sum += weight,
                    None => self.carried.push((local, weight)),
                }
            }
        }
        point.end = self.carried.len() as u32;

        let (mut free, mut all) = (0.0, 0.0);
        for &(node, weight) in &self.carried[start..] {
            let node = &self.nodes[node as usize];
            let along = node.mobility.component_mul(&point.normal).dot(&point.normal);
            free += weight * weight * along;
            all += weight * weight * node.inverse_mass;
        }
        point.is_movable = free > MOVABLE * all;
        point.mass = 1.0 / if point.is_movable { free } else { all };
        let fastest = self.carried[start..]
            .iter()
            .map(|&(node, weight)| weight.abs() * self.nodes[node as usize].mobility.max() * point.mass);
        point.lever = 1.0 / fastest.fold(1.0, f64::max);
        self.points.push(point);
        true
    }

    /// The local number of a node, which is read when first met.
    fn local_node<R: Real>(&mut self, slot: u32, nodes: &ContactNodes<R>) -> u32 {
        let fresh = self.nodes.len() as u32;
        let local = self.index.find_or_insert(slot, fresh);
        if local == fresh {
            let inverse_mass =
                1.0 / nodes.bricks.node_mass(slot, |material| nodes.corner_kg[usize::from(material)]);
            let flags = nodes.flags[slot as usize];
            // What a tool holds yields to none.
            let held = if flags & flag::GRASPED == 0 { flags } else { flag::FIX_ALL };
            let mobility =
                Vec3::from_fn(|axis, _| if held & (flag::FIX_X << axis) == 0 { inverse_mass } else { 0.0 });
            let velocity = nodes.v.vec3(slot);
            self.nodes.push(TouchedNode { slot, mobility, inverse_mass, velocity, change: Vec3::zeros() });
        }
        local
    }

    /// Finds impulses that put every point on its tool.
    fn project(&mut self, tools: &[ToolStep], dt: f64, is_last_move: bool) {
        let limit = PUSH_LIMIT * self.model.lattice().cell_m();
        for sweep in 0..SWEEPS {
            let (mut largest, mut change_of_any) = (0.0_f64, 0.0_f64);
            for point in &mut self.points {
                let carried = &self.carried[point.start as usize..point.end as usize];
                let tool = &tools[point.tool as usize];
                let target = point.depth.min((limit + point.travel) * point.lever);
                if !point.is_movable {
                    // It stays inside the tool: of several moves in a substep the last alone counts.
                    if sweep == 0 && is_last_move {
                        point.push = point.mass * point.depth / dt;
                    }
                    continue;
                }

                // Along the normal: the rest of the depth, by pushing alone.
                let velocity = |nodes: &[TouchedNode]| -> (Vec3, Vec3) {
                    carried.iter().fold(
                        (Vec3::zeros(), Vec3::zeros()),
                        |(before, change), &(node, weight)| {
                            let node = &nodes[node as usize];
                            (before + node.velocity * weight, change + node.change * weight)
                        },
                    )
                };
                let (before, change) = velocity(&self.nodes);
                let wanted = point.push + point.mass * (target / dt - change.dot(&point.normal));
                let pushed = wanted.max(0.0) - point.push;
                point.push += pushed;

                // Across it: with the tool, inside Coulomb's cone.
                let slip = before + change - point.tool_velocity;
                let slip = slip - point.normal * slip.dot(&point.normal);
                let cone = tool.desc.friction * point.push;
                let mut drag = point.drag - slip * point.mass;
                let size = drag.norm();
                if size > cone {
                    drag *= cone / size;
                }
                let dragged = drag - point.drag;
                point.drag = drag;

                let impulse = point.normal * pushed + dragged;
                largest = largest.max(point.push);
                change_of_any = change_of_any.max(impulse.norm());
                for &(node, weight) in carried {
                    let node = &mut self.nodes[node as usize];
                    node.change += node.mobility.component_mul(&impulse) * weight;
                }
            }
            if change_of_any <= CONVERGED * largest {
                break;
            }
        }
    }

    /// Writes the changed velocities and displacements, and adds up what tools gave. Returns how far a node was pushed at most, in m.
    fn apply<R: Real>(
        &mut self,
        tools: &[ToolStep],
        t: f64,
        nodes: &mut ContactNodes<R>,
        sums: &mut [ToolSum],
    ) -> f64 {
        let mut furthest2 = 0.0_f64;
        for node in self.nodes.iter().filter(|node| node.change != Vec3::zeros()) {
            nodes.v.set(node.slot, node.velocity + node.change);
            let u = nodes.u.vec3(node.slot);
            nodes.u.set(node.slot, u + node.change * nodes.dt);
            furthest2 = furthest2.max(node.change.norm_squared());
            let brick = node.slot / BRICK_SLOTS as u32;
            let has_room = self.touched_bricks.len() < self.touched_bricks.capacity();
            if has_room && !self.touched_bricks.contains(&brick) {
                self.touched_bricks.push(brick);
            }
        }
        self.tell(tools, t, sums);
        furthest2.sqrt() * nodes.dt
    }

    /// Adds up what tools gave.
    fn tell(&self, tools: &[ToolStep], t: f64, sums: &mut [ToolSum]) {
        for point in &self.points {
            let tool = &tools[point.tool as usize];
            let origin = tool.path.at(t).translation.vector;
            let impulse = point.normal * point.push + point.drag;
            let sum = &mut sums[point.tool as usize];
            sum.impulse.force_n -= impulse;
            sum.impulse.torque_n_m -= (point.position - origin).cross(&impulse);
            sum.work_j += impulse.dot(&point.tool_velocity);
        }
    }
}

/// Barycentric coordinates of the centres of the n² equal triangles that an edge division by n gives.
fn for_each_centre(n: u32, mut visit: impl FnMut([f64; 3])) {
    let third = 1.0 / (3.0 * f64::from(n));
    for i in 0..n {
        for j in 0..n - i {
            let (a, b) = (f64::from(3 * i + 1) * third, f64::from(3 * j + 1) * third);
            visit([1.0 - a - b, a, b]);
            // The triangle that points the other way shares the edge opposite to corner (i, j).
            if i + j + 2 <= n {
                let (a, b) = (f64::from(3 * i + 2) * third, f64::from(3 * j + 2) * third);
                visit([1.0 - a - b, a, b]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn division_covers_the_triangle_evenly() {
        for n in 1..6 {
            let (mut count, mut sum) = (0, Vec3::zeros());
            for_each_centre(n, |w| {
                assert!((w[0] + w[1] + w[2] - 1.0).abs() < 1e-15 && w.iter().all(|x| *x > 0.0));
                count += 1;
                sum += Vec3::from(w);
            });
            assert_eq!(count, n * n);
            assert!((sum / f64::from(count) - Vec3::repeat(1.0 / 3.0)).norm() < 1e-14);
        }
    }
}
