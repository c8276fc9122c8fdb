//! What cuts have done to a running simulation, and what is left of its tissue.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::event::Event;
use super::state::State;
use crate::cut::extents::Extents;
use crate::cut::inside::{Inside, locate};
use crate::cut::margin::Margin;
use crate::cut::surface::grid::GridEdge;
use crate::cut::surface::{CutSurface, reach, room};
use crate::cut::sweep::{Moving, Sweep};
use crate::cut::topology::{Change, Topology};
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::Model;
use crate::model::lattice::{BRICK_SLOTS, Lattice, flag};
use crate::model::surface::Surface;

/// What cuts have left, and where the last one ended.
#[derive(Clone, Debug)]
pub(super) struct Cuts {
    pub topology: Topology,
    margin: Arc<Margin>,
    /// Edges outside of all tissue, and where they were crossed.
    beyond: HashMap<GridEdge, f64>,
    /// The model's surfaces, cut; none before the first cell is divided, and where there never was one that is closed.
    surfaces: Vec<Option<CutSurface>>,
    /// Where the last blade stands that was not a tool's, model frame.
    blade: Vec<Vec3>,
    pub seen: Seen,
}

/// Where nodes were seen. Model frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Seen {
    /// Displacements of all slots at the last look, and at the one before.
    now: Vec<Vec3>,
    before: Vec<Vec3>,
    extents: Extents,
    /// After which step the last look was.
    pub at_step: u64,
}

impl Cuts {
    /// The empty cells around the tissue.
    pub fn margin(&self) -> &Margin {
        &self.margin
    }

    /// Notes edges outside of all tissue that are crossed, and where.
    pub fn cross(&mut self, beyond: &[(GridEdge, f64)]) {
        for &(edge, at) in beyond {
            self.beyond.entry(edge).or_insert(at);
        }
    }

    fn new(model: &Model, copies: usize) -> Self {
        let lattice = model.lattice();
        let capacity = copies.div_ceil(BRICK_SLOTS) * BRICK_SLOTS;
        let farthest = model.surfaces().iter().map(|surface| reach(surface, lattice)).max();
        Self {
            topology: Topology::new(lattice.slot_count() as u32, capacity),
            margin: Arc::new(Margin::new(lattice, farthest.unwrap_or_default())),
            beyond: HashMap::new(),
            surfaces: Vec::new(),
            blade: Vec::new(),
            seen: Seen::default(),
        }
    }

    /// Has the surfaces follow a change. Gives, for each, whether it has changed; one that cannot follow stays as it was, and tries again at the next change.
    fn follow(&mut self, model: &Model, change: &Change, beyond: &[(GridEdge, f64)]) -> Vec<Result<bool>> {
        let (lattice, topology, all) = (model.lattice(), &self.topology, &self.beyond);
        self.surfaces.resize_with(model.surfaces().len(), || None);
        let follow = |(cut, surface): (&mut Option<CutSurface>, &Arc<Surface>)| match cut {
            Some(cut) => {
                let changed = cut.update(surface, lattice, topology, change, beyond.iter().copied())?;
                Ok(!changed.is_empty())
            }
            None => {
                *cut = Some(CutSurface::new(surface, lattice, topology, all)?);
                Ok(true)
            }
        };
        self.surfaces.iter_mut().zip(model.surfaces()).map(follow).collect()
    }
}

