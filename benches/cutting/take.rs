//! Takes a scene step by step, and says of each what it took.

use std::time::Instant;

use palpate::error::{Error, Result};
use palpate::sim::SimDesc;
use palpate::solver::statistics::Statistics;

use super::options::FRAME_S;
use super::scene::{Phase, Scene};
use super::stage::Stage;

/// One step.
#[derive(Clone, Debug)]
pub struct Sample {
    pub phase: Phase,
    /// The share of its way that the blade had gone.
    pub share: f64,
    /// After the step.
    pub statistics: Statistics,
    /// Whether it has divided a cell, or divided one further.
    pub has_divided: bool,
    /// What went to the device in it, and in mapping the surface.
    pub to_device: u64,
    /// The picture that was taken after it, if one was due.
    pub picture: Option<Picture>,
}

/// A surface that a renderer has taken.
#[derive(Clone, Copy, Debug)]
pub struct Picture {
    /// How long mapping took, in s.
    pub map_s: f64,
    pub vertices: usize,
    pub triangles: usize,
}

/// A scene that is measured.
pub struct Take {
    pub stage: Stage,
    /// What creating the simulation copied to the device, the surface that is shown included.
    pub full_bytes: u64,
    seconds: Option<f64>,
    before: Statistics,
}

impl Take {
    /// Of so much of the cut at most.
    pub fn new(scene: Scene, desc: &SimDesc, seconds: Option<f64>) -> Result<Self> {
        let mut stage = Stage::new(scene, desc)?;
        stage.surface.map()?;
        let before = stage.sim.statistics();
        Ok(Self { stage, full_bytes: before.copied.to_device, seconds, before })
    }

    /// Takes a step; `None` at the end.
    pub fn step(&mut self) -> Result<Option<Sample>> {
        let (scene, time_s) = (&self.stage.scene, self.stage.next_s());
        let cut_s = self.seconds.map_or(scene.cut_s, |seconds| seconds.min(scene.cut_s));
        let end_s = if cut_s < scene.cut_s { scene.rest_s + cut_s } else { scene.seconds() };
        if time_s > end_s + 1e-9 {
            return Ok(None);
        }
        let (phase, share) = (scene.phase(time_s), scene.share(time_s));
        self.stage.step().map_err(|error| Error::State(format!("after {time_s:.3} s: {error}")))?;
        let statistics = self.stage.sim.statistics();
        // Pictures are taken as often as a screen shows them, or after every step where those are longer.
        let frames = |time_s: f64| (time_s / FRAME_S + 1e-9).floor();
        let picture = if frames(time_s) > frames(self.before.time_s) { Some(self.map()?) } else { None };
        let copied = self.stage.sim.statistics().copied;
        let sample = Sample {
            phase,
            share,
            statistics,
            has_divided: [statistics.divided_cells, statistics.copies]
                != [self.before.divided_cells, self.before.copies],
            to_device: copied.to_device - self.before.copied.to_device,
            picture,
        };
        self.before = Statistics { copied, ..statistics };
        Ok(Some(sample))
    }

    fn map(&mut self) -> Result<Picture> {
        let begun = Instant::now();
        let frame = self.stage.surface.map()?;
        let map_s = begun.elapsed().as_secs_f64();
        Ok(Picture { map_s, vertices: frame.positions.len(), triangles: frame.triangles.len() })
    }
}
