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

use super::lanes::{Lanes, Octet, Portable, Real};
use super::nodes::{BRICK_OCTETS, BRICK_ROWS, Bricks, Run};
use crate::model::lattice::{BRICK_SLOTS, NO_BRICK, flag};
use crate::model::law::{CellLaw, SpringClass, squared_change, volume_change};

/// Longest run of bricks along x. Its scratch rows stay in the first-level cache as a window slides over them.
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
    /// Largest |1 − L / l| of a spring.
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

/// Row B that A looks forward to: offset along y and z.
const FORWARD: [(isize, isize); 4] = [(1, 0), (-1, 1), (0, 1), (1, 1)];

/// For each staged row A and each of [`FORWARD`]: whether A's force is wanted (1) and whether B's is (2).
const WANTED: [[u8; 4]; ROWS] = {
    let mut wanted = [[0; 4]; ROWS];
    let side = SIDE as isize;
    let mut a = 0;
    while a < ROWS {
        let (y, z) = (a as isize % side, a as isize / side);
        let mut f = 0;
        while f < 4 {
            let (by, bz) = (y + FORWARD[f].0, z + FORWARD[f].1);
            if by >= 0 && by < side && bz < side {
                wanted[a][f] = owned(y, z) as u8 | (owned(by, bz) as u8) << 1;
            }
            f += 1;
        }
        a += 1;
    }
    wanted
};

/// Whether a staged row belongs to the run, not to its halo.
const fn owned(y: isize, z: isize) -> bool {
    y >= 1 && y <= 4 && z >= 1 && z <= 4
}

/// Index among the run's own rows of a staged row.
const fn own(row: usize) -> usize {
    (row / SIDE - 1) * 4 + row % SIDE - 1
}

/// Which springs of a column of octets exist: those of a whole column, or those that enter the run at its ends.
const WHOLE: u8 = 0;
const LEFT_HALO: u8 = 1;
const RIGHT_HALO: u8 = 2;

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

/// For the brick before, at and after along y or z: the staged rows on it, and its first row.
const SIDES: [(usize, usize, usize); 3] = [(0, 1, 3), (1, 5, 0), (5, 6, 0)];

/// The nearest brick of the run to octet column `x`, and that column's place beside it (0, 1, 2).
#[inline(always)]
fn near(run: Run, x: usize) -> (usize, usize) {
    let near = (run.first + x).clamp(run.first + 1, run.end()) - 1;
    (near, run.first + x - near)
}

/// Asks for memory that a column will need and nobody has read yet: the brick itself, and the sides of those that follow along y and z.
#[inline(always)]
fn fetch<R: Real>(pass: &Pass<R>, run: Run, x: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_ET0, _MM_HINT_T0, _mm_prefetch};
        /// Octets in 64 bytes.
        const fn line<R>() -> usize {
            if size_of::<R>() == 4 { 2 } else { 1 }
        }
        let (near, dx) = near(run, x);
        let brick = |by: usize, bz: usize| pass.bricks.neighbours[near][dx + 3 * by + 9 * bz];
        let octet =
            |brick: u32, comp: usize, row: usize| brick as usize * BRICK_OCTETS + comp * BRICK_ROWS + row;
        if brick(1, 1) != NO_BRICK {
            for at in (0..BRICK_OCTETS).step_by(line::<R>()) {
                // SAFETY: a prefetch changes nothing that the program can see; the octets exist.
                unsafe {
                    _mm_prefetch::<_MM_HINT_T0>(pass.u.add(octet(brick(1, 1), 0, 0) + at).cast());
                    _mm_prefetch::<_MM_HINT_T0>(pass.v.add(octet(brick(1, 1), 0, 0) + at).cast());
                    _mm_prefetch::<_MM_HINT_ET0>(pass.u_next.add(octet(brick(1, 1), 0, 0) + at).cast());
                }
            }
        }
        for comp in 0..3 {
            if brick(1, 2) != NO_BRICK {
                for row in (0..4).step_by(line::<R>()) {
                    // SAFETY: as above.
                    unsafe { _mm_prefetch::<_MM_HINT_T0>(pass.u.add(octet(brick(1, 2), comp, row)).cast()) };
                }
            }
            if brick(2, 1) != NO_BRICK {
                for row in [0, 4, 8, 12] {
                    // SAFETY: as above.
                    unsafe { _mm_prefetch::<_MM_HINT_T0>(pass.u.add(octet(brick(2, 1), comp, row)).cast()) };
                }
            }
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (pass, run, x);
}

