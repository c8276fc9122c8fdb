//! Which parts of walls are inside of a surface.

use super::arrange::{Arrangement, Scene, edges};
use super::hash::Map;
use super::index::{Index, cells_in};
use super::jitter::{Tie, passage};
use crate::math::Vec3;

/// Whether each part of the walls is inside of the surface: what is left of a segment on a wall is inside, and what no segment parts is on the same side. `is_known` says
/// whether an edge is one of a part that is known to be inside.
pub fn inside(
    scene: Scene<'_>,
    index: &Index,
    arrangement: &Arrangement,
    is_known: impl Fn([u32; 2]) -> bool,
) -> Result<Vec<bool>, Tie> {
    let (parts, segments) = (&arrangement.walls, &arrangement.segments);
    let mut at_edge: Map<[u32; 2], Vec<u32>> = Map::default();
    let mut is_inside: Vec<Option<bool>> = vec![None; parts.len()];
    let mut stack = Vec::new();
    let turned = |[a, b]: [u32; 2]| [b, a];
    let sorted = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    for (n, (_, part)) in parts.iter().enumerate() {
        for edge in edges(*part) {
            let seen = if segments.contains(&edge) {
                true
            } else if segments.contains(&turned(edge)) {
                false
            } else {
                at_edge.entry(sorted(edge)).or_default().push(n as u32);
                if !is_known(edge) {
                    continue;
                }
                true
            };
            if is_inside[n].replace(seen).is_some_and(|before| before != seen) {
                return Err(Tie);
            }
            stack.push(n as u32);
        }
    }
    for n in 0..=parts.len() {
        while let Some(at) = stack.pop() {
            for edge in edges(parts[at as usize].1) {
                // At a segment the surface is between the two.
                let Some(beside) = at_edge.get(&sorted(edge)) else { continue };
                for &next in beside {
                    match is_inside[next as usize] {
                        None => {
                            is_inside[next as usize] = is_inside[at as usize];
                            stack.push(next);
                        }
                        seen if seen != is_inside[at as usize] => return Err(Tie),
                        Some(_) => {}
                    }
                }
            }
        }
        // Walls that the surface does not meet are all inside, or all outside.
        if n < parts.len() && is_inside[n].is_none() {
            let point = scene.walls.triangles[parts[n].0].corners[2];
            is_inside[n] = Some(encloses(scene, index, scene.walls.points[point].beside)?);
            stack.push(n as u32);
        }
    }
    Ok(is_inside.into_iter().map(|inside| inside == Some(true)).collect())
}

/// Whether a point is inside of the surface: how often a ray along x leaves it.
fn encloses(scene: Scene<'_>, index: &Index, point: Vec3) -> Result<bool, Tie> {
    let [cell, _] = cells_in(&point, &point, scene.cell_m);
    let along: Vec<[Vec3; 3]> = index.triangles_along(cell).into_iter().map(|t| scene.beside(t)).collect();
    let mut beyond = point;
    beyond.x = along.iter().flatten().fold(point.x, |x, p| x.max(p.x)) + 1.0;
    let mut leaves = 0;
    for triangle in along {
        if let Some(found) = passage(triangle, point, beyond)? {
            leaves += if found.is_upward { 1 } else { -1 };
        }
    }
    Ok(leaves > 0)
}
