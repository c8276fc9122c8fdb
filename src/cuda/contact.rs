//! Contact on the device: what it works on, and what is asked of it in a step.

use std::sync::Arc;

use super::device::Device;
use super::kernels::Kernels;
use super::layout::{self, MAX_NEAR, MAX_NODES, MAX_POINTS, Moment, Part, Pass, ToolSum, point};
use super::memory::{Buffer, Stream};
use super::pointer;
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::model::Model;
use crate::model::surface::ROW;
use crate::sim::MAX_TOOLS;
use crate::solver::ToolStep;
use crate::solver::tool::{Contact, MAX_PARTS};

/// Threads of a block of `contact_near`, and of the one block of `contact_list` and of `contact_resolve`.
const NEAR_THREADS: u32 = 256;
const LIST_THREADS: u32 = 1024;
const THREADS: u32 = 256;
/// Nothing near, nothing dropped. The tag starts at 1: what was never tagged is 0, and belongs to no time.
const FRESH_COUNTS: [u32; 8] = [0, 0, 0, 0, 1, 0, 0, 0];
/// Most moves of a tool in a substep.
const MAX_MOVES: f64 = 64.0;
/// Share of a tool's feature that the tissue may travel in a substep before its way matters.
const JUMP: f64 = 0.125;
/// Share of a cell by which a node may be pushed in one substep, besides the tool's own motion.
const PUSH_LIMIT: f64 = 0.25;

/// How much contact a device's shared memory holds at once.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// Points.
    points: u32,
    /// Nodes that carry them.
    touched: u32,
}

impl Room {
    /// What a block may share on a device.
    pub fn on(device: &Device) -> Result<Self> {
        device.shared_bytes().map(Self::within)
    }

    /// What fits where a block may have so many bytes.
    pub fn within(shared_bytes: u32) -> Self {
        /// What the kernel declares itself, and what the driver keeps, in bytes.
        const DECLARED: u32 = 9 << 10;
        let shared = shared_bytes.saturating_sub(DECLARED);
        // Both hold 16 bytes each; a point is carried by nearly two nodes of its own.
        let points = (shared / 16 * 4 / 11).min(MAX_POINTS as u32);
        Self { points, touched: points * 7 / 4 }
    }

    /// Shared memory in bytes.
    pub fn bytes(self) -> u32 {
        (self.points + self.touched) * 16
    }
}

/// The contact surface of a model on the device.
#[derive(Debug)]
pub struct ContactSurface {
    model: Arc<Model>,
    room: Room,
    longest_edge: f64,
    /// Largest Σ |w| of a vertex: how much further than a node it may move.
    lever: f64,
    vertices: u32,
    rest: Buffer<[f32; 3]>,
    row_nodes: Buffer<[u32; ROW]>,
    row_weights: Buffer<[f32; ROW]>,
    parts: Buffer<Part>,
    near_bits: Buffer<u32>,
    near: Buffer<u32>,
    counts: Buffer<u32>,
    node_stamp: Buffer<u32>,
    node_of: Buffer<u32>,
    nodes: Buffer<u32>,
    mobility: Buffer<[f32; 4]>,
    node_tag: Buffer<u32>,
    touched_at: Buffer<u32>,
    touched: Buffer<u32>,
    touched_mobility: Buffer<[f32; 4]>,
    entry_start: Buffer<u32>,
    entries: Buffer<[u32; 2]>,
    head_tag: Buffer<u32>,
    head: Buffer<u32>,
    points: Buffer<f32>,
    sums: Buffer<ToolSum>,
    /// The parts that lie in `parts`, tool by tool.
    known_parts: Vec<Part>,
}

/// How contact takes part in a step: equal plans are recorded once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Plan {
    /// How many tools there are.
    pub tools: u32,
    /// How many moves each makes in a substep.
    pub moves: u32,
}

