//! Gives the shared library its name for the dynamic linker, for cargo gives it none, and finds the GPU's kernels.
//!
//! Without a SONAME, programs record the path of the library that they were linked against and miss a change
//! of the ABI.

#[path = "kernels/build.rs"]
mod kernels;

use std::env;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    kernels::provide();
    println!("cargo:rerun-if-changed=src/capi/version.rs");
    let abi = abi_version();
    match env::var("CARGO_CFG_TARGET_OS").as_deref() {
        Ok("linux" | "android" | "freebsd") => {
            println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libpalpate.so.{abi}");
        }
        Ok("macos" | "ios") => {
            println!("cargo:rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libpalpate.{abi}.dylib");
        }
        // Windows has no such name: an import library carries the file's.
        _ => {}
    }
}

/// The number in the line that defines `PLP_ABI_VERSION`, so that it is written in one place only.
fn abi_version() -> u32 {
    let source = std::fs::read_to_string("src/capi/version.rs").expect("src/capi/version.rs is readable");
    let line = source.lines().find(|line| line.starts_with("pub const PLP_ABI_VERSION: u32 ="));
    let number = line.and_then(|line| line.split('=').nth(1)?.split(';').next()?.trim().parse().ok());
    number.expect("src/capi/version.rs defines PLP_ABI_VERSION")
}
