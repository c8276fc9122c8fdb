use std::collections::{BTreeMap, HashSet};

use super::drawn::{Drawing, Drawn, Redrawn};
use super::*;
use crate::cut::sweep::share;
use crate::cut::topology::LatticeEdge;
use crate::model::extract;
use crate::model::fans::{Fans, is_there};
use crate::model::mesh::TriangleMesh;
use crate::noise::Noise;

mod random;

const H: f64 = 2e-3;
/// Vertices and triangles: more than any of these surfaces gets.
const ROOM: [usize; 2] = [1 << 16; 2];

/// Tissue: a lattice, its surface and what cuts have made of them.
struct Tissue {
    lattice: Lattice,
    surface: Surface,
    topology: Topology,
    beyond: HashMap<GridEdge, f64>,
    /// Its surface, which followed each cut, and what the last one changed.
    followed: CutSurface,
    last: Result<SurfaceChange>,
    /// How that is drawn, but for what hangs on `vacant` nodes, and a copy of it, which followed too.
    drawn: (Drawn, Surface),
    copy: Surface,
    vacant: HashSet<u32>,
    /// How often all was drawn anew.
    anew: usize,
}

impl Tissue {
    fn new(cells: [usize; 3], is_tissue: impl Fn([usize; 3]) -> bool, mesh: Option<TriangleMesh>) -> Self {
        let at = |n: usize| [n % cells[0], n / cells[0] % cells[1], n / cells[0] / cells[1]];
        let materials: Vec<u8> = (0..cells.iter().product()).map(|n| u8::from(is_tissue(at(n)))).collect();
        let lattice = Lattice::new(cells, H, &materials).unwrap();
        let mesh = mesh.unwrap_or_else(|| extract::boundary(cells, H, is_tissue).unwrap());
        let surface = Surface::from_mesh(mesh, &lattice).unwrap();
        let topology = Topology::new(lattice.slot_count() as u32, 1_000_000);
        let beyond = HashMap::new();
        let followed = CutSurface::new(&surface, &lattice, &topology, &beyond).unwrap();
        let vacant = HashSet::new();
        let drawn = (Drawn::uncut(&surface, ROOM), surface.clone());
        let last = Ok(SurfaceChange::default());
        let copy = drawn.1.clone();
        Self { lattice, surface, topology, beyond, followed, last, drawn, copy, vacant, anew: 0 }
    }

    /// Has what is drawn follow the last change.
    fn draw(&mut self) {
        let Ok(changed) = &self.last else { return };
        let (drawing, own) = (drawing(&self.vacant), self.surface.positions.len());
        let (drawn, surface) = &mut self.drawn;
        let redrawn = drawn.follow(&self.followed, changed, drawing, surface).unwrap();
        let redrawn = redrawn.unwrap_or_else(|| {
            self.anew += 1;
            self.drawn = Drawn::new(&self.followed, own, drawing).unwrap();
            Redrawn::all()
        });
        redrawn.copy(&self.drawn.1, &mut self.copy);
    }

    /// What is drawn is what would be drawn anew, whatever its numbers, and so is the copy.
    fn check_drawn(&self) {
        let (_, anew) =
            Drawn::new(&self.followed, self.surface.positions.len(), drawing(&self.vacant)).unwrap();
        let lists = |surface: &Surface| {
            let (outer, walls) = surface.triangles.split_at(surface.first_wall);
            let corners = |list| {
                shape(corner(&surface.positions, &surface.uvs, &surface.materials, &surface.rows), list)
            };
            [corners(outer), corners(walls)]
        };
        let now = &self.drawn.1;
        assert!(lists(now) == lists(&anew));
        assert!(lists(&self.copy) == lists(now) && self.copy.triangles == now.triangles);
        let fans = Fans::new(now.positions.len(), &now.triangles).unwrap();
        for v in 0..now.positions.len() {
            assert!(fans.at(v) == now.fans.at(v) && fans.at(v) == self.copy.fans.at(v));
        }
        let lips = now.triangles[..now.first_wall].iter().filter(|t| is_there(t)).flatten();
        let lips: HashSet<_> = lips.collect();
        assert!(
            !now.triangles[now.first_wall..]
                .iter()
                .filter(|t| is_there(t))
                .flatten()
                .any(|v| lips.contains(v))
        );
    }

