//! Which nodes carry a point on one side of a cut.

use super::grid::{Grid, GridNode, corner_node};
use super::jitter::{Tie, passage};
use super::walls::Walls;
use crate::cut::topology::Topology;
use crate::math::Vec3;
use crate::model::binding::trilinear;
use crate::model::lattice::Lattice;
use crate::model::surface::Row;

/// Hangs points on the pieces of cells.
pub struct Hanger<'a> {
    /// The cells.
    pub lattice: &'a Lattice,
    /// Their pieces.
    pub topology: &'a Topology,
    /// What is beside them.
    pub grid: &'a Grid<'a>,
    /// The walls.
    pub walls: &'a Walls,
}

impl Hanger<'_> {
    /// A point (m) on a piece of a divided cell of the walls, and the material there.
    pub fn on_piece(&self, cell: u32, piece: usize, at: Vec3) -> Option<(Row, u8)> {
        let cell = &self.walls.cells[cell as usize];
        let corners = cell.pieces[piece];
        self.on_corner(cell.at, corners.trailing_zeros() as usize, at)
    }

    /// A vertex of the original surface, where a cut has changed what its row hangs on: it is on the same side as the corner of its cell that no wall hides.
    pub fn rehung(&self, row: &Row, at: Vec3) -> Result<Option<(Row, u8)>, Tie> {
        let cell: GridNode = (at / self.lattice.cell_m()).map(|x| x.floor() as i32).into();
        let is_host_divided = self.topology.cell(row.nodes[0]).is_some();
        if !is_host_divided && !self.walls.of_cell.contains_key(&cell) {
            let node: GridNode = (at / self.lattice.cell_m()).map(|x| x.round() as i32).into();
            if self.grid.parent(node).is_none_or(|parent| self.grid.are_connected(parent, row.nodes[0])) {
                return Ok(None);
            }
        }
        let nearest = |corner: &usize| {
            let node = Vec3::from(corner_node(cell, *corner).map(f64::from)) * self.lattice.cell_m();
            (node - at).norm()
        };
        let mut corners: Vec<usize> =
            (0..8).filter(|&c| self.grid.parent(corner_node(cell, c)).is_some()).collect();
        corners.sort_by(|a, b| nearest(a).total_cmp(&nearest(b)));
        for corner in corners {
            if self.sees(at, corner_node(cell, corner))? {
                let parent = self.grid.parent(corner_node(cell, corner)).expect("corners have parents");
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
            let wall = self.walls.triangles[w].corners.map(|p| self.walls.beside[p as usize]);
            if passage(wall, at, node)?.is_some() {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// A point on the piece that has a corner of a cell: where the cell is empty, on that of the nearest cell that has the node's parent.
    fn on_corner(&self, cell: GridNode, corner: usize, at: Vec3) -> Option<(Row, u8)> {
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
                let parent =
                    self.lattice.node_of(self.grid.parent(corner_node(cell, corner))?).map(|x| x as i32);
                let around = (0..8).filter_map(|corner| {
                    let (host, material) = is_cell([0, 1, 2].map(|a| parent[a] - (corner >> a & 1)))?;
                    Some((host, material, corner as usize))
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
        Some((trilinear(nodes, &(at / h - low)), material))
    }
}
