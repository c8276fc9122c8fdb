//! A real scan and its labels, where `PALPATE_DATA` names the folder that holds them.

use std::path::{Path, PathBuf};

use nalgebra::{Point3, Vector3};
use palpate::model::grid::{LabelGrid, ResampleRule};
use palpate::model::import::{read_intensities, read_labels};

/// A file of the test data, or nothing and a loud word about it. A build server must have the data.
fn real_file(name: &str) -> Option<PathBuf> {
    match std::env::var_os("PALPATE_DATA") {
        Some(folder) => Some(Path::new(&folder).join(name)),
        None => {
            assert!(
                std::env::var_os("CI").is_none(),
                "PALPATE_DATA must name the folder of test data under CI"
            );
            eprintln!("\n==== SKIPPED: {name} is not read, because PALPATE_DATA names no folder ====\n");
            None
        }
    }
}

fn histogram(grid: &LabelGrid) -> Vec<usize> {
    let mut counts = vec![0; 11];
    grid.labels().iter().for_each(|&l| counts[usize::from(l)] += 1);
    counts
}

#[test]
fn real_labels_have_the_documented_counts() {
    let Some(path) = real_file("thorax_labels.nii.gz") else { return };
    let grid = read_labels(path).unwrap();

    assert_eq!(grid.dims(), [120, 126, 164]);
    assert!((grid.spacing() - Vector3::repeat(1.5e-3)).norm() < 1e-12);
    let documented =
        [102_424, 793_934, 34_358, 8_742, 726_932, 242_936, 310_511, 72_810, 7_113, 122_763, 57_157];
    assert_eq!(histogram(&grid), documented);
    assert_eq!(grid.resample(1.5e-3, ResampleRule::Majority).unwrap().labels(), grid.labels());

    // Without 0 and 3, taking every second voxel.
    let coarse = grid.resample(3e-3, ResampleRule::Nearest).unwrap();
    let counts = histogram(&coarse);
    assert_eq!(coarse.labels().len() - counts[0] - counts[3], 295_903);
    assert_eq!(counts[1] + counts[2] + counts[8], 104_496);
}

#[test]
fn real_anatomy_stands_upright_in_ras() {
    let Some(path) = real_file("thorax_labels.nii.gz") else { return };
    let grid = read_labels(path).unwrap();
    // The mean place of a label: bone is mostly spine, so it lies behind the heart; the spleen is on the
    // left, below the heart.
    let mean = |label: u16| {
        let [nx, ny, _] = grid.dims();
        let places = grid.labels().iter().enumerate().filter(|&(_, &l)| l == label).map(|(n, _)| n);
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for n in places {
            sum += Vector3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64);
            count += 1.0;
        }
        (grid.frame() * Point3::from((sum / count).component_mul(&grid.spacing()))).coords
    };
    let (heart, bone, spleen) = (mean(5), mean(9), mean(10));
    assert!(bone.y < heart.y, "the spine must lie behind the heart");
    assert!(spleen.z < heart.z, "the spleen must lie below the heart");
}

#[test]
fn real_scan_is_in_hounsfield_units() {
    let (Some(scan), Some(labels)) = (real_file("thorax_ct.nii.gz"), real_file("thorax_labels.nii.gz"))
    else {
        return;
    };
    let (scan, labels) = (read_intensities(scan).unwrap(), read_labels(labels).unwrap());
    assert_eq!((scan.dims(), scan.frame()), (labels.dims(), labels.frame()));
    let mean = |label: u16| {
        let inside = scan.values().iter().zip(labels.labels()).filter(|&(_, &l)| l == label);
        let (sum, count) = inside.fold((0.0, 0.0), |(s, n), (&v, _)| (s + f64::from(v), n + 1.0));
        sum / count
    };
    assert!((-950.0..-650.0).contains(&mean(1)), "lung {}", mean(1));
    assert!((-130.0..-50.0).contains(&mean(6)), "fat {}", mean(6));
    assert!((-1010.0..-930.0).contains(&mean(3)), "air {}", mean(3));
    assert!(mean(9) > 150.0, "bone {}", mean(9));
}
