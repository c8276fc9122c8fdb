//! Scene `ellipsoid`: axes 1 : 0.7 : 0.5, one material, the lowest part held, a sphere pressed in from above.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::error::Result;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};

use super::measure::{Scene, measure, simulation};
use super::options::Options;
use super::press::Press;
use super::report::Report;

/// Edge length of a cell in m.
const CELL_M: f64 = 2e-3;
/// Semi-axes by the longest one.
const SHAPE: [f64; 3] = [1.0, 0.7, 0.5];
/// Nodes when the command line names none.
const SIZES: [usize; 4] = [4_000, 34_108, 82_105, 262_144];
/// Soft enough for one or two substeps in a millisecond, as in the fastest tissue that presets know.
const YOUNG_PA: f64 = 3e3;
/// Without and with the volume term.
const POISSON: [f64; 2] = [0.25, 0.45];
const DENSITY_KG_M3: f64 = 1000.0;
/// Share of the height, from below, that is held.
const HELD: f64 = 0.15;

/// Runs all sizes and Poisson's ratios that the options ask for.
pub fn run(options: &Options, report: &mut Report) {
    let sizes = options.nodes.map_or(SIZES.to_vec(), |n| vec![n]);
    let ratios = options.nu.map_or(POISSON.to_vec(), |nu| vec![nu]);
    for nodes in sizes {
        for &poisson in &ratios {
            match scene(nodes, poisson, options) {
                Ok(scene) => report.add(&measure(&scene, options)),
                Err(error) => report.fail("ellipsoid", &error.to_string()),
            }
        }
    }
}

fn scene(nodes: usize, poisson: f64, options: &Options) -> Result<Scene> {
    let young_pa = options.young.unwrap_or(YOUNG_PA);
    let model = Arc::new(model(nodes, Material::new("tissue", young_pa, poisson, DENSITY_KG_M3)?)?);
    let top = simulation(model.clone(), false, options)?.pick(Vec3::z(), -Vec3::z())?;
    let press = Press {
        radius_m: 5.0 * CELL_M,
        friction: 0.3,
        point_m: top.expect("the ellipsoid lies around the origin").point_m,
        direction: -Vec3::z(),
        gap_m: 0.5 * CELL_M,
        depth_m: 3.0 * CELL_M,
        speed_m_s: 0.03,
        circle_m: CELL_M,
    };
    Ok(Scene {
        name: "ellipsoid".into(),
        model,
        measured_from_m: press.depth_m,
        press,
        sleeping: false,
        young_pa: Some(young_pa),
        young_cap_pa: None,
        poisson: Some(poisson),
    })
}

/// An ellipsoid around the origin with as nearly so many nodes as there can be.
fn model(nodes: usize, material: Material) -> Result<Model> {
    let (dims, labels) = voxels(semi_axis(nodes));
    let low = Vec3::from_fn(|a, _| -0.5 * dims[a] as f64 * CELL_M);
    let centre = low + Vec3::repeat(0.5 * CELL_M);
    let frame = Pose::translation(centre.x, centre.y, centre.z);
    let mut build = Build::new(LabelGrid::new(dims, Vec3::repeat(CELL_M), frame, labels)?);
    build.uses = BTreeMap::from([(0, LabelUse::Empty), (1, LabelUse::Tissue(material))]);
    build.fixes.push(Fix {
        pose: Pose::translation(0.0, 0.0, low.z),
        half_extents: Vec3::new(1.0, 1.0, -2.0 * HELD * low.z),
        axes: [true; 3],
    });
    build.run(&mut |_, _| true)
}

/// The longest semi-axis, in cells, whose ellipsoid comes nearest to a number of nodes.
fn semi_axis(nodes: usize) -> f64 {
    let count = |axis: f64| {
        let (dims, labels) = voxels(axis);
        let side = dims.map(|n| n + 1);
        let mut is_node = vec![false; side.iter().product()];
        for cell in (0..labels.len()).filter(|&cell| labels[cell] != 0) {
            let at = [cell % dims[0], cell / dims[0] % dims[1], cell / (dims[0] * dims[1])];
            for corner in 0..8 {
                let node = [0, 1, 2].map(|a| at[a] + (corner >> a & 1));
                is_node[node[0] + side[0] * (node[1] + side[1] * node[2])] = true;
            }
        }
        is_node.iter().filter(|&&is| is).count()
    };
    let guess = (nodes as f64 / (4.0 / 3.0 * std::f64::consts::PI * 0.35)).cbrt();
    let (mut low, mut high) = (0.5 * guess, guess + 2.0);
    let mut best = (usize::MAX, guess);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        let found = count(middle);
        best = if found.abs_diff(nodes) < best.0 { (found.abs_diff(nodes), middle) } else { best };
        if found < nodes { low = middle } else { high = middle }
    }
    best.1
}

/// Cells whose centres lie in the ellipsoid.
fn voxels(semi_axis: f64) -> ([usize; 3], Vec<u16>) {
    let axes = SHAPE.map(|share| share * semi_axis);
    let dims = axes.map(|axis| 2 * axis.ceil() as usize);
    let mut labels = Vec::with_capacity(dims.iter().product());
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let p =
                    [(i, 0), (j, 1), (k, 2)].map(|(i, a)| (i as f64 + 0.5 - 0.5 * dims[a] as f64) / axes[a]);
                labels.push(u16::from(p.iter().map(|x| x * x).sum::<f64>() < 1.0));
            }
        }
    }
    (dims, labels)
}
