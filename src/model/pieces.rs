//! Pieces of tissue that nothing joins to the rest, such as specks that a segmentation left in the air.

use super::lattice::{Lattice, flag};

/// Cells of each piece that floats freely: it shares no node with the largest piece, and none of its nodes is
/// held. Largest first. The largest piece is the body itself and never in the list.
pub(crate) fn loose_pieces(lattice: &Lattice) -> Vec<usize> {
    // Each slot leads towards the first node of its piece.
    let mut toward: Vec<u32> = (0..lattice.slot_count() as u32).collect();
    for (cell, _) in lattice.occupied() {
        let corners = lattice.corners(cell);
        let first = root(&mut toward, corners[0]);
        for corner in &corners[1..] {
            let other = root(&mut toward, *corner);
            toward[other as usize] = first;
        }
    }

    let mut cells = vec![0_usize; toward.len()];
    for (cell, _) in lattice.occupied() {
        cells[root(&mut toward, lattice.corners(cell)[0]) as usize] += 1;
    }
    let mut is_held = vec![false; toward.len()];
    for slot in lattice.slots() {
        is_held[root(&mut toward, slot) as usize] |= lattice.flags()[slot as usize] & flag::FIX_ALL != 0;
    }

    let mut pieces: Vec<(usize, bool)> =
        cells.into_iter().zip(is_held).filter(|(count, _)| *count > 0).collect();
    pieces.sort_unstable_by_key(|(count, _)| std::cmp::Reverse(*count));
    pieces.into_iter().skip(1).filter(|(_, is_held)| !is_held).map(|(count, _)| count).collect()
}

/// The first node of a slot's piece; halves the way for whoever asks next.
fn root(toward: &mut [u32], slot: u32) -> u32 {
    let mut at = slot as usize;
    while toward[at] as usize != at {
        toward[at] = toward[toward[at] as usize];
        at = toward[at] as usize;
    }
    at as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block of 4 × 4 × 4 cells and, two cells away from it, some more.
    fn block_and(more: &[[usize; 3]]) -> Lattice {
        let mut materials = vec![0; 12 * 4 * 4];
        for cell in 0..64 {
            materials[cell % 4 + 12 * (cell / 4)] = 1;
        }
        for [i, j, k] in more {
            materials[i + 12 * (j + 4 * k)] = 1;
        }
        Lattice::new([12, 4, 4], 0.01, &materials).unwrap()
    }

    #[test]
    fn one_body_has_no_loose_pieces() {
        assert!(loose_pieces(&block_and(&[])).is_empty());
    }

    #[test]
    fn specks_are_counted_cell_by_cell_largest_first() {
        let specks = [[6, 0, 0], [9, 1, 1], [10, 1, 1], [10, 2, 1]];
        assert_eq!(loose_pieces(&block_and(&specks)), [3, 1]);
    }

    #[test]
    fn a_shared_corner_joins() {
        assert!(loose_pieces(&block_and(&[[4, 3, 3]])).is_empty());
        assert_eq!(loose_pieces(&block_and(&[[5, 0, 0], [6, 1, 1]])), [2]);
    }

    #[test]
    fn a_held_piece_is_not_loose() {
        let mut lattice = block_and(&[[6, 0, 0], [9, 1, 1]]);
        let slot = lattice.slot([6, 0, 0]).unwrap();
        lattice.flags[slot as usize] |= flag::FIX_X;
        assert_eq!(loose_pieces(&lattice), [1]);
    }
}