    /// Cuts all that a triangle crosses, given in cells; beside the tissue only where that is wanted.
    fn cut(&mut self, triangle: [Vec3; 3], is_beyond: bool) {
        let (mut edges, mut beyond) = (Vec::new(), Vec::new());
        let cells = self.lattice.cells().map(|n| n as i32);
        for k in -4..cells[2] + 4 {
            for j in -4..cells[1] + 4 {
                for i in -4..cells[0] + 4 {
                    for axis in 0..3 {
                        let low = Vec3::new(f64::from(i), f64::from(j), f64::from(k));
                        let Some(at) = share(low, low + Vec3::ith(axis, 1.0), triangle) else { continue };
                        if grid::is_tissue(&self.lattice, ([i, j, k], axis)) {
                            let slot = self.lattice.slot([i, j, k].map(|x| x as usize)).unwrap();
                            edges.push((LatticeEdge { slot, axis: axis as u8 }, at));
                        } else if is_beyond {
                            self.beyond.entry(([i, j, k], axis)).or_insert(at);
                            beyond.push((([i, j, k], axis), at));
                        }
                    }
                }
            }
        }
        let change = self.topology.cut(&self.lattice, &edges).unwrap();
        let before = self.followed.clone();
        self.last = self.followed.update(&self.surface, &self.lattice, &self.topology, &change, beyond);
        if let Ok(changed) = &self.last {
            check_changed(&before, &self.followed, changed);
            // Only a tie of the points themselves, or what went before, lets all be made anew.
            let is_anew = changed.vertices.len() == self.followed.positions.len();
            assert!(!is_anew || before.state.is_behind || self.followed.state.seed != before.state.seed);
        }
        self.draw();
    }

    /// The cut surface, made anew and as it followed the cuts: both are the same.
    fn surface(&self) -> CutSurface {
        let cut = CutSurface::new(&self.surface, &self.lattice, &self.topology, &self.beyond).unwrap();
        self.check(&cut);
        assert!(self.last.is_ok());
        self.check(&self.followed);
        let [anew, followed] = [&cut, &self.followed].map(|cut| {
            [&cut.triangles, &cut.walls]
                .map(|list| shape(corner(&cut.positions, &cut.uvs, &cut.materials, &cut.rows), list))
        });
        assert_eq!(anew[0].len(), followed[0].len());
        assert_eq!(anew[1].len(), followed[1].len());
        assert!(anew == followed);
        self.check_drawn();
        cut
    }

    /// Which whole each node and each copy is a part of.
    fn wholes(&self) -> HashMap<u32, u32> {
        let mut above: HashMap<u32, u32> = HashMap::new();
        fn root(above: &HashMap<u32, u32>, mut n: u32) -> u32 {
            while above[&n] != n {
                n = above[&n];
            }
            n
        }
        for (cell, _) in self.lattice.occupied() {
            let corners = self.lattice.corners(cell);
            let hung = self.topology.cell(corners[0]);
            let all = hung.map_or(vec![corners], |cell| cell.pieces.iter().map(|hung| hung.nodes).collect());
            for nodes in all {
                for node in nodes {
                    above.entry(node).or_insert(node);
                    let (a, b) = (root(&above, nodes[0]), root(&above, node));
                    above.insert(a.max(b), a.min(b));
                }
            }
        }
        above.keys().map(|&node| (node, root(&above, node))).collect()
    }

