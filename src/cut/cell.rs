//! What cuts make of one cell: its pieces, their volumes, and the walls between them.
//!
//! A cell knows of its cuts where they cross its twelve edges. Corners that uncut edges connect are one *piece*: a cell that a blade has crossed in part is
//! still whole, and every piece has a corner of its own. Walls run between the crossings as in marching cubes, over a point on each face and one inside for each
//! sheet; they lie in a plane where the cut does, and neighbours that share a face see the same lines on it.

use crate::math::Vec3;
use crate::model::binding::shares;

/// An edge of a cell: the corner that it starts from, of which corner c is at offset `(c & 1, c >> 1 & 1, c >> 2 & 1)`, and its axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// The corner with the lower coordinate.
    pub low: usize,
    /// The axis that it runs along.
    pub axis: usize,
}

impl Edge {
    /// The corner at the other end.
    pub fn high(self) -> usize {
        self.low | 1 << self.axis
    }
}

/// A cell's edges: four along x, four along y, four along z.
pub const EDGES: [Edge; 12] = {
    let mut edges = [Edge { low: 0, axis: 0 }; 12];
    let mut e = 0;
    while e < 12 {
        let (axis, k) = (e / 4, e % 4);
        edges[e] = Edge { low: (k & 1) << ((axis + 1) % 3) | (k >> 1) << ((axis + 2) % 3), axis };
        e += 1;
    }
    edges
};

/// A face: its four corners, counter-clockwise seen from outside, and the edges that follow each.
#[derive(Clone, Copy, Debug)]
struct Face {
    corners: [usize; 4],
    edges: [usize; 4],
}

/// Number of the edge between two corners.
const fn edge_between(a: usize, b: usize) -> usize {
    let low = if a < b { a } else { b };
    let axis = (a ^ b).trailing_zeros() as usize;
    axis * 4 + (low >> ((axis + 1) % 3) & 1) + 2 * (low >> ((axis + 2) % 3) & 1)
}

/// A cell's faces: low and high x, low and high y, low and high z.
const FACES: [Face; 6] = {
    let mut faces = [Face { corners: [0; 4], edges: [0; 4] }; 6];
    let mut f = 0;
    while f < 6 {
        let (axis, side) = (f / 2, f % 2);
        let (a, b) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        let base = side << axis;
        let around = if side == 1 { [0, a, a | b, b] } else { [0, b, a | b, a] };
        let mut n = 0;
        while n < 4 {
            faces[f].corners[n] = base | around[n];
            n += 1;
        }
        n = 0;
        while n < 4 {
            faces[f].edges[n] = edge_between(faces[f].corners[n], faces[f].corners[(n + 1) % 4]);
            n += 1;
        }
        f += 1;
    }
    faces
};

/// Where each edge of a cell is cut, as a share of its length from its low corner; `None` where it is not.
pub type Crossings = [Option<f64>; 12];

/// A part of a cell that no uncut edge connects to the rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Its corners, a bit for each.
    pub corners: u8,
    /// Its volume as a share of the cell's.
    pub volume: f64,
    /// Its centroid in the cell, from 0 to 1 along each axis.
    pub centroid: Vec3,
}

impl Piece {
    /// Trilinear weights of the cell's corners at the centroid.
    pub fn shares(&self) -> [f64; 8] {
        shares(&self.centroid)
    }
}

/// A triangle of a wall between two pieces. It faces the first: its corners run counter-clockwise seen from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// Indices of the pieces that it parts.
    pub pieces: [usize; 2],
    /// Its corners in the cell, from 0 to 1 along each axis: the crossing of an edge, then a point on a face and one inside.
    pub corners: [Vec3; 3],
    /// Where in the cell it is.
    pub place: Place,
}

/// Where in its cell a wall's triangle is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// The edge at whose crossing its first corner is, as in [`EDGES`].
    pub edge: usize,
    /// The face that its second corner lies on: twice its axis, and one more for the high side.
    pub face: usize,
    /// Which of that face's edges it is, counter-clockwise seen from outside.
    pub turn: usize,
    /// The sheet whose point inside its third corner is.
    pub sheet: usize,
    /// The corner of the cell at that edge which the wall faces.
    pub corner: usize,
}

/// A cell as its cuts have left it.
#[derive(Clone, Debug, PartialEq)]
pub struct Partition {
    /// Its pieces, by their lowest corners. Their volumes sum to one.
    pub pieces: Vec<Piece>,
    /// The walls between them.
    pub walls: Vec<Wall>,
}

/// Where a corner is.
fn corner_at(corner: usize) -> Vec3 {
    Vec3::from_fn(|axis, _| (corner >> axis & 1) as f64)
}

/// Groups of the corners that uncut edges connect, as bits, by their lowest corners.
pub fn groups(crossings: &Crossings) -> Vec<u8> {
    let mut group: [usize; 8] = std::array::from_fn(|c| c);
    // The lowest corner of a group wanders three edges at most in a whole cell, seven along a path of single edges.
    for _ in 0..7 {
        for (edge, crossing) in EDGES.iter().zip(crossings) {
            if crossing.is_none() {
                let lowest = group[edge.low].min(group[edge.high()]);
                (group[edge.low], group[edge.high()]) = (lowest, lowest);
            }
        }
    }
    let mut bits = [0_u8; 8];
    for corner in 0..8 {
        bits[group[corner]] |= 1 << corner;
    }
    bits.into_iter().filter(|&b| b != 0).collect()
}

