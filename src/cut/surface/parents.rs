//! Which tissue node each node of the margin belongs to.
//!
//! These are shortest ways, kept as a cut goes on: ways that a blade has crossed are found anew, and nodes that are added may shorten others
//! (Ramalingam and Reps 1996).

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};

use super::grid::{GridEdge, GridNode, edges_at, is_outer, near, slot};
use super::hash::Map;
use crate::model::lattice::Lattice;

/// What an edge that a blade has crossed counts for: more than all others of a way together.
const CROSSED: u32 = 1 << 16;

/// The way from a node to its parent: of equally short ones, that to the lowest slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Way {
    length: u32,
    parent: u32,
}

impl Way {
    /// The parent, and whether the way to it is crossed.
    fn end(self) -> (u32, bool) {
        (self.parent, self.length >= CROSSED)
    }
}

#[derive(Clone, Copy, Debug)]
struct Node {
    /// Steps from the cuts.
    steps: usize,
    way: Option<Way>,
}

/// Nodes near cuts, beside empty cells, and what they belong to.
#[derive(Clone, Debug, Default)]
pub struct Parents {
    nodes: Map<GridNode, Node>,
    children: Map<u32, Vec<GridNode>>,
}

impl Parents {
    /// The parent of a node, and whether a blade has crossed every way to it: what it cut off outside of the tissue is not a part of its own.
    pub fn of(&self, node: GridNode) -> Option<(u32, bool)> {
        self.nodes.get(&node)?.way.map(Way::end)
    }

    /// The nodes that belong to one, itself among them.
    pub fn children(&self, parent: u32) -> &[GridNode] {
        self.children.get(&parent).map_or(&[], Vec::as_slice)
    }

    /// Adds all nodes up to `reach` steps from `seeds`, and heeds that edges have been `crossed`, which are in `beyond` by now. Returns the nodes that are new or whose parent has changed, ascending.
    pub fn update(
        &mut self,
        lattice: &Lattice,
        beyond: &Map<GridEdge, f64>,
        seeds: &[GridNode],
        crossed: &[GridEdge],
        reach: usize,
    ) -> Vec<GridNode> {
        let length = |edge: GridEdge| if beyond.contains_key(&edge) { CROSSED } else { 1 };
        let mut before: Map<GridNode, Option<Way>> = Map::default();
        before.extend(self.grow(lattice, seeds, reach).into_iter().map(|node| (node, None)));
        self.forget(crossed, length, &mut before);
        let mut open = BinaryHeap::new();
        for &node in before.keys() {
            if let Some(parent) = slot(lattice, node) {
                open.push(Reverse((Way { length: 0, parent }, node)));
            }
            for (edge, other) in edges_at(node) {
                if let Some(way) = self.nodes.get(&other).and_then(|node| node.way) {
                    open.push(Reverse((Way { length: way.length + length(edge), ..way }, node)));
                }
            }
        }
        while let Some(Reverse((way, node))) = open.pop() {
            let known = self.nodes.get_mut(&node).expect("only nodes that are there are looked at");
            if known.way.is_some_and(|known| known <= way) {
                continue;
            }
            before.entry(node).or_insert(known.way);
            known.way = Some(way);
            for (edge, other) in edges_at(node) {
                let Some(beside) = self.nodes.get(&other) else { continue };
                let there = Way { length: way.length + length(edge), ..way };
                if beside.way.is_none_or(|known| there < known) {
                    open.push(Reverse((there, other)));
                }
            }
        }
        let mut changed = Vec::new();
        for (node, before) in before {
            let (before, now) = (before.map(Way::end), self.nodes[&node].way.map(Way::end));
            if before != now {
                self.move_child(node, before.map(|(parent, _)| parent), now.map(|(parent, _)| parent));
                changed.push(node);
            }
        }
        changed.sort_unstable();
        changed
    }

    /// Adds nodes that are near; returns the new ones.
    fn grow(&mut self, lattice: &Lattice, seeds: &[GridNode], reach: usize) -> Vec<GridNode> {
        let mut new = Vec::new();
        let mut queue: VecDeque<(GridNode, usize)> = seeds.iter().map(|&node| (node, 0)).collect();
        while let Some((node, steps)) = queue.pop_front() {
            let known = self.nodes.entry(node).or_insert_with(|| {
                new.push(node);
                Node { steps: usize::MAX, way: None }
            });
            if known.steps <= steps {
                continue;
            }
            known.steps = steps;
            if steps == reach {
                continue;
            }
            for beside in near(node, 1) {
                let is_farther = match self.nodes.get(&beside) {
                    Some(known) => known.steps > steps + 1,
                    None => is_outer(lattice, beside),
                };
                if is_farther {
                    queue.push_back((beside, steps + 1));
                }
            }
        }
        new
    }

    /// Forgets all ways that led over edges which have been crossed.
    fn forget(
        &mut self,
        crossed: &[GridEdge],
        length: impl Fn(GridEdge) -> u32,
        before: &mut Map<GridNode, Option<Way>>,
    ) {
        // By their lengths, so that what a way may run on by has been decided before.
        let mut suspects = BinaryHeap::new();
        for &(low, axis) in crossed {
            let mut high = low;
            high[axis] += 1;
            for node in [low, high] {
                suspects.extend(self.nodes.get(&node).and_then(|n| n.way).map(|w| Reverse((w.length, node))));
            }
        }
        while let Some(Reverse((_, node))) = suspects.pop() {
            let Some(way) = self.nodes[&node].way else { continue };
            let runs_on = |(edge, other): (GridEdge, GridNode)| {
                let there = self.nodes.get(&other).and_then(|node| node.way);
                there.is_some_and(|there| Way { length: there.length + length(edge), ..there } == way)
            };
            if way.length == 0 || edges_at(node).any(runs_on) {
                continue;
            }
            before.entry(node).or_insert(Some(way));
            self.nodes.get_mut(&node).expect("it is there").way = None;
            for (_, other) in edges_at(node) {
                let there = self.nodes.get(&other).and_then(|node| node.way);
                suspects.extend(there.filter(|w| w.length > way.length).map(|w| Reverse((w.length, other))));
            }
        }
    }

    fn move_child(&mut self, node: GridNode, from: Option<u32>, to: Option<u32>) {
        if from == to {
            return;
        }
        if let Some(children) = from.and_then(|parent| self.children.get_mut(&parent)) {
            children.retain(|&child| child != node);
        }
        if let Some(parent) = to {
            self.children.entry(parent).or_default().push(node);
        }
    }
}