impl ContactSurface {
    /// Prepares the contact surface of a model.
    pub fn new(model: &Arc<Model>, stream: &Arc<Stream>, room: Room) -> Result<Self> {
        let surface = &model.surfaces()[model.contact_surface()];
        let slots = model.lattice().slot_count();
        let vertices = surface.positions.len();
        let rest: Vec<[f32; 3]> =
            surface.positions.iter().map(|p| [p.x, p.y, p.z].map(|x| x as f32)).collect();

        let longest_edge = surface
            .triangles
            .iter()
            .flat_map(|t| (0..3).map(move |i| (t[i], t[(i + 1) % 3])))
            .map(|(a, b)| (surface.positions[a as usize] - surface.positions[b as usize]).norm())
            .fold(0.0, f64::max);
        let lever = surface
            .rows
            .iter()
            .map(|row| row.weights.iter().map(|w| f64::from(w.abs())).sum())
            .fold(1.0, f64::max);
        let (points, touched) = (room.points as usize, room.touched as usize);
        Ok(Self {
            room,
            longest_edge,
            lever,
            vertices: vertices as u32,
            rest: Buffer::of(stream, &rest)?,
            row_nodes: Buffer::of(stream, &surface.rows.iter().map(|row| row.nodes).collect::<Vec<_>>())?,
            row_weights: Buffer::of(stream, &surface.rows.iter().map(|row| row.weights).collect::<Vec<_>>())?,
            parts: Buffer::zeros(stream, MAX_TOOLS * MAX_PARTS)?,
            near_bits: Buffer::zeros(stream, vertices.div_ceil(32))?,
            near: Buffer::zeros(stream, MAX_NEAR)?,
            counts: Buffer::of(stream, &FRESH_COUNTS)?,
            node_stamp: Buffer::zeros(stream, slots)?,
            node_of: Buffer::zeros(stream, slots)?,
            nodes: Buffer::zeros(stream, MAX_NODES)?,
            mobility: Buffer::zeros(stream, MAX_NODES)?,
            node_tag: Buffer::zeros(stream, MAX_NODES)?,
            touched_at: Buffer::zeros(stream, MAX_NODES)?,
            touched: Buffer::zeros(stream, touched)?,
            touched_mobility: Buffer::zeros(stream, touched)?,
            entry_start: Buffer::zeros(stream, touched + 1)?,
            entries: Buffer::zeros(stream, points * ROW)?,
            head_tag: Buffer::zeros(stream, vertices)?,
            head: Buffer::zeros(stream, vertices)?,
            points: Buffer::zeros(stream, 2 * point::FIELDS * MAX_POINTS)?,
            sums: Buffer::zeros(stream, MAX_TOOLS)?,
            known_parts: Vec::new(),
            model: model.clone(),
        })
    }

    /// What contact will do in a step, and the device's record of every tool.
    pub fn plan(&mut self, tools: &[ToolStep], substeps: u32) -> Result<(Plan, Vec<layout::ToolStep>)> {
        let mut records = Vec::with_capacity(tools.len());
        let mut parts = Vec::new();
        let mut moves = 1.0_f64;
        for tool in tools {
            let feature = tool.desc.feature_m();
            if self.longest_edge > 0.5 * feature {
                return Err(Error::Unsupported(format!(
                    "on a GPU, contact needs a surface whose edges ({} m) are at most half of a tool's smallest size ({feature} m)",
                    self.longest_edge
                )));
            }
            records.push(layout::ToolStep::of(tool, parts.len() as u32));
            parts.extend(tool.desc.parts.iter().map(|(pose, shape)| Part::of(pose, shape)));
            let way = tool.path.reach(tool.desc.bounding_radius_m()) / f64::from(substeps);
            moves = moves.max((way / (0.5 * feature)).ceil());
        }
        if parts != self.known_parts {
            self.parts.write(0, &parts)?;
            self.known_parts = parts;
        }
        Ok((Plan { tools: tools.len() as u32, moves: moves.min(MAX_MOVES) as u32 }, records))
    }

    /// How far tissue may come to meet tools in a step, besides their own ways, when no node is faster than `speed` at its start and all
    /// fall with `gravity`.
    pub fn margin(&self, tools: &[ToolStep], speed: f64, gravity: f64, duration: f64) -> f64 {
        // Tissue that a tool pushes moves no faster than the tool.
        let reach = tools.iter().map(|t| t.path.reach(t.desc.bounding_radius_m())).fold(0.0, f64::max);
        let way = speed * duration + 0.5 * gravity * duration * duration + reach;
        self.lever * way + 0.5 * self.model.lattice().cell_m()
    }

    /// Whether tissue may come so far in one substep that its way matters to a tool.
    pub fn may_jump(&self, tools: &[ToolStep], speed: f64, dt: f64) -> bool {
        tools.iter().any(|tool| speed * dt > JUMP * tool.desc.feature_m())
    }

    /// Largest push in one substep, in m.
    pub fn push_limit(&self) -> f64 {
        PUSH_LIMIT * self.model.lattice().cell_m()
    }

