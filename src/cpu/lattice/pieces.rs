//! Pieces of divided cells: springs and volume terms as of a whole cell, times the piece's share of its volume.
//!
//! Stiffness and mass shrink alike, so that no piece, however thin, asks for a shorter substep than a whole cell. Every piece is evaluated once in a
//! substep; its nodes then gather what it gives them, in the order of the pieces.

use std::cell::UnsafeCell;
use std::ops::Range;

use super::super::lanes::{Octet, Real};
use super::super::nodes::{BRICK_OCTETS, BRICK_ROWS};
use super::LawTables;
use crate::cut::topology::{HungPiece, Topology};
use crate::math::Num;
use crate::model::lattice::BRICK_SLOTS;
use crate::model::law::{SpringClass, sliver_damping, squared_change, volume_change};

/// A piece and the slots of its nodes.
#[derive(Clone, Copy, Debug)]
struct Piece<R> {
    nodes: [u32; 8],
    material: u8,
    volume: R,
}

/// What a piece gives to its nodes, in N, and how far it is strained.
#[derive(Clone, Copy, Debug, Default)]
struct Given<R> {
    forces: [[R; 3]; 8],
    strain: f32,
    swelling: f32,
    shrinking: f32,
}

/// A piece, and which of its corners a node is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub piece: u32,
    pub corner: u32,
}

/// Where nodes stand in pieces, brick by brick of those that pieces hang on.
#[derive(Debug, Default)]
pub(crate) struct Places {
    /// Where bricks stand among those that pieces hang on; `u32::MAX` for others. Empty before the first cut.
    pub of_brick: Vec<u32>,
    /// Those bricks, ascending.
    pub bricks: Vec<u32>,
    /// Where the places of each of their slots begin, and one more.
    pub starts: Vec<u32>,
    /// In the order of the pieces for each slot.
    pub places: Vec<Place>,
}

impl Places {
    /// Of pieces that hang on these nodes, among so many bricks.
    pub fn of(pieces: impl Iterator<Item = [u32; 8]>, bricks: usize) -> Self {
        let mut listed: Vec<(u32, Place)> = Vec::new();
        for (piece, nodes) in (0..).zip(pieces) {
            listed.extend((0..).zip(nodes).map(|(corner, slot)| (slot, Place { piece, corner })));
        }
        // Stable: nodes gather in the order of the pieces.
        listed.sort_by_key(|&(slot, _)| slot);

        let (mut of_brick, mut own) = (vec![u32::MAX; bricks], Vec::new());
        for &(slot, _) in &listed {
            let brick = slot / BRICK_SLOTS as u32;
            if own.last() != Some(&brick) {
                of_brick[brick as usize] = own.len() as u32;
                own.push(brick);
            }
        }
        let slots = own.len() * BRICK_SLOTS;
        let mut starts = vec![0; slots + 1];
        for &(slot, _) in &listed {
            let place = of_brick[slot as usize / BRICK_SLOTS] as usize;
            starts[place * BRICK_SLOTS + slot as usize % BRICK_SLOTS + 1] += 1;
        }
        for slot in 0..slots {
            starts[slot + 1] += starts[slot];
        }
        let places = listed.iter().map(|&(_, place)| place).collect();
        Self { of_brick, bricks: own, starts, places }
    }

    /// Those of a slot of one of the bricks: 128 times that brick's place, and the slot's own place in it.
    pub fn of_slot(&self, slot: usize) -> &[Place] {
        &self.places[self.starts[slot] as usize..self.starts[slot + 1] as usize]
    }
}

/// The pieces of a lattice that was cut.
#[derive(Debug, Default)]
pub struct Pieces<R> {
    pieces: Vec<Piece<R>>,
    given: Vec<UnsafeCell<Given<R>>>,
    places: Places,
    /// What pieces weigh at each of their slots, in kg.
    mass: Vec<Octet<R>>,
}

// SAFETY: `given` alone is written through a shared reference, each entry by the one thread whose share of the pieces it is in; threads meet before any reads it.
unsafe impl<R: Send + Sync> Sync for Pieces<R> {}

