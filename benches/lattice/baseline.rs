//! What the lattice is compared with: Etheredge 2011, algorithm 1, "straightforward serial implementation", as printed there.
//!
//! One thread walks a list of springs, accumulates forces and then integrates the masses. Everything that the paper's arrays hold is
//! held likewise: positions as four floats, of this and of the last step; for each spring the indices of its masses, its rest length and
//! its material; one stiffness for each material. As printed, forces are halved, the Verlet step has a factor ½, masses are 1 and all
//! springs of a material have one stiffness. There is no tool, no gravity, no damping, no held node and no control of
//! Poisson's ratio: the lattice does all that within the time that it is measured with.
//!
//! In favour of the baseline, masses are numbered along the grid's rows and springs are listed by their first mass, so that memory is
//! walked nearly in order; and array indices are not checked, as they would not be in C.

use std::time::{Duration, Instant};

use palpate::model::Model;

/// How figures name it.
pub const NAME: &str = "etheredge-2011-algorithm-1";
/// Least number of steps, and least time, that one round of measuring takes.
const STEPS: usize = 5;
const ROUND: Duration = Duration::from_millis(200);
/// Stretch that the springs start with, so that they have something to do.
const STRETCH: f32 = 1.005;

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
    /// The springs of a model's lattice: 26 neighbours where a cell joins them. Stiffness by mass is that of the lattice's edges.
    pub fn new(model: &Model, dt: f64) -> Self {
        let lattice = model.lattice();
        let side = lattice.cells().map(|n| n + 1);
        let at = |node: [usize; 3]| node[0] + side[0] * (node[1] + side[1] * node[2]);
        let mut words = vec![0_u32; side.iter().product()];
        for (slot, &word) in lattice.words().iter().enumerate().filter(|(_, word)| **word != 0) {
            words[at(lattice.node_of(slot as u32))] = word;
        }
        let mut number = vec![0_u32; words.len()];
        let mut nodes = Vec::new();
        for index in (0..words.len()).filter(|&index| words[index] != 0) {
            number[index] = nodes.len() as u32;
            nodes.push([index % side[0], index / side[0] % side[1], index / (side[0] * side[1])]);
        }

        let h = lattice.cell_m() as f32;
        let now: Vec<[f32; 4]> = nodes
            .iter()
            .map(|node| {
                let [x, y, z] = node.map(|i| i as f32 * h * STRETCH);
                [x, y, z, 0.0]
            })
            .collect();
        let (mut ends, mut rest, mut material) = (Vec::new(), Vec::new(), Vec::new());
        for node in &nodes {
            // The thirteen offsets that come after the node itself.
            for offset in (14..27).map(|n| [n % 3, n / 3 % 3, n / 9].map(|c| c as isize - 1)) {
                let other = [0, 1, 2].map(|a| node[a].wrapping_add_signed(offset[a]));
                if (0..3).any(|a| other[a] >= side[a]) || words[at(other)] == 0 {
                    continue;
                }
                if let Some(m) = shared_material(words[at(*node)], offset) {
                    ends.push([number[at(*node)], number[at(other)]]);
                    rest.push(h * (offset.iter().map(|c| c * c).sum::<isize>() as f32).sqrt());
                    material.push(m);
                }
            }
        }
        let stiffness = std::array::from_fn(|m| {
            let law = model.laws()[m];
            if law.corner_kg > 0.0 { (law.spring_n_m / (2.0 * law.corner_kg)) as f32 } else { 0.0 }
        });
        let force = vec![[0.0; 4]; now.len()];
        Self { before: now.clone(), now, force, ends, rest, material, stiffness, dt: dt as f32 }
    }

    /// Algorithm 1.
    #[inline(never)]
    pub fn step(&mut self) {
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

    /// Adds the wall times of some steps, in microseconds.
    pub fn measure(&mut self, times_us: &mut Vec<f64>) {
        self.step();
        let start = Instant::now();
        for step in 0.. {
            if step >= STEPS && start.elapsed() >= ROUND {
                break;
            }
            let started = Instant::now();
            self.step();
            times_us.push(started.elapsed().as_secs_f64() * 1e6);
        }
        assert!(self.now.iter().flatten().all(|x| x.is_finite()), "the baseline stays finite");
    }
}

/// The material of the first cell that holds both a node and its neighbour at an offset, from the cells around the node.
fn shared_material(word: u32, offset: [isize; 3]) -> Option<u8> {
    let touches = |cell: u32| {
        (0..3).all(|a| match offset[a] {
            0 => true,
            d => (d > 0) == (cell >> a & 1 == 1),
        })
    };
    (0..8).filter(|&cell| touches(cell)).map(|cell| (word >> (4 * cell) & 15) as u8).find(|&m| m != 0)
}
