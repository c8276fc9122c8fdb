//! Preconditioned conjugate gradients, without anything ever leaving the threads that compute them.
//!
//! Two meetings for each iteration, one more where there is contact. Residuals drift in single precision: the one that ends a solution is computed anew from what
//! was found, and where it is too large still, iterations begin again from there.

use super::super::lanes::{Lanes, Real};
use super::super::nodes::Run;
use super::super::workers::Member;
use super::press::Press;
use super::system::Parts;

/// The recursive residual is brought this much further down than the true one has to be.
const AHEAD: f64 = 0.7;
/// A new start that leaves more than this share of the residual has met what rounding leaves.
const STALLED: f64 = 0.5;

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// Share of the first residual that may be left.
    pub tolerance: f64,
    /// Most iterations.
    pub iterations: u32,
    /// |r| below which all is rounding.
    pub noise: f64,
    /// |r| that the tolerance is a share of; that at the beginning where there is none.
    pub reference: Option<f64>,
}

/// How far a solution came.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reached {
    pub iterations: u32,
    /// |b − A x| at the end.
    pub residual: f64,
    /// What the tolerance was a share of.
    pub reference: f64,
}

/// Improves x. Every member calls this with the same arguments and gets the same answer; `work` is a place that they share.
///
/// # Safety
/// As [`Parts`]; `mine` are runs that no other member has, and nobody else uses `work`.
#[inline(always)]
pub unsafe fn solve<L: Lanes>(
    parts: &Parts<L::Real>,
    press: &Press,
    member: &Member,
    mine: &[Run],
    budget: &Budget,
    work: *mut f64,
) -> Reached
where
    L::Real: Real,
{
    // What contact adds to q, by one member while others wait.
    let touch = |of| {
        if !press.is_empty() {
            if member.index == 0 {
                // SAFETY: the others wait.
                unsafe { *work = press.multiply(parts, of) };
            }
            member.meet();
        }
    };
    // b − A x, and what it comes to.
    let residue = |starts: bool| {
        // SAFETY: every run is one member's, and they meet between parts.
        unsafe {
            mine.iter().for_each(|&run| parts.multiply::<L>(run, starts));
            member.meet();
            touch(parts.x.cast_const());
            mine.iter().for_each(|&run| parts.renew::<L>(run));
            member.meet();
            parts.residue()
        }
    };
    let mut now = residue(budget.reference.is_none());
    let reference = budget.reference.unwrap_or(now.rr.sqrt());
    let target = (budget.tolerance * reference).max(budget.noise);
    let mut reached = Reached { iterations: 0, residual: now.rr.sqrt(), reference };
    while reached.residual > target && reached.iterations < budget.iterations {
        let (mut beta, mut turn) = (0.0, 0);
        while now.rr.sqrt() > AHEAD * target && reached.iterations < budget.iterations {
            // SAFETY: as above. What one part sums up, none writes before the next meeting but one.
            unsafe {
                mine.iter().for_each(|&run| parts.advance::<L>(run, beta, turn));
                member.meet();
                touch(parts.p[1 - turn].cast_const());
                let pq = parts.pq() + if press.is_empty() { 0.0 } else { *work };
                // Not a number, or no descent: what was found so far stands.
                if !(pq > 0.0) {
                    break;
                }
                mine.iter().for_each(|&run| parts.relax::<L>(run, now.rz / pq, turn));
                member.meet();
                let next = parts.residue();
                (beta, turn) = (next.rz / now.rz, 1 - turn);
                now = next;
            }
            reached.iterations += 1;
        }
        now = residue(false);
        let left = now.rr.sqrt();
        let stalls = !(left < STALLED * reached.residual);
        reached.residual = left;
        if stalls {
            break;
        }
    }
    reached
}
