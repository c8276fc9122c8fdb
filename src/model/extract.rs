//! Surface extraction: the smoothed boundary of a set of cells, as closed triangle meshes.
//!
//! The method is dual. Every cell face between inside and outside becomes a quadrilateral, whose corners are
//! vertices near the four grid nodes of the face. Around one node the boundary faces form closed fans; each
//! fan has a vertex of its own, so that tissue that touches itself only at a corner or along an edge does not
//! share vertices.
//!
//! A vertex starts at the mean of the face centres of its fan. Then the surface is faired: its bending, not
//! its area, is made small, because that hardly shrinks what is round. All the while a vertex stays in a box
//! of at most ±0.45 cells around its node: the surface keeps within half a cell of the voxel boundary, and
//! vertices of different nodes cannot meet.

use super::mesh::TriangleMesh;
use super::surface::mirrored_cylinder;
use crate::error::{Error, Result};
use crate::math::Vec3;

mod fair;
mod fans;

use fair::{Neighbours, Room, fair, into_room};
use fans::{Fan, Fans, HalfEdge, face_at, fan_centre};

/// How far a vertex may move from its grid node along each axis, in cells.
const REACH: f64 = 0.45;
/// The same where the set, or the gap between two of its parts, is one or two cells thick. Fairing would wear
/// it away: this leaves half a cell of one, and 1.5 cells of two.
const THIN_REACH: f64 = 0.25;
/// Most cell faces in a surface: the six triangle corners of each are counted in 32 bits.
const MAX_QUADS: usize = (u32::MAX / 6) as usize;
/// Not a node of the surface.
const NO_VERTEX: u32 = u32::MAX;

/// The closed surface around all cells for which `inside(cell)` holds, counter-clockwise seen from outside.
///
/// Cell `(i, j, k)` fills `[i, i+1] × [j, j+1] × [k, k+1]` times `cell_m`, and positions are metres in that
/// frame (the model frame, when the cells are a lattice's). Cells beyond the grid count as outside, so the
/// surface is closed at the border too. Texture coordinates are those of [`mirrored_cylinder`]. Fails when no
/// cell is inside.
pub fn boundary(cells: [usize; 3], cell_m: f64, inside: impl Fn([usize; 3]) -> bool) -> Result<TriangleMesh> {
    let nodes = Nodes::new(cells, inside)?;

    let (first_vertex, mut positions, rooms) = place_vertices(&nodes)?;
    if positions.is_empty() {
        return Err(Error::argument("no cell carries any of the labels that a surface was asked for"));
    }
    let quads = collect_quads(&nodes, &first_vertex);
    drop(first_vertex);
    if quads.len() > MAX_QUADS {
        return Err(Error::Limit(format!("a surface of {} faces is too large", quads.len())));
    }

    let neighbours = Neighbours::new(positions.len(), &quads);
    fair(&mut positions, &rooms, &neighbours);
    let triangles = split_quads(&positions, &quads);
    for position in &mut positions {
        *position *= cell_m;
    }
    let uvs = mirrored_cylinder(&positions);
    Ok(TriangleMesh { positions, triangles, uvs })
}

/// Empty cells around the grid: a node on its border looks three cells far.
const PAD: usize = 3;

/// Which cells are inside, seen from the grid nodes.
struct Nodes {
    /// Nodes along x, y, z: one more than cells.
    dims: [usize; 3],
    /// Cells with a border of [`PAD`] outside cells, x fastest.
    padded: Vec<bool>,
    /// Index distance of neighbours along each axis in `padded`.
    strides: [usize; 3],
    fans: Fans,
}

