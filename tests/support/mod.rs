//! What tests of the C ABI share: the shipped library, a C compiler, and a loud way to skip.
#![allow(dead_code)] // each test binary uses a part

mod programs;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

pub use programs::{need, run};

/// The repository's root.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The folder of the shared library that cargo built together with this test.
///
/// Test binaries and the library of the same build lie in `target/<profile>/deps`; the copy one folder up is
/// only renewed by `cargo build` and may be old.
pub fn library_dir() -> PathBuf {
    let test = std::env::current_exe().expect("a test knows its own path");
    let dir = test.parent().expect("a test lies in a folder").to_owned();
    assert!(dir.join(LIBRARY).exists(), "{LIBRARY} is not in {}", dir.display());
    dir
}

/// The shared library's file name.
pub const LIBRARY: &str = if cfg!(windows) {
    "palpate.dll"
} else if cfg!(target_os = "macos") {
    "libpalpate.dylib"
} else {
    "libpalpate.so"
};

/// A folder of this test's own, emptied.
pub fn scratch(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&dir);
    std::fs::create_dir_all(&dir).expect("the scratch folder can be made");
    dir
}

/// A C compiler.
pub fn c_compiler() -> Option<&'static str> {
    need(&["cc", "gcc", "clang"])
}

/// A C++ compiler.
pub fn cpp_compiler() -> Option<&'static str> {
    need(&["c++", "g++", "clang++"])
}

/// Compiles a C program into `dir`, linked against the shipped library, and returns its path.
pub fn compile(compiler: &str, source: &Path, dir: &Path) -> PathBuf {
    install(dir);
    compile_with(compiler, source, dir, &["-lpalpate".as_ref()])
}

/// Compiles a C program that loads the library itself.
pub fn compile_unlinked(compiler: &str, source: &Path, dir: &Path) -> PathBuf {
    compile_with(compiler, source, dir, &[])
}

/// Puts the shipped library into `dir`, under the names that linkers and programs look for, as installing
/// does.
pub fn install(dir: &Path) {
    let library = library_dir().join(LIBRARY);
    let abi = palpate::capi::version::PLP_ABI_VERSION;
    for name in [LIBRARY.to_owned(), format!("libpalpate.so.{abi}"), format!("libpalpate.{abi}.dylib")] {
        std::fs::copy(&library, dir.join(&name)).expect("the library can be copied");
    }
}

fn compile_with(compiler: &str, source: &Path, dir: &Path, link: &[&OsStr]) -> PathBuf {
    let program = dir.join(source.file_stem().expect("a source has a name"));
    run(compiler_command(compiler, "c11", dir)
        .arg("-I")
        .arg(root().join("tests/c"))
        .arg(source)
        .arg("-o")
        .arg(&program)
        .args(link)
        .args(["-lpthread", "-ldl", "-lm"]));
    program
}

/// A compiler that finds the header, warns about everything, and takes no warning. What it makes looks for libraries in
/// `dir`.
pub fn compiler_command(compiler: &str, standard: &str, dir: &Path) -> Command {
    let mut rpath = std::ffi::OsString::from("-Wl,-rpath,");
    rpath.push(dir);
    let mut command = Command::new(compiler);
    command
        .arg(format!("-std={standard}"))
        .args(["-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror"])
        .arg("-I")
        .arg(root().join("include"))
        .arg("-L")
        .arg(dir)
        .arg(rpath);
    command
}

/// Compares text with a file of the repository, or writes the file when `PALPATE_BLESS` is set.
pub fn assert_same_as_file(path: impl AsRef<OsStr>, text: &str) {
    let path = root().join(Path::new(path.as_ref()));
    if std::env::var_os("PALPATE_BLESS").is_some() {
        std::fs::write(&path, text).expect("the file can be written");
        return;
    }
    // A checkout may have made line ends its own.
    let kept = std::fs::read_to_string(&path).unwrap_or_default().replace("\r\n", "\n");
    let different = kept.lines().zip(text.lines()).position(|(a, b)| a != b);
    assert!(
        kept == text,
        "{} is out of date, first at line {}; `PALPATE_BLESS=1 cargo test` rewrites it. Look at the difference: it is an ABI.",
        path.display(),
        different.unwrap_or_else(|| kept.lines().count().min(text.lines().count())) + 1,
    );
}
