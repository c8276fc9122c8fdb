//! Files that are read rightly, and files that must be refused: every claim of `model::import`.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use flate2::Compression;
use flate2::write::GzEncoder;
use nalgebra::{Matrix3, Matrix3x4, Point3, Rotation3, UnitQuaternion, Vector3, Vector4};
use palpate::error::Error;
use palpate::model::grid::{LabelGrid, ResampleRule};
use palpate::model::import::{read_intensities, read_labels, read_mesh};
use palpate::model::intensity::HounsfieldRange;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

// ---- Files -------------------------------------------------------

/// A file that lives as long as the test looks at it.
struct Scratch(PathBuf);

impl Scratch {
    fn new(extension: &str, bytes: &[u8]) -> Self {
        // ORDERING: only uniqueness of the number matters.
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("palpate-import-{}-{number}.{extension}", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::write(&path, bytes).unwrap();
        Self(path)
    }
}

impl AsRef<Path> for Scratch {
    fn as_ref(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

// ---- NIfTI -------------------------------------------------------

/// A NIfTI-1 header, written by byte offset from the format's definition, little-endian.
#[derive(Clone)]
struct Nifti(Vec<u8>);

impl Nifti {
    const UINT8: (i16, usize) = (2, 1);
    const INT16: (i16, usize) = (4, 2);

    /// A 3-D header with spacing 1 mm and no transform.
    fn new(dims: [i16; 3], (code, size): (i16, usize)) -> Self {
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

    fn sform(mut self, affine: &Matrix3x4<f64>) -> Self {
        self.i16(254, 1);
        for r in 0..3 {
            for c in 0..4 {
                self.f32(280 + 16 * r + 4 * c, affine[(r, c)] as f32);
            }
        }
        self
    }

    fn with(mut self, voxels: &[u8]) -> Vec<u8> {
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

fn bytes_0_to(count: u8) -> Vec<u8> {
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
fn assert_places(grid: &LabelGrid, affine: &Matrix3x4<f64>) {
    for label in 0..24_u16 {
        let index = Vector4::new(f64::from(label % 2), f64::from(label / 2 % 3), f64::from(label / 6), 1.0);
        let error = place_of(grid, label) - affine * index * 1e-3;
        assert!(error.norm() < 1e-7, "voxel {label} is {error:?} m off");
    }
}

fn oblique() -> Matrix3x4<f64> {
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

// ---- NRRD --------------------------------------------------------

fn nrrd(header: &str, data: &[u8]) -> Vec<u8> {
    [format!("NRRD0005\n# a comment\n{header}\n\n").as_bytes(), data].concat()
}

fn vector(v: impl Iterator<Item = f64>) -> String {
    let parts: Vec<String> = v.map(|x| x.to_string()).collect();
    format!("({})", parts.join(","))
}

/// A header whose voxels lie where `affine` (RAS, mm) puts them, written in `space` whose axes have these
/// signs.
fn nrrd_header(affine: &Matrix3x4<f64>, space: &str, signs: [f64; 3], rest: &str) -> String {
    let column = |c: usize| vector((0..3).map(|r| signs[r] * affine[(r, c)]));
    format!(
        "dimension: 3\nsizes: 2 3 4\nspace: {space}\nspace directions: {} {} {}\nspace origin: {}\n{rest}",
        column(0),
        column(1),
        column(2),
        column(3)
    )
}

#[test]
fn nrrd_spaces_all_become_ras() {
    let spaces = [
        ("right-anterior-superior", [1.0, 1.0, 1.0]),
        ("RAS", [1.0, 1.0, 1.0]),
        ("left-posterior-superior", [-1.0, -1.0, 1.0]),
        ("LPS", [-1.0, -1.0, 1.0]),
        ("left-anterior-superior", [-1.0, 1.0, 1.0]),
    ];
    for (space, signs) in spaces {
        let header =
            nrrd_header(&oblique(), space, signs, "type: uint8\nencoding: raw\nkinds: domain domain domain");
        let grid = read_labels(Scratch::new("nrrd", &nrrd(&header, &bytes_0_to(24)))).unwrap();
        assert_places(&grid, &oblique());
    }
}

#[test]
fn nrrd_encodings_and_byte_orders_agree() {
    let header = |rest: &str| nrrd_header(&oblique(), "RAS", [1.0; 3], rest);
    let little: Vec<u8> = (0..24_u16).flat_map(u16::to_le_bytes).collect();
    let big: Vec<u8> = (0..24_u16).flat_map(u16::to_be_bytes).collect();
    let text: String = (0..24).map(|n| format!("{n}{}", if n % 6 == 5 { "\r\n" } else { " " })).collect();
    let files = [
        nrrd(&header("type: ushort\nendian: little\nencoding: raw"), &little),
        nrrd(&header("type: unsigned short\nendian: big\nencoding: raw"), &big),
        nrrd(&header("type: uint16\nendian: little\nencoding: gzip"), &gzip(&little)),
        nrrd(&header("type: int16_t\nencoding: ascii"), text.as_bytes()),
        nrrd(&header("type: float\nencoding: text"), text.trim_end().as_bytes()),
        nrrd(&header("type: uint16\nendian: little\nencoding: raw\nkey:=value: kept apart"), &little),
    ];
    for (n, file) in files.iter().enumerate() {
        let grid = read_labels(Scratch::new("nrrd", file)).unwrap_or_else(|e| panic!("file {n}: {e}"));
        assert_places(&grid, &oblique());
    }
}

#[test]
fn nrrd_spacings_without_space_start_at_the_origin() {
    let header = "type: uchar\ndimension: 3\nsizes: 2 3 4\nspacings: 0.5 2 3\nencoding: raw";
    let expected = Matrix3x4::new(0.5, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0);
    let read = |header: &str| read_labels(Scratch::new("nrrd", &nrrd(header, &bytes_0_to(24))));
    assert_places(&read(header).unwrap(), &expected);

    let in_cm = header.replace("0.5 2 3", "0.05 0.2 0.3") + "\nunits: \"cm\" \"cm\" \"cm\"";
    assert_places(&read(&in_cm).unwrap(), &expected);
    assert!(read(&(in_cm.replace("\"cm\" \"cm\" \"cm\"", "\"cm\" \"mm\" \"cm\""))).is_err());
}

#[test]
fn nrrd_axes_of_length_one_are_passed_over_and_longer_ones_refused() {
    let header = |components: usize| {
        format!(
            "type: uchar\ndimension: 4\nsizes: {components} 2 3 4\nkinds: list domain domain domain\n\
             space: LPS\nspace directions: none (-1,0,0) (0,-1,0) (0,0,1)\nspace origin: (0,0,0)\nencoding: raw"
        )
    };
    let grid = read_labels(Scratch::new("nrrd", &nrrd(&header(1), &bytes_0_to(24)))).unwrap();
    assert_places(&grid, &Matrix3x4::identity());
    let vectors = read_labels(Scratch::new("nrrd", &nrrd(&header(2), &bytes_0_to(48))));
    assert!(matches!(vectors, Err(Error::Unsupported(_))), "{vectors:?}");
}

#[test]
fn nrrd_headers_that_lie_are_refused() {
    let good = "type: uchar\ndimension: 3\nsizes: 2 3 4\nspacings: 1 1 1\nencoding: raw";
    assert!(read_labels(Scratch::new("nrrd", &nrrd(good, &bytes_0_to(24)))).is_ok());
    let cases = [
        ("sizes: 2 3 4", "sizes: 2 3 5"),
        ("sizes: 2 3 4", "sizes: 2 3 3"),
        ("sizes: 2 3 4", "sizes: 2 3"),
        ("sizes: 2 3 4", "sizes: 2 0 4"),
        ("sizes: 2 3 4", "sizes: -2 3 4"),
        ("sizes: 2 3 4", "sizes: 1000 1000 1000"),
        ("sizes: 2 3 4", "sizes: 18446744073709551615 18446744073709551615 2"),
        ("sizes: 2 3 4", "sizes: 2 3 4\nsizes: 2 3 4"),
        ("dimension: 3", "dimension: 99999999999"),
        ("dimension: 3", "dimension: 0"),
        ("spacings: 1 1 1", "spacings: nan 1 1"),
        ("spacings: 1 1 1", "spacings: 1 0 1"),
        ("spacings: 1 1 1", "content: no spacing"),
        ("spacings: 1 1 1", "space directions: (1,0,0) (0,1,0)"),
        ("spacings: 1 1 1", "space directions: (1,0) (0,1) (1,1)"),
        ("spacings: 1 1 1", "space directions: (1,0,0 (0,1,0) (0,0,1)"),
        ("spacings: 1 1 1", "spacings: 1 1 1\nspace: scanner-xyz"),
        ("encoding: raw", "encoding: gzip"),
        ("encoding: raw", "encoding: text"),
        ("encoding: raw", "encoding: bzip2"),
        ("encoding: raw", "encoding: raw\ndata file: other.raw"),
        ("encoding: raw", "encoding: raw\nbyte skip: -1"),
        ("encoding: raw", "encoding: raw\nrubbish"),
        ("type: uchar", "type: block"),
        ("type: uchar", "type: short"),
    ];
    for (old, new) in cases {
        let file = Scratch::new("nrrd", &nrrd(&good.replace(old, new), &bytes_0_to(24)));
        let peak = peak_of(|| {
            let result = read_labels(&file);
            assert!(result.is_err(), "{new}: {result:?}");
        });
        assert!(peak < 1 << 20, "{new}: {peak} bytes allocated");
    }
    assert!(read_labels(Scratch::new("nrrd", b"NRRD0005\ntype: uchar")).is_err());
    assert!(read_labels(Scratch::new("nrrd", b"NRRD9999\n\n")).is_err());
}

// ---- Meshes ------------------------------------------------------

const TETRAHEDRON_OBJ: &str = "# a tetrahedron\no body\nv 0 0 0\nv 1 0 0 1.0\nv 0 1 0 0.5 0.5 0.5\nv 0 0 1\n\
    vn 0 0 1\nl 1 2 3 4\nf 1 3 2\nf 1//1 2//1 4//1\nf -3 -2 -1\nf 3 1 4\n";

fn tetrahedron() -> (Vec<[f64; 3]>, [[usize; 3]; 4]) {
    let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    (positions, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
}

fn binary_stl(comment: &[u8]) -> Vec<u8> {
    let (positions, triangles) = tetrahedron();
    let mut file = vec![b' '; 80];
    file[..comment.len()].copy_from_slice(comment);
    file.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        file.extend([0; 12]);
        for x in triangle.iter().flat_map(|&v| positions[v]) {
            file.extend((x as f32).to_le_bytes());
        }
        file.extend([0; 2]);
    }
    file
}

fn text_stl() -> String {
    let (positions, triangles) = tetrahedron();
    // Two solids, the second without a name, and a negative zero: all must meet at the same vertices.
    let mut text = String::from("solid one\n");
    for (n, triangle) in triangles.iter().enumerate() {
        if n == 2 {
            text += "endsolid one\nsolid\n";
        }
        text += "  facet normal 0 0 0\n    outer loop\n";
        for [x, y, z] in triangle.map(|v| positions[v]) {
            text += &format!("      vertex {} {y} {z:e}\n", if n == 3 && x == 0.0 { -0.0 } else { x });
        }
        text += "    endloop\n  endfacet\n";
    }
    text + "endsolid\n"
}

fn text_ply() -> String {
    let (positions, triangles) = tetrahedron();
    let mut text = String::from(
        "ply\nformat ascii 1.0\ncomment scanned\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n",
    );
    positions.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z} 255\n"));
    triangles.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    text
}

fn binary_ply(is_big_endian: bool) -> Vec<u8> {
    let (positions, triangles) = tetrahedron();
    let order = if is_big_endian { "big" } else { "little" };
    let mut file = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty double x\nproperty double y\n\
         property double z\nelement face 4\nproperty list uchar uint vertex_index\nend_header\n"
    )
    .into_bytes();
    let mut put = |mut little: Vec<u8>| {
        if is_big_endian {
            little.reverse();
        }
        file.extend(little);
    };
    positions.iter().flatten().for_each(|x| put(x.to_le_bytes().to_vec()));
    for triangle in triangles {
        put(vec![3]);
        triangle.iter().for_each(|&v| put((v as u32).to_le_bytes().to_vec()));
    }
    file
}

#[test]
fn every_mesh_format_gives_the_same_tetrahedron_in_metres() {
    let files = [
        ("obj", TETRAHEDRON_OBJ.as_bytes().to_vec()),
        ("OBJ", TETRAHEDRON_OBJ.replace('\n', "\r\n").into_bytes()),
        ("stl", binary_stl(b"made by hand")),
        ("stl", binary_stl(b"solid but binary\n")),
        ("stl", text_stl().into_bytes()),
        ("ply", text_ply().into_bytes()),
        ("ply", binary_ply(false)),
        ("ply", binary_ply(true)),
    ];
    let (positions, triangles) = tetrahedron();
    for (n, (extension, bytes)) in files.iter().enumerate() {
        let mesh =
            read_mesh(Scratch::new(extension, bytes), 1e-3).unwrap_or_else(|e| panic!("file {n}: {e}"));
        assert_eq!((mesh.positions.len(), mesh.triangles.len(), mesh.uvs.len()), (4, 4, 0), "file {n}");
        for (triangle, expected) in mesh.triangles.iter().zip(triangles) {
            for (&v, corner) in triangle.iter().zip(expected) {
                let expected = Vector3::from(positions[corner]) * 1e-3;
                assert!((mesh.positions[v as usize] - expected).norm() < 1e-12, "file {n}");
            }
        }
    }
}

#[test]
fn polygons_become_fans_that_keep_their_winding() {
    let pentagon: String = (0..5)
        .map(|n| {
            let (sin, cos) = (f64::from(n) * std::f64::consts::TAU / 5.0).sin_cos();
            format!("v {cos} {sin} 0\n")
        })
        .collect();
    let mesh = read_mesh(Scratch::new("obj", (pentagon + "f 1 2 3 4 5\n").as_bytes()), 1.0).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    let area: f64 = mesh
        .triangles
        .iter()
        .map(|t| t.map(|v| mesh.positions[v as usize]))
        .map(|[a, b, c]| (b - a).cross(&(c - a)).z / 2.0)
        .sum();
    let expected = 2.5 * (std::f64::consts::TAU / 5.0).sin();
    assert!((area - expected).abs() < 1e-12);
}

#[test]
fn obj_seams_repeat_a_vertex_for_each_texture_coordinate() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0.25 0.5\n\
                f 1/1 2/2 3/3\nf 1/4 3/3 4\n";
    let mesh = read_mesh(Scratch::new("obj", text.as_bytes()), 2.0).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [4, 2, 3]]);
    assert_eq!(mesh.positions[4], mesh.positions[0]);
    assert_eq!(mesh.uvs, [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0], [0.25, 0.5]]);
    assert_eq!(mesh.positions[2], Vector3::new(2.0, 2.0, 0.0));
}

#[test]
fn ply_texture_coordinates_are_kept() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                property float z\nproperty float s\nproperty float t\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n0 0 0 0 1\n1 0 0 0.5 0.25\n0 1 0 1 0\n3 0 1 2\n";
    let mesh = read_mesh(Scratch::new("ply", text.as_bytes()), 1.0).unwrap();
    assert_eq!(mesh.uvs, [[0.0, 1.0], [0.5, 0.25], [1.0, 0.0]]);
}

#[test]
fn meshes_that_lie_are_refused() {
    let three = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";
    let obj = |tail: &str| ("obj", (three.to_owned() + tail).into_bytes());
    let ply = |old: &str, new: &str| {
        let text = text_ply();
        assert!(text.contains(old), "{old}");
        ("ply", text.replacen(old, new, 1).into_bytes())
    };
    let stl_count = |count: u32| {
        let mut file = binary_stl(b"");
        file[80..84].copy_from_slice(&count.to_le_bytes());
        ("stl", file)
    };
    let mut nan_stl = binary_stl(b"");
    nan_stl[96..100].copy_from_slice(&f32::NAN.to_le_bytes());

    let cases = [
        obj("f 1 2 4\n"),
        obj("f 0 1 2\n"),
        obj("f -4 1 2\n"),
        obj("f 1 2 -9223372036854775808\n"),
        obj("f 1 2 99999999999999999999\n"),
        obj("f 1/-9223372036854775807 2/1 3/1\n"),
        obj("f 1/2 2/1 3/1\n"),
        obj("f 1 2\n"),
        obj("f\n"),
        obj("f a b c\n"),
        obj("f 1/1/1/1 2 3\n"),
        obj("v 1 2\nf 1 2 3\n"),
        obj("v nan 0 0\nf 1 2 4\n"),
        obj("v 1e999 0 0\nf 1 2 4\n"),
        obj(""),
        ("obj", Vec::new()),
        ("stl", Vec::new()),
        ("stl", b"solid".to_vec()),
        ("stl", b"solid x\nfacet normal 0 0 0\n".to_vec()),
        ("stl", b"solid x\nendsolid x\n".to_vec()),
        ("stl", text_stl().replace("endfacet", "endless").into_bytes()),
        ("stl", text_stl().replacen("vertex 1", "vertex inf", 1).into_bytes()),
        ("stl", nan_stl),
        stl_count(u32::MAX),
        stl_count(3),
        stl_count(0),
        ply("vertex 4", "vertex 4000000000"),
        ply("vertex 4", "vertex 18446744073709551615"),
        ply("face 4", "face 18446744073709551615"),
        ply("face 4", "face 3"),
        ply("face 4", "face 5"),
        ply("property float z\n", ""),
        ply("property float z", "property float x"),
        ply("property float z", "property list uchar int z"),
        ply("element face", "element nothing 999999999999\nelement face"),
        ply("element face 4", "element vertex 4"),
        ply("uchar int vertex_indices", "uchar float vertex_indices"),
        ply("vertex_indices", "corners"),
        ply("3 0 2 1", "3 0 2 9"),
        ply("3 0 2 1", "3 0 2 -1"),
        ply("3 0 2 1", "2 0 2"),
        ply("3 0 2 1", "4000000000 0 2 1"),
        ply("1 0 0 255", "nan 0 0 255"),
        ply("end_header", "end_heading"),
        ("ply", b"ply\n".to_vec()),
    ];
    for (n, (extension, bytes)) in cases.iter().enumerate() {
        let file = Scratch::new(extension, bytes);
        let peak = peak_of(|| {
            let result = read_mesh(&file, 1.0);
            assert!(result.is_err(), "case {n}, {}: {result:?}", String::from_utf8_lossy(bytes));
        });
        assert!(peak < 1 << 20, "case {n}: {peak} bytes allocated");
    }
}

#[test]
fn what_is_no_mesh_or_no_file_is_an_error() {
    let good = Scratch::new("obj", TETRAHEDRON_OBJ.as_bytes());
    for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(read_mesh(&good, scale), Err(Error::Argument(_))));
    }
    assert!(matches!(read_mesh(&good, 1e308 * 10.0), Err(Error::Argument(_))));
    assert!(matches!(read_mesh(Scratch::new("fbx", b"x"), 1.0), Err(Error::Unsupported(_))));
    assert!(matches!(read_mesh("no such file.obj", 1.0), Err(Error::Io { .. })));
    assert!(matches!(read_labels("no such file.nii"), Err(Error::Io { .. })));
    assert!(matches!(read_labels(std::env::temp_dir()), Err(Error::Io { .. })));
}

