//! Contact on the device: what it works on, and what is asked of it in a step.
//!
//! Sites, the points of the surface that tools may meet, are listed around the tools with room to spare; the list stays good while no tool leaves
//! that room and no tissue can have come through it, so that it is made once in many steps.

use std::sync::Arc;

use super::kernels::Kernels;
use super::layout::{
    self, Carrier, Load, MAX_COUPLED, MAX_POINTS, MAX_ROW, MAX_SITES, Moment, Part, Pass, Step, ToolSum,
    count, point,
};
use super::memory::{Buffer, Stream};
use super::pointer;
use crate::error::Result;
use crate::math::Vec3;
use crate::model::Model;
use crate::model::surface::ROW;
use crate::sim::MAX_TOOLS;
use crate::solver::ToolStep;
use crate::solver::tool::{Contact, MAX_PARTS};

/// Threads of a block of the kernels that list, of the one block of `contact_list`, and of the one that resolves.
const NEAR_THREADS: u32 = 256;
const LIST_THREADS: u32 = 1024;
const THREADS: u32 = 512;
/// Blocks that work out what sites have to do with each other: two or so for each processor of a large GPU.
const COUPLE_BLOCKS: u32 = 256;
/// Nothing near, nothing dropped. The tag starts at 1: what was never tagged is 0, and belongs to no time.
const FRESH_COUNTS: [u32; count::COUNTS] = [0, 0, 0, 0, 0, 0, 1, 0];
/// Numbers of a [`ToolSum`].
const SUMS: usize = 7;
/// No carrier.
const NONE: u32 = u32::MAX;
/// Room to spare around a tool's way, in cells.
const ROOM: f64 = 1.0;
/// How far tissue may come within one step before sites are listed again, in cells.
const LONGEST_WAY: f64 = 2.0;
/// Finest division of a triangle's edge.
const MAX_DIVISION: f64 = 32.0;
/// Less room than any step needs.
const NEVER: f64 = f64::NEG_INFINITY;
/// Most moves of a tool in a substep.
const MAX_MOVES: f64 = 64.0;
/// Share of a tool's feature that the tissue may travel in a substep before its way matters.
const JUMP: f64 = 0.125;
/// Share of a cell by which a node may be pushed in one substep, besides the tool's own motion.
const PUSH_LIMIT: f64 = 0.25;

/// What the device's list of sites is good for.
#[derive(Debug)]
struct List {
    division: u32,
    /// Where each tool was on its way when the list was made.
    ways: Vec<[Vec3; 2]>,
    /// How much of the room is left, in m; [`NEVER`] where it is good for nothing.
    spare: f64,
}

impl List {
    /// Whether the list holds all that tools can meet on ways on which tissue may come `way` to meet them.
    fn serves(&self, tools: &[ToolStep], division: u32, way: f64) -> bool {
        // A comparison with NaN is false.
        self.division == division
            && self.ways.len() == tools.len()
            && self.ways.iter().zip(tools).all(|(listed, tool)| {
                ends(tool).into_iter().all(|end| distance(end, *listed) + way <= self.spare)
            })
    }
}

/// Where a tool's origin starts and ends in a step.
fn ends(tool: &ToolStep) -> [Vec3; 2] {
    [tool.path.from, tool.path.to].map(|pose| pose.translation.vector)
}

/// Of a point from a segment.
fn distance(point: Vec3, [from, to]: [Vec3; 2]) -> f64 {
    let (way, at) = (to - from, point - from);
    let along = if way.norm_squared() > 0.0 { at.dot(&way) / way.norm_squared() } else { 0.0 };
    (at - way * along.clamp(0.0, 1.0)).norm()
}

/// The contact surface of a model on the device.
#[derive(Debug)]
pub struct ContactSurface {
    model: Arc<Model>,
    longest_edge: f64,
    /// Largest Σ |w| of a vertex: how much further than a node it may move.
    lever: f64,
    /// Furthest node of a vertex's row, in m.
    row_reach: f64,
    list: List,
    vertices: u32,
    triangles: u32,
    rest: Buffer<[f32; 3]>,
    row_nodes: Buffer<[u32; ROW]>,
    row_weights: Buffer<[f32; ROW]>,
    corners: Buffer<[u32; 3]>,
    parts: Buffer<Part>,
    near_bits: Buffer<u32>,
    near: Buffer<u32>,
    counts: Buffer<u32>,
    site_rest: Buffer<[f32; 4]>,
    site_own: Buffer<[f32; 4]>,
    site_names: Buffer<[u32; 2]>,
    site_slots: Buffer<u32>,
    site_weights: Buffer<f32>,
    site_carriers: Buffer<Carrier>,
    site_coupled: Buffer<u32>,
    couplings: Buffer<[f32; 4]>,
    carrier_at: Buffer<u32>,
    carriers: Buffer<Carrier>,
    mobility: Buffer<[f32; 4]>,
    loads: Buffer<Load>,
    moved: Buffer<u32>,
    changes: Buffer<[f32; 4]>,
    impulses: Buffer<[f32; 4]>,
    touches: Buffer<[u32; 2]>,
    given: Buffer<f64>,
    points: Buffer<[f32; 4]>,
    sums: Buffer<ToolSum>,
    /// The parts that lie in `parts`, tool by tool.
    known_parts: Vec<Part>,
    /// Those of a step that is being prepared.
    parts_of_step: Vec<Part>,
}

