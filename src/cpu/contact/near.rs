//! Which triangles of the contact surface tools may meet.
//!
//! Around each tool's way in a step lies a box with some room to spare; listed are the triangles that reach into one. The list
//! stays good while the tools stay in their boxes and no node has moved further than that room, so that it is made once in many substeps: where
//! tissue is fast, there is more room.

use std::collections::BTreeMap;

use super::super::lanes::Real;
use super::super::nodes::{Bricks, Field};
use super::awake::USUAL_TOOLS;
use crate::math::{Bounds, Vec3};
use crate::model::fans::is_there;
use crate::model::lattice::{BRICK_SLOTS, Lattice};
use crate::model::surface::{ROW, Surface};
use crate::solver::ToolStep;

/// Least room to spare around a tool's way, in cells.
const ROOM: f64 = 1.0;
/// Substeps that the room is good for, at the pace of the last one; and most room, in cells.
const LASTING: f64 = 32.0;
const MOST_ROOM: f64 = 8.0;
/// In [`Near::place_of`]: not looked at, and looked at but part of no listed triangle.
const UNSEEN: u32 = u32::MAX;
const FAR: u32 = u32::MAX - 1;
/// In [`Hung`]: copies of nodes, which stand in bricks that are nobody's neighbours.
const ANYWHERE: u32 = u32::MAX;
/// Of no triangle: there are not so many bricks.
const NOWHERE: Hung = [u32::MAX - 1; 3];
/// On which sides of the boxes a point lies: a byte for each box, in turn; where boxes share one, the sides on which it lies of all of them.
type Sides = [u8; 8];

/// The listed triangles. What a step uses is allocated once.
#[derive(Debug)]
pub struct Near {
    /// By the bricks that corners hang on.
    groups: BTreeMap<Hung, Group>,
    /// Those of each triangle; [`NOWHERE`] where there is none.
    hung: Vec<Hung>,
    triangles: Vec<Listed>,
    /// Their vertices, each once: six triangles share a vertex, and moving one reads eight nodes.
    vertices: Vec<u32>,
    /// The place of each vertex in `vertices`, or [`FAR`], or [`UNSEEN`].
    place_of: Vec<u32>,
    /// Vertices that the making of the list has looked at, and what it saw, for each vertex.
    seen: Vec<u32>,
    sides_of: Vec<Sides>,
    /// Around each tool.
    boxes: Vec<Bounds>,
    /// How far nodes may have moved since the list was made, in m.
    travelled: f64,
    /// How far they may have moved in the last substep, in m.
    pace: f64,
    cell_m: f64,
    /// Σ |w| of each vertex: how much further than its nodes it may move.
    levers: Vec<f32>,
    /// The largest of them.
    lever: f64,
}

/// A listed triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Its number in the surface.
    pub triangle: u32,
    /// The places of its corners in [`Near::vertices`].
    pub places: [u32; 3],
}

/// The bricks that a triangle's corners hang on, ascending. One that hangs on copies of nodes has [`ANYWHERE`] last.
type Hung = [u32; 3];

/// Triangles whose corners hang on the same bricks.
#[derive(Clone, Debug)]
struct Group {
    /// Ascending.
    triangles: Vec<u32>,
    /// Around their corners at rest, and those of triangles that were here before.
    bounds: Bounds,
}

impl Default for Group {
    fn default() -> Self {
        Self { triangles: Vec::new(), bounds: Bounds::EMPTY }
    }
}

impl Near {
    /// An empty list of a surface.
    pub fn new(surface: &Surface, lattice: &Lattice) -> Self {
        let mut near = Self {
            groups: BTreeMap::new(),
            hung: Vec::new(),
            triangles: Vec::new(),
            vertices: Vec::new(),
            place_of: Vec::new(),
            seen: Vec::new(),
            sides_of: Vec::new(),
            boxes: Vec::with_capacity(USUAL_TOOLS),
            travelled: f64::INFINITY,
            pace: 0.0,
            cell_m: lattice.cell_m(),
            levers: Vec::new(),
            lever: 1.0,
        };
        let [triangles, vertices] = [surface.triangles.len(), surface.positions.len()]
            .map(|count| (0..count as u32).collect::<Vec<_>>());
        near.follow(surface, lattice, &triangles, &vertices);
        near
    }

