//! NIfTI: places, units, byte orders, scaling, and headers that lie.

use nalgebra::{Matrix3, Matrix3x4, Point3, Rotation3, UnitQuaternion, Vector3, Vector4};
use palpate::error::Error;
use palpate::model::grid::LabelGrid;
use palpate::model::import::{read_intensities, read_labels};
use palpate::model::intensity::HounsfieldRange;

use crate::files::{Scratch, gzip};
use crate::memory::peak_of;

/// A NIfTI-1 header, written by byte offset from the format's definition, little-endian.
#[derive(Clone)]
pub struct Nifti(Vec<u8>);

impl Nifti {
    pub const UINT8: (i16, usize) = (2, 1);
    const INT16: (i16, usize) = (4, 2);

    /// A 3-D header with spacing 1 mm and no transform.
    pub fn new(dims: [i16; 3], (code, size): (i16, usize)) -> Self {
        let mut header = Self(vec![0; 352]);
        header.put(0, &348_i32.to_le_bytes());
        header.i16(40, 3);
        (0..3).for_each(|a| header.i16(42 + 2 * a, dims[a]));
        (3..7).for_each(|a| header.i16(42 + 2 * a, 1));
        header.i16(70, code);
        header.i16(72, 8 * size as i16);
        (0..4).for_each(|a| header.f32(76 + 4 * a, 1.0));
        header.f32(108, 352.0);
        header.put(344, b"n+1\0");
        header
    }

    fn put(&mut self, at: usize, bytes: &[u8]) {
        self.0[at..at + bytes.len()].copy_from_slice(bytes);
    }

    fn i16(&mut self, at: usize, value: i16) {
        self.put(at, &value.to_le_bytes());
    }

    fn f32(&mut self, at: usize, value: f32) {
        self.put(at, &value.to_le_bytes());
    }

    pub fn sform(mut self, affine: &Matrix3x4<f64>) -> Self {
        self.i16(254, 1);
        for r in 0..3 {
            for c in 0..4 {
                self.f32(280 + 16 * r + 4 * c, affine[(r, c)] as f32);
            }
        }
        self
    }

    pub fn with(mut self, voxels: &[u8]) -> Vec<u8> {
        self.0.extend_from_slice(voxels);
        self.0
    }

    /// The big-endian twin of a header; its voxels must be swapped by the caller.
    fn swapped(mut self) -> Self {
        let fields = [(0, 4, 1), (32, 4, 1), (36, 2, 1), (40, 2, 8), (56, 4, 3), (68, 2, 4), (76, 4, 11)];
        let more = [(124, 4, 6), (252, 2, 2), (256, 4, 18)];
        for (at, size, count) in fields.into_iter().chain(more) {
            self.0[at..at + size * count].chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
        self
    }
}

pub fn bytes_0_to(count: u8) -> Vec<u8> {
    (0..count).collect()
}

/// The world position of the voxel that holds `label`.
fn place_of(grid: &LabelGrid, label: u16) -> Vector3<f64> {
    let [nx, ny, _] = grid.dims();
    let n = grid.labels().iter().position(|&l| l == label).unwrap();
    let index = Vector3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64);
    (grid.frame() * Point3::from(index.component_mul(&grid.spacing()))).coords
}

/// All 24 voxels of a 2 × 3 × 4 file, holding 0 to 23 in the file's order, lie where `affine` (in mm) puts
/// them.
pub fn assert_places(grid: &LabelGrid, affine: &Matrix3x4<f64>) {
    for label in 0..24_u16 {
        let index = Vector4::new(f64::from(label % 2), f64::from(label / 2 % 3), f64::from(label / 6), 1.0);
        let error = place_of(grid, label) - affine * index * 1e-3;
        assert!(error.norm() < 1e-7, "voxel {label} is {error:?} m off");
    }
}

pub fn oblique() -> Matrix3x4<f64> {
    let axes =
        Rotation3::from_euler_angles(0.4, -0.2, 2.5) * Matrix3::from_diagonal(&Vector3::new(0.7, 1.3, 2.5));
    let mut affine = Matrix3x4::zeros();
    affine.fixed_columns_mut::<3>(0).copy_from(&axes);
    affine.set_column(3, &Vector3::new(-80.0, 120.0, 35.5));
    affine
}

#[test]
fn oblique_nifti_keeps_voxel_centres() {
    let file = Nifti::new([2, 3, 4], Nifti::UINT8).sform(&oblique()).with(&bytes_0_to(24));
    assert_places(&read_labels(Scratch::new("nii", &file)).unwrap(), &oblique());
    assert_places(&read_labels(Scratch::new("nii.gz", &gzip(&file))).unwrap(), &oblique());
}

