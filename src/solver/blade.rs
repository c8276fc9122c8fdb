//! Blades: edges of tools that cut tissue, and how tissue resists them.
//!
//! Tissue ahead of an edge goes with it, as if it stuck there, until that takes more force than the tissue's toughness times the length of the edge in it; then
//! it gives way, and is cut where the edge passes. So a cut of an area A takes the work Γ A, whatever the pace, and a blade that rests or is drawn back through its own cut meets nothing.

use crate::error::{Error, Result};
use crate::math::{FAR_M, Vec3};

/// Most points of a blade's edge.
pub const MAX_EDGE_POINTS: usize = 64;
/// Largest toughness in J/m²: a hundred times that of skin.
pub const MAX_TOUGHNESS_J_M2: f64 = 1e6;
/// Shortest segment of an edge, in m.
const SHORTEST_M: f64 = 1e-6;

/// The cutting edge of a tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Blade {
    /// The points of a polyline, tool frame, in m `[2 to 64]`. It cuts what it sweeps, in both directions.
    pub edge: Vec<Vec3>,
    /// The toughness Γ that tissue has for this edge, in J/m²: N for each metre of edge. 0 cuts freely. Measured values: 76 to 186 for a pig's liver
    /// (Azar and Hayward 2008, from needles), some 2000 for skin.
    pub toughness_j_m2: f64,
}

/// A point of an edge in tissue that it has not cut, and a length of edge that it stands for, during one step.
#[derive(Clone, Copy, Debug)]
pub struct Held {
    /// Slots of the nodes of its cell.
    pub nodes: [u32; 8],
    /// Their weights at the point.
    pub weights: [f64; 8],
    /// The point, tool frame, in m.
    pub at: Vec3,
    /// Unit vector along the edge, tool frame: along it, tissue does not stick.
    pub along: Vec3,
    /// The force at which the tissue gives way, in N.
    pub limit_n: f64,
}

impl Blade {
    /// Refuses edges without a length, and what is not finite.
    pub fn check(&self) -> Result<()> {
        if !(2..=MAX_EDGE_POINTS).contains(&self.edge.len()) {
            return Err(Error::argument(format!(
                "the edge of a blade has 2 to {MAX_EDGE_POINTS} points, not {}",
                self.edge.len()
            )));
        }
        if !self.edge.iter().flatten().all(|x| x.abs() <= FAR_M) {
            return Err(Error::argument(format!(
                "the edge of a blade must stay within {FAR_M} m of the tool's origin"
            )));
        }
        if !self.edge.windows(2).all(|ends| (ends[1] - ends[0]).norm() >= SHORTEST_M) {
            return Err(Error::argument(format!(
                "a segment of a blade's edge is at least {SHORTEST_M} m long"
            )));
        }
        if !(0.0..=MAX_TOUGHNESS_J_M2).contains(&self.toughness_j_m2) {
            return Err(Error::argument(format!(
                "a toughness of {} J/m² is not between 0 and {MAX_TOUGHNESS_J_M2}",
                self.toughness_j_m2
            )));
        }
        Ok(())
    }

    /// Points along the edge at most `spacing` apart: where they are, the direction of the edge there, and the length that each stands for.
    pub fn points(&self, spacing: f64) -> impl Iterator<Item = (Vec3, Vec3, f64)> + '_ {
        self.edge.windows(2).flat_map(move |ends| {
            let (start, way) = (ends[0], ends[1] - ends[0]);
            let (length, along) = (way.norm(), way.normalize());
            let count = (length / spacing).ceil().max(1.0);
            (0..count as usize)
                .map(move |n| (start + way * ((n as f64 + 0.5) / count), along, length / count))
        })
    }
}
