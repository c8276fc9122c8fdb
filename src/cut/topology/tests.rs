//! Random cuts of blocks and beams, and what is left of them.

use super::*;
use crate::cut::sweep::share;
use crate::noise::Noise;

const H: f64 = 2e-3;

fn block(cells: [usize; 3]) -> Lattice {
    Lattice::new(cells, H, &vec![1; cells.iter().product()]).unwrap()
}

/// A lattice in which about a sixth of the cells is missing.
fn ragged() -> Lattice {
    let mut noise = Noise(7);
    let materials: Vec<u8> = (0..420).map(|_| u8::from(noise.next() > -0.7)).collect();
    Lattice::new([10, 7, 6], H, &materials).unwrap()
}

fn topology(lattice: &Lattice) -> Topology {
    Topology::new(lattice.slot_count() as u32, 100_000)
}

/// The edges of occupied cells that a triangle crosses, in cells.
fn crossed(lattice: &Lattice, triangle: [Vec3; 3]) -> Vec<(LatticeEdge, f64)> {
    let mut all = BTreeSet::new();
    for (cell, _) in lattice.occupied() {
        let corners = lattice.corners(cell);
        all.extend(EDGES.map(|edge| (corners[edge.low], edge.axis as u8)));
    }
    let at = |slot: u32| Vec3::from(lattice.node_of(slot).map(|i| i as f64));
    all.into_iter()
        .filter_map(|(slot, axis)| {
            let beyond = at(slot) + Vec3::ith(usize::from(axis), 1.0);
            share(at(slot), beyond, triangle).map(|t| (LatticeEdge { slot, axis }, t))
        })
        .collect()
}

fn random_triangle(noise: &mut Noise, lattice: &Lattice) -> [Vec3; 3] {
    let size = Vec3::from(lattice.cells().map(|n| n as f64));
    [(); 3].map(|()| Vec3::from_fn(|axis, _| size[axis] * (0.5 + 0.8 * noise.next())))
}

/// Every piece and every whole cell: its volume, its corners, and the nodes that it hangs on.
fn everything(lattice: &Lattice, topology: &Topology) -> Vec<(u32, f64, u8, [u32; 8])> {
    let mut all = Vec::new();
    for (cell, _) in lattice.occupied() {
        let corners = lattice.corners(cell);
        match topology.cell(corners[0]) {
            None => all.push((corners[0], 1.0, 0xff, corners)),
            Some(divided) => all.extend(
                divided
                    .pieces
                    .iter()
                    .map(|hung| (corners[0], hung.piece.volume, hung.piece.corners, hung.nodes)),
            ),
        }
    }
    all
}

/// How many parts pieces form that share nodes, and the volume of each in cells.
fn parts(lattice: &Lattice, topology: &Topology) -> Vec<f64> {
    let all = everything(lattice, topology);
    let mut of_node: HashMap<u32, usize> = HashMap::new();
    let mut part: Vec<usize> = (0..all.len()).collect();
    fn root(part: &mut [usize], mut n: usize) -> usize {
        while part[n] != n {
            part[n] = part[part[n]];
            n = part[n];
        }
        n
    }
    for (n, (.., nodes)) in all.iter().enumerate() {
        for node in nodes {
            let other = *of_node.entry(*node).or_insert(n);
            let (a, b) = (root(&mut part, n), root(&mut part, other));
            part[a.max(b)] = a.min(b);
        }
    }
    let mut volumes = vec![0.0; all.len()];
    for n in 0..all.len() {
        let at = root(&mut part, n);
        volumes[at] += all[n].1;
    }
    volumes.retain(|&volume| volume > 0.0);
    volumes
}

/// What holds after any cuts.
fn check(lattice: &Lattice, topology: &Topology) {
    let all = everything(lattice, topology);
    let total: f64 = all.iter().map(|(_, volume, ..)| volume).sum();
    assert!((total - lattice.cell_count() as f64).abs() < 1e-9 * total);
    let mut used = BTreeSet::new();
    for (cell, volume, corners, nodes) in &all {
        assert!(*volume >= 0.99 * LEAST_VOLUME && *volume <= 1.0, "{volume}");
        let own = lattice.corners(lattice.node_of(*cell));
        for corner in 0..8 {
            // A piece hangs on the node itself at its own corners, and everywhere on that node or a copy of it.
            assert!(corners >> corner & 1 == 0 || nodes[corner] == own[corner]);
            assert_eq!(topology.origin(nodes[corner]), own[corner]);
            used.insert(nodes[corner]);
        }
    }
    // No copy dangles, and no node of the lattice is lost.
    assert_eq!(used.len(), lattice.node_count() + topology.copy_count());
}