    /// Takes over what has changed of a surface, and forgets the list: `triangles` have other corners, or such as lie elsewhere, and `vertices` hang on other nodes; both ascend.
    pub fn follow(&mut self, surface: &Surface, lattice: &Lattice, triangles: &[u32], vertices: &[u32]) {
        self.forget();
        (self.travelled, self.pace) = (f64::INFINITY, 0.0);
        let (triangle_count, vertex_count) = (surface.triangles.len(), surface.positions.len());
        self.hung.resize(triangle_count, NOWHERE);
        for &t in triangles {
            let corners = &surface.triangles[t as usize];
            let now = if is_there(corners) { bricks_of(surface, lattice, corners) } else { NOWHERE };
            let then = std::mem::replace(&mut self.hung[t as usize], now);
            if then != now
                && let Some(group) = self.groups.get_mut(&then)
            {
                if let Ok(at) = group.triangles.binary_search(&t) {
                    group.triangles.remove(at);
                }
                if group.triangles.is_empty() {
                    self.groups.remove(&then);
                }
            }
            if now == NOWHERE {
                continue;
            }
            let group = self.groups.entry(now).or_default();
            if let Err(at) = group.triangles.binary_search(&t) {
                group.triangles.insert(at, t);
            }
            for p in corners.map(|v| surface.positions[v as usize]) {
                group.bounds.add(p);
            }
        }
        self.levers.resize(vertex_count, 1.0);
        for &v in vertices {
            self.levers[v as usize] = lever(&surface.rows[v as usize].weights);
        }
        self.lever = self.levers.iter().copied().fold(1.0, f32::max).into();
        // Room for all of it, so that a step finds it there.
        self.triangles.reserve(triangle_count);
        self.vertices.reserve(vertex_count);
        self.seen.reserve(vertex_count.saturating_sub(self.seen.len()));
        self.place_of.resize(vertex_count, UNSEEN);
        self.sides_of.resize(vertex_count, Sides::default());
    }

    /// The listed triangles.
    pub fn triangles(&self) -> &[Listed] {
        &self.triangles
    }

    /// The vertices of the listed triangles.
    pub fn vertices(&self) -> &[u32] {
        &self.vertices
    }

    /// The list is no good any more, whoever moves.
    pub fn forget(&mut self) {
        self.triangles.clear();
        self.vertices.clear();
        self.boxes.clear();
    }

    /// How much further than the nodes any point of a listed triangle may move.
    pub fn lever(&self, listed: &Listed) -> f32 {
        let levers = listed.places.map(|place| self.levers[self.vertices[place as usize] as usize]);
        levers.into_iter().fold(1.0, f32::max)
    }

    /// No node has moved further than this since the last call.
    pub fn travel(&mut self, distance: f64) {
        self.pace = distance * self.lever;
        self.travelled += self.pace;
    }