/// Copies one octet column of the run and its halo into scratch rows.
#[inline(always)]
unsafe fn stage<L: Lanes, const VOLUME: bool, const DAMPED: bool>(
    pass: &Pass<L::Real>,
    run: Run,
    s: &mut Scratch<L::Real>,
    x: usize,
) {
    let (near, dx) = near(run, x);
    let mut holds = 0_u64;
    for (bz, (z_start, z_end, z_first)) in SIDES.into_iter().enumerate() {
        for (by, (y_start, y_end, y_first)) in SIDES.into_iter().enumerate() {
            let brick = pass.bricks.neighbours[near][dx + 3 * by + 9 * bz];
            for z in z_start..z_end {
                for y in y_start..y_end {
                    let row = z * SIDE + y;
                    // The last rows are no lowest corner of any cell that is looked at.
                    let has_cells = y < SIDE - 1 && z < SIDE - 1;
                    if brick == NO_BRICK {
                        clear_row::<L, VOLUME, DAMPED>(s, row, x);
                        continue;
                    }
                    let local = (z - z_start + z_first) * 4 + y - y_start + y_first;
                    // SAFETY: a row of an existing brick; as the caller's.
                    unsafe {
                        copy_row::<L, VOLUME, DAMPED>(pass, s, row, x, brick as usize, local, has_cells);
                    }
                    holds |= u64::from(pass.bricks.rows[brick as usize] >> local & 1) << row;
                }
            }
        }
    }
    s.holds[x] = holds;
}

#[inline(always)]
fn clear_row<L: Lanes, const VOLUME: bool, const DAMPED: bool>(
    s: &mut Scratch<L::Real>,
    row: usize,
    x: usize,
) {
    for comp in 0..3 {
        s.u[comp][row][x] = Octet::default();
        if DAMPED {
            s.v[comp][row][x] = Octet::default();
        }
    }
    s.spring[row][x] = Octet::default();
    s.corner[row][x] = Octet::default();
    if VOLUME {
        s.volume[row][x] = Octet::default();
    }
    if DAMPED {
        s.damper[row][x] = Octet::default();
    }
}

#[inline(always)]
unsafe fn copy_row<L: Lanes, const VOLUME: bool, const DAMPED: bool>(
    pass: &Pass<L::Real>,
    s: &mut Scratch<L::Real>,
    row: usize,
    x: usize,
    brick: usize,
    local: usize,
    has_cells: bool,
) {
    let octet = brick * BRICK_OCTETS + local;
    // SAFETY: octets and slots of an existing brick; nobody writes `u` during a substep, nor `v` where springs are damped.
    unsafe {
        for comp in 0..3 {
            s.u[comp][row][x] = *pass.u.add(octet + comp * BRICK_ROWS);
            if DAMPED {
                s.v[comp][row][x] = *pass.v.add(octet + comp * BRICK_ROWS);
            }
        }
        if !has_cells {
            return;
        }
        let cells: &[u8; 8] = &*pass.bricks.cells.as_ptr().add(brick * BRICK_SLOTS + local * 8).cast();
        L::look_up(&pass.laws.spring, cells).store(s.spring[row][x].0.as_mut_ptr());
        L::look_up(&pass.laws.corner, cells).store(s.corner[row][x].0.as_mut_ptr());
        if VOLUME {
            L::look_up(&pass.laws.volume, cells).store(s.volume[row][x].0.as_mut_ptr());
        }
        if DAMPED {
            L::look_up(&pass.laws.damper, cells).store(s.damper[row][x].0.as_mut_ptr());
        }
    }
}

/// Eight numbers of a staged row at octet `x`, moved by `dx` nodes.
#[inline(always)]
unsafe fn at<L: Lanes>(row: &[Octet<L::Real>; ROW], x: usize, dx: isize) -> L {
    // SAFETY: the caller stays inside the row: `dx` is -1 for x > 0 alone, +1 for x < ROW - 1 alone.
    unsafe { L::load(row.as_ptr().cast::<L::Real>().offset(8 * x as isize + dx)) }
}

/// `sums -= force`.
#[inline(always)]
fn take<L: Lanes>(sums: &mut [Octet<L::Real>; 3], force: [L; 3]) {
    store(sums, minus(load(sums), force));
}

/// `sums += force`.
#[inline(always)]
fn give<L: Lanes>(sums: &mut [Octet<L::Real>; 3], force: [L; 3]) {
    store(sums, plus(load(sums), force));
}

