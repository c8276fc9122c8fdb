//! The palpation example does what it promises, on a coarse case.

#[allow(dead_code)]
#[path = "../examples/palpation/main.rs"]
mod palpation;

use std::path::Path;

use clap::Parser;
use palpation::Options;
use tiny_skia::Pixmap;

const PICTURES: [&str; 8] = [
    "outside_before.png",
    "outside_pressed.png",
    "outside_displacement.png",
    "cutaway_pressed.png",
    "section_material.png",
    "section_displacement.png",
    "section_strain.png",
    "force_indentation.png",
];

fn run(out: &Path, more: &[&str]) -> anyhow::Result<String> {
    let fixed = ["palpation", "--cell-mm", "10", "--depth-mm", "10", "--speed-mm-s", "100", "--out"];
    let mut words: Vec<&str> = fixed.to_vec();
    words.push(out.to_str().unwrap());
    words.extend(more);
    palpation::run(&Options::try_parse_from(words)?).map(|table| table.to_string())
}

/// The columns of the CSV file by name.
struct Columns {
    names: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Columns {
    fn read(path: &Path) -> Self {
        let text = std::fs::read_to_string(path).unwrap();
        let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        let names = lines.next().unwrap();
        let rows: Vec<_> = lines.collect();
        assert!(rows.iter().all(|row| row.len() == names.len()), "a row is not as long as the head");
        Self { names, rows }
    }

    fn text(&self, name: &str) -> Vec<&str> {
        let column = self.names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no column {name}"));
        self.rows.iter().map(|row| row[column].as_str()).collect()
    }

    fn numbers(&self, name: &str) -> Vec<f64> {
        let numbers: Vec<f64> = self.text(name).iter().map(|text| text.parse().unwrap()).collect();
        assert!(numbers.iter().all(|x| x.is_finite()), "column {name} holds what is not finite");
        numbers
    }
}

#[test]
fn a_press_leaves_a_table_and_pictures_that_are_not_blank() {
    let out = tempfile::tempdir().unwrap();
    let table = run(out.path(), &[]).unwrap();
    for word in ["nodes", "substeps", "real-time factor", "force at most", "indentation", "energy"] {
        assert!(table.contains(word), "the table does not tell '{word}':\n{table}");
    }

    for name in PICTURES {
        let picture =
            Pixmap::load_png(out.path().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        let coarse = |p: &tiny_skia::PremultipliedColorU8| (p.red() / 8, p.green() / 8, p.blue() / 8);
        let mut colours: Vec<_> = picture.pixels().iter().map(coarse).collect();
        colours.sort_unstable();
        colours.dedup();
        assert!(colours.len() > 30, "{name} has only {} colours", colours.len());
    }
}

#[test]
fn force_is_zero_before_contact_and_rises_with_indentation() {
    let out = tempfile::tempdir().unwrap();
    run(out.path(), &["--no-pictures"]).unwrap();
    assert!(!out.path().join("outside_before.png").exists());

    let run = Columns::read(&out.path().join("run.csv"));
    let phase = run.text("phase");
    let [time, indentation, contacts] =
        ["time_s", "indentation_mm", "contacts"].map(|name| run.numbers(name));
    let [x, y, z] = ["force_x_n", "force_y_n", "force_z_n"].map(|name| run.numbers(name));
    let force = |row: usize| x[row].hypot(y[row]).hypot(z[row]);
    assert!(time.is_sorted_by(|a, b| a < b));
    assert!((indentation.iter().copied().fold(0.0, f64::max) - 10.0).abs() < 1e-6);

    // Air first, then every quarter of the way in is felt more than the one before it.
    let first = contacts.iter().position(|&count| count > 0.0).unwrap();
    assert!(first > 0 && (0..first).all(|row| force(row) == 0.0 && indentation[row] == 0.0));
    let mean = |quarter: usize| {
        let is_in =
            |row: &usize| (indentation[*row] / 2.5).min(3.999) as usize == quarter && phase[*row] == "Press";
        let rows: Vec<usize> = (first..phase.len()).filter(is_in).collect();
        rows.iter().map(|&row| force(row)).sum::<f64>() / rows.len() as f64
    };
    assert!((1..4).all(|quarter| mean(quarter) > mean(quarter - 1)));

    // The body is pressed from its front, and pushes back to the front.
    assert!((0..phase.len()).filter(|&row| phase[row] == "Hold").all(|row| y[row] > 0.5 * force(row)));
    assert_eq!(force(phase.len() - 1), 0.0, "the tool ends in the air");
}

#[test]
fn the_table_tells_where_the_tissue_was_computed() {
    let out = tempfile::tempdir().unwrap();
    let told = |more: &[&str]| run(out.path(), &[&["--no-pictures"], more].concat());
    let plain = told(&["--threads", "1"]).unwrap();
    assert!(plain.contains("CPU, 1 thread ") && !plain.contains("not on a GPU"), "{plain}");
    // Double precision runs nowhere but on the processor.
    let fallen_back = told(&["--backend", "auto", "--f64"]).unwrap();
    assert!(fallen_back.contains("CPU") && fallen_back.contains("single precision"), "{fallen_back}");
    let error = told(&["--backend", "cuda", "--f64"]).unwrap_err();
    assert!(palpation::sentence(&error).contains("single precision"), "{error}");
}

#[test]
fn a_mistake_is_answered_with_a_sentence() {
    let out = tempfile::tempdir().unwrap();
    let sentence = |more: &[&str]| palpation::sentence(&run(out.path(), more).unwrap_err());
    assert!(sentence(&["--radius-mm", "0"]).contains("--radius-mm must be a number above 0"));
    assert!(sentence(&["--at", "900,0,900"]).contains("no tissue"));
    assert!(sentence(&["--labels", "absent.nii.gz"]).contains("absent.nii.gz"));
    assert!(sentence(&["--young-cap-kpa", "-1"]).contains("--young-cap-kpa must be a number of at least 0"));
    assert!(sentence(&["--direction", "0,0"]).contains("three finite numbers"));
}