/// Flags of a slot, of a lattice whose own slots have `flags` or a copy: where nothing is left it is held.
pub(super) fn flags_of(cuts: Option<&Cuts>, lattice: &Lattice, flags: &[u8], slot: u32) -> u8 {
    if cuts.is_some_and(|cuts| cuts.topology.is_removed(slot)) {
        return flag::FIX_ALL;
    }
    let of_copy = |cuts: &Cuts| cuts.topology.flags_of(lattice, slot, flags);
    let own = flags.get(slot as usize).copied();
    own.or_else(|| cuts.map(of_copy)).unwrap_or(flag::FIX_ALL)
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

/// A cut surface of a model as it is drawn, without what hangs on `vacant` nodes. Fails where there is no room for it.
fn within_room(
    cut: &CutSurface,
    model: &Model,
    index: usize,
    copies: usize,
    vacant: &HashSet<u32>,
) -> Result<Surface> {
    let [vertices, triangles] = room(&model.surfaces()[index], copies);
    let drawn = left_of(cut.drawn(model.lattice().cell_m())?, vacant)?;
    if drawn.positions.len() > vertices || drawn.triangles.len() > triangles {
        return Err(Error::Limit(format!(
            "the cut surface has {} vertices and {} triangles, and there is room for {vertices} and {triangles}",
            drawn.positions.len(),
            drawn.triangles.len()
        )));
    }
    Ok(drawn)
}

/// A surface without what hangs on `vacant` nodes.
fn left_of(surface: Surface, vacant: &HashSet<u32>) -> Result<Surface> {
    if vacant.is_empty() { Ok(surface) } else { surface.without(|slot| vacant.contains(&slot)) }
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
        let can_cut = |edge| cuts.topology.can_cut(lattice, edge, is_soft);
        let crossed = sweep.crossed(lattice, &nodes, &cuts.seen.extents, can_cut);
        let beyond = sweep.crossed_beyond(lattice, &cuts.margin, &nodes, &cuts.seen.extents);
        if crossed.is_empty() && beyond.is_empty() {
            return Ok(0);
        }
        let mut change = cuts.topology.cut(lattice, &crossed)?;
        cuts.cross(&beyond);
        self.remove_crumbs(cuts, &mut change);
        if cuts.topology.version() == 0 {
            return Ok(0);
        }
        self.take_cut(cuts, &change, &beyond)?;
        Ok(change.cells.len())
    }

    /// Has surfaces and solver follow a cut.
    pub fn take_cut(&mut self, cuts: &mut Cuts, change: &Change, beyond: &[(GridEdge, f64)]) -> Result<()> {
        let model = self.model.clone();
        let is_seen = self.draw(cuts, change, beyond)?;
        if change.reshaped().next().is_none() && !is_seen {
            return Ok(());
        }
        // Should the rest fail, steps are only shorter than they need be.
        self.body.note_cut(&model);
        self.statistics.stable_substep_s = self.body.stable_dt;
        let mut flags = self.flags_of_copies(&cuts.topology);
        flags.extend(change.removed.iter().map(|&slot| (slot, flag::FIX_ALL)));
        let taken = self.solver.cut(&cuts.topology, change, &self.surfaces);
        let taken = taken.and_then(|()| self.solver.set_flags(&flags, self.body.stable_dt));
        self.heed(taken)?;
        self.statistics.divided_cells = cuts.topology.cell_count() as u64;
        self.statistics.copies = cuts.topology.copy_count() as u64;
        self.statistics.node_count = (model.lattice().node_count() - cuts.topology.removed().len()) as u64;
        Ok(())
    }

    /// Draws the surfaces anew that a change has changed; whether there is one. Those that cannot follow, or for which there is no room, stay as they were.
    fn draw(&mut self, cuts: &mut Cuts, change: &Change, beyond: &[(GridEdge, f64)]) -> Result<bool> {
        let model = self.model.clone();
        let answers = cuts.follow(&model, change, beyond);
        let (vacant, removes) = (cuts.topology.vacant(), !change.removed.is_empty());
        let mut is_seen = removes;
        for (index, answer) in answers.into_iter().enumerate() {
            let drawn = answer.and_then(|changed| {
                let cut = cuts.surfaces[index].as_ref().filter(|_| changed || removes);
                cut.map(|cut| within_room(cut, &model, index, self.desc.cut_nodes, &vacant)).transpose()
            });
            if drawn.is_err() && removes {
                // It stays as it was, but for what is gone.
                self.surfaces[index] = Arc::new(left_of((*self.surfaces[index]).clone(), &vacant)?);
            }
            match drawn {
                Ok(None) => {}
                Ok(Some(surface)) => {
                    self.surfaces[index] = Arc::new(surface);
                    self.is_behind[index] = false;
                    is_seen = true;
                }
                // Told once, until it follows.
                Err(_) if std::mem::replace(&mut self.is_behind[index], true) => {}
                Err(_) => {
                    let (time_s, surface) = (self.statistics.time_s, index);
                    self.events.tell(Event::SurfaceBehind { time_s, surface });
                }
            }
        }
        self.surface_version += u64::from(is_seen);
        Ok(is_seen)
    }

    /// Where points of the model frame are in whole soft cells, as last looked at.
    pub fn locate(&self, cuts: &Cuts, points: &[Vec3]) -> Vec<Option<Inside>> {
        let (lattice, laws) = (self.model.lattice(), &self.body.laws);
        let is_soft = |slot: u32| laws[(lattice.words()[slot as usize] >> 28) as usize].spring_n_m > 0.0;
        let is_whole = |slot: u32| cuts.topology.is_whole(slot) && is_soft(slot);
        locate(points, lattice, &Nodes { lattice, seen: &cuts.seen }, &cuts.seen.extents, is_whole)
    }

    /// Makes tissue whole; a reset of the solver follows.
    pub fn heal(&mut self) -> Result<()> {
        let Some(cuts) = self.cuts.take().filter(|cuts| cuts.topology.version() > 0) else { return Ok(()) };
        let flags: Vec<_> =
            cuts.topology.removed().map(|slot| (slot, self.body.flags[slot as usize])).collect();
        let healed = self.solver.set_flags(&flags, self.body.stable_dt).and_then(|()| self.solver.heal());
        self.heed(healed)?;
        self.surfaces = self.model.surfaces().to_vec();
        self.is_behind.fill(false);
        self.surface_version += 1;
        Ok(())
    }

    fn flags_of_copies(&self, topology: &Topology) -> Vec<(u32, u8)> {
        let of = |copy| (copy, topology.flags_of(self.model.lattice(), copy, &self.body.flags));
        topology.copies().map(of).collect()
    }

    /// Flags of a slot, of the lattice or a copy.
    pub fn flags_of(&self, slot: u32) -> u8 {
        flags_of(self.cuts.as_ref(), self.model.lattice(), &self.body.flags, slot)
    }

    /// Adds the flags of all copies of nodes to those of nodes that change; nodes without tissue stay held.
    pub fn heed_cuts(&self, changed: &mut Vec<(u32, u8)>) {
        if let Some(cuts) = &self.cuts {
            changed.retain(|&(slot, _)| !cuts.topology.is_removed(slot));
            changed.extend(self.flags_of_copies(&cuts.topology));
        }
    }
}
