//! What is cut, by which blade, on which way.

use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::Model;
use palpate::solver::blade::Blade;
use serde::Serialize;

/// A scene.
pub struct Scene {
    /// The tissue; its first surface is drawn.
    pub model: Arc<Model>,
    /// In the world.
    pub gravity_m_s2: Vec3,
    /// Whether the tissue is at rest under it.
    pub rests_under_gravity: bool,
    /// Room for copies of nodes.
    pub cut_nodes: usize,
    /// The edge.
    pub blade: Blade,
    /// Where the blade is after a share of its way.
    pub way: Box<dyn Fn(f64) -> Pose>,
    /// How long the tissue is left alone, how long the cut takes, and how long it is looked at afterwards, in s.
    pub rest_s: f64,
    pub cut_s: f64,
    pub after_s: f64,
    /// What is taken out afterwards.
    pub lift: Option<Lift>,
}

/// What a scene is called, from where it is seen, and what is upwards there.
#[derive(Clone, Copy, Debug)]
pub struct View {
    pub title: &'static str,
    pub back: Vec3,
    pub up: Vec3,
}

/// Where the blade is: still before its way, on it, or at its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    Before,
    Cut,
    After,
}

/// What takes out what was cut off.
#[derive(Clone, Copy, Debug)]
pub struct Lift {
    /// Where a ball-tipped grasper holds the tissue, world frame.
    pub at: Vec3,
    /// How far away nodes may be that it holds, in m.
    pub reach_m: f64,
    /// Where it takes them.
    pub way: Vec3,
}

/// The grasper's tip, in m.
pub const GRASPER_M: f64 = 3e-3;

impl Scene {
    /// How long all takes.
    pub fn seconds(&self) -> f64 {
        self.rest_s + self.cut_s + self.after_s
    }

    /// Whether the blade is on its way.
    pub fn phase(&self, time_s: f64) -> Phase {
        if time_s < self.rest_s {
            Phase::Before
        } else if time_s < self.rest_s + self.cut_s {
            Phase::Cut
        } else {
            Phase::After
        }
    }

    /// The share of its way that the blade has gone.
    pub fn share(&self, time_s: f64) -> f64 {
        ((time_s - self.rest_s) / self.cut_s).clamp(0.0, 1.0)
    }

    /// Where the blade is.
    pub fn blade_at(&self, time_s: f64) -> Pose {
        (self.way)(self.share(time_s))
    }

    /// Where the grasper holds the tissue: it does from a third of the time that is left on.
    pub fn grasper_at(&self, time_s: f64) -> Option<Vec3> {
        let lift = self.lift?;
        let since = (time_s - self.rest_s - self.cut_s) / self.after_s;
        let share = (1.5 * (since - 1.0 / 3.0)).clamp(0.0, 1.0);
        (since >= 1.0 / 3.0).then_some(lift.at + lift.way * share)
    }
}
