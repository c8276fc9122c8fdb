//! The linear system of an implicit step, A v = b, and what it is made of.
//!
//! With velocities v at the end of a step of dt, displacements u + dt v, inner forces f, their change −K, damping β K and drag α:
//!
//! ```text
//! A = (1 + α dt) M + (dt² + β dt) K       b = M v₀ + dt (f(u) + M g + loads)
//! ```
//!
//! That is backward Euler (Baraff and Witkin 1998), once linearised. [`Scheme::Paper`] has b = A v₀ + dt (…) instead, as Magnoux and Ozell print it: the forces
//! at the start of the step act with a mass that grows with stiffness. That is stable as well, but damps nothing.

pub mod saved;

use std::ops::Range;

use super::super::lanes::{Lanes, Octet, Real};
use super::super::nodes::{BRICK_OCTETS, BRICK_ROWS, Bricks, Field, Run};
use super::block::{BLOCK, Block, applied, inverted, matrix};
use super::cell_rows::Like;
use super::gather::{Source, gather};
use super::laws::{Changes, Diagonal, Forces, Moduli, Onward, Plain};
use super::rows::{Table, Turned, TurnedParts};
use super::turn::{Deformed, QUATERNION, at_rest, turn};
use crate::math::{Mat3, Vec3};
use crate::model::efg::law::{Elasticity, Rotation};
use crate::model::efg::rows::{BATCH, RowTable};
use crate::model::lattice::{BRICK_SLOTS, flag};
use crate::model::law::CellLaw;
use crate::solver::method::Scheme;

/// What a simulation's steps have in common, and the arrays that they use.
#[derive(Debug)]
pub struct System<R> {
    tables: Tables<R>,
    rows: RowTable,
    turned: Turned<R>,
    rotations: Vec<Octet<R>>,
    frames: Vec<Octet<R>>,
    inverse: Vec<Octet<R>>,
    /// Velocities at the end of the step.
    pub x: Field<R>,
    pub b: Field<R>,
    r: Field<R>,
    z: Field<R>,
    p: [Field<R>; 2],
    /// A p, and after the solution A x.
    pub q: Field<R>,
    pq: Vec<f64>,
    residues: Vec<Residue>,
    seen: Vec<Seen>,
}

/// What steps read.
#[derive(Debug)]
struct Tables<R> {
    elasticity: Elasticity,
    /// Moduli as they are, and times dt² + β dt.
    forces: Moduli<R>,
    changes: Moduli<R>,
    inverse_4h: f64,
    /// Mass of each node, `[brick][row]`.
    mass: Vec<Octet<R>>,
    /// What cells with rows of their own see.
    rows: Table<R>,
}

/// A step's constants.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    pub dt: f64,
    pub drag_per_s: f64,
    pub gravity: [f64; 3],
    pub scheme: Scheme,
    /// A node that goes further is lost, in m.
    pub furthest: f64,
}

impl Step {
    /// What drag makes of a mass.
    fn inertia(&self) -> f64 {
        self.scheme.inertia(self.dt, self.drag_per_s)
    }
}

/// Sums over a brick, or over all.
#[derive(Clone, Copy, Debug, Default)]
pub struct Residue {
    /// r·r.
    pub rr: f64,
    /// r·z.
    pub rz: f64,
}

/// What a step saw in a brick, or in all.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    /// What rounding of displacements makes of b, squared and summed.
    pub noise2: f64,
    /// Largest |v|² of a node; infinite where any is not finite.
    pub speed2: f64,
    /// Largest |u|² of a node when the step began.
    pub moved2: f64,
    /// How cells are deformed.
    pub deformed: Deformed,
}

