//! Whether a test can have a GPU.

use palpate::cuda::device::Device;

/// Whether there is a GPU; a test that needs one returns where there is none. Where `PALPATE_GPU` is set there must be one.
pub fn has_gpu(test: &str) -> bool {
    match Device::open(None) {
        Ok(_) => true,
        Err(error) => {
            assert!(std::env::var_os("PALPATE_GPU").is_none(), "{error}");
            eprintln!("SKIPPED without a GPU: {test} ({error})");
            false
        }
    }
}
