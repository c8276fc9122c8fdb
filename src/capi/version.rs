//! Which library this is, and what it can do.

use std::ffi::c_char;

use super::boundary::read_str;

/// The version of this header's binary interface. It only changes when programs must be compiled again; the
/// shared library's SONAME carries it.
pub const PLP_ABI_VERSION: u32 = 1; // build.rs reads this line

/// The interface version of the loaded library; plp_check_abi compares it with the header's.
///
/// @thread any
#[unsafe(no_mangle)]
pub extern "C" fn plp_abi_version() -> u32 {
    PLP_ABI_VERSION
}

/// The library's version, such as "0.1.0". Static memory.
///
/// @thread any
#[unsafe(no_mangle)]
pub extern "C" fn plp_version_string() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}

/// How the library was built, for reports: "kernels prebuilt", where the GPU's kernels came with the sources, or "kernels built
/// with nvcc". Static memory.
///
/// @thread any
#[unsafe(no_mangle)]
pub extern "C" fn plp_build_string() -> *const c_char {
    let build =
        if cfg!(feature = "build-kernels") { c"kernels built with nvcc" } else { c"kernels prebuilt" };
    build.as_ptr()
}

/// What this build can do.
const FEATURES: [&str; 3] = ["lattice", "double", "cuda"];

/// Whether the library can do something: 1 or 0. Known names are "lattice" (the lattice tissue model),
/// "double" (PLP_PRECISION_DOUBLE) and "cuda" (PLP_BACKEND_CUDA, where plp_device_count() finds a GPU); names that this version does
/// not know, and NULL, answer 0.
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_has(feature: *const c_char) -> i32 {
    // SAFETY: the host passes NULL or a string that ends in NUL.
    let feature = unsafe { read_str(feature, "feature") };
    feature.is_ok_and(|name| FEATURES.contains(&name)).into()
}
