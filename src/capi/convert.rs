//! Between the header's structs and the crate's types.

use nalgebra as na;

use super::boundary::{fill_text, read_text};
use super::status::{Fault, PLP_ERR_UNSUPPORTED};
use super::types::{
    PLP_BACKEND_AUTO, PLP_BACKEND_CPU, PLP_BACKEND_CUDA, plp_box, plp_material, plp_motion, plp_place,
    plp_pose,
};
use crate::math::{Pose, Quat, Vec3};
use crate::model::material::Material;
use crate::sim::{Backend, Place};
use crate::solver::tool::ToolMotion;

/// The pose in a host's struct, its quaternion normalised. `None` when it is not finite or its quaternion is
/// not nearly unit: the struct was probably never filled. Allocates nothing.
pub(super) fn try_pose(pose: &plp_pose) -> Option<Pose> {
    let [x, y, z, w] = pose.rotation;
    let quaternion = na::Quaternion::new(w, x, y, z);
    let finite = pose.position_m.iter().all(|p| p.is_finite());
    // A NaN is in no range.
    (finite && (0.9..=1.1).contains(&quaternion.norm())).then(|| {
        Pose::from_parts(na::Translation3::from(Vec3::from(pose.position_m)), Quat::new_normalize(quaternion))
    })
}

/// As [`try_pose`], with a message.
pub(super) fn pose(from: &plp_pose, what: &str) -> Result<Pose, Fault> {
    try_pose(from).ok_or_else(|| {
        Fault::argument(format!(
            "{what}: position {:?} must be finite and quaternion {:?} (x, y, z, w) of unit length",
            from.position_m, from.rotation
        ))
    })
}

/// A pose for a host.
pub(super) fn pose_out(pose: &Pose) -> plp_pose {
    plp_pose {
        position_m: pose.translation.vector.into(),
        rotation: pose.rotation.coords.into(), // stored as x, y, z, w
    }
}

/// The motion in a host's struct, if it is valid. Allocates nothing.
pub(super) fn try_motion(motion: &plp_motion) -> Option<ToolMotion> {
    try_pose(&motion.pose)
        .map(|pose| ToolMotion {
            pose,
            linear_m_s: motion.linear_m_s.into(),
            angular_rad_s: motion.angular_rad_s.into(),
        })
        .filter(ToolMotion::is_valid)
}

/// A motion for a host.
pub(super) fn motion_out(motion: &ToolMotion) -> plp_motion {
    plp_motion {
        pose: pose_out(&motion.pose),
        linear_m_s: motion.linear_m_s.into(),
        angular_rad_s: motion.angular_rad_s.into(),
    }
}

/// A box's pose and half extents, which must be positive.
pub(super) fn oriented_box(from: &plp_box, what: &str) -> Result<(Pose, Vec3), Fault> {
    if !from.half_extents_m.iter().all(|x| x.is_finite() && *x > 0.0) {
        return Err(Fault::argument(format!(
            "{what}: half extents {:?} must be positive",
            from.half_extents_m
        )));
    }
    Ok((pose(&from.pose, what)?, from.half_extents_m.into()))
}

/// A finite vector.
pub(super) fn vector(from: &[f64; 3], what: &str) -> Result<Vec3, Fault> {
    if from.iter().all(|x| x.is_finite()) {
        Ok((*from).into())
    } else {
        Err(Fault::argument(format!("{what} {from:?} is not finite")))
    }
}

/// The backend that a host asks for.
pub(super) fn backend(backend: u32, device: i32) -> Result<Backend, Fault> {
    match (backend, device) {
        (PLP_BACKEND_CPU, -1) => Ok(Backend::Cpu),
        (PLP_BACKEND_AUTO, -1) => Ok(Backend::Auto),
        (PLP_BACKEND_CUDA, -1) => Ok(Backend::Cuda { index: None }),
        (PLP_BACKEND_CUDA, index @ 0..) => Ok(Backend::Cuda { index: Some(index as u32) }),
        (PLP_BACKEND_CUDA, other) => {
            Err(Fault::argument(format!("device {other} is neither the number of a GPU nor -1")))
        }
        (PLP_BACKEND_CPU | PLP_BACKEND_AUTO, other) => {
            Err(Fault::argument(format!("device {other} can only be chosen for PLP_BACKEND_CUDA")))
        }
        (other, _) => Err(Fault::argument(format!("backend {other} is no PLP_BACKEND_ value"))),
    }
}

/// A simulation's place for a host.
pub(super) fn place_out(place: &Place) -> plp_place {
    let (backend, device) = match place.backend {
        Backend::Cuda { index: Some(index) } => (PLP_BACKEND_CUDA, index as i32),
        _ => (PLP_BACKEND_CPU, -1),
    };
    let fallback = place.fallback.as_deref().unwrap_or_default();
    plp_place { backend, device, name: fill_text(&place.device), fallback: fill_text(fallback) }
}

/// A checked material.
pub(super) fn material(from: &plp_material, what: &str) -> Result<Material, Fault> {
    let material = Material {
        name: read_text(&from.name, &format!("{what}: the material's name"))?,
        young_pa: from.young_pa,
        poisson: from.poisson,
        density_kg_m3: from.density_kg_m3,
        damping_s: from.damping_s,
    };
    material.check().map_err(|error| Fault::argument(format!("{what}: {error}")))?;
    Ok(material)
}

/// A material for a host.
pub(super) fn material_out(material: &Material) -> plp_material {
    plp_material {
        young_pa: material.young_pa,
        poisson: material.poisson,
        density_kg_m3: material.density_kg_m3,
        damping_s: material.damping_s,
        name: fill_text(&material.name),
    }
}

/// Refuses flag bits and reserved fields that only a newer library would know.
pub(super) fn check_bits(bits: u32, known: u32, what: &str) -> Result<(), Fault> {
    if bits & !known == 0 {
        return Ok(());
    }
    Err(Fault::new(
        PLP_ERR_UNSUPPORTED,
        format!("{what} has bits {:#x} that mean nothing here", bits & !known),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(rotation: [f64; 4]) -> Option<Pose> {
        try_pose(&plp_pose { position_m: [1.0, 2.0, 3.0], rotation })
    }

    #[test]
    fn quaternions_are_x_y_z_w_and_normalised() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        // A quarter turn about z, given 5 % too long.
        let pose = turned([0.0, 0.0, 1.05 * half, 1.05 * half]).unwrap();
        let moved = pose * na::Point3::new(1.0, 0.0, 0.0);
        assert!((moved - na::Point3::new(1.0, 3.0, 3.0)).norm() < 1e-15);
        assert_eq!(pose_out(&pose).position_m, [1.0, 2.0, 3.0]);
    }

    #[test]
    fn quaternions_of_no_length_are_refused() {
        for bad in [[0.0; 4], [f64::NAN; 4], [f64::INFINITY, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 2.0]] {
            assert!(turned(bad).is_none(), "{bad:?}");
        }
    }
}
