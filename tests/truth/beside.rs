//! Both models beside each other: on a plain block, and on real anatomy where `PALPATE_DATA` names the folder that holds it.

use std::f64::consts::PI;
use std::sync::Arc;

use palpate::math::Vec3;
use palpate::model::Model;
use palpate::sim::{Precision, Sim, SimDesc};
use palpate::solver::method::{EfgDesc, Method};
use palpate::solver::tool::ToolDesc;

use super::scene::{Body, block, dragged, exact, hold, material, place, touch_flat_top};
use super::tolerance::{self as tol, Claim};

#[allow(dead_code, reason = "benches use the rest")]
#[path = "../../benches/common/anatomy.rs"]
mod chest;
use chest::{Anatomy, FRONT, LUNG, labels, softest};

const YOUNG: f64 = 5e3;
const POISSON: f64 = 0.45;
/// About how thick the lungs are from front to back, in m.
const THICK: f64 = 0.1;
/// Cells in the radius of contact, on a plane.
const REACH: f64 = 6.0;
/// A body is at rest when the force has changed by less than this share between each two of four looks.
const REST: f64 = 1e-3;
/// Looks after which it must be.
const PATIENCE: usize = 100;

/// A ball without friction that comes against a surface, the same for both models.
#[derive(Clone, Copy)]
struct Press {
    /// A place before the surface, and where it is seen from there, out of the tissue.
    before: Vec3,
    out: Vec3,
    radius_m: f64,
    depth_m: f64,
    /// About how far the slowest waves go until they are turned back, in m.
    thick_m: f64,
}

/// What was felt at rest.
struct Felt {
    force_n: f64,
    points: u32,
}

impl Press {
    fn lattice(&self, model: &Arc<Model>) -> Felt {
        let (step_s, slowest) = (2e-3, self.slowest(model));
        let steps = |turns: f64| (turns / slowest / step_s).ceil() as usize;
        let desc = SimDesc { step_s, ..dragged(2.0 * slowest) };
        self.felt(model, &desc, steps(1.0), steps(0.2))
    }

    fn efg(&self, model: &Arc<Model>) -> Felt {
        let method = Method::Efg(EfgDesc { tolerance: 1e-4, max_iterations: 5000, ..EfgDesc::default() });
        let desc = SimDesc { method, step_s: 10.0 / self.slowest(model), ..exact() };
        // A step pushes tissue out of a tool by a quarter of a cell at most.
        let coming = (self.depth_m / (0.2 * model.lattice().cell_m())).ceil() as usize;
        self.felt(model, &desc, coming, 1)
    }

    /// How fast the slowest waves swing, in rad/s.
    fn slowest(&self, model: &Model) -> f64 {
        let tissue = &model.materials()[0];
        0.5 * PI * (tissue.shear_modulus_pa() / tissue.density_kg_m3).sqrt() / self.thick_m
    }

    /// The ball comes in so many steps; after it, so many steps lie between two looks.
    fn felt(&self, model: &Arc<Model>, desc: &SimDesc, coming: usize, between: usize) -> Felt {
        let desc = SimDesc { precision: Precision::Single, threads: 0, ..desc.clone() };
        let mut body = Body::of(model, &desc);
        let met = body.sim.pick(self.before, -self.out).unwrap().expect("a ray meets the surface");
        let mut port = body.sim.add_tool(&ToolDesc::sphere(self.radius_m)).unwrap();
        for step in 1..=coming {
            let depth = self.depth_m * step as f64 / coming as f64;
            place(&mut port, met.point_m + self.out * (self.radius_m - depth));
            body.steps(1);
        }
        let (mut force_n, mut quiet) = (0.0, 0);
        for _ in 0..PATIENCE {
            body.steps(between);
            let last = std::mem::replace(&mut force_n, port.force().wrench.force_n.dot(&self.out));
            quiet = if (force_n - last).abs() < REST * force_n { quiet + 1 } else { 0 };
            if quiet == 3 {
                return Felt { force_n, points: body.sim.statistics().contact_points };
            }
        }
        panic!("still not at rest: {force_n} N");
    }

