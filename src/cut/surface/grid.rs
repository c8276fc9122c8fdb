//! Which edges of the grid are cut, in the tissue and in the margin of empty cells around it.
//!
//! A surface bulges out of the cells that it belongs to, so that what parts the tissue has to part the empty cells beside it as well. A node of the margin
//! belongs to the tissue node that it reaches over the fewest edges which no blade has crossed, its *parent*, and moves with what that one belongs to. An edge of the margin
//! is cut where a blade has crossed it, and also, whatever the blade did there, where the parents of its ends have been parted. So a surface is in two
//! exactly where the tissue is, and no skin spans a cut.

use super::hash::{Map, Set};
use super::parents::Parents;
use super::wholes::{Link, Wholes};
use crate::cut::cell::{Crossings, EDGES, Wall, divide};
use crate::cut::topology::{Change, LatticeEdge, Topology};
use crate::model::lattice::Lattice;

/// A node of the grid, which may lie outside of the lattice.
pub type GridNode = [i32; 3];
/// An edge of the grid: its lower node and its axis.
pub type GridEdge = (GridNode, usize);

/// A grid in which edges are cut.
#[derive(Clone, Debug)]
pub struct Grid {
    /// How many steps from the cuts the margin reaches.
    reach: usize,
    /// The edges outside of all tissue that a blade has crossed, and where.
    beyond: Map<GridEdge, f64>,
    /// The cut edges that no tissue cell has.
    margin: Map<GridEdge, f64>,
    parents: Parents,
    wholes: Wholes,
    /// How many edges lie between each slot's node and the nearest one beside an empty cell.
    depths: Vec<u8>,
    /// The most edges of the tissue between the parents of two neighbours so far.
    widest: u32,
}

/// Where a cut may have changed something.
#[derive(Debug, Default)]
pub struct Touched {
    /// Cells of which edges have been cut, or are cut elsewhere, ascending.
    pub cells: Vec<GridNode>,
    /// Nodes that belong to another node than before, or with it to another whole, ascending.
    pub nodes: Vec<GridNode>,
}

