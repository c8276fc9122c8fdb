//! A sphere and its way: straight in, and then around in a small circle, so that contact slides.

use std::f64::consts::TAU;

use palpate::math::{Pose, Vec3};
use palpate::model::Model;
use palpate::solver::tool::{ToolDesc, ToolMotion};

/// Least radius of a sphere by the longest edge of the surface that it meets: what contact on a GPU asks for, and a little more.
const RADIUS_BY_EDGE: f64 = 2.05;
/// Rounds per second of the circle.
const ROUNDS_PER_S: f64 = 2.0;

/// How the tissue is pressed. World frame.
#[derive(Clone, Debug)]
pub struct Press {
    /// Radius of the sphere in m.
    pub radius_m: f64,
    /// Coulomb friction.
    pub friction: f64,
    /// The point of the rest surface that is met first.
    pub point_m: Vec3,
    /// Unit vector into the tissue.
    pub direction: Vec3,
    /// Distance from the surface at the start, in m.
    pub gap_m: f64,
    /// How deep to press, in m.
    pub depth_m: f64,
    /// Speed of the press, in m/s.
    pub speed_m_s: f64,
    /// Radius of the circle after that, in m; 0 holds still.
    pub circle_m: f64,
}

/// A radius for a sphere that meets a model, in m: the wanted one, or a larger one where the contact surface is too coarse for that.
pub fn radius(wanted_m: f64, model: &Model) -> f64 {
    let surface = &model.surfaces()[model.contact_surface()];
    let edges = surface.triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
    let lengths = edges.map(|[a, b]| (surface.positions[a as usize] - surface.positions[b as usize]).norm());
    wanted_m.max(RADIUS_BY_EDGE * lengths.fold(0.0, f64::max))
}

impl Press {
    /// The tool.
    pub fn tool(&self) -> ToolDesc {
        ToolDesc { friction: self.friction, ..ToolDesc::sphere(self.radius_m) }
    }

    /// When the sphere is `depth_m` inside.
    pub fn pressed_s(&self, depth_m: f64) -> f64 {
        (self.gap_m + depth_m) / self.speed_m_s
    }

    /// Where the sphere is at a time, and how it moves.
    pub fn motion(&self, time_s: f64) -> ToolMotion {
        let whole = self.pressed_s(self.depth_m);
        let inward = self.speed_m_s * time_s.min(whole) - self.gap_m - self.radius_m;
        let angle = TAU * ROUNDS_PER_S * (time_s - whole).max(0.0);
        let across = self.direction.cross(&Vec3::ith(self.direction.iamin(), 1.0)).normalize();
        let along = self.direction.cross(&across);
        let circle = across * (angle.cos() - 1.0) + along * angle.sin();
        let at = self.point_m + self.direction * inward + circle * self.circle_m;
        let linear_m_s = if time_s < whole {
            self.direction * self.speed_m_s
        } else {
            (along * angle.cos() - across * angle.sin()) * (TAU * ROUNDS_PER_S * self.circle_m)
        };
        ToolMotion { linear_m_s, ..ToolMotion::at(Pose::translation(at.x, at.y, at.z)) }
    }
}
