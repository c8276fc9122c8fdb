//! Six-dimensional motion and wrench, and the matrices between them.
//!
//! Everything is in world axes about the tool's origin: displacements are a translation in m and a rotation vector in rad, velocities their rates,
//! wrenches a force in N and a torque in N m. A stiffness is then `[N/m, N/rad; N m/m, N m/rad]`, and so on.

use nalgebra::SymmetricEigen;

use crate::math::{Mat3, Mat6, Pose, Quat, Vec3, Vec6};
use crate::solver::tool::{ToolMotion, Wrench};

/// Largest eigenvalues of the two diagonal blocks of a stiffness or a damping.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockLimit {
    /// Of the block between translation and force: N/m, or N s/m.
    pub linear: f64,
    /// Of the block between rotation and torque: N m/rad, or N m s/rad.
    pub angular: f64,
}

/// What bounds a contact model's two matrices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImpedanceLimits {
    /// Of K: N/m, and N m/rad.
    pub stiffness: BlockLimit,
    /// Of B: N s/m, and N m s/rad.
    pub damping: BlockLimit,
}

/// No entry of a stiffness or damping is larger; the squares of larger ones would not be finite.
const ABSURD: f64 = 1e100;

/// A sweep of the QR iteration takes a few steps for each of three eigenvalues; what needs more is not finite.
const MOST_SWEEPS: usize = 60;

/// The way from one pose to another.
#[inline(always)]
pub fn displacement(from: &Pose, to: &Pose) -> Vec6 {
    let linear = to.translation.vector - from.translation.vector;
    stack(linear, turn(&(to.rotation * from.rotation.inverse())))
}

/// Largest square of the tangent of half an angle for which the series below is exact to rounding: angles up to 0.02 rad, more than a tool
/// turns between two solves.
const SHORT: f64 = 1e-4;

/// The rotation vector. Short ones, which are all that a servo loop meets, come from the series of the arc tangent, as trigonometry would take
/// most of a tick.
#[inline]
fn turn(rotation: &Quat) -> Vec3 {
    let (w, v) = (rotation.w, rotation.imag());
    let over_w = 1.0 / w;
    let square = v.norm_squared() * (over_w * over_w);
    // Written so that a NaN takes the long way.
    if square < SHORT {
        v * (2.0 * over_w * (1.0 - square * (1.0 / 3.0 - square * (1.0 / 5.0 - square * (1.0 / 7.0)))))
    } else {
        rotation.scaled_axis()
    }
}

/// Linear and angular velocity.
pub fn velocity(motion: &ToolMotion) -> Vec6 {
    stack(motion.linear_m_s, motion.angular_rad_s)
}

/// Force and torque.
pub fn stacked(wrench: &Wrench) -> Vec6 {
    stack(wrench.force_n, wrench.torque_n_m)
}

/// The wrench of six numbers.
pub fn wrench(w: &Vec6) -> Wrench {
    Wrench { force_n: linear(w), torque_n_m: angular(w) }
}

/// The first three numbers.
pub fn linear(v: &Vec6) -> Vec3 {
    Vec3::new(v.x, v.y, v.z)
}

/// The last three numbers.
pub fn angular(v: &Vec6) -> Vec3 {
    Vec3::new(v.w, v.a, v.b)
}