impl Nodes {
    fn new(cells: [usize; 3], inside: impl Fn([usize; 3]) -> bool) -> Result<Self> {
        super::grid::voxel_count(cells)?;
        let padded_dims = cells.map(|n| n + 2 * PAD);
        let strides = [1, padded_dims[0], padded_dims[0] * padded_dims[1]];

        let mut padded = vec![false; padded_dims.iter().product()];
        for k in 0..cells[2] {
            for j in 0..cells[1] {
                let row = (j + PAD) * strides[1] + (k + PAD) * strides[2] + PAD;
                for i in 0..cells[0] {
                    padded[row + i] = inside([i, j, k]);
                }
            }
        }
        Ok(Self { dims: cells.map(|n| n + 1), padded, strides, fans: Fans::new() })
    }

    /// The index of a node among all nodes, x fastest.
    fn index(&self, node: [usize; 3]) -> usize {
        node[0] + self.dims[0] * (node[1] + self.dims[1] * node[2])
    }

    /// Bit c tells whether the cell in octant c around the node is inside; bit a of c chooses the side along
    /// axis a.
    fn octants(&self, node: [usize; 3]) -> u8 {
        let [sx, sy, sz] = self.strides;
        let lowest = self.lowest_octant(node);
        let mut bits = 0;
        for (octant, offset) in
            [0, sx, sy, sx + sy, sz, sx + sz, sy + sz, sx + sy + sz].into_iter().enumerate()
        {
            bits |= u8::from(self.padded[lowest + offset]) << octant;
        }
        bits
    }

    /// The index in `padded` of octant 0 around a node.
    fn lowest_octant(&self, node: [usize; 3]) -> usize {
        (0..3).map(|a| (node[a] + PAD - 1) * self.strides[a]).sum()
    }

    /// The lowest and highest place that a node's vertices may take, from the node, in cells.
    fn room(&self, node: [usize; 3]) -> [Vec3; 2] {
        let lowest = self.lowest_octant(node);
        let mut room = [Vec3::repeat(-REACH), Vec3::repeat(REACH)];
        for axis in 0..3 {
            let along = self.strides[axis];
            let (b, c) = (self.strides[(axis + 1) % 3], self.strides[(axis + 2) % 3]);
            for column in [lowest, lowest + b, lowest + c, lowest + b + c] {
                // Three cells on each side of the node.
                let run: [bool; 6] = std::array::from_fn(|n| self.padded[column + n * along - 2 * along]);
                let is_boundary = run[2] != run[3];
                let is_thin = run[0] != run[2] || run[1] != run[2] || run[4] != run[3] || run[5] != run[3];
                if is_boundary && is_thin {
                    (room[0][axis], room[1][axis]) = (-THIN_REACH, THIN_REACH);
                }
            }
        }
        room
    }

    /// The fans around a node with these octants.
    fn fan_of(&self, node: [usize; 3], octants: u8) -> &Fan {
        let Some(edge) = self.fans.pinched[octants as usize] else {
            return &self.fans.plain[octants as usize];
        };

        // The node at the other end shares the four cells of the edge, so it exists. When its fan is pinched
        // by the same edge, four triangles would share it; both ends then join the faces the other way.
        let mut other = node;
        other[edge.axis] = if edge.upper { node[edge.axis] + 1 } else { node[edge.axis] - 1 };
        let opposite = HalfEdge { axis: edge.axis, upper: !edge.upper };
        if self.fans.pinched[self.octants(other) as usize] == Some(opposite) {
            &self.fans.rejoined[octants as usize]
        } else {
            &self.fans.plain[octants as usize]
        }
    }

    /// All nodes, x fastest.
    fn iter(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [nx, ny, nz] = self.dims;
        (0..nz).flat_map(move |k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])))
    }
}

