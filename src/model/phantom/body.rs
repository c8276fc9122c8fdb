//! The solid parts of the phantom: signed distances in metres (negative inside) to smooth shapes.
//!
//! Distances of ellipsoids and their kin are first-order: value over slope. They are exact on the surface and
//! good enough within the few millimetres where layers are measured.

use std::f64::consts::{PI, TAU};

use super::Label;
use crate::math::Vec3;

/// Middle of the tumour.
pub(super) const TUMOUR_CENTRE: Vec3 = Vec3::new(0.040, 0.046, 0.012);
/// The farthest that the tumour reaches from its middle along an axis.
pub(super) const TUMOUR_REACH_M: f64 = 0.0145;

const SKIN_M: f64 = 0.003;
/// From the middle of the ribs to the pleura.
const WALL_M: f64 = 0.0062;
/// Height of the first rib at the spine, and distance to the next one; vertebrae follow the same steps.
const FIRST_RIB_Z: f64 = 0.108;
const RIB_STEP: f64 = 0.0162;
/// Where ribs end, as an angle from the spine (0) to the sternum (π): seven reach the front, the last two
/// float.
const RIB_ENDS: [f64; 12] = [2.75, 2.75, 2.75, 2.75, 2.75, 2.75, 2.75, 2.55, 2.35, 2.10, 1.60, 1.15];

/// The label at a point, before airways, vessels and the tumour are drawn.
///
/// Skin is at least one voxel thick, so that it stays closed at any resolution.
pub(super) fn label_at(p: &Vec3, voxel_m: f64) -> Label {
    let depth = depth_below_skin(p);
    if depth < 0.0 {
        return Label::Outside;
    }
    let skin = SKIN_M.max(voxel_m);
    if depth < skin {
        return Label::Skin;
    }
    if depth < SKIN_M + fat_thickness(p) {
        return Label::Fat;
    }

    let cage = cage_distance(p);
    if rib_at(p, cage).is_some() || is_sternum(p, cage) || is_shoulder_blade(p, cage) {
        return Label::Bone;
    }
    if let Some(label) = spine_at(p) {
        return label;
    }
    if cage > -WALL_M {
        return Label::Muscle;
    }
    let above = above_diaphragm(p);
    if above > 0.0 { chest_at(p, cage, above) } else { abdomen_at(p, cage, above) }
}

/// Above the diaphragm, inside the chest wall.
fn chest_at(p: &Vec3, cage: f64, above: f64) -> Label {
    if heart_distance(p, above) < 0.0 {
        Label::Heart
    } else if lung_distance_given(p, cage, above) < 0.0 {
        Label::Lung
    } else {
        Label::Fat
    }
}

/// The diaphragm and what lies below it, inside the abdominal wall.
fn abdomen_at(p: &Vec3, cage: f64, above: f64) -> Label {
    if above > -0.0035 || (p.x.abs() < 0.045 && p.y < -0.034) {
        return Label::Muscle;
    }
    let inside = smooth_max(above + 0.0035, cage + WALL_M, 0.008);

    // The liver's lower face rises from the right flank to the left; its back leaves room for the spine and
    // the great vessels.
    let lower_face = smooth_max(inside, (-0.080 - 0.30 * p.x - p.z) * 0.96, 0.020);
    let left_lobe = smooth_max(lower_face, -0.062 - p.x, 0.012);
    let back = (p.x - 0.047).max(p.y + 0.028);
    if smooth_max(left_lobe, -back, 0.012) < 0.0 {
        return Label::Liver;
    }

    let stomach = ellipsoid(p, &Vec3::new(-0.058, 0.016, -0.076), &Vec3::new(0.042, 0.036, 0.030));
    if smooth_max(stomach, inside, 0.006) < 0.0 {
        return Label::Muscle;
    }
    let spleen = ellipsoid(p, &Vec3::new(-0.092, -0.032, -0.074), &Vec3::new(0.022, 0.030, 0.030));
    if smooth_max(spleen, inside, 0.006) < 0.0 { Label::Spleen } else { Label::Fat }
}

