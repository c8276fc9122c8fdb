//! Sums of forces, in registers and in scratch rows.

use super::super::lanes::{Lanes, Octet};

/// `sums -= force`.
#[inline(always)]
pub(super) fn take<L: Lanes>(sums: &mut [Octet<L::Real>; 3], force: [L; 3]) {
    store(sums, minus(load(sums), force));
}

/// `sums += force`.
#[inline(always)]
pub(super) fn give<L: Lanes>(sums: &mut [Octet<L::Real>; 3], force: [L; 3]) {
    store(sums, plus(load(sums), force));
}

#[inline(always)]
pub(super) fn load<L: Lanes>(sums: &[Octet<L::Real>; 3]) -> [L; 3] {
    // SAFETY: whole octets.
    unsafe { [L::load(sums[0].0.as_ptr()), L::load(sums[1].0.as_ptr()), L::load(sums[2].0.as_ptr())] }
}

#[inline(always)]
pub(super) fn store<L: Lanes>(sums: &mut [Octet<L::Real>; 3], values: [L; 3]) {
    // SAFETY: whole octets.
    unsafe {
        values[0].store(sums[0].0.as_mut_ptr());
        values[1].store(sums[1].0.as_mut_ptr());
        values[2].store(sums[2].0.as_mut_ptr());
    }
}

#[inline(always)]
pub(super) fn plus<L: Lanes>(p: [L; 3], q: [L; 3]) -> [L; 3] {
    [p[0].add(q[0]), p[1].add(q[1]), p[2].add(q[2])]
}

#[inline(always)]
pub(super) fn minus<L: Lanes>(p: [L; 3], q: [L; 3]) -> [L; 3] {
    [p[0].sub(q[0]), p[1].sub(q[1]), p[2].sub(q[2])]
}
