//! Quiet bricks fall asleep and stay as anchors for their neighbours.
//!
//! A brick sleeps when for 32 substeps no node was faster than [`Thresholds::speed`] nor accelerated (by inner forces and gravity) more
//! than [`Thresholds::acceleration`]. Its displacements stay where they are and its neighbours go on pulling at them: a sleeping
//! node is a fixed anchor, not a missing one. Every few substeps the sleeping bricks next to awake ones are evaluated
//! without being moved; one whose nodes would accelerate wakes. So the unbalanced force that sleep hides stays below m a everywhere,
//! and the error in displacement below ρ a L² / (2 μ) at a distance L from
//! what holds the tissue.

use super::lattice::{MAX_RUN, Mark};
use super::nodes::{Bricks, Run};

/// Substeps of quiet before a brick sleeps.
const QUIET_SUBSTEPS: u8 = 32;
/// Every so many substeps the neighbours of awake bricks are looked at.
const WATCH_EVERY: u64 = 4;
/// A sleeper wakes at this multiple of the acceleration below which it may sleep.
pub const WAKE_FACTOR: f32 = 2.0;

/// What sleep may hide of a displacement at worst, in cells.
const HIDDEN: f64 = 3e-2;
/// By how much tissue is out of balance that an acceleration a moves by a / this: 2 μ / (ρ L²) for a shear modulus of 1.7 kPa (E = 5 kPa),
/// ρ = 1000 kg/m³ and L = 0.1 m from what holds it.
const BALANCE_PER_S2: f64 = 340.0;
/// A speed by the acceleration that goes with it. The slowest wave of such tissue has 20 rad/s, so that what is stopped in its way
/// lacks a tenth of [`HIDDEN`] or less.
const STANDSTILL_S: f64 = 2e-3;

/// When a brick counts as quiet.
#[derive(Clone, Copy, Debug)]
pub struct Thresholds {
    /// In m/s.
    pub speed: f32,
    /// In m/s².
    pub acceleration: f32,
}

impl Thresholds {
    /// For cells of edge length `h` in m; or what rounding makes of a displacement of 1 mm where the model is so stiff that this is more:
    /// `omega` is its highest angular frequency in rad/s, `epsilon` the scalar's rounding.
    pub fn new(h: f64, omega: f64, epsilon: f64) -> Self {
        let noise = epsilon * 1e-3 * omega * omega;
        let acceleration = noise.max(HIDDEN * h * BALANCE_PER_S2);
        Self { speed: (acceleration * STANDSTILL_S) as f32, acceleration: acceleration as f32 }
    }
}

/// Who sleeps, and since when bricks are quiet.
#[derive(Clone, Debug)]
pub struct Sleepers {
    is_asleep: Vec<bool>,
    quiet: Vec<u8>,
    substep: u64,
}

/// Which bricks sleep, and the runs that a substep walks.
#[derive(Debug)]
pub struct Sleep {
    thresholds: Thresholds,
    is_asleep: Vec<bool>,
    quiet: Vec<u8>,
    awake: Vec<Run>,
    watched: Vec<Run>,
    awake_nodes: u64,
    nodes_in: Vec<u8>,
    substep: u64,
}

impl Sleep {
    /// Everything awake, and quiet never: see [`Self::set_thresholds`].
    pub fn new(bricks: &Bricks) -> Self {
        let count = bricks.count();
        let nodes_in = bricks
            .model
            .lattice()
            .words()
            .chunks_exact(crate::model::lattice::BRICK_SLOTS)
            .map(|brick| brick.iter().filter(|&&word| word != 0).count() as u8)
            .collect();
        let mut sleep = Self {
            thresholds: Thresholds { speed: 0.0, acceleration: 0.0 },
            is_asleep: vec![false; count],
            quiet: vec![0; count],
            awake: Vec::with_capacity(count),
            watched: Vec::with_capacity(count),
            awake_nodes: 0,
            nodes_in,
            substep: 0,
        };
        sleep.list(bricks);
        sleep
    }