/// Vertices at their first place: the index of each node's first vertex, positions and rooms.
fn place_vertices(nodes: &Nodes) -> Result<(Vec<u32>, Vec<Vec3>, Vec<Room>)> {
    let mut first_vertex = vec![NO_VERTEX; nodes.dims.iter().product()];
    let (mut positions, mut rooms) = (Vec::new(), Vec::new());

    for node in nodes.iter() {
        let octants = nodes.octants(node);
        if octants == 0 || octants == 0xff {
            continue;
        }
        first_vertex[nodes.index(node)] = u32::try_from(positions.len())
            .ok()
            .filter(|&v| v < NO_VERTEX - 4)
            .ok_or_else(|| Error::Limit("a surface of more than 2³² vertices".into()))?;

        let home = Vec3::new(node[0] as f64, node[1] as f64, node[2] as f64);
        let fan = nodes.fan_of(node, octants);
        let room = nodes.room(node).map(|corner| home + corner);
        for id in 0..fan.count {
            positions.push(into_room(&(home + fan_centre(fan, id)), &room));
            rooms.push(room);
        }
    }
    Ok((first_vertex, positions, rooms))
}

/// One quadrilateral for each cell face between inside and outside, counter-clockwise seen from outside.
fn collect_quads(nodes: &Nodes, first_vertex: &[u32]) -> Vec<[u32; 4]> {
    let mut quads = Vec::new();
    for node in nodes.iter() {
        let octants = nodes.octants(node);
        let upper_inside = octants >> 7 & 1 == 1;
        for axis in 0..3 {
            let lower_inside = octants >> (7 - (1 << axis)) & 1 == 1;
            if lower_inside == upper_inside {
                continue;
            }

            // In this order the corners run counter-clockwise around the axis.
            let mut quad = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(db, dc)| {
                let mut corner = node;
                corner[(axis + 1) % 3] += db;
                corner[(axis + 2) % 3] += dc;
                let fan = nodes.fan_of(corner, nodes.octants(corner));
                first_vertex[nodes.index(corner)] + u32::from(fan.of_face[face_at(axis, 1 - db, 1 - dc)])
            });
            if upper_inside {
                quad.reverse();
            }
            quads.push(quad);
        }
    }
    quads
}