/// Distance to the lungs' surface.
pub(super) fn lung_distance(p: &Vec3) -> f64 {
    lung_distance_given(p, cage_distance(p), above_diaphragm(p))
}

fn lung_distance_given(p: &Vec3, cage: f64, above: f64) -> f64 {
    // The mediastinum is as wide as the spine and narrows towards the sternum, where the lungs nearly meet.
    let mediastinum = 0.022 - 0.015 * smooth_step(0.025, 0.060, p.y);
    let wall = smooth_max(cage + WALL_M, p.z - 0.113, 0.012);
    let sides = smooth_max(wall, mediastinum - p.x.abs(), 0.010);
    let base = smooth_max(sides, -above, 0.004);
    smooth_max(base, 0.003 - heart_distance(p, above), 0.006)
}

/// The tumour: a ball of 12 mm radius with shallow lobes.
pub(super) fn is_tumour(p: &Vec3) -> bool {
    let from = p - TUMOUR_CENTRE;
    let lobes = (from * 480.0).map(f64::sin).product();
    from.norm() < 0.012 * (1.0 + 0.35 * lobes).min(1.2)
}

/// Depth below the skin of a rounded torso that narrows a little towards the shoulders' top.
fn depth_below_skin(p: &Vec3) -> f64 {
    const ROUNDNESS: f64 = 2.5;
    let top = smooth_step(0.03, 0.12, p.z);
    let waist = smooth_step(0.03, 0.12, -p.z);
    let (a, b) = (0.148 - 0.010 * top - 0.004 * waist, 0.098 - 0.012 * top - 0.002 * waist);
    let (u, v) = (p.x.abs() / a, (p.y + 0.010 * top).abs() / b);

    // value = (uⁿ + vⁿ)^(1/n), and its slope.
    let (un, vn) = (u.powf(ROUNDNESS - 1.0), v.powf(ROUNDNESS - 1.0));
    let value = (un * u + vn * v).powf(1.0 / ROUNDNESS).max(1e-6);
    let slope = (un / a).hypot(vn / b) / value.powf(ROUNDNESS - 1.0);
    (1.0 - value) / slope
}

/// Thicker at the flanks and over the belly.
fn fat_thickness(p: &Vec3) -> f64 {
    0.0045 + 0.003 * smooth_step(0.02, 0.10, -p.z) + 0.002 * smooth_step(0.08, 0.14, p.x.abs())
}

/// The surface in which the ribs lie: an elliptical cylinder, closed by a dome above.
fn cage_distance(p: &Vec3) -> f64 {
    ellipsoid(&Vec3::new(p.x, p.y, (p.z - 0.015).max(0.0)), &Vec3::zeros(), &CAGE)
}

const CAGE: Vec3 = Vec3::new(0.130, 0.081, 0.106);

/// The number of the rib at a point, 1 to 12. Ribs fall from the spine to the front.
fn rib_at(p: &Vec3, cage: f64) -> Option<usize> {
    let across = (cage / 0.0036).powi(2);
    if across > 1.0 {
        return None;
    }
    let angle = (p.x.abs() / CAGE.x).atan2(-p.y / CAGE.y);
    (1..=12).find(|&n| {
        let fall = (0.018 + 0.0035 * n as f64) * (1.0 - angle.cos()) / 2.0;
        let z = FIRST_RIB_Z - RIB_STEP * (n - 1) as f64 - fall;
        (0.2..RIB_ENDS[n - 1]).contains(&angle) && ((p.z - z) / 0.0052).powi(2) + across < 1.0
    })
}

fn is_sternum(p: &Vec3, cage: f64) -> bool {
    let body = 0.015 * smooth_step(-0.040, -0.015, p.z);
    let half_width = body + 0.008 * smooth_step(0.045, 0.065, p.z);
    p.y > 0.0 && cage.abs() < 0.0045 && p.x.abs() < half_width && (-0.035..0.088).contains(&p.z)
}

