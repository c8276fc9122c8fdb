//! What cuts have done to a running simulation, and what is left of its tissue.

use std::collections::HashMap;
use std::sync::Arc;

use super::state::State;
use crate::cut::extents::Extents;
use crate::cut::inside::{Inside, locate};
use crate::cut::margin::Margin;
use crate::cut::surface::grid::GridEdge;
use crate::cut::surface::{CutSurface, reach, room};
use crate::cut::sweep::{Moving, Sweep};
use crate::cut::topology::{HungPiece, LatticeEdge, Topology, whole};
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::Model;
use crate::model::lattice::{BRICK_SLOTS, Lattice, flag};
use crate::model::law::CellLaw;
use crate::model::surface::Surface;
use crate::solver::method::Method;

/// What cuts have left, and where the last one ended.
#[derive(Debug)]
pub(super) struct Cuts {
    made: Made,
    margin: Margin,
    /// Where the last blade stands that was not a tool's, model frame.
    blade: Vec<Vec3>,
    pub seen: Seen,
}

/// Where nodes were seen. Model frame.
#[derive(Debug, Default)]
pub(super) struct Seen {
    /// Displacements of all slots at the last look, and at the one before.
    now: Vec<Vec3>,
    before: Vec<Vec3>,
    extents: Extents,
    /// After which step the last look was.
    pub at_step: u64,
}

/// What is cut.
#[derive(Clone, Debug)]
struct Made {
    topology: Topology,
    /// Edges outside of all tissue, and where they were crossed.
    beyond: HashMap<GridEdge, f64>,
    /// Masses of the nodes of divided cells in kg.
    kg: HashMap<u32, f64>,
}

impl Cuts {
    fn new(model: &Model, copies: usize) -> Self {
        let lattice = model.lattice();
        let capacity = copies.div_ceil(BRICK_SLOTS) * BRICK_SLOTS;
        let farthest = model.surfaces().iter().map(|surface| reach(surface, lattice)).max();
        let made = Made {
            topology: Topology::new(lattice.slot_count() as u32, capacity),
            beyond: HashMap::new(),
            kg: HashMap::new(),
        };
        Self {
            made,
            margin: Margin::new(lattice, farthest.unwrap_or_default()),
            blade: Vec::new(),
            seen: Seen::default(),
        }
    }
}

/// Flags of a slot, of a lattice whose own slots have `flags` or a copy.
pub(super) fn flags_of(cuts: Option<&Cuts>, lattice: &Lattice, flags: &[u8], slot: u32) -> u8 {
    let of_copy = |cuts: &Cuts| cuts.made.topology.flags_of(lattice, slot, flags);
    let own = flags.get(slot as usize).copied();
    own.or_else(|| cuts.map(of_copy)).unwrap_or(flag::FIX_ALL)
}

/// Mass of a node in kg, of a lattice or a copy.
pub(super) fn node_kg(cuts: Option<&Cuts>, lattice: &Lattice, laws: &[CellLaw; 16], slot: u32) -> f64 {
    let of_pieces = cuts.and_then(|cuts| cuts.made.kg.get(&slot).copied());
    of_pieces.unwrap_or_else(|| lattice.node_mass(slot, |material| laws[usize::from(material)].corner_kg))
}

impl Made {
    /// The surfaces of a model, cut. Fails where there is no room for them.
    fn surfaces(&self, model: &Model, copies: usize) -> Result<Vec<Arc<Surface>>> {
        let cut = |surface: &Arc<Surface>| {
            let cut = CutSurface::new(surface, model.lattice(), &self.topology, &self.beyond)?;
            let drawn = cut.drawn(model.lattice().cell_m())?;
            let [vertices, triangles] = room(surface, copies);
            if drawn.positions.len() > vertices || drawn.triangles.len() > triangles {
                return Err(Error::Limit(format!(
                    "the cut surface has {} vertices and {} triangles, and there is room for {vertices} and {triangles}",
                    drawn.positions.len(),
                    drawn.triangles.len()
                )));
            }
            Ok(Arc::new(drawn))
        };
        model.surfaces().iter().map(cut).collect()
    }