    fn contact(&self) -> layout::Contact {
        layout::Contact {
            vertices: self.vertices,
            max_points: self.room.points,
            max_touched: self.room.touched,
            rest: self.rest.at(),
            row_nodes: self.row_nodes.at(),
            row_weights: self.row_weights.at(),
            parts: self.parts.at(),
            near_bits: self.near_bits.at(),
            near: self.near.at(),
            counts: self.counts.at(),
            node_stamp: self.node_stamp.at(),
            node_of: self.node_of.at(),
            nodes: self.nodes.at(),
            mobility: self.mobility.at(),
            node_tag: self.node_tag.at(),
            touched_at: self.touched_at.at(),
            touched: self.touched.at(),
            touched_mobility: self.touched_mobility.at(),
            entry_start: self.entry_start.at(),
            entries: self.entries.at(),
            head_tag: self.head_tag.at(),
            head: self.head.at(),
            points: self.points.at(),
            sums: self.sums.at(),
        }
    }

    /// Asks the stream to list what tools may meet in the coming step.
    ///
    /// # Safety
    /// `pass` is that of the step's first substep, and outlives the work.
    pub unsafe fn list(&self, kernels: &Kernels, stream: &Stream, pass: &mut Pass) -> Result<()> {
        let mut contact = self.contact();
        let blocks = self.vertices.div_ceil(NEAR_THREADS);
        let arguments = &mut [pointer(&mut contact), pointer(pass)];
        // SAFETY: the kernels' arguments, as declared.
        unsafe {
            kernels.contact_near.launch(&stream.device, stream.handle, blocks, NEAR_THREADS, 0, arguments)?;
            kernels.contact_list.launch(&stream.device, stream.handle, 1, LIST_THREADS, 0, arguments)
        }
    }

    /// Asks the stream to push the tissue out of the tools at the end of a substep.
    ///
    /// # Safety
    /// `pass` is that of the substep, and outlives the work.
    pub unsafe fn resolve(
        &self,
        kernels: &Kernels,
        stream: &Stream,
        pass: &mut Pass,
        plan: Plan,
        substeps: u32,
    ) -> Result<()> {
        let mut contact = self.contact();
        let begin = pass.substep - 1;
        let fraction =
            |step: u32| (f64::from(begin) + f64::from(step) / f64::from(plan.moves)) / f64::from(substeps);
        for step in 1..=plan.moves {
            let mut moment = Moment {
                from: fraction(step - 1) as f32,
                to: fraction(step) as f32,
                tissue_moves: u32::from(step == 1),
                is_last: u32::from(step == plan.moves),
            };
            let arguments = &mut [pointer(&mut contact), pointer(pass), pointer(&mut moment)];
            // SAFETY: the kernel's arguments, as declared.
            unsafe {
                let device = &stream.device;
                kernels.contact_resolve.launch(
                    device,
                    stream.handle,
                    1,
                    THREADS,
                    self.room.bytes(),
                    arguments,
                )?;
            }
        }
        Ok(())
    }

    /// Counts and sums, for the report.
    pub fn told(&self) -> [u64; 2] {
        [self.counts.at(), self.sums.at()]
    }

    /// The contacts of one tool in the last substep, model frame; `origin` is where it is.
    pub fn contacts_of(&self, tool: u32, origin: Vec3, dt: f64) -> Result<Vec<Contact>> {
        let mut counts = [0; 5];
        self.counts.read(0, &mut counts)?;
        let [.., points, tag] = counts;
        let mut fields = vec![0.0; point::FIELDS * MAX_POINTS];
        self.points.read((tag as usize & 1) * fields.len(), &mut fields)?;
        let surface = &self.model.surfaces()[self.model.contact_surface()];
        let number = |field: usize, k: usize| fields[field * MAX_POINTS + k];
        let vector = |field: usize, k: usize| Vec3::from_fn(|axis, _| f64::from(number(field + axis, k)));
        let is_mine = |k: &usize| number(point::TOOL, *k).to_bits() == tool && number(point::PUSH, *k) > 0.0;
        Ok((0..points as usize)
            .filter(is_mine)
            .map(|k| Contact {
                point_m: origin + vector(point::AT, k),
                normal: vector(point::NORMAL, k),
                depth_m: f64::from(number(point::DEPTH, k)),
                force_n: (vector(point::NORMAL, k) * f64::from(number(point::PUSH, k))
                    + vector(point::DRAG, k))
                    / dt,
                material: surface.materials[number(point::VERTEX, k).to_bits() as usize],
            })
            .collect())
    }

    /// Forgets all contacts.
    pub fn clear(&self) -> Result<()> {
        self.counts.write(0, &FRESH_COUNTS)?;
        self.node_stamp.clear()?;
        self.node_tag.clear()?;
        self.head_tag.clear()
    }
}
