//! What the meshless model is compared with, in the same process and on the same cells: the flow of data of Magnoux and Ozell 2021.
//!
//! Connectivity, φ and ∇φ of all elements lie in whole arrays with rows of one size and a vector of row lengths. Strain is linear, the scheme is the one that is printed,
//! (M + dt² K) Δv = dt f, and plain conjugate gradients solve it from Δv = 0; the host decides after each of the two sums of an iteration. A sphere pushes nodes by springs,
//! explicitly. There is neither stabilisation nor damping, friction or force on what is held.
//!
//! In favour of the baseline, rows have room for eight nodes and no more, which is what elements see that are not cut.

use palpate::error::{Error, Result};
use palpate::math::Vec3;
use palpate::model::Model;
use palpate::model::efg::rows::RowTable;
use palpate::model::lattice::flag;

pub mod parallel;
pub mod serial;

/// Places of a row.
pub const ROW: usize = 8;

/// The paper's arrays, and what elements and nodes are.
pub struct Body {
    pub lengths: Vec<u8>,
    /// Numbers of the nodes that an element sees, and ∇φ of each in 1/m `[element][ROW]`.
    pub nodes: Vec<u32>,
    pub gradients: Vec<[f32; 3]>,
    /// φ, which nothing but masses need where no vertex moves with the element.
    pub phi: Vec<f32>,
    pub stiffness: Vec<Stiffness>,
    pub mass_kg: Vec<f32>,
    pub is_held: Vec<bool>,
    pub rest_m: Vec<[f32; 3]>,
}

/// λ and 2 μ times the element's volume, in N m.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Stiffness {
    pub lambda: f32,
    pub two_mu: f32,
}

impl Body {
    /// Rows for all cells of a model, whose nodes are numbered along the grid's bricks.
    pub fn new(model: &Model) -> Result<Self> {
        let (lattice, laws) = (model.lattice(), model.laws());
        let slots: Vec<u32> = lattice.slots().collect();
        let mut numbers = vec![0; lattice.slot_count()];
        for (number, &slot) in (0..).zip(&slots) {
            numbers[slot as usize] = number;
        }
        let table = RowTable::of_all(lattice)?;
        let places = table.len() * ROW;
        let mut body = Self {
            lengths: Vec::with_capacity(table.len()),
            nodes: vec![0; places],
            gradients: vec![[0.0; 3]; places],
            phi: vec![0.0; places],
            stiffness: Vec::with_capacity(table.len()),
            mass_kg: vec![0.0; slots.len()],
            is_held: slots.iter().map(|&slot| lattice.flags()[slot as usize] & flag::FIX_ALL != 0).collect(),
            rest_m: slots.iter().map(|&slot| lattice.rest_position(slot).map(|x| x as f32).into()).collect(),
        };
        for element in 0..table.len() {
            let row = table.row(element);
            if row.nodes.len() > ROW {
                return Err(Error::argument("the baseline has no room for such a row"));
            }
            let law = &laws[usize::from(row.cell.material)];
            let volume = row.cell.volume * lattice.cell_m().powi(3);
            body.lengths.push(row.nodes.len() as u8);
            body.stiffness.push(Stiffness {
                lambda: (law.lambda_pa * volume) as f32,
                two_mu: (2.0 * law.shear_pa * volume) as f32,
            });
            for (n, &slot) in row.nodes.iter().enumerate() {
                let (place, node) = (element * ROW + n, numbers[slot as usize]);
                body.nodes[place] = node;
                body.gradients[place] = row.gradients[n].map(|x| x as f32).into();
                body.phi[place] = row.phi[n] as f32;
                body.mass_kg[node as usize] += (8.0 * law.corner_kg * row.cell.volume * row.phi[n]) as f32;
            }
        }
        Ok(body)
    }
}

/// What all steps share.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    pub dt: f32,
    pub gravity_m_s2: f32,
    pub tolerance: f64,
    pub radius_m: f32,
    /// What the sphere pushes nodes by, in N/m.
    pub push_n_m: f32,
}

/// A body that is computed by the paper's flow.
pub trait Baseline {
    /// How figures name it.
    fn name(&self) -> &'static str {
        "magnoux-ozell-2021"
    }

    /// Takes a step with the sphere's centre there, model frame. Gives the iterations.
    fn step(&mut self, centre_m: Vec3) -> Result<u32>;

    /// Where nodes have moved.
    fn displacements(&self) -> Result<Vec<[f32; 3]>>;

    /// What the sphere felt in the last step, in N.
    fn felt_n(&self) -> [f32; 3];
}

/// Refuses a state that no figure should come from; `peak_n` is the most that the sphere felt.
pub fn check(baseline: &dyn Baseline, peak_n: f32) -> Result<()> {
    if !baseline.displacements()?.iter().flatten().all(|x| x.is_finite()) {
        return Err(Error::argument("the baseline diverged"));
    }
    if peak_n == 0.0 {
        return Err(Error::argument("the baseline's tool touches nothing"));
    }
    Ok(())
}
