//! What cuts have done to a running simulation, and what is left of its tissue.

use std::collections::HashMap;

use super::state::State;
use crate::cut::sweep::{Moving, Sweep};
use crate::cut::topology::{HungPiece, LatticeEdge, Topology, whole};
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::lattice::{BRICK_SLOTS, Lattice, flag};
use crate::solver::method::Method;

/// The topology as cuts have left it, and where the last one ended.
#[derive(Debug)]
pub(super) struct Cuts {
    topology: Topology,
    /// The blade, model frame.
    blade: Vec<Vec3>,
    /// Displacements of the lattice's own slots, model frame.
    before: Vec<Vec3>,
}

/// A part of the tissue that hangs together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Its volume in m³.
    pub volume_m3: f64,
    /// Its mass in kg.
    pub mass_kg: f64,
    /// Whether nodes of it are held, along all axes.
    pub is_held: bool,
    /// Velocity of its centre of mass, m/s, world frame.
    pub velocity_m_s: Vec3,
}

/// Nodes of a lattice between two cuts, by their displacements.
struct Nodes<'a> {
    lattice: &'a Lattice,
    before: &'a [Vec3],
    now: &'a [Vec3],
}

impl Moving for Nodes<'_> {
    fn from(&self, slot: u32) -> Vec3 {
        self.lattice.rest_position(slot) + self.before[slot as usize]
    }

    fn to(&self, slot: u32) -> Vec3 {
        self.lattice.rest_position(slot) + self.now[slot as usize]
    }
}

impl State {
    /// See [`super::Sim::cut`].
    pub fn cut(&mut self, from: &[Vec3], to: &[Vec3]) -> Result<usize> {
        self.check()?;
        if self.desc.cut_nodes == 0 {
            return Err(Error::State("the simulation was made without room for cuts: see cut_nodes".into()));
        }
        let model = self.model.clone();
        let (lattice, to_model) = (model.lattice(), model.frame().inverse());
        let place = |points: &[Vec3]| -> Vec<Vec3> {
            points.iter().map(|p| to_model.transform_point(&(*p).into()).coords).collect()
        };
        let sweep = Sweep { from: place(from), to: place(to) };
        let now: Vec<Vec3> =
            (0..lattice.slot_count() as u32).map(|slot| self.solver.displacement(slot)).collect();
        let cuts = self.cuts.take().unwrap_or_else(|| {
            let capacity = self.desc.cut_nodes.div_ceil(BRICK_SLOTS) * BRICK_SLOTS;
            let topology = Topology::new(lattice.slot_count() as u32, capacity);
            Cuts { topology, blade: Vec::new(), before: Vec::new() }
        });
        // A blade that sweeps on meets what has moved meanwhile; one that is put in anew does not.
        let before = if cuts.blade == sweep.from { &cuts.before } else { &now };
        let nodes = Nodes { lattice, before, now: &now };
        let laws = &self.body.laws;
        let is_soft = |material: u8| laws[usize::from(material)].spring_n_m > 0.0;
        let crossed = sweep.crossed(lattice, &nodes, |edge| cuts.topology.can_cut(lattice, edge, is_soft));
        let mut topology = cuts.topology.clone();
        let answer = self.take_cut(&mut topology, &crossed);
        let topology = if answer.is_ok() { topology } else { cuts.topology };
        self.cuts = Some(Cuts { topology, blade: sweep.to, before: now });
        answer
    }

    fn take_cut(&mut self, topology: &mut Topology, crossed: &[(LatticeEdge, f64)]) -> Result<usize> {
        let change = topology.cut(self.model.lattice(), crossed)?;
        if change.cells.is_empty() {
            return Ok(0);
        }
        // Should the rest fail, steps are only shorter than they need be.
        self.body.note_cut(&self.model);
        self.statistics.stable_substep_s = self.body.stable_dt;
        let flags = self.flags_of_copies(topology);
        let taken = self.solver.cut(topology, &change);
        let taken = taken.and_then(|()| self.solver.set_flags(&flags, self.body.stable_dt));
        self.heed(taken)?;
        Ok(change.cells.len())
    }

    fn flags_of_copies(&self, topology: &Topology) -> Vec<(u32, u8)> {
        let of = |copy| (copy, topology.flags_of(self.model.lattice(), copy, &self.body.flags));
        topology.copies().map(of).collect()
    }