/// How contact takes part in a step: equal plans are recorded once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Plan {
    /// How many tools there are.
    pub tools: u32,
    /// How many moves each makes in a substep.
    pub moves: u32,
    /// Into how many parts a triangle's edge is divided.
    pub division: u32,
    /// How often sites are listed; 0 where the last list is still good.
    pub lists: u32,
}

impl ContactSurface {
    /// Prepares the contact surface of a model.
    pub fn new(model: &Arc<Model>, stream: &Arc<Stream>) -> Result<Self> {
        let (surface, lattice) = (&model.surfaces()[model.contact_surface()], model.lattice());
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
        let row_reach = surface
            .rows
            .iter()
            .zip(&surface.positions)
            .flat_map(|(row, p)| row.nodes.iter().zip(&row.weights).map(move |(&node, &w)| (node, w, p)))
            .filter(|&(_, weight, _)| weight != 0.0)
            .map(|(node, _, p)| (lattice.rest_position(node) - p).norm())
            .fold(0.0, f64::max);
        let most_elements = vertices.max(surface.triangles.len());
        let rows = MAX_ROW * MAX_SITES;
        let carrier_at = Buffer::zeros(stream, lattice.slot_count())?;
        carrier_at.fill(NONE)?;
        Ok(Self {
            longest_edge,
            lever,
            row_reach,
            list: List { division: 0, ways: Vec::with_capacity(MAX_TOOLS), spare: NEVER },
            vertices: vertices as u32,
            triangles: surface.triangles.len() as u32,
            rest: Buffer::of(stream, &rest)?,
            row_nodes: Buffer::of(stream, &surface.rows.iter().map(|row| row.nodes).collect::<Vec<_>>())?,
            row_weights: Buffer::of(stream, &surface.rows.iter().map(|row| row.weights).collect::<Vec<_>>())?,
            corners: Buffer::of(stream, &surface.triangles)?,
            parts: Buffer::zeros(stream, MAX_TOOLS * MAX_PARTS)?,
            near_bits: Buffer::zeros(stream, most_elements.div_ceil(32))?,
            near: Buffer::zeros(stream, MAX_SITES)?,
            counts: Buffer::of(stream, &FRESH_COUNTS)?,
            site_rest: Buffer::zeros(stream, MAX_SITES)?,
            site_own: Buffer::zeros(stream, MAX_SITES)?,
            site_names: Buffer::zeros(stream, MAX_SITES)?,
            site_slots: Buffer::zeros(stream, rows)?,
            site_weights: Buffer::zeros(stream, rows)?,
            site_carriers: Buffer::zeros(stream, rows)?,
            site_coupled: Buffer::zeros(stream, MAX_SITES)?,
            couplings: Buffer::zeros(stream, MAX_SITES * MAX_COUPLED)?,
            carrier_at,
            carriers: Buffer::zeros(stream, rows)?,
            mobility: Buffer::zeros(stream, rows)?,
            loads: Buffer::zeros(stream, rows)?,
            moved: Buffer::zeros(stream, rows)?,
            changes: Buffer::zeros(stream, rows)?,
            impulses: Buffer::zeros(stream, MAX_POINTS)?,
            touches: Buffer::zeros(stream, 2 * MAX_SITES)?,
            given: Buffer::zeros(stream, SUMS * MAX_POINTS)?,
            points: Buffer::zeros(stream, 2 * point::FIELDS * MAX_POINTS)?,
            sums: Buffer::zeros(stream, MAX_TOOLS)?,
            known_parts: Vec::with_capacity(MAX_TOOLS * MAX_PARTS),
            parts_of_step: Vec::with_capacity(MAX_TOOLS * MAX_PARTS),
            model: model.clone(),
        })
    }

