//! Which nodes of the tissue are parts of one whole.

use super::grid::{GridNode, has_edge, node_of, slot};
use super::groups::Groups;
use crate::cut::topology::LatticeEdge;
use crate::model::lattice::Lattice;

/// Labels of the wholes that uncut edges connect nodes to.
#[derive(Clone, Debug)]
pub struct Wholes {
    /// The label of each slot's whole.
    labels: Vec<u32>,
    /// The axes along which the edge from each slot is cut, a bit for each.
    cut: Vec<u8>,
    /// While a search is on, one more than the number of the group that has seen a slot; else 0.
    seen: Vec<u32>,
    next: u32,
}

/// An edge of the tissue from a node.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// The slot at its other end.
    pub to: u32,
    /// Whether that is the upper one.
    pub is_upward: bool,
    /// Whether it is cut.
    pub is_cut: bool,
}

impl Wholes {
    /// Of a lattice in which some edges are cut.
    pub fn new(lattice: &Lattice, edges: &[LatticeEdge]) -> Self {
        let count = lattice.slot_count();
        let mut wholes =
            Self { labels: Vec::new(), cut: vec![0; count], seen: vec![0; count], next: count as u32 };
        for edge in edges {
            wholes.cut[edge.slot as usize] |= 1 << edge.axis;
        }
        let mut groups = Groups::new(count);
        for slot in lattice.slots() {
            for link in wholes.links(lattice, slot).filter(|link| link.is_upward && !link.is_cut) {
                groups.join(slot, link.to);
            }
        }
        wholes.labels = groups.all();
        wholes
    }

    /// Whether two nodes are parts of one whole.
    pub fn are_one(&self, a: u32, b: u32) -> bool {
        self.labels[a as usize] == self.labels[b as usize]
    }

    /// The edges of the tissue from a node.
    pub fn links<'a>(&'a self, lattice: &'a Lattice, node: u32) -> impl Iterator<Item = Link> + 'a {
        let at = node_of(lattice, node);
        (0..6).filter_map(move |n| {
            let (axis, is_upward) = (n / 2, n % 2 == 1);
            if is_upward && !has_edge(lattice, node, axis) {
                return None;
            }
            let mut there: GridNode = at;
            there[axis] += if is_upward { 1 } else { -1 };
            let to = slot(lattice, there)?;
            let low = if is_upward { node } else { to };
            let is_cut = self.cut[low as usize] >> axis & 1 != 0;
            (is_upward || has_edge(lattice, low, axis)).then_some(Link { to, is_upward, is_cut })
        })
    }

    /// Cuts edges, those that are not cut. Returns the nodes that are parts of another whole than before.
    ///
    /// It looks as far from the edges as a way around them is long. Where there is none it goes to the end of the smaller part.
    pub fn cut(&mut self, lattice: &Lattice, edges: &[LatticeEdge]) -> Vec<u32> {
        let mut all: Vec<u32> = Vec::new();
        for edge in edges {
            let cut = &mut self.cut[edge.slot as usize];
            if *cut >> edge.axis & 1 != 0 {
                continue;
            }
            *cut |= 1 << edge.axis;
            let mut high = node_of(lattice, edge.slot);
            high[usize::from(edge.axis)] += 1;
            for node in [Some(edge.slot), slot(lattice, high)].into_iter().flatten() {
                if self.seen[node as usize] == 0 {
                    all.push(node);
                    self.seen[node as usize] = all.len() as u32;
                }
            }
        }
        let mut groups = Groups::new(all.len());
        let starts = all.clone();
        let mut front = all.clone();
        // All ends look around by a step at a time, until one of each whole's groups is left that has more to see.
        while self.are_open(&starts, &front, &mut groups) {
            let mut next = Vec::new();
            for node in front {
                let group = self.seen[node as usize] - 1;
                for link in self.links(lattice, node).filter(|link| !link.is_cut) {
                    match self.seen[link.to as usize] {
                        0 => next.push((link.to, group)),
                        met => groups.join(group, met - 1),
                    }
                }
            }
            front = Vec::with_capacity(next.len());
            for (node, group) in next {
                match std::mem::replace(&mut self.seen[node as usize], group + 1) {
                    0 => front.push(node),
                    met => {
                        self.seen[node as usize] = met;
                        groups.join(group, met - 1);
                    }
                }
            }
            all.extend(&front);
        }
        let moved = self.relabel(&starts, &front, &all, &mut groups);
        for node in all {
            self.seen[node as usize] = 0;
        }
        moved
    }

    /// The groups of a search that have more to see.
    fn open(&self, front: &[u32], groups: &mut Groups) -> Vec<u32> {
        let mut open: Vec<u32> = front.iter().map(|&n| groups.of(self.seen[n as usize] - 1)).collect();
        open.sort_unstable();
        open.dedup();
        open
    }

    /// Whether two groups that were one whole have more to see.
    fn are_open(&self, starts: &[u32], front: &[u32], groups: &mut Groups) -> bool {
        let open = self.open(front, groups);
        let mut labels: Vec<u32> =
            open.iter().map(|&group| self.labels[starts[group as usize] as usize]).collect();
        labels.sort_unstable();
        labels.windows(2).any(|pair| pair[0] == pair[1])
    }

    /// Gives new labels to all groups but one of each whole.
    fn relabel(&mut self, starts: &[u32], front: &[u32], all: &[u32], groups: &mut Groups) -> Vec<u32> {
        let mut keeps = self.open(front, groups);
        let mut parted: Vec<u32> = (0..starts.len() as u32).filter(|&n| groups.of(n) == n).collect();
        parted.retain(|group| !keeps.contains(group));
        let label = |group: u32| self.labels[starts[group as usize] as usize];
        parted.retain(|&group| {
            let is_first = !keeps.iter().any(|&kept| label(kept) == label(group));
            if is_first {
                keeps.push(group);
            }
            !is_first
        });
        let mut moved = Vec::new();
        if !parted.is_empty() {
            for &node in all {
                let group = groups.of(self.seen[node as usize] - 1);
                if let Ok(n) = parted.binary_search(&group) {
                    self.labels[node as usize] = self.next + n as u32;
                    moved.push(node);
                }
            }
            self.next += parted.len() as u32;
        }
        moved
    }
}
