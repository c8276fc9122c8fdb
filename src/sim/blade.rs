//! Tools with an edge: what it stands in when a step begins, and what it has cut when the step ends.

use std::sync::Arc;

use super::cut::Cuts;
use super::event::Event;
use super::state::State;
use crate::cut::sweep::Sweep;
use crate::math::{Pose, Vec3};
use crate::solver::ToolStep;
use crate::solver::blade::{Blade, Held};

/// Points at which tissue holds an edge, for each length of a cell.
const POINTS: f64 = 2.0;

impl State {
    /// Has tissue stick to the edges in it, before a step.
    pub fn stick_to_blades(&mut self) {
        if self.steps.iter().all(|step| step.desc.blade.is_none()) {
            return;
        }
        let mut cuts = self.take_cuts();
        if cuts.seen.at_step != self.statistics.steps || cuts.seen.is_empty() {
            self.look(&mut cuts, false);
        }
        let mut steps = std::mem::take(&mut self.steps);
        for step in &mut steps {
            if let Some(blade) = step.desc.blade.as_ref().filter(|blade| blade.toughness_j_m2 > 0.0) {
                step.held = self.held(&mut cuts, blade, &step.path.from);
            }
        }
        self.steps = steps;
        self.cuts = Some(cuts);
    }

    /// Where the edge of a blade stands in whole soft cells.
    fn held(&mut self, cuts: &mut Cuts, blade: &Blade, pose: &Pose) -> Arc<[Held]> {
        let edge: Vec<_> = blade.points(self.model.lattice().cell_m() / POINTS).collect();
        let points: Vec<Vec3> =
            edge.iter().map(|(at, ..)| pose.transform_point(&(*at).into()).coords).collect();
        let found = self.locate(cuts, &points);
        let held = edge.into_iter().zip(found).filter_map(|((at, along, length), inside)| {
            let inside = inside?;
            let limit_n = blade.toughness_j_m2 * length;
            Some(Held { nodes: inside.corners, weights: inside.weights, at, along, limit_n })
        });
        held.collect()
    }

    /// Cuts what edges have crossed in the step that has ended.
    pub fn cut_with_blades(&mut self) {
        if self.steps.iter().all(|step| step.desc.blade.is_none()) {
            return;
        }
        let mut cuts = self.take_cuts();
        let goes_on = cuts.seen.at_step + 1 == self.statistics.steps;
        self.look(&mut cuts, goes_on);
        let cell_m = self.model.lattice().cell_m();
        for planned in 0..self.steps.len() {
            let ToolStep { desc, path, .. } = &self.steps[planned];
            let Some(blade) = &desc.blade else { continue };
            let place = |pose: &Pose| -> Vec<Vec3> {
                blade.edge.iter().map(|point| pose.transform_point(&(*point).into()).coords).collect()
            };
            let sweep = Sweep::new(&place(&path.from), &place(&path.to), cell_m);
            let answer = self.cut_along(&mut cuts, &sweep);
            let tool = &mut self.tools[self.planned[planned]];
            // Told once: there is no more room until a reset.
            if answer.is_err() && !std::mem::replace(&mut tool.is_refused, true) {
                let (time_s, tool) = (self.statistics.time_s, tool.id);
                self.events.tell(Event::CutRefused { time_s, tool });
            }
        }
        self.cuts = Some(cuts);
    }
}
