//! A grid of intensities, such as Hounsfield units of a CT, and labels from it by thresholds.

use nalgebra::Matrix3x4;

use super::grid::LabelGrid;
use super::placement::{Placement, reverse_x};
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};

/// Intensities of a regular grid of voxels, placed in the world as a [`LabelGrid`] is.
///
/// Values are single precision whatever the file held: every 16-bit scanner value is exact in it.
#[derive(Clone, Debug)]
pub struct IntensityGrid {
    placement: Placement,
    values: Vec<f32>,
}

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
    /// A grid from intensities in memory, x fastest. `affine` maps a voxel index to the centre of that voxel
    /// in the world, in metres; see [`LabelGrid::from_affine`].
    pub fn from_affine(dims: [usize; 3], affine: &Matrix3x4<f64>, mut values: Vec<f32>) -> Result<Self> {
        let (placement, is_reversed) = Placement::from_affine(dims, affine)?;
        if values.len() != placement.count() {
            return Err(Error::argument(format!(
                "a grid of {dims:?} voxels needs {} intensities, not {}",
                placement.count(),
                values.len()
            )));
        }
        if is_reversed {
            reverse_x(&mut values, dims);
        }
        Ok(Self { placement, values })
    }

    /// Voxel counts along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.placement.dims
    }

    /// Distance of neighbouring voxel centres along x, y, z, in metres.
    pub fn spacing(&self) -> Vec3 {
        self.placement.spacing
    }

    /// Grid axes to world; the translation is the centre of voxel (0, 0, 0).
    pub fn frame(&self) -> Pose {
        self.placement.frame
    }

    /// All intensities, x fastest.
    pub fn values(&self) -> &[f32] {
        &self.values
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
        LabelGrid::from_placement(self.placement.clone(), self.values.iter().map(|&v| label(v)).collect())
    }
}

#[cfg(test)]
mod tests {
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

    #[test]
    fn left_handed_intensities_stay_where_they_were() {
        let affine = Matrix3x4::new(-1e-3, 0.0, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 1e-3, 0.0);
        let grid = IntensityGrid::from_affine([3, 1, 1], &affine, vec![1.0, 2.0, 3.0]).unwrap();
        assert_eq!(grid.values(), [3.0, 2.0, 1.0]);
        assert!((grid.frame().translation.vector.x - -2e-3).abs() < 1e-15);
    }
}