#[test]
fn a_plane_parts_a_block_in_two_that_share_no_node_and_have_their_exact_volumes() {
    let lattice = block([9, 5, 4]);
    for height in [2.3, 2.0 + 1e-9, 2.5, 2.999] {
        let mut topology = topology(&lattice);
        // Larger than the block, in two triangles.
        let [a, b, c, d] =
            [[-1.0, -1.0], [11.0, -1.0], [11.0, 6.0], [-1.0, 6.0]].map(|[x, y]| Vec3::new(x, y, height));
        let mut edges = crossed(&lattice, [a, b, c]);
        edges.extend(crossed(&lattice, [a, c, d]));
        let change = topology.cut(&lattice, &edges).unwrap();
        check(&lattice, &topology);
        assert_eq!(change.cells.len(), 45);
        // Each side has copies of the two layers of nodes beyond the cut.
        assert_eq!((change.births.len(), topology.copy_count()), (120, 120));
        let volumes = parts(&lattice, &topology);
        let lower = 45.0 * height.clamp(2.0 + LEAST_DISTANCE, 3.0 - LEAST_DISTANCE);
        assert_eq!(volumes.len(), 2);
        assert!(
            (volumes[0] - lower).abs() < 1e-9 && (volumes[1] - (180.0 - lower)).abs() < 1e-9,
            "{volumes:?}"
        );
    }
}

#[test]
fn behind_the_tip_of_a_cut_both_sides_hang_on_the_same_nodes() {
    let lattice = block([8, 3, 4]);
    let mut topology = topology(&lattice);
    // A blade from the side x = 0 to x = 4.6: four cells are divided, and the fifth holds.
    let triangle = [Vec3::new(4.6, -50.0, 1.4), Vec3::new(4.6, 50.0, 1.4), Vec3::new(-99.0, 0.0, 1.4)];
    topology.cut(&lattice, &crossed(&lattice, triangle)).unwrap();
    check(&lattice, &topology);
    assert_eq!(topology.cells().len(), 4 * 3);
    assert_eq!(parts(&lattice, &topology).len(), 1);
    // Copies of two nodes in each column along z, at x = 0 to 3; at x = 4 the whole cell holds them.
    assert_eq!(topology.copy_count(), 4 * 4 * 2);
}

#[test]
fn cuts_in_many_steps_end_where_one_step_does() {
    let mut noise = Noise(21);
    for _ in 0..20 {
        let lattice = ragged();
        let (mut once, mut often) = (topology(&lattice), topology(&lattice));
        let mut edges: HashMap<LatticeEdge, f64> = HashMap::new();
        for _ in 0..4 {
            for (edge, at) in crossed(&lattice, random_triangle(&mut noise, &lattice)) {
                edges.entry(edge).or_insert(at);
            }
        }
        let mut edges: Vec<_> = edges.into_iter().collect();
        edges.sort_by_key(|(edge, _)| *edge);
        once.cut(&lattice, &edges).unwrap();
        // In any order: a blade may go to and fro.
        let stride = 1 + (noise.next().abs() * 7.0) as usize;
        for start in 0..stride {
            let some: Vec<_> = edges.iter().skip(start).step_by(stride).copied().collect();
            for few in some.chunks(5) {
                let change = often.cut(&lattice, few).unwrap();
                // A copy is born from what its cells hung on.
                assert!(
                    change.births.iter().all(|birth| often.origin(birth.from) == often.origin(birth.slot))
                );
            }
            check(&lattice, &often);
        }
        check(&lattice, &once);
        let (a, b) = (everything(&lattice, &once), everything(&lattice, &often));
        assert_eq!(a.len(), b.len());
        // The same pieces, on the same nodes but for the names of copies.
        let mut names: HashMap<u32, u32> = HashMap::new();
        for (a, b) in a.iter().zip(&b) {
            assert_eq!((a.0, a.1, a.2), (b.0, b.1, b.2));
            for (a, b) in a.3.iter().zip(b.3) {
                assert_eq!(*names.entry(*a).or_insert(b), b);
            }
        }
        assert_eq!(names.values().collect::<BTreeSet<_>>().len(), names.len());
        let (mut a, mut b) = (parts(&lattice, &once), parts(&lattice, &often));
        a.sort_by(f64::total_cmp);
        b.sort_by(f64::total_cmp);
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-9) && a.len() == b.len());
    }
}

