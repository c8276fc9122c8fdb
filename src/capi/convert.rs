//! Between the header's structs and the crate's types.

use nalgebra as na;

use super::boundary::{fill_text, read_text};
use super::status::{Fault, PLP_ERR_UNSUPPORTED};
use super::types::{
    PLP_AXIS_ALL, PLP_BACKEND_AUTO, PLP_BACKEND_CPU, PLP_BACKEND_CUDA, PLP_COUPLING_DIRECT,
    PLP_COUPLING_VIRTUAL, PLP_HAPTIC_BALL, PLP_HAPTIC_PASSIVE, plp_box, plp_fix, plp_haptic_desc,
    plp_material, plp_motion, plp_place, plp_pose,
};
use crate::math::{Pose, Quat, Vec3, all_finite};
use crate::model::Fix;
use crate::model::material::Material;
use crate::servo::ServoOptions;
use crate::servo::coupling::{Coupling, VirtualCoupling};
use crate::servo::device::{DeviceDesc, Workspace};
use crate::servo::impedance::BlockLimit;
use crate::sim::{Backend, Place};
use crate::solver::tool::ToolMotion;

/// The pose in a host's struct, its quaternion normalised. `None` when it is not finite or its quaternion is
/// not nearly unit: the struct was probably never filled. Allocates nothing.
pub(super) fn try_pose(pose: &plp_pose) -> Option<Pose> {
    let [x, y, z, w] = pose.rotation;
    let quaternion = na::Quaternion::new(w, x, y, z);
    let (finite, norm) = (all_finite(&pose.position_m), quaternion.norm());
    // A NaN is in no range.
    (finite && (0.9..=1.1).contains(&norm)).then(|| {
        let rotation = Quat::new_unchecked(quaternion * (1.0 / norm));
        Pose::from_parts(na::Translation3::from(Vec3::from(pose.position_m)), rotation)
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

/// Nodes that are held.
pub(super) fn fix_of(from: &plp_fix, what: &str) -> Result<Fix, Fault> {
    check_bits(from.axes, PLP_AXIS_ALL, &format!("{what}.axes"))?;
    check_bits(from.reserved, 0, &format!("{what}.reserved"))?;
    let (pose, half_extents) = oriented_box(&from.region, what)?;
    Ok(Fix { pose, half_extents, axes: std::array::from_fn(|axis| from.axes >> axis & 1 == 1) })
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

/// A haptic device and how it holds its tool.
pub(super) fn haptic(from: &plp_haptic_desc) -> Result<(DeviceDesc, ServoOptions), Fault> {
    check_bits(from.flags, PLP_HAPTIC_PASSIVE | PLP_HAPTIC_BALL, "plp_haptic_desc.flags")?;
    check_bits(from.reserved, 0, "plp_haptic_desc.reserved")?;
    let device = DeviceDesc {
        max_force_n: from.max_force_n,
        max_torque_n_m: from.max_torque_n_m,
        continuous_force_n: from.continuous_force_n,
        continuous_torque_n_m: from.continuous_torque_n_m,
        window_s: from.window_s,
        max_stiffness: BlockLimit { linear: from.max_stiffness_n_m, angular: from.max_stiffness_n_m_rad },
        max_damping: BlockLimit { linear: from.max_damping_n_s_m, angular: from.max_damping_n_m_s_rad },
        slew_n_per_s: from.slew_n_s,
        slew_n_m_per_s: from.slew_n_m_s,
        servo_rate_hz: from.servo_rate_hz,
        max_speed_m_s: from.max_speed_m_s,
        workspace: if from.flags & PLP_HAPTIC_BALL != 0 {
            Workspace::Ball { radius_m: from.workspace_m[0] }
        } else {
            Workspace::Box { half_extents_m: from.workspace_m.into() }
        },
    };
    let strongest = VirtualCoupling::of(&device);
    let or = |asked: f64, most: f64| if asked == 0.0 { most } else { asked };
    let coupling = match from.coupling {
        PLP_COUPLING_DIRECT => Coupling::Direct,
        PLP_COUPLING_VIRTUAL => Coupling::Virtual(VirtualCoupling {
            stiffness_n_per_m: or(from.coupling_n_m, strongest.stiffness_n_per_m),
            damping_n_s_per_m: from.coupling_n_s_m,
            stiffness_n_m_per_rad: or(from.coupling_n_m_rad, strongest.stiffness_n_m_per_rad),
            damping_n_m_s_per_rad: from.coupling_n_m_s_rad,
        }),
        other => return Err(Fault::argument(format!("coupling {other} is no PLP_COUPLING_ value"))),
    };
    let controls_passivity = from.flags & PLP_HAPTIC_PASSIVE != 0;
    Ok((device, ServoOptions { coupling, controls_passivity }))
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
