//! Scenes `thorax-…` and `lung-…`: a labelled chest from the folder that `PALPATE_DATA` names, pressed from the front.
//!
//! A cell takes the label that fills most of it (majority rule). Bone is rigid, and so are all faces of the volume but the front, which are
//! cuts through tissue. Label 4, muscle and liver together, counts as muscle, the stiffer of the two.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use palpate::error::{Error, Result};
use palpate::math::Vec3;
use palpate::model::grid::{LabelGrid, ResampleRule};
use palpate::model::lattice::flag;
use palpate::model::material::Material;
use palpate::model::{Build, LabelUse, Model, import};
use palpate::sim::{Pick, Sim};

use super::measure::{Scene, measure, simulation};
use super::options::{Options, SceneName};
use super::pace::Pace;
use super::press::{Press, radius};
use super::report::Report;

/// The tissue of each label; no name is nothing.
const LABELS: [&str; 11] =
    ["", "lung", "vessel", "", "muscle", "muscle", "fat", "vessel", "vessel", "bone", "liver"];
/// Labels of the lungs alone.
const LUNG: [u16; 3] = [1, 2, 8];
/// Where patients look, in the world of files.
const FRONT: Vec3 = Vec3::new(0.0, 1.0, 0.0);
/// Rays along each side of the search for a place to press.
const RAYS: usize = 15;

/// Runs one scene, with sleeping and without.
pub fn run(name: SceneName, options: &Options, report: &mut Report) {
    let (title, cell_m, labels): (_, _, &[u16]) = match name {
        SceneName::Lung45 => ("lung-4.5mm", 4.5e-3, &LUNG),
        SceneName::Thorax15 => ("thorax-1.5mm", 1.5e-3, &[]),
        SceneName::Thorax3 => ("thorax-3mm", 3e-3, &[]),
        _ => ("thorax-4.5mm", 4.5e-3, &[]),
    };
    let Some(folder) = std::env::var_os("PALPATE_DATA") else {
        report.skip(title, "PALPATE_DATA does not name the folder with thorax_labels.nii.gz");
        return;
    };
    let path = PathBuf::from(folder).join("thorax_labels.nii.gz");
    if !path.exists() {
        report.skip(title, &format!("{} is not there", path.display()));
        return;
    }
    match prepare(title, &path, cell_m, labels, options) {
        Ok(mut scene) => {
            for sleeping in [true, false] {
                scene.sleeping = sleeping;
                report.add(measure(&scene, options));
            }
        }
        Err(error) => report.fail(title, &error.to_string()),
    }
}

/// Builds the scene; of these labels alone where there are any.
fn prepare(title: &str, path: &PathBuf, cell_m: f64, only: &[u16], options: &Options) -> Result<Scene> {
    let mut build = Build::new(import::read_labels(path)?);
    build.cell_m = Some(cell_m);
    build.rule = ResampleRule::Majority;
    build.uses = uses(only, options)?;
    build.fix_faces = held_faces(&build.grid);
    build.young_cap_pa = Some(options.young_cap);
    let model = Arc::new(build.run(&mut |_, _| true)?);

    let pace = Pace::of(options, &model);
    let press = Press {
        radius_m: radius(10e-3, &model),
        friction: 0.3,
        point_m: softest(&simulation(model.clone(), true, pace, options)?)?.point_m,
        direction: -FRONT,
        gap_m: 1e-3,
        depth_m: 15e-3,
        speed_m_s: 20e-3,
        circle_m: 0.0,
    };
    Ok(Scene {
        name: title.into(),
        model,
        pace,
        press,
        sleeping: true,
        measured_from_m: 0.0,
        young_pa: options.young,
        young_cap_pa: Some(options.young_cap),
        poisson: options.nu,
    })
}

fn uses(only: &[u16], options: &Options) -> Result<BTreeMap<u16, LabelUse>> {
    (0..).zip(LABELS).map(|(label, tissue)| Ok((label, use_of(label, tissue, only, options)?))).collect()
}

fn use_of(label: u16, tissue: &str, only: &[u16], options: &Options) -> Result<LabelUse> {
    if tissue.is_empty() || !(only.is_empty() || only.contains(&label)) {
        return Ok(LabelUse::Empty);
    }
    let mut material = Material::preset(tissue)?;
    if tissue == "bone" {
        return Ok(LabelUse::Rigid(material));
    }
    material.young_pa = options.young.unwrap_or(material.young_pa);
    material.poisson = options.nu.unwrap_or(material.poisson);
    Ok(LabelUse::Tissue(material))
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
fn softest(sim: &Sim) -> Result<Pick> {
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
