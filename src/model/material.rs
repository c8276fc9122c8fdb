//! What tissue is made of: isotropic elasticity, density and damping, and presets with their sources.
//!
//! **About the presets.** Living tissue is nonlinear, anisotropic, and differs between people and between
//! ways of measuring by factors of two to ten; a preset is a sound start, not a measurement of a patient. All
//! are small-strain values. Shear moduli μ are converted by E = 2 μ (1 + ν) with the ν of the same preset.
//! Soft tissue is nearly incompressible (ν → 0.5); 0.45 is taken where the source names none, because the
//! time step shrinks without bound towards 0.5. Their damping is 0: background drag belongs to the
//! simulation, not to the material.

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
    /// Stiffness-proportional damping β in seconds: every spring of stiffness k resists with β k times its
    /// rate of length.
    pub damping_s: f64,
}

/// A named material with where its numbers come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// What [`Material::preset`] knows it by.
    pub name: &'static str,
    /// Young's modulus in Pa.
    pub young_pa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Mass density in kg/m³.
    pub density_kg_m3: f64,
    /// Stiffness-proportional damping in seconds, see [`Material::damping_s`].
    pub damping_s: f64,
    /// Where the numbers come from, and how far to trust them.
    pub source: &'static str,
}

/// All presets. A figure is either from the source named with it, or called an estimate there. Bone is here for pictures and contact lists: make it rigid, since no explicit time
/// step affords its stiffness.
pub const PRESETS: &[Preset] = &[
    preset("lung", 2e3, 0.43, 300.0, LUNG),
    preset("brain", from_shear(1.03e3, 0.49), 0.49, 1040.0, BRAIN),
    preset("fat", from_shear(0.752e3, 0.45), 0.45, 950.0, FAT),
    preset("stomach", from_shear(0.637e3, 0.45), 0.45, 1058.0, ABDOMEN),
    preset("liver", from_shear(1.8e3, 0.45), 0.45, 1060.0, ABDOMEN),
    preset("diseased_liver", from_shear(19.8e3, 0.45), 0.45, 1060.0, ABDOMEN),
    preset("tumour", from_shear(23.4e3, 0.45), 0.45, 1060.0, TUMOUR),
    preset("gallbladder", from_shear(85e3, 0.45), 0.45, 1060.0, ABDOMEN),
    preset("bile_duct", from_shear(166e3, 0.45), 0.45, 1060.0, ABDOMEN),
    preset("spleen", from_shear(3.6e3, 0.45), 0.45, 1054.0, SPLEEN),
    preset("kidney", from_shear(4.9e3, 0.45), 0.45, 1050.0, KIDNEY),
    preset("muscle", from_shear(3.91e3, 0.45), 0.45, 1060.0, MUSCLE),
    preset("myocardium", 20e3, 0.45, 1055.0, MYOCARDIUM),
    preset("vessel", from_shear(210e3, 0.45), 0.45, 1050.0, VESSEL),
    preset("airway_wall", 100e3, 0.45, 1070.0, AIRWAY),
    preset("skin", 129e3, 0.45, 1100.0, SKIN),
    preset("bone", 10e9, 0.30, 1920.0, BONE),
];

const LUNG: &str = "E and nu: indentation of inflated dog lobes gives E of about twice the inflation \
    pressure, here 1 kPa, and nu of about 0.43 (paper: Elastic constants of inflated lobes of dog lungs). \
    Density: an estimate, what a CT value of -700 HU means.";
const BRAIN: &str = "Shear modulus: slow indentation of porcine white matter, 1.03 kPa, table 1 of J. Funct. \
    Biomater. 3 (2012) 839 (PMC4030922). Density: ICRU Report 44. nu is an estimate: nearly \
    incompressible.";
const FAT: &str = "Shear modulus: magnetic resonance elastography of undeformed fat of the buttocks at 50 Hz, 0.752 \
    kPa (Strain-dependent shear properties of human adipose tissue in vivo, J. Mech. Behav. Biomed. \
    Mater. 2023); fat of the thigh was given 3.04 kPa (PMC4580449). Density: ICRU Report 44. nu is an \
    estimate.";
const ABDOMEN: &str = "Shear modulus and density: table 1 of Phys. Med. Biol. 64 (2019) 225001 \
    (PMC6925591), with liver 1.8 ± 0.4 kPa, gallbladder 85 ± 8.2 kPa, bile duct 166 ± 67 kPa. nu is an \
    estimate.";
const TUMOUR: &str = "Hepatocellular carcinoma, shear modulus 23.4 kPa and density: table 1 of Phys. \
    Med. Biol. 64 (2019) 225001 (PMC6925591). nu is an estimate.";
const SPLEEN: &str = "Shear modulus: magnetic resonance elastography of 12 healthy volunteers, 3.6 ± 0.3 \
    kPa, Am. J. Roentgenol. 193 (2009) 122 (PMC2860633); slow loading is softer. Density: Kaye and Laby's \
    tables. nu is an estimate.";