/// The springs of one column of octets, each evaluated once.
#[inline(always)]
unsafe fn springs<L: Lanes, const COLUMN: u8, const DAMPED: bool>(
    s: &mut Scratch<L::Real>,
    x: usize,
    c: &Constants<L>,
) {
    let here = s.holds[x];
    let around = here | if x > 0 { s.holds[x - 1] } else { 0 } | if x + 1 < ROW { s.holds[x + 1] } else { 0 };
    // SAFETY: a whole octet.
    let strain = &mut unsafe { L::load(s.extremes[0].0.as_ptr()) };
    // Rows of the last z plane look forward to nothing that is wanted.
    for a in (0..ROWS - SIDE).filter(|a| here >> a & 1 != 0) {
        let mut force = [c.zero; 3];
        let own_a = owned((a % SIDE) as isize, (a / SIDE) as isize);

        // SAFETY: as the caller's.
        unsafe {
            if own_a && COLUMN != RIGHT_HALO {
                let k = edge_cells::<L>(&s.spring, a, x);
                let kb = if DAMPED { edge_cells::<L>(&s.damper, a, x) } else { k };
                let f = spring::<L, 1, 0, 0, DAMPED>(s, a, a, x, k, kb, c, strain);
                force = f.on_a(force);
                f.give_a(&mut s.sums[x & 1][own(a)].up);
            }
            // Row B, and the rows of the cells around each spring.
            pair::<L, 1, 0, COLUMN, DAMPED>(s, a, WANTED[a][0], around, x, c, &mut force, strain);
            pair::<L, -1, 1, COLUMN, DAMPED>(s, a, WANTED[a][1], around, x, c, &mut force, strain);
            pair::<L, 0, 1, COLUMN, DAMPED>(s, a, WANTED[a][2], around, x, c, &mut force, strain);
            pair::<L, 1, 1, COLUMN, DAMPED>(s, a, WANTED[a][3], around, x, c, &mut force, strain);
        }
        if own_a && COLUMN == WHOLE {
            give::<L>(&mut s.sums[x & 1][own(a)].at, force);
        }
    }
    // SAFETY: a whole octet.
    unsafe { strain.store(s.extremes[0].0.as_mut_ptr()) };
}

/// The three springs from each node of row A to row B at offset (Y, Z).
#[inline(always)]
unsafe fn pair<L: Lanes, const Y: isize, const Z: isize, const COLUMN: u8, const DAMPED: bool>(
    s: &mut Scratch<L::Real>,
    a: usize,
    wanted: u8,
    around: u64,
    x: usize,
    c: &Constants<L>,
    force: &mut [L; 3],
    strain: &mut L,
) {
    let b = a.wrapping_add_signed(Z * SIDE as isize + Y);
    if wanted == 0 || around >> b & 1 == 0 || (COLUMN != WHOLE && wanted & 2 == 0) {
        return;
    }

    // Stiffness: the cells of row `one` and, beside a face between two rows, of row `two`; at x, and at x - 1.
    let one = if Y < 0 { a - 1 } else { a };
    let two = if Z == 0 { a - SIDE } else { a.wrapping_sub(1) };
    // SAFETY: as the caller's.
    unsafe {
        let own_b = if wanted & 2 != 0 { own(b) } else { 0 };

        if COLUMN != RIGHT_HALO {
            let (ahead, damped_ahead) = (
                cells_beside::<L, Y, Z>(&s.spring, one, two, x, 0),
                if DAMPED { cells_beside::<L, Y, Z>(&s.damper, one, two, x, 0) } else { c.h },
            );
            if COLUMN == WHOLE {
                let k = ahead.add(cells_beside::<L, Y, Z>(&s.spring, one, two, x, -1));
                let kb = if DAMPED {
                    damped_ahead.add(cells_beside::<L, Y, Z>(&s.damper, one, two, x, -1))
                } else {
                    c.h
                };
                let f = spring::<L, 0, Y, Z, DAMPED>(s, a, b, x, k, kb, c, strain);
                if wanted & 1 != 0 {
                    *force = f.on_a(*force);
                }
                if wanted & 2 != 0 {
                    f.give_b(&mut s.sums[x & 1][own_b].at);
                }
            }
            let f = spring::<L, 1, Y, Z, DAMPED>(
                s,
                a,
                b,
                x,
                weaken::<L, Y, Z>(ahead, c),
                weaken::<L, Y, Z>(damped_ahead, c),
                c,
                strain,
            );
            if COLUMN == WHOLE && wanted & 1 != 0 {
                *force = f.on_a(*force);
            }
            if wanted & 2 != 0 {
                f.give_a(&mut s.sums[x & 1][own_b].up);
            }
        }
        if COLUMN != LEFT_HALO {
            let behind = weaken::<L, Y, Z>(cells_beside::<L, Y, Z>(&s.spring, one, two, x, -1), c);
            let damped_behind = if DAMPED {
                weaken::<L, Y, Z>(cells_beside::<L, Y, Z>(&s.damper, one, two, x, -1), c)
            } else {
                c.h
            };
            let f = spring::<L, -1, Y, Z, DAMPED>(s, a, b, x, behind, damped_behind, c, strain);
            if COLUMN == WHOLE && wanted & 1 != 0 {
                *force = f.on_a(*force);
            }
            if wanted & 2 != 0 {
                f.give_a(&mut s.sums[x & 1][own_b].down);
            }
        }
    }
}