/// A cell with walls in it.
#[derive(Clone, Debug, PartialEq)]
pub struct GridCell {
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
pub fn near([i, j, k]: GridNode, far: i32) -> impl Iterator<Item = GridNode> {
    let along = move || -far..=far;
    along().flat_map(move |c| along().flat_map(move |b| along().map(move |a| [i + a, j + b, k + c])))
}

/// The higher end of an edge.
pub fn higher_end((low, axis): GridEdge) -> GridNode {
    std::array::from_fn(|a| low[a] + i32::from(a == axis))
}

/// The node at a cell's corner.
pub fn corner_node(cell: GridNode, corner: usize) -> GridNode {
    std::array::from_fn(|axis| cell[axis] + (corner >> axis & 1) as i32)
}

/// The lowest nodes of the eight cells around a node.
pub fn cells_around(node: GridNode) -> [GridNode; 8] {
    std::array::from_fn(|corner| std::array::from_fn(|axis| node[axis] - (corner >> axis & 1) as i32))
}

/// The lowest nodes of the four cells around an edge.
fn cells_around_edge((low, axis): GridEdge) -> [GridNode; 4] {
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

/// The nodes at the ends of an edge.
fn ends_of((low, axis): GridEdge) -> [GridNode; 2] {
    [low, step(low, axis, 1)]
}

/// Material of a cell: 0 where it is empty.
pub(crate) fn material(lattice: &Lattice, cell: GridNode) -> u8 {
    let inside = (0..3).all(|a| cell[a] >= 0 && (cell[a] as usize) < lattice.cells()[a]);
    if inside { lattice.cell_material(cell.map(|x| x as usize)) } else { 0 }
}

/// The slot of a node, where the lattice has it.
pub fn slot(lattice: &Lattice, node: GridNode) -> Option<u32> {
    if node.iter().any(|&x| x < 0) { None } else { lattice.slot(node.map(|x| x as usize)) }
}

/// Whether a cell of the tissue has the edge upward from a slot's node along an axis.
pub fn has_edge(lattice: &Lattice, slot: u32, axis: usize) -> bool {
    // Materials of the four cells that have it.
    let around = [0xf0f0_f0f0, 0xff00_ff00, 0xffff_0000][axis];
    lattice.words()[slot as usize] & around != 0
}

/// Whether a cell of the tissue has an edge.
pub(crate) fn is_tissue(lattice: &Lattice, edge: GridEdge) -> bool {
    slot(lattice, edge.0).is_some_and(|slot| has_edge(lattice, slot, edge.1))
}

/// Whether a node has an empty cell beside it.
pub(crate) fn is_outer(lattice: &Lattice, node: GridNode) -> bool {
    slot(lattice, node).is_none_or(|slot| {
        let word = lattice.words()[slot as usize];
        (0..8).any(|cell| word >> (4 * cell) & 15 == 0)
    })
}

pub(crate) fn node_of(lattice: &Lattice, slot: u32) -> GridNode {
    lattice.node_of(slot).map(|x| x as i32)
}

/// How many edges lie between two nodes.
fn distance(a: GridNode, b: GridNode) -> u32 {
    (0..3).map(|axis| a[axis].abs_diff(b[axis])).sum()
}

/// The nodes at the ends of an edge of the lattice.
fn ends(lattice: &Lattice, edge: LatticeEdge) -> [GridNode; 2] {
    ends_of((node_of(lattice, edge.slot), usize::from(edge.axis)))
}

/// How many edges lie between each slot's node and the nearest one beside an empty cell.
fn depths(lattice: &Lattice) -> Vec<u8> {
    let mut depths = vec![u8::MAX; lattice.slot_count()];
    let mut front: Vec<u32> =
        lattice.slots().filter(|&slot| is_outer(lattice, node_of(lattice, slot))).collect();
    for depth in 0..u8::MAX {
        front.retain(|&slot| depths[slot as usize] == u8::MAX);
        for &slot in &front {
            depths[slot as usize] = depth;
        }
        let beside = front.iter().flat_map(|&slot| edges_at(node_of(lattice, slot)));
        let beside = beside.filter_map(|(_, node)| slot(lattice, node));
        front = beside.filter(|&slot| depths[slot as usize] == u8::MAX).collect();
        if front.is_empty() {
            break;
        }
    }
    depths
}

impl Grid {
    /// Without walls as yet, in a lattice of which some edges are cut. The margin will reach `reach` cells far.
    pub fn new(lattice: &Lattice, cut: &[LatticeEdge], reach: usize) -> Self {
        Self {
            reach,
            beyond: Map::default(),
            margin: Map::default(),
            parents: Parents::default(),
            wholes: Wholes::new(lattice, cut),
            depths: depths(lattice),
            widest: 1,
        }
    }

    /// The edges outside of all tissue that a blade has crossed, and where.
    pub fn beyond(&self) -> impl Iterator<Item = (GridEdge, f64)> + '_ {
        self.beyond.iter().map(|(&edge, &at)| (edge, at))
    }

    /// Notes edges outside of all tissue that a blade has crossed, and where; returns those that are new.
    pub fn cross(&mut self, beyond: impl IntoIterator<Item = (GridEdge, f64)>) -> Vec<GridEdge> {
        let mut crossed = Vec::new();
        for (edge, at) in beyond {
            self.beyond.entry(edge).or_insert_with(|| {
                crossed.push(edge);
                at
            });
        }
        crossed
    }

    /// Heeds a change of the topology, and that edges outside of all tissue have been `crossed`.
    pub fn update(
        &mut self,
        lattice: &Lattice,
        topology: &Topology,
        change: &Change,
        crossed: &[GridEdge],
    ) -> Touched {
        let parted = self.wholes.cut(lattice, &change.edges);
        let seeds = self.seeds(lattice, change, crossed);
        let mut nodes = self.parents.update(lattice, &self.beyond, &seeds, crossed, self.reach);
        nodes.extend(parted.iter().flat_map(|&slot| self.parents.children(slot)));

        let mut near: Set<GridNode> = nodes.iter().copied().collect();
        near.extend(crossed.iter().map(|&(low, _)| low));
        for slot in self.near_cuts(lattice, &change.edges) {
            near.extend(self.parents.children(slot));
        }
        let is_first = |(edge, other): &(GridEdge, GridNode)| edge.0 != *other || !near.contains(other);
        let edges = near.iter().flat_map(|&node| edges_at(node).filter(is_first)).map(|(edge, _)| edge);
        let is_between_tissue =
            |edge: &GridEdge| ends_of(*edge).into_iter().all(|node| slot(lattice, node).is_some());
        let (between, mut others): (Vec<GridEdge>, Vec<GridEdge>) = edges.partition(is_between_tissue);
        let mut cells: Vec<GridNode> = change.cells.iter().map(|&slot| node_of(lattice, slot)).collect();
        let mut parted = Map::default();
        // Edges between the children of two nodes of the tissue may inherit from the one between these.
        let mut heirs: Set<GridNode> = Set::default();
        for edge in between {
            if self.look_at(lattice, topology, edge, &mut parted) {
                cells.extend(cells_around_edge(edge));
                let ends = ends_of(edge).into_iter().filter_map(|node| slot(lattice, node));
                heirs.extend(ends.flat_map(|slot| self.parents.children(slot)));
            }
        }
        others.extend(heirs.iter().flat_map(|&node| edges_at(node)).map(|(edge, _)| edge));
        for edge in others {
            if self.look_at(lattice, topology, edge, &mut parted) {
                cells.extend(cells_around_edge(edge));
            }
        }
        let around = change
            .edges
            .iter()
            .flat_map(|edge| cells_around_edge((node_of(lattice, edge.slot), usize::from(edge.axis))));
        cells.extend(around.filter(|&cell| material(lattice, cell) == 0));
        cells.sort_unstable();
        cells.dedup();
        nodes.sort_unstable();
        nodes.dedup();
        Touched { cells, nodes }
    }

    /// A cell, if it has walls in it.
    pub fn divided(&self, lattice: &Lattice, topology: &Topology, at: GridNode) -> Option<GridCell> {
        if material(lattice, at) != 0 {
            let cell = topology.cell(slot(lattice, at)?)?;
            let pieces = cell.pieces.iter().map(|hung| hung.piece.corners).collect();
            return Some(GridCell { pieces, walls: cell.walls.clone() });
        }
        let crossings: Crossings =
            EDGES.map(|edge| self.crossing(lattice, topology, (corner_node(at, edge.low), edge.axis)));
        let partition = divide(&crossings)?;
        let pieces = partition.pieces.iter().map(|piece| piece.corners).collect();
        Some(GridCell { pieces, walls: partition.walls })
    }

    /// The tissue node that a node near a cut belongs to.
    pub fn parent_near_cut(&self, node: GridNode) -> Option<u32> {
        self.parents.of(node).map(|(parent, _)| parent)
    }

    /// The tissue node that a node is or belongs to.
    pub fn parent(&self, lattice: &Lattice, node: GridNode) -> Option<u32> {
        self.parent_near_cut(node).or_else(|| slot(lattice, node))
    }

    /// Whether two tissue nodes are parts of one whole.
    pub fn are_connected(&self, a: u32, b: u32) -> bool {
        self.wholes.are_one(a, b)
    }

    /// Where an edge is cut, as a share of its length.
    fn crossing(&self, lattice: &Lattice, topology: &Topology, edge: GridEdge) -> Option<f64> {
        if let Some(&at) = self.margin.get(&edge) {
            return Some(at);
        }
        let slot = slot(lattice, edge.0)?;
        let at = topology.crossing(LatticeEdge { slot, axis: edge.1 as u8 });
        at.filter(|_| is_tissue(lattice, edge))
    }

    /// The nodes beside empty cells at which a change is.
    fn seeds(&self, lattice: &Lattice, change: &Change, crossed: &[GridEdge]) -> Vec<GridNode> {
        let corners = |&slot: &u32| {
            let at = node_of(lattice, slot);
            (0..8).map(move |corner| corner_node(at, corner))
        };
        let at_cells = change.cells.iter().flat_map(corners);
        let at_edges = change.edges.iter().flat_map(|&edge| ends(lattice, edge));
        let mut seeds: Vec<GridNode> = at_cells.chain(at_edges).collect();
        seeds.sort_unstable();
        seeds.dedup();
        seeds.retain(|&node| is_outer(lattice, node));
        // A blade that leaves the tissue at a small angle runs on along it.
        let is_near =
            |node: &GridNode| near(*node, self.reach as i32).any(|node| slot(lattice, node).is_some());
        let mut beyond: Vec<GridNode> = crossed.iter().copied().flat_map(ends_of).collect();
        beyond.sort_unstable();
        beyond.dedup();
        seeds.extend(beyond.into_iter().filter(is_near));
        seeds
    }

    /// The tissue nodes beside empty cells from which what lies between the parents of two neighbours may have changed when some edges were cut.
    fn near_cuts(&self, lattice: &Lattice, edges: &[LatticeEdge]) -> Vec<u32> {
        let mut seen: Set<u32> = Set::default();
        let mut front: Vec<u32> = Vec::new();
        let ends = edges.iter().flat_map(|&edge| ends(lattice, edge));
        front.extend(ends.filter_map(|node| slot(lattice, node)).filter(|&slot| seen.insert(slot)));
        let mut near = Vec::new();
        // A way around that is two edges longer passes a cut at most so far from its start.
        for left in (0..=self.widest + 1).rev() {
            let mut next = Vec::new();
            for node in front {
                let depth = u32::from(self.depths[node as usize]);
                if depth == 0 {
                    near.push(node);
                }
                if depth <= left && left > 0 {
                    let beside =
                        edges_at(node_of(lattice, node)).filter_map(|(_, other)| slot(lattice, other));
                    next.extend(beside.filter(|&slot| seen.insert(slot)));
                }
            }
            front = next;
        }
        near
    }

    /// Looks anew where an edge that no tissue cell has is cut. Returns whether that is elsewhere than before.
    fn look_at(
        &mut self,
        lattice: &Lattice,
        topology: &Topology,
        edge: GridEdge,
        parted: &mut Map<[u32; 2], bool>,
    ) -> bool {
        let now = self.crossing_of_margin(lattice, topology, edge, parted);
        let before = match now {
            Some(at) => self.margin.insert(edge, at),
            None => self.margin.remove(&edge),
        };
        before != now
    }

    /// Where an edge that no tissue cell has is cut. What has been found of pairs of parents is kept in `parted`.
    fn crossing_of_margin(
        &mut self,
        lattice: &Lattice,
        topology: &Topology,
        edge: GridEdge,
        parted: &mut Map<[u32; 2], bool>,
    ) -> Option<f64> {
        let (a, is_cut_off) = self.parents.of(edge.0)?;
        let (b, is_other_cut_off) = self.parents.of(step(edge.0, edge.1, 1))?;
        let by_blade = self.beyond.get(&edge).copied();
        if is_tissue(lattice, edge) || a == b && by_blade.is_none() {
            return None;
        }
        let is_parted = a != b
            && *parted.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                let between = distance(node_of(lattice, a), node_of(lattice, b));
                self.widest = self.widest.max(between);
                self.are_parted(lattice, a, b, between + 2)
            });
        if is_parted {
            by_blade.or_else(|| Some(self.inherited(lattice, topology, edge.1, a, b)))
        } else {
            by_blade.filter(|_| !is_cut_off && !is_other_cut_off)
        }
    }

    /// Whether a cut lies between two tissue nodes: no way around it of at most `far` edges is left, and there was one.
    fn are_parted(&self, lattice: &Lattice, a: u32, b: u32, far: u32) -> bool {
        if !self.are_connected(a, b) {
            return true;
        }
        let to = node_of(lattice, b);
        let reaches = |is_way: fn(Link) -> bool| {
            let mut seen = vec![a];
            let mut front = 0..1;
            for steps in 1..=far {
                for n in front.clone() {
                    for link in self.wholes.links(lattice, seen[n]) {
                        if !is_way(link) || seen.contains(&link.to) {
                            continue;
                        }
                        if link.to == b {
                            return true;
                        }
                        if steps + distance(node_of(lattice, link.to), to) <= far {
                            seen.push(link.to);
                        }
                    }
                }
                front = front.end..seen.len();
            }
            false
        };
        !reaches(|link| !link.is_cut) && reaches(|_| true)
    }

    /// Where an edge is cut that no blade has crossed: as the edge between its parents is.
    fn inherited(&self, lattice: &Lattice, topology: &Topology, axis: usize, a: u32, b: u32) -> f64 {
        let (a, b) = (node_of(lattice, a), node_of(lattice, b));
        let at = if step(a, axis, 1) == b { self.crossing(lattice, topology, (a, axis)) } else { None };
        at.unwrap_or(0.5)
    }
}