    /// What holds after any cuts.
    fn check(&self, cut: &CutSurface) {
        let count = cut.positions.len();
        assert!([cut.uvs.len(), cut.wall_uvs.len(), cut.materials.len(), cut.rows.len()] == [count; 4]);
        let mut used = HashSet::new();
        for &[a, b, c] in all(cut) {
            for edge in [[a, b], [b, c], [c, a]] {
                assert!(used.insert(edge), "an edge is used twice");
            }
        }
        assert!(used.iter().all(|&[a, b]| used.contains(&[b, a])), "an edge has no opposite");
        let before = volume(&self.surface.positions, &self.surface.triangles);
        let after: f64 = parts(cut).iter().map(|part| volume(&cut.positions, part)).sum();
        assert!((after - before).abs() < 1e-9 * before, "{after} {before}");

        for (row, at) in cut.rows.iter().zip(&cut.positions) {
            let node = |n: usize| self.lattice.rest_position(self.topology.origin(row.nodes[n]));
            let weights = row.weights.map(f64::from);
            // How far from its place the weights put it, which are in single precision, and large where a vertex lies far outside of the tissue.
            let off: Vec3 = (0..8).map(|n| (node(n) - at) * weights[n]).sum();
            let most = 1e-6 * weights.iter().map(|w| w.abs()).sum::<f64>();
            assert!(off.norm() < most * H, "{off} at {at}");
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < most);
        }
        let wholes = self.wholes();
        for part in parts(cut) {
            let of = |v: u32| cut.rows[v as usize].nodes.map(|node| wholes[&node]);
            let whole = of(part[0][0])[0];
            assert!(part.iter().flatten().all(|&v| of(v) == [whole; 8]), "a part hangs on two wholes");
        }
    }
}

/// How all of a surface is drawn, but for what hangs on `vacant` nodes.
fn drawing(vacant: &HashSet<u32>) -> Drawing<'_> {
    Drawing { cell_m: H, vacant, room: ROOM }
}

/// What a vertex is, whatever its number.
fn corner<'a>(
    positions: &'a [Vec3],
    uvs: &'a [[f32; 2]],
    materials: &'a [u8],
    rows: &'a [Row],
) -> impl Fn(u32) -> Vec<u64> + 'a {
    |v| {
        let v = v as usize;
        let (row, uv) = (&rows[v], uvs[v].map(|x| u64::from(x.to_bits())));
        let places = positions[v].iter().map(|x| x.to_bits()).chain(uv).chain([u64::from(materials[v])]);
        let nodes = row.nodes.map(u64::from).into_iter().chain(row.weights.map(|w| u64::from(w.to_bits())));
        places.chain(nodes).collect()
    }
}

/// What each triangle of a list is, whatever its number: all of its corners, from the lowest.
fn shape(corner: impl Fn(u32) -> Vec<u64>, list: &[[u32; 3]]) -> Vec<[Vec<u64>; 3]> {
    let mut all: Vec<[Vec<u64>; 3]> = there(list)
        .map(|t| {
            let mut corners = t.map(&corner);
            let lowest = (0..3).min_by_key(|&i| &corners[i]).unwrap();
            corners.rotate_left(lowest);
            corners
        })
        .collect();
    all.sort_unstable();
    all
}

/// Checks that what a change does not name is what it was.
fn check_changed(before: &CutSurface, after: &CutSurface, changed: &SurfaceChange) {
    let of = |cut: &CutSurface, v: usize| {
        let row = &cut.rows[v];
        (cut.positions[v], cut.uvs[v], cut.wall_uvs[v], cut.materials[v], row.nodes, row.weights)
    };
    let both = before.positions.len().min(after.positions.len());
    for v in (0..both).filter(|&v| changed.vertices.binary_search(&(v as u32)).is_err()) {
        assert_eq!(of(before, v), of(after, v));
    }
    assert!((before.positions.len()..after.positions.len()).all(|v| changed.vertices.contains(&(v as u32))));
    let lists = [
        (&before.triangles, &after.triangles, &changed.triangles),
        (&before.walls, &after.walls, &changed.walls),
    ];
    for (before, after, changed) in lists {
        let is_same = |t: usize| before.get(t) == after.get(t);
        assert!((0..after.len()).all(|t| is_same(t) || changed.binary_search(&(t as u32)).is_ok()));
    }
}