/// Sum over the four cells ahead along x of the nodes of row A.
#[inline(always)]
unsafe fn edge_cells<L: Lanes>(row: &[[Octet<L::Real>; ROW]; ROWS], a: usize, x: usize) -> L {
    // SAFETY: as the caller's.
    unsafe {
        let near = at::<L>(&row[a], x, 0).add(at(&row[a - 1], x, 0));
        near.add(at::<L>(&row[a - SIDE], x, 0).add(at(&row[a - SIDE - 1], x, 0)))
    }
}

/// Sum over the cells at `x + dx` that lie beside a spring to row (Y, Z): one for a diagonal of rows, else two.
#[inline(always)]
unsafe fn cells_beside<L: Lanes, const Y: isize, const Z: isize>(
    row: &[[Octet<L::Real>; ROW]; ROWS],
    one: usize,
    two: usize,
    x: usize,
    dx: isize,
) -> L {
    // SAFETY: as the caller's.
    unsafe {
        let first = at::<L>(&row[one], x, dx);
        if Y != 0 && Z != 0 { first } else { first.add(at(&row[two], x, dx)) }
    }
}

/// The share of a body diagonal, where the spring to row (Y, Z) is one.
#[inline(always)]
fn weaken<L: Lanes, const Y: isize, const Z: isize>(k: L, c: &Constants<L>) -> L {
    if Y != 0 && Z != 0 { k.mul(c.three_quarters) } else { k }
}

/// Component `comp` of row A minus that of row B, X nodes further.
#[inline(always)]
unsafe fn difference<L: Lanes, const X: isize>(
    field: &[[[Octet<L::Real>; ROW]; ROWS]; 3],
    comp: usize,
    a: usize,
    b: usize,
    x: usize,
) -> L {
    // SAFETY: as the caller's.
    unsafe { at::<L>(&field[comp][a], x, 0).sub(at(&field[comp][b], x, X)) }
}

/// `d` minus the rest vector's component, `r` cells.
#[inline(always)]
fn along<L: Lanes>(r: isize, d: L, c: &Constants<L>) -> L {
    match r {
        0 => d,
        1 => d.sub(c.h),
        _ => d.add(c.h),
    }
}

/// A force along a spring: `-size * way` on the node in row A, and its opposite on the one in row B. Kept as factors, so that sums take
/// it in by fused multiply-adds.
struct Pull<L> {
    size: L,
    /// From B to A as they are now.
    way: [L; 3],
}

impl<L: Lanes> Pull<L> {
    /// Adds the force on A to a sum.
    #[inline(always)]
    fn on_a(&self, sum: [L; 3]) -> [L; 3] {
        [
            self.size.take_from(self.way[0], sum[0]),
            self.size.take_from(self.way[1], sum[1]),
            self.size.take_from(self.way[2], sum[2]),
        ]
    }

    /// Adds the force on A to stored sums.
    #[inline(always)]
    fn give_a(&self, sums: &mut [Octet<L::Real>; 3]) {
        store(sums, self.on_a(load(sums)));
    }

    /// Adds the force on B to stored sums.
    #[inline(always)]
    fn give_b(&self, sums: &mut [Octet<L::Real>; 3]) {
        let sum = load::<L>(sums);
        let [x, y, z] = self.way;
        store(sums, [self.size.fma(x, sum[0]), self.size.fma(y, sum[1]), self.size.fma(z, sum[2])]);
    }
}

#[inline(always)]
fn load<L: Lanes>(sums: &[Octet<L::Real>; 3]) -> [L; 3] {
    // SAFETY: whole octets.
    unsafe { [L::load(sums[0].0.as_ptr()), L::load(sums[1].0.as_ptr()), L::load(sums[2].0.as_ptr())] }
}

#[inline(always)]
fn store<L: Lanes>(sums: &mut [Octet<L::Real>; 3], values: [L; 3]) {
    // SAFETY: whole octets.
    unsafe {
        values[0].store(sums[0].0.as_mut_ptr());
        values[1].store(sums[1].0.as_mut_ptr());
        values[2].store(sums[2].0.as_mut_ptr());
    }
}

