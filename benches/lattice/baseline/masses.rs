//! The masses and springs of a model's lattice: up to 26 neighbours, where a cell joins them.
//!
//! In favour of the baselines, masses are numbered along the grid's rows, so that memory is walked nearly in order.

use palpate::model::Model;
use palpate::model::lattice::flag;

/// The masses of a model.
pub struct Masses {
    /// Points of the grid along x, y, z.
    side: [usize; 3],
    /// The lattice's word at each point; 0 where there is no mass.
    words: Vec<u32>,
    /// The number of the mass at each point that has one.
    numbers: Vec<u32>,
    /// The point of each mass.
    points: Vec<u32>,
    held: Vec<bool>,
    cell_m: f32,
    stretch: f32,
    stiffness: [f32; 16],
}

/// A spring, seen from one of its masses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// The mass at the other end.
    pub other: u32,
    /// Rest length in m.
    pub rest_m: f32,
    /// The material of the first cell that holds both.
    pub material: u8,
}

impl Masses {
    /// The masses of a model, and how far their springs are stretched at the start, 1 being not at all. Stiffness by mass is that of the
    /// lattice's edges.
    pub fn new(model: &Model, stretch: f32) -> Self {
        let lattice = model.lattice();
        let side = lattice.cells().map(|n| n + 1);
        let mut words = vec![0; side.iter().product()];
        let mut is_held = vec![false; words.len()];
        for slot in lattice.slots() {
            let node = lattice.node_of(slot);
            let point = node[0] + side[0] * (node[1] + side[1] * node[2]);
            words[point] = lattice.words()[slot as usize];
            is_held[point] = lattice.flags()[slot as usize] & flag::FIX_ALL == flag::FIX_ALL;
        }
        let points: Vec<u32> = (0..words.len() as u32).filter(|&at| words[at as usize] != 0).collect();
        let mut numbers = vec![0; words.len()];
        for (number, &point) in (0..).zip(&points) {
            numbers[point as usize] = number;
        }
        let stiffness = model.laws().map(|law| {
            if law.corner_kg > 0.0 { (law.spring_n_m / (2.0 * law.corner_kg)) as f32 } else { 0.0 }
        });
        let held = points.iter().map(|&point| is_held[point as usize]).collect();
        Self { side, words, numbers, points, held, cell_m: lattice.cell_m() as f32, stretch, stiffness }
    }

    /// How many masses there are.
    pub fn count(&self) -> usize {
        self.points.len()
    }

    /// Where they start, model frame, in m. The fourth number is 0.
    pub fn positions(&self) -> Vec<[f32; 4]> {
        let position = |mass| {
            let [x, y, z] = self.node(mass).map(|i| i as f32 * self.cell_m * self.stretch);
            [x, y, z, 0.0]
        };
        (0..self.count()).map(position).collect()
    }

    /// Whether a mass does not move.
    pub fn is_held(&self, mass: usize) -> bool {
        self.held[mass]
    }

    /// The first material around a mass.
    pub fn material(&self, mass: usize) -> u8 {
        nibbles(self.word(mass)).find(|&material| material != 0).expect("a mass touches a cell")
    }

    /// Stiffness by mass of each material, in 1/s².
    pub fn stiffness(&self) -> &[f32; 16] {
        &self.stiffness
    }

    /// The spring from a mass to its neighbour at an offset, where there is one.
    pub fn link(&self, mass: usize, offset: [isize; 3]) -> Option<Link> {
        let node = self.node(mass);
        let other = [0, 1, 2].map(|a| node[a].wrapping_add_signed(offset[a]));
        if (0..3).any(|a| other[a] >= self.side[a]) {
            return None;
        }
        let point = other[0] + self.side[0] * (other[1] + self.side[1] * other[2]);
        let material = shared_material(self.word(mass), offset)?;
        let length2 = offset.iter().map(|c| c * c).sum::<isize>();
        Some(Link { other: self.numbers[point], rest_m: self.cell_m * (length2 as f32).sqrt(), material })
    }

    fn word(&self, mass: usize) -> u32 {
        self.words[self.points[mass] as usize]
    }

    fn node(&self, mass: usize) -> [usize; 3] {
        let point = self.points[mass] as usize;
        [point % self.side[0], point / self.side[0] % self.side[1], point / (self.side[0] * self.side[1])]
    }
}

/// The offsets to all 26 neighbours, x fastest; those from the thirteenth on come after the mass itself.
pub fn offsets() -> [[isize; 3]; 26] {
    std::array::from_fn(|n| {
        let n = n + usize::from(n >= 13);
        [n % 3, n / 3 % 3, n / 9].map(|c| c as isize - 1)
    })
}

/// The material of the first cell that holds both a node and its neighbour at an offset, from the cells around the node.
fn shared_material(word: u32, offset: [isize; 3]) -> Option<u8> {
    let touches = |cell: usize| {
        (0..3).all(|a| match offset[a] {
            0 => true,
            d => (d > 0) == (cell >> a & 1 == 1),
        })
    };
    let shared = nibbles(word).enumerate().filter(|(cell, _)| touches(*cell));
    shared.map(|(_, material)| material).find(|&material| material != 0)
}

/// The materials of the eight cells around a node.
fn nibbles(word: u32) -> impl Iterator<Item = u8> {
    (0..8).map(move |cell| (word >> (4 * cell) & 15) as u8)
}
