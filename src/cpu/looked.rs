//! Where nodes were when the host looked.

use super::lanes::Real;
use super::nodes::Field;
use crate::math::{Bounds, Vec3};
use crate::model::lattice::{BRICK_SLOTS, Lattice};
use crate::solver::SeenBrick;

/// Displacements at the last two looks; empty where there were none.
#[derive(Clone, Debug)]
pub struct Looked<R> {
    before: Field<R>,
    now: Field<R>,
}

impl<R> Default for Looked<R> {
    fn default() -> Self {
        Self { before: Field(Vec::new()), now: Field(Vec::new()) }
    }
}

impl<R: Real> Looked<R> {
    /// Looks at the nodes of a lattice; see [`crate::solver::Solver::look`].
    pub fn look(&mut self, u: &Field<R>, lattice: &Lattice, displaced: &mut Vec<Bounds>) {
        std::mem::swap(&mut self.before, &mut self.now);
        self.now.0.clone_from(&u.0);
        let of_brick = |brick: u32| {
            let mut bounds = Bounds::EMPTY;
            lattice.slots_of(&[brick]).for_each(|slot| bounds.add(u.vec3(slot)));
            bounds
        };
        displaced.extend((0..lattice.bricks().len() as u32).map(of_brick));
    }

    /// See [`crate::solver::Solver::seen`].
    pub fn seen(&self, bricks: &[u32], nodes: &mut Vec<SeenBrick>) {
        let before = if self.before.0.is_empty() { &self.now } else { &self.before };
        let vector = |field: &Field<R>, brick: u32| -> [Vec3; BRICK_SLOTS] {
            std::array::from_fn(|place| field.vec3(brick * BRICK_SLOTS as u32 + place as u32))
        };
        nodes.extend(bricks.iter().map(|&brick| [before, &self.now].map(|field| vector(field, brick))));
    }
}