impl<R: Real> System<R> {
    /// At rest. The cells of `rows` are none of the bricks' own.
    pub fn new(bricks: &Bricks, rows: RowTable, elasticity: Elasticity, laws: &[CellLaw; 16]) -> Self {
        let (count, h) = (bricks.count(), bricks.model.lattice().cell_m());
        let (rotations, frames) = at_rest(count);
        let mut system = Self {
            tables: Tables {
                elasticity,
                forces: Moduli::new(laws, h, |_| 1.0),
                changes: Moduli::new(laws, h, |_| 0.0),
                inverse_4h: 0.25 / h,
                mass: vec![Octet::default(); count * BRICK_ROWS],
                rows: Table::default(),
            },
            turned: Turned::at_rest(rows.len()),
            rows,
            rotations,
            frames,
            inverse: vec![Octet::default(); count * BLOCK * BRICK_ROWS],
            x: Field::zeros(count),
            b: Field::zeros(count),
            r: Field::zeros(count),
            z: Field::zeros(count),
            p: [Field::zeros(count), Field::zeros(count)],
            q: Field::zeros(count),
            pq: vec![0.0; count],
            residues: vec![Residue::default(); count],
            seen: vec![Seen::default(); count],
        };
        system.set_laws(bricks, laws);
        system
    }

    /// Copies rows that changed to where steps read them. Gives the bytes that it copied.
    pub fn upload(&mut self, bricks: &Bricks) -> u64 {
        let cell_m = bricks.model.lattice().cell_m();
        Table::<R>::bytes_of(&self.tables.rows.upload(&mut self.rows, bricks.slot_count(), cell_m))
    }

    /// Rows of cells, to be changed; [`Self::upload`] takes over what changed.
    pub fn rows(&mut self) -> &mut RowTable {
        &mut self.rows
    }

    /// How a cell is turned.
    pub fn rotation(&self, of: Like) -> Rotation<R> {
        match of {
            Like::Row(row) => self.turned.rotations[row],
            Like::Cell(slot) => {
                let (brick, local) = (slot as usize / BRICK_SLOTS, slot as usize % BRICK_SLOTS);
                let octet = brick * QUATERNION * BRICK_ROWS + local / 8;
                std::array::from_fn(|n| self.rotations[octet + n * BRICK_ROWS].0[local % 8])
            }
        }
    }

    /// Turns the cell of a row; rows up to the one behind the last can be turned.
    pub fn turn_to(&mut self, row: usize, rotation: Rotation<R>) {
        self.turned.turn_to(row, rotation);
    }

    /// Cells that are not turned, and nothing that is not finite anywhere.
    pub fn reset(&mut self, bricks: &Bricks) {
        (self.rotations, self.frames) = at_rest(bricks.count());
        self.turned = Turned::at_rest(self.rows.len());
        for field in &mut self.p {
            field.0.fill(Octet::default());
        }
    }

    /// The inverse of a slot's block on A's diagonal.
    pub fn inverse(&self, slot: u32) -> Block {
        let (octet, lane) = block_place(slot);
        std::array::from_fn(|n| self.inverse[octet + n * BRICK_ROWS].0[lane].to_f64())
    }

    /// Replaces it.
    fn set_inverse(&mut self, slot: u32, block: Block) {
        let (octet, lane) = block_place(slot);
        for (n, number) in block.into_iter().enumerate() {
            self.inverse[octet + n * BRICK_ROWS].0[lane] = R::splat(number);
        }
    }

    /// Adds to the block on A's diagonal of a slot's node, where that has one.
    pub fn stiffen(&mut self, slot: u32, more: &Mat3) {
        let stiffer = matrix(&self.inverse(slot)).try_inverse().map(|block| block + more);
        if let Some(m) = stiffer.and_then(Mat3::try_inverse) {
            self.set_inverse(slot, [m[(0, 0)], m[(0, 1)], m[(0, 2)], m[(1, 1)], m[(1, 2)], m[(2, 2)]]);
        }
    }

    /// What the last step saw in all bricks.
    pub fn seen(&self) -> Seen {
        let of_rows = self.turned.deformed.iter().fold(Deformed::default(), |all, batch| all.max(batch));
        self.seen.iter().fold(Seen { deformed: of_rows, ..Seen::default() }, |all, brick| Seen {
            noise2: all.noise2 + brick.noise2,
            speed2: all.speed2.max(brick.speed2),
            moved2: all.moved2.max(brick.moved2),
            deformed: all.deformed.max(&brick.deformed),
        })
    }

