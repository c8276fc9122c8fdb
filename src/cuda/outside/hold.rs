//! Nodes that tools hold.

use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use crate::cuda::body::Body;
use crate::cuda::layout::{self, Held};
use crate::cuda::memory::{Buffer, Stream};
use crate::error::Result;
use crate::math::Vec3;
use crate::model::Model;
use crate::sim::MAX_TOOLS;
use crate::solver::{StepPlan, ToolStep};

/// Slots of nodes that a tool holds, and where they are in its frame, in m.
type Grasped = Arc<[(u32, Vec3)]>;

/// What tools hold, as the device knows it.
#[derive(Debug)]
pub struct Holds {
    model: Arc<Model>,
    /// What each tool of the last step held, where that is what is listed.
    known: Option<Vec<Grasped>>,
    nodes: Buffer<Held>,
    starts: Buffer<u32>,
    count: u32,
    /// The furthest node of each tool from its origin, in m.
    reaches: Vec<f64>,
}

impl Holds {
    /// Nothing is held.
    pub fn new(model: &Arc<Model>, stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            model: model.clone(),
            known: Some(Vec::with_capacity(MAX_TOOLS)),
            nodes: Buffer::zeros(stream, 0)?,
            starts: Buffer::zeros(stream, MAX_TOOLS + 1)?,
            count: 0,
            reaches: Vec::with_capacity(MAX_TOOLS),
        })
    }

    /// Masses have changed.
    pub fn forget(&mut self) {
        self.known = None;
    }

    /// The device's record of what tools hold in a step, which adds to `sums` what that takes; and how far a node goes at most, in m. Waits where tools hold
    /// other nodes than last time.
    pub fn prepare(
        &mut self,
        plan: &StepPlan,
        body: &Body,
        sums: CUdeviceptr,
    ) -> Result<(layout::Hold, f64)> {
        let is_same = |(known, tool): (&Grasped, &ToolStep)| Arc::ptr_eq(known, &tool.grasped);
        let are_known = self.known.as_ref().is_some_and(|known| {
            known.len() == plan.tools.len() && known.iter().zip(plan.tools).all(is_same)
        });
        if !are_known {
            self.list(plan.tools, body)?;
        }
        if self.count == 0 {
            return Ok(Default::default());
        }
        let way = plan.tools.iter().zip(&self.reaches).map(|(tool, &reach)| tool.path.reach(reach));
        let hold = layout::Hold {
            count: self.count,
            substeps: plan.substeps,
            nodes: self.nodes.at(),
            starts: self.starts.at(),
            sums,
        };
        Ok((hold, way.fold(0.0, f64::max)))
    }

    fn list(&mut self, tools: &[ToolStep], body: &Body) -> Result<()> {
        self.known = None;
        let lattice = self.model.lattice();
        let (mut nodes, mut starts) = (Vec::new(), vec![0]);
        self.reaches.clear();
        for tool in tools {
            let held = tool.grasped.iter();
            nodes.extend(held.map(|&(slot, place)| {
                Held::of(slot, lattice.rest_position(slot), place, body.node_mass(slot))
            }));
            starts.push(nodes.len() as u32);
            self.reaches.push(tool.grasped.iter().map(|(_, place)| place.norm()).fold(0.0, f64::max));
        }
        self.nodes.replace(&nodes)?;
        self.starts.write(0, &starts)?;
        self.count = nodes.len() as u32;
        self.known = Some(tools.iter().map(|tool| tool.grasped.clone()).collect());
        Ok(())
    }
}
