//! Which rows cells have: none of those that bricks know, one of a cell with a row of its own, and one for each piece of a divided cell.

use std::collections::HashMap;

use super::super::nodes::Bricks;
use crate::cut::topology::{Change, Topology};
use crate::error::Result;
use crate::model::efg::rows::{Cell, RowTable};
use crate::model::lattice::Lattice;
use crate::solver::method::Rows;

/// The rows of cells that have rows, by the slots where they start.
#[derive(Clone, Debug, Default)]
pub struct CellRows(HashMap<u32, Vec<PieceRow>>);

/// The row of a piece.
#[derive(Clone, Copy, Debug)]
struct PieceRow {
    /// The corners of the cell that it has, a bit for each.
    corners: u8,
    row: usize,
}

/// A cell that is turned: one with a row of its own, or one of a brick's own by the slot where it starts.
#[derive(Clone, Copy, Debug)]
pub enum Like {
    Row(usize),
    Cell(u32),
}

impl CellRows {
    /// The rows of cells before any cut, and whose they are.
    pub fn uncut(bricks: &mut Bricks, rows: Rows) -> Result<(RowTable, Self)> {
        match rows {
            Rows::Irregular => Ok(Default::default()),
            Rows::All => {
                // No cell is a brick's own any more.
                bricks.cells.fill(0);
                let lattice = bricks.model.lattice();
                let of_cell =
                    |(row, (cell, _))| (lattice.corners(cell)[0], vec![PieceRow { corners: 0xff, row }]);
                let of_cells = lattice.occupied().enumerate().map(of_cell).collect();
                Ok((RowTable::of_all(lattice)?, Self(of_cells)))
            }
        }
    }

    /// Gives the pieces of cells that a cut has changed rows in `table`: the first piece of what had a row keeps that, others get new ones behind the last. Says
    /// how these are turned: as what they were part of. What was removed sees no node any more.
    pub fn divide(
        &mut self,
        table: &mut RowTable,
        lattice: &Lattice,
        topology: &Topology,
        change: &Change,
    ) -> Vec<(usize, Like)> {
        let h = lattice.cell_m();
        let mut new = Vec::new();
        for cell in change.reshaped().chain(change.rehung.iter().copied()) {
            let pieces = topology.left_of(lattice, cell);
            let material = lattice.cell_material(lattice.node_of(cell));
            let low = lattice.rest_position(cell);
            let before = self.0.remove(&cell).unwrap_or_default();
            let mut hung: Vec<PieceRow> = Vec::with_capacity(pieces.len());
            for piece in &pieces {
                let corners = piece.piece.corners;
                let was = before.iter().find(|old| old.corners & corners != 0);
                let kept = was.filter(|was| hung.iter().all(|hung| hung.row != was.row));
                let row = kept.map_or(table.len(), |kept| kept.row);
                if kept.is_none() {
                    new.push((row, was.map_or(Like::Cell(cell), |was| Like::Row(was.row))));
                }
                let at = Cell { point: low + piece.piece.centroid * h, volume: piece.piece.volume, material };
                table.put_piece(row, at, piece.nodes, low, h);
                hung.push(PieceRow { corners, row });
            }
            for gone in before.iter().filter(|old| hung.iter().all(|hung| hung.row != old.row)) {
                table.clear(gone.row);
            }
            self.0.insert(cell, hung);
        }
        new
    }
}