// ---- Damage ------------------------------------------------------

/// Counts the bytes that the current thread holds and has held at most.
struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(change: isize) {
    // A thread that is ending has no counters any more, and no test looks at it.
    let _ = HELD.try_with(|held| {
        held.set(held.get() + change);
        PEAK.with(|peak| peak.set(peak.get().max(held.get())));
    });
}

// SAFETY: every call is passed on unchanged to the system's allocator; only numbers are kept besides.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller's promises are the system allocator's conditions.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: as above; `pointer` came from `System`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The most bytes that `work` held at once on this thread.
fn peak_of(work: impl FnOnce()) -> isize {
    let before = HELD.get();
    PEAK.set(before);
    work();
    PEAK.get() - before
}

/// One file of each kind, all valid.
fn valid_files() -> Vec<(&'static str, Vec<u8>)> {
    let nifti = Nifti::new([2, 3, 4], Nifti::UINT8).sform(&oblique()).with(&bytes_0_to(24));
    let short = "type: ushort\nendian: little\nencoding: gzip";
    let little: Vec<u8> = (0..24_u16).flat_map(u16::to_le_bytes).collect();
    let text: String = (0..24).map(|n| format!("{n} ")).collect();
    vec![
        ("nii", nifti.clone()),
        ("nii.gz", gzip(&nifti)),
        ("nrrd", nrrd(&nrrd_header(&oblique(), "LPS", [-1.0, -1.0, 1.0], short), &gzip(&little))),
        (
            "nrrd",
            nrrd("type: int\ndimension: 3\nsizes: 2 3 4\nspacings: 1 1 1\nencoding: text", text.as_bytes()),
        ),
        ("obj", TETRAHEDRON_OBJ.as_bytes().to_vec()),
        ("stl", binary_stl(b"")),
        ("stl", text_stl().into_bytes()),
        ("ply", text_ply().into_bytes()),
        ("ply", binary_ply(false)),
        ("ply", binary_ply(true)),
    ]
}

