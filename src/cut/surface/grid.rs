//! Which edges of the grid are cut, in the tissue and in the margin of empty cells around it.
//!
//! A surface bulges out of the cells that it belongs to, so that what parts the tissue has to part the empty cells beside it as well. A node of the margin
//! belongs to the tissue node that it reaches over the fewest edges which no blade has crossed, its *parent*, and moves with what that one belongs to. An edge of the margin
//! is cut where a blade has crossed it, and also, whatever the blade did there, where the parents of its ends have been parted. So a surface is in two
//! exactly where the tissue is, and no skin spans a cut.

use std::collections::{BTreeSet, HashMap, HashSet, VecDeque};

use super::groups::Groups;
use crate::cut::cell::{Crossings, EDGES, Wall, divide};
use crate::cut::topology::{LatticeEdge, Topology};
use crate::model::lattice::Lattice;

/// A node of the grid, which may lie outside of the lattice.
pub type GridNode = [i32; 3];
/// An edge of the grid: its lower node and its axis.
pub type GridEdge = (GridNode, usize);

/// A grid in which edges are cut.
#[derive(Debug)]
pub struct Grid<'a> {
    lattice: &'a Lattice,
    topology: &'a Topology,
    /// The cut edges that no tissue cell has.
    margin: HashMap<GridEdge, f64>,
    parents: HashMap<GridNode, u32>,
    /// The lowest slot of the whole that each node is a part of, by slots.
    components: Vec<u32>,
}

/// A cell with walls in it.
#[derive(Debug)]
pub struct GridCell {
    /// Its lowest node.
    pub at: GridNode,
    /// The corners of each piece, a bit for each.
    pub pieces: Vec<u8>,
    /// The walls between them.
    pub walls: Vec<Wall>,
}

/// A node's neighbour along an axis.
fn step(node: GridNode, axis: usize, by: i32) -> GridNode {
    let mut beside = node;
    beside[axis] += by;
    beside
}

/// The nodes up to so many cells away along each axis, itself among them.
fn near([i, j, k]: GridNode, far: i32) -> impl Iterator<Item = GridNode> {
    let along = move || -far..=far;
    along().flat_map(move |c| along().flat_map(move |b| along().map(move |a| [i + a, j + b, k + c])))
}

/// The node at a cell's corner.
pub fn corner_node(cell: GridNode, corner: usize) -> GridNode {
    std::array::from_fn(|axis| cell[axis] + (corner >> axis & 1) as i32)
}

/// The lowest nodes of the four cells around an edge.
fn cells_around((low, axis): GridEdge) -> [GridNode; 4] {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(a, b)| step(step(low, u, -a), v, -b))
}

/// The six edges at a node, and the nodes at their other ends.
pub(crate) fn edges_at(node: GridNode) -> impl Iterator<Item = (GridEdge, GridNode)> {
    (0..3).flat_map(move |axis| {
        let (below, above) = (step(node, axis, -1), step(node, axis, 1));
        [((below, axis), below), ((node, axis), above)]
    })
}

/// Material of a cell: 0 where it is empty.
fn material(lattice: &Lattice, cell: GridNode) -> u8 {
    let inside = (0..3).all(|a| cell[a] >= 0 && (cell[a] as usize) < lattice.cells()[a]);
    if inside { lattice.cell_material(cell.map(|x| x as usize)) } else { 0 }
}

/// The slot of a node, where the lattice has it.
fn slot(lattice: &Lattice, node: GridNode) -> Option<u32> {
    if node.iter().any(|&x| x < 0) { None } else { lattice.slot(node.map(|x| x as usize)) }
}

/// Whether a cell of the tissue has an edge.
pub(crate) fn is_tissue(lattice: &Lattice, edge: GridEdge) -> bool {
    cells_around(edge).iter().any(|&cell| material(lattice, cell) != 0)
}

/// Whether a node has an empty cell beside it.
pub(crate) fn is_outer(lattice: &Lattice, node: GridNode) -> bool {
    (0..8).any(|corner| {
        let cell = std::array::from_fn(|axis| node[axis] - (corner >> axis & 1));
        material(lattice, cell) == 0
    })
}

pub(crate) fn node_of(lattice: &Lattice, slot: u32) -> GridNode {
    lattice.node_of(slot).map(|x| x as i32)
}