/// The springs from the nodes of row A to those of row B, one node further by X: stiffness `k`, damper `kb`.
#[inline(always)]
unsafe fn spring<L: Lanes, const X: isize, const Y: isize, const Z: isize, const DAMPED: bool>(
    s: &Scratch<L::Real>,
    a: usize,
    b: usize,
    x: usize,
    k: L,
    kb: L,
    c: &Constants<L>,
    strain: &mut L,
) -> Pull<L> {
    // SAFETY: as the caller's.
    let d = unsafe {
        [
            difference::<L, X>(&s.u, 0, a, b, x),
            difference::<L, X>(&s.u, 1, a, b, x),
            difference::<L, X>(&s.u, 2, a, b, x),
        ]
    };

    // -r·d / h, for `d` is taken from B to A: a signed sum of the components along the spring.
    let rd = match (X != 0, Y != 0, Z != 0) {
        (true, false, false) => d[0],
        (false, true, false) => d[1],
        (false, false, true) => d[2],
        (true, true, false) => signed(X, d[0], Y, d[1], c),
        (true, false, true) => signed(X, d[0], Z, d[2], c),
        (false, true, true) => signed(Y, d[1], Z, d[2], c),
        _ => signed(1, signed(X, d[0], Y, d[1], c), Z, d[2], c),
    };
    let class = match X.abs() + Y.abs() + Z.abs() {
        1 => &c.edge,
        2 => &c.face,
        _ => &c.body,
    };
    let l = [along(X, d[0], c), along(Y, d[1], c), along(Z, d[2], c)];

    let elongation = class.elongation(squared_change(d, rd, c.minus_2h));
    // Edges alone are watched: a body diagonal hardly stretches without one.
    if X.abs() + Y.abs() + Z.abs() == 1 {
        *strain = elongation.magnitude_where(k).max(*strain);
    }
    let mut scale = k.mul(elongation);
    if DAMPED {
        // SAFETY: as the caller's.
        let dv = unsafe {
            [
                difference::<L, X>(&s.v, 0, a, b, x),
                difference::<L, X>(&s.v, 1, a, b, x),
                difference::<L, X>(&s.v, 2, a, b, x),
            ]
        };
        let rate = l[0].fma(dv[0], l[1].fma(dv[1], l[2].mul(dv[2])));
        scale = kb.mul(class.inverse_length2).fma(rate, scale);
    }
    Pull { size: scale, way: l }
}

/// ±p ± q.
#[inline(always)]
fn signed<L: Lanes>(sp: isize, p: L, sq: isize, q: L, c: &Constants<L>) -> L {
    match (sp, sq) {
        (1, 1) => p.add(q),
        (1, _) => p.sub(q),
        (_, 1) => q.sub(p),
        _ => p.add(q).mul(c.minus_one),
    }
}

/// The volume terms of one column of octets of cells.
#[inline(always)]
unsafe fn cells<L: Lanes>(s: &mut Scratch<L::Real>, x: usize, c: &Constants<L>) {
    let here = s.holds[x];
    let (mut swelling, mut shrinking) = (c.zero, c.zero);
    for z in 0..SIDE - 1 {
        for y in 0..SIDE - 1 {
            let low = z * SIDE + y;
            if here >> low & 1 == 0 {
                continue;
            }
            let rows = [low, low + 1, low + SIDE, low + SIDE + 1];

            // SAFETY: as the caller's; `x` is not the last octet of a row.
            let gradient = unsafe {
                [
                    gradient::<L>(&s.u[0], rows, x, c),
                    gradient::<L>(&s.u[1], rows, x, c),
                    gradient::<L>(&s.u[2], rows, x, c),
                ]
            };
            let (cof, dj) = volume_change(gradient);
            // SAFETY: as the caller's.
            let stiffness = unsafe { at::<L>(&s.volume[low], x, 0) };
            let p = stiffness.mul(dj).mul(c.minus_one);
            let there = dj.magnitude_where(stiffness);
            swelling = there.min(dj).max(swelling);
            shrinking = there.min(c.zero.sub(dj)).max(shrinking);

            // Corner (±, ±, ±) receives ±cx ±cy ±cz.
            let cx = [cof[0][0].mul(p), cof[1][0].mul(p), cof[2][0].mul(p)];
            let cy = [cof[0][1].mul(p), cof[1][1].mul(p), cof[2][1].mul(p)];
            let cz = [cof[0][2].mul(p), cof[1][2].mul(p), cof[2][2].mul(p)];
            let (same, opposite) = (plus(cy, cz), minus(cy, cz));
            for (r, row) in rows.into_iter().enumerate() {
                if !owned((row % SIDE) as isize, (row / SIDE) as isize) {
                    continue;
                }
                let sums = &mut s.sums[x & 1][own(row)];
                // What the node ahead receives is subtracted from what is taken from it.
                match r {
                    0 => {
                        take::<L>(&mut sums.at, plus(same, cx));
                        give::<L>(&mut sums.up, minus(same, cx));
                    }
                    1 => {
                        give::<L>(&mut sums.at, minus(opposite, cx));
                        take::<L>(&mut sums.up, plus(opposite, cx));
                    }
                    2 => {
                        take::<L>(&mut sums.at, plus(opposite, cx));
                        give::<L>(&mut sums.up, minus(opposite, cx));
                    }
                    _ => {
                        give::<L>(&mut sums.at, minus(same, cx));
                        take::<L>(&mut sums.up, plus(same, cx));
                    }
                }
            }
        }
    }
    // SAFETY: whole octets.
    unsafe {
        swelling.store(s.extremes[1].0.as_mut_ptr());
        shrinking.store(s.extremes[2].0.as_mut_ptr());
    }
}