    /// Flags of a slot, of the lattice or a copy.
    pub fn flags_of(&self, slot: u32) -> u8 {
        let of_copy = |cuts: &Cuts| cuts.topology.flags_of(self.model.lattice(), slot, &self.body.flags);
        let own = self.body.flags.get(slot as usize).copied();
        own.or_else(|| self.cuts.as_ref().map(of_copy)).unwrap_or(flag::FIX_ALL)
    }

    /// Adds the flags of all copies of nodes to those of nodes that change.
    pub fn add_copies(&self, changed: &mut Vec<(u32, u8)>) {
        if let Some(cuts) = &self.cuts {
            changed.extend(self.flags_of_copies(&cuts.topology));
        }
    }

    /// Every whole cell and every piece: its material and what it hangs on.
    pub fn hung(&self) -> Vec<(u8, HungPiece)> {
        let lattice = self.model.lattice();
        let mut all = Vec::with_capacity(lattice.cell_count());
        for (cell, material) in lattice.occupied() {
            let corners = lattice.corners(cell);
            match self.cuts.as_ref().and_then(|cuts| cuts.topology.cell(corners[0])) {
                Some(divided) => all.extend(divided.pieces.iter().map(|&piece| (material, piece))),
                None => all.push((material, whole(corners))),
            }
        }
        all
    }

    /// Every node that has a mass, by its slot, and that mass in kg.
    pub fn masses(&self) -> Vec<(u32, f64)> {
        let mut masses: HashMap<u32, f64> = HashMap::new();
        for (material, hung) in self.hung() {
            let kg = 8.0 * self.body.laws[usize::from(material)].corner_kg * hung.piece.volume;
            for (node, share) in hung.nodes.into_iter().zip(self.shares(&hung)) {
                *masses.entry(node).or_default() += kg * share;
            }
        }
        let mut masses: Vec<_> = masses.into_iter().collect();
        masses.sort_by_key(|&(slot, _)| slot);
        masses
    }

    /// How the mass of a piece is shared among its nodes.
    fn shares(&self, hung: &HungPiece) -> [f64; 8] {
        match self.desc.method {
            // By its centroid; explicit steps would get shorter where a node weighs little.
            Method::Efg(_) => hung.piece.shares(),
            Method::Lattice => [0.125; 8],
        }
    }

    /// See [`super::Sim::parts`].
    pub fn parts(&self) -> Vec<Part> {
        let all = self.hung();
        let (h, frame) = (self.model.lattice().cell_m(), self.model.frame());
        // Pieces that share a node hang together: each node points to a piece, and pieces to others, up to one that points to itself.
        fn root(next: &mut [usize], mut n: usize) -> usize {
            while next[n] != n {
                next[n] = next[next[n]];
                n = next[n];
            }
            n
        }
        let mut next: Vec<usize> = (0..all.len()).collect();
        let mut piece_of: HashMap<u32, usize> = HashMap::new();
        for (n, (_, hung)) in all.iter().enumerate() {
            for node in hung.nodes {
                let other = *piece_of.entry(node).or_insert(n);
                let (a, b) = (root(&mut next, n), root(&mut next, other));
                next[a.max(b)] = a.min(b);
            }
        }
        let mut parts: HashMap<usize, (Part, Vec3)> = HashMap::new();
        for (n, (material, hung)) in all.iter().enumerate() {
            let kg = 8.0 * self.body.laws[usize::from(*material)].corner_kg * hung.piece.volume;
            let none = Part { volume_m3: 0.0, mass_kg: 0.0, is_held: false, velocity_m_s: Vec3::zeros() };
            let (part, momentum) = parts.entry(root(&mut next, n)).or_insert((none, Vec3::zeros()));
            part.volume_m3 += hung.piece.volume * h * h * h;
            part.mass_kg += kg;
            for (corner, (node, share)) in hung.nodes.into_iter().zip(self.shares(hung)).enumerate() {
                *momentum += self.solver.velocity(node) * (kg * share);
                // Its own corners are nodes of the lattice.
                part.is_held |= hung.piece.corners >> corner & 1 != 0
                    && self.body.flags[node as usize] & flag::FIX_ALL == flag::FIX_ALL;
            }
        }
        let mut parts: Vec<Part> = parts
            .into_values()
            .map(|(part, momentum)| Part { velocity_m_s: frame * (momentum / part.mass_kg), ..part })
            .collect();
        parts.sort_by(|a, b| b.volume_m3.total_cmp(&a.volume_m3));
        parts
    }
}
