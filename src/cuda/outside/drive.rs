//! Rigid regions that are driven.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::cuda::layout::{self, Driven, Motion};
use crate::cuda::memory::{Buffer, Pinned, Stream};
use crate::error::Result;
use crate::math::Vec3;
use crate::model::Model;
use crate::solver::tool::ToolPath;
use crate::solver::{RegionStep, StepPlan};

/// Driven regions as the device knows them.
#[derive(Debug)]
pub struct Drives {
    model: Arc<Model>,
    stream: Arc<Stream>,
    /// The nodes of each region that are listed.
    listed: Vec<Arc<[u32]>>,
    nodes: Buffer<Driven>,
    count: u32,
    /// The furthest of them from the model frame's origin, in m.
    reach: f64,
    /// Where regions are after each substep: on the way, and there.
    sent: Pinned<Motion>,
    motions: Buffer<Motion>,
}

impl Drives {
    /// No region is driven.
    pub fn new(model: &Arc<Model>, stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            model: model.clone(),
            stream: stream.clone(),
            listed: Vec::new(),
            nodes: Buffer::zeros(stream, 0)?,
            count: 0,
            reach: 0.0,
            sent: Pinned::new(stream)?,
            motions: Buffer::zeros(stream, 1)?,
        })
    }

    /// The device's record of the regions that move in a step, and how far a node of theirs goes at most, in m. Does not wait, unless other
    /// nodes move than last time.
    pub fn prepare(&mut self, plan: &StepPlan) -> Result<(layout::Drive, f64)> {
        let regions = plan.regions;
        if regions.is_empty() {
            return Ok(Default::default());
        }
        let is_listed = |(listed, region): (&Arc<[u32]>, &RegionStep)| Arc::ptr_eq(listed, &region.nodes);
        if self.listed.len() != regions.len() || !self.listed.iter().zip(regions).all(is_listed) {
            self.list(regions)?;
        }
        let substeps = plan.substeps as usize;
        let count = substeps * regions.len();
        if count > self.motions.room() {
            let room = count.next_power_of_two();
            self.sent = Pinned::array(&self.stream, room)?;
            self.motions = Buffer::zeros(&self.stream, room)?;
        }
        for substep in 0..substeps {
            let t = (substep + 1) as f64 / substeps as f64;
            for (place, region) in regions.iter().enumerate() {
                let motion = Motion::of(&region.at(t));
                // SAFETY: inside the record, which has as much room as the buffer; its last copy was made before the last step's report.
                unsafe { self.sent.host().add(substep * regions.len() + place).write(motion) };
            }
        }
        // SAFETY: the record is written again only after the step that follows in the stream.
        unsafe { self.motions.send(&self.sent, count)? };
        let way = |region: &RegionStep| ToolPath { from: region.from, to: region.to }.reach(self.reach);
        let drive = layout::Drive {
            count: self.count,
            regions: regions.len() as u32,
            nodes: self.nodes.at(),
            motions: self.motions.at(),
        };
        Ok((drive, regions.iter().map(way).fold(0.0, f64::max)))
    }

    /// Lists the nodes of regions, each once: where regions share a node, the last one takes it along, as on the processor.
    fn list(&mut self, regions: &[RegionStep]) -> Result<()> {
        let lattice = self.model.lattice();
        let rest = |slot: u32| lattice.rest_position(slot);
        let mut nodes = BTreeMap::new();
        for (place, region) in (0..).zip(regions) {
            let slots = region.nodes.iter();
            nodes.extend(slots.map(|&slot| (slot, Driven::of(slot, rest(slot), place))));
        }
        self.reach = nodes.keys().map(|&slot| rest(slot)).map(|at: Vec3| at.norm()).fold(0.0, f64::max);
        self.count = nodes.len() as u32;
        self.nodes.replace(&nodes.into_values().collect::<Vec<_>>())?;
        self.listed.clear();
        self.listed.extend(regions.iter().map(|region| region.nodes.clone()));
        Ok(())
    }
}
