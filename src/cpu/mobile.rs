//! Nodes at the end of a substep, for impulses that come after all inner forces.

use super::lanes::Real;
use super::nodes::{Bricks, Field};
use crate::math::Vec3;
use crate::model::lattice::flag;

/// What impulses read and change.
#[derive(Debug)]
pub struct Mobile<'a, R> {
    /// Displacements at the end of the substep.
    pub u: &'a mut Field<R>,
    /// Velocities.
    pub v: &'a mut Field<R>,
    /// Flag bits.
    pub flags: &'a [u8],
    /// The bricks that the nodes are in.
    pub bricks: &'a Bricks,
    /// Corner mass of each material in kg.
    pub corner_kg: &'a [f64; 16],
}

impl<R: Real> Mobile<'_, R> {
    /// 1 / mass along each axis that is free, else 0.
    pub fn mobility(&self, slot: u32) -> Vec3 {
        let flags = self.flags[slot as usize];
        let kg = self.bricks.node_mass(slot, |material| self.corner_kg[usize::from(material)]);
        let is_free = |axis: usize| flags & (flag::GRASPED | flag::FIX_X << axis) == 0;
        Vec3::from_fn(|axis, _| if is_free(axis) { 1.0 / kg } else { 0.0 })
    }
}
