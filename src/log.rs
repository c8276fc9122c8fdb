//! What the library tells its host in passing: lines of text, on the thread and within the call that caused
//! them.
//!
//! There is no global logger. Whoever builds a model or owns a simulation hands over a [`Log`]; a step logs
//! only when it fails, and when cells turn over for the first time.

use crate::model::Model;
use crate::sim::{Place, SimDesc};
use crate::solver::statistics::Statistics;

/// How much a line matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Something that a curious user wants to know.
    Info,
    /// Something that a user should change, or know before trusting the result.
    Warning,
}

/// Takes a line.
type Sink = Box<dyn FnMut(Level, &str) + Send>;

/// A destination of lines, or none.
#[derive(Default)]
pub struct Log {
    sink: Option<Sink>,
}

impl Log {
    /// A log that calls `sink` with every line.
    pub fn to(sink: impl FnMut(Level, &str) + Send + 'static) -> Self {
        Self { sink: Some(Box::new(sink)) }
    }

    /// Writes an [`Level::Info`] line. The text is only made when somebody listens.
    pub fn info(&mut self, line: impl FnOnce() -> String) {
        self.write(Level::Info, line);
    }

    /// Writes a [`Level::Warning`] line.
    pub fn warning(&mut self, line: impl FnOnce() -> String) {
        self.write(Level::Warning, line);
    }

    fn write(&mut self, level: Level, line: impl FnOnce() -> String) {
        if let Some(sink) = &mut self.sink {
            sink(level, &line());
        }
    }
}

impl std::fmt::Debug for Log {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Log").field("listening", &self.sink.is_some()).finish()
    }
}

/// What is said when the volume ratio first reaches 0.
pub const OVERTURNED: &str = "step: cells have turned over; forces and shapes are not those of tissue any more, for it \
                              was squeezed further than the model is good for";

/// One line about a finished model.
pub fn model_line(model: &Model, wall_s: f64) -> String {
    let lattice = model.lattice();
    let names: Vec<_> = model.materials().iter().map(|material| material.name.as_str()).collect();
    format!(
        "model: {} cells of {:.3} mm, {} nodes, {} surfaces, materials {}; built in {wall_s:.2} s",
        lattice.cell_count(),
        lattice.cell_m() * 1e3,
        lattice.node_count(),
        model.surfaces().len(),
        names.join(", "),
    )
}

/// One line about the pieces of a model that hang on nothing; none where there are none.
pub fn loose_line(model: &Model) -> Option<String> {
    let pieces = model.loose_pieces();
    let (largest, smallest) = (*pieces.first()?, *pieces.last()?);
    let size = if largest == smallest { largest.to_string() } else { format!("{smallest} to {largest}") };
    Some(format!(
        "model: loose pieces of tissue: {}, cells in each: {size}; joined to nothing and held nowhere, they will \
         move as free bodies; label specks as empty if that is not meant",
        pieces.len()
    ))
}

/// One line about why a simulation that would take a GPU has none; none where it has, or asked for none.
pub fn fallback_line(place: &Place) -> Option<String> {
    place.fallback.as_ref().map(|why| format!("simulation: the processor is taken: {why}"))
}

/// One line about a simulation that was just created.
pub fn sim_line(desc: &SimDesc, place: &Place, now: &Statistics) -> String {
    let substeps = desc.substeps.map_or_else(
        || format!("{} or more", (desc.step_s / now.stable_substep_s).ceil()),
        |fixed| fixed.to_string(),
    );
    format!(
        "simulation on {place}: steps of {:.3} ms, largest stable substep {:.4} ms, {substeps} substeps a step, \
         {:?} precision, {} KiB of nodes",
        desc.step_s * 1e3,
        now.stable_substep_s * 1e3,
        desc.precision,
        now.node_bytes / 1024,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Pose, Vec3};
    use crate::model::grid::LabelGrid;
    use crate::model::material::Material;
    use crate::model::{Build, LabelUse};

    #[test]
    fn loose_pieces_are_told_with_count_and_size() {
        let line = |labels: &[u16]| {
            let grid =
                LabelGrid::new([labels.len(), 1, 1], Vec3::repeat(0.01), Pose::identity(), labels.into());
            let mut build = Build::new(grid.unwrap());
            let jelly = Material::new("jelly", 1e3, 0.3, 1e3).unwrap();
            build.uses = [(0, LabelUse::Empty), (1, LabelUse::Tissue(jelly))].into();
            loose_line(&build.run(&mut |_, _| true).unwrap())
        };
        assert_eq!(line(&[1, 1, 1, 1]), None);
        assert!(line(&[1, 1, 0, 1]).unwrap().contains("tissue: 1, cells in each: 1;"));
        assert!(line(&[1, 0, 1, 1, 1, 1, 0, 1, 1]).unwrap().contains("tissue: 2, cells in each: 1 to 2;"));
    }
}
