//! The sides of cuts, face to face, on the device.

use std::sync::Arc;

use super::kept::Kept;
use super::layout;
use super::memory::Stream;
use crate::cut::facing::{CLASSES, Facing};
use crate::cut::topology::Topology;
use crate::error::Result;

/// All pairs.
#[derive(Debug)]
pub struct Sides {
    facing: Vec<Facing>,
    all: Kept<layout::Facing>,
    cells: Kept<u32>,
    classes: Kept<u32>,
}

impl Sides {
    /// None.
    pub fn new(stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            facing: Vec::new(),
            all: Kept::of(stream, Vec::new(), 0)?,
            cells: Kept::of(stream, Vec::new(), 0)?,
            classes: Kept::of(stream, Vec::new(), CLASSES + 1)?,
        })
    }

    /// Takes over those of a topology, whose nodes weigh `kg`.
    pub fn take(&mut self, topology: &Topology, kg: impl Fn(u32) -> f64) -> Result<()> {
        self.facing = Facing::all(topology);
        let (mut cells, mut classes) = (Vec::new(), Vec::new());
        for (pair, facing) in (0..).zip(&self.facing) {
            let begins = pair == 0 || self.facing[pair as usize - 1].cell != facing.cell;
            classes.resize(classes.len().max(facing.class() + 1), cells.len() as u32);
            if begins {
                cells.push(pair);
            }
        }
        classes.resize(CLASSES + 1, cells.len() as u32);
        cells.push(self.facing.len() as u32);
        self.cells.set(cells)?;
        self.classes.set(classes)?;
        self.weigh(kg)
    }

    /// Nodes weigh otherwise, by their slots.
    pub fn weigh(&mut self, kg: impl Fn(u32) -> f64) -> Result<()> {
        let record = |facing: &Facing| layout::Facing {
            nodes: facing.nodes,
            weights: facing.weights,
            inverse_kg: facing.nodes.map(|side| side.map(|slot| kg(slot).recip())),
            normal: facing.normal.into(),
        };
        self.all.set(self.facing.iter().map(record).collect())
    }

    /// All cells are whole again.
    pub fn heal(&mut self) {
        self.facing.clear();
    }

    /// What kernels know; nothing where there are none.
    pub fn on_device(&self) -> layout::Sides {
        if self.facing.is_empty() {
            return layout::Sides::default();
        }
        layout::Sides { all: self.all.at(), cells: self.cells.at(), classes: self.classes.at() }
    }
}
