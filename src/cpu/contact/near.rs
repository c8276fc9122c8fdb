//! Which triangles of the contact surface tools may meet.
//!
//! Around each tool's way in a step lies a box with some room to spare; listed are the triangles that reach into one. The list
//! stays good while the tools stay in their boxes and no node has moved further than that room, so that it is made once in many substeps: where
//! tissue is fast, there is more room.

use super::super::lanes::Real;
use super::super::nodes::{Bricks, Field};
use super::awake::USUAL_TOOLS;
use crate::math::Vec3;
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
/// In [`Group::bricks`]: copies of nodes, which stand in bricks that are nobody's neighbours.
const ANYWHERE: u32 = u32::MAX;
/// On which sides of the boxes a point lies: a byte for each box, in turn; where boxes share one, the sides on which it lies of all of them.
type Sides = [u8; 8];

/// The listed triangles. Everything is allocated once.
#[derive(Debug)]
pub struct Near {
    groups: Vec<Group>,
    /// Triangles in the order of their groups.
    grouped: Vec<u32>,
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

/// Triangles whose corners hang on the same bricks.
#[derive(Clone, Copy, Debug)]
struct Group {
    /// Ascending; a triangle may reach over several. One that hangs on copies of nodes has [`ANYWHERE`] last.
    bricks: [u32; 3],
    start: u32,
    end: u32,
    bounds: Bounds,
}

/// A box along the axes.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    low: Vec3,
    high: Vec3,
}

impl Bounds {
    /// Around two points, this far beyond them.
    pub fn around(p: Vec3, q: Vec3, reach: f64) -> Self {
        let reach = Vec3::repeat(reach);
        Self { low: p.inf(&q) - reach, high: p.sup(&q) + reach }
    }

    /// Beyond which of its six sides a point lies, a bit for each. Points that share a side lie apart from the box, and so
    /// does all that is between them.
    pub fn sides(&self, p: Vec3) -> u8 {
        (0..3).fold(0, |sides, a| {
            sides | u8::from(p[a] < self.low[a]) << (2 * a) | u8::from(p[a] > self.high[a]) << (2 * a + 1)
        })
    }

    fn meets(&self, other: &Self, slack: f64) -> bool {
        (0..3).all(|a| self.low[a] - slack <= other.high[a] && other.low[a] - slack <= self.high[a])
    }

    fn holds(&self, other: &Self, spare: f64) -> bool {
        (0..3).all(|a| self.low[a] + spare <= other.low[a] && other.high[a] + spare <= self.high[a])
    }
}

impl Near {
    /// An empty list of a surface.
    pub fn new(surface: &Surface, lattice: &Lattice) -> Self {
        let h = lattice.cell_m();
        let (brick_of, first_copy) = (|slot: u32| slot / BRICK_SLOTS as u32, lattice.slot_count() as u32);
        let bricks_of = |t: &[u32; 3]| {
            let rows = t.map(|v| &surface.rows[v as usize].nodes);
            let mut own = rows.into_iter().flatten().copied().filter(|&slot| slot < first_copy);
            if own.clone().count() < rows.len() * ROW {
                return [own.next().map_or(ANYWHERE, brick_of), ANYWHERE, ANYWHERE];
            }
            let mut bricks = rows.map(|nodes| brick_of(nodes[0]));
            bricks.sort_unstable();
            bricks
        };
        let mut grouped: Vec<u32> = (0..surface.triangles.len() as u32).collect();
        grouped.sort_by_key(|&t| (bricks_of(&surface.triangles[t as usize]), t));

        let mut groups: Vec<Group> = Vec::new();
        for (at, &t) in grouped.iter().enumerate() {
            let corners = surface.triangles[t as usize];
            let bricks = bricks_of(&corners);
            if groups.last().is_none_or(|group| group.bricks != bricks) {
                let (low, high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
                groups.push(Group { bricks, start: at as u32, end: at as u32, bounds: Bounds { low, high } });
            }
            let group = groups.last_mut().expect("a group was just pushed if there was none");
            group.end = at as u32 + 1;
            for p in corners.map(|v| surface.positions[v as usize]) {
                group.bounds.low = group.bounds.low.inf(&p);
                group.bounds.high = group.bounds.high.sup(&p);
            }
        }
        let vertices = surface.positions.len();
        let levers: Vec<f32> = surface.rows.iter().map(|row| lever(&row.weights)).collect();
        Self {
            triangles: Vec::with_capacity(grouped.len()),
            vertices: Vec::with_capacity(vertices),
            place_of: vec![UNSEEN; vertices],
            seen: Vec::with_capacity(vertices),
            sides_of: vec![Sides::default(); vertices],
            boxes: Vec::with_capacity(USUAL_TOOLS),
            travelled: f64::INFINITY,
            pace: 0.0,
            cell_m: h,
            lever: levers.iter().copied().map(f64::from).fold(1.0, f64::max),
            levers,
            groups,
            grouped,
        }
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

        let Self { groups, grouped, triangles, vertices, place_of, seen, sides_of, boxes, lever, .. } = self;
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
        for group in groups.iter().filter(|group| is_near(&group.bounds, furthest * *lever)) {
            if group.bricks[2] != ANYWHERE {
                let around = group.bricks.iter().flat_map(|&brick| bricks.around(brick as usize));
                if !is_near(&group.bounds, around.map(&moved).fold(0.0, f64::max) * *lever) {
                    continue;
                }
            }
            for &triangle in &grouped[group.start as usize..group.end as usize] {
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