impl<R: Real> Pieces<R> {
    /// Of a topology, on so many bricks.
    pub fn new(topology: &Topology, bricks: usize, corner_kg: &[f64; 16]) -> Self {
        let piece = |(material, hung): (u8, HungPiece)| Piece {
            nodes: hung.nodes,
            material,
            volume: R::splat(hung.piece.volume),
        };
        let pieces: Vec<_> = topology.pieces().map(piece).collect();
        let mut all = Self {
            given: pieces.iter().map(|_| UnsafeCell::default()).collect(),
            mass: Vec::new(),
            places: Places::of(pieces.iter().map(|piece| piece.nodes), bricks),
            pieces,
        };
        all.weigh(corner_kg);
        all
    }

    /// What pieces weigh, by the mass of a whole cell's corner of each material.
    pub fn weigh(&mut self, corner_kg: &[f64; 16]) {
        let kg = |place: &Place| {
            let piece = &self.pieces[place.piece as usize];
            corner_kg[usize::from(piece.material)] * piece.volume.to_f64()
        };
        let of_slot = |slot: usize| -> f64 { self.places.of_slot(slot).iter().map(kg).sum() };
        let slots = self.places.bricks.len() * BRICK_SLOTS;
        self.mass = (0..slots / 8)
            .map(|octet| Octet(std::array::from_fn(|lane| R::splat(of_slot(octet * 8 + lane)))))
            .collect();
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.pieces.len()
    }

    /// The bricks that they hang on, ascending.
    pub fn bricks(&self) -> &[u32] {
        &self.places.bricks
    }

    /// Where a brick stands among those.
    #[inline(always)]
    pub fn place_of(&self, brick: usize) -> Option<usize> {
        let place = *self.places.of_brick.get(brick)?;
        (place != u32::MAX).then_some(place as usize)
    }

    /// What the nodes in a row of a brick receive, and what pieces weigh at them.
    ///
    /// # Safety
    /// The brick stands at `place`, and nobody evaluates pieces meanwhile.
    pub unsafe fn gather(&self, place: usize, row: usize) -> ([Octet<R>; 3], &Octet<R>) {
        let mut forces = [Octet::<R>::default(); 3];
        for lane in 0..8 {
            let slot = place * BRICK_SLOTS + row * 8 + lane;
            for at in self.places.of_slot(slot) {
                // SAFETY: as the caller promises.
                let given = unsafe { &*self.given[at.piece as usize].get() };
                for c in 0..3 {
                    let number = &mut forces[c].0[lane];
                    *number = number.add(given.forces[at.corner as usize][c]);
                }
            }
        }
        (forces, &self.mass[place * BRICK_ROWS + row])
    }

    /// Evaluates some of the pieces under displacements `u` and velocities `v`.
    ///
    /// # Safety
    /// Those pieces are the caller's alone, `u` and `v` are fields of all slots, and nobody writes them.
    pub unsafe fn evaluate(
        &self,
        some: Range<usize>,
        laws: &LawTables<R>,
        u: *const Octet<R>,
        v: *const Octet<R>,
    ) {
        let classes = [1, 2, 3].map(|diagonal| SpringClass::new(diagonal, laws.h));
        for piece in some {
            let nodes = &self.pieces[piece].nodes;
            // SAFETY: as the caller promises.
            let read = |field: *const Octet<R>| nodes.map(|slot| unsafe { vector(field, slot) });
            let given = self.pieces[piece].give(laws, &classes, &read(u), &read(v));
            // SAFETY: as the caller promises.
            unsafe { *self.given[piece].get() = given };
        }
    }

    /// The largest strain of an edge, J − 1 and 1 − J of all pieces.
    pub fn extremes(&mut self) -> [f32; 3] {
        self.given.iter_mut().map(UnsafeCell::get_mut).fold(
            [0.0; 3],
            |[strain, swelling, shrinking], given| {
                [strain.max(given.strain), swelling.max(given.swelling), shrinking.max(given.shrinking)]
            },
        )
    }
}

