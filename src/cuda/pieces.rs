//! Pieces of divided cells on the device: what they weigh and, in the lattice, what they give to their nodes.

use std::sync::Arc;

use super::body::Body;
use super::kept::Kept;
use super::layout::{self, NO_PLACE, Pass, Piece};
use super::memory::{Buffer, Stream};
use crate::cpu::lattice::pieces::{Place, Places};
use crate::cut::topology::Topology;
use crate::error::Result;
use crate::model::lattice::BRICK_SLOTS;

/// Corners of a piece.
const CORNERS: usize = 8;

/// All pieces.
#[derive(Debug)]
pub struct Pieces {
    pieces: Vec<Piece>,
    places: Places,
    bricks: Kept<u32>,
    kg: Kept<f32>,
    springs: Option<Springs>,
    record: Kept<layout::Pieces>,
}

/// What it takes to evaluate them.
#[derive(Debug)]
struct Springs {
    all: Kept<Piece>,
    given: Buffer<[f32; 4]>,
    starts: Kept<u32>,
    hung: Kept<u32>,
}

impl Springs {
    fn new(stream: &Arc<Stream>, room: usize, places: usize) -> Result<Self> {
        Ok(Self {
            all: Kept::of(stream, Vec::new(), room)?,
            given: Buffer::zeros(stream, room * CORNERS)?,
            starts: Kept::of(stream, Vec::new(), places + 1)?,
            hung: Kept::of(stream, Vec::new(), room * CORNERS)?,
        })
    }
}

impl Pieces {
    /// None, with room for as many as there is for copies of nodes: a topology makes no more. `evaluates` says whether they give
    /// forces.
    pub fn new(body: &Body, evaluates: bool, stream: &Arc<Stream>) -> Result<Self> {
        let room = body.slot_count() - body.own_slots();
        let bricks = body.bricks.count();
        // A piece hangs on eight bricks at most.
        let places = bricks.min(CORNERS * room) * BRICK_SLOTS;
        let springs = evaluates.then(|| Springs::new(stream, room, places));
        Ok(Self {
            pieces: Vec::new(),
            places: Places::default(),
            bricks: Kept::of(stream, vec![NO_PLACE; if room > 0 { bricks + 1 } else { 0 }], 0)?,
            kg: Kept::of(stream, Vec::new(), places)?,
            springs: springs.transpose()?,
            record: Kept::of(stream, Vec::new(), 1)?,
        })
    }

    /// Takes over those of a topology.
    pub fn take(&mut self, topology: &Topology, body: &Body) -> Result<()> {
        self.pieces.clear();
        self.pieces.extend(topology.pieces().map(|(material, hung)| Piece {
            nodes: hung.nodes,
            material: material.into(),
            volume: hung.piece.volume as f32,
        }));
        let bricks = body.bricks.count();
        self.places = Places::of(self.pieces.iter().map(|piece| piece.nodes), bricks);
        // The empty brick has no place either.
        let mut of_brick = self.places.of_brick.clone();
        of_brick.push(NO_PLACE);
        self.bricks.set(of_brick)?;
        self.weigh(body)?;
        if let Some(springs) = &mut self.springs {
            springs.all.set(self.pieces.clone())?;
            springs.starts.set(self.places.starts.clone())?;
            let hung = |place: &Place| place.piece * CORNERS as u32 + place.corner;
            springs.hung.set(self.places.places.iter().map(hung).collect())?;
        }
        let (springs, count) = (self.springs.as_ref(), self.pieces.len() as u32);
        let record = layout::Pieces {
            count,
            all: springs.map_or(0, |springs| springs.all.at()),
            given: springs.map_or(0, |springs| springs.given.at()),
            starts: springs.map_or(0, |springs| springs.starts.at()),
            hung: springs.map_or(0, |springs| springs.hung.at()),
            kg: self.kg.at(),
        };
        self.record.set(vec![record])
    }

    /// Materials weigh otherwise.
    pub fn weigh(&mut self, body: &Body) -> Result<()> {
        let corner_kg = body.corner_kg();
        let kg = |piece: &Piece| corner_kg(piece.material as u8) * f64::from(piece.volume);
        let of_slot = |slot: usize| {
            let places = self.places.of_slot(slot).iter();
            places.map(|place| kg(&self.pieces[place.piece as usize])).sum::<f64>() as f32
        };
        self.kg.set((0..self.places.bricks.len() * BRICK_SLOTS).map(of_slot).collect())
    }

    /// All cells are whole again.
    pub fn heal(&mut self) {
        self.pieces.clear();
        self.places = Places::default();
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.pieces.len()
    }

    /// Tells a pass where they are.
    pub fn note_in(&self, pass: &mut Pass) {
        if self.count() > 0 {
            (pass.piece_bricks, pass.pieces) = (self.bricks.at(), self.record.at());
        }
    }

    /// Bytes on the device.
    pub fn bytes(&self) -> u64 {
        let springs = self.springs.iter().map(|springs| {
            springs.all.bytes() + springs.given.bytes() + springs.starts.bytes() + springs.hung.bytes()
        });
        self.bricks.bytes() + self.kg.bytes() + self.record.bytes() + springs.sum::<u64>()
    }
}