    /// Makes the list anew unless it is still good for all that is within `reach` of the tools' ways in this step. `moved` bounds how far nodes of a brick
    /// are from rest, in m. Returns whether it was made anew.
    pub fn keep_up<R: Real>(
        &mut self,
        surface: &Surface,
        bricks: &Bricks,
        tools: &[ToolStep],
        u: &Field<R>,
        reach: f64,
        moved: impl Fn(usize) -> f64,
    ) -> bool {
        let way = |tool: &ToolStep, spare: f64| {
            let (from, to) = (tool.path.from.translation.vector, tool.path.to.translation.vector);
            Bounds::around(from, to, tool.desc.bounding_radius_m() + spare)
        };
        // Nodes that are nowhere finite have travelled nowhere finite: the comparison fails.
        let is_good = self.boxes.len() == tools.len()
            && self.boxes.iter().zip(tools).all(|(list, tool)| list.holds(&way(tool, reach), self.travelled));
        if is_good {
            return false;
        }
        self.forget();
        self.travelled = 0.0;
        let room = (LASTING * self.pace).clamp(ROOM * self.cell_m, MOST_ROOM * self.cell_m);
        self.boxes.extend(tools.iter().map(|tool| way(tool, reach + room)));

        let Self { groups, triangles, vertices, place_of, seen, sides_of, boxes, lever, .. } = self;
        for vertex in seen.drain(..) {
            place_of[vertex as usize] = UNSEEN;
        }
        let sides = |p: Vec3| {
            boxes.iter().enumerate().fold([!0; size_of::<Sides>()], |mut sides: Sides, (tool, bounds)| {
                sides[tool % size_of::<Sides>()] &= bounds.sides(p);
                sides
            })
        };
        let is_near = |bounds: &Bounds, slack: f64| boxes.iter().any(|tool| tool.meets(bounds, slack));
        // Most groups lie too far away whoever moves.
        let furthest = (0..bricks.count()).map(&moved).fold(0.0, f64::max);
        let near_rest = |(_, group): &(&Hung, &Group)| is_near(&group.bounds, furthest * *lever);
        for (hung, group) in groups.iter().filter(near_rest) {
            if hung[2] != ANYWHERE {
                let around = hung.iter().flat_map(|&brick| bricks.around(brick as usize));
                if !is_near(&group.bounds, around.map(&moved).fold(0.0, f64::max) * *lever) {
                    continue;
                }
            }
            for &triangle in &group.triangles {
                let corners = surface.triangles[triangle as usize];
                for vertex in corners.map(|vertex| vertex as usize) {
                    if place_of[vertex] == UNSEEN {
                        place_of[vertex] = FAR;
                        seen.push(vertex as u32);
                        sides_of[vertex] = sides(position(surface, vertex as u32, u));
                    }
                }
                let shared = corners
                    .iter()
                    .fold(!0, |all, &vertex| all & u64::from_ne_bytes(sides_of[vertex as usize]));
                if has_zero_byte(shared) {
                    let places = corners.map(|vertex| {
                        let place = &mut place_of[vertex as usize];
                        if *place == FAR {
                            *place = vertices.len() as u32;
                            vertices.push(vertex);
                        }
                        *place
                    });
                    triangles.push(Listed { triangle, places });
                }
            }
        }
        true
    }
}

/// The bricks that corners hang on.
fn bricks_of(surface: &Surface, lattice: &Lattice, corners: &[u32; 3]) -> Hung {
    let (brick_of, first_copy) = (|slot: u32| slot / BRICK_SLOTS as u32, lattice.slot_count() as u32);
    let rows = corners.map(|v| &surface.rows[v as usize].nodes);
    let mut own = rows.into_iter().flatten().copied().filter(|&slot| slot < first_copy);
    if own.clone().count() < rows.len() * ROW {
        return [own.next().map_or(ANYWHERE, brick_of), ANYWHERE, ANYWHERE];
    }
    let mut bricks = rows.map(|nodes| brick_of(nodes[0]));
    bricks.sort_unstable();
    bricks
}

/// Whether one of the eight bytes is zero.
fn has_zero_byte(bytes: u64) -> bool {
    const ONES: u64 = u64::from_ne_bytes([1; 8]);
    bytes.wrapping_sub(ONES) & !bytes & ONES << 7 != 0
}

/// Σ |w| of a row, rounded up.
fn lever(weights: &[f32; ROW]) -> f32 {
    let sum: f64 = weights.iter().map(|w| f64::from(w.abs())).sum();
    sum as f32 * (1.0 + f32::EPSILON)
}

