//! The parts of a step, compiled for what the processor has.

#[cfg(target_arch = "x86_64")]
use super::super::lanes::{Avx2F32, Avx2F64};
use super::super::lanes::{Lanes, Portable, Real};
#[cfg(target_arch = "x86_64")]
use super::super::lattice::has_avx2;
use super::super::nodes::Run;
use super::super::workers::Member;
use super::conjugate::{Budget, Reached, solve};
use super::press::Press;
use super::system::Parts;
use crate::solver::method::Scheme;

/// Turns frames, says where nodes go by themselves, and builds the system but for loads and contact.
type Begin<R> = unsafe fn(&Parts<R>, &Member, &[Run]);
/// See [`solve`].
type Solve<R> = unsafe fn(&Parts<R>, &Press, &Member, &[Run], &Budget, *mut f64) -> Reached;
/// Moves nodes, unless one is lost.
type Finish<R> = unsafe fn(&Parts<R>, &Member, &[Run]);

/// Every part for one scalar and one route. Unsafe: the processor has what the route needs; `Parts` says the rest.
#[derive(Clone, Copy, Debug)]
pub struct Route<R> {
    pub(super) begin: Begin<R>,
    pub(super) solve: Solve<R>,
    pub(super) finish: Finish<R>,
}

/// A scalar for which routes exist.
pub trait EfgReal: Real {
    /// The fastest route for this processor.
    fn route() -> Route<Self>;
}

#[inline(always)]
unsafe fn begin<L: Lanes>(parts: &Parts<L::Real>, member: &Member, mine: &[Run]) {
    // SAFETY: the caller's runs are its own, and all meet before frames of other bricks are read.
    unsafe {
        for &run in mine {
            parts.look::<L>(run);
        }
        member.meet();
        for &run in mine {
            parts.invert::<L>(run);
            parts.begin::<L>(run);
            if parts.step.scheme == Scheme::Paper {
                parts.add_velocities::<L>(run);
            }
        }
    }
}

#[inline(always)]
unsafe fn finish<L: Lanes>(parts: &Parts<L::Real>, member: &Member, mine: &[Run]) {
    // SAFETY: the caller's runs are its own, and all meet before what was seen in other bricks is read.
    unsafe {
        for &run in mine {
            parts.measure::<L>(run);
        }
        member.meet();
        if parts.is_sound() {
            for &run in mine {
                parts.go::<L>(run);
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
macro_rules! compiled {
    ($features:literal, $real:ty, $lanes:ty) => {{
        #[target_feature(enable = $features)]
        unsafe fn begin_with(parts: &Parts<$real>, member: &Member, mine: &[Run]) {
            // SAFETY: the caller promises the same.
            unsafe { begin::<$lanes>(parts, member, mine) }
        }
        #[target_feature(enable = $features)]
        unsafe fn solve_with(
            parts: &Parts<$real>,
            press: &Press,
            member: &Member,
            mine: &[Run],
            budget: &Budget,
            work: *mut f64,
        ) -> Reached {
            // SAFETY: the caller promises the same.
            unsafe { solve::<$lanes>(parts, press, member, mine, budget, work) }
        }
        #[target_feature(enable = $features)]
        unsafe fn finish_with(parts: &Parts<$real>, member: &Member, mine: &[Run]) {
            // SAFETY: the caller promises the same.
            unsafe { finish::<$lanes>(parts, member, mine) }
        }
        Route { begin: begin_with, solve: solve_with, finish: finish_with }
    }};
}

macro_rules! routes {
    ($real:ty, $avx2:ident) => {
        impl EfgReal for $real {
            fn route() -> Route<Self> {
                #[cfg(target_arch = "x86_64")]
                if has_avx2() {
                    return compiled!("avx2,fma", $real, $avx2);
                }
                Route {
                    begin: begin::<Portable<$real>>,
                    solve: solve::<Portable<$real>>,
                    finish: finish::<Portable<$real>>,
                }
            }
        }
    };
}
routes!(f32, Avx2F32);
routes!(f64, Avx2F64);
