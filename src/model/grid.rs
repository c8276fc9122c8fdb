//! A label grid: one integer per voxel, with its place in the world.
//!
//! Voxel `(i, j, k)` lies at `labels[i + nx * (j + ny * k)]` and its **centre** at
//! `frame * (i * spacing.x, j * spacing.y, k * spacing.z)`, in metres, in a right-handed world.

use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};

/// Most voxels that a grid may have: 2³¹, so that an index always fits and a hostile header cannot ask for terabytes.
pub const MAX_VOXELS: usize = 1 << 31;

/// Labels of a regular grid of voxels. Label 0 is a label like any other; what is empty is said when a model is built.
#[derive(Clone, Debug)]
pub struct LabelGrid {
    dims: [usize; 3],
    spacing: Vec3,
    frame: Pose,
    labels: Vec<u16>,
}

/// How a coarser (or finer) cubic cell takes its label from the voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResampleRule {
    /// The voxel that contains the centre of the cell.
    Nearest,
    /// The label that fills the largest part of the cell; of equal parts the smaller label. Space outside the grid counts as
    /// label 0.
    Majority,
}

impl LabelGrid {
    /// A grid from labels in memory.
    ///
    /// `dims` is the voxel count along x, y, z; `spacing` the distance of neighbouring centres in metres; `frame` maps
    /// grid axes to the world, its translation being the centre of voxel (0, 0, 0).
    pub fn new(dims: [usize; 3], spacing: Vec3, frame: Pose, labels: Vec<u16>) -> Result<Self> {
        let count = voxel_count(dims)?;
        if labels.len() != count {
            return Err(Error::argument(format!(
                "a grid of {dims:?} voxels needs {count} labels, not {}",
                labels.len()
            )));
        }
        if !spacing.iter().all(|s| s.is_finite() && (1e-6..=1.0).contains(s)) {
            return Err(Error::argument(format!("voxel spacing {spacing:?} is not between 1e-6 m and 1 m")));
        }
        if !frame.to_homogeneous().iter().all(|x| x.is_finite()) {
            return Err(Error::argument("the frame of a grid must be finite"));
        }
        Ok(Self { dims, spacing, frame, labels })
    }

    /// Voxel counts along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Distance of neighbouring voxel centres along x, y, z, in metres.
    pub fn spacing(&self) -> Vec3 {
        self.spacing
    }

    /// Grid axes to world; the translation is the centre of voxel (0, 0, 0).
    pub fn frame(&self) -> Pose {
        self.frame
    }

    /// All labels, x fastest.
    pub fn labels(&self) -> &[u16] {
        &self.labels
    }

    /// The label of one voxel. The indices must lie inside the grid.
    pub fn label(&self, i: usize, j: usize, k: usize) -> u16 {
        self.labels[i + self.dims[0] * (j + self.dims[1] * k)]
    }
}

/// The number of voxels, refused when empty or above [`MAX_VOXELS`].
pub fn voxel_count(dims: [usize; 3]) -> Result<usize> {
    dims.iter().try_fold(1_usize, |n, &d| n.checked_mul(d)).filter(|&n| n > 0 && n <= MAX_VOXELS).ok_or_else(
        || Error::Limit(format!("a grid of {dims:?} voxels is empty or has more than {MAX_VOXELS}")),
    )
}
