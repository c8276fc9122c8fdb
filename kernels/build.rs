//! Finds the kernels' images: those that lie in `prebuilt` beside their sources, checked against these, or, with the feature
//! `build-kernels`, fresh ones from nvcc.

use std::env;
use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use sha2::{Digest, Sha256};

/// Source files that each become two images.
const IMAGES: [&str; 12] = [
    "lattice", "pieces", "sleep", "near", "contact", "outside", "mobile", "surface", "report", "efg", "cut",
    "look",
];
/// What they include.
const HEADERS: [&str; 16] = [
    "block.cuh",
    "clock.cuh",
    "contact.cuh",
    "efg.cuh",
    "field.cuh",
    "grid.cuh",
    "law.cuh",
    "layout.cuh",
    "outside.cuh",
    "points.cuh",
    "press.cuh",
    "rows.cuh",
    "tile.cuh",
    "tool.cuh",
    "touched.cuh",
    "worker.cuh",
];
/// Sources in one folder that are compiled, checked and kept together.
struct Set {
    folder: &'static str,
    images: &'static [&'static str],
    headers: &'static [&'static str],
    /// Whether older drivers get them too, as PTX.
    has_ptx: bool,
    /// The variable that tells the compiler where the images are.
    variable: &'static str,
}
/// The library's kernels, and those that benches compare them with: no library holds these.
const SETS: [Set; 3] = [
    Set { folder: "kernels", images: &IMAGES, headers: &HEADERS, has_ptx: true, variable: "PALPATE_KERNELS" },
    Set {
        folder: "benches/lattice",
        images: &["baseline"],
        headers: &[],
        has_ptx: false,
        variable: "PALPATE_BASELINE",
    },
    Set {
        folder: "benches/efg",
        images: &["baseline"],
        headers: &[],
        has_ptx: false,
        variable: "PALPATE_EFG_BASELINE",
    },
];
/// The compiler that made the images in `prebuilt`.
const NVCC: &str = "13.0.88";
/// Approximate roots and quotients, and denormal numbers as zero: a displacement that small is none.
const FLAGS: [&str; 5] = ["-std=c++17", "-O3", "-ftz=true", "-prec-div=false", "-prec-sqrt=false"];
/// Machine code for common GPUs, and PTX that newer ones compile for themselves.
const FATBIN: [&str; 8] = [
    "-fatbin",
    "-Xfatbin=-compress-all",
    "-gencode=arch=compute_75,code=compute_75",
    "-gencode=arch=compute_80,code=sm_80",
    "-gencode=arch=compute_86,code=sm_86",
    "-gencode=arch=compute_89,code=sm_89",
    "-gencode=arch=compute_90,code=sm_90",
    "-gencode=arch=compute_120,code=sm_120",
];
/// PTX for drivers that are older than the compiler, and so do not read its fat binaries.
const PTX: [&str; 2] = ["-ptx", "-arch=compute_75"];
/// The version that the compiler writes into PTX, and the one that stands there in its place: the kernels need no later one.
const PTX_VERSIONS: [&str; 2] = [".version 9.0", ".version 7.0"];
/// A hint to analysing tools that came later than that version.
const LATER_HINT: &str = ".pragma \"used_bytes_mask";

impl Set {
    fn path(&self) -> PathBuf {
        Path::new(&env::var("CARGO_MANIFEST_DIR").expect("cargo sets it")).join(self.folder)
    }

    /// Names of what is made of them.
    fn kept(&self) -> impl Iterator<Item = String> {
        let kinds: &[&str] = if self.has_ptx { &["fatbin", "ptx"] } else { &["fatbin"] };
        self.images.iter().flat_map(move |image| kinds.iter().map(move |kind| format!("{image}.{kind}")))
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
        images.iter().for_each(|image| make(set, image, &fresh));
        println!("cargo:rerun-if-env-changed=PALPATE_KEEP_KERNELS");
        if env::var_os("PALPATE_KEEP_KERNELS").is_some() {
            keep(set, &fresh, &prebuilt, &digest);
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
    if set.has_ptx {
        images.iter().for_each(|image| pack(&found.join(image).with_extension("ptx")));
    }
    println!("cargo:rustc-env={variable}={}", found.display());
}

/// Of everything that the images depend on.
fn digest(set: &Set) -> String {
    let mut hash = Sha256::new();
    hash.update(NVCC);
    let how = FLAGS.iter().chain(&FATBIN).chain(&PTX).chain(&PTX_VERSIONS);
    how.chain([&LATER_HINT]).for_each(|text| hash.update(text));
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

/// Makes the images of one source file.
fn make(set: &Set, image: &str, to: &Path) {
    let to = to.join(image);
    compile(&set.path(), image, &FATBIN, &to.with_extension("fatbin"));
    if !set.has_ptx {
        return;
    }
    let ptx = to.with_extension("ptx");
    compile(&set.path(), image, &PTX, &ptx);
    let text = fs::read_to_string(&ptx).expect("nvcc has written it");
    fs::write(&ptx, as_older(&text)).expect("the build's own folder can be written");
}

/// PTX as older drivers take it, without comments.
fn as_older(text: &str) -> String {
    let [newer, older] = PTX_VERSIONS;
    assert!(text.lines().any(|line| line == newer), "PTX of another version than {newer}");
    text.lines()
        .filter(|line| {
            let line = line.trim_start();
            !line.is_empty() && !line.starts_with("//") && !line.starts_with(LATER_HINT)
        })
        .flat_map(|line| [if line == newer { older } else { line }, "\n"])
        .collect()
}

/// Leaves PTX compressed where the library takes it from.
fn pack(ptx: &Path) {
    let text = fs::read(ptx).expect("there is PTX of every image");
    let to = Path::new(&env::var("OUT_DIR").expect("cargo sets it")).join(ptx.file_name().expect("a file"));
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::best());
    packed.write_all(&text).expect("memory takes all");
    let packed = packed.finish().expect("memory takes all");
    fs::write(to.with_extension("ptx.z"), packed).expect("the build's own folder can be written");
}

/// Runs the compiler on one source file.
fn compile(sources: &Path, image: &str, kind: &[&str], to: &Path) {
    let nvcc = nvcc();
    let status = Command::new(&nvcc)
        .current_dir(sources)
        .args(FLAGS)
        .args(kind)
        .arg(format!("{image}.cu"))
        .arg("-o")
        .arg(to)
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
fn keep(set: &Set, fresh: &Path, prebuilt: &Path, digest: &str) {
    fs::create_dir_all(prebuilt).expect("the folder of the images can be made");
    for name in set.kept() {
        fs::copy(fresh.join(&name), prebuilt.join(&name)).expect("the folder of the images can be written");
    }
    fs::write(prebuilt.join("SOURCES.sha256"), format!("{digest}\n"))
        .expect("the folder of the images can be written");
}
