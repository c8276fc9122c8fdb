//! What tissue is made of: isotropic elasticity, density and damping, and presets with their sources.

use crate::error::{Error, Result};

/// Most materials in one model: a cell's material is four bits and 0 means empty.
pub const MAX_MATERIALS: usize = 15;

/// An isotropic, linearly elastic material at small strain.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// A name for tables and pictures.
    pub name: String,
    /// Young's modulus in Pa.
    pub young_pa: f64,
    /// Poisson's ratio, in [0.25, 0.5).
    pub poisson: f64,
    /// Mass density in kg/m³.
    pub density_kg_m3: f64,
    /// Stiffness-proportional damping β in seconds: every spring of stiffness k resists with β k times its rate of length.
    pub damping_s: f64,
}

impl Material {
    /// A checked material without damping.
    pub fn new(name: impl Into<String>, young_pa: f64, poisson: f64, density_kg_m3: f64) -> Result<Self> {
        let material = Self { name: name.into(), young_pa, poisson, density_kg_m3, damping_s: 0.0 };
        material.check()?;
        Ok(material)
    }

    /// Refuses values outside what the models can represent.
    pub fn check(&self) -> Result<()> {
        let Self { name, young_pa, poisson, density_kg_m3, damping_s } = self;
        let refuse = |what: String| Err(Error::argument(format!("material '{name}': {what}")));
        if !(1.0..=1e12).contains(young_pa) {
            return refuse(format!("Young's modulus {young_pa} Pa is not between 1 Pa and 1e12 Pa"));
        }
        if !(0.25..0.5).contains(poisson) {
            return refuse(format!("Poisson's ratio {poisson} is not in [0.25, 0.5)"));
        }
        if !(1.0..=30_000.0).contains(density_kg_m3) {
            return refuse(format!("density {density_kg_m3} kg/m³ is not between 1 and 30,000"));
        }
        if !(0.0..=1.0).contains(damping_s) {
            return refuse(format!("damping {damping_s} s is not between 0 s and 1 s"));
        }
        Ok(())
    }

    /// Lamé's second constant μ (the shear modulus), in Pa.
    pub fn shear_modulus_pa(&self) -> f64 {
        self.young_pa / (2.0 * (1.0 + self.poisson))
    }

    /// Lamé's first constant λ, in Pa.
    pub fn lame_lambda_pa(&self) -> f64 {
        self.young_pa * self.poisson / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson))
    }

    /// Speed of longitudinal waves √((λ + 2 μ) / ρ), in m/s.
    pub fn longitudinal_speed_m_s(&self) -> f64 {
        ((self.lame_lambda_pa() + 2.0 * self.shear_modulus_pa()) / self.density_kg_m3).sqrt()
    }
}
