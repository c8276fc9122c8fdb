//! One substep of the lattice over a run of bricks: the kernel.
//!
//! A run of up to [`MAX_RUN`] bricks along x and the one-node halo around it is staged into scratch rows. Rows of nodes then walk along
//! x, eight nodes a time, and evaluate each spring once for both of its ends:
//!
//! ```text
//!   z+1   (y-1) (y) (y+1)        a row A looks forward to four rows B and to itself;
//!   z           [A] (y+1)        with each B there are three springs: dx = -1, 0, +1
//! ```
//!
//! The force on A is summed in registers. The reaction on B at `x + dx` is kept at A's index in one of three sums for B (`dx` = 0, +1, -1) and
//! shifted by one lane when the node is integrated, one vector later, when all its parts are there. Springs that leave the run are
//! evaluated by both runs. Every node so receives its forces in an order fixed by the model alone: runs, threads and their number
//! change nothing.

mod cells;
mod integrate;
mod springs;
mod stage;
mod sums;
#[cfg(test)]
mod tests;

use self::cells::cells;
use self::integrate::{integrate, take_from_below};
use self::springs::{LEFT_HALO, RIGHT_HALO, WHOLE, springs};
use self::stage::{fetch, stage};
use super::lanes::{Lanes, Octet, Portable, Real};
use super::nodes::{BRICK_ROWS, Bricks, Run};
use crate::model::law::{CellLaw, SpringClass};

/// Longest run of bricks along x. Of its scratch rows only the three octet columns around the current one are in use at a time, and those
/// stay in the first-level cache.
pub const MAX_RUN: usize = 16;

/// Octets of a staged row: the run and one octet of halo on each side.
const ROW: usize = MAX_RUN + 2;
/// Staged rows along y, and along z: a brick's four and the halo.
const SIDE: usize = 6;
/// Staged rows; row `(y, z)` of the run is `(z + 1) * SIDE + y + 1`.
const ROWS: usize = SIDE * SIDE;

/// Stiffnesses and masses of the sixteen materials (0 is empty), rounded to the scalar.
#[derive(Clone, Debug)]
pub struct LawTables<R> {
    spring: [R; 16],
    volume: [R; 16],
    corner: [R; 16],
    damper: [R; 16],
    /// Whether any cell has a volume term.
    pub volumetric: bool,
    /// Whether any spring is damped.
    pub damped: bool,
    h: f64,
}

impl<R: Real> LawTables<R> {
    /// Tables for cells of edge length `h`.
    pub fn new(laws: &[CellLaw; 16], h: f64) -> Self {
        let table = |f: &dyn Fn(&CellLaw) -> f64| std::array::from_fn(|m| R::splat(f(&laws[m])));
        Self {
            spring: table(&|law| law.spring_n_m),
            volume: table(&|law| law.volume_n),
            corner: table(&|law| law.corner_kg),
            damper: table(&|law| law.spring_n_m * law.damping_s),
            volumetric: laws.iter().any(|law| law.volume_n > 0.0),
            damped: laws.iter().any(|law| law.damping_s > 0.0),
            h,
        }
    }
}

/// What one substep reads and writes. Pointers are to the first octet of a field, see [`super::nodes::Field`].
#[derive(Debug)]
pub struct Pass<'a, R> {
    /// Topology.
    pub bricks: &'a Bricks,
    /// Flag bits of each slot.
    pub flags: &'a [u8],
    /// Material tables.
    pub laws: &'a LawTables<R>,
    /// Displacements.
    pub u: *const Octet<R>,
    /// Velocities.
    pub v: *const Octet<R>,
    /// Displacements after the substep.
    pub u_next: *mut Octet<R>,
    /// Velocities after the substep; may be `v` where no spring is damped.
    pub v_next: *mut Octet<R>,
    /// One mark a brick.
    pub marks: *mut Mark,
    /// Substep in s.
    pub dt: f64,
    /// Gravity in the model frame, m/s².
    pub gravity: [f64; 3],
    /// What background drag leaves of a velocity: 1 / (1 + α dt).
    pub keep: f64,
    /// Whether only marks are written.
    pub watch: bool,
}