/// Reads a file of any kind; the answer does not matter, that there is one does.
fn read_any(extension: &str, bytes: &[u8]) -> bool {
    let file = Scratch::new(extension, bytes);
    match extension {
        "obj" | "stl" | "ply" => read_mesh(&file, 1.0).is_ok(),
        _ => {
            let labels = read_labels(&file).is_ok();
            read_intensities(&file).is_ok() || labels
        }
    }
}

#[test]
fn damaged_files_never_panic_and_allocate_no_more_than_they_could_hold() {
    let files = valid_files();
    assert!(files.iter().all(|(extension, bytes)| read_any(extension, bytes)));

    let edit = (
        any::<prop::sample::Index>(),
        prop_oneof![any::<u8>(), Just(b'-'), Just(b'9'), Just(b' '), Just(0xff)],
    );
    let damage = (
        0..files.len(),
        prop::collection::vec(edit, 0..8),
        prop::option::of(any::<prop::sample::Index>()),
        prop::option::of((any::<prop::sample::Index>(), any::<prop::sample::Index>())),
    );
    let config = Config { cases: 4000, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    runner
        .run(&damage, |(which, edits, cut, swap)| {
            let (extension, mut bytes) = files[which].clone();
            for (place, value) in edits {
                let place = place.index(bytes.len());
                bytes[place] = value;
            }
            if let Some((a, b)) = swap {
                // A piece repeated elsewhere keeps the words of a text valid and its structure not.
                let (a, b) = (a.index(bytes.len()), b.index(bytes.len()));
                let piece = bytes[a.min(b)..a.max(b)].to_vec();
                bytes.splice(a..a, piece);
            }
            if let Some(cut) = cut {
                bytes.truncate(cut.index(bytes.len() + 1));
            }
            let size = bytes.len() as isize;
            let peak = peak_of(|| {
                read_any(extension, &bytes);
            });
            // Two bytes for each byte that deflate can make of one, three buffers, and the list that PLY
            // prepares.
            let most = 8 * 1032 * size + (2 << 20);
            prop_assert!(peak <= most, "{peak} bytes for a {extension} file of {size}");
            Ok(())
        })
        .unwrap();
}

#[test]
fn every_truncation_of_every_file_is_refused_or_loses_only_blank_space() {
    for (extension, bytes) in valid_files() {
        for length in 0..bytes.len() {
            let (kept, lost) = bytes.split_at(length);
            // OBJ has no end mark, and a text STL may end after any solid: what stands before the cut is a
            // file of its own.
            let last_line = kept.trim_ascii_end().rsplit(|&b| b == b'\n').next().unwrap_or_default();
            let is_whole = match extension {
                "obj" => true,
                "stl" => last_line.trim_ascii().starts_with(b"endsolid"),
                // The last number of a text may lose a digit.
                "nrrd" => lost.len() < 3,
                _ => false,
            };
            assert!(
                is_whole || lost.trim_ascii().is_empty() || !read_any(extension, kept),
                "{extension} cut to {length} of {} bytes was accepted",
                bytes.len()
            );
        }
    }
}

#[test]
fn noise_is_refused() {
    let config = Config { cases: 1000, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let starts = ["", "NRRD0005\n", "\u{1f}", "ply\n", "solid ", "v "];
    let noise = (0..starts.len(), prop::collection::vec(any::<u8>(), 0..600), 0..5_usize);
    runner
        .run(&noise, |(start, noise, extension)| {
            let bytes = [starts[start].as_bytes(), &noise].concat();
            let extension = ["nii", "nrrd", "obj", "stl", "ply"][extension];
            prop_assert!(!read_any(extension, &bytes));
            Ok(())
        })
        .unwrap();
}

// ---- Real anatomy ------------------------------------------------

/// A file of the test data, or nothing and a loud word about it. A build server must have the data.
fn real_file(name: &str) -> Option<PathBuf> {
    match std::env::var_os("PALPATE_DATA") {
        Some(folder) => Some(Path::new(&folder).join(name)),
        None => {
            assert!(
                std::env::var_os("CI").is_none(),
                "PALPATE_DATA must name the folder of test data under CI"
            );
            eprintln!("\n==== SKIPPED: {name} is not read, because PALPATE_DATA names no folder ====\n");
            None
        }
    }
}

fn histogram(grid: &LabelGrid) -> Vec<usize> {
    let mut counts = vec![0; 11];
    grid.labels().iter().for_each(|&l| counts[usize::from(l)] += 1);
    counts
}

#[test]
fn real_labels_have_the_documented_counts() {
    let Some(path) = real_file("thorax_labels.nii.gz") else { return };
    let grid = read_labels(path).unwrap();

    assert_eq!(grid.dims(), [120, 126, 164]);
    assert!((grid.spacing() - Vector3::repeat(1.5e-3)).norm() < 1e-12);
    let documented =
        [102_424, 793_934, 34_358, 8_742, 726_932, 242_936, 310_511, 72_810, 7_113, 122_763, 57_157];
    assert_eq!(histogram(&grid), documented);
    assert_eq!(grid.resample(1.5e-3, ResampleRule::Majority).unwrap().labels(), grid.labels());

    // Without 0 and 3, taking every second voxel.
    let coarse = grid.resample(3e-3, ResampleRule::Nearest).unwrap();
    let counts = histogram(&coarse);
    assert_eq!(coarse.labels().len() - counts[0] - counts[3], 295_903);
    assert_eq!(counts[1] + counts[2] + counts[8], 104_496);
}

#[test]
fn real_anatomy_stands_upright_in_ras() {
    let Some(path) = real_file("thorax_labels.nii.gz") else { return };
    let grid = read_labels(path).unwrap();
    // The mean place of a label: bone is mostly spine, so it lies behind the heart; the spleen is on the
    // left, below the heart.
    let mean = |label: u16| {
        let [nx, ny, _] = grid.dims();
        let places = grid.labels().iter().enumerate().filter(|&(_, &l)| l == label).map(|(n, _)| n);
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for n in places {
            sum += Vector3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64);
            count += 1.0;
        }
        (grid.frame() * Point3::from((sum / count).component_mul(&grid.spacing()))).coords
    };
    let (heart, bone, spleen) = (mean(5), mean(9), mean(10));
    assert!(bone.y < heart.y, "the spine must lie behind the heart");
    assert!(spleen.z < heart.z, "the spleen must lie below the heart");
}

#[test]
fn real_scan_is_in_hounsfield_units() {
    let (Some(scan), Some(labels)) = (real_file("thorax_ct.nii.gz"), real_file("thorax_labels.nii.gz"))
    else {
        return;
    };
    let (scan, labels) = (read_intensities(scan).unwrap(), read_labels(labels).unwrap());
    assert_eq!((scan.dims(), scan.frame()), (labels.dims(), labels.frame()));
    let mean = |label: u16| {
        let inside = scan.values().iter().zip(labels.labels()).filter(|&(_, &l)| l == label);
        let (sum, count) = inside.fold((0.0, 0.0), |(s, n), (&v, _)| (s + f64::from(v), n + 1.0));
        sum / count
    };
    assert!((-950.0..-650.0).contains(&mean(1)), "lung {}", mean(1));
    assert!((-130.0..-50.0).contains(&mean(6)), "fat {}", mean(6));
    assert!((-1010.0..-930.0).contains(&mean(3)), "air {}", mean(3));
    assert!(mean(9) > 150.0, "bone {}", mean(9));
}
