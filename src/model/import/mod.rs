//! Label maps, scans and meshes from files.
//!
//! **World of files.** Volumes arrive in patient axes: +x to the patient's right, +y anterior, +z superior
//! (RAS), in metres. NIfTI is written in these axes; NRRD files in LPS axes are converted by negating x and
//! y, which is a half turn, and those in LAS axes by negating x. Whatever the order in which a file stores
//! its voxels, a voxel keeps its place in the patient. Mesh files say neither axes nor unit: coordinates are
//! multiplied by a scale and otherwise kept.
//!
//! **Hostile files.** Nothing is allocated because a header says so: a promised size is first held against
//! [`MAX_VOXELS`](super::grid::MAX_VOXELS) and against what the file can hold (for gzip, which cannot expand
//! more than 1032-fold, against that multiple). Compressed streams are read up to the promised size and must
//! end there. What does not follow its format is an [`Error::Format`]; what follows it but is not read here
//! is an [`Error::Unsupported`].
//!
//! **Who parses what.** NIfTI headers come from the crate `nifti` and PLY from `ply-rs-bw`, STL triangles
//! from `stl_io`. The voxels of NIfTI are read here, by the code that NRRD needs as well, because the crate
//! allocates what a header promises. NRRD and OBJ are parsed here: we know of no published crate for NRRD,
//! and the OBJ crate `tobj` overflows on far out-of-range texture indices, turns polylines into faces and
//! loses track of texture coordinates that only some corners have.

use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;

use super::grid::LabelGrid;
use super::intensity::IntensityGrid;
use super::mesh::TriangleMesh;
use crate::error::{Error, Result};
use volume::{Source, Volume};

mod nifti;
mod nrrd;
mod obj;
mod ply;
mod stl;
mod volume;

/// Reads a label map: NIfTI-1 (`.nii`, `.nii.gz`) or NRRD with its data in the same file (`.nrrd`), told
/// apart by content.
///
/// Voxels may have any integer or floating-point type; after the file's own scaling each must be a whole
/// number from 0 to 65535. Further axes are accepted where their length is 1.
pub fn read_labels(path: impl AsRef<Path>) -> Result<LabelGrid> {
    open_volume(path.as_ref())?.into_labels()
}

/// Reads a scan, such as a CT in Hounsfield units, from the formats of [`read_labels`]. The file's slope and
/// intercept are applied.
pub fn read_intensities(path: impl AsRef<Path>) -> Result<IntensityGrid> {
    open_volume(path.as_ref())?.into_intensities()
}

/// Reads a surface: Wavefront OBJ, STL (text or binary) or PLY (text or binary), by the name's ending.
///
/// `scale_to_m` is the length of the file's unit in metres: 0.001 for millimetres. Polygons become fans
/// around their first corner, which suits convex ones. Vertices keep the file's order; where a corner of an
/// OBJ file gives a vertex a second texture coordinate, a copy of that vertex follows at the end. STL names
/// no vertices: equal positions become one.
pub fn read_mesh(path: impl AsRef<Path>, scale_to_m: f64) -> Result<TriangleMesh> {
    let path = path.as_ref();
    if !(scale_to_m > 0.0 && scale_to_m.is_finite()) {
        return Err(Error::argument(format!("a unit of {scale_to_m} m is not a length")));
    }
    let parse: fn(&str, &[u8]) -> Result<TriangleMesh> =
        match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("obj") => obj::parse,
            Some("stl") => stl::parse,
            Some("ply") => ply::parse,
            Some(_) | None => {
                return Err(Error::Unsupported(format!(
                    "{}: meshes are read from files ending in .obj, .stl or .ply",
                    path.display()
                )));
            }
        };

    let (file, length) = open(path)?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes).map_err(|reason| Error::Io { path: path.into(), reason })?;
    let what = path.display().to_string();
    let mut mesh = parse(&what, &bytes)?;
    for position in &mut mesh.positions {
        *position *= scale_to_m;
    }
    mesh.check().map_err(|e| match e {
        Error::Argument(reason) => Error::format(what, reason),
        other => other,
    })?;
    Ok(mesh)
}

/// Opens a regular file; a pipe or a device, which may never end, is refused. Answers its length in bytes.
pub(super) fn open(path: &Path) -> Result<(File, u64)> {
    let io_error = |reason| Error::Io { path: path.into(), reason };
    let file = File::open(path).map_err(io_error)?;
    let metadata = file.metadata().map_err(io_error)?;
    if !metadata.is_file() {
        return Err(io_error(std::io::Error::new(ErrorKind::InvalidInput, "not a regular file")));
    }
    Ok((file, metadata.len()))
}

/// Reads the header of a volume and leaves its voxels to be read.
fn open_volume(path: &Path) -> Result<Volume> {
    let (file, length) = open(path)?;
    let mut reader = BufReader::new(file);
    let start = reader.fill_buf().map_err(|reason| Error::Io { path: path.into(), reason })?;
    let (is_nrrd, is_gzip) = (start.starts_with(b"NRRD"), start.starts_with(&[0x1f, 0x8b]));

    let what = path.display().to_string();
    let mut source = Source { what, reader: Box::new(reader), capacity: length };
    if is_nrrd {
        return nrrd::open(source);
    }
    if is_gzip {
        source = source.inflated();
    }
    nifti::open(source)
}