    /// The meshless model's force over the lattice's less 1, and the case in words.
    fn apart(&self, model: &Arc<Model>) -> (f64, String) {
        let (lattice, efg) = (self.lattice(model), self.efg(model));
        let case = format!(
            "cells of {} m, ball of {} m, {:.5} m deep, lattice {:.4} N at {} points, EFG {:.4} N at {}",
            model.lattice().cell_m(),
            self.radius_m,
            self.depth_m,
            lattice.force_n,
            lattice.points,
            efg.force_n,
            efg.points
        );
        (efg.force_n / lattice.force_n - 1.0, case)
    }
}

// ---- A plain block -----------------------------------------------

#[test]
fn both_models_feel_alike_on_a_block_and_springs_stiffen_as_it_is_strained() {
    let mut claim = Claim::new("plain block");
    let (cells, h) = ([24, 24, 16], 4e-3);
    let mut build = block(cells, h, material(YOUNG, POISSON, 1000.0));
    hold(&mut build, Vec3::new(-1.0, -1.0, 0.0), Vec3::new(1.0, 1.0, 0.0), [true; 3]);
    touch_flat_top(&mut build, cells, h);
    let model = Arc::new(build.run(&mut |_, _| true).unwrap());
    let size = Vec3::from(cells.map(|n| n as f64)) * h;
    let before = Vec3::new(0.5 * size.x, 0.5 * size.y, 2.0 * size.z);
    // Strain under a ball is in proportion to the radius of contact over the ball's.
    let apart = [0.1, 0.2, 0.3].map(|strain| {
        let reach = REACH * h;
        let (radius_m, depth_m) = (reach / strain, reach * strain);
        let press = Press { before, out: Vec3::z(), radius_m, depth_m, thick_m: size.z };
        let (apart, case) = press.apart(&model);
        claim.check(tol::MODELS_AGREE, &case, apart);
        apart
    });
    assert!(apart[0] > apart[1] && apart[1] > apart[2], "{apart:?}");
}

// ---- Real lungs --------------------------------------------------

/// The lungs of the chest, of the same stiffness everywhere, held where the volume ends but in front.
fn lungs(cell_m: f64) -> Option<Arc<Model>> {
    let path = match labels() {
        Ok(path) => path,
        Err(why) => {
            assert!(std::env::var_os("CI").is_none(), "{why}");
            eprintln!("\n==== SKIPPED: nothing real is pressed, because {why} ====\n");
            return None;
        }
    };
    let anatomy = Anatomy {
        cell_m,
        only: LUNG,
        young_pa: Some(YOUNG),
        poisson: Some(POISSON),
        young_cap_pa: YOUNG,
        holds_front: false,
    };
    Some(anatomy.model(&path).unwrap())
}

/// A place before the lungs, where those of 4.5 mm are soft.
fn before() -> Option<Vec3> {
    let sim = Sim::new(lungs(4.5e-3)?, &exact()).unwrap();
    Some(softest(&sim).unwrap().point_m + FRONT * THICK)
}

fn press_lungs(before: Vec3, radius_m: f64, depth_m: f64) -> Press {
    Press { before, out: FRONT, radius_m, depth_m, thick_m: THICK }
}

#[test]
fn both_models_feel_alike_under_a_shallow_press_of_the_same_lungs() {
    let Some(before) = before() else { return };
    let mut claim = Claim::new("lungs");
    // Blunt: with six cells in the radius of contact, that is 0.14 and 0.09 of the ball's.
    let radius_m = 0.2;
    for cell_m in [4.5e-3, 3e-3] {
        let press = press_lungs(before, radius_m, (REACH * cell_m).powi(2) / radius_m);
        let (apart, case) = press.apart(&lungs(cell_m).unwrap());
        claim.check(tol::MODELS_AGREE, &case, apart);
    }
}

#[test]
#[ignore = "takes minutes; tests/long.sh runs it, and it prints the table of docs/efg.md"]
fn both_models_come_closer_on_real_lungs_with_finer_cells() {
    let Some(before) = before() else { return };
    for (radius_m, depth_m) in [(0.06, 3e-3), (0.06, 6e-3), (0.1, 6e-3), (0.2, 3e-3)] {
        let apart = [9e-3, 6e-3, 4.5e-3, 3e-3].map(|cell_m| {
            let (apart, case) = press_lungs(before, radius_m, depth_m).apart(&lungs(cell_m).unwrap());
            println!("{case}: {apart:.4}");
            apart
        });
        assert!(apart[3].abs() < apart[0].abs(), "{radius_m} m: {apart:?}");
    }
}
