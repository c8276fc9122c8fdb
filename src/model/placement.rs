//! Where a grid of voxels lies in the world, whatever its voxels hold.

use nalgebra as na;

use super::grid::voxel_count;
use crate::error::{Error, Result};
use crate::math::{FAR_M, Mat3, Pose, Vec3};

/// Voxel to world: the first three columns are the steps along i, j, k, the last is the centre of voxel (0,
/// 0, 0); metres.
pub(crate) type Affine = na::Matrix3x4<f64>;

/// Largest cosine of the angle between two grid axes that still counts as a right angle: 0.06°. Files store
/// axes in single precision or with a few decimals; a tilted gantry is degrees away.
const SQUARE_COSINE: f64 = 1e-3;

/// Counts, spacing and frame of a grid. The frame's translation is the **centre** of voxel (0, 0, 0).
#[derive(Clone, Debug)]
pub(crate) struct Placement {
    pub(crate) dims: [usize; 3],
    pub(crate) spacing: Vec3,
    pub(crate) frame: Pose,
}

impl Placement {
    pub(crate) fn new(dims: [usize; 3], spacing: Vec3, frame: Pose) -> Result<Self> {
        voxel_count(dims)?;
        if !spacing.iter().all(|s| (1e-6..=1.0).contains(s)) {
            let [x, y, z] = spacing.into();
            return Err(Error::argument(format!(
                "voxel spacing ({x}, {y}, {z}) m is not between 1e-6 m and 1 m"
            )));
        }
        let is_near = frame.translation.vector.iter().all(|x| x.abs() <= FAR_M);
        if !is_near || !frame.rotation.coords.iter().all(|x| x.is_finite()) {
            return Err(Error::argument(format!(
                "the frame of a grid must be finite and within {FAR_M} m of the origin"
            )));
        }
        Ok(Self { dims, spacing, frame })
    }

    /// The placement that an affine matrix describes, and whether the voxels must be reversed along x to fit
    /// it: a left-handed matrix becomes right-handed by counting x from the other end.
    pub(crate) fn from_affine(dims: [usize; 3], affine: &Affine) -> Result<(Self, bool)> {
        voxel_count(dims)?;
        let mut axes: Mat3 = affine.fixed_columns::<3>(0).into();
        let mut origin: Vec3 = affine.column(3).into();
        if !affine.iter().all(|x| x.is_finite()) {
            return Err(Error::argument("the affine matrix of a grid must be finite"));
        }
        let spacing = Vec3::from_fn(|a, _| axes.column(a).norm());
        if spacing.min() <= 0.0 {
            return Err(Error::argument("an axis of the affine matrix has no length"));
        }

        let is_left_handed = axes.determinant() < 0.0;
        if is_left_handed {
            origin += axes.column(0) * (dims[0] - 1) as f64;
            axes.column_mut(0).neg_mut();
        }

        let frame = Pose::from_parts(origin.into(), nearest_rotation(axes, spacing)?);
        Ok((Self::new(dims, spacing, frame)?, is_left_handed))
    }

    /// The number of voxels.
    pub(crate) fn count(&self) -> usize {
        self.dims.iter().product()
    }
}

/// Reverses the order of the voxels along x.
pub(crate) fn reverse_x<T>(voxels: &mut [T], dims: [usize; 3]) {
    for row in voxels.chunks_exact_mut(dims[0]) {
        row.reverse();
    }
}

