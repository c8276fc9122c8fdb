//! Figure `thorax`: the lattice of a whole chest, which a blade cuts from the front as deep as it is put in.

use palpate::error::Result;
use palpate::math::{Pose, Vec3};
use palpate::sim::Sim;
use palpate::solver::blade::Blade;

use super::common::anatomy::{self, Anatomy, FRONT, softest};
use super::common::report::Report;
use super::options::{ModelName, Options};
use super::phases::measure;
use super::scene::Scene;

const CELL_M: f64 = 3e-3;
/// Cap on Young's modulus, in Pa, as in the bench of the lattice.
const YOUNG_CAP_PA: f64 = 20e3;
/// In J/m²: so little that soft tissue is not carried along by more than a cell before it is cut. That of a liver, 100, takes centimetres.
const TOUGHNESS_J_M2: f64 = 10.0;
/// The edge goes straight into the tissue, and ends so far before its surface, in m.
const ABOVE_M: f64 = 10e-3;
const DEPTH_M: f64 = 25e-3;
/// Segments of the edge.
const SEGMENTS: u32 = 4;
/// Share of the way in which it is put in, along itself.
const PLUNGE: f64 = 0.2;
/// How long the cut is, in m: along the body.
const LENGTH_M: f64 = 40e-3;

/// Takes the figure where the anatomy is.
pub fn run(options: &Options, report: &mut Report) {
    let path = match anatomy::labels() {
        Ok(path) => path,
        Err(why) => return report.skip("thorax", &why),
    };
    let how = (ModelName::Lattice, options.step_s(), options.seconds);
    match scene(&path).and_then(|scene| measure("thorax-3mm", scene, how, options)) {
        Ok(phases) => phases.iter().for_each(|phase| report.add(phase)),
        Err(error) => report.fail("thorax", &error.to_string()),
    }
}

/// A straight edge that is put in where the chest is softest, and drawn along the body.
fn scene(labels: &std::path::Path) -> Result<Scene> {
    let anatomy = Anatomy {
        cell_m: CELL_M,
        only: &[],
        young_pa: None,
        poisson: None,
        young_cap_pa: YOUNG_CAP_PA,
        holds_front: false,
    };
    let model = anatomy.model(labels)?;
    let skin = softest(&Sim::new(model.clone(), &Default::default())?)?.point_m;
    let point = |n: u32| FRONT * (ABOVE_M - (ABOVE_M + DEPTH_M) * f64::from(n) / f64::from(SEGMENTS));
    let blade = Blade { edge: (0..=SEGMENTS).map(point).collect(), toughness_j_m2: TOUGHNESS_J_M2 };
    let way = move |share: f64| {
        let out = (1.0 - share / PLUNGE).max(0.0);
        let along = ((share - PLUNGE) / (1.0 - PLUNGE)).max(0.0) - 0.5;
        let at = skin + FRONT * (DEPTH_M + ABOVE_M) * out + Vec3::z() * (LENGTH_M * along);
        Pose::translation(at.x, at.y, at.z)
    };
    // Some four pieces on each cell of a face as deep as the edge, and of its rim.
    let face_cells = LENGTH_M * DEPTH_M / (CELL_M * CELL_M);
    Ok(Scene {
        model,
        gravity_m_s2: Vec3::new(0.0, 0.0, -9.81),
        rests_under_gravity: true,
        cut_nodes: (16.0 * face_cells) as usize + 256,
        blade,
        way: Box::new(way),
        rest_s: 0.2,
        cut_s: 2.0,
        after_s: 0.2,
        lift: None,
    })
}
