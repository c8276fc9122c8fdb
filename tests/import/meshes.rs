//! OBJ, STL and PLY: the same shape from each, and meshes that lie.

use nalgebra::Vector3;
use palpate::error::Error;
use palpate::model::import::{read_labels, read_mesh};

use crate::files::Scratch;
use crate::memory::peak_of;

pub const TETRAHEDRON_OBJ: &str = "# a tetrahedron\no body\nv 0 0 0\nv 1 0 0 1.0\nv 0 1 0 0.5 0.5 0.5\nv 0 0 1\n\
    vn 0 0 1\nl 1 2 3 4\nf 1 3 2\nf 1//1 2//1 4//1\nf -3 -2 -1\nf 3 1 4\n";

fn tetrahedron() -> (Vec<[f64; 3]>, [[usize; 3]; 4]) {
    let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    (positions, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
}

pub fn binary_stl(comment: &[u8]) -> Vec<u8> {
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

pub fn text_stl() -> String {
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

pub fn text_ply() -> String {
    let (positions, triangles) = tetrahedron();
    let mut text = String::from(
        "ply\nformat ascii 1.0\ncomment scanned\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n",
    );
    positions.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z} 255\n"));
    triangles.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    text
}

pub fn binary_ply(is_big_endian: bool) -> Vec<u8> {
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
