//! The branching parts of the phantom: airways, pulmonary arteries, aorta.
//!
//! A tree fills a lung by dividing it: the points of a lung are halved at the place of each branching, and
//! each child grows towards the middle of its half. Radii follow Murray's law: the cubes of the children's
//! radii add up to their parent's.

use super::SIZE_M;
use super::body::lung_distance;
use crate::math::Vec3;

/// A straight tube with round ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Branch {
    pub start: Vec3,
    pub end: Vec3,
    /// Of the lumen, for an airway; metres.
    pub radius: f64,
}

impl Branch {
    /// Distance from the tube's axis.
    pub fn distance(&self, point: &Vec3) -> f64 {
        let along = self.end - self.start;
        let t = ((point - self.start).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (point - self.start - along * t).norm()
    }
}

/// How a tree divides a lung.
struct Habit {
    /// Share of a region's points that go to the first child.
    share: f64,
    /// How far a branch grows towards the middle of its region.
    reach: f64,
    /// Branchings from the hilum outwards.
    generations: usize,
}

const AIRWAYS: Habit = Habit { share: 0.5, reach: 0.48, generations: 5 };
// Another share than the airways', so that vessels run beside them and not inside them.
const ARTERIES: Habit = Habit { share: 0.42, reach: 0.52, generations: 6 };

/// Distance of the points that stand for a lung. It belongs to the anatomy: it does not follow the voxels.
const CLOUD_STEP_M: f64 = 0.006;
/// How far inside the pleura these points lie.
const CLOUD_DEPTH_M: f64 = 0.006;

/// Thickness of the wall around an airway's lumen, in metres.
pub(super) fn airway_wall(radius: f64) -> f64 {
    (0.28 * radius).max(0.0012)
}

/// Trachea, main bronchi and five more generations, parents before children. The trachea leaves through the
/// top.
pub(super) fn airways() -> Vec<Branch> {
    let carina = Vec3::new(0.004, -0.012, 0.046);
    let mut branches = vec![Branch { start: Vec3::new(0.004, -0.008, 0.130), end: carina, radius: 0.0075 }];
    for (side, hilum) in [(1.0, Vec3::new(0.034, -0.010, 0.024)), (-1.0, Vec3::new(-0.036, -0.010, 0.020))] {
        branches.push(Branch { start: carina, end: hilum, radius: 0.0055 });
        grow(&mut branches, hilum, 0.0055, &mut lung_points(side), 0, &AIRWAYS);
    }
    branches
}

/// The trunk, both pulmonary arteries with their branches, and the superior vena cava.
pub(super) fn pulmonary_arteries() -> Vec<Branch> {
    let (valve, fork) = (Vec3::new(-0.018, 0.026, 0.022), Vec3::new(-0.014, 0.010, 0.038));
    let mut branches = vec![
        Branch { start: valve, end: fork, radius: 0.011 },
        Branch { start: Vec3::new(0.026, 0.010, 0.130), end: Vec3::new(0.024, 0.014, 0.010), radius: 0.008 },
    ];
    for (side, hilum) in [(1.0, Vec3::new(0.036, 0.004, 0.030)), (-1.0, Vec3::new(-0.038, 0.004, 0.032))] {
        branches.push(Branch { start: fork, end: hilum, radius: 0.0075 });
        grow(&mut branches, hilum, 0.0075, &mut lung_points(side), 0, &ARTERIES);
    }
    branches
}

/// From the heart over the arch, on the left of the trachea, and down along the spine.
pub(super) fn aorta() -> Vec<Branch> {
    let course = [
        Vec3::new(0.008, 0.024, 0.015),
        Vec3::new(0.012, 0.026, 0.045),
        Vec3::new(0.004, 0.020, 0.062),
        Vec3::new(-0.012, 0.005, 0.069),
        Vec3::new(-0.024, -0.012, 0.060),
        Vec3::new(-0.027, -0.024, 0.040),
        Vec3::new(-0.025, -0.027, 0.0),
        Vec3::new(-0.015, -0.024, -0.130),
    ];
    course.windows(2).map(|w| Branch { start: w[0], end: w[1], radius: 0.0105 }).collect()
}

/// Points spread evenly over the lung on one side (1 right, −1 left).
fn lung_points(side: f64) -> Vec<Vec3> {
    let half = SIZE_M.map(|size| (size / 2.0 / CLOUD_STEP_M) as i32);
    let mut points = Vec::new();
    for k in -half[2]..=half[2] {
        for j in -half[1]..=half[1] {
            for i in 1..=half[0] {
                let p = Vec3::new(f64::from(i) * side, f64::from(j), f64::from(k)) * CLOUD_STEP_M;
                if lung_distance(&p) < -CLOUD_DEPTH_M {
                    points.push(p);
                }
            }
        }
    }
    points
}

/// Adds the subtree that leaves `start` and serves the points of `region`.
fn grow(
    branches: &mut Vec<Branch>,
    start: Vec3,
    radius: f64,
    region: &mut [Vec3],
    generation: usize,
    habit: &Habit,
) {
    if generation == habit.generations || region.len() < 4 {
        return;
    }

    // Divide where the region is longest. The sort is stable, so points at equal heights keep their order.
    let axis = longest_axis(region);
    region.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
    let count = region.len();
    let (first, second) = region.split_at_mut((count as f64 * habit.share) as usize);

    for part in [first, second] {
        let middle = part.iter().sum::<Vec3>() / part.len() as f64;
        let end = start + (middle - start) * habit.reach;
        let radius = radius * (part.len() as f64 / count as f64).cbrt();
        branches.push(Branch { start, end, radius });
        grow(branches, end, radius, part, generation + 1, habit);
    }
}

/// The axis along which points spread most.
fn longest_axis(points: &[Vec3]) -> usize {
    let middle = points.iter().sum::<Vec3>() / points.len() as f64;
    let spread = points.iter().map(|p| (p - middle).component_mul(&(p - middle))).sum::<Vec3>();
    spread.imax()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trees() -> [Vec<Branch>; 2] {
        [airways(), pulmonary_arteries()]
    }

    #[test]
    fn every_branch_starts_where_another_ends() {
        for tree in trees() {
            // The roots: the trachea; the trunk and the vena cava.
            let roots = tree.iter().filter(|b| tree.iter().all(|other| other.end != b.start)).count();
            assert!((1..=2).contains(&roots), "{roots} branches hang in the air");
        }
    }

    #[test]
    fn airways_branch_five_times_in_each_lung() {
        // Trachea, two main bronchi, and 2 + 4 + 8 + 16 + 32 branches on each side.
        assert_eq!(airways().len(), 1 + 2 + 2 * 62);
    }

    #[test]
    fn the_cubes_of_radii_are_kept_at_every_branching() {
        for branch in airways() {
            let children: Vec<Branch> = airways().into_iter().filter(|c| c.start == branch.end).collect();
            // The main bronchi are drawn by hand.
            if children.len() == 2 && branch.radius < 0.007 {
                let cubes: f64 = children.iter().map(|c| c.radius.powi(3)).sum();
                assert!((cubes / branch.radius.powi(3) - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn small_branches_end_inside_their_lung() {
        for tree in trees() {
            for branch in tree.iter().filter(|b| b.radius < 0.0028) {
                assert!(lung_distance(&branch.end) < 0.0, "{branch:?}");
                assert!(branch.start.x * branch.end.x > 0.0, "{branch:?} crosses the middle");
            }
        }
    }

    #[test]
    fn a_branchs_distance_is_that_of_its_axis() {
        let branch = Branch { start: Vec3::zeros(), end: Vec3::new(0.0, 0.0, 2.0), radius: 0.1 };
        assert_eq!(branch.distance(&Vec3::new(3.0, 4.0, 1.0)), 5.0);
        assert_eq!(branch.distance(&Vec3::new(0.0, 0.0, 5.0)), 3.0);
    }
}