fn volume(positions: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    let six = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| positions[v as usize] - positions[triangles[0][0] as usize]);
        a.dot(&b.cross(&c))
    };
    triangles.iter().map(six).sum::<f64>() / 6.0
}

fn area(cut: &CutSurface, triangles: &[[u32; 3]]) -> f64 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| cut.positions[v as usize]);
        0.5 * (b - a).cross(&(c - a)).norm()
    };
    triangles.iter().map(of).sum()
}

/// The triangles of the outer surface and of the walls.
fn all(cut: &CutSurface) -> impl Iterator<Item = &[u32; 3]> {
    there(&cut.triangles).chain(there(&cut.walls))
}

/// Those triangles of a list whose numbers are not free.
fn there(list: &[[u32; 3]]) -> impl Iterator<Item = &[u32; 3]> {
    list.iter().filter(|t| **t != [0; 3])
}

/// The triangles that share vertices, part by part.
fn parts(cut: &CutSurface) -> Vec<Vec<[u32; 3]>> {
    let mut groups = groups::Groups::new(cut.positions.len());
    for &[a, b, c] in all(cut) {
        groups.join(a, b);
        groups.join(a, c);
    }
    let mut parts: BTreeMap<u32, Vec<[u32; 3]>> = BTreeMap::new();
    for t in all(cut) {
        parts.entry(groups.of(t[0])).or_default().push(*t);
    }
    parts.into_values().collect()
}

fn is_in_ball(cell: [usize; 3]) -> bool {
    Vec3::from(cell.map(|x| x as f64 - 4.5)).norm() < 4.6
}

fn ball() -> Tissue {
    Tissue::new([10; 3], is_in_ball, None)
}

/// A triangle far around a point in a plane, in cells.
fn plane(through: Vec3, normal: Vec3) -> [Vec3; 3] {
    let u = normal.cross(&Vec3::ith(normal.iamin(), 1.0)).normalize();
    let v = normal.cross(&u).normalize();
    [through + 200.0 * u, through - 100.0 * u + 180.0 * v, through - 100.0 * u - 180.0 * v]
}

#[test]
fn a_plane_leaves_two_closed_parts_with_their_exact_volumes_and_flat_walls() {
    let mut noise = Noise(11);
    for n in 0..12 {
        let mut body = ball();
        let normal = if n == 0 { Vec3::z() } else { Vec3::from_fn(|_, _| noise.next()).normalize() };
        let through = Vec3::repeat(5.03) + normal * (2.0 * noise.next());
        body.cut(plane(through, normal), true);
        let cut = body.surface();
        let parts = parts(&cut);
        assert_eq!(parts.len(), 2);
        let above = |part: &[[u32; 3]]| {
            part.iter()
                .flatten()
                .map(|&v| normal.dot(&(cut.positions[v as usize] / H - through)))
                .sum::<f64>()
                > 0.0
        };
        assert_ne!(above(&parts[0]), above(&parts[1]));
        let walls: HashSet<[u32; 3]> = cut.walls.iter().copied().collect();
        for part in &parts {
            let side = if above(part) { 1.0 } else { -1.0 };
            for &v in part.iter().flatten() {
                let height = normal.dot(&(cut.positions[v as usize] / H - through));
                assert!(height * side > -2e-3, "{height}");
            }
        }
        let areas = parts.iter().map(|part| {
            let wall: Vec<_> = part.iter().copied().filter(|t| walls.contains(t)).collect();
            area(&cut, &wall)
        });
        let areas: Vec<f64> = areas.collect();
        assert!((areas[0] - areas[1]).abs() < 1e-12 * areas[0] && areas[0] > 0.0);
    }
}

