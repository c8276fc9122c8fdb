//! A generated thorax: the anatomy that a simulation starts with when its host has no scan.
//!
//! The phantom is anatomy-inspired, not a patient: a torso of 0.30 × 0.20 × 0.24 m from the base of the neck
//! to the upper abdomen, with skin, fat, muscle, ribs, sternum, spine, lungs with airways and vessels, heart,
//! aorta, diaphragm, liver, stomach (drawn as muscle), spleen and a tumour in the right lung. It is the same
//! at every voxel size, because every label comes from the distance to analytic shapes; what is thinner than
//! a voxel appears where a voxel's centre falls into it.
//!
//! **Axes.** x points to the patient's right, y to the front (anterior), z to the head (superior), which is
//! right-handed. The world origin is the middle of the torso.
//!
//! **Where to press.** Costal cartilage is left out, so that beside the body of the sternum there is soft
//! tissue about 30 mm wide on each side, besides the gaps between ribs; the tumour lies behind the right one.
//! Below the costal arch, within 40 mm of the middle and from z = −0.045 m downwards, the front is soft too.

use std::collections::BTreeMap;

use super::build::LabelUse;
use super::grid::{LabelGrid, voxel_count};
use super::material::Material;
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};

mod body;
mod tree;

/// Size of the phantom along x, y, z in metres.
pub const SIZE_M: [f64; 3] = [0.30, 0.20, 0.24];

/// What the phantom's labels mean. As a number, a label is `label as u16`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u16)]
pub enum Label {
    /// Around the body.
    Outside = 0,
    /// Lung parenchyma.
    Lung = 1,
    /// Pulmonary arteries with their trunk, and the superior vena cava.
    Vessel = 2,
    /// Air in the trachea and bronchi.
    AirwayLumen = 3,
    /// Muscle: chest and abdominal wall, shoulders, back, diaphragm, stomach.
    Muscle = 4,
    /// The heart, filled.
    Heart = 5,
    /// Fat: under the skin, in the mediastinum, in the abdomen, in the spinal canal.
    Fat = 6,
    /// The aorta, filled.
    Aorta = 7,
    /// Walls of the trachea and bronchi.
    AirwayWall = 8,
    /// Ribs, sternum, spine, shoulder blades.
    Bone = 9,
    /// The spleen.
    Spleen = 10,
    /// A tumour of about 24 mm in the right lung, near the front.
    Tumour = 11,
    /// Skin.
    Skin = 12,
    /// The liver.
    Liver = 13,
}

impl Label {
    /// All labels in the order of their numbers.
    pub const ALL: [Self; 14] = [
        Self::Outside,
        Self::Lung,
        Self::Vessel,
        Self::AirwayLumen,
        Self::Muscle,
        Self::Heart,
        Self::Fat,
        Self::Aorta,
        Self::AirwayWall,
        Self::Bone,
        Self::Spleen,
        Self::Tumour,
        Self::Skin,
        Self::Liver,
    ];

    /// A name for tables and pictures.
    pub fn name(self) -> &'static str {
        match self {
            Self::Outside => "outside",
            Self::Lung => "lung",
            Self::Vessel => "vessel",
            Self::AirwayLumen => "airway lumen",
            Self::Muscle => "muscle",
            Self::Heart => "heart",
            Self::Fat => "fat",
            Self::Aorta => "aorta",
            Self::AirwayWall => "airway wall",
            Self::Bone => "bone",
            Self::Spleen => "spleen",
            Self::Tumour => "tumour",
            Self::Skin => "skin",
            Self::Liver => "liver",
        }
    }
}

