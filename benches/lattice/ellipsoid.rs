//! Scene `ellipsoid`: axes 1 : 0.7 : 0.5, one material, the lowest part held, a sphere pressed in from above.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::error::Result;
use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};

use super::common::place::Backend;
use super::measure::{Scene, measure};
use super::options::Options;
use super::pace::Pace;
use super::press::{Press, radius};
use super::report::Report;

/// Edge length of a cell in m.
const CELL_M: f64 = 2e-3;
/// Semi-axes by the longest one.
const SHAPE: [f64; 3] = [1.0, 0.7, 0.5];
/// Nodes when the command line names none.
const CPU_SIZES: &[usize] = &[4_000, 34_108, 82_105, 262_144];
const CUDA_SIZES: &[usize] = &[34_108, 82_105, 150_250, 1_000_000, 16_000_000];
/// Soft enough for one or two substeps in a millisecond, as in the fastest tissue that presets know.
const CPU_YOUNG_PA: f64 = 3e3;
/// The stiffest that the thorax keeps: a hundred substeps are 12 to 20 ms, in which the tool moves by a third of a cell at most.
const CUDA_YOUNG_PA: f64 = 20e3;
/// Without and with the volume term.
const POISSON: [f64; 2] = [0.25, 0.45];
const DENSITY_KG_M3: f64 = 1000.0;
/// Size and depth of the press: so shallow that no cell turns inside out, and forces grow as Young's modulus does.
const RADIUS_M: f64 = 8.0 * CELL_M;
const DEPTH_M: f64 = 2.0 * CELL_M;
/// Share of the height, from below, that is held.
const HELD: f64 = 0.15;

/// Runs all sizes and Poisson's ratios that the options ask for.
pub fn run(options: &Options, report: &mut Report) {
    for nodes in sizes(options) {
        for poisson in ratios(options) {
            match scene(nodes, poisson, options) {
                Ok(scene) => report.add(measure(&scene, options)),
                Err(error) => report.fail("ellipsoid", &error.to_string()),
            }
        }
    }
}

/// Numbers of nodes that the options ask for.
pub fn sizes(options: &Options) -> Vec<usize> {
    let all = match options.machine.backend {
        Backend::Cpu => CPU_SIZES,
        Backend::Cuda => CUDA_SIZES,
    };
    options.nodes.map_or(all.to_vec(), |nodes| vec![nodes])
}

/// Poisson's ratios that the options ask for.
pub fn ratios(options: &Options) -> Vec<f64> {
    options.nu.map_or(POISSON.to_vec(), |nu| vec![nu])
}

/// The ellipsoid with as nearly so many nodes as there can be.
pub fn scene(nodes: usize, poisson: f64, options: &Options) -> Result<Scene> {
    let young_pa = options.young.unwrap_or(match options.machine.backend {
        Backend::Cpu => CPU_YOUNG_PA,
        Backend::Cuda => CUDA_YOUNG_PA,
    });
    let model = Arc::new(model(nodes, Material::new("tissue", young_pa, poisson, DENSITY_KG_M3)?)?);
    let press = Press {
        radius_m: radius(RADIUS_M, &model),
        friction: 0.3,
        point_m: Vec3::z() * highest(&model),
        direction: -Vec3::z(),
        gap_m: 0.5 * CELL_M,
        depth_m: DEPTH_M,
        speed_m_s: 0.03,
        circle_m: CELL_M,
    };
    Ok(Scene {
        name: "ellipsoid".into(),
        pace: Pace::of(options, &model),
        model,
        measured_from_m: press.depth_m,
        press,
        sleeping: false,
        young_pa: Some(young_pa),
        young_cap_pa: None,
        poisson: Some(poisson),
    })
}

/// Height of the contact surface's highest vertex, world frame, in m.
fn highest(model: &Model) -> f64 {
    let vertices = model.surfaces()[model.contact_surface()].positions.iter();
    let heights = vertices.map(|vertex| model.frame().transform_point(&(*vertex).into()).z);
    heights.fold(f64::NEG_INFINITY, f64::max)
}

/// An ellipsoid around the origin with as nearly so many nodes as there can be.
pub fn model(nodes: usize, material: Material) -> Result<Model> {
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
pub fn semi_axis(nodes: usize) -> f64 {
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

/// Nodes of the ellipsoid with a longest semi-axis of so many cells.
pub fn count(semi_axis: f64) -> usize {
    let axes = SHAPE.map(|share| share * semi_axis);
    // On either side of the middle a row of nodes reaches as far as the longest row of cells that it touches: the one nearest to the middle.
    let reach = |row: [usize; 2]| {
        let [y, z] = [0, 1].map(|a| (row[a].saturating_sub(1) as f64 + 0.5) / axes[a + 1]);
        (axes[0] * (1.0 - y * y - z * z).max(0.0).sqrt() - 0.5).ceil().max(0.0) as usize
    };
    let sides = |n: usize| if n == 0 { 1 } else { 2 };
    let [_, ny, nz] = axes.map(|axis| axis.ceil() as usize);
    let rows = (0..=nz).flat_map(|k| (0..=ny).map(move |j| [j, k]));
    rows.map(|row| match reach(row) {
        0 => 0,
        cells => sides(row[0]) * sides(row[1]) * (2 * cells + 1),
    })
    .sum()
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