#[test]
fn a_slit_leaves_one_closed_part_whose_walls_meet_at_the_front() {
    for is_beyond in [true, false] {
        for depth in [3.0, 4.4, 5.1, 7.7] {
            let mut body = ball();
            // From outside of the ball at x < 0 to x = depth.
            let (y, tilt) = (4.7, 0.11);
            let at = |x: f64, z: f64| Vec3::new(x, y + tilt * z, z);
            body.cut([at(depth, -90.0), at(depth, 90.0), at(-90.0, 0.0)], is_beyond);
            let cut = body.surface();
            assert_eq!(parts(&cut).len(), 1);
            assert!(cut.walls.len() > 20);
            let sheet = area(&cut, &cut.walls) / 2.0 / (H * H);
            // The ball's section, of which the tip's cell stays whole.
            assert!(sheet > 3.0 && sheet < std::f64::consts::PI * 5.0 * 5.0, "{sheet}");
        }
    }
}

#[test]
fn a_cut_inside_of_the_body_that_no_surface_meets_is_a_closed_pocket() {
    let mut body = ball();
    body.cut([Vec3::new(3.3, 3.2, 5.2), Vec3::new(7.4, 3.1, 5.2), Vec3::new(5.0, 7.6, 5.2)], true);
    let cut = body.surface();
    assert_eq!(cut.triangles, body.surface.triangles);
    assert_eq!(parts(&cut).len(), 2, "the pocket shares no vertex with the outer surface");
}

fn random_cuts(mut body: Tissue, noise: &mut Noise, cuts: usize, is_beyond: bool) {
    for _ in 0..cuts {
        let size = Vec3::from(body.lattice.cells().map(|n| n as f64));
        let triangle = [(); 3].map(|()| Vec3::from_fn(|axis, _| size[axis] * (0.5 + 0.9 * noise.next())));
        body.cut(triangle, is_beyond);
        body.surface();
    }
}

#[test]
fn random_cuts_leave_closed_surfaces_of_the_right_volume() {
    let mut noise = Noise(5);
    for n in 0..10 {
        random_cuts(ball(), &mut noise, 6, n % 2 == 0);
    }
}

#[test]
fn what_hangs_on_vacant_nodes_is_not_drawn_and_the_rest_follows() {
    let mut noise = Noise(29);
    for n in 0..4 {
        let mut body = ball();
        // As if a corner of the ball had been removed, and the first copies that cuts make.
        let first = body.lattice.slot_count() as u32;
        body.vacant = body.lattice.slots().filter(|slot| slot % 7 == n).chain(first..first + 40).collect();
        body.last = Ok(SurfaceChange {
            vertices: (0..body.surface.positions.len() as u32).collect(),
            ..SurfaceChange::default()
        });
        body.draw();
        assert_eq!(body.anew, 1);
        random_cuts(body, &mut noise, 4, false);
    }
}

#[test]
fn many_small_cuts_are_followed() {
    let mut noise = Noise(23);
    for n in 0..3 {
        let mut body = ball();
        for _ in 0..12 {
            for _ in 0..4 {
                let at = Vec3::from_fn(|_, _| 5.0 + 4.0 * noise.next());
                body.cut([(); 3].map(|()| at + Vec3::from_fn(|_, _| 2.5 * noise.next())), n != 1);
            }
            body.surface();
        }
    }
}