#[test]
fn left_handed_nifti_keeps_voxel_centres_in_a_right_handed_frame() {
    let mut affine = oblique();
    affine.column_mut(1).neg_mut();
    let file = Nifti::new([2, 3, 4], Nifti::UINT8).sform(&affine).with(&bytes_0_to(24));
    assert_places(&read_labels(Scratch::new("nii", &file)).unwrap(), &affine);
}

#[test]
fn sform_goes_before_qform_and_qform_before_spacing() {
    let affine = oblique();
    let rotation = UnitQuaternion::from_euler_angles(0.4, -0.2, 2.5);
    let sign = if rotation.w < 0.0 { -1.0 } else { 1.0 };
    let mut header = Nifti::new([2, 3, 4], Nifti::UINT8);
    header.i16(252, 1);
    for (n, part) in [rotation.i, rotation.j, rotation.k].into_iter().enumerate() {
        header.f32(256 + 4 * n, (sign * part) as f32);
    }
    for (n, origin) in [-80.0, 120.0, 35.5].into_iter().enumerate() {
        header.f32(268 + 4 * n, origin);
    }
    for (n, spacing) in [0.7, 1.3, 2.5].into_iter().enumerate() {
        header.f32(80 + 4 * n, spacing);
    }
    let read =
        |header: &Nifti| read_labels(Scratch::new("nii", &header.clone().with(&bytes_0_to(24)))).unwrap();
    assert_places(&read(&header), &affine);

    // A negative pixdim[0] turns k around.
    header.f32(76, -1.0);
    let mut turned = affine;
    turned.column_mut(2).neg_mut();
    assert_places(&read(&header), &turned);

    let other = Matrix3x4::new(2.0, 0.0, 0.0, 5.0, 0.0, 2.0, 0.0, 6.0, 0.0, 0.0, 2.0, 7.0);
    assert_places(&read(&header.clone().sform(&other)), &other);

    header.i16(252, 0);
    let bare = Matrix3x4::new(0.7, 0.0, 0.0, 0.0, 0.0, 1.3, 0.0, 0.0, 0.0, 0.0, 2.5, 0.0);
    assert_places(&read(&header), &bare);
}

#[test]
fn nifti_units_become_metres() {
    for (code, unit_m) in [(0, 1e-3), (1, 1.0), (2, 1e-3), (3, 1e-6), (2 | 8, 1e-3)] {
        let mut header = Nifti::new([1, 1, 1], Nifti::UINT8);
        (0..3).for_each(|a| header.f32(80 + 4 * a, 0.5 / (unit_m * 1e3) as f32));
        header.put(123, &[code]);
        let grid = read_labels(Scratch::new("nii", &header.with(&[1]))).unwrap();
        assert!((grid.spacing().x - 0.5e-3).abs() < 1e-10, "unit {code}: {} m", grid.spacing().x);
    }
}

#[test]
fn big_endian_nifti_reads_like_its_twin() {
    let header = Nifti::new([2, 3, 4], Nifti::INT16).sform(&oblique());
    let voxels: Vec<u8> = (0..24_i16).flat_map(i16::to_be_bytes).collect();
    let grid = read_labels(Scratch::new("nii", &header.swapped().with(&voxels))).unwrap();
    assert_places(&grid, &oblique());
}

#[test]
fn nifti_scaling_applies_to_intensities_and_labels() {
    let mut header = Nifti::new([3, 1, 1], Nifti::INT16);
    header.f32(112, 0.5);
    header.f32(116, -1024.0);
    let voxels: Vec<u8> = [0_i16, 2048, 2050].into_iter().flat_map(i16::to_le_bytes).collect();
    let file = Scratch::new("nii", &header.clone().with(&voxels));
    let scan = read_intensities(&file).unwrap();
    assert_eq!(scan.values(), [-1024.0, 0.0, 1.0]);
    let water = HounsfieldRange { low: -0.5, high: 1.0, label: 7 };
    assert_eq!(scan.to_labels(&[water]).unwrap().labels(), [0, 7, 7]);

    // A label of −1024 is refused, and the message says where it is.
    let message = read_labels(&file).unwrap_err().to_string();
    assert!(message.contains("voxel 0 holds -1024"), "{message}");
    header.f32(116, 0.0);
    assert_eq!(read_labels(Scratch::new("nii", &header.with(&voxels))).unwrap().labels(), [0, 1024, 1025]);
}