    /// What contact will do in a step in which no node comes further than `way` by itself, in m; fills in what the device needs to know. `step`
    /// says already how long its substeps are.
    pub fn prepare(&mut self, tools: &[ToolStep], substeps: u32, way: f64, step: &mut Step) -> Result<Plan> {
        let (mut moves, mut division, mut reach) = (1.0_f64, 1.0_f64, 0.0_f64);
        self.parts_of_step.clear();
        for (tool, record) in tools.iter().zip(&mut step.tools) {
            let feature = tool.desc.feature_m();
            *record = layout::ToolStep::of(tool, self.parts_of_step.len() as u32);
            self.parts_of_step.extend(tool.desc.parts.iter().map(|(pose, shape)| Part::of(pose, shape)));
            let own = tool.path.reach(tool.desc.bounding_radius_m());
            moves = moves.max((own / f64::from(substeps) / (0.5 * feature)).ceil());
            division = division.max((self.longest_edge / (0.5 * feature)).ceil());
            reach = reach.max(own);
        }
        if self.parts_of_step != self.known_parts {
            self.parts.write(0, &self.parts_of_step)?;
            std::mem::swap(&mut self.known_parts, &mut self.parts_of_step);
            self.lose_track();
        }
        step.tool_count = tools.len() as u32;
        step.push_limit = (PUSH_LIMIT * self.model.lattice().cell_m()) as f32;
        let jump = way / f64::from(substeps);
        step.may_jump = tools.iter().any(|tool| jump > JUMP * tool.desc.feature_m()).into();

        let division = division.min(MAX_DIVISION) as u32;
        // Tissue that a tool pushes moves no faster than the tool.
        let way = self.lever * (way + reach);
        let lists = self.keep_up(tools, division, substeps, way, step);
        Ok(Plan { tools: tools.len() as u32, moves: moves.min(MAX_MOVES) as u32, division, lists })
    }

    /// How often sites are to be listed in a step in which tissue may come `way` to meet tools.
    fn keep_up(
        &mut self,
        tools: &[ToolStep],
        division: u32,
        substeps: u32,
        way: f64,
        step: &mut Step,
    ) -> u32 {
        if tools.is_empty() {
            self.list.spare = NEVER;
            return 0;
        }
        if self.list.serves(tools, division, way) {
            self.list.spare -= way;
            return 0;
        }
        let cell = self.model.lattice().cell_m();
        let lists = (way / (LONGEST_WAY * cell)).ceil().clamp(1.0, f64::from(substeps)) as u32;
        step.margin = (way / f64::from(lists) + ROOM * cell) as f32;
        self.list.division = division;
        self.list.ways.clear();
        self.list.ways.extend(tools.iter().map(ends));
        // One that is made within a step is that of its last part.
        self.list.spare = if lists == 1 { ROOM * cell } else { NEVER };
        lists
    }

    /// The tissue has been moved otherwise than by steps, or further than was thought.
    pub fn lose_track(&mut self) {
        self.list.spare = NEVER;
    }

    fn contact(&self, plan: Plan) -> layout::Contact {
        let edge = if plan.division > 1 { self.longest_edge } else { 0.0 };
        layout::Contact {
            vertices: self.vertices,
            triangles: self.triangles,
            division: plan.division,
            // A little more, for sites lie where rounding puts them.
            reach: (2.001 * (self.row_reach + edge)) as f32,
            edge: edge as f32,
            rest: self.rest.at(),
            row_nodes: self.row_nodes.at(),
            row_weights: self.row_weights.at(),
            corners: self.corners.at(),
            parts: self.parts.at(),
            near_bits: self.near_bits.at(),
            near: self.near.at(),
            counts: self.counts.at(),
            site_rest: self.site_rest.at(),
            site_own: self.site_own.at(),
            site_names: self.site_names.at(),
            site_slots: self.site_slots.at(),
            site_weights: self.site_weights.at(),
            site_carriers: self.site_carriers.at(),
            site_coupled: self.site_coupled.at(),
            couplings: self.couplings.at(),
            carrier_at: self.carrier_at.at(),
            carriers: self.carriers.at(),
            mobility: self.mobility.at(),
            loads: self.loads.at(),
            moved: self.moved.at(),
            changes: self.changes.at(),
            impulses: self.impulses.at(),
            touches: self.touches.at(),
            given: self.given.at(),
            points: self.points.at(),
            sums: self.sums.at(),
        }
    }