impl<R: Real> Piece<R> {
    fn give(
        &self,
        laws: &LawTables<R>,
        classes: &[SpringClass<R>; 3],
        u: &[[R; 3]; 8],
        v: &[[R; 3]; 8],
    ) -> Given<R> {
        let material = usize::from(self.material);
        let (stiffness, damper) =
            (laws.spring[material].mul(self.volume), laws.damper[material].mul(self.volume));
        let (h, h2) = (R::splat(laws.h), R::splat(2.0 * laws.h));
        let mut given = Given::default();
        for a in 0..8_usize {
            for b in a + 1..8 {
                // Corners differ in one, two or three bits: an edge, a face diagonal or a body diagonal.
                let diagonal = (a ^ b).count_ones();
                let class = &classes[diagonal as usize - 1];
                let apart =
                    |field: &[[R; 3]; 8]| -> [R; 3] { std::array::from_fn(|c| field[b][c].sub(field[a][c])) };
                let (d, mut rd, mut way) = (apart(u), R::default(), [R::default(); 3]);
                for axis in 0..3 {
                    way[axis] = d[axis];
                    match (b >> axis & 1, a >> axis & 1) {
                        (1, 0) => (rd, way[axis]) = (rd.add(d[axis]), way[axis].add(h)),
                        (0, 1) => (rd, way[axis]) = (rd.sub(d[axis]), way[axis].sub(h)),
                        _ => {}
                    }
                }
                let elongation = class.elongation(squared_change(d, rd, h2));
                // Rigid cells have none.
                if diagonal == 1 && stiffness.to_f64() > 0.0 {
                    given.strain = given.strain.max(elongation.to_f64().abs() as f32);
                }
                let mut pull = stiffness.mul(elongation);
                if laws.damped {
                    let dv = apart(v);
                    let rate = way[0].fma(dv[0], way[1].fma(dv[1], way[2].mul(dv[2])));
                    pull = damper.mul(class.damping).fma(rate, pull);
                }
                for c in 0..3 {
                    given.forces[a][c] = pull.fma(way[c], given.forces[a][c]);
                    given.forces[b][c] = given.forces[b][c].sub(pull.mul(way[c]));
                }
            }
        }
        let damping = sliver_damping(laws.spring[material], laws.corner[material], self.volume);
        if damping.to_f64() > 0.0 {
            for c in 0..3 {
                let mean = v.iter().map(|v| v[c]).fold(R::default(), Num::add).mul(R::splat(0.125));
                for (force, v) in given.forces.iter_mut().zip(v) {
                    force[c] = force[c].sub(damping.mul(v[c].sub(mean)));
                }
            }
        }
        add_volume(laws.volume[material].mul(self.volume), laws.h, u, &mut given);
        given
    }
}

/// Adds the forces of the volume term.
fn add_volume<R: Real>(stiffness: R, h: f64, u: &[[R; 3]; 8], given: &mut Given<R>) {
    if stiffness.to_f64() == 0.0 {
        return;
    }
    let inverse_4h = R::splat(0.25 / h);
    let gradient: [[R; 3]; 3] = std::array::from_fn(|c| {
        std::array::from_fn(|axis| {
            let signed = |corner: usize| {
                if corner >> axis & 1 == 1 { u[corner][c] } else { R::default().sub(u[corner][c]) }
            };
            (0..8).map(signed).fold(R::default(), Num::add).mul(inverse_4h)
        })
    });
    let (cof, change) = volume_change(gradient);
    given.swelling = change.to_f64().max(0.0) as f32;
    given.shrinking = (-change.to_f64()).max(0.0) as f32;
    let p = stiffness.mul(change);
    for corner in 0..8 {
        for c in 0..3 {
            let along = |axis: usize| {
                if corner >> axis & 1 == 1 { cof[c][axis] } else { R::default().sub(cof[c][axis]) }
            };
            let sum = along(0).add(along(1)).add(along(2));
            given.forces[corner][c] = given.forces[corner][c].sub(p.mul(sum));
        }
    }
}

/// The vector of a slot.
///
/// # Safety
/// The field has the slot, and nobody writes it.
unsafe fn vector<R: Real>(field: *const Octet<R>, slot: u32) -> [R; 3] {
    let (brick, local) = (slot as usize / BRICK_SLOTS, slot as usize % BRICK_SLOTS);
    let octet = brick * BRICK_OCTETS + local / 8;
    // SAFETY: as the caller promises.
    std::array::from_fn(|c| unsafe { (*field.add(octet + c * BRICK_ROWS)).0[local % 8] })
}
