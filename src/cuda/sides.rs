//! The sides of cuts, face to face, on the device.

use std::sync::Arc;

use super::kept::Kept;
use super::layout;
use super::memory::Stream;
use crate::cut::facing::{CLASSES, Facing, Facings};
use crate::cut::topology::{Change, Topology};
use crate::error::Result;

/// All pairs.
#[derive(Debug)]
pub struct Sides {
    facing: Facings,
    all: Kept<layout::Facing>,
    cells: Kept<u32>,
    classes: Kept<u32>,
}

impl Sides {
    /// None, with room for so many.
    pub fn new(room: usize, stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            facing: Facings::default(),
            all: Kept::of(stream, Vec::new(), room)?,
            cells: Kept::of(stream, Vec::new(), room + 1)?,
            classes: Kept::of(stream, Vec::new(), CLASSES + 1)?,
        })
    }

    /// Takes over what a cut has changed of a topology, whose nodes weigh `kg`.
    pub fn take(&mut self, topology: &Topology, change: &Change, kg: impl Fn(u32) -> f64) -> Result<()> {
        self.facing.follow(topology, change);
        let (mut cells, mut classes, mut pairs) = (Vec::new(), Vec::new(), 0);
        for (class, facing) in self.facing.cells() {
            classes.resize(classes.len().max(class + 1), cells.len() as u32);
            cells.push(pairs);
            pairs += facing.len() as u32;
        }
        classes.resize(CLASSES + 1, cells.len() as u32);
        cells.push(pairs);
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
