//! The torus example does what it promises, on a coarse case.

#[allow(dead_code)]
#[path = "../examples/torus/main.rs"]
mod torus;

use clap::Parser;
use tiny_skia::Pixmap;

#[test]
fn a_torus_hangs_still_and_is_drawn() {
    let dir = tempfile::tempdir().unwrap();
    let options = |young_kpa: &str| {
        let out = dir.path().to_str().unwrap();
        torus::Options::try_parse_from(["torus", "--cell-mm", "8", "--young-kpa", young_kpa, "--out", out])
            .unwrap()
    };
    let hung = torus::run(&options("8")).unwrap();
    // A bar as long as what hangs, 0.126 m, would grow by ρ g L² / 2 E; a ring bends besides.
    let bar_m = 1000.0 * 9.81 * 0.126_f64.powi(2) / (2.0 * 8e3);
    assert!((bar_m..3.0 * bar_m).contains(&hung.sag_m), "{} m", hung.sag_m);
    assert!(hung.speed_m_s < 1e-3, "it rests: {} m/s", hung.speed_m_s);
    let picture = Pixmap::load_png(dir.path().join("torus.png")).unwrap();
    assert_eq!([picture.width() as usize, picture.height() as usize], torus::SIZE);
    let colours: std::collections::BTreeSet<_> =
        picture.pixels().iter().map(|p| [p.red(), p.green(), p.blue()]).collect();
    assert!(colours.len() > 2000, "{} colours", colours.len());

    // Twice as stiff it sinks about half as far.
    let stiffer = torus::run(&options("16")).unwrap();
    assert!((0.4..0.6).contains(&(stiffer.sag_m / hung.sag_m)), "{} m", stiffer.sag_m);
}
