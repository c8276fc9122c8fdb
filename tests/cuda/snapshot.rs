//! Snapshots on a GPU: what follows a restore is what followed the snapshot, to the last bit.

use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::Model;
use palpate::sim::{NodeField, Precision, Sim, SimDesc, SurfacePort, ToolPort};
use palpate::solver::blade::Blade;
use palpate::solver::load::{Load, Region};
use palpate::solver::method::{EfgDesc, Method, Rows};
use palpate::solver::tool::{ToolDesc, ToolForce, ToolMotion, Wrench};

use super::gpu::has_gpu;
use super::{CELL_M, GPU, block_of, desc};

const CELLS: [usize; 3] = [18, 9, 8];
/// Where the ball's middle is above the block's lowest corner when it touches its top, in cells.
const TOUCHES: f64 = 8.0 + 3.0;
const STEPS: u32 = 40;

/// Both models, in all precisions that a GPU has for them; the meshless one with rows for all cells as well.
fn cases() -> [(Method, Precision); 4] {
    let efg = |rows| Method::Efg(EfgDesc { rows, ..EfgDesc::default() });
    [
        (Method::Lattice, Precision::Single),
        (efg(Rows::Irregular), Precision::Single),
        (efg(Rows::Irregular), Precision::Double),
        (efg(Rows::All), Precision::Double),
    ]
}

/// What a host sees after a step: nodes, a surface's positions and triangles, and forces.
type Seen = ([Vec<Vec3>; 2], Vec<[u32; 4]>, Vec<[u32; 3]>, Vec<Wrench>);

/// A simulation with a ball that presses and a blade, and a renderer.
struct Rig {
    sim: Sim,
    tools: [ToolPort; 2],
    surface: SurfacePort,
}

impl Rig {
    fn new(model: &Arc<Model>, (method, precision): (Method, Precision), sleeping: bool) -> Self {
        let desc = SimDesc { method, cut_nodes: 4000, sleeping, drag_per_s: 100.0, ..desc(GPU, precision) };
        let mut sim = Sim::new(model.clone(), &desc).unwrap();
        let ball = ToolDesc { friction: 0.3, ..ToolDesc::sphere(3.0 * CELL_M) };
        let blade = ToolDesc::blade(Blade { edge: vec![-Vec3::y(), Vec3::y()], toughness_j_m2: 2.0 });
        let tools = [ball, blade].map(|tool| sim.add_tool(&tool).unwrap());
        let surface = sim.open_surface(0).unwrap();
        Self { sim, tools, surface }
    }

    /// A step in which the ball presses and slides, and the blade cuts from the other end.
    fn step(&mut self, step: u32) -> Seen {
        let (t, frame) = (f64::from(step), self.sim.model().frame());
        let ways = [
            Vec3::new(5.0 + 0.02 * t, 4.5, TOUCHES + 0.3 - 0.04 * t.min(25.0)),
            Vec3::new(18.4 - 0.15 * t, 4.5, 3.3),
        ];
        for (tool, at) in self.tools.iter_mut().zip(ways.map(|at| at * CELL_M)) {
            tool.set_motion(&ToolMotion::at(frame * Pose::translation(at.x, at.y, at.z))).unwrap();
        }
        self.sim.step().unwrap();
        let fields = [NodeField::Displacement, NodeField::Velocity].map(|field| self.sim.nodes(field));
        let frame = self.surface.map().unwrap();
        let positions = frame.positions.iter().map(|p| p.map(f32::to_bits)).collect();
        let triangles = frame.triangles.to_vec();
        let forces = self.tools.each_mut().map(ToolPort::force).map(|ToolForce { wrench, .. }| wrench);
        (fields, positions, triangles, forces.to_vec())
    }

    fn run(&mut self, steps: std::ops::Range<u32>) -> Vec<Seen> {
        steps.map(|step| self.step(step)).collect()
    }
}

#[test]
fn what_follows_a_restore_on_a_gpu_is_what_followed_the_snapshot_to_the_last_bit() {
    if !has_gpu("what_follows_a_restore_on_a_gpu_is_what_followed_the_snapshot_to_the_last_bit") {
        return;
    }
    for (damping_s, case) in [0.0, 1e-4].into_iter().flat_map(|damping_s| cases().map(|c| (damping_s, c))) {
        let model = block_of(CELLS, 0.45, damping_s);
        let mut rig = Rig::new(&model, case, false);
        let region = Region {
            pose: model.frame() * Pose::translation(0.0, 0.0, 8.0 * CELL_M),
            half_extents_m: Vec3::new(6.0 * CELL_M, 1.0, 0.1 * CELL_M),
        };
        rig.sim.add_load(&Load::Pressure { region, pressure_pa: 5.0 }).unwrap();
        let what = format!("{case:?}, damping {damping_s}");
        // Before anything is touched or cut, and while it is.
        for first in [1, 20] {
            rig.run(0..first);
            let snapshot = rig.sim.snapshot().unwrap();
            let then = rig.run(first..STEPS);
            assert!(rig.sim.statistics().divided_cells > 20, "{what}");
            assert!(then.iter().any(|seen| seen.3[0].force_n != Vec3::zeros()), "{what}: the ball touches");
            rig.sim.restore(&snapshot).unwrap();
            assert!(rig.run(first..STEPS) == then, "{what}, from step {first}");
            let mut other = Rig::new(&model, case, false);
            other.sim.restore(&snapshot).unwrap();
            assert!(other.run(first..STEPS) == then, "{what}, another simulation from step {first}");
            rig.sim.reset();
            assert_eq!(rig.sim.parts().len(), 1, "{what}");
        }
    }
}

#[test]
fn tissue_that_sleeps_on_a_gpu_at_a_snapshot_sleeps_after_a_restore() {
    if !has_gpu("tissue_that_sleeps_on_a_gpu_at_a_snapshot_sleeps_after_a_restore") {
        return;
    }
    let model = block_of([40, 9, 8], 0.45, 0.0);
    let mut rig = Rig::new(&model, (Method::Lattice, Precision::Single), true);
    rig.sim.set_gravity(Vec3::zeros()).unwrap();
    for _ in 0..60 {
        rig.sim.step().unwrap();
    }
    let asleep = rig.sim.statistics().awake_bricks;
    let snapshot = rig.sim.snapshot().unwrap();
    let then = rig.run(0..STEPS);
    rig.sim.restore(&snapshot).unwrap();
    assert_eq!(rig.sim.statistics().awake_bricks, asleep);
    assert!(rig.run(0..STEPS) == then);
}
