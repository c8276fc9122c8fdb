//! Tissue that sticks to the edges of blades.

use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use crate::cuda::layout::{self, EdgeCarrier, EdgeLoad, EdgePoint, Pull, Stuck};
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
    /// What implicit steps need besides.
    carried: Option<Carried>,
}

/// What points do inside an implicit step, and the nodes that carry them.
#[derive(Debug)]
struct Carried {
    points: Buffer<EdgePoint>,
    carriers: Buffer<EdgeCarrier>,
    count: Buffer<u32>,
    loads: Buffer<EdgeLoad>,
    /// Of each slot; the kernel writes it.
    carrier_at: Buffer<u32>,
}

impl Carried {
    fn new(slots: usize, stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            points: Buffer::zeros(stream, ROOM)?,
            carriers: Buffer::zeros(stream, 8 * ROOM)?,
            count: Buffer::zeros(stream, 1)?,
            loads: Buffer::zeros(stream, 8 * ROOM)?,
            carrier_at: Buffer::zeros(stream, slots)?,
        })
    }

    /// Lists what nodes carry, in the order of the points for each.
    fn list(&mut self, stuck: &[Stuck]) -> Result<()> {
        let mut loads: Vec<(u32, EdgeLoad)> = Vec::with_capacity(8 * stuck.len());
        for (point, stuck) in (0..).zip(stuck) {
            let pairs = stuck.nodes.into_iter().zip(stuck.weights);
            loads.extend(pairs.map(|(slot, weight)| (slot, EdgeLoad { weight, point })));
        }
        // Stable.
        loads.sort_by_key(|&(slot, _)| slot);
        let mut carriers: Vec<EdgeCarrier> = Vec::new();
        for (place, &(slot, _)) in (0..).zip(&loads) {
            match carriers.last_mut() {
                Some(last) if last.slot == slot => last.count += 1,
                _ => carriers.push(EdgeCarrier { slot, start: place, count: 1 }),
            }
        }
        let loads: Vec<EdgeLoad> = loads.into_iter().map(|(_, load)| load).collect();
        self.carriers.replace(&carriers)?;
        self.loads.replace(&loads)?;
        self.count.write(0, &[carriers.len() as u32])
    }
}

impl Sticks {
    /// None; `slots` is how many there are for nodes where steps are implicit.
    pub fn new(slots: Option<usize>, stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            points: Buffer::zeros(stream, ROOM)?,
            pulls: Buffer::zeros(stream, ROOM)?,
            count: Buffer::zeros(stream, 1)?,
            carried: slots.map(|slots| Carried::new(slots, stream)).transpose()?,
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
        let mut sticks = layout::Sticks {
            all: self.points.at(),
            pulls: self.pulls.at(),
            count: self.count.at(),
            sums,
            substeps: plan.substeps,
            begins: u32::from(!holds),
            ..layout::Sticks::default()
        };
        if let Some(carried) = &mut self.carried {
            carried.list(&points)?;
            carried.points.make_room(self.points.room())?;
            sticks.points = carried.points.at();
            sticks.carriers = carried.carriers.at();
            sticks.carrier_count = carried.count.at();
            sticks.loads = carried.loads.at();
            sticks.carrier_at = carried.carrier_at.at();
        }
        Ok(sticks)
    }
}
