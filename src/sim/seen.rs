//! Where a simulation's nodes were seen, while a blade is there: bricks near it alone are brought from where the nodes are.

use crate::cut::extents::Extents;
use crate::cut::sweep::Moving;
use crate::math::Vec3;
use crate::model::lattice::{BRICK_SLOTS, Lattice};
use crate::solver::{SeenBrick, Solver};

/// No place.
const NOWHERE: u32 = u32::MAX;

/// The last look, and what is left of the one before. Model frame.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    pub extents: Extents,
    /// Whether nodes were at the start where the look before saw them; else they were where they are.
    have_moved: bool,
    /// The bricks that were brought since the last look, their nodes, and where among these each brick of the lattice is.
    brought: Vec<u32>,
    nodes: Vec<SeenBrick>,
    places: Vec<u32>,
    /// After which step the last look was.
    pub at_step: u64,
}

impl Seen {
    /// Nothing as yet, of a lattice.
    pub fn new(lattice: &Lattice) -> Self {
        Self {
            extents: Extents::new(lattice),
            have_moved: false,
            brought: Vec::new(),
            nodes: Vec::new(),
            places: vec![NOWHERE; lattice.bricks().len()],
            at_step: 0,
        }
    }

    /// Whether nothing was looked at.
    pub fn is_empty(&self) -> bool {
        self.extents.is_empty()
    }

    /// Looks where nodes are, which `have_moved` there since the last look, or have always been there.
    pub fn look(&mut self, solver: &mut dyn Solver, have_moved: bool) {
        self.have_moved = have_moved && !self.is_empty();
        self.extents.look(|displaced| solver.look(displaced), have_moved);
        self.brought.drain(..).for_each(|brick| self.places[brick as usize] = NOWHERE);
        self.nodes.clear();
    }

    /// Brings the nodes of the cells of some bricks, and those of some `others`.
    pub fn fetch(&mut self, solver: &mut dyn Solver, bricks: &[u32], others: impl Iterator<Item = u32>) {
        let of_cells = bricks.iter().flat_map(|&brick| self.extents.nodes_of(brick));
        let mut new: Vec<u32> =
            of_cells.chain(others).filter(|&brick| self.places[brick as usize] == NOWHERE).collect();
        new.sort_unstable();
        new.dedup();
        if !new.is_empty() {
            for &brick in &new {
                self.places[brick as usize] = self.brought.len() as u32;
                self.brought.push(brick);
            }
            solver.seen(&new, &mut self.nodes);
        }
    }

    /// The nodes that were brought.
    pub fn nodes(&self) -> Nodes<'_> {
        Nodes(self)
    }
}

/// Nodes of a lattice between two looks.
pub(super) struct Nodes<'a>(&'a Seen);

impl Moving for Nodes<'_> {
    fn moved(&self, slot: u32) -> [Vec3; 2] {
        let (brick, node) = (slot as usize / BRICK_SLOTS, slot as usize % BRICK_SLOTS);
        // A device that is lost has brought nothing.
        let nodes = self.0.nodes.get(self.0.places[brick] as usize);
        let [before, now] = nodes.map_or([Vec3::zeros(); 2], |nodes| [nodes[0][node], nodes[1][node]]);
        [if self.0.have_moved { before } else { now }, now]
    }
}