/// Where a vertex is, model frame. Displacements are added up as they are stored, and widened once.
#[inline]
pub fn position<R: Real>(surface: &Surface, vertex: u32, u: &Field<R>) -> Vec3 {
    let row = &surface.rows[vertex as usize];
    let mut moved = [R::default(); 3];
    for (&node, &weight) in row.nodes.iter().zip(&row.weights) {
        let (at, weight) = (u.get(node), R::splat(f64::from(weight)));
        moved = [0, 1, 2].map(|axis| moved[axis].add(at[axis].mul(weight)));
    }
    surface.positions[vertex as usize] + Vec3::from(moved.map(R::to_f64))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use super::super::awake::{Awake, Ball};
    use super::*;
    use crate::math::Pose;
    use crate::model::grid::LabelGrid;
    use crate::model::material::Material;
    use crate::model::{Build, LabelUse};
    use crate::solver::tool::{ToolDesc, ToolPath};

    #[test]
    fn every_triangle_in_reach_is_listed_and_awake_while_tool_and_tissue_move() {
        let (h, cells) = (1e-3, [40, 6, 4]);
        let mut build = Build::new(
            LabelGrid::new(cells, Vec3::repeat(h), Pose::identity(), vec![1; cells.iter().product()])
                .unwrap(),
        );
        build.uses = BTreeMap::from([(1, LabelUse::Tissue(Material::new("t", 3e3, 0.25, 1e3).unwrap()))]);
        let model = Arc::new(build.run(&mut |_, _| true).unwrap());
        let surface = &model.surfaces()[model.contact_surface()];
        let mut u = Field::<f32>::zeros(model.lattice().bricks().len());
        let bricks = Bricks::new(model.clone(), 0);
        let mut near = Near::new(surface, model.lattice());
        let mut awake = Awake::new(surface.triangles.len(), surface.positions.len());

        // The block slides under the tool by a tenth of a cell at a time, the tool against it by half as much.
        let (mut fewest, mut kept, mut looked_at, mut all) = (usize::MAX, 0, 0, 0);
        for step in 0..60 {
            let slid = 1e-4 * f64::from(step);
            for slot in model.lattice().slots() {
                u.set(slot, Vec3::new(slid, 0.0, 0.0));
            }
            let at = |step: i32| Pose::translation(0.012 - 5e-5 * f64::from(step), 0.003, 0.005);
            let tool = ToolStep {
                grasped: Arc::new([]),
                held: Arc::new([]),
                desc: Arc::new(ToolDesc::sphere(2e-3)),
                path: ToolPath { from: at(step), to: at(step + 1) },
            };
            let before = near.triangles().to_vec();
            near.travel(1e-4);
            awake.travel(1e-4);
            if near.keep_up(surface, &bricks, std::slice::from_ref(&tool), &u, 0.0, |_| slid) {
                awake.restart();
            }
            kept += usize::from(near.triangles() == before);

            let centre = tool.path.to.translation.vector;
            let bounds = Bounds::around(centre, centre, 2e-3);
            let listed: Vec<u32> = near.triangles().iter().map(|listed| listed.triangle).collect();
            for (triangle, corners) in (0..).zip(&surface.triangles) {
                let sides = corners.map(|vertex| bounds.sides(position(surface, vertex, &u)));
                if sides[0] & sides[1] & sides[2] == 0 {
                    assert!(listed.contains(&triangle), "step {step}, triangle {triangle}");
                }
            }

            awake.sort_out(&near, std::iter::once(Ball { centre, radius: 2e-3 }), false, |vertex| {
                looked_at += 1;
                let at = position(surface, vertex, &u);
                (at, at)
            });
            let awake: Vec<u32> = awake.triangles().iter().map(|listed| listed.triangle).collect();
            for (triangle, corners) in (0..).zip(&surface.triangles) {
                let corners = corners.map(|vertex| position(surface, vertex, &u));
                let middle = corners.iter().sum::<Vec3>() / 3.0;
                if corners.into_iter().chain([middle]).any(|p| (p - centre).norm() < 2e-3) {
                    assert!(awake.contains(&triangle), "step {step}, triangle {triangle} sleeps");
                }
            }
            all += near.vertices().len();
            fewest = fewest.min(listed.len());
        }
        assert!(fewest < surface.triangles.len() / 2 && kept > 30, "{fewest} listed, {kept} times kept");
        assert!(looked_at < all / 2, "{looked_at} looks at {all} listed vertices");
    }

    #[test]
    fn a_zero_byte_is_found_wherever_it_is() {
        assert!(!has_zero_byte(u64::MAX) && !has_zero_byte(u64::from_ne_bytes([1; 8])));
        for at in 0..8 {
            for other in [1, 0x3f, 0x80, 0xff] {
                let mut bytes = [other; 8];
                bytes[at] = 0;
                assert!(has_zero_byte(u64::from_ne_bytes(bytes)));
            }
        }
    }

    #[test]
    fn a_segment_that_crosses_a_box_shares_no_side_of_it() {
        let bounds = Bounds::around(Vec3::zeros(), Vec3::x(), 0.5);
        let sides = |p: [f64; 3], q: [f64; 3]| bounds.sides(p.into()) & bounds.sides(q.into());
        assert_eq!(sides([-2.0, 0.0, 0.0], [3.0, 0.1, 0.0]), 0);
        assert_eq!(sides([0.5, -1.0, 0.2], [0.5, 1.0, 0.3]), 0);
        assert_ne!(sides([-2.0, 0.0, 0.0], [-1.0, 9.0, 9.0]), 0);
        assert_ne!(sides([0.0, 0.0, 0.6], [1.0, 0.0, 9.0]), 0);
    }
}
