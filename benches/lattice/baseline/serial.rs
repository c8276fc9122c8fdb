//! Algorithm 1, "straightforward serial implementation", as printed.
//!
//! One thread walks a list of springs, accumulates forces and then integrates the masses. Everything that the paper's arrays hold is
//! held likewise: positions as four floats, of this and of the last step; for each spring the indices of its masses, its rest length and
//! its material; one stiffness for each material. There is no tool, no gravity, no damping and no held node: the lattice does all that within
//! the time that it is measured with.
//!
//! In favour of the baseline, springs are listed by their first mass, and array indices are not checked, as they would not be in C.

use palpate::error::{Error, Result};

use super::Baseline;
use super::masses::{Masses, offsets};

/// Stretch that the springs start with, so that they have something to do.
pub const STRETCH: f32 = 1.005;

/// A mass–spring system as the paper lays it out.
pub struct Serial {
    now: Vec<[f32; 4]>,
    before: Vec<[f32; 4]>,
    force: Vec<[f32; 4]>,
    ends: Vec<[u32; 2]>,
    rest: Vec<f32>,
    material: Vec<u8>,
    stiffness: [f32; 16],
    dt: f32,
}

impl Serial {
    /// The masses at the start, with a step of `dt` seconds.
    pub fn new(masses: &Masses, dt: f64) -> Self {
        let now = masses.positions();
        let (mut ends, mut rest, mut material) = (Vec::new(), Vec::new(), Vec::new());
        for mass in 0..masses.count() {
            // Each spring once: from the mass that comes first.
            for link in offsets()[13..].iter().filter_map(|&offset| masses.link(mass, offset)) {
                ends.push([mass as u32, link.other]);
                rest.push(link.rest_m);
                material.push(link.material);
            }
        }
        let force = vec![[0.0; 4]; now.len()];
        let stiffness = *masses.stiffness();
        Self { before: now.clone(), now, force, ends, rest, material, stiffness, dt: dt as f32 }
    }

    /// Where the masses are.
    pub fn positions(&self) -> &[[f32; 4]] {
        &self.now
    }

    /// Algorithm 1.
    #[inline(never)]
    fn step(&mut self) {
        let Self { now, before, force, ends, rest, material, stiffness, dt } = self;
        force.fill([0.0; 4]);
        for spring in 0..ends.len() {
            // SAFETY: the lists are equally long, both ends are masses and a material is below 16.
            unsafe {
                let [i, j] = ends.get_unchecked(spring).map(|end| end as usize);
                let (a, b) = (now.get_unchecked(i), now.get_unchecked(j));
                let l = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
                let length = (l[0] * l[0] + l[1] * l[1] + l[2] * l[2]).sqrt();
                let k = stiffness.get_unchecked(usize::from(*material.get_unchecked(spring)));
                let scale = k * (length - rest.get_unchecked(spring)) / length * 0.5;
                let f = [l[0] * scale, l[1] * scale, l[2] * scale];
                let on_a = force.get_unchecked_mut(i);
                on_a[0] += f[0];
                on_a[1] += f[1];
                on_a[2] += f[2];
                let on_b = force.get_unchecked_mut(j);
                on_b[0] -= f[0];
                on_b[1] -= f[1];
                on_b[2] -= f[2];
            }
        }
        let half = 0.5 * *dt * *dt;
        for ((x, old), f) in now.iter().zip(before.iter_mut()).zip(&*force) {
            for axis in 0..3 {
                old[axis] = 2.0 * x[axis] - old[axis] + half * f[axis];
            }
        }
        std::mem::swap(now, before);
    }
}

impl Baseline for Serial {
    fn name(&self) -> &'static str {
        "etheredge-2011-algorithm-1"
    }

    fn advance(&mut self) -> Result<u32> {
        self.step();
        Ok(1)
    }

    fn check(&self) -> Result<()> {
        let is_finite = self.positions().iter().flatten().all(|x| x.is_finite());
        is_finite.then_some(()).ok_or_else(|| Error::argument("the baseline diverged"))
    }
}
