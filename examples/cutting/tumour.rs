//! The tumour of the generated thorax, cut out of the lung with what is around it: a cone whose tip lies behind it.

use std::f64::consts::TAU;
use std::sync::Arc;

use palpate::math::{Pose, Quat, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::phantom::{self, Label};
use palpate::model::{Build, LabelUse, SurfaceSource};
use palpate::solver::blade::Blade;

use super::scene::{GRASPER_M, Lift, Scene, View};

/// What of the chest is open, world frame, in m: the right lung around the tumour.
const LOW: Vec3 = Vec3::new(-0.002, 0.004, -0.036);
const HIGH: Vec3 = Vec3::new(0.086, 0.085, 0.060);
/// The middle of the tumour.
const TUMOUR: Vec3 = Vec3::new(0.040, 0.046, 0.012);
/// The tip of the cone, behind the tumour, and a circle of the cone before the lung: y, and y and radius, in m.
const TIP_Y: f64 = 0.017;
const MOUTH: [f64; 2] = [0.088, 0.044];
/// Share of the way in which the blade is put in, along itself.
const PLUNGE: f64 = 0.2;
/// A little more than one round.
const ROUNDS: f64 = 1.03;

/// From where it is seen.
pub const VIEW: View = View {
    title: "A tumour is cut out of the lung",
    back: Vec3::new(0.75, 1.0, 0.7),
    up: Vec3::new(0.0, 0.0, 1.0),
};

/// The scene, in cells of this edge length, of tissue so tough.
pub fn scene(voxel_m: f64, toughness_j_m2: f64) -> anyhow::Result<Scene> {
    let chest = phantom::thorax(voxel_m)?;
    let mut build = Build::new(open(&chest)?);
    build.uses = phantom::thorax_uses();
    for label in Label::ALL.into_iter().filter(|label| !is_lung(*label)) {
        build.uses.insert(label as u16, LabelUse::Empty);
    }
    build.cell_m = Some(voxel_m);
    // All but the front: the rest of the lung goes on there.
    build.fix_faces = [true, true, true, false, true, true];
    build.surfaces = vec![SurfaceSource::Labels(Vec::new())];
    let model = Arc::new(build.run(&mut |_, _| true)?);

    // Along the cone from its tip on, in the plane z = 0 of the tool, whose origin is the tip and whose y axis is the cone's.
    let mouth = Vec3::new(MOUTH[1], MOUTH[0] - TIP_Y, 0.0);
    let blade = Blade { edge: vec![Vec3::zeros(), 0.5 * mouth, mouth], toughness_j_m2 };
    let tip = Vec3::new(TUMOUR.x, TIP_Y, TUMOUR.z);
    let way = move |share: f64| {
        let out = (1.0 - share / PLUNGE).max(0.0);
        let turn = ROUNDS * TAU * ((share - PLUNGE) / (1.0 - PLUNGE)).max(0.0);
        Pose::from_parts((tip + mouth * out).into(), Quat::from_axis_angle(&Vec3::y_axis(), turn))
    };
    let cone_cells = TAU * 0.5 * MOUTH[1] * mouth.norm() / (voxel_m * voxel_m);
    let top = front(&model, voxel_m);
    Ok(Scene {
        model,
        gravity_m_s2: Vec3::zeros(),
        rests_under_gravity: true,
        cut_nodes: (8.0 * cone_cells) as usize + 256,
        blade,
        way: Box::new(way),
        rest_s: 0.1,
        cut_s: 4.0,
        after_s: 3.0,
        lift: Some(Lift {
            at: Vec3::new(TUMOUR.x, top + 0.8 * GRASPER_M, TUMOUR.z),
            reach_m: 2.5 * voxel_m,
            way: Vec3::new(0.0, 0.05, 0.0),
        }),
    })
}

/// What is left of a chest that is opened.
fn is_lung(label: Label) -> bool {
    matches!(label, Label::Lung | Label::Vessel | Label::Tumour)
}

/// The voxels of the open part.
fn open(chest: &LabelGrid) -> anyhow::Result<LabelGrid> {
    let voxel = chest.spacing();
    let first = chest.frame().translation.vector;
    let low = [0, 1, 2].map(|a| ((LOW[a] - first[a]) / voxel[a]).round() as usize);
    let dims = [0, 1, 2].map(|a| ((HIGH[a] - LOW[a]) / voxel[a]).round() as usize);
    let at =
        |n: usize| [n % dims[0] + low[0], n / dims[0] % dims[1] + low[1], n / (dims[0] * dims[1]) + low[2]];
    let labels = (0..dims.iter().product()).map(|n| {
        let [i, j, k] = at(n);
        let is_there = [i, j, k].iter().zip(chest.dims()).all(|(i, n)| *i < n);
        if is_there { chest.label(i, j, k) } else { Label::Outside as u16 }
    });
    let corner = first + Vec3::from(low.map(|i| i as f64)).component_mul(&voxel);
    Ok(LabelGrid::new(dims, voxel, Pose::translation(corner.x, corner.y, corner.z), labels.collect())?)
}

/// Where the lung ends in front of the tumour: y, in m.
fn front(model: &palpate::model::Model, cell_m: f64) -> f64 {
    let frame = model.frame();
    let surface = &model.surfaces()[0];
    let world = surface.positions.iter().map(|p| frame.transform_point(&(*p).into()).coords);
    let before = world.filter(|p| (p - TUMOUR).xz().norm() < 1.5 * cell_m);
    before.map(|p| p.y).fold(f64::NEG_INFINITY, f64::max)
}