// SAFETY: a pass is shared by threads that each write the bricks of their own runs and read fields that nobody writes.
unsafe impl<R: Sync> Sync for Pass<'_, R> {}

/// What a substep saw in one brick. Plain numbers, so that a backend's host part can decide on them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Mark {
    /// Largest |v|² of a node, m²/s²; not finite if any is not.
    pub speed2: f32,
    /// Largest |a|² of a node along its free axes, gravity included, m²/s⁴.
    pub acceleration2: f32,
    /// Largest |u|² of a node, m².
    pub displacement2: f32,
    /// Σ m v², twice the kinetic energy, J.
    pub vis_viva: f32,
    /// Largest |1 − L / l| of an edge spring.
    pub strain: f32,
    /// Largest J − 1 of a cell with a volume term.
    pub swelling: f32,
    /// Largest 1 − J of a cell with a volume term.
    pub shrinking: f32,
}

/// Staged rows of one thread.
#[derive(Debug)]
pub struct Scratch<R> {
    u: [[[Octet<R>; ROW]; ROWS]; 3],
    v: [[[Octet<R>; ROW]; ROWS]; 3],
    spring: [[Octet<R>; ROW]; ROWS],
    volume: [[Octet<R>; ROW]; ROWS],
    corner: [[Octet<R>; ROW]; ROWS],
    damper: [[Octet<R>; ROW]; ROWS],
    /// Of this octet column and the one before.
    sums: [[Sums<R>; BRICK_ROWS]; 2],
    /// Which staged rows hold a node, a bit for each row, for each octet column.
    holds: [u64; ROW],
    /// Of the springs and cells of this octet column: largest |1 − L / l|, J − 1, 1 − J.
    extremes: [Octet<R>; 3],
}

/// Forces gathered for one row of eight nodes.
#[derive(Clone, Copy, Debug, Default)]
struct Sums<R> {
    /// On the nodes themselves.
    at: [Octet<R>; 3],
    /// What is to be taken from the node one further along x.
    up: [Octet<R>; 3],
    /// What is to be taken from the node one back along x.
    down: [Octet<R>; 3],
}

impl<R: Real> Scratch<R> {
    /// Zeroed scratch on the heap.
    pub fn new() -> Box<Self> {
        // SAFETY: all fields are numbers, for which zero bits are the value zero.
        unsafe { Box::<Self>::new_zeroed().assume_init() }
    }
}

/// A kernel for one scalar and one route. Unsafe: the processor has what the route needs, and nobody else touches the run's bricks
/// of `u_next`, `v_next` and `marks`, nor writes `u` and `v`, meanwhile.
///
/// The second run is the one that the thread will probably advance next: its memory is asked for in time.
pub type Kernel<R> = unsafe fn(&Pass<R>, Run, Option<Run>, &mut Scratch<R>);

/// A scalar for which kernels exist.
pub trait CpuReal: Real {
    /// The kernel for this processor.
    fn kernel(laws: &LawTables<Self>) -> Kernel<Self>;
}

/// Whether AVX2 and FMA are there.
#[cfg(target_arch = "x86_64")]
pub fn has_avx2() -> bool {
    std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
}

macro_rules! kernels {
    ($real:ty, $avx2:ident) => {
        impl CpuReal for $real {
            fn kernel(laws: &LawTables<Self>) -> Kernel<Self> {
                #[cfg(target_arch = "x86_64")]
                if has_avx2() {
                    #[target_feature(enable = "avx2,fma")]
                    unsafe fn avx2<const VOLUME: bool, const DAMPED: bool>(
                        pass: &Pass<$real>,
                        run: Run,
                        next: Option<Run>,
                        scratch: &mut Scratch<$real>,
                    ) {
                        // SAFETY: the caller promises the same.
                        unsafe { advance::<super::lanes::$avx2, VOLUME, DAMPED>(pass, run, next, scratch) }
                    }
                    return match (laws.volumetric, laws.damped) {
                        (false, false) => avx2::<false, false>,
                        (true, false) => avx2::<true, false>,
                        (false, true) => avx2::<false, true>,
                        (true, true) => avx2::<true, true>,
                    };
                }
                // Without AVX2 speed is lost anyway: one kernel, with the terms of all.
                if laws.damped {
                    advance::<Portable<$real>, true, true>
                } else {
                    advance::<Portable<$real>, true, false>
                }
            }
        }
    };
}
kernels!(f32, Avx2F32);
kernels!(f64, Avx2F64);

