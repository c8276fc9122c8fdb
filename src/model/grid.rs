//! Regular grids of voxels with their place in the world: labels, or intensities.
//!
//! Voxel `(i, j, k)` lies at `voxels[i + nx * (j + ny * k)]` and its **centre** at
//! `frame * (i * spacing.x, j * spacing.y, k * spacing.z)`, in metres, in a right-handed world.

use nalgebra::Matrix3x4;

use super::placement::{Placement, reverse_x};
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};

/// Most voxels that a grid may have: 2³¹, so that an index always fits and a hostile header cannot ask for
/// terabytes.
pub const MAX_VOXELS: usize = 1 << 31;

/// A regular grid of voxels: a [`LabelGrid`] or an [`IntensityGrid`](super::intensity::IntensityGrid).
#[derive(Clone, Debug)]
pub struct Grid<T> {
    placement: Placement,
    voxels: Vec<T>,
}

/// One integer for each voxel. Label 0 is a label like any other; what is empty is said when a model is built.
pub type LabelGrid = Grid<u16>;

/// How a coarser (or finer) cubic cell takes its label from the voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResampleRule {
    /// The voxel that contains the centre of the cell.
    Nearest,
    /// The label that fills the largest part of the cell; of equal parts the smaller label. Space outside the
    /// grid counts as label 0.
    Majority,
}

impl<T> Grid<T> {
    /// A grid from voxels in memory, x fastest.
    ///
    /// `dims` is the voxel count along x, y, z; `spacing` the distance of neighbouring centres in metres;
    /// `frame` maps grid axes to the world, its translation being the centre of voxel (0, 0, 0).
    pub fn new(dims: [usize; 3], spacing: Vec3, frame: Pose, voxels: Vec<T>) -> Result<Self> {
        Self::from_placement(Placement::new(dims, spacing, frame)?, voxels)
    }

    /// A grid from voxels in memory, x fastest, and the affine matrix that files carry.
    ///
    /// `affine` maps a voxel index (i, j, k, 1) to the centre of that voxel in the world, in metres; its axes
    /// may have any direction and each its own spacing. Axes more than 0.06° from square are refused. A
    /// left-handed matrix is accepted: the voxels are then reversed along x, so that the grid's frame is
    /// right-handed and every voxel stays where it was.
    pub fn from_affine(dims: [usize; 3], affine: &Matrix3x4<f64>, mut voxels: Vec<T>) -> Result<Self> {
        let (placement, is_reversed) = Placement::from_affine(dims, affine)?;
        if is_reversed {
            reverse_x(&mut voxels, dims);
        }
        Self::from_placement(placement, voxels)
    }

    pub(crate) fn from_placement(placement: Placement, voxels: Vec<T>) -> Result<Self> {
        if voxels.len() != placement.count() {
            return Err(Error::argument(format!(
                "a grid of {:?} voxels needs {} values, not {}",
                placement.dims,
                placement.count(),
                voxels.len()
            )));
        }
        Ok(Self { placement, voxels })
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

    pub(super) fn placement(&self) -> &Placement {
        &self.placement
    }

    pub(super) fn voxels(&self) -> &[T] {
        &self.voxels
    }
}

impl LabelGrid {
    /// All labels, x fastest.
    pub fn labels(&self) -> &[u16] {
        self.voxels()
    }

    /// The label of one voxel. The indices must lie inside the grid.
    pub fn label(&self, i: usize, j: usize, k: usize) -> u16 {
        let [nx, ny, _] = self.placement.dims;
        self.voxels[i + nx * (j + ny * k)]
    }
}

/// The number of voxels, refused when there is none or there are more than [`MAX_VOXELS`].
pub fn voxel_count(dims: [usize; 3]) -> Result<usize> {
    if dims.contains(&0) {
        return Err(Error::argument(format!("a grid of {dims:?} voxels is empty")));
    }
    let count = dims.iter().try_fold(1_usize, |n, &d| n.checked_mul(d)).filter(|&n| n <= MAX_VOXELS);
    count.ok_or_else(|| Error::Limit(format!("a grid of {dims:?} voxels has more than {MAX_VOXELS}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn left_handed_labels_stay_where_they_were() {
        let labels: Vec<u16> = (0..24).collect();
        // x runs towards −x from 9 mm, as in radiological storage.
        let affine = Matrix3x4::new(-1e-3, 0.0, 0.0, 9e-3, 0.0, 2e-3, 0.0, 0.0, 0.0, 0.0, 3e-3, 0.0);
        let grid = LabelGrid::from_affine([2, 3, 4], &affine, labels).unwrap();

        // The file's voxel (1, 2, 3), label 23, lies at (8, 4, 9) mm and is now voxel (0, 2, 3).
        assert_eq!(grid.label(0, 2, 3), 23);
        let centre = grid.frame() * nalgebra::Point3::new(0.0, 2.0 * 2e-3, 3.0 * 3e-3);
        assert!((centre.coords - Vec3::new(8e-3, 4e-3, 9e-3)).norm() < 1e-15);
        assert_eq!(grid.frame().rotation, crate::math::Quat::identity());
    }

    #[test]
    fn a_wrong_number_of_labels_is_refused() {
        let spacing = Vec3::repeat(1e-3);
        assert!(LabelGrid::new([2, 2, 2], spacing, Pose::identity(), vec![0; 7]).is_err());
        let affine = Matrix3x4::new(-1e-3, 0.0, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 1e-3, 0.0);
        assert!(LabelGrid::from_affine([2, 2, 2], &affine, vec![0; 9]).is_err());
    }

    #[test]
    fn grids_of_terabytes_are_refused_before_anything_else() {
        for dims in [[usize::MAX, 2, 2], [1 << 16, 1 << 16, 2]] {
            assert!(matches!(voxel_count(dims), Err(Error::Limit(_))));
        }
        assert!(matches!(voxel_count([0, 1, 1]), Err(Error::Argument(_))));
        assert_eq!(voxel_count([1 << 11, 1 << 10, 1 << 10]).unwrap(), MAX_VOXELS);
    }
}
