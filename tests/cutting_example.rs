//! The cutting example does what it promises, on coarse cases.

use std::collections::{BTreeSet, HashSet};
use std::path::Path;

use clap::Parser;
use palpate::math::Vec3;
use palpate::sim::Part;
use tiny_skia::Pixmap;

#[path = "support/closed.rs"]
mod closed;
#[allow(dead_code)]
#[path = "../examples/cutting/main.rs"]
mod cutting;

use closed::{check_closed, names, points, there};
use cutting::{Done, Options};

/// Volumes sum up so exactly.
const SUM: f64 = 1e-9;
/// Share of the cone's volume by which its part may differ: a cut that is beside the edge's way by a fifth of a cell of 6 mm all around.
const BESIDE: f64 = 0.1;

fn run(out: &Path, words: &[&str]) -> (Options, Done) {
    let out = out.to_str().unwrap();
    let options =
        Options::try_parse_from([&["cutting", "--frames", "2", "--out", out], words].concat()).unwrap();
    let done = cutting::run(&options).unwrap();
    (options, done)
}

fn volume_m3(parts: &[Part]) -> f64 {
    parts.iter().map(|part| part.volume_m3).sum()
}

/// Vertices less edges plus triangles, where points that are one count once: 0 of a ring, 2 of a ball.
fn euler(done: &Done) -> i64 {
    let frame = done.stage.surface.last().unwrap();
    let names = names(&points(&frame));
    let corners = frame.triangles.iter().map(|corners| corners.map(|v| names[v as usize]));
    let triangles: Vec<[usize; 3]> = corners.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    let vertices: HashSet<usize> = triangles.iter().flatten().copied().collect();
    let edges: HashSet<(usize, usize)> = triangles
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
        .map(|(a, b)| (a.min(b), a.max(b)))
        .collect();
    vertices.len() as i64 - edges.len() as i64 + triangles.len() as i64
}

/// What is true of either scene. Gives how many points of the pictures before, during and after show walls.
fn check(out: &Path, options: &Options, done: &Done) -> [usize; 3] {
    let (scene, sim) = (&done.stage.scene, &done.stage.sim);
    let lattice = scene.model.lattice();
    let had = lattice.cell_count() as f64 * lattice.cell_m().powi(3);
    let has = volume_m3(&sim.parts()) + sim.statistics().removed_m3;
    assert!((has / had - 1.0).abs() < SUM, "{has} m³ of {had} m³");

    let frame = done.stage.surface.last().unwrap();
    check_closed(&frame, &points(&frame));
    assert!(there(&frame.triangles[frame.first_wall..]).count() > 0, "there are walls");

    // Tissue laid open is redder than any tissue is.
    let red = ["before", "during", "after"].map(|name| {
        let picture = Pixmap::load_png(out.join(name).with_extension("png")).unwrap();
        assert_eq!([picture.width() as usize, picture.height() as usize], cutting::SIZE, "{name}");
        let colours: BTreeSet<_> = picture.pixels().iter().map(|p| [p.red(), p.green(), p.blue()]).collect();
        assert!(colours.len() > 2000, "{name}: {} colours", colours.len());
        picture.pixels().iter().filter(|p| f64::from(p.red()) > 1.6 * f64::from(p.green().max(1))).count()
    });
    assert_eq!(red[0], 0, "nothing is open before");
    assert!(red[2] > 2000, "what is cut off lies open: {red:?}");

    let table = std::fs::read_to_string(out.join("steps.csv")).unwrap();
    let (heading, lines) = table.split_once('\n').unwrap();
    let steps = (scene.seconds() / options.step_s()).round() as usize;
    assert_eq!(lines.lines().count(), steps, "a line for each step");

    let force = heading.split(',').position(|name| name == "force_n").unwrap();
    let forces = lines.lines().map(|line| line.split(',').nth(force).unwrap().parse::<f64>().unwrap());
    let peak_n = forces.fold(0.0, f64::max);
    let edge_m: f64 = scene.blade.edge.windows(2).map(|ends| (ends[1] - ends[0]).norm()).sum();
    let most_n = options.toughness * edge_m;
    // Told to a millionth of a newton.
    assert!(0.0 < peak_n && peak_n <= most_n + 1e-6, "{peak_n} N of {most_n} N");
    red
}

#[test]
fn a_torus_is_cut_through_in_both_models() {
    for model in ["efg", "lattice"] {
        let dir = tempfile::tempdir().unwrap();
        let (options, done) = run(dir.path(), &["--cells", "1500", "--triangles", "1500", "--model", model]);
        let red = check(dir.path(), &options, &done);
        assert!(red[1] > 200, "{model}: the cut gapes: {red:?}");
        // A ring that was cut once is one part, and no ring.
        assert_eq!([done.parts_before.len(), done.stage.sim.parts().len()], [1, 1], "{model}");
        assert_eq!(euler(&done), 2, "{model}");
    }
}

#[test]
fn a_tumour_is_cut_out_with_the_cone_around_it() {
    let dir = tempfile::tempdir().unwrap();
    let (options, done) = run(dir.path(), &["--scene", "tumour", "--cell-mm", "6", "--step-ms", "20"]);
    check(dir.path(), &options, &done);
    let parts = done.stage.sim.parts();
    assert_eq!(parts.len(), done.parts_before.len() + 1);

    // The cone that the edge goes around.
    let scene = &done.stage.scene;
    let (model, lattice) = (&scene.model, scene.model.lattice());
    let to_tool = scene.blade_at(scene.seconds()).inverse();
    let mouth = scene.blade.edge[scene.blade.edge.len() - 1];
    let is_inside = |cell: Vec3| {
        let at = to_tool.transform_point(&cell.into()).coords;
        at.y > 0.0 && at.xz().norm() < mouth.x / mouth.y * at.y
    };
    let cells = lattice.occupied().filter(|(cell, _)| {
        let corners = lattice.corners(*cell).map(|slot| lattice.rest_position(slot));
        let middle = corners.iter().sum::<Vec3>() / 8.0;
        is_inside(model.frame().transform_point(&middle.into()).coords)
    });
    let cone_m3 = cells.count() as f64 * lattice.cell_m().powi(3);
    let free: Vec<_> = parts.iter().filter(|part| !part.is_held).collect();
    assert_eq!(free.len(), 1);
    let off = free[0].volume_m3 / cone_m3 - 1.0;
    assert!(off.abs() < BESIDE, "{} m³ of {cone_m3} m³", free[0].volume_m3);
}
