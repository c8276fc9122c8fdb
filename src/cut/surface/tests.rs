use std::collections::{BTreeMap, HashSet};

use super::*;
use crate::cut::sweep::share;
use crate::cut::topology::LatticeEdge;
use crate::model::extract;
use crate::model::mesh::TriangleMesh;
use crate::noise::Noise;

const H: f64 = 2e-3;

/// A body: a lattice, its surface and what cuts have made of them.
struct Body {
    lattice: Lattice,
    surface: Surface,
    topology: Topology,
    beyond: HashMap<GridEdge, f64>,
}

impl Body {
    fn new(cells: [usize; 3], is_tissue: impl Fn([usize; 3]) -> bool, mesh: Option<TriangleMesh>) -> Self {
        let at = |n: usize| [n % cells[0], n / cells[0] % cells[1], n / cells[0] / cells[1]];
        let materials: Vec<u8> =
            (0..cells.iter().product()).map(|n| u8::from(is_tissue(at(n)))).collect();
        let lattice = Lattice::new(cells, H, &materials).unwrap();
        let mesh = mesh.unwrap_or_else(|| extract::boundary(cells, H, is_tissue).unwrap());
        let surface = Surface::from_mesh(mesh, &lattice).unwrap();
        let topology = Topology::new(lattice.slot_count() as u32, 1_000_000);
        Self { lattice, surface, topology, beyond: HashMap::new() }
    }

    /// Cuts all that a triangle crosses, given in cells; beside the tissue only where that is wanted.
    fn cut(&mut self, triangle: [Vec3; 3], is_beyond: bool) {
        let mut edges = Vec::new();
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
                        }
                    }
                }
            }
        }
        self.topology.cut(&self.lattice, &edges).unwrap();
    }

    fn surface(&self) -> CutSurface {
        let cut = CutSurface::new(&self.surface, &self.lattice, &self.topology, &self.beyond).unwrap();
        self.check(&cut);
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
        for &[a, b, c] in &cut.triangles {
            for edge in [[a, b], [b, c], [c, a]] {
                assert!(used.insert(edge), "an edge is used twice");
            }
        }
        assert!(used.iter().all(|&[a, b]| used.contains(&[b, a])), "an edge has no opposite");
        let before = volume(&self.surface.positions, &self.surface.triangles);
        let after: f64 = parts(cut).iter().map(|part| volume(&cut.positions, part)).sum();
        assert!((after - before).abs() < 1e-9 * before, "{after} {before}");

        for (row, at) in cut.rows.iter().zip(&cut.positions) {
            let there: Vec3 = (0..8)
                .map(|n| self.lattice.rest_position(self.topology.origin(row.nodes[n])) * f64::from(row.weights[n]))
                .sum();
            assert!((there - at).norm() < 1e-5 * H, "{there} {at}");
        }
        let wholes = self.wholes();
        for part in parts(cut) {
            let of = |v: u32| cut.rows[v as usize].nodes.map(|node| wholes[&node]);
            let whole = of(part[0][0])[0];
            assert!(part.iter().flatten().all(|&v| of(v) == [whole; 8]), "a part hangs on two wholes");
        }
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

/// The triangles that share vertices, part by part.
fn parts(cut: &CutSurface) -> Vec<Vec<[u32; 3]>> {
    let mut above: Vec<u32> = (0..cut.positions.len() as u32).collect();
    fn root(above: &mut [u32], mut n: u32) -> u32 {
        while above[n as usize] != n {
            above[n as usize] = above[above[n as usize] as usize];
            n = above[n as usize];
        }
        n
    }
    for t in &cut.triangles {
        for &v in &t[1..] {
            let (a, b) = (root(&mut above, t[0]), root(&mut above, v));
            above[a.max(b) as usize] = a.min(b);
        }
    }
    let mut parts: BTreeMap<u32, Vec<[u32; 3]>> = BTreeMap::new();
    for t in &cut.triangles {
        parts.entry(root(&mut above, t[0])).or_default().push(*t);
    }
    parts.into_values().collect()
}

fn is_in_ball(cell: [usize; 3]) -> bool {
    Vec3::from(cell.map(|x| x as f64 - 4.5)).norm() < 4.6
}

fn ball() -> Body {
    Body::new([10; 3], is_in_ball, None)
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
            part.iter().flatten().map(|&v| normal.dot(&(cut.positions[v as usize] / H - through))).sum::<f64>() > 0.0
        };
        assert_ne!(above(&parts[0]), above(&parts[1]));
        let walls: HashSet<[u32; 3]> = cut.triangles[cut.first_wall..].iter().copied().collect();
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