    /// Weighs the nodes of divided cells, given the corner mass of each material.
    fn weigh(&mut self, lattice: &Lattice, laws: &[CellLaw; 16]) {
        let corner_kg = |material: u8| laws[usize::from(material)].corner_kg;
        self.kg.clear();
        let cells = self.topology.cells();
        for (_, cell) in &cells {
            for (hung, node) in cell.pieces.iter().flat_map(|hung| hung.nodes.map(|node| (hung, node))) {
                *self.kg.entry(node).or_default() += corner_kg(cell.material) * hung.piece.volume;
            }
        }
        // And the whole cells beside them.
        for (&slot, kg) in self.kg.iter_mut().filter(|(slot, _)| (**slot as usize) < lattice.slot_count()) {
            let divided = |corner: usize| {
                let node = lattice.node_of(slot);
                let cell = [0, 1, 2].map(|axis| node[axis].wrapping_sub(corner >> axis & 1));
                let is_cell = (0..3).all(|axis| cell[axis] < lattice.cells()[axis]);
                let cell = is_cell.then(|| self.topology.cell(lattice.slot(cell)?)).flatten();
                cell.map_or(0.0, |cell| corner_kg(cell.material))
            };
            *kg += lattice.node_mass(slot, corner_kg) - (0..8).map(divided).sum::<f64>();
        }
    }
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

impl Seen {
    /// Whether nothing was looked at.
    pub fn is_empty(&self) -> bool {
        self.now.is_empty()
    }
}

/// Nodes of a lattice between two looks.
struct Nodes<'a> {
    lattice: &'a Lattice,
    seen: &'a Seen,
}

/// Why nothing can be cut.
pub(super) fn no_room() -> Error {
    Error::State("the simulation was made without room for cuts: see cut_nodes".into())
}

impl Moving for Nodes<'_> {
    fn from(&self, slot: u32) -> Vec3 {
        self.lattice.rest_position(slot) + self.seen.before[slot as usize]
    }

    fn to(&self, slot: u32) -> Vec3 {
        self.lattice.rest_position(slot) + self.seen.now[slot as usize]
    }
}

impl State {
    /// See [`super::Sim::cut`].
    pub fn cut(&mut self, from: &[Vec3], to: &[Vec3]) -> Result<usize> {
        self.check()?;
        if self.desc.cut_nodes == 0 {
            return Err(no_room());
        }
        let to_model = self.model.frame().inverse();
        let place = |points: &[Vec3]| -> Vec<Vec3> {
            points.iter().map(|p| to_model.transform_point(&(*p).into()).coords).collect()
        };
        let sweep = Sweep { from: place(from), to: place(to) };
        let mut cuts = self.take_cuts();
        // A blade that sweeps on meets what has moved meanwhile; one that is put in anew does not.
        let goes_on = cuts.blade == sweep.from;
        self.look(&mut cuts, goes_on);
        let answer = self.cut_along(&mut cuts, &sweep);
        cuts.blade = sweep.to;
        self.cuts = Some(cuts);
        answer
    }

    /// The cuts, to be put back.
    pub fn take_cuts(&mut self) -> Cuts {
        self.cuts.take().unwrap_or_else(|| Cuts::new(&self.model, self.desc.cut_nodes))
    }

    /// Looks where nodes are. Where a blade `goes_on`, they have moved there since the last look.
    pub fn look(&self, cuts: &mut Cuts, goes_on: bool) {
        let seen = &mut cuts.seen;
        std::mem::swap(&mut seen.before, &mut seen.now);
        self.solver.displacements(&mut seen.now);
        if !goes_on {
            seen.before.clone_from(&seen.now);
        }
        let lattice = self.model.lattice();
        seen.extents = Extents::new(lattice, &Nodes { lattice, seen });
        seen.at_step = self.statistics.steps;
    }

    /// Cuts what a sweep crosses since the look before the last one. Gives how many cells were divided.
    pub fn cut_along(&mut self, cuts: &mut Cuts, sweep: &Sweep) -> Result<usize> {
        let model = self.model.clone();
        let lattice = model.lattice();
        let nodes = Nodes { lattice, seen: &cuts.seen };
        let laws = &self.body.laws;
        let is_soft = |material: u8| laws[usize::from(material)].spring_n_m > 0.0;
        let can_cut = |edge| cuts.made.topology.can_cut(lattice, edge, is_soft);
        let crossed = sweep.crossed(lattice, &nodes, &cuts.seen.extents, can_cut);
        let beyond = sweep.crossed_beyond(lattice, &cuts.margin, &nodes, &cuts.seen.extents);
        let Some((made, count)) = self.take_cut(&cuts.made, &crossed, &beyond)? else { return Ok(0) };
        cuts.made = made;
        Ok(count)
    }

