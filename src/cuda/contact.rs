//! Contact on the device: what it works on, and what is asked of it in a step.
//!
//! Sites, the points of the surface that tools may meet, are listed around the tools with room to spare; the list stays good while no tool leaves
//! that room and no tissue can have come through it, so that it is made once in many steps.

use std::sync::Arc;

use cudarc::driver::sys::CUdeviceptr;

use super::kept::Kept;
use super::kernels::{Kernels, SurfaceKernels};
use super::layout::{
    self, COUNTS, Carrier, Load, MAX_COUPLED, MAX_POINTS, MAX_ROW, MAX_SITES, Moment, Part, Pass, Step,
    ToolSum, Touched, point,
};
use super::memory::{Buffer, Pinned, Stream};
use super::pointer;
use super::surface::room_of;
use crate::cut::surface::drawn::Redrawn;
use crate::error::Result;
use crate::math::{Pose, Vec3};
use crate::model::Model;
use crate::model::lattice::BRICK_SLOTS;
use crate::model::surface::{Edges, ROW, Row, Surface};
use crate::sim::MAX_TOOLS;
use crate::solver::tool::{Contact, MAX_PARTS, ToolPath};
use crate::solver::{StepPlan, ToolStep};

/// Threads of a block of the kernels that list, of the one block of `contact_list`, and of the one that resolves.
const NEAR_THREADS: u32 = 256;
const LIST_THREADS: u32 = 1024;
const THREADS: u32 = 512;
/// Blocks that work out what sites have to do with each other: two or so for each processor of a large GPU.
const COUPLE_BLOCKS: u32 = 256;
/// Numbers of a [`ToolSum`].
const SUMS: usize = 7;
/// No carrier.
const NONE: u32 = u32::MAX;
/// Room to spare around a tool's way, in cells.
const ROOM: f64 = 1.0;
/// How far tissue may come within one step before sites are listed again, in cells.
const LONGEST_WAY: f64 = 2.0;
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
    divides: bool,
    zones: Vec<Zone>,
    /// How far from tools points were looked at then, in m, beyond those that they meet.
    reach: f64,
    /// How much of the room is left, in m; [`NEVER`] where it is good for nothing.
    spare: f64,
}

/// Around a tool.
#[derive(Debug)]
struct Zone {
    /// Where the tool was at the end of the step for which the list was made.
    pose: Pose,
    /// How far any of its points went in that step.
    reach: f64,
}

impl Zone {
    fn of(tool: &ToolStep) -> Self {
        Self { pose: tool.path.to, reach: tool.path.reach(tool.desc.bounding_radius_m()) }
    }

    /// How far any point of the tool gets from where it was, less how far it went then.
    fn leave(&self, tool: &ToolStep) -> f64 {
        let away = [tool.path.from, tool.path.to]
            .map(|pose| ToolPath { from: self.pose, to: pose }.reach(tool.desc.bounding_radius_m()));
        away[0].max(away[1]) - self.reach
    }
}

impl List {
    /// Whether the list holds all that comes as near to tools as `reach` on ways on which tissue may come `way` to meet them.
    fn serves(&self, tools: &[ToolStep], divides: bool, way: f64, reach: f64) -> bool {
        let way = way + reach - self.reach;
        // A comparison with NaN is false.
        self.divides == divides
            && self.zones.len() == tools.len()
            && self.zones.iter().zip(tools).all(|(zone, tool)| zone.leave(tool) + way <= self.spare)
    }
}

