//! Other programs that tests start: compilers, and what they made. Tests inside the library use them too.

use std::process::{Command, Output};

/// Whether a program can be started at all.
fn exists(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok()
}

/// The first of the programs that exists. Without any, says so loudly, and fails under CI, where everything
/// is there.
pub fn need(programs: &[&'static str]) -> Option<&'static str> {
    let found = programs.iter().copied().find(|program| exists(program));
    if found.is_none() {
        assert!(std::env::var_os("CI").is_none(), "none of {programs:?} is here, and CI must have one");
        eprintln!("SKIPPED: none of {programs:?} is installed");
    }
    found
}

/// Runs a command and shows all it said when it fails.
pub fn run(command: &mut Command) -> Output {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(
        output.status.success(),
        "{command:?}\n{}\n{}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}
