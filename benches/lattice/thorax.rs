//! Scenes `thorax-…` and `lung-…`: the chest of [`anatomy`], pressed from the front.

use std::path::Path;

use palpate::error::Result;

use super::common::anatomy::{self, Anatomy, FRONT, LUNG, softest};
use super::measure::{Scene, measure, simulation};
use super::options::{Options, SceneName};
use super::pace::Pace;
use super::press::{Press, radius};
use super::report::Report;

/// Runs one scene, with sleeping and without.
pub fn run(name: SceneName, options: &Options, report: &mut Report) {
    let (title, cell_m, only): (_, _, &[u16]) = match name {
        SceneName::Lung45 => ("lung-4.5mm", 4.5e-3, LUNG),
        SceneName::Thorax15 => ("thorax-1.5mm", 1.5e-3, &[]),
        SceneName::Thorax3 => ("thorax-3mm", 3e-3, &[]),
        _ => ("thorax-4.5mm", 4.5e-3, &[]),
    };
    let path = match anatomy::labels() {
        Ok(path) => path,
        Err(why) => return report.skip(title, &why),
    };
    match prepare(title, &path, cell_m, only, options) {
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
fn prepare(title: &str, path: &Path, cell_m: f64, only: &'static [u16], options: &Options) -> Result<Scene> {
    let anatomy = Anatomy {
        cell_m,
        only,
        young_pa: options.young,
        poisson: options.nu,
        young_cap_pa: options.young_cap,
        holds_front: false,
    };
    let model = anatomy.model(path)?;

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
