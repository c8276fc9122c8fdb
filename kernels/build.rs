//! Finds the kernels' images for the library: those that lie in `kernels/prebuilt`, checked against their sources, or, with the feature
//! `build-kernels`, fresh ones from nvcc.

use std::env;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest, Sha256};

/// Source files that each become one image.
const IMAGES: [&str; 5] = ["lattice", "near", "contact", "surface", "report"];
/// What they include.
const HEADERS: [&str; 4] = ["block.cuh", "contact.cuh", "law.cuh", "layout.cuh"];
/// The compiler that made the images in `kernels/prebuilt`.
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

/// Tells the compiler where the images are.
pub fn provide() {
    let kernels = Path::new(&env::var("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("kernels");
    println!("cargo:rerun-if-changed=kernels");
    let prebuilt = kernels.join("prebuilt");
    let digest = digest(&kernels);
    let images = if env::var_os("CARGO_FEATURE_BUILD_KERNELS").is_some() {
        let fresh = PathBuf::from(env::var("OUT_DIR").expect("cargo sets it"));
        IMAGES.iter().for_each(|image| compile(&kernels, image, &fresh));
        println!("cargo:rerun-if-env-changed=PALPATE_KEEP_KERNELS");
        if env::var_os("PALPATE_KEEP_KERNELS").is_some() {
            keep(&fresh, &prebuilt, &digest);
        }
        fresh
    } else {
        let made_of = fs::read_to_string(prebuilt.join("SOURCES.sha256")).unwrap_or_default();
        assert!(
            made_of.trim() == digest,
            "kernels/prebuilt was made from other sources than kernels/ holds now. With nvcc {NVCC} in reach, make it again by\n    \
             PALPATE_KEEP_KERNELS=1 cargo build --features build-kernels"
        );
        prebuilt
    };
    println!("cargo:rustc-env=PALPATE_KERNELS={}", images.display());
}

/// Of everything that the images depend on.
fn digest(kernels: &Path) -> String {
    let mut hash = Sha256::new();
    hash.update(NVCC);
    for flag in FLAGS {
        hash.update(flag);
    }
    for name in IMAGES.iter().map(|image| format!("{image}.cu")).chain(HEADERS.map(String::from)) {
        let text = fs::read_to_string(kernels.join(&name)).expect("the kernels' sources are readable");
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
fn compile(kernels: &Path, image: &str, to: &Path) {
    let nvcc = nvcc();
    let status = Command::new(&nvcc)
        .current_dir(kernels)
        .args(FLAGS)
        .arg(format!("{image}.cu"))
        .arg("-o")
        .arg(to.join(format!("{image}.fatbin")))
        .status();
    match status {
        Ok(status) if status.success() => {}
        Ok(status) => panic!("{} could not compile kernels/{image}.cu: {status}", nvcc.display()),
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
fn keep(fresh: &Path, prebuilt: &Path, digest: &str) {
    fs::create_dir_all(prebuilt).expect("kernels/prebuilt can be made");
    for image in IMAGES {
        let name = format!("{image}.fatbin");
        fs::copy(fresh.join(&name), prebuilt.join(&name)).expect("kernels/prebuilt can be written");
    }
    fs::write(prebuilt.join("SOURCES.sha256"), format!("{digest}\n"))
        .expect("kernels/prebuilt can be written");
}