/// The contact surface of a simulation on the device.
#[derive(Debug)]
pub struct ContactSurface {
    cell_m: f64,
    edges: Edges,
    /// Material of the tissue under each vertex.
    materials: Vec<u8>,
    /// The longest of all edges at rest, in m.
    longest_edge: f32,
    /// Σ |w| of each vertex: how much further than a node it may move; and the largest.
    levers: Vec<f64>,
    lever: f64,
    /// Furthest node of each vertex's row, in m; and of all.
    reaches: Vec<f64>,
    row_reach: f64,
    list: List,
    vertices: u32,
    triangles: u32,
    rest: Kept<[f32; 3]>,
    row_nodes: Kept<[u32; ROW]>,
    row_weights: Kept<[f32; ROW]>,
    corners: Kept<[u32; 3]>,
    parts: Buffer<Part>,
    triangle_edges: Kept<f32>,
    vertex_edges: Kept<f32>,
    near_bits: Buffer<u32>,
    near: Buffer<u32>,
    near_starts: Buffer<u32>,
    divisions: Buffer<u32>,
    counts: Buffer<u32>,
    site_rest: Buffer<[f32; 4]>,
    site_own: Buffer<[f32; 4]>,
    site_edges: Buffer<f32>,
    site_names: Buffer<[u32; 2]>,
    site_slots: Buffer<u32>,
    site_weights: Buffer<f32>,
    site_carriers: Buffer<Carrier>,
    site_coupled: Buffer<u32>,
    couplings: Buffer<Load>,
    carrier_at: Buffer<u32>,
    carriers: Buffer<Carrier>,
    mobility: Buffer<[f32; 4]>,
    loads: Buffer<Load>,
    active_loads: Buffer<Load>,
    claimed: Buffer<u32>,
    moved: Buffer<[u32; 2]>,
    changes: Buffer<[f32; 4]>,
    active_rows: Buffer<Load>,
    impulses: Buffer<[f32; 4]>,
    given: Buffer<f64>,
    points: Buffer<[f32; 4]>,
    sums: Buffer<ToolSum>,
    /// The points of the last step, where the device tells them; how many they are, and whether it has told them.
    touched: Pinned<Touched>,
    touching: usize,
    are_told: bool,
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
    /// Whether triangles are divided that are long.
    pub divides: bool,
    /// How often sites are listed; 0 where the last list is still good.
    pub lists: u32,
    /// Whether the points come with the step's report.
    pub tells: bool,
}

impl ContactSurface {
    /// Prepares the contact surface of a model, with room for what cuts make of it that copy so many nodes.
    pub fn new(model: &Arc<Model>, copies: usize, stream: &Arc<Stream>) -> Result<Self> {
        let (surface, lattice) = (&model.surfaces()[model.contact_surface()], model.lattice());
        let [vertices, triangles] = room_of(surface, copies);
        let words = vertices.div_ceil(32) + triangles.div_ceil(32);
        let rows = MAX_ROW * MAX_SITES;
        let carrier_at = Buffer::zeros(stream, lattice.slot_count() + copies.next_multiple_of(BRICK_SLOTS))?;
        carrier_at.fill(NONE)?;
        let mut contact = Self {
            cell_m: lattice.cell_m(),
            edges: Edges { of_triangles: Vec::new(), of_vertices: Vec::new() },
            materials: Vec::new(),
            longest_edge: 0.0,
            levers: Vec::new(),
            lever: 1.0,
            reaches: Vec::new(),
            row_reach: 0.0,
            list: List { divides: false, zones: Vec::with_capacity(MAX_TOOLS), reach: 0.0, spare: NEVER },
            vertices: 0,
            triangles: 0,
            rest: Kept::of(stream, Vec::new(), vertices)?,
            row_nodes: Kept::of(stream, Vec::new(), vertices)?,
            row_weights: Kept::of(stream, Vec::new(), vertices)?,
            corners: Kept::of(stream, Vec::new(), triangles)?,
            parts: Buffer::zeros(stream, MAX_TOOLS * MAX_PARTS)?,
            triangle_edges: Kept::of(stream, Vec::new(), triangles)?,
            vertex_edges: Kept::of(stream, Vec::new(), vertices)?,
            near_bits: Buffer::zeros(stream, words)?,
            near: Buffer::zeros(stream, MAX_SITES)?,
            near_starts: Buffer::zeros(stream, MAX_SITES)?,
            divisions: Buffer::zeros(stream, triangles)?,
            counts: Buffer::zeros(stream, COUNTS)?,
            site_rest: Buffer::zeros(stream, MAX_SITES)?,
            site_own: Buffer::zeros(stream, MAX_SITES)?,
            site_edges: Buffer::zeros(stream, MAX_SITES)?,
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
            active_loads: Buffer::zeros(stream, rows)?,
            claimed: Buffer::zeros(stream, rows)?,
            moved: Buffer::zeros(stream, rows)?,
            changes: Buffer::zeros(stream, rows)?,
            active_rows: Buffer::zeros(stream, MAX_POINTS * MAX_ROW)?,
            impulses: Buffer::zeros(stream, MAX_POINTS)?,
            given: Buffer::zeros(stream, SUMS * MAX_POINTS)?,
            points: Buffer::zeros(stream, point::FIELDS * MAX_POINTS)?,
            sums: Buffer::zeros(stream, MAX_TOOLS)?,
            touched: Pinned::array(stream, MAX_POINTS)?,
            touching: 0,
            are_told: false,
            known_parts: Vec::with_capacity(MAX_TOOLS * MAX_PARTS),
            parts_of_step: Vec::with_capacity(MAX_TOOLS * MAX_PARTS),
        };
        contact.follow(surface, &Redrawn::all(), |slot| lattice.rest_position(slot))?;
        Ok(contact)
    }

