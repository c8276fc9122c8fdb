//! Tissue that sticks to the edges of blades.

use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use crate::cuda::layout::{self, Pull, Stuck};
use crate::cuda::memory::{Buffer, Stream};
use crate::error::Result;
use crate::solver::StepPlan;

/// Points for which there is room at first: there is more where more are in tissue.
const ROOM: usize = 256;

/// The points of edges that are in tissue, as the device knows them.
#[derive(Debug)]
pub struct Sticks {
    points: Buffer<Stuck>,
    pulls: Buffer<Pull>,
    count: Buffer<u32>,
}

impl Sticks {
    /// None.
    pub fn new(stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            points: Buffer::zeros(stream, ROOM)?,
            pulls: Buffer::zeros(stream, ROOM)?,
            count: Buffer::zeros(stream, 1)?,
        })
    }

    /// The device's record of a step's, which adds to `sums` what they give to tools, where nothing `holds` these before; nothing where there are none. Nodes weigh `kg`.
    pub fn prepare(
        &mut self,
        plan: &StepPlan,
        kg: impl Fn(u32) -> f64,
        sums: CUdeviceptr,
        holds: bool,
    ) -> Result<layout::Sticks> {
        let of_tools =
            (0..).zip(plan.tools).flat_map(|(tool, step)| step.held.iter().map(move |held| (tool, held)));
        let points: Vec<Stuck> = of_tools
            .map(|(tool, held)| Stuck {
                nodes: held.nodes,
                weights: held.weights,
                inverse_kg: held.nodes.map(|slot| kg(slot).recip()),
                limit: held.limit_n,
                at: held.at.map(|x| x as f32).into(),
                along: held.along.map(|x| x as f32).into(),
                tool,
            })
            .collect();
        if points.is_empty() {
            return Ok(layout::Sticks::default());
        }
        self.points.replace(&points)?;
        self.pulls.make_room(self.points.room())?;
        self.count.write(0, &[points.len() as u32])?;
        Ok(layout::Sticks {
            all: self.points.at(),
            pulls: self.pulls.at(),
            count: self.count.at(),
            sums,
            substeps: plan.substeps,
            begins: u32::from(!holds),
        })
    }
}
