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
mod stage;
mod torus;
mod tumour;

use std::process::ExitCode;

use anyhow::Context;
use clap::Parser;
use palpate::sim::Part;

pub use options::Options;
use options::Subject;
use picture::Moment;
pub use picture::SIZE;
use record::{Record, Step};
use stage::Stage;

/// Share of the blade's way after which the second picture is taken.
const DURING: f64 = 0.75;

fn main() -> ExitCode {
    match run(&Options::parse()) {
        Ok(done) => {
            println!("{}", done.record.table(&done.stage.sim.place().to_string()));
            println!("parts: {} before, {} after", done.parts_before.len(), done.stage.sim.parts().len());
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("cutting: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// What became of it.
pub(crate) struct Done {
    /// Every step.
    pub record: Record,
    /// The scene after the last.
    pub stage: Stage,
    /// What hung together before the first.
    pub parts_before: Vec<Part>,
}

/// Does the whole job.
pub(crate) fn run(options: &Options) -> anyhow::Result<Done> {
    options.check()?;
    std::fs::create_dir_all(&options.out)
        .with_context(|| format!("cannot make the folder {}", options.out.display()))?;
    let (scene, view) = match options.scene {
        Subject::Torus => (torus::scene(&options.torus())?, torus::VIEW),
        Subject::Tumour => (tumour::scene(options.cell_mm * 1e-3, options.toughness)?, tumour::VIEW),
    };
    let steps = (scene.seconds() / options.step_s()).round() as u32;
    // Before, when most is cut, and at the end.
    let during = ((scene.rest_s + DURING * scene.cut_s) / options.step_s()) as u32;
    let mut stage = Stage::new(scene, &options.desc())?;
    let parts_before = stage.sim.parts();

    let mut record = Record::new(&stage.scene.model);
    let mut film = animation::Film::new(options.frames);
    let mut moments = vec![Moment::of(&stage.surface.map()?, None, None)];
    for step in 1..=steps {
        let time_s = stage.next_s();
        stage.step().with_context(|| format!("after {time_s:.3} s"))?;
        let (scene, frame) = (&stage.scene, stage.surface.map()?);
        record.note(Step::of(&stage.sim, &stage.blade.force(), &frame, scene.phase(time_s)));
        let pose = scene.blade_at(time_s);
        let grasper = scene.grasper_at(time_s);
        if step == during || step == steps {
            moments.push(Moment::of(&frame, Some(&pose), grasper));
        }
        if film.is_due(step, steps) {
            film.shoot(Moment::of(&frame, Some(&pose), grasper));
        }
    }
    let seen = (&stage.scene, &view);
    for (moment, name) in moments.iter().zip(["before.png", "during.png", "after.png"]) {
        picture::draw(seen, moment, &moments, SIZE)?.save(&options.out.join(name))?;
    }
    film.write(seen, &moments, &options.out.join("cut.gif"))?;
    record.write(&options.out.join("steps.csv"))?;
    Ok(Done { record, stage, parts_before })
}
