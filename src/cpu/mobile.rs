//! Nodes at the end of a substep, for impulses that come after all inner forces.

use super::nodes::Field;
use crate::math::Vec3;
use crate::model::lattice::flag;

/// What impulses read and change.
pub struct Mobile<'a, R> {
    /// Displacements at the end of the substep.
    pub u: &'a mut Field<R>,
    /// Velocities.
    pub v: &'a mut Field<R>,
    /// Flag bits.
    pub flags: &'a [u8],
    /// Mass of a node in kg.
    pub kg: &'a dyn Fn(u32) -> f64,
}

impl<R> Mobile<'_, R> {
    /// 1 / mass along each axis that is free, else 0.
    pub fn mobility(&self, slot: u32) -> Vec3 {
        self.free(slot) / (self.kg)(slot)
    }

    /// 1 along each axis that is free, else 0.
    pub fn free(&self, slot: u32) -> Vec3 {
        free(self.flags[slot as usize])
    }
}

/// 1 along each axis that flags leave free, else 0.
pub fn free(flags: u8) -> Vec3 {
    let is_free = |axis: usize| flags & (flag::GRASPED | flag::FIX_X << axis) == 0;
    Vec3::from_fn(|axis, _| if is_free(axis) { 1.0 } else { 0.0 })
}
