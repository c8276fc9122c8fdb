//! One substep of the lattice over a run of bricks: the kernel.
//!
//! A run of up to [`MAX_RUN`] bricks along x is advanced brick by brick. The brick's sixteen rows of eight nodes and the one-node halo around them are
//! staged into scratch rows, where each spring is evaluated once for both of its ends:
//!
//! ```text
//!   z+1   (y-1) (y) (y+1)        a row A looks forward to four rows B and to itself;
//!   z           [A] (y+1)        with each B there are three springs: dx = -1, 0, +1
//! ```
//!
//! The force on A is summed in registers. The reaction on B at `x + dx` is kept at A's index in one of three sums for B (`dx` = 0, +1, -1)
//! and shifted by one lane at the end; what crosses to the next brick is kept for it, so that a brick's nodes move when the next one's
//! springs are known. Springs that leave the run are evaluated by both runs. Every node so receives its forces in an order fixed by the
//! model alone: runs, threads and their number change nothing.

mod cells;
mod integrate;
pub mod pieces;
mod springs;
mod stage;
mod sums;
#[cfg(test)]
mod tests;

use self::cells::cells;
use self::integrate::{Motion, integrate};
use self::pieces::Pieces;
use self::springs::springs;
use self::stage::{Held, enter, fetch, stage};
use self::sums::{clear, keep, turn_left_end};
use super::lanes::{Lanes, Octet, Portable, Real};
use super::nodes::{Bricks, Run};
use crate::model::law::{CellLaw, SpringClass};

/// Longest run of bricks along x: long enough that its ends cost little, short enough that every thread finds one.
pub const MAX_RUN: usize = 16;

/// Staged rows along y, and along z: a brick's four and the halo.
const SIDE: usize = 6;
/// Staged rows; row `(y, z)` of the brick is `(z + 1) * SIDE + y + 1`.
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
    /// Pieces of divided cells, evaluated.
    pub pieces: &'a Pieces<R>,
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

/// Eight numbers of a row and, on both sides, the next one: a cache line in single precision, so that no shifted load crosses its border.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Window<R>([R; 16]);

impl<R: Real> Window<R> {
    /// Where the eight begin.
    const FIRST: usize = 4;

    /// The eight numbers, moved by `dx` = -1, 0 or 1 nodes.
    #[inline(always)]
    fn at<L: Lanes<Real = R>>(&self, dx: isize) -> L {
        debug_assert!(dx.abs() <= 1);
        // SAFETY: 3 to 5 and eight more numbers are inside the window.
        unsafe { L::load(self.0.as_ptr().add(Self::FIRST).offset(dx)) }
    }

    /// Moves on by a row: its last number is now the one before.
    #[inline(always)]
    fn pass_last(&mut self) {
        self.0[Self::FIRST - 1] = self.0[Self::FIRST + 7];
    }

    /// Replaces the last of the eight.
    #[inline(always)]
    fn set_last(&mut self, number: R) {
        self.0[Self::FIRST + 7] = number;
    }

    /// Replaces the eight.
    #[inline(always)]
    fn put<L: Lanes<Real = R>>(&mut self, eight: L) {
        // SAFETY: 4 and eight more numbers are inside the window.
        unsafe { eight.store(self.0.as_mut_ptr().add(Self::FIRST)) }
    }
}

/// A row of eight nodes as one thread sees it.
#[derive(Debug)]
#[repr(C)]
struct Row<R> {
    u: [Window<R>; 3],
    spring: Window<R>,
    corner: Window<R>,
    volume: Window<R>,
    damper: Window<R>,
    v: [Window<R>; 3],
    sums: Sums<R>,
    before: Before<R>,
}

/// Forces gathered for a row.
#[derive(Clone, Copy, Debug, Default)]
struct Sums<R> {
    /// On the nodes themselves.
    at: [Octet<R>; 3],
    /// What is to be taken from the node one further along x.
    up: [Octet<R>; 3],
    /// What is to be taken from the node one back along x.
    down: [Octet<R>; 3],
}

/// What is kept of the row before this one along x.
#[derive(Clone, Copy, Debug, Default)]
struct Before<R> {
    /// Forces, complete but for what the first node of this row takes from the last of that one.
    force: [Octet<R>; 3],
    /// Its `up` sums, of which the last belongs to this row's first node.
    up: [Octet<R>; 3],
    mass: Octet<R>,
}

/// Largest |1 − L / l|, J − 1 and 1 − J among a brick's springs and cells.
#[derive(Clone, Copy, Debug)]
struct Extremes<L> {
    strain: L,
    swelling: L,
    shrinking: L,
}

/// The staged rows of one thread.
#[derive(Debug)]
pub struct Scratch<R> {
    rows: [Row<R>; ROWS],
}

impl<R> Scratch<R> {
    /// A staged row.
    ///
    /// # Safety
    /// `row` is below [`ROWS`].
    #[inline(always)]
    unsafe fn row(&self, row: usize) -> &Row<R> {
        debug_assert!(row < ROWS);
        // SAFETY: as promised.
        unsafe { self.rows.get_unchecked(row) }
    }

    /// A staged row, to be changed.
    ///
    /// # Safety
    /// `row` is below [`ROWS`].
    #[inline(always)]
    unsafe fn row_mut(&mut self, row: usize) -> &mut Row<R> {
        debug_assert!(row < ROWS);
        // SAFETY: as promised.
        unsafe { self.rows.get_unchecked_mut(row) }
    }
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
    /// Every route that this processor can take, the fastest first.
    fn routes(laws: &LawTables<Self>) -> Vec<Kernel<Self>>;

