//! Cuts soft tissue: `cargo run --release --example cutting`.
//!
//! A torus that hangs by its top is cut through, as that of Magnoux and Ozell (2021), or a tumour is cut out of a chest (`--scene tumour`). Pictures before, during and after, a short animation and
//! a line of numbers for each step go to `--out DIR`, one table to the terminal.

mod animation;
// Pressing needs what cutting does not.
#[allow(dead_code)]
#[path = "../common/picture/mod.rs"]
mod drawing;
mod options;
mod picture;
mod record;
mod scene;
mod torus;
mod tumour;

use std::process::ExitCode;

use anyhow::Context;
use clap::Parser;
use palpate::math::Pose;
use palpate::sim::{Sim, SimDesc};
use palpate::solver::tool::{ToolDesc, ToolMotion};

pub use options::Options;
use options::Subject;
use picture::Moment;
pub use picture::SIZE;
use record::{Record, Step};
use scene::{GRASPER_M, Scene};

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(done) => {
            println!("{}", done.record.table(&done.place));
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("cutting: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// What became of it.
#[derive(Debug)]
pub struct Done {
    /// Every step.
    pub record: Record,
    /// Where it ran.
    pub place: String,
    /// Volumes of the parts at the end in m³, the largest first.
    pub parts_m3: Vec<f64>,
}

/// Does the whole job.
pub fn run(options: &Options) -> anyhow::Result<Done> {
    options.check()?;
    std::fs::create_dir_all(&options.out)
        .with_context(|| format!("cannot make the folder {}", options.out.display()))?;
    let scene = match options.scene {
        Subject::Torus => torus::scene(options)?,
        Subject::Tumour => tumour::scene(options)?,
    };
    let mut sim = Sim::new(scene.model.clone(), &desc(options, &scene))?;
    let mut surface = sim.open_surface(0)?;
    let mut blade = sim.add_tool(&ToolDesc::blade(scene.blade.clone()))?;

    let mut grasper = scene.lift.map(|_| sim.add_tool(&ToolDesc::sphere(GRASPER_M))).transpose()?;
    let mut is_held = false;

    let mut record = Record::new(&scene.model);
    let mut film = animation::Film::new(options.frames);
    let steps = (scene.seconds() / options.step_s()).round() as u32;
    // Before, in the middle of the cut, and at the end.
    let during = ((scene.rest_s + 0.5 * scene.cut_s) / options.step_s()) as u32;
    let mut moments = vec![Moment::of(&surface.map()?, None, None)];
    for step in 1..=steps {
        let time_s = f64::from(step) * options.step_s();
        let pose = scene.blade_at(time_s);
        blade.set_motion(&ToolMotion::at(pose))?;
        let taken = scene.grasper_at(time_s).zip(grasper.as_mut());
        if let Some(((at, true), port)) = taken {
            port.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z)))?;
        }
        sim.step().with_context(|| format!("after {time_s:.3} s"))?;
        let shown = scene.grasper_at(time_s).filter(|(_, holds)| *holds).map(|(at, _)| at);
        if let (Some(port), Some(lift), Some(_), false) = (&grasper, &scene.lift, shown, is_held) {
            sim.grasp(port.id(), lift.reach_m)?;
            is_held = true;
        }
        let frame = surface.map()?;
        record.note(Step::of(&sim, &blade.force(), &frame, scene.is_cutting(time_s)));
        if step == during || step == steps {
            moments.push(Moment::of(&frame, Some(&pose), shown));
        }
        if film.is_due(step, steps) {
            film.shoot(Moment::of(&frame, Some(&pose), shown));
        }
    }
    for (moment, name) in moments.iter().zip(["before.png", "during.png", "after.png"]) {
        picture::draw(&scene, moment, &moments, SIZE)?.save(&options.out.join(name))?;
    }
    film.write(&scene, &moments, &options.out.join("cut.gif"))?;
    record.write(&options.out.join("steps.csv"))?;
    let parts_m3 = sim.parts().iter().map(|part| part.volume_m3).collect();
    Ok(Done { record, place: sim.place().to_string(), parts_m3 })
}

fn desc(options: &Options, scene: &Scene) -> SimDesc {
    SimDesc {
        method: options.method(),
        backend: options.backend(),
        gravity_m_s2: scene.gravity_m_s2,
        rest_under_gravity: scene.rests_under_gravity,
        step_s: options.step_s(),
        cut_nodes: scene.cut_nodes,
        ..SimDesc::default()
    }
}
