//! The servo bridge for OpenHaptics on the emulated HDAPI: the emulator's own rules, what the bridge does with good and
//! with failing devices, and the example.
#![cfg(unix)] // link flags are those of c++

mod support;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use support::{c_compiler, compiler_command, cpp_compiler, install, root, run, scratch};

const FOLDER: &str = "bindings/haptics";

/// The C++ files of a folder of the repository.
fn sources(folder: &str) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(root().join(folder))
        .expect("the folder is there")
        .map(|entry| entry.expect("it can be listed").path())
        .filter(|path| path.extension().is_some_and(|name| name == "cpp"))
        .collect();
    files.sort();
    files
}

fn includes(command: &mut Command) -> &mut Command {
    for folder in [FOLDER, "bindings/haptics/emulator", "tests/c", "tests/haptics"] {
        command.arg("-I").arg(root().join(folder));
    }
    command
}

/// The folder with the library, the emulator in the place of the SDK's library, and the bridge; built once. None without a
/// C++ compiler.
fn libraries() -> Option<&'static Path> {
    static BUILT: OnceLock<Option<PathBuf>> = OnceLock::new();
    BUILT
        .get_or_init(|| {
            let compiler = cpp_compiler()?;
            let dir = scratch("haptics");
            install(&dir);
            for (name, folder, needs) in [
                ("libHD.so", "bindings/haptics/emulator", &["-lpthread"] as &[&str]),
                ("libpalpate_hdapi.so", FOLDER, &["-lHD", "-lpalpate", "-lpthread"]),
            ] {
                run(includes(&mut compiler_command(compiler, "c++17", &dir))
                    .args(["-shared", "-fPIC"])
                    .args(sources(folder))
                    .arg("-o")
                    .arg(dir.join(name))
                    .args(needs));
            }
            Some(dir)
        })
        .as_deref()
}

/// Compiles a program, in C or C++ by its name, against them.
fn compile(source: &str) -> Option<PathBuf> {
    let dir = libraries()?;
    let source = root().join(source);
    let program = dir.join(source.file_stem().expect("a source has a name"));
    let (compiler, standard) = match source.extension() {
        Some(name) if name == "c" => (c_compiler()?, "c11"),
        _ => (cpp_compiler()?, "c++17"),
    };
    run(includes(&mut compiler_command(compiler, standard, dir)).arg(source).arg("-o").arg(&program).args([
        "-lpalpate_hdapi",
        "-lHD",
        "-lpalpate",
        "-lpthread",
        "-lm",
    ]));
    Some(program)
}

/// Runs a program of tests/haptics, which prints what it found right.
fn check(name: &str, claim: &str) {
    let Some(program) = compile(&format!("tests/haptics/{name}.cpp")) else { return };
    let dir = scratch(&format!("haptics_{name}"));
    let output = run(Command::new(program).current_dir(dir));
    assert_eq!(String::from_utf8_lossy(&output.stdout), format!("{claim}: ok\n"));
}

#[test]
fn the_emulator_keeps_the_rules_of_frames_errors_and_callbacks() {
    check("emulator_rules", "emulator rules");
}

#[test]
fn the_emulated_hand_moves_as_its_mass_spring_and_friction_say() {
    check("emulator_hand", "emulator hand");
}

#[test]
fn the_bridge_maps_places_forces_and_torques_so_that_work_is_kept() {
    check("bridge_mapping", "bridge mapping");
}

#[test]
fn a_failing_device_or_simulation_stops_the_force_and_not_the_program() {
    check("bridge_faults", "bridge faults");
}

#[test]
fn ports_close_in_any_order_under_running_servos() {
    check("bridge_threads", "bridge threads");
}

#[test]
#[cfg(all(target_os = "linux", target_env = "gnu"))] // replaces glibc's allocator functions
fn a_tick_allocates_nothing() {
    check("no_allocation", "no allocation");
}
