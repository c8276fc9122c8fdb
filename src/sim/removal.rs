//! Removal of tissue: by shape, by part, and of crumbs that a cut leaves.

use std::collections::BTreeSet;

use super::cut::{Cuts, no_room};
use super::state::State;
use crate::cut::region::Region;
use crate::cut::topology::Change;
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};
use crate::model::Model;
use crate::model::law::CellLaw;
use crate::solver::tool::Shape;

/// How much tissue was removed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Removed {
    /// Its volume at rest in m³.
    pub volume_m3: f64,
    /// Its mass in kg.
    pub mass_kg: f64,
}

impl State {
    /// See [`super::Sim::ablate`].
    pub fn ablate(&mut self, shape: &Shape, pose: &Pose) -> Result<Removed> {
        self.refuse_removal()?;
        let mut cuts = self.take_cuts();
        let answer = self.ablate_from(&mut cuts, shape, pose);
        self.cuts = Some(cuts);
        answer
    }

    /// See [`super::Sim::remove_part`].
    pub fn remove_part(&mut self, id: u32) -> Result<Removed> {
        self.refuse_removal()?;
        let model = self.model.clone();
        let lattice = model.lattice();
        let mut cuts = self.take_cuts();
        let is_node = lattice.words().get(id as usize).is_some_and(|&word| word != 0);
        let part = if is_node { cuts.topology.part_of(lattice, id) } else { BTreeSet::new() };
        let answer = if part.is_empty() {
            Err(Error::argument(format!("there is no part {id}")))
        } else {
            let mut change = Change::default();
            let removed = self.remove(&mut cuts, &part, &mut change);
            self.take_cut(&mut cuts, &change, &[]).map(|()| removed)
        };
        self.cuts = Some(cuts);
        answer
    }

    fn refuse_removal(&mut self) -> Result<()> {
        self.check()?;
        if self.desc.cut_nodes == 0 { Err(no_room()) } else { Ok(()) }
    }

    fn ablate_from(&mut self, cuts: &mut Cuts, shape: &Shape, pose: &Pose) -> Result<Removed> {
        let model = self.model.clone();
        let lattice = model.lattice();
        let mut displacements = Vec::new();
        self.solver.displacements(&mut displacements);
        let to_shape = pose.inverse() * model.frame();
        let distance = |p: Vec3| shape.distance(to_shape.transform_point(&p.into()).coords).0;
        let region = Region { lattice, displacements: &displacements, distance: &distance };
        let is_removable =
            |&slot: &u32| !cuts.topology.is_removed(slot) && is_soft(&model, &self.body.laws, slot);
        let nodes: BTreeSet<u32> = region.nodes().filter(is_removable).collect();
        if nodes.is_empty() {
            return Ok(Removed::default());
        }
        let mut change = cuts.topology.cut(lattice, &region.around(&nodes))?;
        let beyond = region.around_beyond(cuts.margin());
        cuts.cross(&beyond);
        let removed = self.remove(cuts, &nodes, &mut change);
        self.take_cut(cuts, &change, &beyond)?;
        Ok(removed)
    }

    /// Takes crumbs away that a cut has left, and that nothing holds: parts smaller than [`super::SimDesc::least_part_cells`].
    pub fn remove_crumbs(&mut self, cuts: &mut Cuts, change: &mut Change) {
        let model = self.model.clone();
        let crumbs = cuts.topology.crumbs(model.lattice(), change, self.desc.least_part_cells);
        let is_free = |crumb: &BTreeSet<u32>| crumb.iter().all(|&slot| self.body.flags[slot as usize] == 0);
        let nodes: BTreeSet<u32> = crumbs.into_iter().filter(is_free).flatten().collect();
        self.remove(cuts, &nodes, change);
    }

    /// Removes the tissue of nodes that cuts have parted from all others. Surfaces and solver have yet to follow.
    fn remove(&mut self, cuts: &mut Cuts, nodes: &BTreeSet<u32>, change: &mut Change) -> Removed {
        let lattice = self.model.lattice();
        let cell_m3 = lattice.cell_m().powi(3);
        let mut removed = Removed::default();
        for (material, volume) in cuts.topology.remove(lattice, nodes, change) {
            removed.volume_m3 += volume * cell_m3;
            removed.mass_kg += 8.0 * self.body.laws[usize::from(material)].corner_kg * volume;
        }
        self.statistics.removed_m3 += removed.volume_m3;
        self.statistics.removed_kg += removed.mass_kg;
        self.let_go_of(nodes);
        removed
    }

    /// Has tools and regions let go of nodes that are gone.
    fn let_go_of(&mut self, nodes: &BTreeSet<u32>) {
        for tool in &mut self.tools {
            if tool.grasped.iter().any(|(slot, _)| nodes.contains(slot)) {
                tool.grasped =
                    tool.grasped.iter().filter(|(slot, _)| !nodes.contains(slot)).copied().collect();
            }
        }
        self.body.set_grasped(nodes.iter().copied(), false);
        for region in self.regions.values_mut() {
            if region.nodes.iter().any(|slot| nodes.contains(slot)) {
                region.nodes = region.nodes.iter().filter(|slot| !nodes.contains(slot)).copied().collect();
            }
        }
    }
}

/// Whether no rigid cell has a node.
fn is_soft(model: &Model, laws: &[CellLaw; 16], slot: u32) -> bool {
    let word = model.lattice().words()[slot as usize];
    let around = (0..8).map(|cell| (word >> (4 * cell) & 15) as usize);
    around.filter(|&material| material != 0).all(|material| laws[material].spring_n_m > 0.0)
}
