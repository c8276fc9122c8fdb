//! The kernels' laws, compiled as plain C++, against their twins in Rust.
//!
//! A law answers in single precision, its twin in double precision to the same numbers: they differ by the law's own roundings.

mod efg;
mod laws;
#[path = "../../../tests/support/programs.rs"]
mod programs;
mod shapes;
mod vectors;

use std::ffi::OsStr;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use tempfile::TempDir;

/// What `count` roundings in a row do at most to a sum of terms whose magnitudes add up to `scale`.
fn rounded(count: u32, scale: f64) -> f64 {
    /// What one rounding does, relatively.
    const UNIT: f64 = f32::EPSILON as f64 / 2.0;
    let share = f64::from(count) * UNIT;
    share / (1.0 - share) * scale
}

/// A header of the kernels.
pub fn header(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("kernels").join(name);
    std::fs::read_to_string(path).expect("the kernels' headers are readable")
}

/// Compiles C++ that includes headers of the kernels. None, said loudly, where there is no compiler.
pub fn compile(source: &Path, how: &[&OsStr]) -> Option<()> {
    let compiler = programs::need(&["c++", "g++", "clang++"])?;
    let headers = Path::new(env!("CARGO_MANIFEST_DIR")).join("kernels");
    programs::run(
        Command::new(compiler)
            .args(["-std=c++17", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I"])
            .arg(headers)
            .arg(source)
            .args(how),
    );
    Some(())
}

/// What a law is asked, what it must answer, and how far from that each number may be.
struct Case<const N: usize> {
    input: Vec<f32>,
    expected: [f64; N],
    tolerance: [f64; N],
}

/// The compiled laws: tests/twins/laws.cpp.
struct Laws {
    dir: TempDir,
}

impl Laws {
    /// None, said loudly, where there is no compiler.
    fn compiled() -> Option<Self> {
        let laws = Self { dir: tempfile::tempdir().expect("a folder for the laws") };
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/twins/laws.cpp");
        compile(&source, &["-o".as_ref(), laws.program().as_os_str()])?;
        Some(laws)
    }

    fn program(&self) -> std::path::PathBuf {
        self.dir.path().join("laws")
    }

    /// The laws' result types and names.
    fn names(&self) -> Vec<String> {
        let output = programs::run(&mut Command::new(self.program()));
        String::from_utf8_lossy(&output.stdout).lines().map(String::from).collect()
    }

    /// What a law answers to each input.
    fn answers<'a, const N: usize>(
        &self,
        law: &str,
        inputs: impl IntoIterator<Item = &'a Vec<f32>>,
    ) -> Vec<[f32; N]> {
        let inputs: Vec<_> = inputs.into_iter().collect();
        let mut child = Command::new(self.program())
            .arg(law)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the laws start");
        let bytes: Vec<u8> = inputs.iter().copied().flatten().flat_map(|x| x.to_ne_bytes()).collect();
        // All is read before anything is answered. Dropping the pipe ends it.
        child.stdin.take().expect("a pipe").write_all(&bytes).expect("the laws read");
        let output = child.wait_with_output().expect("the laws end");
        assert!(output.status.success(), "{law}: {}", output.status);
        let (words, rest) = output.stdout.as_chunks();
        let numbers: Vec<_> = words.iter().map(|bytes| f32::from_ne_bytes(*bytes)).collect();
        let (answers, more) = numbers.as_chunks();
        assert!(
            answers.len() == inputs.len() && rest.is_empty() && more.is_empty(),
            "{law}: {} numbers for {} inputs",
            numbers.len(),
            inputs.len()
        );
        answers.to_vec()
    }

    /// Asks a law and compares.
    fn check<const N: usize>(&self, law: &str, cases: &[Case<N>]) {
        let answers = self.answers::<N>(law, cases.iter().map(|case| &case.input));
        for (case, answer) in cases.iter().zip(&answers) {
            let pairs = answer.iter().zip(case.expected).zip(case.tolerance);
            for (place, ((&found, expected), tolerance)) in pairs.enumerate() {
                let found = f64::from(found);
                // Infinities are equal or wrong.
                assert!(
                    found == expected || (found - expected).abs() <= tolerance,
                    "{law} of {:?}: number {place} is {found:e}, not {expected:e} within {tolerance:e}",
                    case.input
                );
            }
        }
    }
}

#[test]
fn every_law_of_the_kernels_has_an_answer_to_compare() {
    let Some(laws) = Laws::compiled() else { return };
    let headers = ["law.cuh", "contact.cuh", "efg.cuh"].map(header);
    let declared = headers.iter().flat_map(|header| header.lines()).filter_map(|line| {
        let (name, _) = line.strip_prefix("PLP_LAW ")?.split_once('(')?;
        Some(name)
    });
    assert_eq!(declared.collect::<Vec<_>>(), laws.names());
}
