//! Finds the kernels' images: those that lie in `prebuilt` beside their sources, checked against these, or, with the feature
//! `build-kernels`, fresh ones from nvcc.

use std::env;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest, Sha256};

/// Source files that each become one image.
const IMAGES: [&str; 4] = ["lattice", "contact", "surface", "report"];
/// What they include.
const HEADERS: [&str; 3] = ["contact.cuh", "law.cuh", "layout.cuh"];
/// Sources in one folder that are compiled, checked and kept together.
struct Set {
    folder: &'static str,
    images: &'static [&'static str],
    headers: &'static [&'static str],
    /// The variable that tells the compiler where the images are.
    variable: &'static str,
}
/// The library's kernels, and those that the bench compares them with: no library holds these.
const SETS: [Set; 2] = [
    Set { folder: "kernels", images: &IMAGES, headers: &HEADERS, variable: "PALPATE_KERNELS" },
    Set { folder: "benches/lattice", images: &["baseline"], headers: &[], variable: "PALPATE_BASELINE" },
];
/// The compiler that made the images in `prebuilt`.
const NVCC: &str = "13.0.88";
/// Machine code for common GPUs, and PTX that newer ones compile for themselves. Approximate roots and quotients, and denormal
/// numbers as zero: a displacement that small is none.
const FLAGS: [&str; 13] = [
    "-fatbin",
    "-Xfatbin=-compress-all",
    "-std=c++17",
    "-O3",
    "-ftz=true",
    "-prec-div=false",
    "-prec-sqrt=false",
    "-gencode=arch=compute_75,code=compute_75",
    "-gencode=arch=compute_80,code=sm_80",
    "-gencode=arch=compute_86,code=sm_86",
    "-gencode=arch=compute_89,code=sm_89",
    "-gencode=arch=compute_90,code=sm_90",
    "-gencode=arch=compute_120,code=sm_120",
];

impl Set {
    fn path(&self) -> PathBuf {
        Path::new(&env::var("CARGO_MANIFEST_DIR").expect("cargo sets it")).join(self.folder)
    }

    /// Names of all source files.
    fn files(&self) -> impl Iterator<Item = String> {
        let images = self.images.iter().map(|image| format!("{image}.cu"));
        images.chain(self.headers.iter().map(|name| (*name).to_owned()))
    }
}

/// Tells the compiler where the images are.
pub fn provide() {
    SETS.iter().for_each(provide_set);
}

fn provide_set(set: &Set) {
    let Set { folder, images, variable, .. } = set;
    for file in set.files().chain(["prebuilt".into()]) {
        println!("cargo:rerun-if-changed={folder}/{file}");
    }
    let prebuilt = set.path().join("prebuilt");
    let digest = digest(set);
    let found = if env::var_os("CARGO_FEATURE_BUILD_KERNELS").is_some() {
        let fresh = PathBuf::from(env::var("OUT_DIR").expect("cargo sets it"));
        images.iter().for_each(|image| compile(&set.path(), image, &fresh));
        println!("cargo:rerun-if-env-changed=PALPATE_KEEP_KERNELS");
        if env::var_os("PALPATE_KEEP_KERNELS").is_some() {
            keep(images, &fresh, &prebuilt, &digest);
        }
        fresh
    } else {
        let made_of = fs::read_to_string(prebuilt.join("SOURCES.sha256")).unwrap_or_default();
        assert!(
            made_of.trim() == digest,
            "{folder}/prebuilt was made from other sources than {folder} holds now. With nvcc {NVCC} in reach, make it again by\n    \
             PALPATE_KEEP_KERNELS=1 cargo build --features build-kernels"
        );
        prebuilt
    };
    println!("cargo:rustc-env={variable}={}", found.display());
}

/// Of everything that the images depend on.
fn digest(set: &Set) -> String {
    let mut hash = Sha256::new();
    hash.update(NVCC);
    for flag in FLAGS {
        hash.update(flag);
    }
    for name in set.files() {
        let text = fs::read_to_string(set.path().join(&name)).expect("the kernels' sources are readable");
        hash.update(name);
        // A checkout may have changed the line ends.
        hash.update(text.replace('\r', ""));
    }
    hash.finalize().iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("a string takes all");
        text
    })
}

/// Compiles one source file.
fn compile(sources: &Path, image: &str, to: &Path) {
    let nvcc = nvcc();
    let status = Command::new(&nvcc)
        .current_dir(sources)
        .args(FLAGS)
        .arg(format!("{image}.cu"))
        .arg("-o")
        .arg(to.join(format!("{image}.fatbin")))
        .status();
    match status {
        Ok(status) if status.success() => {}
        Ok(status) => panic!("{} could not compile {image}.cu: {status}", nvcc.display()),
        Err(error) => {
            panic!("{} could not be started: {error}; set PALPATE_NVCC to nvcc's path", nvcc.display())
        }
    }
}

/// The compiler: `PALPATE_NVCC`, or that of `CUDA_HOME` or `CUDA_PATH`, or the one on the path.
fn nvcc() -> PathBuf {
    for name in ["PALPATE_NVCC", "CUDA_HOME", "CUDA_PATH"] {
        println!("cargo:rerun-if-env-changed={name}");
    }
    let of_toolkit = |name| env::var_os(name).map(|home| Path::new(&home).join("bin").join("nvcc"));
    let own = env::var_os("PALPATE_NVCC").map(PathBuf::from);
    own.or_else(|| of_toolkit("CUDA_HOME"))
        .or_else(|| of_toolkit("CUDA_PATH"))
        .unwrap_or_else(|| "nvcc".into())
}

/// Puts fresh images where builds without a compiler find them.
fn keep(images: &[&str], fresh: &Path, prebuilt: &Path, digest: &str) {
    fs::create_dir_all(prebuilt).expect("the folder of the images can be made");
    for image in images {
        let name = format!("{image}.fatbin");
        fs::copy(fresh.join(&name), prebuilt.join(&name)).expect("the folder of the images can be written");
    }
    fs::write(prebuilt.join("SOURCES.sha256"), format!("{digest}\n"))
        .expect("the folder of the images can be written");
}
