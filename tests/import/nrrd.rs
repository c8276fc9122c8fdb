//! NRRD: spaces, encodings, axes, and headers that lie.

use nalgebra::Matrix3x4;
use palpate::error::Error;
use palpate::model::import::read_labels;

use crate::files::{Scratch, gzip};
use crate::memory::peak_of;
use crate::nifti::{assert_places, bytes_0_to, oblique};

pub fn nrrd(header: &str, data: &[u8]) -> Vec<u8> {
    [format!("NRRD0005\n# a comment\n{header}\n\n").as_bytes(), data].concat()
}

fn vector(v: impl Iterator<Item = f64>) -> String {
    let parts: Vec<String> = v.map(|x| x.to_string()).collect();
    format!("({})", parts.join(","))
}

/// A header whose voxels lie where `affine` (RAS, mm) puts them, written in `space` whose axes have these
/// signs.
pub fn nrrd_header(affine: &Matrix3x4<f64>, space: &str, signs: [f64; 3], rest: &str) -> String {
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