const KIDNEY: &str = "Shear modulus: magnetic resonance elastography of 10 healthy volunteers at 45 Hz, 4.9 \
    ± 0.5 kPa, J. Magn. Reson. Imaging 34 (2011) 880 (PMC3176985). Density: Kaye and Laby's tables. nu is \
    an estimate.";
const MUSCLE: &str = "Shear modulus: magnetic resonance elastography of the rectus femoris at rest, 3.91 ± \
    0.16 kPa, PLoS ONE 10 (2015) e0138873 (PMC4580449); tensed muscle is stiffer. Density: the usual \
    constant, Sci. Rep. 2021, s41598-021-81489-w. nu is an estimate.";
const MYOCARDIUM: &str = "E and nu are estimates: somewhat stiffer than relaxed skeletal muscle. What is \
    published is in part contradictory (review: Biophys. Rev. 13 (2021) 587). Density: the accepted value \
    in BMC Med. Imaging 2019, s12880-019-0326-4.";
const VESSEL: &str = "Hepatic artery, shear modulus 210 ± 47 kPa and density: table 1 of Phys. Med. \
    Biol. 64 (2019) 225001 (PMC6925591). nu is an estimate.";
const AIRWAY: &str = "E is an estimate of its order of magnitude: tension of pig airways gave 8 to 31 kPa \
    (doi 10.1152/japplphysiol.00090.2018), compression of human bronchial walls 0.17 to 1.65 MPa \
    (arXiv:1111.5645). Density: half soft tissue, half cartilage, table 2 of PMC3859249. nu is an estimate.";
const SKIN: &str = "E: suction on the forearms of 10 men, 129 ± 88 kPa, Skin Res. Technol. 6 (2000) 214; \
    other methods give 5 kPa to 140 MPa. Density: table 1 of PMC4201780. nu is an estimate.";
const BONE: &str = "E is an estimate for whole bone: nanoindentation of its lamellae gave 6.9 to 25 GPa, with \
    nu taken as 0.3, J. Biomech. 32 (1999) 1005. Density: cortical bone, ICRU Report 44.";

const fn preset(
    name: &'static str,
    young_pa: f64,
    poisson: f64,
    density_kg_m3: f64,
    source: &'static str,
) -> Preset {
    Preset { name, young_pa, poisson, density_kg_m3, damping_s: 0.0, source }
}

/// Young's modulus from a shear modulus.
const fn from_shear(shear_pa: f64, poisson: f64) -> f64 {
    2.0 * shear_pa * (1.0 + poisson)
}

impl Material {
    /// A checked material without damping.
    pub fn new(name: impl Into<String>, young_pa: f64, poisson: f64, density_kg_m3: f64) -> Result<Self> {
        let material = Self { name: name.into(), young_pa, poisson, density_kg_m3, damping_s: 0.0 };
        material.check()?;
        Ok(material)
    }

    /// The preset of this name, one of [`PRESETS`].
    pub fn preset(name: &str) -> Result<Self> {
        let found = PRESETS.iter().find(|p| p.name == name).ok_or_else(|| {
            let names: Vec<&str> = PRESETS.iter().map(|p| p.name).collect();
            Error::argument(format!("no material preset is named '{name}'; there are {}", names.join(", ")))
        })?;
        let &Preset { name, young_pa, poisson, density_kg_m3, damping_s, source: _ } = found;
        Ok(Self { name: name.into(), young_pa, poisson, density_kg_m3, damping_s })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_give_the_measured_shear_moduli_back() {
        // Shear modulus in Pa, its stated spread (0: none stated, so only rounding) and density of
        // PMC6925591, table 1.
        let measured = [
            ("liver", 1.8e3, 0.4e3, 1060.0),
            ("tumour", 23.4e3, 0.0, 1060.0),
            ("diseased_liver", 19.8e3, 0.0, 1060.0),
            ("vessel", 210e3, 47e3, 1050.0),
            ("gallbladder", 85e3, 8.2e3, 1060.0),
            ("bile_duct", 166e3, 67e3, 1060.0),
            ("stomach", 0.637e3, 0.0, 1058.0),
        ];
        for (name, shear, spread, density) in measured {
            let material = Material::preset(name).unwrap();
            let error = (material.shear_modulus_pa() - shear).abs();
            assert!(error <= f64::max(spread, 1e-9 * shear), "{name}: {error} Pa off");
            assert_eq!(material.density_kg_m3, density, "{name}");
        }
    }

    #[test]
    fn every_preset_is_valid_and_names_its_source() {
        for preset in PRESETS {
            let material = Material::preset(preset.name).unwrap();
            material.check().unwrap();
            assert_eq!((material.young_pa, material.damping_s), (preset.young_pa, 0.0));
            assert!(preset.source.len() > 20, "{}", preset.name);
            assert_eq!(PRESETS.iter().filter(|p| p.name == preset.name).count(), 1, "{}", preset.name);
        }
    }

    #[test]
    fn an_unknown_preset_is_answered_with_the_known_ones() {
        let message = Material::preset("rubber").unwrap_err().to_string();
        assert!(
            message.contains("rubber") && message.contains("liver") && message.contains("bone"),
            "{message}"
        );
    }
}
