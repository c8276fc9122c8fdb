//! The CUDA driver's functions, found at run time.
//!
//! Types are cudarc's; the functions are loaded here, all at once, so that an old or broken driver is an error with a name and not a panic in the
//! middle of a step. Status codes stay plain integers: a driver newer than the header may return numbers that an enumeration does not
//! know.

use std::error::Error as _;
use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::sync::OnceLock;

use cudarc::driver::sys::{
    CUcontext, CUdevice, CUdeviceptr, CUfunction, CUgraph, CUgraphExec, CUlaunchConfig, CUmodule, CUstream,
};
use libloading::Library;

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
                let library = open().map_err(|error| {
                    let why = error.source().map_or_else(|| error.to_string(), ToString::to_string);
                    format!("no CUDA driver can be loaded: {why}")
                })?;
                // It stays loaded for ever, whatever follows: a driver that has begun to work cannot be taken away.
                let library: &'static Library = Box::leak(Box::new(library));
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

/// Opens the driver's library, by the one name that every driver has: another one may be a stub to link against.
#[cfg(not(windows))]
fn open() -> std::result::Result<Library, libloading::Error> {
    // SAFETY: this runs the library's initialisers, as any CUDA program does.
    unsafe { Library::new("libcuda.so.1") }
}

/// Opens the driver's library, from the system's folder alone.
#[cfg(windows)]
fn open() -> std::result::Result<Library, libloading::Error> {
    use libloading::os::windows::{LOAD_LIBRARY_SEARCH_SYSTEM32, Library as WindowsLibrary};
    // SAFETY: this runs the library's initialisers, as any CUDA program does.
    unsafe { WindowsLibrary::load_with_flags("nvcuda.dll", LOAD_LIBRARY_SEARCH_SYSTEM32) }.map(Library::from)
}

functions! {
    init = "cuInit"(c_uint);
    driver_get_version = "cuDriverGetVersion"(*mut c_int);
    get_error_name = "cuGetErrorName"(c_int, *mut *const c_char);
    device_get_count = "cuDeviceGetCount"(*mut c_int);
    device_get = "cuDeviceGet"(*mut CUdevice, c_int);
    device_get_name = "cuDeviceGetName"(*mut c_char, c_int, CUdevice);
    device_get_attribute = "cuDeviceGetAttribute"(*mut c_int, c_int, CUdevice);
    device_total_mem = "cuDeviceTotalMem_v2"(*mut usize, CUdevice);
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
    func_get_attribute = "cuFuncGetAttribute"(*mut c_int, c_int, CUfunction);
    func_set_attribute = "cuFuncSetAttribute"(CUfunction, c_int, c_int);
    launch_kernel_ex = "cuLaunchKernelEx"(*const CUlaunchConfig, CUfunction, *mut *mut c_void, *mut *mut c_void);
}

/// "Out of memory" among the driver's status codes.
const OUT_OF_MEMORY: c_int = 2;
/// The answer of the library that the toolkit has for linking.
const STUB: c_int = 34;
/// No GPU.
const NO_DEVICE: c_int = 100;
/// That in words.
pub const NO_GPU: &str = "the CUDA driver finds no GPU";
/// "Not ready": what was asked for is still under way.
const NOT_READY: c_int = 600;

impl Driver {
    /// The driver, initialised once; or why there is none.
    pub fn get() -> Result<&'static Self> {
        static DRIVER: OnceLock<std::result::Result<Driver, String>> = OnceLock::new();
        let found = DRIVER.get_or_init(|| {
            let driver = Self::find()?;
            // SAFETY: the first call that a program makes.
            match unsafe { (driver.init)(0) } {
                0 => Ok(driver),
                STUB => Err("the CUDA driver is only the stub that programs are linked against".into()),
                NO_DEVICE => Err(NO_GPU.into()),
                status => Err(format!("the CUDA driver does not start: {}", driver.name_of(status))),
            }
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
            NO_DEVICE => Err(Error::NoDevice(NO_GPU.into())),
            _ => Err(Error::Device(format!("{what}: {}", self.name_of(status)))),
        }
    }

    /// Whether a step that was asked of a stream is done. Nobody knows what a step that fails leaves behind: the device counts as
    /// lost, whatever the status.
    pub fn is_done(&self, stream: CUstream) -> Result<bool> {
        // SAFETY: the caller's stream exists.
        match unsafe { (self.stream_query)(stream) } {
            0 => Ok(true),
            NOT_READY => Ok(false),
            status => Err(Error::Device(format!("a step on the GPU: {}", self.name_of(status)))),
        }
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