/// The phantom on cubic voxels of `voxel_m`, between 1 mm and 10 mm. Labels are those of [`Label`].
pub fn thorax(voxel_m: f64) -> Result<LabelGrid> {
    if !(0.001..=0.010).contains(&voxel_m) {
        return Err(Error::argument(format!("the phantom's voxels are 0.001 m to 0.010 m, not {voxel_m} m")));
    }
    // A size that is a whole number of voxels must not gain one by rounding.
    let dims = SIZE_M.map(|size| (size / voxel_m - 1e-6).ceil() as usize);
    let first = Vec3::from(dims.map(|n| (n - 1) as f64 * -0.5 * voxel_m));

    let mut labels = vec![0; voxel_count(dims)?];
    for (n, label) in labels.iter_mut().enumerate() {
        let voxel = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
        *label = body::label_at(&(first + Vec3::from(voxel.map(|x| x as f64 * voxel_m))), voxel_m) as u16;
    }

    let mut canvas = Canvas { dims, voxel_m, first, labels };
    draw_vessels(&mut canvas);
    draw_airways(&mut canvas);
    draw_tumour(&mut canvas);
    LabelGrid::new(dims, Vec3::repeat(voxel_m), Pose::translation(first.x, first.y, first.z), canvas.labels)
}

/// What each label of [`thorax`] becomes: air is empty, bone is rigid, all else is tissue; materials are the
/// [`PRESETS`](super::material::PRESETS) of their kind.
pub fn thorax_uses() -> BTreeMap<u16, LabelUse> {
    Label::ALL.into_iter().map(|label| (label as u16, label_use(label))).collect()
}

fn label_use(label: Label) -> LabelUse {
    let preset = match label {
        Label::Outside | Label::AirwayLumen => return LabelUse::Empty,
        Label::Lung => "lung",
        Label::Vessel | Label::Aorta => "vessel",
        Label::Muscle => "muscle",
        Label::Heart => "myocardium",
        Label::Fat => "fat",
        Label::AirwayWall => "airway_wall",
        Label::Bone => "bone",
        Label::Spleen => "spleen",
        Label::Tumour => "tumour",
        Label::Skin => "skin",
        Label::Liver => "liver",
    };
    let known = Material::preset(preset).expect("the phantom's presets exist");
    let material = Material { name: label.name().to_string(), ..known };
    if label == Label::Bone { LabelUse::Rigid(material) } else { LabelUse::Tissue(material) }
}

/// Voxels that shapes are drawn into, in the order of the calls.
struct Canvas {
    dims: [usize; 3],
    voxel_m: f64,
    /// Centre of voxel (0, 0, 0).
    first: Vec3,
    labels: Vec<u16>,
}

impl Canvas {
    /// Labels the voxels around `centre` (as far as `reach` along each axis) that are inside and now carry
    /// one of `over`.
    fn draw(
        &mut self,
        centre: &Vec3,
        reach: &Vec3,
        label: Label,
        over: &[Label],
        is_inside: impl Fn(&Vec3) -> bool,
    ) {
        let voxel_at = |x: f64, a: usize| ((x - self.first[a]) / self.voxel_m).round().max(0.0) as usize;
        let low = [0, 1, 2].map(|a| voxel_at(centre[a] - reach[a], a));
        let high = [0, 1, 2].map(|a| voxel_at(centre[a] + reach[a], a).min(self.dims[a] - 1));
        for k in low[2]..=high[2] {
            for j in low[1]..=high[1] {
                for i in low[0]..=high[0] {
                    let old = &mut self.labels[i + self.dims[0] * (j + self.dims[1] * k)];
                    let point = self.first + Vec3::new(i as f64, j as f64, k as f64) * self.voxel_m;
                    if over.iter().any(|&l| l as u16 == *old) && is_inside(&point) {
                        *old = label as u16;
                    }
                }
            }
        }
    }

    /// A tube with round ends.
    fn draw_tube(&mut self, tube: &tree::Branch, radius: f64, label: Label, over: &[Label]) {
        let reach = (tube.end - tube.start).abs() / 2.0 + Vec3::repeat(radius);
        self.draw(&((tube.start + tube.end) / 2.0), &reach, label, over, |point| {
            tube.distance(point) <= radius
        });
    }
}

