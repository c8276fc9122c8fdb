//! Where the bricks of a lattice are, as its nodes move: what a blade is far from need not be looked at.

use std::sync::Arc;

use crate::math::{Bounds, Vec3};
use crate::model::lattice::{BRICK, BRICK_SLOTS, Lattice, NO_BRICK};

/// What a brick is at rest.
#[derive(Clone, Copy, Debug)]
struct Brick {
    /// Around its nodes, m, model frame.
    rest: Bounds,
    /// The bricks that its cells have nodes of: at their high faces they reach into the next ones. The first is the brick itself, and stands for those that are not there.
    of_cells: [u32; 8],
}

/// For each brick a box around its nodes, at the start and at the end of a step, and around those of its cells. m, model frame.
#[derive(Clone, Debug)]
pub struct Extents {
    bricks: Arc<[Brick]>,
    /// What displaces nodes of each brick at the end: least and most along each axis. Nothing before the first look.
    displaced: Vec<Bounds>,
    /// The same, at the start as well.
    moved: Vec<Bounds>,
    of_cells: Vec<Bounds>,
}

impl Extents {
    /// Of a lattice that nobody has looked at.
    pub fn new(lattice: &Lattice) -> Self {
        let size = Vec3::from(BRICK.map(|n| (n - 1) as f64)) * lattice.cell_m();
        let brick = |(index, at): (usize, &[u16; 3])| {
            let corner = lattice.rest_position((index * BRICK_SLOTS) as u32);
            let next = |n: usize| lattice.brick_at([0, 1, 2].map(|a| i64::from(at[a]) + (n as i64 >> a & 1)));
            let of_cells = std::array::from_fn(|n| {
                Some(next(n)).filter(|&next| next != NO_BRICK).unwrap_or(index as u32)
            });
            Brick { rest: Bounds { low: corner, high: corner + size }, of_cells }
        };
        Self {
            bricks: lattice.bricks().iter().enumerate().map(brick).collect(),
            displaced: Vec::new(),
            moved: Vec::new(),
            of_cells: Vec::new(),
        }
    }

    /// What displaces nodes of each brick now, which were before where they were at the last look if they have moved since: the boxes follow, which are those of
    /// bricks at rest, widened and moved: no smaller than they need be.
    pub fn look(&mut self, now: impl FnOnce(&mut Vec<Bounds>), have_moved: bool) {
        self.moved.clone_from(&self.displaced);
        self.displaced.clear();
        now(&mut self.displaced);
        if !have_moved || self.moved.len() != self.displaced.len() {
            self.moved.clone_from(&self.displaced);
        }
        for (moved, now) in self.moved.iter_mut().zip(&self.displaced) {
            *moved = moved.union(now);
        }
        let (bricks, moved) = (&self.bricks, &self.moved);
        let own = |brick: u32| bricks[brick as usize].rest.moved(&moved[brick as usize]);
        let around = |brick: &Brick| {
            // Mostly all eight are there.
            brick.of_cells[1..].iter().fold(own(brick.of_cells[0]), |all, &next| all.union(&own(next)))
        };
        self.of_cells.clear();
        // A device that is lost has shown nothing.
        if moved.len() == bricks.len() {
            self.of_cells.extend(bricks.iter().map(around));
        }
    }

    /// Whether nobody has looked.
    pub fn is_empty(&self) -> bool {
        self.displaced.is_empty()
    }

    /// What displaces nodes of a brick, at the start and at the end.
    pub fn moved(&self, brick: u32) -> &Bounds {
        &self.moved[brick as usize]
    }

    /// The bricks, ascending, of which a cell may meet one of some boxes.
    pub fn near(&self, boxes: &[Bounds]) -> Vec<u32> {
        let all = boxes.iter().fold(Bounds::EMPTY, |all, one| all.union(one));
        let is_near =
            |brick: &Bounds| brick.meets(&all, 0.0) && boxes.iter().any(|one| brick.meets(one, 0.0));
        (0..).zip(&self.of_cells).filter(|(_, brick)| is_near(brick)).map(|(index, _)| index).collect()
    }

    /// The box around a brick's cells.
    pub fn of_cells(&self, brick: u32) -> &Bounds {
        &self.of_cells[brick as usize]
    }

    /// The bricks that hold the nodes of the cells of a brick.
    pub fn nodes_of(&self, brick: u32) -> [u32; 8] {
        self.bricks[brick as usize].of_cells
    }
}
