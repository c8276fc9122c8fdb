//! Fairing: a surface is bent as little as the rooms of its vertices allow.

use crate::math::Vec3;

/// Smoothing passes. The terraces of a gentle slope are tens of cells wide, and 100 passes level those of
/// about 20.
const PASSES: usize = 100;
/// Step length against the gradient; 1/4 is the largest stable one, since no eigenvalue of the squared
/// deviation operator exceeds 4.
const STEP: f64 = 0.25;

/// The lowest and highest corner of the box that a vertex may not leave, in cells.
pub(super) type Room = [Vec3; 2];

/// The nearest place inside a room.
pub(super) fn into_room(position: &Vec3, room: &Room) -> Vec3 {
    position.sup(&room[0]).inf(&room[1])
}

/// The vertices at the other end of each vertex's edges, in compressed rows.
pub(super) struct Neighbours {
    starts: Vec<u32>,
    vertex_of: Vec<u32>,
}

impl Neighbours {
    /// In a closed manifold every edge is run through once in each direction, so that the vertex after v in
    /// each quadrilateral of v gives each neighbour once.
    pub fn new(vertex_count: usize, quads: &[[u32; 4]]) -> Self {
        let mut starts = vec![0_u32; vertex_count + 1];
        for &v in quads.iter().flatten() {
            starts[v as usize + 1] += 1;
        }
        for v in 0..vertex_count {
            starts[v + 1] += starts[v];
        }

        let mut next = starts.clone();
        let mut vertex_of = vec![0; 4 * quads.len()];
        for quad in quads {
            for n in 0..4 {
                let place = &mut next[quad[n] as usize];
                vertex_of[*place as usize] = quad[(n + 1) % 4];
                *place += 1;
            }
        }
        Self { starts, vertex_of }
    }

    /// How far each vertex's value lies from the mean of its neighbours'.
    fn deviations(&self, values: &[Vec3], deviations: &mut [Vec3]) {
        for (v, deviation) in deviations.iter_mut().enumerate() {
            let row = &self.vertex_of[self.starts[v] as usize..self.starts[v + 1] as usize];
            let sum: Vec3 = row.iter().map(|&n| values[n as usize]).sum();
            *deviation = values[v] - sum / row.len() as f64;
        }
    }
}

/// Makes the bending Σ |deviation|² small within each vertex's room, by projected gradient steps with
/// momentum: the n-th step starts from a point (n − 1) / (n + 2) of the last movement ahead.
pub(super) fn fair(positions: &mut [Vec3], rooms: &[Room], neighbours: &Neighbours) {
    let mut ahead = positions.to_vec();
    let mut deviations = vec![Vec3::zeros(); positions.len()];
    let mut bending = deviations.clone();

    for pass in 1..=PASSES {
        neighbours.deviations(&ahead, &mut deviations);
        neighbours.deviations(&deviations, &mut bending);
        let momentum = (pass as f64 - 1.0) / (pass as f64 + 2.0);
        for v in 0..positions.len() {
            let moved = into_room(&(ahead[v] - bending[v] * STEP), &rooms[v]);
            ahead[v] = moved + (moved - positions[v]) * momentum;
            positions[v] = moved;
        }
    }
}