/// Cuts a cell into its pieces; `None` where it is still whole.
pub fn divide(crossings: &Crossings) -> Option<Partition> {
    let groups = groups(crossings);
    if groups.len() < 2 {
        return None;
    }
    let piece_of = |corner: usize| {
        groups.iter().position(|bits| bits >> corner & 1 != 0).expect("every corner is in one")
    };
    let on_edge: [Vec3; 12] = std::array::from_fn(|e| {
        let Edge { low, axis } = EDGES[e];
        let mut at = corner_at(low);
        at[axis] = crossings[e].unwrap_or(0.5);
        at
    });
    let is_cut = |e: usize| crossings[e].is_some();
    let on_face = FACES.map(|face| {
        mean(face.edges.into_iter().filter(|&e| is_cut(e)).map(|e| on_edge[e]))
            .unwrap_or_else(|| mean(face.corners.into_iter().map(corner_at)).expect("four corners"))
    });
    let sheet = sheets(crossings);
    // A sheet's point inside: the mean of where it crosses faces.
    let inside: [Vec3; 12] = std::array::from_fn(|s| {
        let faces = (0..6).filter(|&f| {
            let mut cut = FACES[f].edges.into_iter().filter(|&e| is_cut(e) && sheet[e] == s);
            cut.next().is_some() && cut.next().is_some()
        });
        mean(faces.map(|f| on_face[f])).unwrap_or_else(|| Vec3::repeat(0.5))
    });

    let mut walls = Vec::new();
    let mut sums = vec![Moments::default(); groups.len()];
    for f in 0..6 {
        let Face { corners, edges } = FACES[f];
        for n in 0..4 {
            let (before, after) = (edges[(n + 3) % 4], edges[n]);
            let sum = &mut sums[piece_of(corners[n])];
            sum.add([corner_at(corners[n]), on_edge[after], on_face[f]]);
            sum.add([corner_at(corners[n]), on_face[f], on_edge[before]]);
            // The wall that leaves this face at the edge behind the corner: seen from that corner, the face is on the right.
            let pieces = [piece_of(corners[n]), piece_of(corners[(n + 1) % 4])];
            if is_cut(after) && pieces[0] != pieces[1] {
                let triangle = [on_edge[after], on_face[f], inside[sheet[after]]];
                let turned = [triangle[0], triangle[2], triangle[1]];
                sums[pieces[0]].add(turned);
                sums[pieces[1]].add(triangle);
                let place = Place { edge: after, face: f, turn: n, sheet: sheet[after], corner: corners[n] };
                walls.push(Wall { pieces, corners: triangle, place });
            }
        }
    }
    let pieces = groups.iter().zip(&sums).map(|(&corners, sum)| sum.piece(corners)).collect();
    Some(Partition { pieces, walls })
}