#[test]
fn a_blade_that_goes_on_is_followed_where_it_is() {
    // A beam is cut lengthwise, by a cell at a time, along a plane that lies at an angle to the grid.
    let mut body = Tissue::new([40, 10, 8], |_| true, None);
    let height = |y: f64| 3.7 + 0.13 * y;
    let at = |x: f64, y: f64| Vec3::new(x, y, height(y));
    let mut looked_at = Vec::new();
    for n in 0..32 {
        let (from, to) = (f64::from(n) - 2.0 * f64::from(u8::from(n == 0)), f64::from(n) + 1.03);
        let before = body.followed.clone();
        let (a, b, c, d) = (at(from, -90.0), at(to, -90.0), at(to, 90.0), at(from, 90.0));
        body.cut([a, b, c], true);
        let first = body.last.as_ref().unwrap().looked_at;
        body.cut([a, c, d], true);
        looked_at.push(first + body.last.as_ref().unwrap().looked_at);

        let after = &body.followed;
        let used: HashSet<u32> = before.walls.iter().chain(&after.walls).flatten().copied().collect();
        for v in used.into_iter().map(|v| v as usize).filter(|&v| v < before.positions.len()) {
            // Points on faces that the cut has only now reached are elsewhere.
            let stays = before.positions[v] == after.positions[v];
            assert!(!stays || before.wall_uvs[v] == after.wall_uvs[v]);
        }
        if n % 8 == 7 {
            body.surface();
        }
    }
    // What a step looks at does not grow with what has been cut, and is a small part of everything.
    let most = |steps: &[usize]| steps.iter().copied().max().unwrap();
    assert!(most(&looked_at[20..]) <= most(&looked_at[4..20]), "{looked_at:?}");
    let everything = body.surface.triangles.len() + body.followed.triangles.len() + body.followed.walls.len();
    assert!(8 * most(&looked_at[4..]) < everything, "{looked_at:?} {everything}");
}

#[test]
fn a_cut_that_cannot_be_followed_is_made_anew() {
    let mut body = ball();
    body.cut(plane(Vec3::repeat(5.1), Vec3::new(0.1, 0.2, 1.0)), true);
    body.followed.state.is_behind = true;
    body.cut(plane(Vec3::repeat(4.3), Vec3::new(1.0, -0.2, 0.3)), true);
    let changed = body.last.as_ref().unwrap();
    assert_eq!(changed.vertices.len(), body.followed.positions.len());
    body.surface();
    assert!(!body.followed.state.is_behind);
}

#[test]
fn random_cuts_of_a_ragged_body_leave_closed_surfaces_of_the_right_volume() {
    let mut noise = Noise(7);
    for n in 0..6 {
        let tissue: Vec<bool> = (0..420).map(|_| noise.next() > -0.7).collect();
        let body = Tissue::new([10, 7, 6], |[i, j, k]| tissue[i + 10 * (j + 7 * k)], None);
        random_cuts(body, &mut noise, 6, n % 2 == 0);
    }
}

/// A sphere of its own triangles, in cells.
fn sphere(middle: Vec3, radius: f64, rings: u32) -> TriangleMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let around = 2 * rings;
    let at = |ring: u32, n: u32| {
        let (polar, turn) = (
            std::f64::consts::PI * f64::from(ring) / f64::from(rings),
            std::f64::consts::TAU * f64::from(n) / f64::from(around),
        );
        middle + radius * Vec3::new(polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos())
    };
    positions.push(at(0, 0) * H);
    for ring in 1..rings {
        positions.extend((0..around).map(|n| at(ring, n) * H));
    }
    positions.push(at(rings, 0) * H);
    let last = positions.len() as u32 - 1;
    let index = |ring: u32, n: u32| match ring {
        0 => 0,
        _ if ring == rings => last,
        _ => 1 + (ring - 1) * around + n % around,
    };
    for ring in 0..rings {
        for n in 0..around {
            let [a, b, c, d] =
                [index(ring, n), index(ring + 1, n), index(ring + 1, n + 1), index(ring, n + 1)];
            triangles.extend(
                [[a, b, c], [a, c, d]].into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[0] != t[2]),
            );
        }
    }
    TriangleMesh { positions, triangles, uvs: Vec::new() }
}

/// A cuboid of twelve triangles, in cells.
fn cuboid(low: Vec3, high: Vec3) -> TriangleMesh {
    let corner =
        |c: usize| Vec3::from_fn(|axis, _| if c >> axis & 1 == 1 { high[axis] } else { low[axis] }) * H;
    let triangles = [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]];
    let others = [[2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]];
    let triangles = triangles.into_iter().chain(others).collect();
    TriangleMesh { positions: (0..8).map(corner).collect(), triangles, uvs: Vec::new() }
}