    /// How far nodes of a brick were from rest at most when the step began, in m.
    pub fn moved(&self, brick: usize) -> f64 {
        self.seen[brick].moved2.sqrt()
    }

    /// Other materials.
    pub fn set_laws(&mut self, bricks: &Bricks, laws: &[CellLaw; 16]) {
        let lattice = bricks.model.lattice();
        self.tables.forces = Moduli::new(laws, lattice.cell_m(), |_| 1.0);
        let corner_kg = |material: u8| laws[usize::from(material)].corner_kg;
        let mut masses = vec![0.0; bricks.slot_count()];
        for slot in lattice.slots() {
            let material = bricks.cells[slot as usize];
            if material != 0 {
                for corner in lattice.corners(lattice.node_of(slot)) {
                    masses[corner as usize] += corner_kg(material);
                }
            }
        }
        self.rows.add_masses(laws, &mut masses);
        for (octet, masses) in self.tables.mass.iter_mut().zip(masses.chunks_exact(8)) {
            *octet = Octet(std::array::from_fn(|lane| R::splat(masses[lane])));
        }
    }

    /// Mass of the node in a slot, in kg.
    pub fn mass(&self, slot: u32) -> f64 {
        self.tables.mass[slot as usize / 8].0[slot as usize % 8].to_f64()
    }

    /// Stiffness in steps of a length.
    pub fn set_step(&mut self, bricks: &Bricks, laws: &[CellLaw; 16], dt: f64, scheme: Scheme) {
        let h = bricks.model.lattice().cell_m();
        self.tables.changes = Moduli::new(laws, h, |law| scheme.stiffness(dt, law.damping_s));
    }

    /// Bytes of all this.
    pub fn bytes(&self) -> u64 {
        let octets = 7 * self.x.0.len()
            + self.tables.mass.len()
            + self.inverse.len()
            + self.rotations.len()
            + self.frames.len();
        (octets * size_of::<Octet<R>>()) as u64 + self.tables.rows.bytes()
    }

    /// The parts of a step, for threads to share. Nothing else may touch the system while they are in use.
    pub fn parts<'a>(
        &'a mut self,
        bricks: &'a Bricks,
        flags: &'a [u8],
        step: Step,
        u: &'a mut Field<R>,
        v: &'a mut Field<R>,
    ) -> Parts<'a, R> {
        let start = |field: &mut Field<R>| field.0.as_mut_ptr();
        Parts {
            bricks,
            flags,
            step,
            tables: &self.tables,
            u: u.0.as_mut_ptr(),
            v: v.0.as_mut_ptr(),
            x: start(&mut self.x),
            b: start(&mut self.b),
            r: start(&mut self.r),
            z: start(&mut self.z),
            p: self.p.each_mut().map(start),
            q: start(&mut self.q),
            inverse: self.inverse.as_mut_ptr(),
            rotations: self.rotations.as_mut_ptr(),
            frames: self.frames.as_mut_ptr(),
            turned: self.turned.parts(),
            pq: self.pq.as_mut_ptr(),
            residues: self.residues.as_mut_ptr(),
            seen: self.seen.as_mut_ptr(),
        }
    }
}

/// The parts of a step, each done by threads that take runs of bricks of their own. Between two parts threads meet.
///
/// All are unsafe in the same way: every run is one thread's, and threads meet before another part reads across bricks what this one wrote.
#[derive(Clone, Copy, Debug)]
pub struct Parts<'a, R> {
    pub bricks: &'a Bricks,
    flags: &'a [u8],
    pub step: Step,
    tables: &'a Tables<R>,
    /// Displacements and velocities at the start of the step.
    pub u: *mut Octet<R>,
    pub v: *mut Octet<R>,
    /// Velocities at its end.
    pub x: *mut Octet<R>,
    pub b: *mut Octet<R>,
    /// b − A x along free axes, and that preconditioned.
    r: *mut Octet<R>,
    z: *mut Octet<R>,
    /// Directions, in turn, and A times the newer one, or A x.
    pub p: [*mut Octet<R>; 2],
    pub q: *mut Octet<R>,
    inverse: *mut Octet<R>,
    rotations: *mut Octet<R>,
    frames: *mut Octet<R>,
    turned: TurnedParts<R>,
    pq: *mut f64,
    residues: *mut Residue,
    seen: *mut Seen,
}

