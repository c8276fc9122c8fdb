//! How far a cut opens in tissue that is pulled.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse};
use palpate::sim::{Precision, Sim, SimDesc};
use palpate::solver::load::{Load, Region};
use palpate::solver::method::{EfgDesc, Elasticity, Method};

const CELL_M: f64 = 2e-3;
/// Cells of the body, and in the radius of the cut.
const CELLS: [usize; 3] = [28, 28, 24];
const RADIUS: f64 = 5.0;
/// Pa, and Poisson's ratio.
const YOUNG_PA: f64 = 1e4;
const POISSON: f64 = 0.3;
const TENSION_PA: f64 = 200.0;

/// A penny-shaped cut of radius a in tension σ opens by 8 (1 − ν²) σ a ÷ (π E) in its middle (Sneddon 1946). The cells in which the rim stands stay whole, so that the cut is smaller by
/// half a cell on the average and one at most; and the body is finite: half its width is 2.8 a, where a cylinder's cut opens by some 5 % more.
#[test]
fn a_penny_shaped_cut_opens_as_elasticity_says() {
    let middle = Pose::translation(0.5 * CELL_M, 0.5 * CELL_M, 0.5 * CELL_M);
    let labels = vec![1; CELLS.iter().product()];
    let mut build = Build::new(LabelGrid::new(CELLS, Vec3::repeat(CELL_M), middle, labels).unwrap());
    build.uses =
        BTreeMap::from([(1, LabelUse::Tissue(Material::new("tissue", YOUNG_PA, POISSON, 1000.0).unwrap()))]);
    // Supported below along z, and at one corner and an edge against sliding and turning.
    let size = Vec3::from(CELLS.map(|n| n as f64 * CELL_M));
    let slab = Vec3::new(1.0, 1.0, 0.1 * CELL_M);
    build.fixes.push(Fix { pose: Pose::identity(), half_extents: slab, axes: [false, false, true] });
    let corner = Vec3::repeat(0.1 * CELL_M);
    build.fixes.push(Fix { pose: Pose::identity(), half_extents: corner, axes: [true, true, false] });
    let other = Pose::translation(size.x, 0.0, 0.0);
    build.fixes.push(Fix { pose: other, half_extents: corner, axes: [false, true, false] });
    let model = Arc::new(build.run(&mut |_, _| true).unwrap());
    let elasticity = Elasticity::Linear;
    let desc = SimDesc {
        method: Method::Efg(EfgDesc {
            elasticity,
            tolerance: 1e-6,
            max_iterations: 3000,
            ..EfgDesc::default()
        }),
        precision: Precision::Double,
        threads: 2,
        cut_nodes: 2000,
        ..SimDesc::default()
    };
    let mut sim = Sim::new(model, &desc).unwrap();

    // An edge along y whose ends follow the circle.
    let centre = 0.5 * size + Vec3::z() * 0.37 * CELL_M;
    let edge = |x: f64| {
        let half = (RADIUS * RADIUS - x * x).max(0.0).sqrt();
        [-half, half].map(|y| centre + Vec3::new(x, y, 0.0) * CELL_M)
    };
    let steps = 100;
    let x = |n: i32| RADIUS * (2.0 * f64::from(n) / f64::from(steps) - 1.0);
    for n in 0..steps {
        sim.cut(&edge(x(n)), &edge(x(n + 1))).unwrap();
    }
    assert_eq!(sim.parts().len(), 1);
    let top = Region {
        pose: Pose::translation(0.5 * size.x, 0.5 * size.y, size.z),
        half_extents_m: Vec3::new(1.0, 1.0, 0.1 * CELL_M),
    };
    sim.add_load(&Load::Traction { region: top, traction_pa: Vec3::z() * TENSION_PA }).unwrap();
    sim.settle(1e-3, 200).unwrap();

    // Walls around the middle, above and below.
    let mut surface = sim.open_surface(0).unwrap();
    let frame = surface.map().unwrap();
    let walls = frame.triangles[frame.first_wall..].iter().flatten().map(|&v| frame.positions[v as usize]);
    let near =
        walls.filter(|p| (f64::from(p[0]) - centre.x).hypot(f64::from(p[1]) - centre.y) < 0.8 * CELL_M);
    let heights: Vec<f64> = near.map(|p| f64::from(p[2])).collect();
    let (low, high) = heights.iter().fold((f64::MAX, f64::MIN), |(low, high), &z| (low.min(z), high.max(z)));
    let opening = high - low;
    let radius = RADIUS * CELL_M;
    let expected = 8.0 * (1.0 - POISSON * POISSON) * TENSION_PA * radius / (std::f64::consts::PI * YOUNG_PA);
    let share = opening / expected;
    assert!(share > 1.0 - 1.0 / RADIUS && share < 1.05, "{share} of {expected} m");
}