/// One component's gradient in eight cells with corner rows `rows`: sums and differences along x, then along y and z.
#[inline(always)]
unsafe fn gradient<L: Lanes>(
    field: &[[Octet<L::Real>; ROW]; ROWS],
    rows: [usize; 4],
    x: usize,
    c: &Constants<L>,
) -> [L; 3] {
    // SAFETY: as the caller's.
    unsafe {
        let (a, a1) = (at::<L>(&field[rows[0]], x, 0), at::<L>(&field[rows[0]], x, 1));
        let (b, b1) = (at::<L>(&field[rows[1]], x, 0), at::<L>(&field[rows[1]], x, 1));
        let (d, d1) = (at::<L>(&field[rows[2]], x, 0), at::<L>(&field[rows[2]], x, 1));
        let (e, e1) = (at::<L>(&field[rows[3]], x, 0), at::<L>(&field[rows[3]], x, 1));
        let (sa, sb, sd, se) = (a.add(a1), b.add(b1), d.add(d1), e.add(e1));
        let dx = a1.sub(a).add(b1.sub(b)).add(d1.sub(d).add(e1.sub(e)));
        let dy = sb.sub(sa).add(se.sub(sd));
        let dz = sd.sub(sa).add(se.sub(sb));
        [dx.mul(c.inverse_4h), dy.mul(c.inverse_4h), dz.mul(c.inverse_4h)]
    }
}

#[inline(always)]
fn plus<L: Lanes>(p: [L; 3], q: [L; 3]) -> [L; 3] {
    [p[0].add(q[0]), p[1].add(q[1]), p[2].add(q[2])]
}

#[inline(always)]
fn minus<L: Lanes>(p: [L; 3], q: [L; 3]) -> [L; 3] {
    [p[0].sub(q[0]), p[1].sub(q[1]), p[2].sub(q[2])]
}

/// Brings home what nodes one back along x gathered for this column.
#[inline(always)]
fn take_from_below<L: Lanes>(s: &mut Scratch<L::Real>, x: usize) {
    for row in 0..BRICK_ROWS {
        let below = s.sums[(x - 1) & 1][row].up;
        let sums = &mut s.sums[x & 1][row];
        for comp in 0..3 {
            // SAFETY: whole octets.
            unsafe {
                let shifted = L::load(sums.up[comp].0.as_ptr()).shift_up(L::load(below[comp].0.as_ptr()));
                L::load(sums.at[comp].0.as_ptr()).sub(shifted).store(sums.at[comp].0.as_mut_ptr());
            }
        }
    }
}

