//! A grid of intensities, such as Hounsfield units of a CT, and labels from it by thresholds.

use super::grid::{Grid, LabelGrid};
use crate::error::{Error, Result};

/// Intensities of a regular grid of voxels.
///
/// Values are single precision whatever the file held: every 16-bit scanner value is exact in it.
pub type IntensityGrid = Grid<f32>;

/// Intensities that stand for one label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HounsfieldRange {
    /// Lowest intensity of the range, in Hounsfield units (or the file's own unit). Included.
    pub low: f32,
    /// Highest intensity of the range. Included.
    pub high: f32,
    /// The label of voxels in the range.
    pub label: u16,
}

impl IntensityGrid {
    /// All intensities, x fastest.
    pub fn values(&self) -> &[f32] {
        self.voxels()
    }

    /// Labels by thresholds: the first range that holds a voxel names its label; voxels in no range, and
    /// voxels that are not a number, get label 0.
    pub fn to_labels(&self, ranges: &[HounsfieldRange]) -> Result<LabelGrid> {
        // Written so that a bound which is not a number is refused too.
        if let Some(bad) = ranges.iter().find(|r| !matches!(r.low.partial_cmp(&r.high), Some(o) if o.is_le()))
        {
            return Err(Error::argument(format!(
                "the range from {} to {} of label {} is empty",
                bad.low, bad.high, bad.label
            )));
        }
        let label = |v: f32| ranges.iter().find(|r| r.low <= v && v <= r.high).map_or(0, |r| r.label);
        LabelGrid::from_placement(self.placement().clone(), self.values().iter().map(|&v| label(v)).collect())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3x4;

    use super::*;

    fn row(values: &[f32]) -> IntensityGrid {
        let affine = Matrix3x4::new(1e-3, 0.0, 0.0, 0.5, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 2e-3, 0.0);
        IntensityGrid::from_affine([values.len(), 1, 1], &affine, values.to_vec()).unwrap()
    }

    #[test]
    fn the_first_matching_range_names_the_label() {
        let range = |low, high, label| HounsfieldRange { low, high, label };
        let grid = row(&[-1000.0, -500.0, -200.0, 0.0, 300.0, 301.0, f32::NAN]);
        let labels = grid
            .to_labels(&[range(-500.0, -200.0, 1), range(-500.0, 0.0, 2), range(300.0, 300.0, 3)])
            .unwrap();
        assert_eq!(labels.labels(), [0, 1, 1, 2, 3, 0, 0]);
        assert_eq!(
            (labels.dims(), labels.spacing(), labels.frame()),
            (grid.dims(), grid.spacing(), grid.frame())
        );
    }

    #[test]
    fn empty_ranges_are_refused() {
        for (low, high) in [(1.0, 0.0), (f32::NAN, 0.0), (0.0, f32::NAN)] {
            assert!(row(&[0.0]).to_labels(&[HounsfieldRange { low, high, label: 1 }]).is_err());
        }
    }
}