/// So many random cuts of ragged bodies, a new one after every forty.
fn cut_at_random(count: usize) {
    let (mut noise, lattice) = (Noise(57), ragged());
    let mut topology = topology(&lattice);
    for cut in 0..count {
        if cut % 40 == 0 {
            topology = self::topology(&lattice);
        }
        topology.cut(&lattice, &crossed(&lattice, random_triangle(&mut noise, &lattice))).unwrap();
        check(&lattice, &topology);
    }
}

#[test]
fn a_thousand_random_cuts_lose_nothing_and_leave_no_copy_dangling() {
    cut_at_random(1000);
}

#[test]
#[ignore = "takes minutes; tests/long.sh runs it"]
fn a_hundred_thousand_random_cuts_lose_nothing_and_leave_no_copy_dangling() {
    cut_at_random(100_000);
}

#[test]
fn random_cuts_lose_nothing_until_every_node_stands_alone() {
    let mut noise = Noise(33);
    let lattice = ragged();
    let mut topology = topology(&lattice);
    for _ in 0..200 {
        topology.cut(&lattice, &crossed(&lattice, random_triangle(&mut noise, &lattice))).unwrap();
        check(&lattice, &topology);
    }
    // Each edge, one after the other: then each node carries what is next to it.
    let all: Vec<_> =
        lattice.slots().flat_map(|slot| [0, 1, 2].map(|axis| (LatticeEdge { slot, axis }, 0.5))).collect();
    topology.cut(&lattice, &all).unwrap();
    check(&lattice, &topology);
    assert!(topology.cells().iter().all(|(_, cell)| cell.pieces.len() == 8));
    assert_eq!(parts(&lattice, &topology).len(), lattice.node_count());
    let version = topology.version();
    assert_eq!(topology.cut(&lattice, &all).unwrap(), Change::default());
    assert_eq!(topology.version(), version);
}

#[test]
fn random_cuts_and_removals_lose_nothing_but_what_is_removed() {
    let (mut noise, lattice) = (Noise(91), ragged());
    let size = Vec3::from(lattice.cells().map(|n| n as f64));
    for _ in 0..20 {
        let mut topology = topology(&lattice);
        let mut gone = 0.0;
        for _ in 0..12 {
            topology.cut(&lattice, &crossed(&lattice, random_triangle(&mut noise, &lattice))).unwrap();
            let middle = Vec3::from_fn(|axis, _| size[axis] * (0.5 + 0.5 * noise.next()));
            let is_near = |&slot: &u32| {
                (Vec3::from(lattice.node_of(slot).map(|i| i as f64)) - middle).norm() < 1.9
                    && !topology.is_removed(slot)
            };
            let nodes: BTreeSet<u32> = lattice.slots().filter(is_near).collect();
            let links = nodes.iter().flat_map(|&node| neighbours(&lattice, node));
            let leaving = links.filter(|(_, other)| !nodes.contains(other));
            let leaving: Vec<_> = leaving.map(|(edge, _)| (edge, 0.3)).collect();
            let mut change = topology.cut(&lattice, &leaving).unwrap();
            let removed = topology.remove(&lattice, &nodes, &mut change);
            gone += removed.iter().map(|(_, volume)| volume).sum::<f64>();
            assert_eq!(change.removed, nodes.into_iter().collect::<Vec<_>>());

            let (vacant, mut left) = (topology.vacant(), 0.0);
            for (cell, _) in lattice.occupied() {
                for hung in topology.left_of(&lattice, lattice.corners(cell)[0]) {
                    left += hung.piece.volume;
                    assert!(hung.nodes.iter().all(|slot| !vacant.contains(slot)));
                }
            }
            assert!((left + gone - lattice.cell_count() as f64).abs() < 1e-9, "{left} and {gone}");
        }
        assert!(gone > 50.0);
    }
}

#[test]
fn a_cut_without_room_for_its_copies_is_refused_whole() {
    let lattice = block([4, 4, 4]);
    let mut topology = Topology::new(lattice.slot_count() as u32, 49);
    let plane = [Vec3::new(-50.0, -50.0, 1.5), Vec3::new(50.0, -50.0, 1.5), Vec3::new(0.0, 99.0, 1.5)];
    let edges = crossed(&lattice, plane);
    let before = format!("{:?}", topology.cells());
    let error = topology.cut(&lattice, &edges).unwrap_err();
    assert!(matches!(&error, Error::Limit(why) if why.contains("needs 50 copies")), "{error}");
    assert_eq!(
        (format!("{:?}", topology.cells()), topology.version(), topology.copy_count()),
        (before, 0, 0)
    );
    assert!(topology.crossing(edges[0].0).is_none());
}