/// Two triangles for each quadrilateral, along its shorter diagonal.
fn split_quads(positions: &[Vec3], quads: &[[u32; 4]]) -> Vec<[u32; 3]> {
    let mut triangles = Vec::with_capacity(2 * quads.len());
    for &[a, b, c, d] in quads {
        let length = |one: u32, two: u32| (positions[one as usize] - positions[two as usize]).norm_squared();
        if length(a, c) <= length(b, d) {
            triangles.extend([[a, b, c], [a, c, d]]);
        } else {
            triangles.extend([[b, c, d], [b, d, a]]);
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    const H: f64 = 0.002;

    fn extract(cells: [usize; 3], inside: impl Fn([usize; 3]) -> bool) -> TriangleMesh {
        let mesh = boundary(cells, H, inside).unwrap();
        mesh.check().unwrap();
        mesh
    }

    fn ball(cells: usize, radius: f64) -> impl Fn([usize; 3]) -> bool {
        let centre = Vec3::repeat(cells as f64 / 2.0);
        move |cell| (Vec3::from(cell.map(|x| x as f64 + 0.5)) - centre).norm() <= radius
    }

    fn corners(mesh: &TriangleMesh, t: usize) -> [Vec3; 3] {
        mesh.triangles[t].map(|v| mesh.positions[v as usize])
    }

    fn area(mesh: &TriangleMesh) -> f64 {
        let area_of = |[a, b, c]: [Vec3; 3]| (b - a).cross(&(c - a)).norm() / 2.0;
        (0..mesh.triangles.len()).map(|t| area_of(corners(mesh, t))).sum()
    }

    /// By the divergence theorem: positive when triangles face outwards.
    fn volume(mesh: &TriangleMesh) -> f64 {
        let cone = |[a, b, c]: [Vec3; 3]| a.dot(&b.cross(&c)) / 6.0;
        (0..mesh.triangles.len()).map(|t| cone(corners(mesh, t))).sum()
    }

    /// How often each directed edge is used.
    fn edge_uses(mesh: &TriangleMesh) -> BTreeMap<(u32, u32), usize> {
        let mut uses = BTreeMap::new();
        for &[a, b, c] in &mesh.triangles {
            for edge in [(a, b), (b, c), (c, a)] {
                *uses.entry(edge).or_insert(0) += 1;
            }
        }
        uses
    }

    /// Every edge has one triangle on each side, and they agree about which side is out.
    fn assert_closed_manifold(mesh: &TriangleMesh) {
        let uses = edge_uses(mesh);
        for (&(a, b), &count) in &uses {
            assert_eq!(count, 1, "edge {a}-{b} is used {count} times in one direction");
            assert!(uses.contains_key(&(b, a)), "edge {a}-{b} has one side only");
        }
    }

    /// Vertices − edges + triangles: 2 for each closed surface without handles.
    fn euler(mesh: &TriangleMesh) -> i64 {
        mesh.positions.len() as i64 - edge_uses(mesh).len() as i64 / 2 + mesh.triangles.len() as i64
    }

    #[test]
    fn a_ball_has_the_area_and_volume_of_a_sphere() {
        let radius = 14.0;
        let mesh = extract([32; 3], ball(32, radius));
        assert_closed_manifold(&mesh);
        assert_eq!(euler(&mesh), 2);

        let sphere = 4.0 * std::f64::consts::PI * (radius * H).powi(2);
        let area_error = area(&mesh) / sphere - 1.0;
        assert!(area_error.abs() < 0.02, "area is off by {area_error:.4}");

        let inside = ball(32, radius);
        let count = (0..32_usize.pow(3)).filter(|n| inside([n % 32, n / 32 % 32, n / 1024])).count();
        let volume_error = volume(&mesh) / (count as f64 * H.powi(3)) - 1.0;
        assert!(volume_error.abs() < 0.01, "volume is off by {volume_error:.4}");
    }

    #[test]
    fn a_balls_triangles_face_along_the_radius() {
        let mesh = extract([32; 3], ball(32, 14.0));
        let centre = Vec3::repeat(16.0 * H);
        // The voxel faces themselves are up to 55 degrees off (cos 0.577).
        for t in 0..mesh.triangles.len() {
            let [a, b, c] = corners(&mesh, t);
            let cosine = (b - a).cross(&(c - a)).normalize().dot(&((a + b + c) / 3.0 - centre).normalize());
            assert!(cosine > 0.97, "triangle {t} is {:.1} degrees off", cosine.acos().to_degrees());
        }
    }

    #[test]
    fn vertices_stay_within_half_a_cell_of_the_voxel_boundary() {
        let mesh = extract([32; 3], ball(32, 14.0));
        for p in &mesh.positions {
            // A vertex belongs to the nearest node, which lies on the voxel boundary.
            let node = (p / H).map(f64::round);
            assert!((p / H - node).amax() <= REACH + 1e-9);
            let around = |inside: bool| {
                (0..8).any(|c| {
                    let cell = [0, 1, 2].map(|a| node[a] as usize - (c >> a & 1));
                    ball(32, 14.0)(cell) == inside
                })
            };
            assert!(around(true) && around(false));
        }
    }

    #[test]
    fn one_cell_gives_a_small_closed_surface_inside_it() {
        let mesh = extract([1; 3], |_| true);
        assert_closed_manifold(&mesh);
        assert_eq!((mesh.positions.len(), mesh.triangles.len(), euler(&mesh)), (8, 12, 2));
        let share = volume(&mesh) / H.powi(3);
        // Vertices stay 1 − 2 THIN_REACH cells apart, and none leaves the cell by symmetry.
        assert!((0.124..=1.0).contains(&share), "the surface fills {share} of the cell");
    }

    #[test]
    fn cells_that_touch_at_a_corner_or_an_edge_have_separate_surfaces() {
        for other in [[1, 1, 1], [1, 1, 0]] {
            let mesh = extract([2; 3], |cell| cell == [0; 3] || cell == other);
            assert_closed_manifold(&mesh);
            assert_eq!((mesh.positions.len(), euler(&mesh)), (16, 4), "cells 000 and {other:?}");
        }
    }

    #[test]
    fn empty_cells_that_touch_at_a_corner_stay_separate_holes() {
        let mesh = extract([4; 3], |cell| cell != [1, 1, 1] && cell != [2, 2, 2]);
        assert_closed_manifold(&mesh);
        assert_eq!(euler(&mesh), 6, "an outer surface and two cavities");
    }

    #[test]
    fn a_sheet_of_one_cell_keeps_its_thickness_within_half_a_cell() {
        let mesh = extract([20, 20, 3], |cell| cell[2] == 1);
        assert_closed_manifold(&mesh);
        assert_eq!(euler(&mesh), 2);
        let from_middle = |p: &Vec3| (p.z / H - 1.5).abs();
        assert!(mesh.positions.iter().all(|p| (from_middle(p) - 0.5).abs() <= THIN_REACH + 1e-9));
        let share = volume(&mesh) / (400.0 * H.powi(3));
        assert!((0.8..1.25).contains(&share), "the sheet has {share} of its volume");
    }

    #[test]
    fn a_rod_of_two_cells_keeps_most_of_its_section() {
        let mesh = extract([30, 4, 4], |[_, j, k]| (1..3).contains(&j) && (1..3).contains(&k));
        assert_closed_manifold(&mesh);
        // 1.5 cells of 2 remain in each direction; rounding the ends costs a little of the length.
        let share = volume(&mesh) / (30.0 * 4.0 * H.powi(3));
        assert!((0.5..=1.0).contains(&share), "the rod has {share} of its volume");
    }

    #[test]
    fn terraces_of_a_gentle_slope_are_levelled() {
        // A plane that rises one cell in ten. Its voxel boundary steps by half a cell to each side of it.
        let height = |x: f64| 6.0 + 0.1 * x;
        let mesh = extract([80, 30, 20], |[i, _, k]| k as f64 + 0.5 < height(i as f64 + 0.5));
        let off: Vec<f64> = mesh
            .positions
            .iter()
            .map(|p| p / H)
            .filter(|p| (15.0..65.0).contains(&p.x) && (8.0..22.0).contains(&p.y) && p.z > 5.0)
            .map(|p| p.z - height(p.x))
            .collect();
        assert!(off.len() > 600);
        let (low, high) = off.iter().fold((1.0_f64, -1.0_f64), |(low, high), &d| (low.min(d), high.max(d)));
        assert!(high - low < 0.25, "the slope is rough by {:.3} cells", high - low);
    }

    #[test]
    fn cells_at_the_border_of_the_grid_are_closed_off() {
        let mesh = extract([10, 11, 12], |_| true);
        assert_closed_manifold(&mesh);
        assert_eq!(euler(&mesh), 2);
        let share = volume(&mesh) / (10.0 * 11.0 * 12.0 * H.powi(3));
        assert!((0.9..=1.1).contains(&share), "rounding the edges of a block leaves {share} of it");
    }

    #[test]
    fn no_cells_are_refused() {
        assert!(matches!(boundary([3; 3], H, |_| false), Err(Error::Argument(_))));
        assert!(boundary([0, 3, 3], H, |_| true).is_err());
    }

    #[test]
    fn any_set_of_cells_has_a_closed_manifold_surface() {
        // Noise at three densities holds every pattern of ambiguous edges.
        for (seed, share) in [(1_u64, 64), (2, 128), (3, 190)] {
            let noise = |cell: [usize; 3]| {
                let n = (cell[0] + 24 * (cell[1] + 24 * cell[2])) as u64 + 1;
                let hash = (n ^ seed << 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                (hash ^ hash >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 56 < share
            };
            assert_closed_manifold(&extract([24; 3], noise));
        }
    }

    #[test]
    fn the_same_cells_give_the_same_bits() {
        let bits = || {
            let mesh = extract([16; 3], ball(16, 6.3));
            let positions: Vec<_> =
                mesh.positions.iter().map(|p| [p.x, p.y, p.z].map(f64::to_bits)).collect();
            (positions, mesh.triangles)
        };
        assert_eq!(bits(), bits());
    }
}
