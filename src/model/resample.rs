//! Cubic cells from voxels of any spacing.
//!
//! Cells start at the low **corner** of the voxel grid (half a spacing below the centre of voxel 0) and cover
//! it. Along each axis a cell overlaps a run of voxels by known lengths, so the volume of any overlap is a
//! product of three numbers that are computed once per axis; then one sweep over the cells counts votes.

use super::grid::{LabelGrid, ResampleRule, voxel_count};
use super::placement::Placement;
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};

/// Lengths below this part of a voxel or cell are rounding of the file's spacing: they neither add a cell nor
/// a vote.
const SLIVER: f64 = 1e-3;

/// Parts of a cell that differ by less than this share of its volume are equal.
const TIE: f64 = 1e-4;

impl LabelGrid {
    /// The same anatomy in cubic cells of edge `cell_m` (metres), coarser or finer than the voxels.
    ///
    /// Cell (0, 0, 0) and voxel (0, 0, 0) share their lowest corner, and as many cells follow along each axis
    /// as it takes to cover the grid (a rest thinner than a thousandth of a cell is dropped). The result is
    /// again a grid with its frame at the *centre* of its first voxel.
    pub fn resample(&self, cell_m: f64, rule: ResampleRule) -> Result<LabelGrid> {
        if !(1e-6..=1.0).contains(&cell_m) {
            return Err(Error::argument(format!("a cell of {cell_m} m is not between 1e-6 m and 1 m")));
        }
        let ratio = self.spacing().map(|s| cell_m / s);
        let voxels = self.dims();
        let dims = [0, 1, 2].map(|a| cell_count(voxels[a], ratio[a]));
        let count = voxel_count(dims)?;

        let mut labels = Vec::new();
        labels
            .try_reserve_exact(count)
            .map_err(|_| Error::Limit(format!("there is no memory for a grid of {dims:?} cells")))?;
        match rule {
            ResampleRule::Nearest => nearest(self, dims, ratio, &mut labels),
            ResampleRule::Majority => majority(self, dims, ratio, &mut labels),
        }

        // From the centre of the first voxel to that of the first cell: down half a voxel, up half a cell.
        let shift = (Vec3::repeat(cell_m) - self.spacing()) / 2.0;
        let frame = self.frame() * Pose::translation(shift.x, shift.y, shift.z);
        LabelGrid::from_placement(Placement::new(dims, Vec3::repeat(cell_m), frame)?, labels)
    }
}

/// Cells that cover `voxels` voxels when a cell is `ratio` voxels long.
fn cell_count(voxels: usize, ratio: f64) -> usize {
    ((voxels as f64 / ratio - SLIVER).ceil() as usize).max(1)
}

fn nearest(grid: &LabelGrid, dims: [usize; 3], ratio: Vec3, labels: &mut Vec<u16>) {
    // The voxel with each cell's centre along one axis; the lower one where the centre lies between two.
    let voxels_of = [0, 1, 2].map(|a| -> Vec<Option<usize>> {
        let inside = |centre: f64| ((centre - SLIVER).ceil() as usize).saturating_sub(1);
        (0..dims[a])
            .map(|c| Some(inside((c as f64 + 0.5) * ratio[a])).filter(|&v| v < grid.dims()[a]))
            .collect()
    });

    for &k in &voxels_of[2] {
        for &j in &voxels_of[1] {
            let row = j.zip(k);
            labels.extend(
                voxels_of[0].iter().map(|&i| i.zip(row).map_or(0, |(i, (j, k))| grid.label(i, j, k))),
            );
        }
    }
}