/// The mean of some points.
fn mean(points: impl Iterator<Item = Vec3>) -> Option<Vec3> {
    let (sum, count) = points.fold((Vec3::zeros(), 0.0), |(sum, count), p| (sum + p, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// The sheet that each cut edge belongs to, by its lowest edge: sheets are connected over faces.
fn sheets(crossings: &Crossings) -> [usize; 12] {
    let mut sheet: [usize; 12] = std::array::from_fn(|e| e);
    // Every round that changes something joins at least two of twelve.
    for _ in 0..11 {
        for face in &FACES {
            let cut = || face.edges.into_iter().filter(|&e| crossings[e].is_some());
            if let Some(lowest) = cut().map(|e| sheet[e]).min() {
                cut().for_each(|e| sheet[e] = lowest);
            }
        }
    }
    sheet
}

/// Volume and first moment of a solid, from triangles that face outward.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    volume: f64,
    first: Vec3,
}

impl Moments {
    /// Adds the tetrahedron between a triangle and the origin.
    fn add(&mut self, [a, b, c]: [Vec3; 3]) {
        let volume = a.dot(&b.cross(&c)) / 6.0;
        self.volume += volume;
        self.first += (a + b + c) * (volume / 4.0);
    }

    fn piece(&self, corners: u8) -> Piece {
        // What is cut off next to nothing has its centroid where its corners are.
        let anywhere =
            || mean((0..8).filter(|c| corners >> c & 1 != 0).map(corner_at)).expect("a piece has a corner");
        let centroid = if self.volume > 1e-12 { self.first / self.volume } else { anywhere() };
        Piece { corners, volume: self.volume.max(0.0), centroid: centroid.map(|x| x.clamp(0.0, 1.0)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::Noise;

    /// The crossings of a cell by the plane n · x = d.
    fn by_plane(n: Vec3, d: f64) -> Crossings {
        EDGES.map(|edge| {
            let low = n.dot(&corner_at(edge.low)) - d;
            let high = n.dot(&corner_at(edge.high())) - d;
            (low * high < 0.0).then(|| low / (low - high))
        })
    }

    fn random_direction(noise: &mut Noise) -> Vec3 {
        Vec3::from_fn(|_, _| noise.next()).normalize()
    }

    /// Volume of what lies below a plane in the unit cell (n · x < d), by inclusion and exclusion over its corners.
    fn below(n: Vec3, d: f64) -> f64 {
        // Axes turned so that the normal has no negative component.
        let d = d - n.iter().filter(|&&x| x < 0.0).sum::<f64>();
        let n = n.abs();
        let cubes = (0..8).map(|corner| {
            let sign = if (corner as u32).count_ones().is_multiple_of(2) { 1.0 } else { -1.0 };
            sign * (d - n.dot(&corner_at(corner))).max(0.0).powi(3)
        });
        cubes.sum::<f64>() / (6.0 * n.x * n.y * n.z)
    }

    #[test]
    fn a_plane_parts_a_cell_into_its_exact_volumes_by_walls_in_the_plane() {
        let mut noise = Noise(3);
        let mut divided = 0;
        for _ in 0..2000 {
            let n = random_direction(&mut noise);
            let d = n.dot(&Vec3::from_fn(|_, _| 0.5 + 0.5 * noise.next()));
            let Some(partition) = divide(&by_plane(n, d)) else { continue };
            divided += 1;
            assert_eq!(partition.pieces.len(), 2);
            let mut volumes = [0.0; 2];
            for piece in &partition.pieces {
                let side = n.dot(&corner_at(piece.corners.trailing_zeros() as usize)) > d;
                volumes[usize::from(side)] = piece.volume;
                assert!((n.dot(&piece.centroid) > d) == side || piece.volume < 1e-6);
            }
            // Inclusion and exclusion cancel where a component of the normal is small.
            let lost = 1e-15 / (n.x * n.y * n.z).abs();
            assert!((volumes[0] - below(n, d)).abs() < 1e-12 + lost, "{volumes:?} {}", below(n, d));
            for wall in &partition.walls {
                assert!(wall.corners.iter().all(|p| (n.dot(p) - d).abs() < 1e-12));
                let [a, b, c] = wall.corners;
                let toward =
                    corner_at(partition.pieces[wall.pieces[0]].corners.trailing_zeros() as usize) - a;
                assert!(
                    (b - a).cross(&(c - a)).dot(&n) * toward.dot(&n) >= -1e-12,
                    "a wall faces its first piece"
                );
            }
        }
        assert!(divided > 1500);
    }

    #[test]
    fn whatever_edges_are_cut_pieces_have_the_volume_of_the_cell_and_walls_close_them() {
        let mut noise = Noise(5);
        for _ in 0..4000 {
            let crossings: Crossings =
                std::array::from_fn(|_| (noise.next() > -0.2).then(|| 0.5 + 0.49 * noise.next()));
            let Some(partition) = divide(&crossings) else { continue };
            let total: f64 = partition.pieces.iter().map(|piece| piece.volume).sum();
            assert!((total - 1.0).abs() < 1e-12, "{total}");
            let all = partition.pieces.iter().fold(0, |all, piece| all ^ piece.corners);
            assert_eq!(all, 0xff);
            let first: Vec3 = partition.pieces.iter().map(|piece| piece.centroid * piece.volume).sum();
            assert!((first - Vec3::repeat(0.5)).norm() < 1e-9);
        }
    }

    #[test]
    fn a_cell_that_a_blade_has_not_crossed_to_the_end_is_whole() {
        // A half plane x = 0.3, y < 0.6: two edges along x are cut, and the others hold.
        let crossings = EDGES.map(|edge| (edge.axis == 0 && edge.low & 2 == 0).then_some(0.3));
        assert_eq!(crossings.iter().flatten().count(), 2);
        assert!(divide(&crossings).is_none());
        let crossings = EDGES.map(|edge| (edge.axis == 0).then_some(0.3));
        let partition = divide(&crossings).unwrap();
        assert_eq!(partition.pieces.iter().map(|piece| piece.corners).collect::<Vec<_>>(), [0x55, 0xaa]);
        assert!((partition.pieces[0].volume - 0.3).abs() < 1e-15);
        assert!((partition.pieces[0].centroid - Vec3::new(0.15, 0.5, 0.5)).norm() < 1e-15);
    }

    #[test]
    fn two_corners_that_are_cut_off_have_walls_of_their_own() {
        // By planes a tenth from two opposite corners.
        let near = |corner: usize, edge: &Edge| edge.low == corner || edge.high() == corner;
        let crossings = std::array::from_fn(|e| {
            let edge = &EDGES[e];
            near(0, edge).then_some(0.1).or_else(|| near(7, edge).then_some(0.9))
        });
        let partition = divide(&crossings).unwrap();
        let volumes: Vec<f64> = partition.pieces.iter().map(|piece| piece.volume).collect();
        assert!((volumes[0] - 1e-3 / 6.0).abs() < 1e-12 && (volumes[2] - 1e-3 / 6.0).abs() < 1e-12);
    }
}
