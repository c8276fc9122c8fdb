//! Archives of models: what is loaded is what was saved, to the last bit, and what is damaged or forged is refused.

use std::collections::BTreeMap;
use std::ffi::CString;
use std::sync::Arc;

use palpate::capi::model::{plp_model_destroy, plp_model_get_info, plp_model_load, plp_model_save};
use palpate::capi::status::{PLP_ERR_FORMAT, PLP_ERR_INVALID_HANDLE, PLP_ERR_IO, PLP_ERR_NULL, PLP_OK};
use palpate::capi::types::{plp_model, plp_model_info};
use palpate::error::Error;
use palpate::math::{Pose, Quat, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::mesh::TriangleMesh;
use palpate::model::{Build, Fix, LabelUse, Model, SurfaceSource};
use palpate::sim::{NodeField, Precision, Sim, SimDesc};
use palpate::solver::method::{EfgDesc, Method};
use palpate::solver::tool::{ToolDesc, ToolMotion};

const H: f64 = 4e-3;
const CELLS: [usize; 3] = [9, 6, 5];

/// Two tissues with damping and a bone, held at one side, somewhere in the world, with an extracted surface and a host's.
fn build() -> Build {
    let label = |n: usize| match [n % CELLS[0], n / CELLS[0] % CELLS[1], n / (CELLS[0] * CELLS[1])] {
        [1, 1..=3, 1..=2] => 3,
        [7 | 8, _, 4] => 0,
        [x, ..] => 1 + u16::from(x > 5),
    };
    let labels = (0..CELLS.iter().product()).map(label).collect();
    let turn = Quat::from_euler_angles(0.3, -0.2, 0.9);
    let frame = Pose::from_parts(Vec3::new(0.1, -2.0, 0.03).into(), turn);
    let mut build = Build::new(LabelGrid::new(CELLS, Vec3::repeat(H), frame, labels).unwrap());
    let tissue = |name: &str, young_pa, damping_s| Material {
        damping_s,
        ..Material::new(name, young_pa, 0.45, 1000.0).unwrap()
    };
    build.uses = BTreeMap::from([
        (0, LabelUse::Empty),
        (1, LabelUse::Tissue(tissue("fat", 3e3, 1e-4))),
        (2, LabelUse::Tissue(tissue("muscle", 9e3, 0.0))),
        (3, LabelUse::Rigid(tissue("bone", 1e9, 0.0))),
    ]);
    build.fix_faces[4] = true;
    build.fixes = vec![Fix {
        pose: frame * Pose::translation(0.0, 0.0, 2.0 * H),
        half_extents: Vec3::repeat(0.6 * H),
        axes: [false, true, false],
    }];
    let corners = [[1.0, 1.0, 4.4], [4.0, 1.0, 4.4], [4.0, 4.0, 4.4], [1.0, 4.0, 4.4]];
    let mesh = TriangleMesh {
        positions: corners.map(|p| (frame * nalgebra::Point3::from(Vec3::from(p) * H)).coords).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        uvs: vec![[0.0, 0.5], [1.0, 0.25], [0.125, 1.0], [0.0, 0.0]],
    };
    build.surfaces = vec![SurfaceSource::Labels(vec![1, 2]), SurfaceSource::Mesh(mesh)];
    build.contact_surface = None;
    build
}

fn model() -> Model {
    build().run(&mut |_, _| true).unwrap()
}

/// Displacements of all nodes after a press, and the force on the tool.
fn pressed(model: &Arc<Model>, method: Method) -> (Vec<Vec3>, Vec3) {
    let desc = SimDesc { method, precision: Precision::Double, threads: 1, ..SimDesc::default() };
    let mut sim = Sim::new(model.clone(), &desc).unwrap();
    let mut tool = sim.add_tool(&ToolDesc { friction: 0.2, ..ToolDesc::sphere(0.01) }).unwrap();
    for step in 0..30 {
        let above = Vec3::new(3.0 * H, 3.0 * H, 5.0 * H + 0.009 - 1e-4 * f64::from(step));
        let at = model.frame() * Pose::translation(above.x, above.y, above.z);
        tool.set_motion(&ToolMotion::at(at)).unwrap();
        sim.step().unwrap();
    }
    (sim.nodes(NodeField::Displacement), tool.force().wrench.force_n)
}

#[test]
fn a_loaded_model_does_the_same_to_the_last_bit() {
    let built = model();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("chest.plp");
    built.save(&path).unwrap();
    let loaded = Model::load(&path).unwrap();

    // All that can be read of it, to the last digit.
    assert_eq!(format!("{loaded:?}"), format!("{built:?}"));
    let (built, loaded) = (Arc::new(built), Arc::new(loaded));
    for method in [Method::Lattice, Method::Efg(EfgDesc::default())] {
        let (first, again) = (pressed(&built, method), pressed(&loaded, method));
        assert!(first.1.norm() > 1e-3, "{:?} is felt", first.1);
        assert!(first == again, "{method:?}");
    }
}

#[test]
fn an_archive_of_a_loaded_model_is_the_same_archive() {
    let bytes = model().to_bytes().unwrap();
    let again = Model::from_bytes("archive", &bytes).unwrap().to_bytes().unwrap();
    assert!(bytes == again);
}

fn refusal(bytes: &[u8]) -> String {
    match Model::from_bytes("archive", bytes) {
        Err(Error::Format { what, reason }) if what == "archive" => reason,
        other => panic!("{other:?}"),
    }
}

#[test]
fn damaged_archives_are_refused_with_the_reason() {
    let good = model().to_bytes().unwrap();
    for length in (0..good.len()).step_by(97).chain([23, 24, good.len() - 1]) {
        refusal(&good[..length]);
    }
    for at in (0..good.len()).step_by(131).chain(0..64) {
        let mut bad = good.clone();
        bad[at] ^= 1 << (at % 8);
        refusal(&bad);
    }
    let with = |at: usize, byte: u8| {
        let mut bad = good.clone();
        bad[at] = byte;
        bad
    };
    assert!(refusal(b"").contains("not an archive"));
    assert!(refusal(&with(0, b'X')).contains("not an archive"));
    assert!(refusal(&with(8, 2)).contains("version 2"));
    assert!(refusal(&with(18, 1)).contains("are promised"));
    assert!(refusal(&with(good.len() / 2, !good[good.len() / 2])).contains("checksum"));
    assert!(refusal(&[good.clone(), vec![0]].concat()).contains("are promised"));
}

/// An archive of these contents with a right header.
fn sealed(contents: &[u8]) -> Vec<u8> {
    let mut bytes = b"PLPMODEL\x01\0\0\0".to_vec();
    bytes.extend((contents.len() as u64).to_le_bytes());
    bytes.extend(crc32fast::hash(contents).to_le_bytes());
    bytes.extend(contents);
    bytes
}

#[test]
fn forged_archives_are_refused_or_are_models() {
    let good = model().to_bytes().unwrap();
    let contents = &good[24..];
    assert!(sealed(contents) == good);
    assert!(refusal(&sealed(&[contents, &[0]].concat())).contains("follow the model"));
    assert!(refusal(&sealed(&contents[..contents.len() / 2])).contains("no model"));

    let (mut state, mut refused, mut taken) = (1_u64, 0, 0);
    let mut draw = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for _ in 0..1500 {
        let mut forged = contents.to_vec();
        for _ in 0..=draw(3) {
            let at = if draw(2) == 0 { draw(600) } else { draw(forged.len()) };
            forged[at] = [0, 1, 0x7f, 0x80, 0xff, draw(256) as u8][draw(6)];
        }
        match Model::from_bytes("archive", &sealed(&forged)) {
            Err(Error::Format { .. }) => refused += 1,
            Err(other) => panic!("{other:?}"),
            // What it holds is wrong in no way that breaks a simulation.
            Ok(model) => {
                taken += 1;
                let desc = SimDesc { threads: 1, substeps: Some(1), ..SimDesc::default() };
                let Ok(mut sim) = Sim::new(Arc::new(model), &desc) else { continue };
                let _ = sim.step();
                for index in 0..sim.model().surfaces().len() {
                    let _ = sim.open_surface(index).unwrap().map();
                }
            }
        }
    }
    assert!(refused > 300 && taken > 100, "{refused} refused, {taken} taken");
}

#[test]
fn a_grid_of_other_cells_than_there_are_materials_for_is_refused() {
    let good = model().to_bytes().unwrap();
    let mut forged = good[24..].to_vec();
    // Behind the cell's size stand the counts.
    assert_eq!(forged[8..11], CELLS.map(|n| n as u8));
    forged[8] += 1;
    assert!(refusal(&sealed(&forged)).contains("270 cells for a grid of [10, 6, 5] cells"));
    // A promise of 2⁶³ cells, which takes no memory.
    forged.splice(8..9, [0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x01]);
    assert!(refusal(&sealed(&forged)).contains("more than"));
}

#[test]
fn models_go_through_c_to_a_file_and_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| CString::new(dir.path().join(name).to_str().unwrap()).unwrap();
    let built = model();
    built.save(dir.path().join("a")).unwrap();
    std::fs::write(dir.path().join("bad"), b"PLPMODEL and nothing else").unwrap();

    let untouched = std::ptr::dangling_mut::<plp_model>();
    let mut model = untouched;
    // SAFETY: paths are strings, and everything lives until the calls return.
    unsafe {
        for (name, status) in [("none", PLP_ERR_IO), ("bad", PLP_ERR_FORMAT), ("", PLP_ERR_IO)] {
            assert_eq!(plp_model_load(path(name).as_ptr(), &raw mut model), status, "{name}");
            assert_eq!(model, untouched);
        }
        assert_eq!(plp_model_load(std::ptr::null(), &raw mut model), PLP_ERR_NULL);
        assert_eq!(plp_model_load(path("a").as_ptr(), std::ptr::null_mut()), PLP_ERR_NULL);
        assert_eq!(plp_model_load(path("a").as_ptr(), &raw mut model), PLP_OK);

        let mut info: plp_model_info = std::mem::zeroed();
        assert_eq!(plp_model_get_info(model, &raw mut info, size_of::<plp_model_info>() as u32), PLP_OK);
        assert_eq!(info.node_count, built.lattice().node_count() as u64);

        assert_eq!(plp_model_save(model, std::ptr::null()), PLP_ERR_NULL);
        assert_eq!(plp_model_save(model, path("no/folder").as_ptr()), PLP_ERR_IO);
        assert_eq!(plp_model_save(model, path("b").as_ptr()), PLP_OK);
        assert_eq!(plp_model_destroy(model), PLP_OK);
        assert_eq!(plp_model_save(model, path("b").as_ptr()), PLP_ERR_INVALID_HANDLE);
    }
    let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
    assert!(read("a") == read("b"));
}