fn draw_vessels(canvas: &mut Canvas) {
    for branch in tree::pulmonary_arteries() {
        canvas.draw_tube(&branch, branch.radius, Label::Vessel, &[Label::Lung, Label::Fat]);
    }
    let around_aorta = [Label::Lung, Label::Fat, Label::Muscle, Label::Vessel, Label::Liver];
    for branch in tree::aorta() {
        canvas.draw_tube(&branch, branch.radius, Label::Aorta, &around_aorta);
    }
}

/// All walls come before all lumens, so that no wall closes a junction.
fn draw_airways(canvas: &mut Canvas) {
    use Label::{AirwayWall, Aorta, Fat, Heart, Lung, Muscle, Vessel};
    let branches = tree::airways();
    for branch in &branches {
        let outer = branch.radius + tree::airway_wall(branch.radius);
        canvas.draw_tube(branch, outer, AirwayWall, &[Lung, Fat, Muscle, Heart, Vessel, Aorta]);
    }
    for branch in &branches {
        canvas.draw_tube(branch, branch.radius, Label::AirwayLumen, &[AirwayWall]);
    }
}

fn draw_tumour(canvas: &mut Canvas) {
    use Label::{AirwayLumen, AirwayWall, Lung, Tumour, Vessel};
    let reach = Vec3::repeat(body::TUMOUR_REACH_M);
    let over = [Lung, Vessel, AirwayWall, AirwayLumen];
    canvas.draw(&body::TUMOUR_CENTRE, &reach, Tumour, &over, body::is_tumour);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(grid: &LabelGrid, label: Label) -> usize {
        grid.labels().iter().filter(|&&l| l == label as u16).count()
    }

    fn voxels(grid: &LabelGrid) -> impl Iterator<Item = ([usize; 3], u16)> {
        let [nx, ny, _] = grid.dims();
        grid.labels().iter().enumerate().map(move |(n, &label)| ([n % nx, n / nx % ny, n / (nx * ny)], label))
    }

    fn world(grid: &LabelGrid, voxel: [usize; 3]) -> Vec3 {
        grid.frame().translation.vector + Vec3::from(voxel.map(|x| x as f64)).component_mul(&grid.spacing())
    }

    fn middle(grid: &LabelGrid, label: Label) -> Vec3 {
        let of_label = voxels(grid).filter(|&(_, l)| l == label as u16);
        of_label.map(|(voxel, _)| world(grid, voxel)).sum::<Vec3>() / count(grid, label) as f64
    }

    /// The labels met by a straight path from the front towards the back, starting outside.
    fn path_from_front(grid: &LabelGrid, x: f64, z: f64) -> Vec<u16> {
        let [_, ny, _] = grid.dims();
        let first = grid.frame().translation.vector;
        let (i, k) = ((x - first.x) / grid.spacing().x, (z - first.z) / grid.spacing().z);
        (0..ny).rev().map(|j| grid.label(i.round() as usize, j, k.round() as usize)).collect()
    }

    /// How many voxels with one of `labels` are joined, through faces, edges and corners, to the first one
    /// met from the top.
    fn joined_count(grid: &LabelGrid, labels: &[Label]) -> usize {
        let dims = grid.dims();
        let index = |[i, j, k]: [usize; 3]| i + dims[0] * (j + dims[1] * k);
        let mut open: Vec<bool> =
            grid.labels().iter().map(|l| labels.iter().any(|&label| label as u16 == *l)).collect();
        let Some(start) = open.iter().rposition(|&is_open| is_open) else { return 0 };
        open[start] = false;

        let (mut stack, mut joined) = (vec![start], 0);
        while let Some(n) = stack.pop() {
            joined += 1;
            let at = [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
            let near = |a: usize| at[a].saturating_sub(1)..=(at[a] + 1).min(dims[a] - 1);
            for k in near(2) {
                for j in near(1) {
                    for i in near(0) {
                        let next = index([i, j, k]);
                        if std::mem::take(&mut open[next]) {
                            stack.push(next);
                        }
                    }
                }
            }
        }
        joined
    }

    #[test]
    fn the_grid_is_the_torso_and_centred_at_any_voxel_size() {
        for voxel_m in [0.002, 0.003, 0.007, 0.010] {
            let grid = thorax(voxel_m).unwrap();
            let (low, high) = (world(&grid, [0; 3]), world(&grid, grid.dims().map(|n| n - 1)));
            assert!((low + high).norm() < 1e-12);
            for a in 0..3 {
                let size = grid.dims()[a] as f64 * voxel_m;
                assert!(size > SIZE_M[a] - 1e-9 && size < SIZE_M[a] + voxel_m);
            }
        }
        assert_eq!(thorax(0.002).unwrap().dims(), [150, 100, 120]);
    }

    #[test]
    fn voxels_outside_the_stated_sizes_are_refused() {
        for voxel_m in [0.0, 0.000_9, 0.011, -0.002, f64::NAN, f64::INFINITY] {
            assert!(matches!(thorax(voxel_m), Err(Error::Argument(_))));
        }
    }

    #[test]
    fn organs_have_the_same_volume_and_place_at_every_voxel_size() {
        let (fine, coarse) = (thorax(0.002).unwrap(), thorax(0.005).unwrap());
        for label in [Label::Lung, Label::Heart, Label::Liver, Label::Muscle, Label::Bone] {
            let share = count(&coarse, label) as f64 * 125.0 / (count(&fine, label) as f64 * 8.0);
            assert!((0.93..1.07).contains(&share), "{} has {share:.3} of its volume", label.name());
            let apart = (middle(&fine, label) - middle(&coarse, label)).norm();
            assert!(apart < 0.0025, "{} moved by {apart:.4} m", label.name());
        }
        for label in Label::ALL {
            assert!(count(&coarse, label) > 0, "{} is missing at 5 mm", label.name());
        }
    }

    #[test]
    fn organs_lie_where_they_do_in_a_body() {
        let grid = thorax(0.003).unwrap();
        let at = |label| middle(&grid, label);
        assert!(
            at(Label::Liver).x > 0.02 && at(Label::Spleen).x < -0.05,
            "the liver is right, the spleen left"
        );
        assert!(at(Label::Heart).x < -0.01, "the heart is left of the middle");
        assert!(at(Label::Lung).z > at(Label::Heart).z && at(Label::Heart).z > at(Label::Liver).z);
        assert!(at(Label::Bone).y < 0.0, "the spine is at the back");
        assert!(at(Label::Tumour).x > 0.02 && at(Label::Tumour).y > 0.03, "the tumour is at the right front");
        assert!(at(Label::Aorta).x < 0.0 && at(Label::Aorta).y < at(Label::Heart).y);
    }

    #[test]
    fn skin_covers_the_body_except_where_the_grid_cuts_it() {
        let grid = thorax(0.002).unwrap();
        let dims = grid.dims();
        for ([i, j, k], label) in voxels(&grid) {
            if label == Label::Outside as u16
                || label == Label::Skin as u16
                || label == Label::AirwayLumen as u16
            {
                continue;
            }
            // Neighbours along x and y only: above and below, the grid ends.
            assert!(i > 0 && i + 1 < dims[0] && j > 0 && j + 1 < dims[1]);
            for next in [[i - 1, j, k], [i + 1, j, k], [i, j - 1, k], [i, j + 1, k]] {
                assert_ne!(
                    grid.label(next[0], next[1], next[2]),
                    Label::Outside as u16,
                    "no skin at {next:?}"
                );
            }
        }
    }

    #[test]
    fn the_front_can_be_pressed_beside_the_sternum_and_below_the_ribs() {
        let grid = thorax(0.002).unwrap();
        let is_bone = |labels: &[u16]| labels.contains(&(Label::Bone as u16));
        // To the depth of the tumour's far side, and through the whole abdomen as far as the spine.
        let window = path_from_front(&grid, 0.033, 0.012);
        assert!(!is_bone(&window[..35]) && window[..35].contains(&(Label::Tumour as u16)), "{window:?}");
        for z in [-0.05, -0.08, -0.11] {
            for x in [-0.038, 0.0, 0.038] {
                let path = path_from_front(&grid, x, z);
                assert!(!is_bone(&path[..55]), "bone at x {x}, z {z}");
            }
        }
        // The sternum and a rib are there to be felt.
        assert!(is_bone(&path_from_front(&grid, 0.0, 0.03)[..20]));
        let ribs =
            (0..60).filter(|n| is_bone(&path_from_front(&grid, 0.07, f64::from(*n) * 0.002 - 0.05)[..30]));
        assert!((15..45).contains(&ribs.count()), "ribs and gaps alternate");
    }

    #[test]
    fn soft_tissue_hangs_together() {
        let grid = thorax(0.003).unwrap();
        let soft: Vec<Label> =
            Label::ALL.into_iter().filter(|&label| matches!(label_use(label), LabelUse::Tissue(_))).collect();
        let total: usize = soft.iter().map(|&label| count(&grid, label)).sum();
        assert_eq!(joined_count(&grid, &soft), total);
    }

    #[test]
    fn airways_are_open_to_the_top_and_lined_by_their_wall() {
        let grid = thorax(0.001_5).unwrap();
        assert_eq!(joined_count(&grid, &[Label::AirwayLumen]), count(&grid, Label::AirwayLumen));

        // A wall is at least 1.2 mm thick: at 1.5 mm a few gaps are left in the smallest branches.
        let (mut faces, mut bare) = (0, 0);
        for ([i, j, k], label) in voxels(&grid).filter(|&([_, _, k], _)| k + 1 < grid.dims()[2]) {
            if label == Label::AirwayLumen as u16 {
                for next in
                    [[i - 1, j, k], [i + 1, j, k], [i, j - 1, k], [i, j + 1, k], [i, j, k - 1], [i, j, k + 1]]
                {
                    let other = grid.label(next[0], next[1], next[2]);
                    faces += usize::from(other != label);
                    bare += usize::from(other != label && other != Label::AirwayWall as u16);
                }
            }
        }
        assert!(bare * 20 < faces, "{bare} of {faces} faces of the lumen have no wall");
    }

    #[test]
    fn the_tumour_touches_lung_and_what_grows_in_it_only() {
        let grid = thorax(0.002).unwrap();
        let allowed = [Label::Tumour, Label::Lung, Label::Vessel, Label::AirwayWall, Label::AirwayLumen];
        for ([i, j, k], _) in voxels(&grid).filter(|&(_, l)| l == Label::Tumour as u16) {
            for next in
                [[i - 1, j, k], [i + 1, j, k], [i, j - 1, k], [i, j + 1, k], [i, j, k - 1], [i, j, k + 1]]
            {
                let label = grid.label(next[0], next[1], next[2]);
                assert!(allowed.iter().any(|&l| l as u16 == label), "label {label} beside the tumour");
            }
        }
    }

    #[test]
    fn every_label_has_a_use_and_there_are_few_enough_materials() {
        let uses = thorax_uses();
        let mut material_count = 0;
        for (n, label) in Label::ALL.into_iter().enumerate() {
            assert_eq!(label as usize, n);
            match &uses[&(label as u16)] {
                LabelUse::Empty => assert!(matches!(label, Label::Outside | Label::AirwayLumen)),
                LabelUse::Rigid(material) => {
                    assert_eq!(label, Label::Bone);
                    material.check().unwrap();
                    material_count += 1;
                }
                LabelUse::Tissue(material) => {
                    material.check().unwrap();
                    material_count += 1;
                }
            }
        }
        assert_eq!(uses.len(), Label::ALL.len());
        assert!(material_count <= super::super::material::MAX_MATERIALS);
    }

    #[test]
    fn the_phantom_is_always_the_same() {
        assert_eq!(thorax(0.004).unwrap().labels(), thorax(0.004).unwrap().labels());
    }
}
