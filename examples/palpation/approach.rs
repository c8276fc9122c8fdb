//! Where to press: from the front of the body, over soft tissue and away from bone and from where the body is held.

use anyhow::bail;
use palpate::math::Vec3;
use palpate::model::Model;
use palpate::model::lattice::flag;
use palpate::sim::{Pick, Sim};

/// Rays along each side of the search grid.
const RAYS: usize = 25;

/// Where and along which unit vector the tool goes in, world frame.
#[derive(Clone, Copy, Debug)]
pub struct Approach {
    /// The point of the undeformed surface that is met.
    pub point_m: Vec3,
    /// Direction of the press.
    pub direction: Vec3,
}

/// The approach along `direction` through `at_m`, or through the softest place when that is not given.
/// `room_m` is how far from the surface the press will be felt most: its depth and the size of the tool.
pub fn choose(sim: &Sim, at_m: Option<Vec3>, direction: Vec3, room_m: f64) -> anyhow::Result<Approach> {
    let [low, high] = bounds(sim.model());
    let back_off = (high - low).norm();
    let cast = |through: Vec3| sim.pick(through - direction * back_off, direction);

    let pick = match at_m {
        Some(at_m) => cast(at_m)?,
        None => softest(sim.model(), direction, room_m, &cast)?,
    };
    let Some(pick) = pick else {
        bail!("no tissue lies along the direction of the press: try --at or --direction")
    };
    Ok(Approach { point_m: pick.point_m, direction })
}

/// The ray, of a grid of rays over the whole body, that ends farthest from anything held, facing the tool, near the middle.
fn softest(
    model: &Model,
    direction: Vec3,
    room_m: f64,
    cast: &dyn Fn(Vec3) -> palpate::error::Result<Option<Pick>>,
) -> anyhow::Result<Option<Pick>> {
    let [low, high] = bounds(model);
    let middle = (low + high) / 2.0;
    let across = direction.cross(&Vec3::ith(direction.iamin(), 1.0)).normalize();
    let along = direction.cross(&across);
    let half = (high - low) / 2.0;
    let reach = |axis: Vec3| half.component_mul(&axis).abs().sum();
    let held = held_nodes(model);

    let mut best: Option<(f64, Pick)> = None;
    for index in 0..RAYS * RAYS {
        let step = |i: usize| (i as f64 + 0.5) / RAYS as f64 * 2.0 - 1.0;
        let offset =
            across * (step(index % RAYS) * reach(across)) + along * (step(index / RAYS) * reach(along));
        let Some(pick) = cast(middle + offset)? else { continue };

        // Bone and held faces count up to where they are no longer felt; beyond that the middle of the body is preferred.
        let centre = pick.point_m + direction * (0.5 * room_m);
        let clearance = held.iter().map(|node| (node - centre).norm()).fold(2.0 * room_m, f64::min);
        let facing = -pick.normal.dot(&direction);
        let score = clearance + room_m * facing - 0.2 * offset.norm();
        if best.as_ref().is_none_or(|(highest, _)| score > *highest) {
            best = Some((score, pick));
        }
    }
    Ok(best.map(|(_, pick)| pick))
}

/// Rest positions of all nodes that are held or rigid, world frame.
fn held_nodes(model: &Model) -> Vec<Vec3> {
    let lattice = model.lattice();
    let stays = flag::FIX_ALL | flag::DRIVEN;
    lattice
        .slots()
        .filter(|&slot| lattice.flags()[slot as usize] & stays != 0)
        .map(|slot| (model.frame() * nalgebra::Point3::from(lattice.rest_position(slot))).coords)
        .collect()
}

/// Lowest and highest corner of the contact surface at rest, world frame.
fn bounds(model: &Model) -> [Vec3; 2] {
    let positions = &model.surfaces()[model.contact_surface()].positions;
    let world = positions.iter().map(|&p| (model.frame() * nalgebra::Point3::from(p)).coords);
    world.fold([Vec3::repeat(f64::MAX), Vec3::repeat(f64::MIN)], |[low, high], p| [low.inf(&p), high.sup(&p)])
}
