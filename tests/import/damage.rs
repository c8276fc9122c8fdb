//! Damaged files: no panic, and no more memory than a file of that length could hold.

use palpate::model::import::{read_intensities, read_labels, read_mesh};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

use crate::files::{Scratch, gzip};
use crate::memory::peak_of;
use crate::meshes::{TETRAHEDRON_OBJ, binary_ply, binary_stl, text_ply, text_stl};
use crate::nifti::{Nifti, bytes_0_to, oblique};
use crate::nrrd::{nrrd, nrrd_header};

/// One file of each kind, all valid.
fn valid_files() -> Vec<(&'static str, Vec<u8>)> {
    let nifti = Nifti::new([2, 3, 4], Nifti::UINT8).sform(&oblique()).with(&bytes_0_to(24));
    let short = "type: ushort\nendian: little\nencoding: gzip";
    let little: Vec<u8> = (0..24_u16).flat_map(u16::to_le_bytes).collect();
    let text: String = (0..24).map(|n| format!("{n} ")).collect();
    vec![
        ("nii", nifti.clone()),
        ("nii.gz", gzip(&nifti)),
        ("nrrd", nrrd(&nrrd_header(&oblique(), "LPS", [-1.0, -1.0, 1.0], short), &gzip(&little))),
        (
            "nrrd",
            nrrd("type: int\ndimension: 3\nsizes: 2 3 4\nspacings: 1 1 1\nencoding: text", text.as_bytes()),
        ),
        ("obj", TETRAHEDRON_OBJ.as_bytes().to_vec()),
        ("stl", binary_stl(b"")),
        ("stl", text_stl().into_bytes()),
        ("ply", text_ply().into_bytes()),
        ("ply", binary_ply(false)),
        ("ply", binary_ply(true)),
    ]
}

/// Reads a file of any kind; the answer does not matter, that there is one does.
fn read_any(extension: &str, bytes: &[u8]) -> bool {
    let file = Scratch::new(extension, bytes);
    match extension {
        "obj" | "stl" | "ply" => read_mesh(&file, 1.0).is_ok(),
        _ => {
            let labels = read_labels(&file).is_ok();
            read_intensities(&file).is_ok() || labels
        }
    }
}

#[test]
fn damaged_files_never_panic_and_allocate_no_more_than_they_could_hold() {
    let files = valid_files();
    assert!(files.iter().all(|(extension, bytes)| read_any(extension, bytes)));

    let edit = (
        any::<prop::sample::Index>(),
        prop_oneof![any::<u8>(), Just(b'-'), Just(b'9'), Just(b' '), Just(0xff)],
    );
    let damage = (
        0..files.len(),
        prop::collection::vec(edit, 0..8),
        prop::option::of(any::<prop::sample::Index>()),
        prop::option::of((any::<prop::sample::Index>(), any::<prop::sample::Index>())),
    );
    let config = Config { cases: 4000, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    runner
        .run(&damage, |(which, edits, cut, swap)| {
            let (extension, mut bytes) = files[which].clone();
            for (place, value) in edits {
                let place = place.index(bytes.len());
                bytes[place] = value;
            }
            if let Some((a, b)) = swap {
                // A piece repeated elsewhere keeps the words of a text valid and its structure not.
                let (a, b) = (a.index(bytes.len()), b.index(bytes.len()));
                let piece = bytes[a.min(b)..a.max(b)].to_vec();
                bytes.splice(a..a, piece);
            }
            if let Some(cut) = cut {
                bytes.truncate(cut.index(bytes.len() + 1));
            }
            let size = bytes.len() as isize;
            let peak = peak_of(|| {
                read_any(extension, &bytes);
            });
            // Two bytes for each byte that deflate can make of one, three buffers, and the list that PLY
            // prepares.
            let most = 8 * 1032 * size + (2 << 20);
            prop_assert!(peak <= most, "{peak} bytes for a {extension} file of {size}");
            Ok(())
        })
        .unwrap();
}

#[test]
fn every_truncation_of_every_file_is_refused_or_loses_only_blank_space() {
    for (extension, bytes) in valid_files() {
        for length in 0..bytes.len() {
            let (kept, lost) = bytes.split_at(length);
            // OBJ has no end mark, and a text STL may end after any solid: what stands before the cut is a
            // file of its own.
            let last_line = kept.trim_ascii_end().rsplit(|&b| b == b'\n').next().unwrap_or_default();
            let is_whole = match extension {
                "obj" => true,
                "stl" => last_line.trim_ascii().starts_with(b"endsolid"),
                // The last number of a text may lose a digit.
                "nrrd" => lost.len() < 3,
                _ => false,
            };
            assert!(
                is_whole || lost.trim_ascii().is_empty() || !read_any(extension, kept),
                "{extension} cut to {length} of {} bytes was accepted",
                bytes.len()
            );
        }
    }
}

#[test]
fn noise_is_refused() {
    let config = Config { cases: 1000, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let starts = ["", "NRRD0005\n", "\u{1f}", "ply\n", "solid ", "v "];
    let noise = (0..starts.len(), prop::collection::vec(any::<u8>(), 0..600), 0..5_usize);
    runner
        .run(&noise, |(start, noise, extension)| {
            let bytes = [starts[start].as_bytes(), &noise].concat();
            let extension = ["nii", "nrrd", "obj", "stl", "ply"][extension];
            prop_assert!(!read_any(extension, &bytes));
            Ok(())
        })
        .unwrap();
}
