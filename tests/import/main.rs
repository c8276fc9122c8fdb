//! Files that are read rightly, and files that must be refused: every claim of `model::import`.

mod anatomy;
mod damage;
mod files;
mod memory;
mod meshes;
mod nifti;
mod nrrd;