#[test]
fn a_hosts_own_mesh_is_cut_far_outside_of_the_tissue_and_within_it() {
    let mut noise = Noise(13);
    for radius in [3.1, 5.0, 7.3] {
        for is_beyond in [true, false] {
            let mesh = sphere(Vec3::repeat(5.0), radius, 12);
            random_cuts(Tissue::new([10; 3], is_in_ball, Some(mesh)), &mut noise, 4, is_beyond);
        }
    }
}

#[test]
fn a_mesh_that_lies_on_the_planes_of_the_grid_is_cut_along_them() {
    // Large triangles, of which a plane through nodes meets corners and whole edges.
    let (low, high) = (Vec3::zeros(), Vec3::new(6.0, 5.0, 4.0));
    for height in [2.0, 2.5] {
        let mut body = Tissue::new([6, 5, 4], |_| true, Some(cuboid(low, high)));
        let nudged = height + 5.3e-7;
        body.cut(plane(Vec3::new(3.0, 3.0, nudged), Vec3::z()), true);
        let cut = body.surface();
        let volumes =
            parts(&cut).iter().map(|part| volume(&cut.positions, part) / H.powi(3)).collect::<Vec<_>>();
        assert_eq!(volumes.len(), 2);
        // A cut keeps a thousandth of a cell away from nodes.
        assert!(volumes.iter().any(|v| (v - 30.0 * height).abs() < 0.031), "{volumes:?}");
    }
    let mut noise = Noise(17);
    random_cuts(Tissue::new([6, 5, 4], |_| true, Some(cuboid(low, high))), &mut noise, 12, true);
}

#[test]
fn a_mesh_is_as_far_from_the_tissue_as_it_lies_between_its_vertices() {
    // Two of twelve triangles span a pit three cells wide, whose middle is two cells from all tissue.
    let is_in_pit = |[i, j, k]: [usize; 3]| (1..4).contains(&i) && (1..4).contains(&j) && k >= 2;
    let mesh = || Some(cuboid(Vec3::zeros(), Vec3::new(6.0, 5.0, 4.0)));
    let reach_of = |body: &Tissue| reach(&body.surface, &body.lattice);
    // Cells count of which it only touches a side.
    assert_eq!(reach_of(&Tissue::new([6, 5, 4], |_| true, mesh())), 2);
    assert_eq!(reach_of(&Tissue::new([6, 5, 4], |cell| !is_in_pit(cell), mesh())), 3);
}

#[test]
fn triangles_without_area_are_cut_like_others() {
    // An edge of a cuboid is divided in three on one of its sides only, and a triangle without area makes up for it.
    let mut mesh = cuboid(Vec3::zeros(), Vec3::new(6.0, 5.0, 4.0));
    let first = mesh.positions.len() as u32;
    let [a, b, c] = mesh.triangles[0];
    let at = |v: u32| mesh.positions[v as usize];
    let (p, q) = (at(a) + (at(b) - at(a)) / 3.0, at(a) + (at(b) - at(a)) / 1.5);
    mesh.positions.extend([p, q]);
    mesh.triangles[0] = [a, first, c];
    mesh.triangles.extend([
        [first, first + 1, c],
        [first + 1, b, c],
        [a, b, first + 1],
        [a, first + 1, first],
    ]);
    let mut noise = Noise(19);
    random_cuts(Tissue::new([6, 5, 4], |_| true, Some(mesh)), &mut noise, 12, true);
}

#[test]
fn a_surface_with_a_hole_where_it_is_cut_is_refused() {
    let mut mesh = cuboid(Vec3::zeros(), Vec3::new(6.0, 5.0, 4.0));
    mesh.triangles.truncate(11);
    let mut body = Tissue::new([6, 5, 4], |_| true, Some(mesh));
    body.cut(plane(Vec3::new(3.0, 3.0, 1.7), Vec3::z()), true);
    assert!(CutSurface::new(&body.surface, &body.lattice, &body.topology, &body.beyond).is_err());
    // One that follows the cut stays as it was.
    assert!(body.last.is_err());
    assert_eq!(body.followed.triangles, body.surface.triangles);
    assert!(body.followed.walls.is_empty());
}

