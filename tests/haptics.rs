//! The servo bridge for OpenHaptics on the emulated HDAPI: the emulator's own rules, what the bridge does with good and
//! with failing devices, and the example.
#![cfg(unix)] // link flags are those of c++

mod support;

#[allow(dead_code)]
#[path = "../examples/haptics_plot/main.rs"]
mod haptics_plot;

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
    run(includes(&mut compiler_command(compiler, standard, dir))
        .arg("-DPALPATE_HD_EMULATOR")
        .arg(source)
        .arg("-o")
        .arg(&program)
        .args(["-lpalpate_hdapi", "-lHD", "-lpalpate", "-lpthread", "-lm"]));
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
fn under_the_librarys_own_thread_faults_take_the_force_away_and_hang_nobody() {
    check("bridge_driver", "bridge driver");
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

/// Runs the example, and returns what it printed and its record.
fn example(name: &str, arguments: &[&str]) -> Option<(String, String)> {
    static BUILT: OnceLock<Option<PathBuf>> = OnceLock::new();
    let program = BUILT.get_or_init(|| compile("examples/haptics/main.cpp")).as_ref()?;
    let dir = scratch(&format!("haptics_{name}"));
    let output = run(Command::new(program).args(arguments).current_dir(&dir));
    let record = std::fs::read_to_string(dir.join("haptics.csv")).expect("the example writes a record");
    Some((String::from_utf8_lossy(&output.stdout).into_owned(), record))
}

/// The columns of a record that are numbers, by name.
fn column(record: &str, name: &str) -> Vec<f64> {
    let mut lines = record.lines();
    let at =
        lines.next().and_then(|names| names.split(',').position(|n| n == name)).expect("the column is there");
    lines.map(|line| line.split(',').nth(at).and_then(|x| x.parse().ok()).expect("a number")).collect()
}

#[test]
fn the_example_lets_a_hand_feel_the_chest_the_same_way_each_time() {
    let press = ["--virtual", "--seconds", "1.8"];
    let Some((report, record)) = example("example", &press) else { return };
    for word in [
        "presses              skin",
        "driver               virtual time",
        "servo period",
        "p99.9",
        "misses",
        "longest run",
        "force age",
        "pose to force        p50 1.0",
        "without valid force  0 ticks",
        "fresh forces",
        "least energy",
        "peak force",
        "real-time factor",
        "let go",
        "faults               none\n",
    ] {
        assert!(report.contains(word), "'{word}' is missing in\n{report}");
    }

    let (time, force) = (column(&record, "time_s"), column(&record, "device_z_n"));
    assert_eq!(time.len(), 1800);
    assert!(force.iter().all(|n| n.is_finite() && n.abs() <= 3.3));
    // Free before the skin, pushed back towards the user when pressed.
    assert!(force[..800].iter().all(|&n| n == 0.0), "{:?}", &force[..800]);
    assert!(force[1700] > 0.5, "{} N", force[1700]);
    assert!(column(&record, "age_s").iter().all(|&s| s < 0.01));

    let (_, again) = example("example_again", &press).expect("it ran before");
    assert!(record == again, "the second run differs");

    // What was recorded can be looked at.
    let dir = scratch("haptics_plot");
    std::fs::write(dir.join("press.csv"), &record).expect("the record can be written");
    haptics_plot::run(&dir.join("press.csv"), &dir.join("press.png")).expect("the plot");
    let picture = tiny_skia::Pixmap::load_png(dir.join("press.png")).expect("a picture");
    assert_eq!((picture.width(), picture.height()), haptics_plot::SIZE);
    let is_colour = |p: &tiny_skia::PremultipliedColorU8| p.red().abs_diff(p.blue()) > 40;
    let coloured = picture.pixels().iter().filter(|p| is_colour(p)).count();
    assert!(coloured > 5000, "{coloured} pixels of lines and flags");
    std::fs::write(dir.join("bad.csv"), "time_s,x_m\n0,0\n").expect("it can be written");
    let why = haptics_plot::run(&dir.join("bad.csv"), &dir.join("bad.png")).expect_err("it is no record");
    assert!(why.to_string().contains("no column"), "{why}");
}

#[test]
fn the_example_keeps_a_record_in_real_time_whoever_steps() {
    for (drive, words) in [("thread", "the simulation's own"), ("host", "a thread of this program")] {
        let arguments = ["--seconds", "1", "--drive", drive];
        let Some((report, record)) = example(&format!("example_{drive}"), &arguments) else { return };
        assert!(report.contains(words) && report.contains("period histogram\n"), "{report}");
        assert!(report.contains("without valid force  0 ticks\n"), "{report}");
        let time = column(&record, "time_s");
        assert!(!time.is_empty() && time.windows(2).all(|pair| pair[1] > pair[0]));
        assert!(column(&record, "sequence").last().is_some_and(|&steps| steps > 0.0));
    }
}

#[test]
fn a_servo_callback_is_fifteen_lines_of_c() {
    let source = std::fs::read_to_string(root().join("examples/haptics/minimal.c")).expect("the example");
    let body = source.split("servo(void *user) {\n").nth(1).and_then(|rest| rest.split("\n}").next());
    let lines = body.expect("the callback").lines().count() + 2; // its head and its end
    assert!(lines <= 15, "{lines} lines");
    let Some(program) = compile("examples/haptics/minimal.c") else { return };
    let output = run(Command::new(program).current_dir(scratch("haptics_minimal")));
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("peak force "));
}

#[test]
fn only_one_file_of_the_binding_knows_the_platform() {
    for folder in [FOLDER, "bindings/haptics/emulator"] {
        for path in sources(folder) {
            let text = std::fs::read_to_string(&path).expect("a source");
            let knows = ["<unistd.h>", "<pthread.h>", "<time.h>", "<sys/", "__linux__"]
                .iter()
                .any(|word| text.contains(word));
            assert_eq!(knows, path.ends_with("clock.cpp"), "{}", path.display());
            assert!(text.lines().count() <= 700, "{}", path.display());
        }
    }
}
