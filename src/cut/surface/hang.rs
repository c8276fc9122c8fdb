//! Which nodes carry a point on one side of a cut.

use super::glue::Anchor;
use super::grid::{Grid, GridNode, cells_around, corner_node};
use super::jitter::{Tie, passage};
use super::walls::Walls;
use crate::cut::topology::Topology;
use crate::math::Vec3;
use crate::model::binding::trilinear;
use crate::model::lattice::Lattice;
use crate::model::surface::Row;

/// Hangs points on the pieces of cells.
#[derive(Clone, Copy, Debug)]
pub struct Hanger<'a> {
    /// The cells.
    pub lattice: &'a Lattice,
    /// Their pieces.
    pub topology: &'a Topology,
    /// What is beside them.
    pub grid: &'a Grid,
    /// The walls.
    pub walls: &'a Walls,
}

/// What a point hangs on.
#[derive(Clone, Copy, Debug)]
pub struct Hung {
    /// The nodes and weights.
    pub row: Row,
    /// Material of the cell.
    pub material: u8,
    /// Slot of the cell's lowest corner.
    pub host: u32,
}

impl Hanger<'_> {
    /// A point (m) on a piece of a cell.
    pub fn on_piece(&self, (cell, corners): Anchor, at: Vec3) -> Option<Hung> {
        self.on_corner(cell, corners.trailing_zeros() as usize, at)
    }

    /// A vertex of the original surface, where a cut has changed what its row hangs on: it is on the same side as the corner of its cell that no wall hides from where decisions take it to be,
    /// `beside`. They take the parts of its triangles to be on that side too, also where it lies on a wall.
    pub fn rehung(&self, row: &Row, at: Vec3, beside: Vec3) -> Result<Option<Hung>, Tie> {
        let cell: GridNode = (beside / self.lattice.cell_m()).map(|x| x.floor() as i32).into();
        let is_host_divided = self.topology.cell(row.nodes[0]).is_some();
        if !is_host_divided && self.walls.in_cell(cell).is_empty() {
            let node: GridNode = (at / self.lattice.cell_m()).map(|x| x.round() as i32).into();
            let parent = self.grid.parent_near_cut(node);
            if parent.is_none_or(|parent| self.grid.are_connected(parent, row.nodes[0])) {
                return Ok(None);
            }
        }
        let nearest = |corner: &usize| {
            let node = Vec3::from(corner_node(cell, *corner).map(f64::from)) * self.lattice.cell_m();
            (node - at).norm()
        };
        let parent = |corner: usize| self.grid.parent(self.lattice, corner_node(cell, corner));
        let mut corners: Vec<usize> = (0..8).filter(|&corner| parent(corner).is_some()).collect();
        corners.sort_by(|a, b| nearest(a).total_cmp(&nearest(b)));
        for corner in corners {
            if self.sees(beside, corner_node(cell, corner))? {
                let parent = parent(corner).expect("corners have parents");
                if !is_host_divided && self.grid.are_connected(parent, row.nodes[0]) {
                    return Ok(None);
                }
                return Ok(self.on_corner(cell, corner, at));
            }
        }
        Err(Tie)
    }

    /// Whether no wall is between a point and a node. On a grid's plane a wall's edge may be beside both by next to nothing: walls of all cells that meet there count.
    fn sees(&self, at: Vec3, node: GridNode) -> Result<bool, Tie> {
        let node = Vec3::from(node.map(f64::from)) * self.lattice.cell_m();
        for w in self.walls.near(&at.inf(&node), &at.sup(&node), self.lattice.cell_m()) {
            if passage(self.walls.beside(w), at, node)?.is_some() {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// A point on the piece that has a corner of a cell: where the cell is empty, on that of the nearest cell that has the node's parent.
    fn on_corner(&self, cell: GridNode, corner: usize, at: Vec3) -> Option<Hung> {
        let h = self.lattice.cell_m();
        let is_cell = |cell: GridNode| {
            let at = cell.map(|x| usize::try_from(x).ok());
            let at = [at[0]?, at[1]?, at[2]?];
            let material =
                (0..3).all(|a| at[a] < self.lattice.cells()[a]).then(|| self.lattice.cell_material(at))?;
            (material != 0).then_some((at, material))
        };
        let (host, material, corner) = match is_cell(cell) {
            Some((host, material)) => (host, material, corner),
            None => {
                let parent = self.grid.parent(self.lattice, corner_node(cell, corner))?;
                let parent = self.lattice.node_of(parent).map(|x| x as i32);
                let around = cells_around(parent).into_iter().enumerate().filter_map(|(corner, cell)| {
                    let (host, material) = is_cell(cell)?;
                    Some((host, material, corner))
                });
                let distance = |host: [usize; 3]| {
                    let low = Vec3::from(host.map(|x| x as f64));
                    let local = at / h - low;
                    (local - local.map(|x| x.clamp(0.0, 1.0))).norm()
                };
                around.min_by(|a, b| distance(a.0).total_cmp(&distance(b.0)))?
            }
        };
        let whole = self.lattice.corners(host);
        let nodes = self.topology.cell(whole[0]).map_or(whole, |divided| {
            let has = |bits: u8| bits >> corner & 1 != 0;
            divided.pieces.iter().find(|hung| has(hung.piece.corners)).map_or(whole, |hung| hung.nodes)
        });
        let low = Vec3::from(host.map(|x| x as f64));
        Some(Hung { row: trilinear(nodes, &(at / h - low)), material, host: whole[0] })
    }
}