/// Two triangular plates behind the ribs.
fn is_shoulder_blade(p: &Vec3, cage: f64) -> bool {
    let half_width = 0.004 + 0.022 * smooth_step(0.0, 0.07, p.z);
    let middle = 0.070 + 0.10 * (p.z - 0.035);
    p.y < 0.0
        && (0.0065..0.0105).contains(&cage)
        && (p.x.abs() - middle).abs() < half_width
        && (0.0..0.085).contains(&p.z)
}

/// Vertebrae with their arches and processes, and the canal, which is filled with fat.
fn spine_at(p: &Vec3) -> Option<Label> {
    let body_y = -0.047 + 0.007 * (p.z / 0.12).powi(2);
    let canal_y = body_y - 0.0205;
    if p.x.abs() > 0.034 || p.y > body_y + 0.02 {
        return None;
    }

    let level = (p.z - FIRST_RIB_Z) / RIB_STEP;
    let from_level = (level - level.round()) * RIB_STEP;
    let waist = 0.95 - 0.05 * (TAU * level).cos();
    let body = (p.x / 0.0165).hypot((p.y - body_y) / 0.0135) < waist;
    let from_canal = p.x.hypot(p.y - canal_y);
    if from_canal < 0.0062 && !body {
        return Some(Label::Fat);
    }
    let arch = from_canal < 0.0105 && from_level.abs() < 0.0062;

    // Transverse processes point backwards and out to the ribs, spinous processes backwards and down.
    let out = ((p.x.abs() - 0.009) / 0.019).clamp(0.0, 1.0);
    let transverse = (p.x.abs() - 0.009 - 0.019 * out).hypot(p.y - canal_y + 0.010 * out);
    let back = canal_y - p.y;
    let spinous_level = level + back * 0.5 / RIB_STEP;
    let from_spinous = (spinous_level - spinous_level.round()) * RIB_STEP;
    let spinous = p.x.abs() < 0.003 && (0.006..0.021).contains(&back) && from_spinous.abs() < 0.0052;

    let is_bone = body || arch || spinous || transverse.hypot(from_level) < 0.0046;
    is_bone.then_some(Label::Bone)
}

/// Height above the diaphragm: two domes, the right one higher, with steep sides that end lower at the back.
fn above_diaphragm(p: &Vec3) -> f64 {
    const STEP: f64 = 1e-4;
    let z = diaphragm_height(p.x, p.y);
    let slope_x = (diaphragm_height(p.x + STEP, p.y) - z) / STEP;
    let slope_y = (diaphragm_height(p.x, p.y + STEP) - z) / STEP;
    (p.z - z) / (1.0 + slope_x * slope_x + slope_y * slope_y).sqrt()
}

fn diaphragm_height(x: f64, y: f64) -> f64 {
    let from_middle = (x / 0.128).powi(2) + (y / 0.079).powi(2);
    let side = (x / 0.06).clamp(-1.0, 1.0);
    let rise = 0.054 + 0.007 * (side * PI / 2.0).sin() + 0.018 * smooth_step(0.0, 1.0, side.abs());
    -0.092 + 0.012 * (y / 0.079).clamp(-1.0, 1.0) + rise * (1.0 - from_middle).max(0.0025).sqrt()
}

/// The heart points to the left, the front and down, and rests on the diaphragm.
fn heart_distance(p: &Vec3, above: f64) -> f64 {
    let axis = Vec3::new(-0.62, 0.52, -0.587);
    let from = p - Vec3::new(-0.020, 0.019, -0.006);
    let along = from.dot(&axis);
    let across = (from - axis * along).norm();
    let heart = ellipsoid(&Vec3::new(along, across, 0.0), &Vec3::zeros(), &Vec3::new(0.052, 0.039, 1.0));
    smooth_max(heart, -above, 0.008)
}