#[test]
fn labels_that_are_not_whole_numbers_are_refused() {
    for value in [0.5_f32, -1.0, 65_536.0, f32::NAN, f32::INFINITY] {
        let file = Nifti::new([1, 1, 1], (16, 4)).with(&value.to_le_bytes());
        let file = Scratch::new("nii", &file);
        assert!(matches!(read_labels(&file), Err(Error::Format { .. })), "{value}");
        assert!(read_intensities(&file).is_ok());
    }
}

#[test]
fn a_fourth_dimension_of_one_is_accepted_and_of_two_refused() {
    let mut header = Nifti::new([2, 2, 2], Nifti::UINT8);
    header.i16(40, 4);
    assert!(read_labels(Scratch::new("nii", &header.clone().with(&[1; 8]))).is_ok());
    header.i16(48, 2);
    assert!(matches!(read_labels(Scratch::new("nii", &header.with(&[1; 16]))), Err(Error::Unsupported(_))));
}

#[test]
fn nifti_headers_that_lie_are_refused() {
    let good = || Nifti::new([2, 2, 2], Nifti::UINT8);
    let refused = |name: &str, bytes: &[u8]| {
        for extension in ["nii", "nii.gz"] {
            let bytes = if extension == "nii" { bytes.to_vec() } else { gzip(bytes) };
            let peak = peak_of(|| {
                let result = read_labels(Scratch::new(extension, &bytes));
                assert!(result.is_err(), "{name}: {result:?}");
            });
            assert!(peak < 1 << 20, "{name}: {peak} bytes allocated");
        }
    };
    let edited = |edit: &dyn Fn(&mut Nifti)| {
        let mut header = good();
        edit(&mut header);
        header.with(&[1; 8])
    };
    assert!(read_labels(Scratch::new("nii", &good().with(&[1; 8]))).is_ok());

    refused("truncated", &good().with(&[1; 7]));
    refused("too long", &good().with(&[1; 9]));
    refused("header only", &good().0[..300]);
    refused("nothing", &[]);
    refused("terabytes", &edited(&|h| (0..3).for_each(|a| h.i16(42 + 2 * a, i16::MAX))));
    refused("gigabytes", &edited(&|h| (0..3).for_each(|a| h.i16(42 + 2 * a, 1200))));
    refused("zero dimension", &edited(&|h| h.i16(44, 0)));
    refused("negative dimension", &edited(&|h| h.i16(44, -3)));
    refused("nine dimensions", &edited(&|h| h.i16(40, 9)));
    refused("NaN spacing", &edited(&|h| h.f32(80, f32::NAN)));
    refused("zero spacing", &edited(&|h| h.f32(84, 0.0)));
    refused("wrong magic", &edited(&|h| h.put(344, b"nope")));
    refused("two files", &edited(&|h| h.put(344, b"ni1\0")));
    refused("complex voxels", &edited(&|h| h.i16(70, 32)));
    refused("offset inside the header", &edited(&|h| h.f32(108, 100.0)));
    refused("offset past the end", &edited(&|h| h.f32(108, 1e30)));
    refused("NaN offset", &edited(&|h| h.f32(108, f32::NAN)));
    refused("unknown unit", &edited(&|h| h.put(123, &[5])));
    refused("empty sform", &edited(&|h| h.i16(254, 1)));
    refused(
        "sheared",
        &good()
            .sform(&Matrix3x4::new(1.0, 0.3, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0))
            .with(&[1; 8]),
    );
    refused("NIfTI-2", &edited(&|h| h.put(0, &540_i32.to_le_bytes())));
}

#[test]
fn a_gzip_bomb_stops_at_the_promised_size() {
    // 8 voxels promised, 64 MiB of zeros sent.
    let bomb = gzip(&Nifti::new([2, 2, 2], Nifti::UINT8).with(&vec![0; 64 << 20]));
    let file = Scratch::new("nii.gz", &bomb);
    let peak = peak_of(|| assert!(matches!(read_labels(&file), Err(Error::Format { .. }))));
    assert!(peak < 1 << 20, "{peak} bytes");
}

#[test]
fn damaged_gzip_data_is_refused_by_its_checksum() {
    let mut file = gzip(&Nifti::new([2, 3, 4], Nifti::UINT8).with(&bytes_0_to(24)));
    let checksum = file.len() - 8;
    file[checksum] ^= 1;
    assert!(matches!(read_labels(Scratch::new("nii.gz", &file)), Err(Error::Format { .. })));
}
