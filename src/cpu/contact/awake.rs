//! Which of the listed triangles tools may meet now, and where the corners of those are.
//!
//! A triangle that lies apart from every tool is left alone until tools and tissue together have gone as far as that gap is wide. So in most
//! substeps most of a list is not looked at, and most of its vertices are not moved.

use super::near::{Listed, Near};
use crate::math::Vec3;

/// Tools for which memory is taken at creation.
pub const USUAL_TOOLS: usize = 64;

/// Around all that is in a tool's reach.
#[derive(Clone, Copy, Debug)]
pub struct Ball {
    pub centre: Vec3,
    pub radius: f64,
}

impl Ball {
    /// How far points, and all that is between them, lie apart from it at least; not above 0 where they may not.
    pub fn gap<const N: usize>(&self, points: &[Vec3; N]) -> f64 {
        let middle = points.iter().sum::<Vec3>() / N as f64;
        let size2 = points.iter().map(|point| (point - middle).norm_squared()).fold(0.0, f64::max);
        (middle - self.centre).norm() - size2.sqrt() - self.radius
    }
}

/// For a listed triangle: up to which way of tools and of its own points no tool can meet it, in m.
#[derive(Clone, Copy, Debug)]
struct Quiet {
    until: f64,
    /// How much further than the nodes its points may move.
    lever: f32,
}

/// The triangles that may be met. Everything is allocated once.
#[derive(Debug)]
pub struct Awake {
    /// How far nodes, and tools, may have moved since the list was made, in m.
    nodes_way: f64,
    tools_way: f64,
    quiet: Vec<Quiet>,
    balls: Vec<Ball>,
    triangles: Vec<Listed>,
    /// By a vertex's place in the list: where it was and where it is, if it is a corner of a triangle that may be met.
    corners: Vec<(Vec3, Vec3)>,
    is_placed: Vec<bool>,
}

impl Awake {
    /// For lists of at most so many triangles and vertices.
    pub fn new(triangles: usize, vertices: usize) -> Self {
        Self {
            nodes_way: 0.0,
            tools_way: 0.0,
            quiet: Vec::with_capacity(triangles),
            balls: Vec::with_capacity(USUAL_TOOLS),
            triangles: Vec::with_capacity(triangles),
            corners: Vec::with_capacity(vertices),
            is_placed: Vec::with_capacity(vertices),
        }
    }

    /// There is another surface, of so many triangles and vertices.
    pub fn reserve(&mut self, triangles: usize, vertices: usize) {
        self.restart();
        self.quiet.reserve(triangles);
        self.triangles.clear();
        self.triangles.reserve(triangles);
        self.corners.reserve(vertices.saturating_sub(self.corners.len()));
        self.is_placed.reserve(vertices.saturating_sub(self.is_placed.len()));
    }

    /// The list has been made anew.
    pub fn restart(&mut self) {
        self.quiet.clear();
        self.balls.clear();
        (self.nodes_way, self.tools_way) = (0.0, 0.0);
    }

    /// No node has moved further than this since the last call.
    pub fn travel(&mut self, distance: f64) {
        self.nodes_way += distance;
    }

    /// Sorts out the triangles that tools at these places may meet; all of them if `every`. `place` says where a vertex was and where it is.
    pub fn sort_out(
        &mut self,
        near: &Near,
        balls: impl Iterator<Item = Ball> + Clone,
        every: bool,
        mut place: impl FnMut(u32) -> (Vec3, Vec3),
    ) {
        let listed = near.triangles();
        let came =
            |(old, new): (&Ball, Ball)| (new.centre - old.centre).norm() + (new.radius - old.radius).max(0.0);
        self.tools_way += self.balls.iter().zip(balls.clone()).map(came).fold(0.0, f64::max);
        if self.balls.len() != balls.clone().count() || self.quiet.len() != listed.len() {
            let awake = |listed| Quiet { until: f64::NEG_INFINITY, lever: near.lever(listed) };
            self.quiet.clear();
            self.quiet.extend(listed.iter().map(awake));
        }
        self.balls.clear();
        self.balls.extend(balls);

        self.triangles.clear();
        self.is_placed.clear();
        self.is_placed.resize(near.vertices().len(), false);
        self.corners.resize(near.vertices().len(), Default::default());
        for (&triangle, quiet) in listed.iter().zip(&mut self.quiet) {
            let way = self.tools_way + f64::from(quiet.lever) * self.nodes_way;
            if !every && way < quiet.until {
                continue;
            }
            for at in triangle.places.map(|place| place as usize) {
                if !std::mem::replace(&mut self.is_placed[at], true) {
                    self.corners[at] = place(near.vertices()[at]);
                }
            }
            if !every {
                let corners = triangle.places.map(|place| self.corners[place as usize].1);
                let gap = self.balls.iter().map(|ball| ball.gap(&corners)).fold(f64::INFINITY, f64::min);
                if gap > 0.0 {
                    quiet.until = way + gap;
                    continue;
                }
            }
            self.triangles.push(triangle);
        }
    }

    /// The triangles that may be met, in the order of the list.
    pub fn triangles(&self) -> &[Listed] {
        &self.triangles
    }

    /// Where the corners of one of them were, and where they are.
    pub fn corners(&self, triangle: &Listed) -> [(Vec3, Vec3); 3] {
        triangle.places.map(|place| self.corners[place as usize])
    }
}