/// First-order distance to an ellipsoid.
fn ellipsoid(p: &Vec3, centre: &Vec3, radii: &Vec3) -> f64 {
    let scaled = (p - centre).component_div(radii);
    let value = scaled.norm().max(1e-6);
    (value - 1.0) * value / scaled.component_div(radii).norm().max(1e-9)
}

/// The larger of two distances, rounded where they differ by less than `width`: an intersection with a soft
/// edge.
fn smooth_max(a: f64, b: f64, width: f64) -> f64 {
    let overlap = (width - (a - b).abs()).max(0.0);
    a.max(b) + overlap * overlap / (4.0 * width)
}

/// 0 up to `from`, 1 beyond `to`, smooth between.
fn smooth_step(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of the surface in which the ribs lie, on one side (1 right, −1 left), with their angle from the
    /// spine.
    fn rib_surface(side: f64) -> impl Iterator<Item = (f64, Vec3)> {
        let angles = (1..314).map(|n| f64::from(n) * 0.01);
        angles.flat_map(move |angle| {
            (-240..240).map(move |n| {
                let z = f64::from(n) * 0.0005;
                let dome = (1.0 - ((z - 0.015).max(0.0) / CAGE.z).powi(2)).sqrt();
                let x = CAGE.x * dome * angle.sin() * side;
                (angle, Vec3::new(x, -CAGE.y * dome * angle.cos(), z))
            })
        })
    }

    #[test]
    fn the_surface_of_the_ribs_is_where_their_distance_is_zero() {
        assert!(rib_surface(1.0).all(|(_, p)| cage_distance(&p).abs() < 1e-12));
    }

    #[test]
    fn each_side_has_twelve_separate_ribs() {
        for side in [1.0, -1.0] {
            let mut seen = [false; 12];
            let mut below: Option<(f64, f64, Option<usize>)> = None;
            for (angle, p) in rib_surface(side) {
                let rib = rib_at(&p, 0.0);
                if let Some(n) = rib {
                    seen[n - 1] = true;
                }
                // Going up at one angle, one rib never follows another without a gap.
                if let Some((last_angle, last_z, Some(last))) = below
                    && last_angle == angle
                    && last_z < p.z
                    && let Some(n) = rib
                {
                    assert_eq!(n, last, "ribs touch at {p:?}");
                }
                below = Some((angle, p.z, rib));
            }
            assert_eq!(seen, [true; 12]);
        }
    }

    #[test]
    fn first_order_distances_are_exact_for_a_sphere() {
        let (centre, radius) = (Vec3::new(0.01, -0.02, 0.03), 0.05);
        for offset in [Vec3::new(0.03, 0.0, 0.0), Vec3::new(0.02, 0.04, -0.05)] {
            let distance = ellipsoid(&(centre + offset), &centre, &Vec3::repeat(radius));
            assert!((distance - (offset.norm() - radius)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_smooth_maximum_rounds_only_where_its_arguments_are_close() {
        assert_eq!(smooth_max(3.0, 1.0, 2.0), 3.0);
        assert_eq!(smooth_max(1.0, 1.0, 2.0), 1.5);
        assert_eq!(smooth_max(-1.0, 4.0, 0.5), 4.0);
    }

    #[test]
    fn the_tumour_stays_within_its_reach_and_in_the_lung() {
        let step = TUMOUR_REACH_M / 20.0;
        for n in 0..51_i32.pow(3) {
            let offset = Vec3::new(f64::from(n % 51), f64::from(n / 51 % 51), f64::from(n / 2601))
                - Vec3::repeat(25.0);
            let p = TUMOUR_CENTRE + offset * step;
            if is_tumour(&p) {
                assert!(offset.amax() * step <= TUMOUR_REACH_M);
                assert!(lung_distance(&p) < 0.0, "{p:?} is outside the lung");
            }
        }
    }
}
