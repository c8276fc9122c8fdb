//! What is pressed: the generated thorax, or a label map from a file.

use std::collections::BTreeMap;

use anyhow::{Context, bail};
use indicatif::ProgressBar;
use palpate::math::Vec3;
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, LabelUse, Model, import, phantom};

use super::options::Options;

/// What labels mean in a file when `--material` does not say otherwise: those of a segmented chest. Label, use, and the name in
/// pictures and tables.
const CHEST_LABELS: [(u16, &str, &str); 11] = [
    (0, "empty", "outside"),
    (1, "lung", "lung"),
    (2, "vessel", "vessels in the lung"),
    (3, "empty", "airways"),
    (4, "muscle", "muscle and liver"),
    (5, "muscle", "filled heart"),
    (6, "fat", "fat"),
    (7, "vessel", "aorta"),
    (8, "airway_wall", "airway wall"),
    (9, "rigid", "bone"),
    (10, "spleen", "spleen"),
];

/// Builds the model that the options ask for. `toward` is the direction of the press in the world: the face of a label map that
/// it enters by stays free, the other five are held.
pub fn build(options: &Options, toward: Vec3, bar: &ProgressBar) -> anyhow::Result<Model> {
    let cell_m = options.cell_mm * 1e-3;
    let mut build = match &options.labels {
        None => {
            let mut build = Build::new(phantom::thorax(cell_m.clamp(0.001, 0.010))?);
            build.uses = phantom::thorax_uses();
            build
        }
        Some(path) => {
            let grid = import::read_labels(path)?;
            let uses = uses(&grid, &options.materials)?;
            let mut build = Build::new(grid);
            build.uses = uses;
            build
        }
    };
    build.cell_m = Some(cell_m);
    build.fix_faces = held_faces(&build.grid, toward);
    build.young_cap_pa = (options.young_cap_kpa > 0.0).then_some(options.young_cap_kpa * 1e3);

    bar.set_length(1000);
    let model = build.run(&mut |fraction, stage| {
        bar.set_position((fraction * 1000.0) as u64);
        bar.set_message(stage.to_owned());
        true
    })?;
    bar.finish_and_clear();
    Ok(model)
}

/// All faces but the one that looks against the press.
fn held_faces(grid: &LabelGrid, toward: Vec3) -> [bool; 6] {
    let local = grid.frame().rotation.inverse() * toward;
    let axis = local.iamax();
    let mut held = [true; 6];
    held[2 * axis + usize::from(local[axis] < 0.0)] = false;
    held
}

/// The use of every label in the grid.
fn uses(grid: &LabelGrid, choices: &[String]) -> anyhow::Result<BTreeMap<u16, LabelUse>> {
    let mut words: BTreeMap<u16, (&str, &str)> =
        CHEST_LABELS.into_iter().map(|(label, word, name)| (label, (word, name))).collect();
    let mut chosen = Vec::new();
    for choice in choices {
        let Some((label, word)) = choice.split_once('=') else {
            bail!("--material {choice}: LABEL=USE is needed")
        };
        let label = label.trim();
        let number =
            label.parse().with_context(|| format!("--material {choice}: '{label}' is not a label"))?;
        words.insert(number, (word.trim(), word.trim()));
        chosen.push(number);
    }

    let mut is_used = vec![false; usize::from(u16::MAX) + 1];
    grid.labels().iter().for_each(|&label| is_used[usize::from(label)] = true);
    if let Some(label) = chosen.into_iter().find(|label| !is_used[usize::from(*label)]) {
        bail!("--material {label}=…: the file has no label {label}");
    }
    let labels = (0..=u16::MAX).filter(|&label| is_used[usize::from(label)]);
    labels
        .map(|label| {
            let known = words.get(&label);
            let (word, name) = known
                .with_context(|| format!("label {label} has no meaning: add --material {label}=TISSUE"))?;
            Ok((label, use_of(word, name)?))
        })
        .collect()
}

fn use_of(word: &str, name: &str) -> anyhow::Result<LabelUse> {
    let named = |preset: &str| Material::preset(preset).map(|m| Material { name: name.to_owned(), ..m });
    Ok(match word {
        "empty" => LabelUse::Empty,
        "rigid" => LabelUse::Rigid(named("bone")?),
        tissue => LabelUse::Tissue(named(tissue)?),
    })
}
