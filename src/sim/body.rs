//! What a simulation has changed of its model: materials and what is held; and the stable step that follows.

use crate::cpu::stability;
use crate::error::{Error, Result};
use crate::model::lattice::flag;
use crate::model::law::{CellLaw, most_damping};
use crate::model::material::Material;
use crate::model::{Fix, Model};

/// Share of the time in which a pressure wave crosses a cell that is stable whatever cells there are and whatever is held: by the element eigenvalue theorem, for
/// ν up to 0.49, whose factor is 1.71.
const ANY_CELLS: f64 = 0.55;

/// The simulation's own copy of what can change.
#[derive(Clone, Debug)]
pub(super) struct Body {
    pub materials: Vec<Material>,
    pub laws: [CellLaw; 16],
    pub flags: Vec<u8>,
    /// The model's highest angular frequency in rad/s, squared, with its own laws and flags.
    omega2: f64,
    /// Whether something moves that the model holds, or stands alone that hung together.
    is_freed: bool,
    pub stable_dt: f64,
}

impl Body {
    /// As the model is, of which a solver found the stable step.
    pub fn new(model: &Model, stable_dt: f64) -> Self {
        let omega2 = stability::highest_omega(stable_dt, most_damping(model.laws())).powi(2);
        Self {
            materials: model.materials().to_vec(),
            laws: *model.laws(),
            flags: model.lattice().flags().to_vec(),
            omega2,
            is_freed: false,
            stable_dt,
        }
    }

    /// Gives a material index, from 1, another material. Cells that are rigid stay so.
    pub fn set_material(&mut self, model: &Model, index: u8, material: &Material) -> Result<()> {
        material.check()?;
        let at = usize::from(index);
        let Some(known) = at.checked_sub(1).and_then(|position| self.materials.get_mut(position)) else {
            return Err(Error::argument(format!("the model has no material {index}")));
        };
        if self.laws[at].spring_n_m == 0.0 {
            return Err(Error::argument(format!("material {index}, {}, is rigid and stays so", known.name)));
        }
        *known = material.clone();
        self.laws[at] = CellLaw::of(material, model.lattice().cell_m());
        self.stable_dt = self.bound(model);
        Ok(())
    }

    /// Holds or frees axes of nodes; gives those whose flags change, with their new ones. Rigid regions stay held.
    pub fn set_held(&mut self, model: &Model, fix: &Fix, is_held: bool) -> Result<Vec<(u32, u8)>> {
        let lattice = model.lattice();
        let (bits, slots) = (fix.bits(), fix.slots(lattice, &model.frame())?);
        let mut changed = Vec::new();
        for slot in slots {
            let flags = &mut self.flags[slot as usize];
            if lattice.words()[slot as usize] == 0 || *flags & flag::DRIVEN != 0 {
                continue;
            }
            let new = if is_held { *flags | bits } else { *flags & !bits };
            if new != *flags {
                *flags = new;
                self.is_freed |= lattice.flags()[slot as usize] & !new & flag::FIX_ALL != 0;
                changed.push((slot, new));
            }
        }
        self.stable_dt = self.bound(model);
        Ok(changed)
    }

    /// Notes that cells were divided: a piece is as stiff for its mass as a whole cell that stands alone.
    pub fn note_cut(&mut self, model: &Model) {
        self.is_freed = true;
        self.stable_dt = self.bound(model);
    }

    /// Notes nodes as held by a tool, or not any more; gives them with their flags.
    pub fn set_grasped(&mut self, slots: impl Iterator<Item = u32>, is_held: bool) -> Vec<(u32, u8)> {
        slots
            .map(|slot| {
                let flags = &mut self.flags[slot as usize];
                *flags = if is_held { *flags | flag::GRASPED } else { *flags & !flag::GRASPED };
                (slot, *flags)
            })
            .collect()
    }

    /// A step that is stable at rest.
    ///
    /// What is held lowers frequencies. Where each cell is at most a times as stiff and at least b times as heavy as in the model, ω² is at most a/b times the
    /// model's. Where that says nothing, what holds of any cells does.
    fn bound(&self, model: &Model) -> f64 {
        // Implicit steps are stable whatever changes.
        if self.stable_dt.is_infinite() {
            return self.stable_dt;
        }
        let soft = self.laws.iter().zip(model.laws()).filter(|(_, old)| old.spring_n_m > 0.0);
        let (mut stiffer, mut lighter) = (1.0_f64, 1.0_f64);
        for (new, old) in soft {
            stiffer = stiffer.max(new.spring_n_m / old.spring_n_m);
            // Terms that were not there make it infinite, those that are gone need no room.
            stiffer = stiffer.max(if new.volume_n > 0.0 { new.volume_n / old.volume_n } else { 0.0 });
            lighter = lighter.max(old.corner_kg / new.corner_kg);
        }
        let known = if self.is_freed { f64::INFINITY } else { self.omega2 * stiffer * lighter };
        let moving = self.materials.iter().zip(&self.laws[1..]).filter(|(_, law)| law.spring_n_m > 0.0);
        let fastest = moving.map(|(material, _)| material.longitudinal_speed_m_s()).fold(0.0, f64::max);
        let of_any = (2.0 * fastest / (ANY_CELLS * model.lattice().cell_m())).powi(2);
        stability::stable_dt(known.min(of_any).sqrt(), most_damping(&self.laws))
    }

    /// Largest Poisson's ratio, ¼ at least.
    pub fn poisson(&self) -> f64 {
        self.materials.iter().map(|material| material.poisson).fold(0.25, f64::max)
    }
}
