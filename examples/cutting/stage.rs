//! A scene that runs.

use palpate::error::Result;
use palpate::math::Pose;
use palpate::sim::{Sim, SimDesc, SurfacePort, ToolPort};
use palpate::solver::tool::{ToolDesc, ToolMotion};

use super::scene::{GRASPER_M, Scene};

/// A scene with its simulation, and who works in it.
pub struct Stage {
    pub scene: Scene,
    /// How the simulation was made.
    pub desc: SimDesc,
    pub sim: Sim,
    pub surface: SurfacePort,
    pub blade: ToolPort,
    grasper: Option<ToolPort>,
    is_held: bool,
    steps: u32,
}

impl Stage {
    /// Before the first step. `desc` says all that the scene leaves open.
    pub fn new(scene: Scene, desc: &SimDesc) -> Result<Self> {
        let desc = SimDesc {
            gravity_m_s2: scene.gravity_m_s2,
            rest_under_gravity: scene.rests_under_gravity,
            cut_nodes: scene.cut_nodes,
            ..desc.clone()
        };
        let mut sim = Sim::new(scene.model.clone(), &desc)?;
        let surface = sim.open_surface(0)?;
        let blade = sim.add_tool(&ToolDesc::blade(scene.blade.clone()))?;
        let grasper = scene.lift.map(|_| sim.add_tool(&ToolDesc::sphere(GRASPER_M))).transpose()?;
        Ok(Self { scene, desc, sim, surface, blade, grasper, is_held: false, steps: 0 })
    }

    /// When the next step ends, in s.
    pub fn next_s(&self) -> f64 {
        f64::from(self.steps + 1) * self.desc.step_s
    }

    /// Takes a step, at whose end blade and grasper are where they are then. What the grasper holds it takes at the end of its first.
    pub fn step(&mut self) -> Result<()> {
        let time_s = self.next_s();
        self.blade.set_motion(&ToolMotion::at(self.scene.blade_at(time_s)))?;
        let grasper = self.scene.grasper_at(time_s).zip(self.grasper.as_mut());
        if let Some((at, port)) = grasper {
            port.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z)))?;
        }
        self.sim.step()?;
        self.steps += 1;
        if let (Some(_), Some(port), Some(lift), false) =
            (self.scene.grasper_at(time_s), &self.grasper, &self.scene.lift, self.is_held)
        {
            self.sim.grasp(port.id(), lift.reach_m)?;
            self.is_held = true;
        }
        Ok(())
    }
}