    /// Asks the stream for contact's part of a substep before the nodes move: to list sites where the plan says so.
    ///
    /// # Safety
    /// `pass` is that of the substep, and outlives the work.
    pub unsafe fn list(
        &self,
        kernels: &Kernels,
        stream: &Stream,
        pass: &mut Pass,
        plan: Plan,
        substeps: u32,
    ) -> Result<()> {
        let part = |substep: u32| u64::from(substep) * u64::from(plan.lists) / u64::from(substeps);
        let begins = pass.substep == 1 || part(pass.substep - 1) != part(pass.substep - 2);
        if plan.lists == 0 || !begins {
            return Ok(());
        }
        let mut contact = self.contact(plan);
        let elements = if plan.division > 1 { self.triangles } else { self.vertices };
        let launch = [
            (kernels.contact_near, elements.div_ceil(NEAR_THREADS).max(1), NEAR_THREADS),
            (kernels.contact_list, 1, LIST_THREADS),
            (kernels.contact_sites, MAX_SITES as u32 / NEAR_THREADS, NEAR_THREADS),
            (kernels.contact_carry, COUPLE_BLOCKS, NEAR_THREADS),
            (kernels.contact_couple, COUPLE_BLOCKS, NEAR_THREADS),
        ];
        for (kernel, blocks, threads) in launch {
            let arguments = &mut [pointer(&mut contact), pointer(pass)];
            // SAFETY: all take the first argument, and those that take a second one take the pass.
            unsafe { kernel.launch(&stream.device, stream.handle, blocks, threads, arguments)? };
            // Only the first kernel of a step notes when it began.
            pass.started = 0;
        }
        Ok(())
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
        let mut contact = self.contact(plan);
        let begin = pass.substep - 1;
        let fraction =
            |step: u32| (f64::from(begin) + f64::from(step) / f64::from(plan.moves)) / f64::from(substeps);
        let kernel = if plan.division > 1 { kernels.contact_centres } else { kernels.contact_vertices };
        for step in 1..=plan.moves {
            let mut moment = Moment {
                from: fraction(step - 1) as f32,
                to: fraction(step) as f32,
                is_first: u32::from(begin == 0 && step == 1),
                tissue_moves: u32::from(step == 1),
                is_last: u32::from(step == plan.moves),
            };
            let arguments = &mut [pointer(&mut contact), pointer(pass), pointer(&mut moment)];
            // SAFETY: the kernel's arguments, as declared.
            unsafe {
                kernel.launch(&stream.device, stream.handle, 1, THREADS, arguments)?;
            };
        }
        Ok(())
    }

    /// Counts and sums, for the report.
    pub fn told(&self) -> [u64; 2] {
        [self.counts.at(), self.sums.at()]
    }

    /// The contacts of one tool in the last substep, model frame; `origin` is where it is.
    pub fn contacts_of(&self, tool: u32, origin: Vec3, dt: f64) -> Result<Vec<Contact>> {
        let mut counts = [0; count::COUNTS];
        self.counts.read(0, &mut counts)?;
        let mut fields = vec![[0.0; 4]; point::FIELDS * MAX_POINTS];
        self.points.read((counts[count::TAG] as usize & 1) * fields.len(), &mut fields)?;
        let surface = &self.model.surfaces()[self.model.contact_surface()];
        let at = |field: usize, k: usize| fields[field * MAX_POINTS + k];
        let vector = |field: usize, k: usize| Vec3::from_fn(|axis, _| f64::from(at(field, k)[axis]));
        let name = |k: usize, place: usize| at(point::NAMES, k)[place].to_bits();
        let push = |k: usize| f64::from(at(point::IMPULSE, k)[3]);
        Ok((0..counts[count::POINTS] as usize)
            .filter(|&k| name(k, 0) == tool && push(k) > 0.0)
            .map(|k| Contact {
                point_m: origin + vector(point::AT, k),
                normal: vector(point::NORMAL, k),
                depth_m: f64::from(at(point::AT, k)[3]),
                force_n: (vector(point::NORMAL, k) * push(k) + vector(point::IMPULSE, k)) / dt,
                material: surface.materials[name(k, 1) as usize],
            })
            .collect())
    }

    /// Forgets all contacts.
    pub fn clear(&mut self) -> Result<()> {
        self.list.spare = NEVER;
        self.counts.write(0, &FRESH_COUNTS)?;
        self.carrier_at.fill(NONE)?;
        self.touches.clear()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_is_as_far_from_a_segment_as_from_its_nearest_point() {
        let segment = [Vec3::zeros(), Vec3::new(2.0, 0.0, 0.0)];
        for (point, expected) in
            [([1.0, 3.0, 0.0], 3.0), ([-3.0, 4.0, 0.0], 5.0), ([5.0, 0.0, 4.0], 5.0), ([0.5, 0.0, 0.0], 0.0)]
        {
            assert_eq!(distance(point.into(), segment), expected);
        }
        assert_eq!(distance(Vec3::x(), [Vec3::zeros(); 2]), 1.0, "one that has no length");
    }
}