#[test]
fn without_a_cut_a_surface_stays_what_it_was() {
    let body = ball();
    let cut = body.surface();
    assert_eq!((&cut.positions, &cut.triangles), (&body.surface.positions, &body.surface.triangles));
    assert_eq!((cut.walls.len(), &cut.uvs), (0, &body.surface.uvs));
}

#[test]
fn what_no_wall_meets_keeps_its_numbers() {
    let mut body = ball();
    body.cut(plane(Vec3::repeat(5.1), Vec3::new(0.1, 0.2, 1.0)), true);
    let cut = body.surface();
    let old = body.surface.positions.len();
    assert_eq!(cut.positions[..old], body.surface.positions[..]);
    let mut kept = 0;
    for (before, after) in body.surface.triangles.iter().zip(&cut.triangles) {
        let heights = before.map(|v| {
            Vec3::new(0.1, 0.2, 1.0).dot(&(body.surface.positions[v as usize] / H - Vec3::repeat(5.1)))
        });
        let is_beside = heights.iter().all(|x| *x > 0.01) || heights.iter().all(|x| *x < -0.01);
        assert!(!is_beside || before == after);
        kept += usize::from(is_beside);
    }
    assert!(kept > body.surface.triangles.len() / 2);
}

#[test]
fn both_sheets_of_a_wall_have_the_same_texture_coordinates_in_cells() {
    let mut body = ball();
    let normal = Vec3::new(0.3, 0.2, 1.0).normalize();
    body.cut(plane(Vec3::repeat(5.1), normal), true);
    let cut = body.surface();
    let mut at: HashMap<[u64; 3], [f32; 2]> = HashMap::new();
    for &v in cut.walls.iter().flatten() {
        let (place, uv) = (cut.positions[v as usize], cut.wall_uvs[v as usize]);
        let other = at.entry(place.map(f64::to_bits).into()).or_insert(uv);
        assert!((0..2).all(|i| (uv[i] - other[i]).abs() < 1e-4));
    }
    for corners in &cut.walls {
        for [a, b] in arrange::edges(*corners).map(|edge| edge.map(|v| v as usize)) {
            let length = (cut.positions[a] - cut.positions[b]).norm() / H;
            let [du, dv] = [0, 1].map(|i| f64::from(cut.wall_uvs[a][i] - cut.wall_uvs[b][i]));
            assert!((du.hypot(dv) - length).abs() < 5e-3, "lengths are kept in a plane");
        }
    }
}

#[test]
fn next_to_a_slit_vertices_move_with_their_own_side() {
    // Nodes above the slit rise by one, those below sink: nothing of the surface that is well behind the front stays between.
    let mut body = ball();
    let height = |p: Vec3| p.y - 4.7 - 0.11 * p.z;
    let at = |x: f64, z: f64| Vec3::new(x, 4.7 + 0.11 * z, z);
    body.cut([at(6.3, -900.0), at(6.3, 900.0), at(-900.0, 0.0)], true);
    let cut = body.surface();
    let rises = |slot: u32| {
        let origin = body.topology.origin(slot);
        let is_above = height(body.lattice.rest_position(origin) / H) > 0.0;
        if is_above == (slot == origin) { 1.0 } else { -1.0 }
    };
    let mut seen = 0;
    for (row, place) in cut.rows.iter().zip(&cut.positions).filter(|(_, place)| place.x < 4.9 * H) {
        let rise: f64 = (0..8).map(|n| f64::from(row.weights[n]) * rises(row.nodes[n])).sum();
        assert!((rise.abs() - 1.0).abs() < 1e-5, "{rise} at {}", place / H);
        let there = height(place / H);
        assert!(there.abs() < 2e-3 || rise * there > 0.0);
        seen += usize::from(there.abs() < 2e-3);
    }
    assert!(seen > 50);
}
