//! What the bench `cutting` measures is what it says: its command line, its phases, and what it makes of steps.

use clap::Parser;
use palpate::solver::statistics::Statistics;

#[allow(dead_code)] // its own program uses the rest
#[path = "../benches/cutting/main.rs"]
mod cutting;

use cutting::hanging::scene;
use cutting::options::{FRAME_S, FigureName, ModelName, Options};
use cutting::phases::{PhaseFigure, Setting, measure};
use cutting::scene::Phase;
use cutting::take::{Picture, Sample, Take};

fn options(words: &[&str]) -> Options {
    Options::try_parse_from([&["cutting"], words].concat()).unwrap()
}

fn is_refused(words: &[&str]) -> bool {
    Options::try_parse_from([&["cutting"], words].concat()).is_err()
}

/// A coarse torus, and steps of the lattice.
fn coarse(words: &[&str]) -> Options {
    options(&[&["--cells", "1500", "--triangles", "1500", "--model", "lattice"], words].concat())
}

fn setting(full_bytes: Option<u64>) -> Setting {
    Setting {
        scene: "torus",
        model: ModelName::Efg,
        cells: 8,
        nodes: 27,
        triangles: 48,
        dt_s: 4e-3,
        toughness_j_m2: 1.0,
        full_bytes,
    }
}

/// A step that took so many ms, half of it to cut where it has divided a cell, and copied as many bytes.
fn sample(phase: Phase, share: f64, ms: u64, has_divided: bool) -> Sample {
    let wall_s = ms as f64 * 1e-3;
    let cut_wall_s = if has_divided { 0.5 * wall_s } else { 0.0 };
    let statistics = Statistics { step_wall_s: wall_s, cut_wall_s, ..Statistics::default() };
    Sample { phase, share, statistics, has_divided, to_device: ms, picture: None }
}

#[test]
fn what_cannot_be_measured_is_refused() {
    for words in [
        &["--cells", "1499"][..],
        &["--cells", "4000001"],
        &["--triangles", "0"],
        &["--dt", "0"],
        &["--dt", "nan"],
        &["--seconds", "-1"],
        &["--seconds", "inf"],
        &["--figure", "everything"],
        &["--model", "fem"],
        &["--backend", "abacus"],
    ] {
        assert!(is_refused(words), "{words:?}");
    }
}

#[test]
fn a_gpu_is_asked_for_more_and_in_shorter_steps() {
    let (cpu, gpu) = (options(&[]), options(&["--backend", "cuda"]));
    assert_eq!([cpu.torus().cells, gpu.torus().cells], [6000, 80_000]);
    assert_eq!([cpu.step_s(), gpu.step_s()], [FRAME_S, 1e-3]);
    assert_eq!([cpu.frame_s(), gpu.frame_s()], [FRAME_S; 2], "`largest` is about frames");
    let chosen = options(&["--backend", "cuda", "--cells", "2000", "--dt", "0.002"]);
    assert_eq!((chosen.torus().cells, chosen.step_s(), chosen.frame_s()), (2000, 2e-3, 2e-3));
    assert_eq!(options(&[]).figures().len(), 5, "all when none is named");
    assert_eq!(options(&["--figure", "servo"]).figures(), [FigureName::Servo]);
}

#[test]
fn quantiles_are_those_of_a_phase() {
    // 200 steps of 1 to 200 ms while cut, of which those of an even number divide; one of a second before, none after.
    let mut samples = vec![sample(Phase::Before, 0.0, 1000, false)];
    samples.extend((1..=200).map(|n| sample(Phase::Cut, n as f64 / 200.0, n, n % 2 == 0)));
    samples[7].picture = Some(Picture { map_s: 0.9, vertices: 5, triangles: 6 });
    let of = |phase| PhaseFigure::of(&setting(Some(1000)), phase, &samples);
    assert!(of(Phase::After).is_none());
    assert_eq!(of(Phase::Before).unwrap().step_ms, [1000.0; 3]);

    let cut = of(Phase::Cut).unwrap();
    let near = |found: [f64; 3], told: [f64; 3]| {
        found.iter().zip(told).for_each(|(a, b)| assert!((a - b).abs() < 1e-9, "{found:?} {told:?}"));
    };
    assert_eq!((cut.steps, cut.dividing_steps), (200, 100));
    near(cut.step_ms, [100.0, 198.0, 200.0]);
    near(cut.map_ms.unwrap(), [900.0; 3]);
    // Half of the steps did not cut.
    near(cut.cut_ms, [0.0, 98.0, 100.0]);
    near(cut.dividing_cut_ms.unwrap(), [50.0, 99.0, 100.0]);
    assert_eq!((cut.drawn_vertices, cut.drawn_triangles), (5, 6));
    // 200 steps of 4 ms in 20.1 s, and 0.9 s of pictures.
    assert!((cut.rtf - 0.8 / 21.0).abs() < 1e-12, "{}", cut.rtf);
    assert!(!cut.keeps_up, "half of the steps take longer than 4 ms");
    let copied = cut.copied.unwrap();
    assert_eq!((copied.bytes_per_step, copied.most_bytes), (100.5, 200));
    assert_eq!((copied.share_of_full, copied.most_share_of_full), (0.1005, 0.2));
    // Fifths of the way end at 0.2, 0.4, ...: the step that ends one is the first of the next.
    let along = cut.step_ms_along_the_way.unwrap().map(|p50| p50.unwrap().round());
    assert_eq!(along, [20.0, 59.0, 99.0, 139.0, 180.0]);
    assert!(of(Phase::Before).unwrap().step_ms_along_the_way.is_none());
}

#[test]
fn a_part_of_a_cut_is_measured_and_nothing_behind_it() {
    let options = coarse(&["--seconds", "1"]);
    let how = (options.model, options.step_s(), options.seconds);
    let scene = scene(&options.torus()).unwrap();
    let steps = [scene.rest_s, 1.0].map(|time_s| (time_s / options.step_s()).round() as usize);
    let phases = measure("torus", scene, how, &options).unwrap();
    assert_eq!(phases.iter().map(|phase| phase.phase).collect::<Vec<_>>(), [Phase::Before, Phase::Cut]);
    assert_eq!(phases[0].steps + phases[1].steps, steps[0] + steps[1]);
    assert_eq!(phases[0].divided_cells, 0);
    assert!(phases[1].divided_cells > 0 && phases[1].dividing_steps > 0, "the edge is in the tissue");
    assert_eq!(
        phases[1].divided_cells.min(1),
        u64::from(phases[1].drawn_triangles > phases[0].drawn_triangles)
    );
    assert!(phases[1].copied.is_none(), "nothing is copied to a GPU");
    let parts = phases[1].step_ms_along_the_way.unwrap();
    assert!(parts[2].is_some() && parts[3..].iter().all(Option::is_none), "half of the way: {parts:?}");
}

#[test]
fn pictures_come_as_often_as_a_screen_shows_them() {
    let options = coarse(&["--dt", "0.004"]);
    let scene = scene(&options.torus()).unwrap();
    let mut take = Take::new(scene, &options.desc(options.model, options.step_s()), options.seconds).unwrap();
    let mut pictures = 0;
    for _ in 0..50 {
        pictures += usize::from(take.step().unwrap().unwrap().picture.is_some());
    }
    assert_eq!(pictures, 12, "60 in a second of 250 steps");
}