/// The rotation nearest to `axes` (columns of the given lengths), refused where the columns are not square to
/// each other.
fn nearest_rotation(axes: Mat3, lengths: Vec3) -> Result<na::UnitQuaternion<f64>> {
    let mut rotation = Mat3::from_fn(|r, c| axes[(r, c)] / lengths[c]);
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        let cosine = rotation.column(a).dot(&rotation.column(b));
        if cosine.abs() > SQUARE_COSINE {
            let degrees = cosine.clamp(-1.0, 1.0).acos().to_degrees();
            return Err(Error::argument(format!(
                "the voxel axes {} and {} meet at {degrees:.3}°, not at a right angle",
                ["x", "y", "z"][a],
                ["x", "y", "z"][b]
            )));
        }
    }
    // Newton's iteration for the polar factor: quadratic from 1e-3, and exact where the axes are exact.
    for _ in 0..4 {
        let inverse =
            rotation.try_inverse().ok_or_else(|| Error::argument("the affine matrix is singular"))?;
        rotation = 0.5 * (rotation + inverse.transpose());
    }
    Ok(na::UnitQuaternion::from_rotation_matrix(&na::Rotation3::from_matrix_unchecked(rotation)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn oblique_axes() -> Mat3 {
        let rotation = na::Rotation3::from_euler_angles(0.3, -0.7, 1.9);
        rotation.matrix() * Mat3::from_diagonal(&Vec3::new(0.7e-3, 1.1e-3, 3.0e-3))
    }

    fn affine(axes: Mat3, origin: Vec3) -> Affine {
        let mut m = Affine::zeros();
        m.fixed_columns_mut::<3>(0).copy_from(&axes);
        m.set_column(3, &origin);
        m
    }

    fn centre(p: &Placement, i: [usize; 3]) -> Vec3 {
        let index = Vec3::new(i[0] as f64, i[1] as f64, i[2] as f64);
        (p.frame * na::Point3::from(index.component_mul(&p.spacing))).coords
    }

    #[test]
    fn oblique_affine_keeps_every_voxel_centre() {
        let dims = [5, 7, 9];
        let m = affine(oblique_axes(), Vec3::new(0.1, -0.2, 0.3));
        let (p, is_reversed) = Placement::from_affine(dims, &m).unwrap();

        assert!(!is_reversed);
        assert!((p.spacing - Vec3::new(0.7e-3, 1.1e-3, 3.0e-3)).norm() < 1e-15);
        for i in [[0, 0, 0], [4, 0, 0], [0, 6, 0], [0, 0, 8], [4, 6, 8]] {
            let expected = m * na::Vector4::new(i[0] as f64, i[1] as f64, i[2] as f64, 1.0);
            assert!((centre(&p, i) - expected).norm() < 1e-14);
        }
    }

    #[test]
    fn left_handed_affine_counts_x_from_the_other_end() {
        let dims = [5, 7, 9];
        let mut axes = oblique_axes();
        axes.column_mut(2).neg_mut();
        let m = affine(axes, Vec3::new(0.1, -0.2, 0.3));
        let (p, is_reversed) = Placement::from_affine(dims, &m).unwrap();

        assert!(is_reversed);
        for i in [[0, 0, 0], [3, 1, 2], [4, 6, 8]] {
            let file_index = na::Vector4::new((dims[0] - 1 - i[0]) as f64, i[1] as f64, i[2] as f64, 1.0);
            assert!((centre(&p, i) - m * file_index).norm() < 1e-14);
        }
    }

    #[test]
    fn shear_is_refused_beyond_its_tolerance_and_only_there() {
        let sheared = |cosine: f64| {
            let axes = Mat3::new(1e-3, cosine * 1e-3, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3);
            Placement::from_affine([2, 2, 2], &affine(axes, Vec3::zeros()))
        };
        assert!(sheared(0.9 * SQUARE_COSINE).is_ok());
        let message = sheared(0.1).unwrap_err().to_string();
        assert!(message.contains("right angle") && message.contains("84.2"), "{message}");
    }

    #[test]
    fn signed_permutations_of_axes_are_exact() {
        let axes = Mat3::new(0.0, 0.0, -2e-3, 2e-3, 0.0, 0.0, 0.0, -2e-3, 0.0);
        let (p, _) = Placement::from_affine([4, 4, 4], &affine(axes, Vec3::zeros())).unwrap();
        assert!((p.frame.rotation.to_rotation_matrix().matrix() * 2e-3 - axes).norm() < 1e-18);
    }

    #[test]
    fn degenerate_affines_are_refused() {
        for bad in
            [Mat3::zeros(), Mat3::from_element(1e-3), Mat3::identity() * f64::NAN, Mat3::identity() * 1e300]
        {
            assert!(Placement::from_affine([2, 2, 2], &affine(bad, Vec3::zeros())).is_err());
        }
        let good = Mat3::identity() * 1e-3;
        assert!(Placement::from_affine([2, 0, 2], &affine(good, Vec3::zeros())).is_err());
        for far in [f64::INFINITY, 1e300, 2.0 * FAR_M] {
            assert!(Placement::from_affine([2, 2, 2], &affine(good, Vec3::repeat(far))).is_err());
        }
    }
}