fn stack(linear: Vec3, angular: Vec3) -> Vec6 {
    Vec6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

/// The same block for all directions of translation, and one for all of rotation.
pub fn isotropic(linear: f64, angular: f64) -> Mat6 {
    Mat6::from_diagonal(&stack(Vec3::repeat(linear), Vec3::repeat(angular)))
}

/// The nearest thing to `matrix` that a device can render: symmetric, positive semidefinite, and no diagonal block above its limit. A
/// matrix that is all of that stays as it is, but for rounding; one that is not finite becomes zero. Allocates nothing.
///
/// The blocks are clamped by eigenvalue, because clamping entries would turn the directions. What couples them is then weakened no more than
/// it must be for the whole to stay semidefinite: `[A C; Cᵀ D]` is that exactly if C = √A M √D with ‖M‖ ≤ 1.
pub fn clamped(matrix: &Mat6, limit: &BlockLimit) -> Mat6 {
    // Written so that a NaN is absurd too.
    if !matrix.iter().all(|x| x.abs() <= ABSURD) {
        return Mat6::zeros();
    }
    let symmetric = (matrix + matrix.transpose()) / 2.0;
    let (Some(a), Some(d)) = (
        Roots::of(symmetric.fixed_view::<3, 3>(0, 0).into(), limit.linear),
        Roots::of(symmetric.fixed_view::<3, 3>(3, 3).into(), limit.angular),
    ) else {
        return Mat6::zeros();
    };
    let coupling: Mat3 = symmetric.fixed_view::<3, 3>(0, 3).into();
    let mut between = a.inverse * coupling * d.inverse;
    let norm = between.norm();
    // The Frobenius norm bounds the spectral one; only where it does not settle the matter is that looked for.
    if norm > 1.0 {
        let Some(squares) = SymmetricEigen::try_new(between * between.transpose(), f64::EPSILON, MOST_SWEEPS)
        else {
            return Mat6::zeros();
        };
        between /= squares.eigenvalues.max().sqrt().max(1.0);
    }
    let coupling = a.root * between * d.root;
    let mut result = Mat6::zeros();
    result.fixed_view_mut::<3, 3>(0, 0).copy_from(&a.block);
    result.fixed_view_mut::<3, 3>(3, 3).copy_from(&d.block);
    result.fixed_view_mut::<3, 3>(0, 3).copy_from(&coupling);
    result.fixed_view_mut::<3, 3>(3, 0).copy_from(&coupling.transpose());
    result
}

/// A clamped diagonal block, its square root, and the root's inverse where it has one (zero elsewhere).
struct Roots {
    block: Mat3,
    root: Mat3,
    inverse: Mat3,
}

impl Roots {
    fn of(block: Mat3, limit: f64) -> Option<Self> {
        let eigen = SymmetricEigen::try_new(block, f64::EPSILON, MOST_SWEEPS)?;
        let values = eigen.eigenvalues.map(|x| x.clamp(0.0, limit.max(0.0)));
        // Rounding leaves small eigenvalues where there are none; their inverse roots would let rounding through.
        let least = 1e-12 * values.max();
        let with = |f: &dyn Fn(f64) -> f64| {
            let m = eigen.eigenvectors * Mat3::from_diagonal(&values.map(f)) * eigen.eigenvectors.transpose();
            (m + m.transpose()) / 2.0
        };
        Some(Self {
            block: with(&|x| x),
            root: with(&f64::sqrt),
            inverse: with(&|x| if x > least { 1.0 / x.sqrt() } else { 0.0 }),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Quat;

    const LIMIT: BlockLimit = BlockLimit { linear: 700.0, angular: 2.0 };

    /// A rank-three stiffness: a point of the tool, off its origin, held by three different springs.
    fn held_at_a_point(stiffness: Vec3, arm: Vec3) -> Mat6 {
        let turned = Quat::from_scaled_axis(Vec3::new(0.3, -0.8, 0.5)).to_rotation_matrix();
        let springs = turned * Mat3::from_diagonal(&stiffness) * turned.inverse();
        let mut to_point = nalgebra::Matrix3x6::zeros();
        to_point.fixed_view_mut::<3, 3>(0, 0).copy_from(&Mat3::identity());
        to_point.fixed_view_mut::<3, 3>(0, 3).copy_from(&-arm.cross_matrix());
        to_point.transpose() * springs * to_point
    }

    fn eigenvalues(m: &Mat6) -> Vec6 {
        m.symmetric_eigenvalues()
    }

    #[test]
    fn a_stiffness_within_the_limits_stays_as_it_is() {
        let springs = held_at_a_point(Vec3::new(100.0, 200.0, 300.0), Vec3::new(0.01, -0.03, 0.02));
        let kept = clamped(&springs, &LIMIT);
        assert!((kept - springs).norm() < 1e-9 * springs.norm(), "{kept} for {springs}");
    }

    #[test]
    fn each_block_is_clamped_by_eigenvalue_and_the_whole_stays_semidefinite() {
        let springs = held_at_a_point(Vec3::new(100.0, 2000.0, 5000.0), Vec3::new(0.1, -0.05, 0.02));
        let kept = clamped(&springs, &LIMIT);
        let block = kept.fixed_view::<3, 3>(0, 0).into_owned().symmetric_eigenvalues();
        assert!((block.max() - 700.0).abs() < 1e-9, "{block}");
        assert!((block.min() - 100.0).abs() < 1e-6, "what is soft stays soft: {block}");
        let turning = kept.fixed_view::<3, 3>(3, 3).into_owned().symmetric_eigenvalues();
        assert!(turning.max() < 2.0 + 1e-9, "{turning}");
        let all = eigenvalues(&kept);
        assert!(all.min() > -1e-9 * all.max(), "{all}");
        assert!(kept.fixed_view::<3, 3>(0, 3).norm() > 1.0, "the coupling is not thrown away");
    }

    #[test]
    fn what_gives_energy_is_taken_out() {
        let mut noise = crate::noise::Noise(7);
        for _ in 0..200 {
            // Not symmetric, indefinite, with every kind of coupling.
            let raw = Mat6::from_fn(|_, _| 1000.0 * noise.next());
            let kept = clamped(&raw, &LIMIT);
            assert_eq!(kept, kept.transpose());
            let all = eigenvalues(&kept);
            assert!(all.min() > -1e-9 * all.max(), "{all}");
            assert!(kept.fixed_view::<3, 3>(0, 0).into_owned().symmetric_eigenvalues().max() < 700.0 + 1e-6);
        }
    }

    #[test]
    fn what_is_not_finite_becomes_nothing() {
        for bad in [f64::NAN, f64::INFINITY] {
            let mut springs = isotropic(100.0, 1.0);
            springs[(2, 4)] = bad;
            assert_eq!(clamped(&springs, &LIMIT), Mat6::zeros());
        }
        assert_eq!(clamped(&isotropic(f64::MAX, 1.0), &LIMIT), Mat6::zeros());
        assert!((clamped(&isotropic(1e99, 1.0), &LIMIT) - isotropic(700.0, 1.0)).norm() < 1e-9);
    }

    #[test]
    fn a_displacement_takes_the_short_way_round() {
        let from = Pose::new(Vec3::new(1.0, 2.0, 3.0), Vec3::z() * 3.0);
        let to = Pose::new(Vec3::new(1.0, 2.0, 3.5), Vec3::z() * -3.0);
        let way = displacement(&from, &to);
        assert!((linear(&way) - Vec3::z() * 0.5).norm() < 1e-12);
        let angle = 2.0 * std::f64::consts::PI - 6.0;
        assert!((angular(&way) - Vec3::z() * angle).norm() < 1e-12, "{way}");
    }
}