/// Moves the nodes of octet column `x` with their forces, now complete.
#[inline(always)]
unsafe fn integrate<L: Lanes>(pass: &Pass<L::Real>, run: Run, s: &Scratch<L::Real>, x: usize) {
    let brick = run.first + x - 1;
    let (dt, keep, one) = (L::splat(pass.dt), L::splat(pass.keep), L::splat(1.0));
    let zero = L::splat(0.0);
    let g = pass.gravity;
    let gravity = [L::splat(g[0]), L::splat(g[1]), L::splat(g[2])];
    let (mut speed2, mut acceleration2, mut displacement2, mut vis_viva) = (zero, zero, zero, zero);

    for row in (0..BRICK_ROWS).filter(|row| pass.bricks.rows[brick] >> row & 1 != 0) {
        let staged = (row / 4 + 1) * SIDE + row % 4 + 1;
        // SAFETY: as the caller's; slots and octets of this run's brick, which this thread alone writes.
        unsafe {
            let flags: &[u8; 8] = &*pass.flags.as_ptr().add(brick * BRICK_SLOTS + row * 8).cast();
            let mut mass = zero;
            for r in [staged, staged - 1, staged - SIDE, staged - SIDE - 1] {
                mass = mass.add(at::<L>(&s.corner[r], x, 0).add(at(&s.corner[r], x, -1)));
            }
            // Where there is no node this is infinite, and cleared below with every held axis.
            let inverse = one.div(mass);
            let is_free = *flags == [0; 8];

            let sums = &s.sums[x & 1][row];
            let ahead = &s.sums[(x + 1) & 1][row].down;
            let (mut v2, mut a2, mut u2) = (zero, zero, zero);
            for comp in 0..3 {
                let down = L::load(sums.down[comp].0.as_ptr()).shift_down(L::load(ahead[comp].0.as_ptr()));
                let force = L::load(sums.at[comp].0.as_ptr()).sub(down);
                let bit = flag::FIX_X << comp;
                let mut a = force.fma(inverse, gravity[comp]);
                let octet = brick * BRICK_OCTETS + comp * BRICK_ROWS + row;
                let mut v = a.fma(dt, L::load(pass.v.add(octet).cast())).mul(keep);
                if !is_free {
                    (a, v) = (a.free(flags, bit), v.free(flags, bit));
                }
                let u = v.fma(dt, at::<L>(&s.u[comp][staged], x, 0));
                if !pass.watch {
                    v.store(pass.v_next.add(octet).cast());
                    u.store(pass.u_next.add(octet).cast());
                }
                v2 = v.fma(v, v2);
                a2 = a.fma(a, a2);
                u2 = u.fma(u, u2);
            }
            speed2 = v2.max(speed2);
            acceleration2 = a2.max(acceleration2);
            displacement2 = u2.max(displacement2);
            vis_viva = mass.fma(v2, vis_viva);
        }
    }
    let vis_viva = total::<L>(vis_viva);
    // A maximum may lose a NaN; a sum does not.
    let speed2 = if vis_viva.is_finite() { largest::<L>(speed2) } else { f32::NAN };
    let extreme = |e: usize| s.extremes[e].0.iter().fold(0.0, |most, lane| lane.to_f64().max(most)) as f32;
    // SAFETY: one mark a brick, written by this thread alone.
    unsafe {
        *pass.marks.add(brick) = Mark {
            speed2,
            acceleration2: largest::<L>(acceleration2),
            displacement2: largest::<L>(displacement2),
            vis_viva: vis_viva as f32,
            strain: extreme(0),
            swelling: extreme(1),
            shrinking: extreme(2),
        };
    }
}

/// The sum of the lanes.
#[inline(always)]
fn total<L: Lanes>(x: L) -> f64 {
    let mut lanes = Octet::<L::Real>::default();
    // SAFETY: a whole octet.
    unsafe { x.store(lanes.0.as_mut_ptr()) };
    lanes.0.iter().map(|lane| lane.to_f64()).sum()
}