    /// A cut has made another surface of it. Nodes are at `rest` before they move, copies where what they are copies of is. All contacts are forgotten.
    pub fn follow(&mut self, surface: &Surface, redrawn: &Redrawn, rest: impl Fn(u32) -> Vec3) -> Result<()> {
        self.touching = 0;
        self.lose_track();
        let count = surface.positions.len();
        let (vertices, edges) = (&redrawn.vertices, &mut self.edges);
        let (moved, around) = if redrawn.is_all {
            *edges = surface.edges();
            (Vec::new(), Vec::new())
        } else {
            let moved = redrawn.moved(surface);
            let around = edges.follow(surface, &moved, &redrawn.fans);
            (moved, around)
        };
        (self.vertices, self.triangles) = (count as u32, surface.triangles.len() as u32);
        if redrawn.is_all {
            self.levers = surface.rows.iter().map(lever).collect();
            self.reaches = (0..count).map(|v| reach(surface, v, &rest)).collect();
            self.materials.clone_from(&surface.materials);
            self.rest.set((0..count).map(|v| position(surface, v)).collect())?;
            self.row_nodes.set(surface.rows.iter().map(|row| row.nodes).collect())?;
            self.row_weights.set(surface.rows.iter().map(|row| row.weights).collect())?;
            self.corners.set(surface.triangles.clone())?;
            self.triangle_edges.set(edges.of_triangles.clone())?;
            self.vertex_edges.set(edges.of_vertices.clone())?;
        } else {
            self.levers.resize(count, 1.0);
            self.reaches.resize(count, 0.0);
            self.materials.resize(count, 0);
            for v in vertices.iter().map(|&v| v as usize) {
                self.levers[v] = lever(&surface.rows[v]);
                self.reaches[v] = reach(surface, v, &rest);
                self.materials[v] = surface.materials[v];
            }
            self.rest.edit(count, vertices, |v| position(surface, v))?;
            self.row_nodes.edit(count, vertices, |v| surface.rows[v].nodes)?;
            self.row_weights.edit(count, vertices, |v| surface.rows[v].weights)?;
            self.corners.edit(surface.triangles.len(), &redrawn.triangles, |t| surface.triangles[t])?;
            self.triangle_edges.edit(surface.triangles.len(), &moved, |t| edges.of_triangles[t])?;
            self.vertex_edges.edit(count, &around, |v| edges.of_vertices[v])?;
        }
        self.longest_edge = self.edges.of_triangles.iter().copied().fold(0.0, f32::max);
        self.lever = self.levers.iter().copied().fold(1.0, f64::max);
        self.row_reach = self.reaches.iter().copied().fold(0.0, f64::max);
        Ok(())
    }

    /// What contact will do in a step in which no node comes further than `way` by itself, in m; fills in what the device needs to know.
    pub fn prepare(&mut self, plan: &StepPlan, way: f64, step: &mut Step) -> Result<Plan> {
        let StepPlan { tools, substeps, tells_contacts: tells, .. } = *plan;
        let (moves, divides, reach) = self.note(tools, substeps, step)?;
        let jump = way / f64::from(substeps);
        step.may_jump = tools.iter().any(|tool| jump > JUMP * tool.desc.feature_m()).into();
        // Tissue that a tool pushes moves no faster than the tool.
        let way = self.lever * (way + reach);
        let lists = self.keep_up(tools, divides, substeps, [way, 0.0], step);
        Ok(Plan { tools: tools.len() as u32, moves, divides, lists, tells })
    }

