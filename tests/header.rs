//! The committed header is what the sources say, keeps its promises about tags, and compiles as C and as C++.

mod support;

use std::path::PathBuf;
use std::process::Command;

use support::{assert_same_as_file, need, root, run, scratch};

const HEADER: &str = "include/palpate/palpate.h";

/// The files of the C ABI in the order in which a reader should meet them.
const SOURCES: [&str; 22] = [
    "version",
    "status",
    "types/mod",
    "types/model",
    "types/device",
    "types/sim",
    "types/drive",
    "types/servo",
    "types/cut",
    "types/tool",
    "types/surface",
    "preset",
    "model",
    "device",
    "sim",
    "drive",
    "change",
    "cut",
    "snapshot",
    "statistics",
    "tool",
    "surface",
];

fn header() -> String {
    std::fs::read_to_string(root().join(HEADER)).expect("the header is committed")
}

/// Each function of the header with its comment.
fn functions() -> Vec<(String, String)> {
    let header = header();
    let start = header.find("extern \"C\" {").expect("functions are extern \"C\"");
    let end = header.find("/* ---- Helpers").expect("the helpers have a heading");
    let mut found = Vec::new();
    let mut comment = String::new();
    let mut declaration = String::new();
    for line in header[start..end].lines() {
        if let Some(text) = line.strip_prefix("///") {
            comment.push_str(text);
            comment.push('\n');
            continue;
        }
        declaration.push_str(line);
        if line.is_empty() || line.starts_with('#') || line.starts_with("typedef") {
            declaration.clear();
            comment.clear();
        } else if line.ends_with(");") {
            let before = declaration.split('(').next().unwrap_or_default();
            let name = before.split([' ', '*']).next_back().unwrap_or_default();
            found.push((name.to_owned(), std::mem::take(&mut comment)));
            declaration.clear();
        }
    }
    found
}

#[test]
fn the_header_is_what_the_sources_say() {
    let config = cbindgen::Config::from_file(root().join("cbindgen.toml")).expect("cbindgen.toml is valid");
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in SOURCES {
        builder = builder.with_src(root().join(format!("src/capi/{source}.rs")));
    }
    let mut text = Vec::new();
    builder.generate().expect("the C ABI can be read").write(&mut text);
    assert_same_as_file(HEADER, &String::from_utf8(text).expect("the header is UTF-8"));
}

#[test]
fn every_function_says_which_thread_may_call_it() {
    let functions = functions();
    assert!(functions.len() > 30, "only {} functions were found", functions.len());
    for (name, comment) in functions {
        let tags: Vec<_> = comment.match_indices("@thread ").map(|(at, _)| &comment[at + 8..]).collect();
        assert_eq!(tags.len(), 1, "{name} has {} @thread tags", tags.len());
        let word = tags[0].split_whitespace().next().unwrap_or_default();
        assert!(["any", "owner", "port"].contains(&word), "{name} has @thread {word}");
    }
}

#[test]
fn every_real_time_function_is_proved_to_allocate_nothing() {
    let program = std::fs::read_to_string(root().join("tests/c/rt_malloc.c")).expect("rt_malloc.c is there");
    let real_time: Vec<_> = functions().into_iter().filter(|(_, text)| text.contains(" @rt\n")).collect();
    assert!(!real_time.is_empty());
    for (name, _) in real_time {
        assert!(program.contains(&format!("FIND({name})")), "{name} is @rt but not in tests/c/rt_malloc.c");
    }
}

#[test]
fn the_header_compiles_as_c11_and_cpp17() {
    let languages: [(&[&'static str], &str, &str); 4] = [
        (&["gcc", "cc"], "c11", "c"),
        (&["g++", "c++"], "c++17", "cpp"),
        (&["clang"], "c11", "c"),
        (&["clang++"], "c++17", "cpp"),
    ];
    let dir = scratch("header");
    for (compilers, standard, extension) in languages {
        let is_optional = compilers[0].starts_with("clang");
        let found = if is_optional {
            compilers.iter().copied().find(|c| Command::new(c).arg("--version").output().is_ok())
        } else {
            need(compilers)
        };
        let Some(compiler) = found else { continue };
        // Alone, so that nothing else could have included what it needs; every helper is used.
        let source: PathBuf = dir.join(format!("header.{extension}"));
        std::fs::write(&source, USES_EVERY_HELPER).expect("the source can be written");
        run(Command::new(compiler)
            .args(["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-fsyntax-only"])
            .arg(format!("-std={standard}"))
            .arg("-I")
            .arg(root().join("include"))
            .arg(&source));
    }
}

const USES_EVERY_HELPER: &str = r#"
#include <palpate/palpate.h>
#include <palpate/palpate.h>

int uses_every_helper(void);
int uses_every_helper(void) {
    plp_model_desc model = plp_model_desc_default();
    plp_sim_desc sim = plp_sim_desc_default();
    plp_tool_desc tool = plp_tool_desc_default();
    plp_load load = plp_load_default();
    plp_pose pose = plp_pose_at(0.0, 0.0, 0.0);
    plp_motion motion = plp_motion_at(0.0, 0.0, 0.0);
    plp_tool_part parts[2] = {plp_capsule(0.01, 0.1), plp_rounded_box(0.1, 0.1, 0.1, 0.01)};
    plp_label_use use = plp_label_as(1, PLP_USE_TISSUE, "lung");
    tool.parts = parts;
    return plp_check_abi() == PLP_OK && model.struct_size && sim.struct_size && load.kind && use.label &&
           pose.rotation[3] > 0.0 && motion.pose.rotation[3] > 0.0 && tool.part_count;
}
"#;