impl<'a> Grid<'a> {
    /// Of a lattice with cuts. `beyond` are the edges outside of all tissue that a blade has crossed, and where; the margin reaches `reach` cells far.
    pub fn new(
        lattice: &'a Lattice,
        topology: &'a Topology,
        beyond: &HashMap<GridEdge, f64>,
        reach: usize,
    ) -> Self {
        let components = components(lattice, topology);
        let mut grid =
            Self { lattice, topology, margin: HashMap::new(), parents: HashMap::new(), components };
        let nodes = grid.nodes_near_cuts(beyond, reach);
        let islands = grid.find_parents(&nodes, beyond);
        let mut parted: HashMap<(u32, u32), bool> = HashMap::new();
        for &low in &nodes {
            for axis in 0..3 {
                let high = step(low, axis, 1);
                let edge = (low, axis);
                if is_tissue(lattice, edge) {
                    continue;
                }
                let (Some(&a), Some(&b)) = (grid.parents.get(&low), grid.parents.get(&high)) else {
                    continue;
                };
                let is_parted =
                    *parted.entry((a.min(b), a.max(b))).or_insert_with(|| a != b && grid.are_parted(a, b));
                let by_blade =
                    beyond.get(&edge).filter(|_| !islands.contains(&low) && !islands.contains(&high));
                if is_parted {
                    let at = beyond.get(&edge).copied().unwrap_or_else(|| grid.inherited(axis, a, b));
                    grid.margin.insert(edge, at);
                } else if let Some(&at) = by_blade {
                    grid.margin.insert(edge, at);
                }
            }
        }
        grid
    }

    /// Where an edge is cut, as a share of its length.
    pub fn crossing(&self, edge: GridEdge) -> Option<f64> {
        if let Some(&at) = self.margin.get(&edge) {
            return Some(at);
        }
        let slot = slot(self.lattice, edge.0)?;
        let at = self.topology.crossing(LatticeEdge { slot, axis: edge.1 as u8 });
        at.filter(|_| is_tissue(self.lattice, edge))
    }

    /// Every cell with walls in it, in a fixed order.
    pub fn divided(&self) -> Vec<GridCell> {
        let mut cells = Vec::new();
        for (slot, cell) in self.topology.cells() {
            let pieces = cell.pieces.iter().map(|hung| hung.piece.corners).collect();
            cells.push(GridCell { at: node_of(self.lattice, slot), pieces, walls: cell.walls.clone() });
        }
        let tissue = self
            .topology
            .crossings()
            .map(|(edge, _)| (node_of(self.lattice, edge.slot), usize::from(edge.axis)));
        let cut = self.margin.keys().copied().chain(tissue);
        let empty: BTreeSet<GridNode> =
            cut.flat_map(cells_around).filter(|&cell| material(self.lattice, cell) == 0).collect();
        for at in empty {
            let crossings: Crossings =
                EDGES.map(|edge| self.crossing((corner_node(at, edge.low), edge.axis)));
            if let Some(partition) = divide(&crossings) {
                let pieces = partition.pieces.iter().map(|piece| piece.corners).collect();
                cells.push(GridCell { at, pieces, walls: partition.walls });
            }
        }
        cells
    }

    /// The tissue node that a node is or belongs to.
    pub fn parent(&self, node: GridNode) -> Option<u32> {
        self.parents.get(&node).copied().or_else(|| slot(self.lattice, node))
    }

    /// Whether two tissue nodes are parts of one whole.
    pub fn are_connected(&self, a: u32, b: u32) -> bool {
        self.components[a as usize] == self.components[b as usize]
    }

    /// Nodes beside empty cells, near the edges that are cut.
    fn nodes_near_cuts(&self, beyond: &HashMap<GridEdge, f64>, reach: usize) -> BTreeSet<GridNode> {
        let corners = |slot: u32| {
            let at = node_of(self.lattice, slot);
            (0..8).map(move |corner| corner_node(at, corner))
        };
        let ends = |(edge, _): (LatticeEdge, f64)| {
            let low = node_of(self.lattice, edge.slot);
            [low, step(low, usize::from(edge.axis), 1)]
        };
        let starts = self.topology.cells().into_iter().flat_map(|(slot, _)| corners(slot));
        let mut nodes: BTreeSet<GridNode> = starts
            .chain(self.topology.crossings().flat_map(ends))
            .filter(|&node| is_outer(self.lattice, node))
            .collect();
        // A blade that leaves the tissue at a small angle runs on along it.
        let is_near =
            |node: GridNode| near(node, reach as i32).any(|node| slot(self.lattice, node).is_some());
        let ends = |&(low, axis): &GridEdge| [low, step(low, axis, 1)];
        nodes.extend(beyond.keys().flat_map(ends).filter(|&node| is_near(node)));
        let mut front: Vec<GridNode> = nodes.iter().copied().collect();
        for _ in 0..reach {
            let mut next = Vec::new();
            for node in front {
                for beside in near(node, 1) {
                    if !nodes.contains(&beside) && is_outer(self.lattice, beside) {
                        nodes.insert(beside);
                        next.push(beside);
                    }
                }
            }
            front = next;
        }
        nodes
    }