// SAFETY: the pointers are to arrays that the system of the same borrow owns; who writes what when is said at `Parts`.
unsafe impl<R: Real> Send for Parts<'_, R> {}
// SAFETY: as above.
unsafe impl<R: Real> Sync for Parts<'_, R> {}

/// Eight numbers in memory.
#[inline(always)]
fn eight_of<L: Lanes>(eight: L) -> [f64; 8] {
    let mut numbers = [L::Real::default(); 8];
    // SAFETY: eight numbers.
    unsafe { eight.store(numbers.as_mut_ptr()) };
    numbers.map(Real::to_f64)
}

/// Their sum, in their order.
#[inline(always)]
fn sum_of<L: Lanes>(eight: L) -> f64 {
    eight_of(eight).iter().sum()
}

/// The octet of a component of a row.
#[inline(always)]
fn at(brick: usize, row: usize, component: usize) -> usize {
    brick * BRICK_OCTETS + component * BRICK_ROWS + row
}

impl<R: Real> Parts<'_, R> {
    /// The vector of a slot. Alone, or where nobody writes the field.
    pub unsafe fn vec3(&self, field: *const Octet<R>, slot: u32) -> Vec3 {
        let (octet, lane) = place(slot);
        // SAFETY: the caller's slot exists and nobody writes it.
        Vec3::from_fn(|c, _| unsafe { (*field.add(octet + c * BRICK_ROWS)).0[lane].to_f64() })
    }

    /// Replaces the vector of a slot. Alone.
    pub unsafe fn set(&self, field: *mut Octet<R>, slot: u32, value: Vec3) {
        let (octet, lane) = place(slot);
        for c in 0..3 {
            // SAFETY: the caller's slot exists and nobody else touches it.
            unsafe { (*field.add(octet + c * BRICK_ROWS)).0[lane] = R::splat(value[c]) };
        }
    }

    /// p·q over all bricks, in their order.
    pub unsafe fn pq(&self) -> f64 {
        // SAFETY: threads have met since it was written.
        (0..self.bricks.count()).map(|brick| unsafe { *self.pq.add(brick) }).sum()
    }

    /// r·r and r·z over all bricks, in their order.
    pub unsafe fn residue(&self) -> Residue {
        // SAFETY: as above.
        let of = |brick: usize| unsafe { *self.residues.add(brick) };
        (0..self.bricks.count())
            .map(of)
            .fold(Residue::default(), |all, brick| Residue { rr: all.rr + brick.rr, rz: all.rz + brick.rz })
    }

    #[inline(always)]
    fn flags_of(&self, brick: usize, row: usize) -> &[u8; 8] {
        let at = brick * BRICK_SLOTS + row * 8;
        self.flags[at..at + 8].try_into().expect("a row has eight nodes")
    }

    /// Whether a row of a brick holds nodes.
    #[inline(always)]
    fn is_held(&self, brick: usize, row: usize) -> bool {
        self.bricks.rows[brick] >> row & 1 != 0
    }

    /// Finds the frames of a run's cells, and how far its nodes are from rest.
    #[inline(always)]
    pub unsafe fn look<L: Lanes<Real = R>>(&self, run: Run) {
        let t = self.tables;
        for brick in run.first..run.end() {
            let mut moved2 = L::splat(0.0);
            for row in 0..BRICK_ROWS {
                let mut u2 = L::splat(0.0);
                for c in 0..3 {
                    // SAFETY: octets of a brick of this thread's.
                    unsafe {
                        let u = L::load(self.u.add(at(brick, row, c)).cast());
                        u2 = u.fma(u, u2);
                    }
                }
                moved2 = moved2.max(u2);
            }
            let moved2 = eight_of(moved2).into_iter().fold(0.0, f64::max);
            // SAFETY: the brick is this thread's, and nobody writes `u`.
            unsafe {
                let deformed = turn::<L>(
                    self.bricks,
                    brick,
                    t.elasticity,
                    &Plain(self.u),
                    t.inverse_4h,
                    self.rotations,
                    self.frames,
                );
                *self.seen.add(brick) = Seen { deformed, moved2, ..Seen::default() };
            }
        }
    }

    /// Finds the frames of cells with rows of their own, a batch at a time.
    pub unsafe fn look_at_rows<L: Lanes<Real = R>>(&self, batches: Range<usize>) {
        for batch in batches {
            // SAFETY: the batch is this thread's, and nobody writes `u`.
            unsafe {
                let u = Plain(self.u);
                self.turned.turn::<L>(&self.tables.rows, batch, self.tables.elasticity, &u);
            }
        }
    }

    /// How many batches there are.
    pub fn batches(&self) -> usize {
        self.tables.rows.len().div_ceil(BATCH)
    }

    /// Inverts the blocks on A's diagonal.
    #[inline(always)]
    pub unsafe fn invert<L: Lanes<Real = R>>(&self, run: Run) {
        let t = self.tables;
        let inertia = L::splat(self.step.inertia());
        let epsilon = if size_of::<R>() == 4 { f64::from(f32::EPSILON) } else { f64::EPSILON };
        let law = Diagonal { moduli: &t.changes, frames: self.frames, row_frames: self.turned.frames };
        // SAFETY: as promised of parts.
        unsafe {
            gather::<L, BLOCK>(
                self.bricks,
                run,
                &t.rows,
                &Plain(self.u),
                &law,
                |brick, row, block, moved| {
                    let heavy = L::load(t.mass.as_ptr().add(brick * BRICK_ROWS + row).cast()).mul(inertia);
                    let [xx, xy, xz, yy, yz, zz] = block;
                    // What rounding of displacements does to forces, as part of b, where anything is free.
                    let flags = self.flags_of(brick, row);
                    let x = free(xx.mul(moved[0]), flags, 0);
                    let (y, z) = (free(yy.mul(moved[1]), flags, 1), free(zz.mul(moved[2]), flags, 2));
                    let noise = x.fma(x, y.fma(y, z.mul(z)));
                    (*self.seen.add(brick)).noise2 += sum_of(noise) * (epsilon / self.step.dt).powi(2);
                    let (xx, yy, zz) = (xx.add(heavy), yy.add(heavy), zz.add(heavy));
                    let inverse = inverted([xx, xy, xz, yy, yz, zz]);
                    for n in 0..BLOCK {
                        inverse[n].store(self.inverse.add((brick * BLOCK + n) * BRICK_ROWS + row).cast());
                    }
                },
            );
        }
    }

    /// Starts b with what acts on nodes without loads and contact, and x with velocities.
    #[inline(always)]
    pub unsafe fn begin<L: Lanes<Real = R>>(&self, run: Run) {
        let (t, step) = (self.tables, self.step);
        let dt = L::splat(step.dt);
        let forces = Forces {
            moduli: &t.forces,
            frames: self.frames,
            row_frames: self.turned.frames,
            elasticity: t.elasticity,
        };
        // SAFETY: as promised of parts.
        unsafe {
            gather::<L, 3>(self.bricks, run, &t.rows, &Plain(self.u), &forces, |brick, row, force, _| {
                let mass = L::load(t.mass.as_ptr().add(brick * BRICK_ROWS + row).cast());
                for c in 0..3 {
                    let octet = at(brick, row, c);
                    let v = L::load(self.v.add(octet).cast());
                    let impulse = mass.fma(L::splat(step.gravity[c]), force[c]).mul(dt);
                    let b = if step.scheme == Scheme::BackwardEuler { mass.fma(v, impulse) } else { impulse };
                    b.store(self.b.add(octet).cast());
                    // What is held stays, unless it is told to move.
                    free(v, self.flags_of(brick, row), c).store(self.x.add(octet).cast());
                }
            });
        }
    }

    /// A times the nodes of `source`, handed on row by row with those themselves.
    #[inline(always)]
    unsafe fn product<L: Lanes<Real = R>>(
        &self,
        run: Run,
        source: &impl Source<L>,
        mut finish: impl FnMut(usize, usize, [L; 3], [L; 3]),
    ) {
        let t = self.tables;
        let inertia = L::splat(self.step.inertia());
        let law = Changes { moduli: &t.changes, frames: self.frames, row_frames: self.turned.frames };
        // SAFETY: as promised of parts.
        unsafe {
            gather::<L, 3>(self.bricks, run, &t.rows, source, &law, |brick, row, force, own| {
                let heavy = L::load(t.mass.as_ptr().add(brick * BRICK_ROWS + row).cast()).mul(inertia);
                let mut product = force;
                for c in 0..3 {
                    product[c] = heavy.mul(own[c]).sub(force[c]);
                }
                finish(brick, row, product, own);
            });
        }
    }

    /// b += A v₀, which is what the paper's scheme has instead of M v₀.
    #[inline(always)]
    pub unsafe fn add_velocities<L: Lanes<Real = R>>(&self, run: Run) {
        // SAFETY: as promised of parts.
        unsafe {
            self.product::<L>(run, &Plain(self.v), |brick, row, product, _| {
                for c in 0..3 {
                    let b = self.b.add(at(brick, row, c));
                    L::load(b.cast()).add(product[c]).store(b.cast());
                }
            });
        }
    }

    /// q = A x.
    #[inline(always)]
    pub unsafe fn multiply<L: Lanes<Real = R>>(&self, run: Run) {
        // SAFETY: as promised of parts.
        unsafe {
            self.product::<L>(run, &Plain(self.x), |brick, row, product, _| {
                for c in 0..3 {
                    let octet = at(brick, row, c);
                    product[c].store(self.q.add(octet).cast());
                }
            });
        }
    }

    /// p = z + β p₀ into the other direction, q = A p, and p·q.
    #[inline(always)]
    pub unsafe fn advance<L: Lanes<Real = R>>(&self, run: Run, beta: f64, turn: usize) {
        let source = Onward { z: self.z, p: self.p[turn], beta };
        for brick in run.first..run.end() {
            // SAFETY: the brick is this thread's.
            unsafe { *self.pq.add(brick) = 0.0 };
        }
        // SAFETY: as promised of parts.
        unsafe {
            self.product::<L>(run, &source, |brick, row, product, own| {
                let mut pq = L::splat(0.0);
                for c in 0..3 {
                    let octet = at(brick, row, c);
                    own[c].store(self.p[1 - turn].add(octet).cast());
                    product[c].store(self.q.add(octet).cast());
                    pq = own[c].fma(product[c], pq);
                }
                *self.pq.add(brick) += sum_of(pq);
            });
        }
    }

    /// x += α p and r −= α q, p being the direction that [`Self::advance`] wrote; z from r; r·r and r·z.
    #[inline(always)]
    pub unsafe fn relax<L: Lanes<Real = R>>(&self, run: Run, alpha: f64, turn: usize) {
        let step = L::splat(alpha);
        // SAFETY: octets of a brick of this thread's.
        unsafe {
            self.precondition::<L>(run, |octet| {
                let (x, p) = (self.x.add(octet), self.p[1 - turn].add(octet));
                L::load(p.cast()).fma(step, L::load(x.cast())).store(x.cast());
                step.take_from(L::load(self.q.add(octet).cast()), L::load(self.r.add(octet).cast()))
            });
        }
    }

    /// r = b − q; z from r; r·r and r·z.
    #[inline(always)]
    pub unsafe fn renew<L: Lanes<Real = R>>(&self, run: Run) {
        // SAFETY: octets of a brick of this thread's.
        unsafe {
            self.precondition::<L>(run, |octet| {
                L::load(self.b.add(octet).cast()).sub(L::load(self.q.add(octet).cast()))
            });
        }
    }

    /// Stores the r that `left` gives, along free axes, and what follows from it.
    #[inline(always)]
    unsafe fn precondition<L: Lanes<Real = R>>(&self, run: Run, left: impl Fn(usize) -> L) {
        for brick in run.first..run.end() {
            let (mut rr, mut rz) = (L::splat(0.0), L::splat(0.0));
            for row in 0..BRICK_ROWS {
                if !self.is_held(brick, row) {
                    continue;
                }
                let flags = self.flags_of(brick, row);
                let mut r = [L::splat(0.0); 3];
                let mut block = [L::splat(0.0); BLOCK];
                // SAFETY: octets of a brick of this thread's.
                unsafe {
                    for c in 0..3 {
                        r[c] = free(left(at(brick, row, c)), flags, c);
                    }
                    for n in 0..BLOCK {
                        block[n] = L::load(self.inverse.add((brick * BLOCK + n) * BRICK_ROWS + row).cast());
                    }
                    let z = applied(&block, r);
                    for c in 0..3 {
                        let z = free(z[c], flags, c);
                        r[c].store(self.r.add(at(brick, row, c)).cast());
                        z.store(self.z.add(at(brick, row, c)).cast());
                        rr = r[c].fma(r[c], rr);
                        rz = r[c].fma(z, rz);
                    }
                }
            }
            // SAFETY: the brick is this thread's.
            unsafe { *self.residues.add(brick) = Residue { rr: sum_of(rr), rz: sum_of(rz) } };
        }
    }

    /// The largest speed at the end of the step.
    #[inline(always)]
    pub unsafe fn measure<L: Lanes<Real = R>>(&self, run: Run) {
        for brick in run.first..run.end() {
            let mut most = 0.0_f64;
            for row in 0..BRICK_ROWS {
                if !self.is_held(brick, row) {
                    continue;
                }
                let mut v2 = L::splat(0.0);
                for c in 0..3 {
                    // SAFETY: octets of a brick of this thread's.
                    let x = unsafe { L::load(self.x.add(at(brick, row, c)).cast()) };
                    v2 = x.fma(x, v2);
                }
                for x in eight_of(v2) {
                    most = if x.is_finite() { most.max(x) } else { f64::INFINITY };
                }
            }
            // SAFETY: the brick is this thread's.
            unsafe { (*self.seen.add(brick)).speed2 = most };
        }
    }

    /// Whether no node is lost.
    pub unsafe fn is_sound(&self) -> bool {
        // SAFETY: threads have met since it was written.
        let speeds = (0..self.bricks.count()).map(|brick| unsafe { (*self.seen.add(brick)).speed2 });
        speeds.fold(0.0, f64::max).sqrt() * self.step.dt < self.step.furthest
    }

    /// u += dt x and v = x.
    #[inline(always)]
    pub unsafe fn go<L: Lanes<Real = R>>(&self, run: Run) {
        let dt = L::splat(self.step.dt);
        for brick in run.first..run.end() {
            for row in 0..BRICK_ROWS {
                for c in 0..3 {
                    let octet = at(brick, row, c);
                    // SAFETY: octets of a brick of this thread's.
                    unsafe {
                        let (x, u) = (L::load(self.x.add(octet).cast()), self.u.add(octet));
                        x.fma(dt, L::load(u.cast())).store(u.cast());
                        x.store(self.v.add(octet).cast());
                    }
                }
            }
        }
    }
}

/// The octet and lane of a slot's x component in a field.
fn place(slot: u32) -> (usize, usize) {
    let (brick, local) = (slot as usize / BRICK_SLOTS, slot as usize % BRICK_SLOTS);
    (brick * BRICK_OCTETS + local / 8, local % 8)
}

/// Likewise of the first number of its block.
fn block_place(slot: u32) -> (usize, usize) {
    let (brick, local) = (slot as usize / BRICK_SLOTS, slot as usize % BRICK_SLOTS);
    (brick * BLOCK * BRICK_ROWS + local / 8, local % 8)
}

/// Nothing where a component is held.
#[inline(always)]
fn free<L: Lanes>(v: L, flags: &[u8; 8], component: usize) -> L {
    v.free(flags, flag::FIX_X << component).free(flags, flag::GRASPED)
}
