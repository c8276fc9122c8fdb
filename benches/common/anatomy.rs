//! A labelled chest from the folder that `PALPATE_DATA` names, to be pressed from the front.
//!
//! A cell takes the label that fills most of it (majority rule). Bone is rigid, and so are all faces of the volume but the front, which are
//! cuts through tissue. Label 4, muscle and liver together, counts as muscle, the stiffer of the two.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use palpate::error::{Error, Result};
use palpate::math::Vec3;
use palpate::model::grid::{LabelGrid, ResampleRule};
use palpate::model::lattice::flag;
use palpate::model::material::Material;
use palpate::model::{Build, LabelUse, Model, import};
use palpate::sim::{Pick, Sim};

/// The tissue of each label; no name is nothing.
const LABELS: [&str; 11] =
    ["", "lung", "vessel", "", "muscle", "muscle", "fat", "vessel", "vessel", "bone", "liver"];
/// Labels of the lungs alone.
pub const LUNG: &[u16] = &[1, 2, 8];
/// Where patients look, in the world of files.
pub const FRONT: Vec3 = Vec3::new(0.0, 1.0, 0.0);
/// Rays along each side of the search for a place to press.
const RAYS: usize = 15;

/// What the chest is made of.
#[derive(Clone, Copy, Debug)]
pub struct Anatomy {
    pub cell_m: f64,
    /// These labels alone; all where there are none.
    pub only: &'static [u16],
    /// Young's modulus and Poisson's ratio of all tissue; presets where left out.
    pub young_pa: Option<f64>,
    pub poisson: Option<f64>,
    pub young_cap_pa: f64,
    /// Whether the front is held too, so that what is pressed is a wall.
    pub holds_front: bool,
}

/// Where the labels are, or why they are not there.
pub fn labels() -> std::result::Result<PathBuf, String> {
    let Some(folder) = std::env::var_os("PALPATE_DATA") else {
        return Err("PALPATE_DATA does not name the folder with thorax_labels.nii.gz".into());
    };
    let path = PathBuf::from(folder).join("thorax_labels.nii.gz");
    if path.exists() { Ok(path) } else { Err(format!("{} is not there", path.display())) }
}

impl Anatomy {
    /// Builds it.
    pub fn model(&self, labels: &Path) -> Result<Arc<Model>> {
        let mut build = Build::new(import::read_labels(labels)?);
        build.cell_m = Some(self.cell_m);
        build.rule = ResampleRule::Majority;
        build.uses = self.uses()?;
        build.fix_faces = if self.holds_front { [true; 6] } else { held_faces(&build.grid) };
        build.young_cap_pa = Some(self.young_cap_pa);
        Ok(Arc::new(build.run(&mut |_, _| true)?))
    }

    fn uses(&self) -> Result<BTreeMap<u16, LabelUse>> {
        (0..).zip(LABELS).map(|(label, tissue)| Ok((label, self.use_of(label, tissue)?))).collect()
    }

    fn use_of(&self, label: u16, tissue: &str) -> Result<LabelUse> {
        if tissue.is_empty() || !(self.only.is_empty() || self.only.contains(&label)) {
            return Ok(LabelUse::Empty);
        }
        let mut material = Material::preset(tissue)?;
        if tissue == "bone" {
            return Ok(LabelUse::Rigid(material));
        }
        material.young_pa = self.young_pa.unwrap_or(material.young_pa);
        material.poisson = self.poisson.unwrap_or(material.poisson);
        Ok(LabelUse::Tissue(material))
    }
}

/// All faces but the front.
fn held_faces(grid: &LabelGrid) -> [bool; 6] {
    let front = grid.frame().rotation.inverse() * FRONT;
    let axis = front.iamax();
    let mut held = [true; 6];
    held[2 * axis + usize::from(front[axis] > 0.0)] = false;
    held
}

/// Of a grid of rays from the front: the one that ends where the surface faces it, farthest from anything held.
pub fn softest(sim: &Sim) -> Result<Pick> {
    let model = sim.model();
    let held = held_nodes(model);
    let surface = &model.surfaces()[model.contact_surface()];
    let world = surface.positions.iter().map(|p| model.frame().transform_point(&(*p).into()).coords);
    let (low, high) = world
        .fold((Vec3::repeat(f64::MAX), Vec3::repeat(f64::MIN)), |(low, high), p| (low.inf(&p), high.sup(&p)));
    let mut best: Option<(f64, Pick)> = None;
    for ray in 0..RAYS * RAYS {
        let along = |a: usize, i: usize| low[a] + (high[a] - low[a]) * (i as f64 + 0.5) / RAYS as f64;
        let from = Vec3::new(along(0, ray % RAYS), high.y + 0.01, along(2, ray / RAYS));
        let Some(pick) = sim.pick(from, -FRONT)? else { continue };
        let clearance = held.iter().map(|node| (node - pick.point_m).norm()).fold(f64::MAX, f64::min);
        let score = clearance * pick.normal.dot(&FRONT);
        if best.is_none_or(|(highest, _)| score > highest) {
            best = Some((score, pick));
        }
    }
    best.map(|(_, pick)| pick).ok_or_else(|| Error::argument("nothing can be pressed from the front"))
}

/// Rest positions of all nodes that are held, world frame.
fn held_nodes(model: &Model) -> Vec<Vec3> {
    let lattice = model.lattice();
    (0..lattice.slot_count() as u32)
        .filter(|&slot| lattice.words()[slot as usize] != 0)
        .filter(|&slot| lattice.flags()[slot as usize] & flag::FIX_ALL != 0)
        .map(|slot| model.frame().transform_point(&lattice.rest_position(slot).into()).coords)
        .collect()
}