    /// Finds the parents of some nodes. Returns those which no edge connects to tissue that a blade has not crossed: what it cut off there is not a part of its own.
    fn find_parents(
        &mut self,
        nodes: &BTreeSet<GridNode>,
        beyond: &HashMap<GridEdge, f64>,
    ) -> HashSet<GridNode> {
        let tissue = nodes.iter().filter_map(|&node| Some((node, slot(self.lattice, node)?)));
        self.parents = tissue.collect();
        let sources: Vec<GridNode> = nodes.iter().copied().filter(|n| self.parents.contains_key(n)).collect();
        self.spread(nodes, sources, |edge| !beyond.contains_key(&edge));
        let (reached, islands): (Vec<_>, Vec<_>) =
            nodes.iter().copied().partition(|node| self.parents.contains_key(node));
        self.spread(nodes, reached, |_| true);
        islands.into_iter().collect()
    }

    fn spread(&mut self, nodes: &BTreeSet<GridNode>, from: Vec<GridNode>, is_way: impl Fn(GridEdge) -> bool) {
        let mut queue = VecDeque::from(from);
        while let Some(node) = queue.pop_front() {
            let parent = self.parents[&node];
            for (edge, other) in edges_at(node) {
                if nodes.contains(&other) && !self.parents.contains_key(&other) && is_way(edge) {
                    self.parents.insert(other, parent);
                    queue.push_back(other);
                }
            }
        }
    }

    /// Whether a cut lies between two tissue nodes: no way around it is about as short as it was.
    fn are_parted(&self, a: u32, b: u32) -> bool {
        if !self.are_connected(a, b) {
            return true;
        }
        let (from, to) = (node_of(self.lattice, a), node_of(self.lattice, b));
        let far = (0..3).map(|axis| from[axis].abs_diff(to[axis])).sum::<u32>() + 2;
        let reaches = |is_way: &dyn Fn(GridEdge) -> bool| {
            let mut seen = HashSet::from([from]);
            let mut front = vec![from];
            for _ in 0..far {
                let mut next = Vec::new();
                for node in front {
                    for (edge, other) in edges_at(node) {
                        if is_tissue(self.lattice, edge) && is_way(edge) && seen.insert(other) {
                            next.push(other);
                        }
                    }
                }
                front = next;
            }
            seen.contains(&to)
        };
        !reaches(&|edge| self.crossing(edge).is_none()) && reaches(&|_| true)
    }

    /// Where an edge is cut that no blade has crossed: as the edge between its parents is.
    fn inherited(&self, axis: usize, a: u32, b: u32) -> f64 {
        let (a, b) = (node_of(self.lattice, a), node_of(self.lattice, b));
        if step(a, axis, 1) == b { self.crossing((a, axis)).unwrap_or(0.5) } else { 0.5 }
    }
}

/// The lowest slot of the nodes that uncut edges of the tissue connect each node with, by slots.
fn components(lattice: &Lattice, topology: &Topology) -> Vec<u32> {
    let mut groups = Groups::new(lattice.slot_count());
    let mut cut = vec![0_u8; lattice.slot_count()];
    for (edge, _) in topology.crossings() {
        cut[edge.slot as usize] |= 1 << edge.axis;
    }
    for slot in lattice.slots() {
        for axis in 0..3 {
            // Materials of the four cells that have the edge upward from a node.
            let around = [0xf0f0_f0f0, 0xff00_ff00, 0xffff_0000][axis];
            if lattice.words()[slot as usize] & around == 0 || cut[slot as usize] >> axis & 1 != 0 {
                continue;
            }
            let other = self::slot(lattice, step(node_of(lattice, slot), axis, 1));
            groups.join(slot, other.expect("a tissue edge has two nodes"));
        }
    }
    groups.all()
}
