//! What the tissue consists of once it was cut, and the parts that hang together.

use std::collections::HashMap;

use super::state::State;
use crate::cut::topology::{HungPiece, own_nodes, whole};
use crate::math::Vec3;
use crate::model::lattice::flag;
use crate::solver::method::Method;

/// A part of the tissue that hangs together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Names it, to remove it. A part that is cut further leaves its name to one of what it becomes.
    pub id: u32,
    /// Its volume in m³.
    pub volume_m3: f64,
    /// Its mass in kg.
    pub mass_kg: f64,
    /// Whether nodes of it are held, along all axes.
    pub is_held: bool,
    /// Velocity of its centre of mass, m/s, world frame.
    pub velocity_m_s: Vec3,
}

impl State {
    /// Every whole cell and every piece that is left: its material and what it hangs on.
    pub fn hung(&self) -> Vec<(u8, HungPiece)> {
        let lattice = self.model.lattice();
        let mut all = Vec::with_capacity(lattice.cell_count());
        for (cell, material) in lattice.occupied() {
            let corners = lattice.corners(cell);
            match &self.cuts {
                Some(cuts) => {
                    let left = cuts.topology.left_of(lattice, corners[0]);
                    all.extend(left.into_iter().map(|piece| (material, piece)));
                }
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
            let none = Part {
                id: u32::MAX,
                volume_m3: 0.0,
                mass_kg: 0.0,
                is_held: false,
                velocity_m_s: Vec3::zeros(),
            };
            let (part, momentum) = parts.entry(root(&mut next, n)).or_insert((none, Vec3::zeros()));
            part.volume_m3 += hung.piece.volume * h * h * h;
            part.mass_kg += kg;
            part.id = own_nodes(hung).fold(part.id, u32::min);
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
