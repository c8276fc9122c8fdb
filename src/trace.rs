//! Ranges of time for NVIDIA's profilers (NVTX), with the feature `nvtx`: what the host waits for beside what the GPU does.
//!
//! NVTX's library is looked for once, at run time. Where there is none, as without the feature, a range is nothing.

pub use self::found::range;

#[cfg(not(all(feature = "nvtx", unix)))]
mod found {
    use std::ffi::CStr;

    #[derive(Debug)]
    pub struct Range;

    /// No range.
    pub fn range(_name: &'static CStr) -> Range {
        Range
    }
}

#[cfg(all(feature = "nvtx", unix))]
mod found {
    use std::ffi::{CStr, c_char, c_int};
    use std::marker::PhantomData;
    use std::sync::OnceLock;

    use libloading::Library;

    /// What the library is called: that of NVTX 3, and the one of CUDA toolkits up to 12.
    const NAMES: [&str; 2] = ["libnvtx3interop.so.1", "libnvToolsExt.so.1"];

    /// The two functions of the library that are called here.
    struct Nvtx {
        push: unsafe extern "C" fn(*const c_char) -> c_int,
        pop: unsafe extern "C" fn() -> c_int,
    }

    impl Nvtx {
        fn get() -> Option<&'static Self> {
            static FOUND: OnceLock<Option<Nvtx>> = OnceLock::new();
            FOUND.get_or_init(Self::find).as_ref()
        }

        fn find() -> Option<Self> {
            // SAFETY: this runs the library's initialisers, as any program with NVTX does.
            let library = NAMES.iter().find_map(|name| unsafe { Library::new(*name) }.ok())?;
            // It stays loaded for ever: ranges may be open on any thread.
            let library: &'static Library = Box::leak(Box::new(library));
            // SAFETY: the types are those of the functions' declarations in nvToolsExt.h.
            unsafe {
                Some(Self {
                    push: *library.get(b"nvtxRangePushA\0").ok()?,
                    pop: *library.get(b"nvtxRangePop\0").ok()?,
                })
            }
        }
    }

    /// A range of this thread's time.
    #[derive(Debug)]
    pub struct Range {
        /// Ends on the thread on which it began.
        here: PhantomData<*const ()>,
    }

    /// Opens a range, until what it gives is dropped.
    pub fn range(name: &'static CStr) -> Range {
        if let Some(nvtx) = Nvtx::get() {
            // SAFETY: a text that ends.
            unsafe { (nvtx.push)(name.as_ptr()) };
        }
        Range { here: PhantomData }
    }

    impl Drop for Range {
        fn drop(&mut self) {
            if let Some(nvtx) = Nvtx::get() {
                // SAFETY: closes what `range` opened on the same thread.
                unsafe { (nvtx.pop)() };
            }
        }
    }
}
