//! Real C programs against the shipped library: the example, bad input, destruction in any order, threads,
//! and real-time calls.
#![cfg(unix)] // the programs use POSIX threads, and link flags are those of cc

mod support;

use std::path::{Path, PathBuf};
use std::process::Command;

use support::{LIBRARY, c_compiler, compile, compile_unlinked, install, root, run, scratch};

/// Builds and runs a program of tests/c and returns what it printed.
fn run_c(name: &str) -> Option<String> {
    let compiler = c_compiler()?;
    let dir = scratch(name);
    let program = compile(compiler, &root().join(format!("tests/c/{name}.c")), &dir);
    let output = run(Command::new(program).current_dir(&dir));
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[test]
fn bad_input_is_answered_with_a_status_and_a_sentence() {
    if let Some(said) = run_c("bad_input") {
        assert_eq!(said, "bad input: ok\n");
    }
}

#[test]
fn handles_may_be_destroyed_in_any_order() {
    if let Some(said) = run_c("destroy_order") {
        assert_eq!(said, "destroy order: ok\n");
    }
}

#[test]
fn ports_work_while_the_simulation_steps() {
    if let Some(said) = run_c("threads") {
        assert_eq!(said, "threads: ok\n");
    }
}

#[test]
fn a_block_is_cut_by_hand_and_with_a_blade() {
    if let Some(said) = run_c("cutting") {
        assert_eq!(said, "cutting: ok\n");
    }
}

#[test]
fn a_cut_block_becomes_what_it_was_at_a_snapshot() {
    if let Some(said) = run_c("snapshot") {
        assert_eq!(said, "snapshot: ok\n");
    }
}

#[test]
fn a_haptic_device_feels_the_tissue_and_nothing_else() {
    if let Some(said) = run_c("servo") {
        assert_eq!(said, "servo: ok\n");
    }
}

#[test]
fn every_backend_answers_and_the_processor_serves() {
    if let Some(said) = run_c("backends") {
        assert!(
            said.contains("\ncpu: cpu, device -1, CPU, 1 thread; \n") && said.ends_with("\nbackends: ok\n"),
            "{said}"
        );
    }
}

#[test]
#[cfg(all(target_os = "linux", target_env = "gnu"))] // replaces glibc's allocator functions
fn real_time_calls_allocate_nothing() {
    let Some(compiler) = c_compiler() else { return };
    let dir = scratch("rt_malloc");
    install(&dir);
    let program = compile_unlinked(compiler, &root().join("tests/c/rt_malloc.c"), &dir);
    run(Command::new(program).arg(dir.join(LIBRARY)));
}

/// The example's program, built as its README says.
fn example(dir: &Path) -> Option<PathBuf> {
    Some(compile(c_compiler()?, &root().join("examples/c/palpation.c"), dir))
}

#[test]
fn the_example_feels_more_force_the_deeper_it_presses() {
    let dir = scratch("palpation");
    let Some(program) = example(&dir) else { return };
    let output = run(Command::new(program).current_dir(&dir));
    let table = String::from_utf8_lossy(&output.stdout);
    for word in ["runs on           CPU", "nodes", "real-time factor", "peak force", "indentation"] {
        assert!(table.contains(word), "'{word}' is missing in\n{table}");
    }

    let csv = std::fs::read_to_string(dir.join("palpation.csv")).expect("the example writes a CSV");
    let mut lines = csv.lines();
    assert_eq!(lines.next(), Some("indentation_m,force_n"));
    let rows: Vec<(f64, f64)> = lines
        .map(|line| {
            let (depth, force) = line.split_once(',').expect("two columns");
            (depth.parse().expect("a number"), force.parse().expect("a number"))
        })
        .collect();
    assert!(rows.len() >= 50, "{} rows", rows.len());
    assert!(rows.iter().all(|(_, force)| force.is_finite()));
    let mean = |range: std::ops::Range<usize>| {
        rows[range.clone()].iter().map(|(_, force)| force).sum::<f64>() / range.len() as f64
    };
    let (early, late) = (mean(0..rows.len() / 4), mean(rows.len() * 3 / 4..rows.len()));
    assert!(late > 1.5 * early && late > 0.01, "from {early} N to {late} N");
}

#[test]
fn the_example_is_short_and_uses_only_the_header() {
    let source = std::fs::read_to_string(root().join("examples/c/palpation.c")).expect("the example");
    assert!(source.lines().count() < 100);
    let includes: Vec<_> = source.lines().filter_map(|line| line.strip_prefix("#include ")).collect();
    assert!(includes.iter().all(|name| name.starts_with('<')), "{includes:?}");
}