    /// What contact will do in an implicit step, which looks for points as near to tools as `reach` before any node moves: nodes went no further than `way` in
    /// the last one, in m. Fills in what the device needs to know.
    pub fn prepare_ahead(
        &mut self,
        tools: &[ToolStep],
        way: f64,
        reach: f64,
        step: &mut Step,
    ) -> Result<Plan> {
        let (moves, divides, _) = self.note(tools, 1, step)?;
        let lists = self.keep_up(tools, divides, 1, [self.lever * way, reach], step);
        Ok(Plan { tools: tools.len() as u32, moves, divides, lists, tells: true })
    }

    /// Fills in what the device needs to know of tools: how many moves they make in a substep, whether long triangles are divided, and how far any tool goes.
    fn note(&mut self, tools: &[ToolStep], substeps: u32, step: &mut Step) -> Result<(u32, bool, f64)> {
        let (mut moves, mut divides, mut reach) = (1.0_f64, false, 0.0_f64);
        self.parts_of_step.clear();
        for (tool, record) in tools.iter().zip(&mut step.tools) {
            let feature = tool.desc.feature_m();
            *record = layout::ToolStep::of(tool, self.parts_of_step.len() as u32);
            self.parts_of_step.extend(tool.desc.parts.iter().map(|(pose, shape)| Part::of(pose, shape)));
            let own = tool.path.reach(tool.desc.bounding_radius_m());
            moves = moves.max((own / f64::from(substeps) / (0.5 * feature)).ceil());
            divides |= tool.desc.parts.iter().any(|(_, shape)| shape.division(self.longest_edge) > 1);
            reach = reach.max(own);
        }
        if self.parts_of_step != self.known_parts {
            self.parts.write(0, &self.parts_of_step)?;
            std::mem::swap(&mut self.known_parts, &mut self.parts_of_step);
            self.lose_track();
        }
        step.tool_count = tools.len() as u32;
        step.push_limit = (PUSH_LIMIT * self.cell_m) as f32;
        Ok((moves.min(MAX_MOVES) as u32, divides, reach))
    }

    /// How often sites are to be listed in a step in which tissue may come `way` to meet what is as near to tools as `reach`.
    fn keep_up(
        &mut self,
        tools: &[ToolStep],
        divides: bool,
        substeps: u32,
        [way, reach]: [f64; 2],
        step: &mut Step,
    ) -> u32 {
        if tools.is_empty() {
            self.list.spare = NEVER;
            return 0;
        }
        if self.list.serves(tools, divides, way, reach) {
            self.list.spare -= way;
            return 0;
        }
        let cell = self.cell_m;
        let lists = (way / (LONGEST_WAY * cell)).ceil().clamp(1.0, f64::from(substeps)) as u32;
        step.margin = (way / f64::from(lists) + reach + ROOM * cell) as f32;
        (self.list.divides, self.list.reach) = (divides, reach);
        self.list.zones.clear();
        self.list.zones.extend(tools.iter().map(Zone::of));
        // One that is made within a step is that of its last part.
        self.list.spare = if lists == 1 { ROOM * cell } else { NEVER };
        lists
    }

    /// The tissue has been moved otherwise than by steps, or further than was thought.
    pub fn lose_track(&mut self) {
        self.list.spare = NEVER;
    }

    /// What the device works on.
    pub fn on_device(&self, plan: Plan) -> layout::Contact {
        let edge = if plan.divides { f64::from(self.longest_edge) } else { 0.0 };
        layout::Contact {
            vertices: self.vertices,
            triangles: self.triangles,
            first_triangle: self.first_triangle(),
            divides: plan.divides.into(),
            // A little more, for sites lie where rounding puts them.
            reach: (2.001 * (self.row_reach + edge)) as f32,
            rest: self.rest.at(),
            row_nodes: self.row_nodes.at(),
            row_weights: self.row_weights.at(),
            corners: self.corners.at(),
            parts: self.parts.at(),
            triangle_edges: self.triangle_edges.at(),
            vertex_edges: self.vertex_edges.at(),
            near_bits: self.near_bits.at(),
            near: self.near.at(),
            near_starts: self.near_starts.at(),
            divisions: self.divisions.at(),
            counts: self.counts.at(),
            site_rest: self.site_rest.at(),
            site_own: self.site_own.at(),
            site_edges: self.site_edges.at(),
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
            active_loads: self.active_loads.at(),
            claimed: self.claimed.at(),
            moved: self.moved.at(),
            changes: self.changes.at(),
            active_rows: self.active_rows.at(),
            impulses: self.impulses.at(),
            given: self.given.at(),
            points: self.points.at(),
            sums: self.sums.at(),
            touched: self.told_at(plan),
        }
    }

