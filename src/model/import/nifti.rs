//! NIfTI-1 in one file.
//!
//! The place of the voxels comes from the sform where the file has one, else from the qform, else from the
//! spacing alone with the first voxel at the origin. Lengths are in the header's unit; millimetres where it
//! names none.

use nalgebra as na;
use nifti::{Endianness, NiftiHeader};

use super::volume::{Encoding, Scalar, Source, Volume};
use crate::error::Result;
use crate::math::{Mat3, Vec3};
use crate::model::placement::Affine;

/// Bytes of a NIfTI-1 header.
const HEADER: usize = 348;
/// Bytes of a NIfTI-2 header, and so its first number.
const HEADER_2: i32 = 540;

pub(super) fn open(mut source: Source) -> Result<Volume> {
    let mut bytes = [0; HEADER];
    if source.read_exact(&mut bytes).is_err() {
        return Err(source.refuse("neither NIfTI nor NRRD: there is no whole header"));
    }
    let first = i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    if first == HEADER_2 || first.swap_bytes() == HEADER_2 {
        return Err(source.unsupported("NIfTI-2 is not read; convert the file to NIfTI-1"));
    }
    let header = NiftiHeader::from_reader(&bytes[..]);
    let header = header.map_err(|e| source.refuse(format!("neither NIfTI nor NRRD: {e}")))?;
    if header.sizeof_hdr != HEADER as i32 {
        return Err(source.refuse(format!("a NIfTI header of {} bytes", header.sizeof_hdr)));
    }
    if &header.magic != b"n+1\0" {
        return Err(source.unsupported("headers with their voxels in a second file are not read"));
    }

    let dims = dims(&header, &source)?;
    let affine = affine(&header, &source)?;
    let encoding = Encoding::Binary {
        scalar: scalar(&header, &source)?,
        is_big_endian: header.endianness == Endianness::Big,
    };
    let scaling = scaling(&header, &source)?;

    // Extensions lie between the header and the voxels.
    let offset = if header.vox_offset == 0.0 { 352.0 } else { header.vox_offset };
    let gap = f64::from(offset) - HEADER as f64;
    if !(gap >= 0.0 && gap.fract() == 0.0 && gap <= source.capacity as f64) {
        return Err(source.refuse(format!("the voxels cannot start at byte {offset}")));
    }
    source.skip(gap as u64)?;
    Volume::new(source, dims, affine, encoding, scaling)
}

fn dims(header: &NiftiHeader, source: &Source) -> Result<[usize; 3]> {
    let rank = usize::from(header.dim[0]);
    if !(1..=7).contains(&rank) {
        return Err(source.refuse(format!("an image of {rank} dimensions")));
    }
    let lengths = &header.dim[1..=rank];
    // The field is signed; the crate reads it as unsigned.
    if lengths.iter().any(|&d| d == 0 || d > i16::MAX as u16) {
        return Err(source.refuse(format!("an image of {lengths:?} voxels")));
    }
    if rank < 3 || lengths[3..].iter().any(|&d| d != 1) {
        return Err(source.unsupported(&format!("an image of {lengths:?} voxels is not three-dimensional")));
    }
    Ok([0, 1, 2].map(|a| usize::from(lengths[a])))
}

fn scalar(header: &NiftiHeader, source: &Source) -> Result<Scalar> {
    Ok(match header.datatype {
        2 => Scalar::U8,
        4 => Scalar::I16,
        8 => Scalar::I32,
        16 => Scalar::F32,
        64 => Scalar::F64,
        256 => Scalar::I8,
        512 => Scalar::U16,
        768 => Scalar::U32,
        1024 => Scalar::I64,
        1280 => Scalar::U64,
        other => {
            return Err(
                source.unsupported(&format!("voxels of NIfTI type {other} are not single real numbers"))
            );
        }
    })
}

/// Slope and intercept; none where the slope is 0 or, as some writers leave it, not a number.
fn scaling(header: &NiftiHeader, source: &Source) -> Result<Option<[f64; 2]>> {
    let (slope, intercept) = (f64::from(header.scl_slope), f64::from(header.scl_inter));
    if slope == 0.0 || !slope.is_finite() || (slope, intercept) == (1.0, 0.0) {
        return Ok(None);
    }
    if !intercept.is_finite() {
        return Err(source.refuse(format!("an intercept of {intercept}")));
    }
    Ok(Some([slope, intercept]))
}

fn affine(header: &NiftiHeader, source: &Source) -> Result<Affine> {
    let unit_m = match header.xyzt_units & 7 {
        0 | 2 => 1e-3,
        1 => 1.0,
        3 => 1e-6,
        other => return Err(source.refuse(format!("unknown unit of length {other}"))),
    };

    let mut affine = Affine::zeros();
    if header.sform_code > 0 {
        let rows = [header.srow_x, header.srow_y, header.srow_z];
        affine = Affine::from_fn(|r, c| f64::from(rows[r][c]));
    } else {
        let spacing = Vec3::from_fn(|a, _| f64::from(header.pixdim[a + 1]));
        if spacing.iter().any(|&s| s.is_nan() || s <= 0.0) {
            let [x, y, z] = spacing.into();
            return Err(source.refuse(format!("a voxel spacing of ({x}, {y}, {z})")));
        }
        let mut axes = Mat3::from_diagonal(&spacing);
        if header.qform_code > 0 {
            // The sign of pixdim[0] says whether k runs against the third axis of the rotation.
            axes[(2, 2)] *= if header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
            axes = rotation(header) * axes;
            let origin = [header.quatern_x, header.quatern_y, header.quatern_z].map(f64::from);
            affine.set_column(3, &Vec3::from(origin));
        }
        affine.fixed_columns_mut::<3>(0).copy_from(&axes);
    }
    Ok(affine * unit_m)
}

/// The rotation of the qform: three parts of a unit quaternion are stored, the real part is what is missing
/// to length 1.
fn rotation(header: &NiftiHeader) -> Mat3 {
    let parts = Vec3::from([header.quatern_b, header.quatern_c, header.quatern_d].map(f64::from));
    let real = (1.0 - parts.norm_squared()).max(0.0).sqrt();
    let quaternion = na::Quaternion::from_parts(real, parts);
    na::UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix().into_inner()
}
