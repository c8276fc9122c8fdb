//! What cuts have done to a running simulation, and what is left of its tissue.

use std::collections::HashMap;
use std::sync::Arc;

use super::event::Event;
use super::seen::Seen;
use super::state::State;
use crate::cut::inside::{Inside, locate};
use crate::cut::margin::Margin;
use crate::cut::surface::drawn::{Drawing, Drawn, Redrawn};
use crate::cut::surface::grid::GridEdge;
use crate::cut::surface::{CutSurface, SurfaceChange, reach, room};
use crate::cut::sweep::Sweep;
use crate::cut::topology::{Change, Topology};
use crate::error::{Error, Result};
use crate::math::{Bounds, Vec3};
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
    /// The model's surfaces, cut; none where there never was one that is closed.
    surfaces: Vec<Option<CutSurface>>,
    /// How those are drawn; none where what is drawn is not what is cut.
    drawn: Vec<Option<Drawn>>,
    /// Whether they have been told of a change. They follow no cut before the first cell is divided, and hear of all that was crossed then.
    have_followed: bool,
    /// Where the last blade stands that was not a tool's, model frame.
    blade: Vec<Vec3>,
    pub seen: Seen,
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

    /// None as yet. All that the first cut would else have to find out is found out here.
    pub fn new(model: &Model, copies: usize) -> Self {
        let lattice = model.lattice();
        let capacity = copies.div_ceil(BRICK_SLOTS) * BRICK_SLOTS;
        let topology = Topology::new(lattice.slot_count() as u32, capacity);
        let uncut = |surface: &Arc<Surface>| {
            let mut cut = CutSurface::new(surface, lattice, &topology, &HashMap::new()).ok()?;
            let room = room(surface, copies);
            cut.reserve(room);
            Some((cut, Drawn::uncut(surface, room)))
        };
        let (surfaces, drawn) = model.surfaces().iter().map(|surface| uncut(surface).unzip()).unzip();
        let farthest = model.surfaces().iter().map(|surface| reach(surface, lattice)).max();
        Self {
            topology,
            margin: Arc::new(Margin::new(lattice, farthest.unwrap_or_default())),
            beyond: HashMap::new(),
            surfaces,
            drawn,
            have_followed: false,
            blade: Vec::new(),
            seen: Seen::new(lattice),
        }
    }

    /// Those of the same tissue without a cut.
    fn uncut(self, model: &Model, copies: usize) -> Self {
        if self.topology.version() > 0 || !self.beyond.is_empty() {
            return Self::new(model, copies);
        }
        Self { blade: Vec::new(), seen: Seen::new(model.lattice()), ..self }
    }

    /// Has the surfaces follow a change. Gives, for each, what has changed, `None` where that may be all; one that cannot follow stays as it was, and tries again at the next change.
    fn follow(
        &mut self,
        model: &Model,
        change: &Change,
        beyond: &[(GridEdge, f64)],
    ) -> Vec<Result<Option<SurfaceChange>>> {
        let (lattice, topology, all) = (model.lattice(), &self.topology, &self.beyond);
        let (mut first, mut first_beyond) = (Change::default(), Vec::new());
        let (change, beyond) = if std::mem::replace(&mut self.have_followed, true) {
            (change, beyond)
        } else {
            first.clone_from(change);
            first.edges = topology.everything().edges;
            first_beyond.extend(all.iter().map(|(&edge, &at)| (edge, at)));
            first_beyond.sort_by_key(|&(edge, _)| edge);
            (&first, &first_beyond[..])
        };
        let follow = |(cut, surface): (&mut Option<CutSurface>, &Arc<Surface>)| match cut {
            Some(cut) => cut.update(surface, lattice, topology, change, beyond.iter().copied()).map(Some),
            None => {
                *cut = Some(CutSurface::new(surface, lattice, topology, all)?);
                Ok(None)
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

/// A model's surfaces before any cut, with room for what cuts make of them that copy so many nodes.
pub(super) fn uncut_surfaces(model: &Model, copies: usize) -> Vec<Arc<Surface>> {
    let with_room = |surface: &Arc<Surface>| match copies {
        0 => surface.clone(),
        _ => Arc::new(surface.with_room(room(surface, copies))),
    };
    model.surfaces().iter().map(with_room).collect()
}

/// Why nothing can be cut.
pub(super) fn no_room() -> Error {
    Error::State("the simulation was made without room for cuts: see cut_nodes".into())
}

/// Draws what has changed of a cut surface, or all of it.
fn draw(
    cut: &CutSurface,
    changed: Option<SurfaceChange>,
    own: &Surface,
    drawing: Drawing<'_>,
    drawn: &mut Option<Drawn>,
    surface: &mut Surface,
) -> Result<Redrawn> {
    if let (Some(drawn), Some(changed)) = (&mut *drawn, changed)
        && let Some(redrawn) = drawn.follow(cut, &changed, drawing, surface)?
    {
        return Ok(redrawn);
    }
    let (anew, all) = Drawn::new(cut, own.positions.len(), drawing)?;
    (*drawn, *surface) = (Some(anew), all);
    Ok(Redrawn::all())
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
        let (from, to) = (place(from), place(to));
        let mut cuts = self.take_cuts();
        // A blade that sweeps on meets what has moved meanwhile; one that is put in anew does not.
        let goes_on = cuts.blade == from;
        self.look(&mut cuts, goes_on);
        let answer = self.cut_along(&mut cuts, &Sweep::new(&from, &to, self.model.lattice().cell_m()));
        cuts.blade = to;
        self.cuts = Some(cuts);
        answer
    }

    /// The cuts, to be put back.
    pub fn take_cuts(&mut self) -> Cuts {
        self.cuts.take().unwrap_or_else(|| Cuts::new(&self.model, self.desc.cut_nodes))
    }

    /// Looks where nodes are. Where a blade `goes_on`, they have moved there since the last look.
    pub fn look(&mut self, cuts: &mut Cuts, goes_on: bool) {
        cuts.seen.look(self.solver.as_mut(), goes_on);
        cuts.seen.at_step = self.statistics.steps;
    }

    /// Cuts what a sweep crosses since the look before the last one. Gives how many cells were divided.
    pub fn cut_along(&mut self, cuts: &mut Cuts, sweep: &Sweep) -> Result<usize> {
        let model = self.model.clone();
        let lattice = model.lattice();
        let bricks = cuts.seen.extents.near(sweep.boxes());
        let groups = cuts.margin.near(&cuts.seen.extents, sweep.boxes());
        if bricks.is_empty() && groups.is_empty() {
            return Ok(0);
        }
        cuts.seen.fetch(self.solver.as_mut(), &bricks, cuts.margin.bricks_of(&groups));
        let nodes = cuts.seen.nodes();
        let laws = &self.body.laws;
        let is_soft = |material: u8| laws[usize::from(material)].spring_n_m > 0.0;
        let can_cut = |edge| cuts.topology.can_cut(lattice, edge, is_soft);
        let crossed = sweep.crossed(lattice, &nodes, &cuts.seen.extents, &bricks, can_cut);
        let beyond = sweep.crossed_beyond(lattice, &cuts.margin, &nodes, &cuts.seen.extents, &groups);
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
        let redrawn = self.draw(cuts, change, beyond)?;
        if change.reshaped().next().is_none() && redrawn.iter().all(Redrawn::is_empty) {
            return Ok(());
        }
        // Should the rest fail, steps are only shorter than they need be.
        self.body.note_cut(&model);
        self.statistics.stable_substep_s = self.body.stable_dt;
        let topology = &cuts.topology;
        let copies = topology
            .nodes_of(model.lattice(), change)
            .into_iter()
            .filter(|&slot| topology.origin(slot) != slot);
        let mut flags: Vec<_> = copies.map(|copy| self.flag_of_copy(topology, copy)).collect();
        flags.extend(change.removed.iter().map(|&slot| (slot, flag::FIX_ALL)));
        let surfaces: Vec<_> = self.surfaces.iter().map(Arc::as_ref).zip(&redrawn).collect();
        let taken = self.solver.cut(&cuts.topology, change, &surfaces);
        let taken = taken.and_then(|()| self.solver.set_flags(&flags, self.body.stable_dt));
        self.heed(taken)?;
        self.statistics.divided_cells = cuts.topology.cell_count() as u64;
        self.statistics.copies = cuts.topology.copy_count() as u64;
        self.statistics.node_count = (model.lattice().node_count() - cuts.topology.removed().len()) as u64;
        Ok(())
    }

    /// Draws what a change has changed of the surfaces; gives what that is. Those that cannot follow, or for which there is no room, stay as they were.
    fn draw(&mut self, cuts: &mut Cuts, change: &Change, beyond: &[(GridEdge, f64)]) -> Result<Vec<Redrawn>> {
        let model = self.model.clone();
        let answers = cuts.follow(&model, change, beyond);
        let vacant = cuts.topology.vacant();
        let removes = !change.removed.is_empty();
        let mut all = Vec::with_capacity(answers.len());
        for (index, answer) in answers.into_iter().enumerate() {
            let own = &model.surfaces()[index];
            let drawing = Drawing {
                cell_m: model.lattice().cell_m(),
                vacant: &vacant,
                room: room(own, self.desc.cut_nodes),
            };
            let (cut, drawn) = (&cuts.surfaces[index], &mut cuts.drawn[index]);
            let surface = &mut self.surfaces[index];
            let redrawn = answer.and_then(|changed| match cut {
                Some(cut) if removes || changed.as_ref().is_none_or(|changed| !changed.is_empty()) => {
                    draw(cut, changed.filter(|_| !removes), own, drawing, drawn, Arc::make_mut(surface))
                }
                _ => Ok(Redrawn::default()),
            });
            all.push(match redrawn {
                Ok(redrawn) => {
                    self.is_behind[index] &= drawn.is_none();
                    redrawn
                }
                Err(_) => {
                    *drawn = None;
                    if removes {
                        // It stays as it was, but for what is gone.
                        Arc::make_mut(surface).lose(|row| drawing.is_lost(row))?;
                    }
                    // Told once, until it follows.
                    if !std::mem::replace(&mut self.is_behind[index], true) {
                        let (time_s, surface) = (self.statistics.time_s, index);
                        self.events.tell(Event::SurfaceBehind { time_s, surface });
                    }
                    if removes { Redrawn::all() } else { Redrawn::default() }
                }
            });
        }
        self.surface_version += u64::from(all.iter().any(|redrawn| !redrawn.is_empty()));
        Ok(all)
    }

    /// Where points are in whole soft cells, as last looked at: those of a polyline, model frame.
    pub fn locate(&mut self, cuts: &mut Cuts, points: &[Vec3]) -> Vec<Option<Inside>> {
        let lattice = self.model.lattice();
        let bricks = cuts.seen.extents.near(&Bounds::along(points));
        cuts.seen.fetch(self.solver.as_mut(), &bricks, std::iter::empty());
        let laws = &self.body.laws;
        let is_soft = |slot: u32| laws[(lattice.words()[slot as usize] >> 28) as usize].spring_n_m > 0.0;
        let is_whole = |slot: u32| cuts.topology.is_whole(slot) && is_soft(slot);
        locate(points, lattice, &cuts.seen.nodes(), &cuts.seen.extents, &bricks, is_whole)
    }

    /// Makes tissue whole; a reset of the solver follows.
    pub fn heal(&mut self) -> Result<()> {
        let Some(cuts) = self.cuts.take() else { return Ok(()) };
        let is_whole = cuts.topology.version() == 0;
        let flags: Vec<_> =
            cuts.topology.removed().map(|slot| (slot, self.body.flags[slot as usize])).collect();
        self.cuts = Some(cuts.uncut(&self.model, self.desc.cut_nodes));
        if is_whole {
            return Ok(());
        }
        let healed = self.solver.set_flags(&flags, self.body.stable_dt).and_then(|()| self.solver.heal());
        self.heed(healed)?;
        self.surfaces = uncut_surfaces(&self.model, self.desc.cut_nodes);
        self.is_behind.fill(false);
        self.surface_version += 1;
        Ok(())
    }

    /// A copy and its flags.
    fn flag_of_copy(&self, topology: &Topology, copy: u32) -> (u32, u8) {
        (copy, topology.flags_of(self.model.lattice(), copy, &self.body.flags))
    }

    /// Flags of a slot, of the lattice or a copy.
    pub fn flags_of(&self, slot: u32) -> u8 {
        flags_of(self.cuts.as_ref(), self.model.lattice(), &self.body.flags, slot)
    }

    /// Adds the flags of all copies of nodes to those of nodes that change; nodes without tissue stay held.
    pub fn heed_cuts(&self, changed: &mut Vec<(u32, u8)>) {
        if let Some(cuts) = &self.cuts {
            changed.retain(|&(slot, _)| !cuts.topology.is_removed(slot));
            changed.extend(cuts.topology.copies().map(|copy| self.flag_of_copy(&cuts.topology, copy)));
        }
    }
}