    /// Asks the stream for contact's part of a substep before the nodes move: to list sites where the plan says so. Gives whether it does.
    ///
    /// # Safety
    /// `pass` is that of the substep, and outlives the work.
    pub unsafe fn list(
        &self,
        kernels: &SurfaceKernels,
        stream: &Stream,
        pass: &mut Pass,
        plan: Plan,
        substeps: u32,
    ) -> Result<bool> {
        let part = |substep: u32| u64::from(substep) * u64::from(plan.lists) / u64::from(substeps);
        let begins = pass.substep == 1 || part(pass.substep - 1) != part(pass.substep - 2);
        if plan.lists == 0 || !begins {
            return Ok(false);
        }
        let mut contact = self.on_device(plan);
        let elements = if plan.divides { self.triangles } else { self.vertices };
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
        Ok(true)
    }

    /// Asks the stream to push the tissue out of the tools at the end of a substep; `begins_sums` says whether nothing has been added to the tools' sums in a
    /// step before its first.
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
        begins_sums: bool,
    ) -> Result<()> {
        let mut contact = self.on_device(plan);
        let begin = pass.substep - 1;
        let fraction =
            |step: u32| (f64::from(begin) + f64::from(step) / f64::from(plan.moves)) / f64::from(substeps);
        for step in 1..=plan.moves {
            let mut moment = Moment {
                from: fraction(step - 1) as f32,
                to: fraction(step) as f32,
                is_first: u32::from(begins_sums && begin == 0 && step == 1),
                tissue_moves: u32::from(step == 1),
                is_last: u32::from(step == plan.moves),
            };
            let arguments = &mut [pointer(&mut contact), pointer(pass), pointer(&mut moment)];
            // SAFETY: the kernel's arguments, as declared.
            unsafe {
                kernels.contact.launch(&stream.device, stream.handle, 1, THREADS, arguments)?;
            };
        }
        Ok(())
    }

    /// Where the triangles begin among the elements.
    fn first_triangle(&self) -> u32 {
        self.vertices.next_multiple_of(32)
    }

    /// What tools gave and got in a step, on the device.
    pub fn sums(&self) -> CUdeviceptr {
        self.sums.at()
    }

    /// What else the report is made of, counts and points; and where points are told.
    pub fn told(&self, plan: Plan) -> [CUdeviceptr; 3] {
        [self.counts.at(), self.points.at(), self.told_at(plan)]
    }

    /// Where the device writes points; null where they stay with it.
    fn told_at(&self, plan: Plan) -> CUdeviceptr {
        if plan.tells { self.touched.device_at() } else { 0 }
    }

    /// There are so many points, which the device has told where the plan said so. Gives how many bytes that were.
    pub fn hear(&mut self, points: u32, plan: Plan) -> usize {
        self.touching = (points as usize).min(MAX_POINTS);
        self.are_told = plan.tells;
        if plan.tells { self.touching * size_of::<Touched>() } else { 0 }
    }

    /// The points of the last step, field by field, where they stayed with the device: they are copied here. Nothing where it has told them.
    fn untold(&self) -> Result<Vec<[f32; 4]>> {
        if self.are_told || self.touching == 0 {
            return Ok(Vec::new());
        }
        let mut fields = vec![[0.0; 4]; point::TOLD * MAX_POINTS];
        self.points.read(0, &mut fields)?;
        Ok(fields)
    }

    /// Shows the contacts of one tool in the last substep, model frame; `origin` is where it is.
    pub fn show(&self, tool: u32, origin: Vec3, dt: f64, show: &mut dyn FnMut(Contact)) -> Result<()> {
        let untold = self.untold()?;
        let corners = self.corners.host();
        let first_triangle = self.first_triangle();
        // Which of a triangle's points it is stays with the device.
        let lies = move |element: u32| match element.checked_sub(first_triangle) {
            Some(triangle) => (corners[triangle as usize], [1.0 / 3.0; 3]),
            None => ([element; 3], [1.0, 0.0, 0.0]),
        };
        for k in 0..self.touching {
            let Touched { fields } = if self.are_told {
                // SAFETY: one of those that were heard of. The device told them before its report, and tells others in the next step alone.
                unsafe { self.touched.host().add(k).read_volatile() }
            } else {
                Touched { fields: std::array::from_fn(|field| untold[field * MAX_POINTS + k]) }
            };
            let vector = |field: usize| Vec3::from_fn(|axis, _| f64::from(fields[field][axis]));
            let name = |place: usize| fields[point::NAMES][place].to_bits();
            let (normal, push) = (vector(point::NORMAL), f64::from(fields[point::IMPULSE][3]));
            if name(0) == tool && push > 0.0 {
                let (vertices, shares) = lies(name(1));
                show(Contact {
                    point_m: origin + vector(point::AT),
                    normal,
                    depth_m: f64::from(fields[point::AT][3]),
                    force_n: (normal * push + vector(point::IMPULSE)) / dt,
                    material: self.materials[vertices[0] as usize],
                    vertices,
                    shares,
                });
            }
        }
        Ok(())
    }

    /// Forgets all contacts.
    pub fn clear(&mut self) -> Result<()> {
        self.touching = 0;
        self.lose_track();
        self.counts.clear()?;
        self.claimed.clear()?;
        self.carrier_at.fill(NONE)
    }
}