    /// What counts as quiet.
    pub fn set_thresholds(&mut self, thresholds: Thresholds) {
        self.thresholds = thresholds;
    }

    /// Runs of awake bricks.
    pub fn awake(&self) -> &[Run] {
        &self.awake
    }

    /// Runs of sleeping bricks that the coming substep looks at; empty in most substeps.
    pub fn watched(&self) -> &[Run] {
        if self.substep.is_multiple_of(WATCH_EVERY) { &self.watched } else { &[] }
    }

    /// Nodes in awake bricks.
    pub fn awake_nodes(&self) -> u64 {
        self.awake_nodes
    }

    /// Wakes everything.
    pub fn wake_all(&mut self, bricks: &Bricks) {
        self.quiet.fill(0);
        if self.is_asleep.contains(&true) {
            self.is_asleep.fill(false);
            self.list(bricks);
        }
    }

    /// Who sleeps now.
    pub fn sleepers(&self) -> Sleepers {
        Sleepers { is_asleep: self.is_asleep.clone(), quiet: self.quiet.clone(), substep: self.substep }
    }

    /// Lets those sleep who slept then.
    pub fn set_sleepers(&mut self, bricks: &Bricks, then: &Sleepers) {
        self.is_asleep.clone_from(&then.is_asleep);
        self.quiet.clone_from(&then.quiet);
        self.substep = then.substep;
        self.list(bricks);
    }

    /// After a substep: wakes the touched bricks with their neighbours and the sleepers that would move, puts quiet bricks to sleep by
    /// calling `stop` for each.
    pub fn update(
        &mut self,
        bricks: &Bricks,
        marks: &[Mark],
        touched: impl Iterator<Item = u32>,
        mut stop: impl FnMut(usize),
    ) {
        let mut has_changed = false;
        let watched = if self.substep.is_multiple_of(WATCH_EVERY) { self.watched.len() } else { 0 };
        self.substep += 1;

        let wake = (WAKE_FACTOR * self.thresholds.acceleration).powi(2);
        for run in 0..watched {
            let Run { first, bricks: count } = self.watched[run];
            for brick in (first..first + count).filter(|&b| marks[b].acceleration2 > wake) {
                has_changed |= std::mem::take(&mut self.is_asleep[brick]);
                self.quiet[brick] = 0;
            }
        }
        let (speed2, acceleration2) = (self.thresholds.speed.powi(2), self.thresholds.acceleration.powi(2));
        for run in 0..self.awake.len() {
            let Run { first, bricks: count } = self.awake[run];
            for brick in first..first + count {
                let mark = &marks[brick];
                if mark.speed2 < speed2 && mark.acceleration2 < acceleration2 {
                    self.quiet[brick] += 1;
                } else {
                    self.quiet[brick] = 0;
                }
            }
        }
        for brick in touched {
            for near in bricks.around(brick as usize) {
                has_changed |= std::mem::take(&mut self.is_asleep[near]);
                self.quiet[near] = 0;
            }
        }
        for run in 0..self.awake.len() {
            let Run { first, bricks: count } = self.awake[run];
            for brick in first..first + count {
                if self.quiet[brick] >= QUIET_SUBSTEPS && !self.is_asleep[brick] {
                    self.is_asleep[brick] = true;
                    has_changed = true;
                    stop(brick);
                }
            }
        }
        if has_changed {
            self.list(bricks);
        }
    }

    /// Lists the runs anew, in memory taken at creation.
    fn list(&mut self, bricks: &Bricks) {
        let Self { is_asleep, awake, watched, nodes_in, .. } = self;
        bricks.list_runs(MAX_RUN, |b| !is_asleep[b], awake);
        let near_awake = |b: usize| is_asleep[b] && bricks.around(b).any(|near| !is_asleep[near]);
        bricks.list_runs(MAX_RUN, near_awake, watched);
        self.awake_nodes = (0..is_asleep.len())
            .filter(|&b| !is_asleep[b])
            .map(|b| u64::from(nodes_in.get(b).copied().unwrap_or_default()))
            .sum();
    }
}
