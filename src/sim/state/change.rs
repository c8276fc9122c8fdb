//! What the owner changes of tissue that runs: gravity, materials, and what is held, by itself or by tools.

use std::sync::Arc;

use super::{MAX_SUBSTEPS, SAFETY, State};
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::Fix;
use crate::model::material::Material;
use crate::sim::ToolId;

impl State {
    pub fn set_gravity(&mut self, gravity: Vec3) {
        self.desc.gravity_m_s2 = gravity;
        self.solver.wake();
    }

    /// Gives a material index other properties.
    pub fn set_material(&mut self, index: u8, material: &Material) -> Result<()> {
        self.check()?;
        let mut body = self.body.clone();
        body.set_material(&self.model, index, material)?;
        let needed = self.desc.step_s / (SAFETY * body.stable_dt);
        if needed > f64::from(MAX_SUBSTEPS) {
            return Err(Error::Limit(format!(
                "a step would need {needed:.0} substeps, more than {MAX_SUBSTEPS}"
            )));
        }
        let changed = self.solver.set_laws(&body.laws, body.stable_dt);
        self.heed(changed)?;
        self.body = body;
        self.statistics.stable_substep_s = self.body.stable_dt;
        Ok(())
    }

    /// Holds or frees nodes; gives how many that changed.
    pub fn set_held(&mut self, fix: &Fix, is_held: bool) -> Result<usize> {
        self.check()?;
        let mut changed = self.body.set_held(&self.model, fix, is_held)?;
        let count = changed.len();
        self.heed_cuts(&mut changed);
        let answer = self.solver.set_flags(&changed, self.body.stable_dt);
        self.heed(answer)?;
        self.statistics.stable_substep_s = self.body.stable_dt;
        Ok(count)
    }

    /// Has a tool hold the nodes within `reach_m` of it; gives how many it holds.
    pub fn grasp(&mut self, id: ToolId, reach_m: f64) -> Result<usize> {
        self.refuse_if_failed()?;
        let index = self.tool_index(id)?;
        let tool = &self.tools[index];
        let Some(asked) = tool.stands else {
            return Err(Error::State("the tool stands nowhere: it has not been moved in a step".into()));
        };
        let (lattice, pose) = (self.model.lattice(), self.model.frame().inverse() * asked.motion.pose);
        let place = |slot: u32| {
            let at = lattice.rest_position(slot) + self.solver.displacement(slot);
            pose.inverse_transform_point(&at.into()).coords
        };
        let is_free = |slot: &u32| self.flags_of(*slot) == 0;
        let near = lattice.slots().filter(is_free).map(|slot| (slot, place(slot)));
        let near = near.filter(|(_, place)| tool.desc.distance(*place).distance <= reach_m);
        let held: Arc<[(u32, Vec3)]> = tool.grasped.iter().copied().chain(near).collect();
        let changed = self.body.set_grasped(held.iter().map(|(slot, _)| *slot), true);
        let answer = self.solver.set_flags(&changed, self.body.stable_dt);
        self.heed(answer)?;
        let count = held.len();
        self.tools[index].grasped = held;
        Ok(count)
    }

    /// Has a tool let go of what it holds; gives how many nodes that were.
    pub fn release_tissue(&mut self, id: ToolId) -> Result<usize> {
        self.check()?;
        let index = self.tool_index(id)?;
        self.release(index)
    }

    pub(super) fn release(&mut self, index: usize) -> Result<usize> {
        let held = std::mem::replace(&mut self.tools[index].grasped, Arc::new([]));
        if held.is_empty() {
            return Ok(0);
        }
        let changed = self.body.set_grasped(held.iter().map(|(slot, _)| *slot), false);
        let answer = self.solver.set_flags(&changed, self.body.stable_dt);
        self.heed(answer).map(|()| held.len())
    }
}