    /// Where points of the model frame are in whole soft cells, as last looked at.
    pub fn locate(&self, cuts: &Cuts, points: &[Vec3]) -> Vec<Option<Inside>> {
        let (lattice, laws) = (self.model.lattice(), &self.body.laws);
        let is_soft = |slot: u32| laws[(lattice.words()[slot as usize] >> 28) as usize].spring_n_m > 0.0;
        let is_whole = |slot: u32| cuts.made.topology.cell(slot).is_none() && is_soft(slot);
        locate(points, lattice, &Nodes { lattice, seen: &cuts.seen }, &cuts.seen.extents, is_whole)
    }

    /// What is cut then, and how many cells were divided; nothing where nothing is met.
    fn take_cut(
        &mut self,
        made: &Made,
        crossed: &[(LatticeEdge, f64)],
        beyond: &[(GridEdge, f64)],
    ) -> Result<Option<(Made, usize)>> {
        let new: Vec<_> =
            beyond.iter().filter(|(edge, _)| !made.beyond.contains_key(edge)).copied().collect();
        if crossed.is_empty() && new.is_empty() {
            return Ok(None);
        }
        let (model, mut made) = (self.model.clone(), made.clone());
        made.beyond.extend(new);
        let change = made.topology.cut(model.lattice(), crossed)?;
        if made.topology.version() == 0 || change.cells.is_empty() && beyond.is_empty() {
            return Ok(Some((made, 0)));
        }
        let surfaces = made.surfaces(&model, self.desc.cut_nodes)?;
        // Should the rest fail, steps are only shorter than they need be.
        self.body.note_cut(&model);
        self.statistics.stable_substep_s = self.body.stable_dt;
        made.weigh(model.lattice(), &self.body.laws);
        let flags = self.flags_of_copies(&made.topology);
        let taken = self.solver.cut(&made.topology, &change, &surfaces);
        let taken = taken.and_then(|()| self.solver.set_flags(&flags, self.body.stable_dt));
        self.heed(taken)?;
        self.show(surfaces);
        self.statistics.divided_cells = made.topology.cell_count() as u64;
        self.statistics.copies = made.topology.copy_count() as u64;
        Ok(Some((made, change.cells.len())))
    }

    /// Makes tissue whole; a reset of the solver follows.
    pub fn heal(&mut self) -> Result<()> {
        if self.cuts.take().is_none_or(|cuts| cuts.made.topology.version() == 0) {
            return Ok(());
        }
        let healed = self.solver.heal();
        self.heed(healed)?;
        let whole = self.model.surfaces().to_vec();
        self.show(whole);
        Ok(())
    }

    /// Other surfaces are seen and touched from now on.
    fn show(&mut self, surfaces: Vec<Arc<Surface>>) {
        self.surfaces = surfaces;
        self.surface_version += 1;
    }

    /// Materials weigh otherwise.
    pub fn weigh_cuts(&mut self) {
        if let Some(cuts) = &mut self.cuts {
            cuts.made.weigh(self.model.lattice(), &self.body.laws);
        }
    }

    fn flags_of_copies(&self, topology: &Topology) -> Vec<(u32, u8)> {
        let of = |copy| (copy, topology.flags_of(self.model.lattice(), copy, &self.body.flags));
        topology.copies().map(of).collect()
    }

    /// Flags of a slot, of the lattice or a copy.
    pub fn flags_of(&self, slot: u32) -> u8 {
        flags_of(self.cuts.as_ref(), self.model.lattice(), &self.body.flags, slot)
    }

    /// Adds the flags of all copies of nodes to those of nodes that change.
    pub fn add_copies(&self, changed: &mut Vec<(u32, u8)>) {
        if let Some(cuts) = &self.cuts {
            changed.extend(self.flags_of_copies(&cuts.made.topology));
        }
    }

    /// Every whole cell and every piece: its material and what it hangs on.
    pub fn hung(&self) -> Vec<(u8, HungPiece)> {
        let lattice = self.model.lattice();
        let mut all = Vec::with_capacity(lattice.cell_count());
        for (cell, material) in lattice.occupied() {
            let corners = lattice.corners(cell);
            match self.cuts.as_ref().and_then(|cuts| cuts.made.topology.cell(corners[0])) {
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