/// The largest lane of positive numbers.
#[inline(always)]
fn largest<L: Lanes>(x: L) -> f32 {
    let mut lanes = Octet::<L::Real>::default();
    // SAFETY: a whole octet.
    unsafe { x.store(lanes.0.as_mut_ptr()) };
    lanes.0.iter().fold(0.0, |most, lane| lane.to_f64().max(most)) as f32
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::nodes::Nodes;
    use super::*;
    use crate::math::{Pose, Vec3};
    use crate::model::lattice::Lattice;
    use crate::model::material::Material;
    use crate::model::{Model, energy};

    /// A reproducible sequence in [-1, 1).
    struct Noise(u64);

    impl Noise {
        fn next(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        }
    }

    fn model_of(lattice: Lattice) -> Arc<Model> {
        Arc::new(Model {
            lattice,
            materials: Vec::new(),
            laws: [CellLaw::default(); 16],
            regions: Default::default(),
            surfaces: Vec::new(),
            contact_surface: 0,
            frame: Pose::identity(),
        })
    }

    /// Accelerations that the kernel finds, on all runs of at most `longest` bricks.
    fn accelerations<R: CpuReal>(
        bricks: &Bricks,
        laws: &[CellLaw; 16],
        nodes: &mut Nodes<R>,
        longest: usize,
        kernel: Kernel<R>,
    ) -> Vec<Vec3> {
        let lattice = bricks.model.lattice();
        let tables = LawTables::<R>::new(laws, lattice.cell_m());
        let mut marks = vec![Mark::default(); bricks.count()];
        let mut scratch = Scratch::new();
        let mut v_next = nodes.v.clone();
        let pass = Pass {
            bricks,
            flags: lattice.flags(),
            laws: &tables,
            u: nodes.u.0.as_ptr(),
            v: nodes.v.0.as_ptr(),
            u_next: nodes.u_next.0.as_mut_ptr(),
            v_next: v_next.0.as_mut_ptr(),
            marks: marks.as_mut_ptr(),
            dt: 1.0,
            gravity: [0.0; 3],
            keep: 1.0,
            watch: false,
        };
        let mut runs = Vec::new();
        bricks.list_runs(longest, |_| true, &mut runs);
        for run in runs {
            // SAFETY: one thread, fields of the right size, a kernel for this processor.
            unsafe { kernel(&pass, run, None, &mut scratch) };
        }
        (0..lattice.slot_count() as u32).map(|slot| v_next.vec3(slot) - nodes.v.vec3(slot)).collect()
    }

    /// A ragged body of random cells and materials that spans several bricks on every axis.
    fn ragged() -> (Arc<Model>, [CellLaw; 16]) {
        let cells = [37, 11, 9];
        let mut noise = Noise(7);
        let materials: Vec<u8> =
            (0..cells.iter().product()).map(|_| ((noise.next() + 1.0) * 8.0 - 4.0).max(0.0) as u8).collect();
        let h = 2e-3;
        let laws = std::array::from_fn(|m| {
            if m == 0 {
                return CellLaw::default();
            }
            let mut material =
                Material::new("m", 1e3 * m as f64, 0.25 + 0.015 * m as f64, 900.0 + 50.0 * m as f64).unwrap();
            material.damping_s = 1e-4 * m as f64;
            CellLaw::of(&material, h)
        });
        (model_of(Lattice::new(cells, h, &materials).unwrap()), laws)
    }

    #[test]
    fn kernel_force_is_the_gradient_of_the_energy() {
        let (model, mut laws) = ragged();
        laws.iter_mut().for_each(|law| law.damping_s = 0.0);
        let lattice = model.lattice();
        let bricks = Bricks::new(model.clone());
        let mut nodes = Nodes::<f64>::at_rest(bricks.count(), false);
        let mut noise = Noise(3);
        let slots: Vec<u32> =
            (0..lattice.slot_count() as u32).filter(|&s| lattice.words()[s as usize] != 0).collect();
        for &slot in &slots {
            nodes.u.set(slot, Vec3::from_fn(|_, _| 4e-4 * noise.next()));
        }

        let tables = LawTables::<f64>::new(&laws, lattice.cell_m());
        let found = accelerations(&bricks, &laws, &mut nodes, MAX_RUN, f64::kernel(&tables));
        let mass = |slot| lattice.node_mass(slot, |m| laws[usize::from(m)].corner_kg);
        let scale = slots.iter().map(|&s| (found[s as usize] * mass(s)).norm()).fold(0.0, f64::max);

        // Central differences of the energy of the whole body, at nodes spread over all bricks.
        for &slot in slots.iter().step_by(97) {
            let rest = nodes.u.vec3(slot);
            for axis in 0..3 {
                let eps = 1e-7;
                let energy_at = |shift: f64| {
                    let mut moved = rest;
                    moved[axis] += shift;
                    energy::elastic_j(lattice, &laws, |s| if s == slot { moved } else { nodes.u.vec3(s) })
                };
                let expected = -(energy_at(eps) - energy_at(-eps)) / (2.0 * eps);
                let force = found[slot as usize][axis] * mass(slot);
                assert!(
                    (force - expected).abs() < 1e-5 * scale,
                    "slot {slot} axis {axis}: {force:e} against {expected:e}"
                );
            }
        }
    }

    #[test]
    fn damped_kernels_agree_on_every_route_and_run_length() {
        let (model, laws) = ragged();
        let bricks = Bricks::new(model.clone());
        let lattice = model.lattice();
        let (mut double, mut single) =
            (Nodes::<f64>::at_rest(bricks.count(), true), Nodes::<f32>::at_rest(bricks.count(), true));
        let mut noise = Noise(11);
        for slot in (0..lattice.slot_count() as u32).filter(|&s| lattice.words()[s as usize] != 0) {
            let (u, v) = (Vec3::from_fn(|_, _| 4e-4 * noise.next()), Vec3::from_fn(|_, _| noise.next()));
            double.u.set(slot, u);
            double.v.set(slot, v);
            single.u.set(slot, u);
            single.v.set(slot, v);
        }

        let tables = LawTables::<f64>::new(&laws, lattice.cell_m());
        let reference = accelerations(&bricks, &laws, &mut double, 1, advance::<Portable<f64>, true, true>);
        let scale = reference.iter().map(Vec3::norm).fold(0.0, f64::max);
        let furthest = |found: &[Vec3]| {
            reference.iter().zip(found).map(|(a, b)| (a - b).norm() / scale).fold(0.0, f64::max)
        };
        let long = accelerations(&bricks, &laws, &mut double, MAX_RUN, advance::<Portable<f64>, true, true>);
        assert_eq!(furthest(&long), 0.0, "the same sums in the same order");
        let simd = accelerations(&bricks, &laws, &mut double, MAX_RUN, f64::kernel(&tables));
        assert!(furthest(&simd) < 1e-14);
        let tables = LawTables::<f32>::new(&laws, lattice.cell_m());
        let simd = accelerations(&bricks, &laws, &mut single, MAX_RUN, f32::kernel(&tables));
        assert!(furthest(&simd) < 1e-6, "{}", furthest(&simd));
    }
}
