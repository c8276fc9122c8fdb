//! The CUDA driver's functions, found at run time.
//!
//! Types are cudarc's; the functions are loaded here, all at once, so that an old or broken driver is an error with a name and not a panic in the
//! middle of a step. Status codes stay plain integers: a driver newer than the header may return numbers that an enumeration does not
//! know.

use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::sync::OnceLock;

use cudarc::driver::sys::{
    CUcontext, CUdevice, CUdeviceptr, CUfunction, CUgraph, CUgraphExec, CUmodule, CUstream, culib,
    is_culib_present,
};

use crate::error::{Error, Result};

macro_rules! functions {
    ($($(#[$doc:meta])* $name:ident = $symbol:literal ($($argument:ty),*);)*) => {
        /// Pointers to the driver's functions, under the names of the C interface without their prefix.
        #[derive(Debug)]
        pub struct Driver {
            $($(#[$doc])* pub $name: unsafe extern "C" fn($($argument),*) -> c_int,)*
        }

        impl Driver {
            /// Finds every function, or says which one is missing.
            fn find() -> std::result::Result<Self, String> {
                // SAFETY: opening the driver's library runs its initialisers, as any CUDA program does.
                if !unsafe { is_culib_present() } {
                    return Err("no CUDA driver is installed".into());
                }
                // SAFETY: the library was just seen; it stays loaded for ever.
                let library = unsafe { culib() };
                $(
                    // SAFETY: the type is that of the function's declaration in cuda.h.
                    let $name = unsafe {
                        library.get::<unsafe extern "C" fn($($argument),*) -> c_int>(concat!($symbol, "\0").as_bytes())
                    };
                    let $name = *$name.map_err(|_| concat!("the CUDA driver has no function ", $symbol))?;
                )*
                Ok(Self { $($name),* })
            }
        }
    };
}

functions! {
    init = "cuInit"(c_uint);
    driver_get_version = "cuDriverGetVersion"(*mut c_int);
    get_error_name = "cuGetErrorName"(c_int, *mut *const c_char);
    device_get_count = "cuDeviceGetCount"(*mut c_int);
    device_get = "cuDeviceGet"(*mut CUdevice, c_int);
    device_get_name = "cuDeviceGetName"(*mut c_char, c_int, CUdevice);
    device_get_attribute = "cuDeviceGetAttribute"(*mut c_int, c_int, CUdevice);
    primary_ctx_retain = "cuDevicePrimaryCtxRetain"(*mut CUcontext, CUdevice);
    primary_ctx_release = "cuDevicePrimaryCtxRelease_v2"(CUdevice);
    ctx_push_current = "cuCtxPushCurrent_v2"(CUcontext);
    ctx_pop_current = "cuCtxPopCurrent_v2"(*mut CUcontext);
    stream_create = "cuStreamCreate"(*mut CUstream, c_uint);
    stream_destroy = "cuStreamDestroy_v2"(CUstream);
    stream_synchronize = "cuStreamSynchronize"(CUstream);
    stream_query = "cuStreamQuery"(CUstream);
    stream_begin_capture = "cuStreamBeginCapture_v2"(CUstream, c_uint);
    stream_end_capture = "cuStreamEndCapture"(CUstream, *mut CUgraph);
    graph_instantiate = "cuGraphInstantiateWithFlags"(*mut CUgraphExec, CUgraph, u64);
    graph_launch = "cuGraphLaunch"(CUgraphExec, CUstream);
    graph_exec_destroy = "cuGraphExecDestroy"(CUgraphExec);
    graph_destroy = "cuGraphDestroy"(CUgraph);
    mem_alloc = "cuMemAlloc_v2"(*mut CUdeviceptr, usize);
    mem_free = "cuMemFree_v2"(CUdeviceptr);
    mem_host_alloc = "cuMemHostAlloc"(*mut *mut c_void, usize, c_uint);
    mem_free_host = "cuMemFreeHost"(*mut c_void);
    mem_host_get_device_pointer = "cuMemHostGetDevicePointer_v2"(*mut CUdeviceptr, *mut c_void, c_uint);
    memcpy_to_device = "cuMemcpyHtoDAsync_v2"(CUdeviceptr, *const c_void, usize, CUstream);
    memcpy_to_host = "cuMemcpyDtoHAsync_v2"(*mut c_void, CUdeviceptr, usize, CUstream);
    memset_words = "cuMemsetD32Async"(CUdeviceptr, c_uint, usize, CUstream);
    module_load_data = "cuModuleLoadData"(*mut CUmodule, *const c_void);
    module_unload = "cuModuleUnload"(CUmodule);
    module_get_function = "cuModuleGetFunction"(*mut CUfunction, CUmodule, *const c_char);
    func_set_attribute = "cuFuncSetAttribute"(CUfunction, c_int, c_int);
    launch_kernel = "cuLaunchKernel"(CUfunction, c_uint, c_uint, c_uint, c_uint, c_uint, c_uint, c_uint, CUstream, *mut *mut c_void, *mut *mut c_void);
}

/// "Out of memory" among the driver's status codes.
const OUT_OF_MEMORY: c_int = 2;
/// "Not ready": what was asked for is still under way.
const NOT_READY: c_int = 600;

impl Driver {
    /// The driver, initialised once; or why there is none.
    pub fn get() -> Result<&'static Self> {
        static DRIVER: OnceLock<std::result::Result<Driver, String>> = OnceLock::new();
        let found = DRIVER.get_or_init(|| {
            let driver = Self::find()?;
            // SAFETY: the first call that a program makes.
            let status = unsafe { (driver.init)(0) };
            if status != 0 {
                return Err(format!("the CUDA driver does not start: {}", driver.name_of(status)));
            }
            Ok(driver)
        });
        found.as_ref().map_err(|why| Error::NoDevice(why.clone()))
    }

    /// The newest CUDA version that the driver serves: 13000 is 13.0.
    pub fn version(&self) -> Result<i32> {
        let mut version = 0;
        // SAFETY: `version` is written.
        let status = unsafe { (self.driver_get_version)(&mut version) };
        self.check(status, "asking the driver's version").map(|()| version)
    }

    /// Turns a status into a result; `what` says what was tried.
    pub fn check(&self, status: c_int, what: &str) -> Result<()> {
        match status {
            0 => Ok(()),
            OUT_OF_MEMORY => Err(Error::Limit(format!("{what}: the GPU has too little free memory"))),
            _ => Err(Error::Device(format!("{what}: {}", self.name_of(status)))),
        }
    }

    /// Whether what was asked of a stream is done.
    pub fn is_done(&self, stream: CUstream) -> Result<bool> {
        // SAFETY: the caller's stream exists.
        let status = unsafe { (self.stream_query)(stream) };
        if status == NOT_READY {
            return Ok(false);
        }
        self.check(status, "a step on the GPU").map(|()| true)
    }

    /// A status code in words.
    fn name_of(&self, status: c_int) -> String {
        let mut name = std::ptr::null();
        // SAFETY: `name` is written with a pointer to a constant string of the driver, or left alone for an unknown code.
        unsafe {
            if (self.get_error_name)(status, &mut name) == 0 && !name.is_null() {
                return format!("{} ({status})", CStr::from_ptr(name).to_string_lossy());
            }
        }
        format!("status {status}")
    }
}
