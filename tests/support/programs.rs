//! Other programs that tests start: compilers, and what they made. Tests inside the library use them too.

use std::io::Read;
use std::process::{Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

/// What runs longer than this hangs: no program of a test needs minutes.
const HANGS: Duration = Duration::from_secs(600);

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

/// Runs a command and shows all it said when it fails, or hangs and is killed.
pub fn run(command: &mut Command) -> Output {
    let started = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut child = started.unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let (stdout, stderr) = (gather(child.stdout.take()), gather(child.stderr.take()));
    let begun = Instant::now();
    let ended: Option<ExitStatus> = loop {
        match child.try_wait().expect("a child can be asked") {
            None if begun.elapsed() < HANGS => std::thread::sleep(Duration::from_millis(2)),
            None => {
                child.kill().expect("a child can be killed");
                child.wait().expect("a killed child ends");
                break None;
            }
            ended => break ended,
        }
    };
    let [stdout, stderr] = [stdout, stderr].map(|thread| thread.join().expect("it only reads"));
    let said = format!("{}{}", String::from_utf8_lossy(&stdout), String::from_utf8_lossy(&stderr));
    let status = ended.unwrap_or_else(|| panic!("{command:?} hangs, and said\n{said}"));
    assert!(status.success(), "{command:?}\n{status}\n{said}");
    Output { status, stdout, stderr }
}

/// Reads all that a program says, beside it, so that no full pipe holds it up.
fn gather(pipe: Option<impl Read + Send + 'static>) -> std::thread::JoinHandle<Vec<u8>> {
    std::thread::spawn(move || {
        let mut said = Vec::new();
        if let Some(mut pipe) = pipe {
            pipe.read_to_end(&mut said).expect("a pipe can be read");
        }
        said
    })
}
