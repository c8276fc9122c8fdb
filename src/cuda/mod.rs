//! WHERE: on an NVIDIA GPU, the same model and the same answers.
//!
//! Nothing links CUDA. The driver is looked for when the first simulation asks for a GPU; that there is none is a normal answer. The
//! kernels lie in the library as machine code for common GPUs and as PTX for the rest and for older drivers, see `kernels/`.

mod body;
mod contact;
mod cut;
pub mod device;
mod driver;
pub mod efg;
mod graph;
mod kept;
mod kernels;
mod layout;
mod look;
mod memory;
mod near;
mod outside;
mod pieces;
mod sides;
mod sleep;
pub mod solver;
mod state;
mod surface;
mod told;
#[cfg(all(test, unix))] // the twins talk through pipes, and compilers go by their Unix names
mod twins;

/// An argument of a kernel.
fn pointer<T>(value: &mut T) -> *mut std::ffi::c_void {
    std::ptr::from_mut(value).cast()
}
