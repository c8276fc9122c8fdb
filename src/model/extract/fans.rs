//! How the boundary faces around a grid node hang together: one vertex for each fan of faces.

use crate::math::Vec3;

/// Faces that meet at a node: four in each of three planes.
const FACES: usize = 12;
/// Not a boundary face.
const NO_FAN: u8 = u8::MAX;

/// One of the six grid edges that leave a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct HalfEdge {
    pub axis: usize,
    pub upper: bool,
}

/// How the boundary faces around one node hang together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fan {
    /// The fan of each face `[FACES]`, counted from 0, or [`NO_FAN`]. See [`face_at`] for the order.
    pub of_face: [u8; FACES],
    /// Number of fans, at most 4.
    pub count: u8,
}

/// The fans for each of the 256 patterns of inside cells around a node.
///
/// Two faces belong to one fan when they follow each other around a grid edge. Where two inside cells touch
/// only along an edge, four faces meet there, and a pair has to be chosen. `plain` keeps the inside cells
/// apart. A fan may then pass the same edge twice (it is *pinched*, which happens at one edge only); should
/// that be so at both ends of the edge, the surface could not be a manifold, and `rejoined` pairs the faces
/// around the outside cells instead.
pub(super) struct Fans {
    pub plain: [Fan; 256],
    pub rejoined: [Fan; 256],
    pub pinched: [Option<HalfEdge>; 256],
}

impl Fans {
    pub fn new() -> Self {
        let plain = std::array::from_fn(|octants| join_faces(octants, None));
        let pinched = std::array::from_fn(|octants| {
            half_edges().find(|&edge| {
                let faces = faces_around(edge);
                let fan = |n: usize| plain[octants].of_face[faces[n]];
                fan(0) != NO_FAN && (1..4).all(|n| fan(n) == fan(0))
            })
        });
        let rejoined = std::array::from_fn(|octants| join_faces(octants, pinched[octants]));
        Self { plain, rejoined, pinched }
    }
}

/// The place of a face in [`Fan::of_face`]: the face normal to `axis` that lies on side `b` of the next axis
/// and on side `c` of the one after.
pub(super) fn face_at(axis: usize, b: usize, c: usize) -> usize {
    axis * 4 + b + 2 * c
}

/// The octants on both sides of a face, in ascending order.
fn sides_of(face: usize) -> [usize; 2] {
    let (axis, b, c) = (face / 4, face % 2, face / 2 % 2);
    let lower = b << ((axis + 1) % 3) | c << ((axis + 2) % 3);
    [lower, lower | 1 << axis]
}

fn half_edges() -> impl Iterator<Item = HalfEdge> {
    (0..3).flat_map(|axis| [false, true].map(|upper| HalfEdge { axis, upper }))
}

/// The four octants around an edge, in cyclic order.
fn octants_around(edge: HalfEdge) -> [usize; 4] {
    let along = usize::from(edge.upper) << edge.axis;
    let (b, c) = (1 << ((edge.axis + 1) % 3), 1 << ((edge.axis + 2) % 3));
    [along, along | b, along | b | c, along | c]
}

/// The four faces around an edge; face n lies between octants n and n + 1 of [`octants_around`].
fn faces_around(edge: HalfEdge) -> [usize; 4] {
    let octants = octants_around(edge);
    std::array::from_fn(|n| {
        let mut sides = [octants[n], octants[(n + 1) % 4]];
        sides.sort_unstable();
        (0..FACES).find(|&face| sides_of(face) == sides).expect("neighbouring octants share a face")
    })
}

/// The fans of one pattern of inside cells. Faces are joined around inside cells, at the edge `rejoined`
/// around outside cells.
fn join_faces(octants: usize, rejoined: Option<HalfEdge>) -> Fan {
    let is_inside = |octant: usize| octants >> octant & 1 == 1;

    // Every boundary face starts as a fan of its own, named after itself.
    let mut fans: [u8; FACES] = std::array::from_fn(|face| {
        let [lower, upper] = sides_of(face);
        if is_inside(lower) == is_inside(upper) { NO_FAN } else { face as u8 }
    });
    let mut join = |one: usize, two: usize| {
        let (keep, drop) = (fans[one].min(fans[two]), fans[one].max(fans[two]));
        for fan in fans.iter_mut().filter(|fan| **fan == drop) {
            *fan = keep;
        }
    };

    for edge in half_edges() {
        let (around, faces) = (octants_around(edge), faces_around(edge));
        let boundary = |n: usize| is_inside(around[n]) != is_inside(around[(n + 1) % 4]);
        let boundary_count = (0..4).filter(|&n| boundary(n)).count();
        if boundary_count == 2 {
            let mut two = (0..4).filter(|&n| boundary(n));
            if let (Some(one), Some(other)) = (two.next(), two.next()) {
                join(faces[one], faces[other]);
            }
        } else if boundary_count == 4 {
            let joined_side = rejoined != Some(edge);
            for n in (0..4).filter(|&n| is_inside(around[n]) == joined_side) {
                join(faces[(n + 3) % 4], faces[n]);
            }
        }
    }
    number_fans(fans)
}

/// Renames fans to 0, 1, 2, …
fn number_fans(fans: [u8; FACES]) -> Fan {
    let mut of_face = [NO_FAN; FACES];
    let mut count = 0;
    for face in 0..FACES {
        if fans[face] == NO_FAN {
            continue;
        }
        // A fan is named after its first face, which has been numbered by the time a later one is met.
        let first = fans[face] as usize;
        if first == face {
            of_face[face] = count;
            count += 1;
        } else {
            of_face[face] = of_face[first];
        }
    }
    Fan { of_face, count }
}

/// The mean of the centres of a fan's faces, from the node, in cells.
pub(super) fn fan_centre(fan: &Fan, id: u8) -> Vec3 {
    let (mut sum, mut count) = (Vec3::zeros(), 0.0);
    for face in (0..FACES).filter(|&face| fan.of_face[face] == id) {
        let (axis, b, c) = (face / 4, face % 2, face / 2 % 2);
        sum[(axis + 1) % 3] += b as f64 - 0.5;
        sum[(axis + 2) % 3] += c as f64 - 0.5;
        count += 1.0;
    }
    sum / count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fan_is_pinched_at_one_edge_only_and_rejoining_opens_it() {
        let fans = Fans::new();
        let mut pinched_count = 0;
        for octants in 0..256 {
            let Some(edge) = fans.pinched[octants] else { continue };
            pinched_count += 1;
            let ambiguous = half_edges()
                .filter(|&edge| {
                    let around = octants_around(edge).map(|c| octants >> c & 1);
                    around[0] == around[2] && around[1] == around[3] && around[0] != around[1]
                })
                .count();
            assert_eq!(ambiguous, 1, "octants {octants:08b}");

            let faces = faces_around(edge).map(|face| fans.rejoined[octants].of_face[face]);
            assert!(faces.iter().any(|&fan| fan != faces[0]), "octants {octants:08b}");
        }
        assert!(pinched_count > 0);
    }
}