fn majority(grid: &LabelGrid, dims: [usize; 3], ratio: Vec3, labels: &mut Vec<u16>) {
    let [nx, ny, _] = grid.dims();
    let [along_x, along_y, along_z] = [0, 1, 2].map(|a| Overlaps::new(grid.dims()[a], dims[a], ratio[a]));
    let mut votes = Votes::new();

    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let (first_x, parts_x) = along_x.of(x);
                for (k, part_z) in along_z.voxels(z) {
                    for (j, part_y) in along_y.voxels(y) {
                        let row = first_x + nx * (j + ny * k);
                        votes.add_row(&grid.labels()[row..row + parts_x.len()], parts_x, part_y * part_z);
                    }
                }
                labels.push(votes.elect());
            }
        }
    }
}

/// How the cells of one axis overlap its voxels.
struct Overlaps {
    /// The first voxel of each cell `[cells]`.
    first: Vec<usize>,
    /// Where each cell's parts start `[cells + 1]`.
    start: Vec<usize>,
    /// Shares of a cell's length, cell after cell. They sum to 1 where the cell lies inside the grid.
    parts: Vec<f64>,
}

impl Overlaps {
    fn new(voxels: usize, cells: usize, ratio: f64) -> Self {
        let boundary = |cell: usize| {
            let x = cell as f64 * ratio;
            let on_voxel = x.round();
            if (x - on_voxel).abs() < SLIVER.min(SLIVER * ratio) { on_voxel } else { x }
        };
        let mut overlaps = Self { first: Vec::new(), start: vec![0], parts: Vec::new() };
        for cell in 0..cells {
            let (low, high) = (boundary(cell), boundary(cell + 1));
            let first = (low as usize).min(voxels);
            let end = (high.ceil() as usize).min(voxels);
            overlaps.first.push(first);
            overlaps.parts.extend(
                (first..end).map(|v| ((v as f64 + 1.0).min(high) - (v as f64).max(low)) / (high - low)),
            );
            overlaps.start.push(overlaps.parts.len());
        }
        overlaps
    }

    /// The first voxel and the parts of one cell.
    fn of(&self, cell: usize) -> (usize, &[f64]) {
        (self.first[cell], &self.parts[self.start[cell]..self.start[cell + 1]])
    }

    /// The voxels of one cell with their parts.
    fn voxels(&self, cell: usize) -> impl Iterator<Item = (usize, f64)> {
        let (first, parts) = self.of(cell);
        parts.iter().enumerate().map(move |(n, &part)| (first + n, part))
    }
}

/// The shares of the labels in one cell.
struct Votes {
    /// The label that was added last; neighbours are mostly equal, so it is kept at hand.
    label: u16,
    /// Its share so far.
    share: f64,
    /// Shares of labels seen before it `[65536]`; 0 for labels that are not in `seen`.
    share_of: Vec<f64>,
    /// Labels that have an entry in `share_of`.
    seen: Vec<u16>,
}

impl Votes {
    fn new() -> Self {
        Self { label: 0, share: 0.0, share_of: vec![0.0; 1 << 16], seen: Vec::new() }
    }

    fn add_row(&mut self, labels: &[u16], parts: &[f64], area: f64) {
        for (&label, &part) in labels.iter().zip(parts) {
            if label != self.label {
                self.set_aside();
                self.label = label;
            }
            self.share += part * area;
        }
    }

    /// Moves the label at hand to the others.
    fn set_aside(&mut self) {
        if self.share > 0.0 {
            let entry = &mut self.share_of[usize::from(self.label)];
            if *entry == 0.0 {
                self.seen.push(self.label);
            }
            *entry += self.share;
            self.share = 0.0;
        }
    }