    /// The kernel for this processor.
    fn kernel(laws: &LawTables<Self>) -> Kernel<Self> {
        Self::routes(laws)[0]
    }
}

/// Whether AVX2 and FMA are there.
#[cfg(target_arch = "x86_64")]
pub fn has_avx2() -> bool {
    std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
}

/// Whether, besides those of [`has_avx2`], there are twice as many registers. The operations are the same ones and so are the results.
#[cfg(target_arch = "x86_64")]
fn has_avx512vl() -> bool {
    std::arch::is_x86_feature_detected!("avx512f") && std::arch::is_x86_feature_detected!("avx512vl")
}

/// The kernel of a material table, compiled for some features of the processor.
#[cfg(target_arch = "x86_64")]
macro_rules! compiled_for {
    ($features:literal, $real:ty, $lanes:ty, $laws:expr) => {{
        #[target_feature(enable = $features)]
        unsafe fn with<const VOLUME: bool, const DAMPED: bool>(
            pass: &Pass<$real>,
            run: Run,
            next: Option<Run>,
            scratch: &mut Scratch<$real>,
        ) {
            // SAFETY: the caller promises the same.
            unsafe { advance::<$lanes, VOLUME, DAMPED>(pass, run, next, scratch) }
        }
        match ($laws.volumetric, $laws.damped) {
            (false, false) => with::<false, false>,
            (true, false) => with::<true, false>,
            (false, true) => with::<false, true>,
            (true, true) => with::<true, true>,
        }
    }};
}

macro_rules! kernels {
    ($real:ty, $avx2:ident) => {
        impl CpuReal for $real {
            fn routes(laws: &LawTables<Self>) -> Vec<Kernel<Self>> {
                let mut routes: Vec<Kernel<Self>> = Vec::new();
                #[cfg(target_arch = "x86_64")]
                if has_avx2() {
                    if has_avx512vl() {
                        let kernel =
                            compiled_for!("avx2,fma,avx512f,avx512vl", $real, super::lanes::$avx2, laws);
                        routes.push(kernel);
                    }
                    routes.push(compiled_for!("avx2,fma", $real, super::lanes::$avx2, laws));
                }
                // Without AVX2 speed is lost anyway: one kernel, with the terms of all.
                routes.push(if laws.damped {
                    advance::<Portable<$real>, true, true>
                } else {
                    advance::<Portable<$real>, true, false>
                });
                routes
            }
        }
    };
}
kernels!(f32, Avx2F32);
kernels!(f64, Avx2F64);

/// Which springs and cells of a brick are meant: all that begin in it, or those that enter the run from before its first brick or from
/// behind its last.
const WHOLE: u8 = 0;
const LEFT_END: u8 = 1;
const RIGHT_END: u8 = 2;

/// Constants of a substep in registers.
struct Constants<L> {
    h: L,
    minus_2h: L,
    edge: SpringClass<L>,
    face: SpringClass<L>,
    body: SpringClass<L>,
    inverse_4h: L,
    minus_one: L,
    zero: L,
}

/// Whether a staged row belongs to the brick, not to its halo.
const fn owned(y: isize, z: isize) -> bool {
    y >= 1 && y <= 4 && z >= 1 && z <= 4
}

/// The staged row of a brick's row.
const fn staged(row: usize) -> usize {
    (row / 4 + 1) * SIDE + row % 4 + 1
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
    let h = pass.laws.h;
    let c = Constants::<L> {
        h: L::splat(h),
        minus_2h: L::splat(-2.0 * h),
        edge: SpringClass::new(1, h),
        face: SpringClass::new(2, h),
        body: SpringClass::new(3, h),
        inverse_4h: L::splat(0.25 / h),
        minus_one: L::splat(-1.0),
        zero: L::splat(0.0),
    };
    let motion = Motion::<L>::new(pass);
    let still = || Extremes { strain: c.zero, swelling: c.zero, shrinking: c.zero };

    // SAFETY: the caller's promise covers every read and write below.
    unsafe {
        enter::<L, VOLUME, DAMPED>(pass, run.first, s);
        let mut held = Held::new(pass, run.first);
        let mut last = still();
        for brick in run.first..run.end() {
            stage::<L, VOLUME, DAMPED>(pass, brick, s);
            fetch(pass, run, next, brick);
            clear::<L>(s);
            let mut extremes = still();
            if brick == run.first {
                if VOLUME {
                    cells::<L, LEFT_END>(s, held, &c, &mut extremes);
                }
                springs::<L, LEFT_END, DAMPED>(s, held, &c, &mut extremes.strain);
                turn_left_end::<L>(s);
            }
            if VOLUME {
                cells::<L, WHOLE>(s, held, &c, &mut extremes);
            }
            springs::<L, WHOLE, DAMPED>(s, held, &c, &mut extremes.strain);
            if brick > run.first {
                integrate::<L, WHOLE>(pass, brick - 1, s, &motion, &last);
            }
            keep::<L>(s);
            last = extremes;
            if brick + 1 < run.end() {
                held.move_on(pass, brick + 1);
            }
        }
        clear::<L>(s);
        springs::<L, RIGHT_END, DAMPED>(s, held, &c, &mut last.strain);
        integrate::<L, RIGHT_END>(pass, run.end() - 1, s, &motion, &last);
    }
}
