//! Preconditioned conjugate gradients, without anything ever leaving the threads that compute them.
//!
//! Two meetings for each iteration, one more where there is contact. Residuals drift in single precision: the one that ends a solution is computed anew from what
//! was found, and where it is too large still, iterations begin again from there.

use super::super::lanes::{Lanes, Octet, Real};
use super::super::nodes::Run;
use super::super::workers::Member;
use super::press::Press;
use super::system::{Parts, Residue};

/// The recursive residual is brought this much further down than the true one has to be.
const AHEAD: f64 = 0.7;
/// A new start that leaves more than this share of the residual has met what rounding leaves.
const STALLED: f64 = 0.9;

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

/// What a solution is made of.
struct Solution<'a, R: Real> {
    parts: &'a Parts<'a, R>,
    press: &'a Press,
    member: &'a Member<'a>,
    mine: &'a [Run],
    /// What contact adds to p·q.
    work: *mut f64,
}

// Plain loops and functions, no closures around what computes: those would not be compiled for what the processor has.
impl<R: Real> Solution<'_, R> {
    /// Adds what contact has of A times `of` to q, by one member while others wait.
    fn touch(&self, of: *const Octet<R>) {
        if !self.press.is_empty() {
            if self.member.index == 0 {
                // SAFETY: the others wait.
                unsafe { *self.work = self.press.multiply(self.parts, of) };
            }
            self.member.meet();
        }
    }

    /// b − A x, and what it comes to.
    #[inline(always)]
    unsafe fn renew<L: Lanes<Real = R>>(&self) -> Residue {
        // SAFETY: every run is one member's, and they meet between parts.
        unsafe {
            for &run in self.mine {
                self.parts.multiply::<L>(run);
            }
            self.member.meet();
            self.touch(self.parts.x);
            for &run in self.mine {
                self.parts.renew::<L>(run);
            }
            self.member.meet();
            self.parts.residue()
        }
    }
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
) -> Reached {
    let solution = Solution { parts, press, member, mine, work };
    let mut reached = Reached::default();
    let mut starts = true;
    loop {
        // SAFETY: as promised.
        let mut now = unsafe { solution.renew::<L>() };
        let left = now.rr.sqrt();
        // A new start that found little has met what rounding leaves, or what is not finite.
        let improves = left < STALLED * reached.residual;
        let stalls = !starts && !improves;
        if starts {
            reached.reference = budget.reference.unwrap_or(left);
            starts = false;
        }
        reached.residual = left;
        let target = (budget.tolerance * reached.reference).max(budget.noise);
        let is_open = left > target;
        if !is_open || stalls || reached.iterations >= budget.iterations {
            return reached;
        }
        let (mut beta, mut turn) = (0.0, 0);
        while now.rr.sqrt() > AHEAD * target && reached.iterations < budget.iterations {
            // SAFETY: as promised. What one part sums up, none writes before the next meeting but one.
            unsafe {
                for &run in mine {
                    parts.advance::<L>(run, beta, turn);
                }
                member.meet();
                solution.touch(parts.p[1 - turn]);
                let pq = parts.pq() + if press.is_empty() { 0.0 } else { *work };
                // Not a number, or no descent: what was found so far stands.
                let descends = pq > 0.0;
                if !descends {
                    break;
                }
                for &run in mine {
                    parts.relax::<L>(run, now.rz / pq, turn);
                }
                member.meet();
                let next = parts.residue();
                (beta, turn) = (next.rz / now.rz, 1 - turn);
                now = next;
            }
            reached.iterations += 1;
        }
    }
}