    /// The winner, space outside the grid voting for label 0. Leaves no votes.
    fn elect(&mut self) -> u16 {
        if self.seen.is_empty() && self.share > 0.5 + TIE {
            self.share = 0.0;
            return self.label;
        }
        self.set_aside();
        let outside = 1.0 - self.seen.iter().map(|&l| self.share_of[usize::from(l)]).sum::<f64>();
        (self.label, self.share) = (0, outside.max(0.0));
        self.set_aside();

        let most = self.seen.iter().map(|&l| self.share_of[usize::from(l)]).fold(0.0, f64::max);
        let tied = self.seen.iter().filter(|&&l| self.share_of[usize::from(l)] >= most - TIE);
        let winner = tied.min().copied().unwrap_or(0);
        for label in self.seen.drain(..) {
            self.share_of[usize::from(label)] = 0.0;
        }
        winner
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Quat;

    const BOTH: [ResampleRule; 2] = [ResampleRule::Nearest, ResampleRule::Majority];

    fn posed() -> Pose {
        Pose::from_parts(Vec3::new(0.3, -0.1, 0.7).into(), Quat::from_euler_angles(0.2, 1.1, -2.0))
    }

    /// A row of voxels along x, 1 mm each, one voxel thick.
    fn row(labels: &[u16]) -> LabelGrid {
        LabelGrid::new([labels.len(), 1, 1], Vec3::repeat(1e-3), Pose::identity(), labels.to_vec()).unwrap()
    }

    /// A pattern with no symmetry, so that any mixed-up index shows.
    fn pattern(dims: [usize; 3], spacing: Vec3) -> LabelGrid {
        let count = dims.iter().product::<usize>() as u64;
        let labels = (0..count).map(|n| (n.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 61) as u16).collect();
        LabelGrid::new(dims, spacing, posed(), labels).unwrap()
    }

    #[test]
    fn resampling_to_the_own_spacing_changes_nothing() {
        // Single precision as in files, so that the ratio is only almost 1.
        for spacing in [1e-3, f64::from(0.7_f32) * 1e-3] {
            let grid = pattern([13, 7, 5], Vec3::repeat(spacing));
            for rule in BOTH {
                let same = grid.resample(0.7e-3_f64.max(spacing), rule).unwrap();
                assert_eq!((same.dims(), same.labels()), (grid.dims(), grid.labels()), "{rule:?}");
                assert!((same.frame().translation.vector - grid.frame().translation.vector).norm() < 1e-10);
            }
        }
    }

    #[test]
    fn exact_multiples_gain_no_cell_and_a_rest_gains_one() {
        for (voxels, ratio, cells) in
            [(12, 3.0, 4), (13, 3.0, 5), (10, 0.1, 100), (7, 1.0 / 3.0, 21), (2, 9.0, 1)]
        {
            for noise in [1.0 - 1e-7, 1.0, 1.0 + 1e-7] {
                assert_eq!(cell_count(voxels, ratio * noise), cells, "{voxels} voxels, {ratio} per cell");
            }
        }
    }

    #[test]
    fn the_low_corner_of_the_grid_stays_in_place() {
        let spacing = Vec3::new(1e-3, 2e-3, 0.5e-3);
        let grid = pattern([6, 3, 12], spacing);
        let coarse = grid.resample(1.5e-3, ResampleRule::Majority).unwrap();

        let corner = |g: &LabelGrid| g.frame() * nalgebra::Point3::from(-g.spacing() / 2.0);
        assert!((corner(&grid) - corner(&coarse)).norm() < 1e-15);
        assert_eq!(coarse.dims(), [4, 4, 4]);
        assert_eq!(coarse.frame().rotation, grid.frame().rotation);
    }

    #[test]
    fn majority_weighs_parts_of_voxels_by_volume() {
        // Cells of 1.5 voxels: [0, 1.5) holds 1 of label 5 and 0.5 of label 3; [1.5, 3) holds 0.5 of 3 and 1
        // of 4.
        let cells = row(&[5, 3, 4]).resample(1.5e-3, ResampleRule::Majority).unwrap();
        // The row is 1 mm thick, so a third of each cell lies outside along y and z: 1 − 4/9 of it votes for
        // 0.
        assert_eq!((cells.dims(), cells.labels()), ([2, 1, 1], &[0, 0][..]));

        let mut slab = Vec::new();
        (0..9).for_each(|_| slab.extend([5, 3, 4]));
        let slab = LabelGrid::new([3, 3, 3], Vec3::repeat(1e-3), Pose::identity(), slab).unwrap();
        assert_eq!(slab.resample(1.5e-3, ResampleRule::Majority).unwrap().labels(), &[5, 4].repeat(4)[..]);
    }

    #[test]
    fn majority_agrees_with_counting_fine_samples() {
        // Each cell is cut into 4³ points, far from every voxel boundary of these ratios; the counts are
        // exact volumes.
        let spacing = Vec3::new(1.0e-3, 0.5e-3, 2.0e-3);
        let grid = pattern([9, 14, 5], spacing);
        let cell = 2.0e-3;
        let coarse = grid.resample(cell, ResampleRule::Majority).unwrap();
        assert_eq!(coarse.dims(), [5, 4, 5]);

        for z in 0..5 {
            for y in 0..4 {
                for x in 0..5 {
                    let mut counts = [0; 8];
                    for n in 0..64 {
                        let at = |c: usize, m: usize, s: f64| {
                            ((c as f64 + (m as f64 + 0.5) / 4.0) * cell / s).floor() as usize
                        };
                        let (i, j, k) =
                            (at(x, n % 4, spacing.x), at(y, n / 4 % 4, spacing.y), at(z, n / 16, spacing.z));
                        let is_inside = i < 9 && j < 14 && k < 5;
                        counts[if is_inside { usize::from(grid.label(i, j, k)) } else { 0 }] += 1;
                    }
                    let most = *counts.iter().max().unwrap();
                    let expected = counts.iter().position(|&c| c == most).unwrap() as u16;
                    assert_eq!(coarse.label(x, y, z), expected, "cell {x} {y} {z}: {counts:?}");
                }
            }
        }
    }

    #[test]
    fn ties_go_to_the_smaller_label_in_any_order() {
        for labels in [[7, 2], [2, 7]] {
            let square = [labels, labels, labels, labels].concat();
            let grid = LabelGrid::new([2, 2, 2], Vec3::repeat(1e-3), Pose::identity(), square).unwrap();
            assert_eq!(grid.resample(2e-3, ResampleRule::Majority).unwrap().labels(), [2]);
        }
    }

    #[test]
    fn nearest_takes_the_lower_of_two_equally_near_voxels() {
        let grid = pattern([8, 6, 4], Vec3::repeat(f64::from(1.1_f32) * 1e-3));
        let every_second = grid.resample(2.2e-3, ResampleRule::Nearest).unwrap();
        assert_eq!(every_second.dims(), [4, 3, 2]);
        for (n, &label) in every_second.labels().iter().enumerate() {
            assert_eq!(label, grid.label(2 * (n % 4), 2 * (n / 4 % 3), 2 * (n / 12)));
        }
    }

    #[test]
    fn finer_cells_repeat_their_voxel() {
        let grid = pattern([3, 4, 5], Vec3::new(1e-3, 2e-3, 3e-3));
        for rule in BOTH {
            let fine = grid.resample(0.5e-3, rule).unwrap();
            assert_eq!(fine.dims(), [6, 16, 30]);
            for (n, &label) in fine.labels().iter().enumerate() {
                assert_eq!(label, grid.label(n % 6 / 2, n / 6 % 16 / 4, n / 96 / 6));
            }
        }
    }

    #[test]
    fn a_cell_whose_centre_is_outside_is_label_0() {
        assert_eq!(row(&[4, 4]).resample(5e-3, ResampleRule::Nearest).unwrap().labels(), [0]);
    }

    #[test]
    fn impossible_cells_are_refused() {
        let grid = pattern([30, 30, 30], Vec3::repeat(1e-2));
        for cell in [0.0, -1e-3, f64::NAN, f64::INFINITY, 2.0, 1e-6] {
            assert!(grid.resample(cell, ResampleRule::Majority).is_err(), "{cell}");
        }
    }
}