/// Constants of a substep in registers.
struct Constants<L> {
    h: L,
    minus_2h: L,
    edge: SpringClass<L>,
    face: SpringClass<L>,
    body: SpringClass<L>,
    three_quarters: L,
    inverse_4h: L,
    minus_one: L,
    zero: L,
}

/// Whether a staged row belongs to the run, not to its halo.
const fn owned(y: isize, z: isize) -> bool {
    y >= 1 && y <= 4 && z >= 1 && z <= 4
}

/// Index among the run's own rows of a staged row.
const fn own(row: usize) -> usize {
    (row / SIDE - 1) * 4 + row % SIDE - 1
}

/// One substep of a run.
///
/// # Safety
/// See [`Kernel`].
#[inline(always)]
unsafe fn advance<L: Lanes, const VOLUME: bool, const DAMPED: bool>(
    pass: &Pass<L::Real>,
    run: Run,
    next: Option<Run>,
    s: &mut Scratch<L::Real>,
) {
    debug_assert!(run.bricks <= MAX_RUN);
    let h = pass.laws.h;
    let c = Constants::<L> {
        h: L::splat(h),
        minus_2h: L::splat(-2.0 * h),
        edge: SpringClass::new(1, h),
        face: SpringClass::new(2, h),
        body: SpringClass::new(3, h),
        three_quarters: L::splat(0.75),
        inverse_4h: L::splat(0.25 / h),
        minus_one: L::splat(-1.0),
        zero: L::splat(0.0),
    };

    // SAFETY: the caller's promise covers every read and write below; indices stay inside the scratch by construction.
    unsafe {
        let last = run.bricks + 1;
        s.holds = [0; ROW];
        stage::<L, VOLUME, DAMPED>(pass, run, s, 0);
        for x in 0..=last {
            // Staging stays one column ahead of the springs, and asking for memory two columns ahead of that.
            if x < last {
                stage::<L, VOLUME, DAMPED>(pass, run, s, x + 1);
            }
            let ahead = x + 3;
            match next {
                _ if ahead <= run.bricks => fetch(pass, run, ahead),
                Some(next) if ahead - run.bricks <= next.bricks => fetch(pass, next, ahead - run.bricks),
                _ => {}
            }
            s.sums[x & 1] = [Sums::default(); BRICK_ROWS];
            s.extremes = [Octet::default(); 3];
            if VOLUME && x < last {
                cells::<L>(s, x, &c);
            }
            match x {
                0 => springs::<L, LEFT_HALO, DAMPED>(s, x, &c),
                _ if x == last => springs::<L, RIGHT_HALO, DAMPED>(s, x, &c),
                _ => springs::<L, WHOLE, DAMPED>(s, x, &c),
            }
            if x >= 1 {
                take_from_below::<L>(s, x);
            }
            if x >= 2 {
                integrate::<L>(pass, run, s, x - 1);
            }
        }
    }
}

/// Eight numbers of a staged row at octet `x`, moved by `dx` nodes.
#[inline(always)]
unsafe fn at<L: Lanes>(row: &[Octet<L::Real>; ROW], x: usize, dx: isize) -> L {
    // SAFETY: the caller stays inside the row: `dx` is -1 for x > 0 alone, +1 for x < ROW - 1 alone.
    unsafe { L::load(row.as_ptr().cast::<L::Real>().offset(8 * x as isize + dx)) }
}