/// Σ |w| of a row.
fn lever(row: &Row) -> f64 {
    row.weights.iter().map(|w| f64::from(w.abs())).sum()
}

/// Where a vertex is at rest.
fn position(surface: &Surface, vertex: usize) -> [f32; 3] {
    let p = surface.positions[vertex];
    [p.x, p.y, p.z].map(|x| x as f32)
}

/// How far the furthest node of a vertex's row is from it at rest, in m.
fn reach(surface: &Surface, vertex: usize, rest: impl Fn(u32) -> Vec3) -> f64 {
    let Row { nodes, weights } = &surface.rows[vertex];
    let carriers = nodes.iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
    carriers.map(|(&node, _)| (rest(node) - surface.positions[vertex]).norm()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::tool::ToolDesc;

    #[test]
    fn a_list_serves_until_a_tool_or_the_tissue_has_used_up_its_room() {
        let tool = |from: f64, to: f64, turn: f64| ToolStep {
            grasped: Arc::new([]),
            held: Arc::new([]),
            desc: Arc::new(ToolDesc::sphere(0.01)),
            path: ToolPath {
                from: Pose::translation(from, 0.0, 0.0),
                to: Pose::new(Vec3::new(to, 0.0, 0.0), Vec3::new(0.0, turn, 0.0)),
            },
        };
        let list = |spare: f64| List {
            divides: false,
            zones: vec![Zone::of(&tool(0.0, 0.003, 0.0))],
            reach: 0.004,
            spare,
        };
        // On the listed way, as far beyond either of its ends as there is room, and turned as far.
        for (from, to, turn, used) in [
            (0.0, 0.003, 0.0, 0.0),
            (0.003, 0.0, 0.0, 0.0),
            (0.003, 0.008, 0.0, 0.002),
            (0.003, -0.002, 0.0, 0.002),
            (0.003, 0.003, 0.5, 0.002),
        ] {
            let tools = [tool(from, to, turn)];
            // What is looked at further from tools takes room as well.
            for (way, reach) in [(0.001, 0.004), (0.0, 0.005), (0.002, 0.003)] {
                assert!(list(used + 0.001 + 1e-9).serves(&tools, false, way, reach), "{from} to {to}");
                assert!(!list(used + 0.001 - 1e-9).serves(&tools, false, way, reach), "{from} to {to}");
            }
        }
        let tools = [tool(0.0, 0.003, 0.0), tool(0.0, 0.003, 0.0)];
        assert!(!list(1.0).serves(&tools, false, 0.0, 0.004), "another tool");
        assert!(!list(1.0).serves(&tools[..1], true, 0.0, 0.004), "sites elsewhere");
        assert!(
            !list(NEVER).serves(&tools[..1], false, 0.0, 0.004)
                && !list(1.0).serves(&tools[..1], false, f64::NAN, 0.004)
        );
    }
}
