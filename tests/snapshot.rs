//! Snapshots: what follows a restore is what followed the snapshot, to the last bit; and a recorded cut does the same each time.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hasher};
use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::sim::{NodeField, Part, Precision, Sim, SimDesc, Snapshot, SurfaceFrame, SurfacePort, ToolPort};
use palpate::solver::method::{EfgDesc, Method, Rows};
use palpate::solver::tool::{ToolDesc, ToolForce, ToolMotion};

#[path = "snapshot/changes.rs"]
mod changes;
#[path = "snapshot/cuts.rs"]
mod cuts;
#[path = "snapshot/refusals.rs"]
mod refusals;
#[path = "snapshot/tools.rs"]
mod tools;

const CELL_M: f64 = 4e-3;
const CELLS: [usize; 3] = [12, 7, 6];
/// The label of the bone.
const BONE: u16 = 2;

/// Both models, in both precisions; the meshless one with rows for all cells as well.
fn cases() -> [(Method, Precision); 5] {
    let efg = |rows| Method::Efg(EfgDesc { rows, ..EfgDesc::default() });
    [
        (Method::Lattice, Precision::Single),
        (Method::Lattice, Precision::Double),
        (efg(Rows::Irregular), Precision::Single),
        (efg(Rows::Irregular), Precision::Double),
        (efg(Rows::All), Precision::Double),
    ]
}

/// Tissue of two kinds, one of which damps its springs, held at its bottom, with a bone in it. Its lowest corner is the world's origin.
fn model() -> Arc<Model> {
    let label = |n: usize| match [n % CELLS[0], n / CELLS[0] % CELLS[1], n / (CELLS[0] * CELLS[1])] {
        [8 | 9, 2..=3, 1..=2] => BONE,
        [x, ..] => {
            if x < 6 {
                1
            } else {
                3
            }
        }
    };
    let labels = (0..CELLS.iter().product()).map(label).collect();
    let frame = Pose::translation(0.5 * CELL_M, 0.5 * CELL_M, 0.5 * CELL_M);
    let mut build = Build::new(LabelGrid::new(CELLS, Vec3::repeat(CELL_M), frame, labels).unwrap());
    let tissue = |young_pa, poisson, damping_s| Material {
        damping_s,
        ..Material::new("tissue", young_pa, poisson, 1000.0).unwrap()
    };
    build.uses = BTreeMap::from([
        (1, LabelUse::Tissue(tissue(4e3, 0.45, 1e-4))),
        (BONE, LabelUse::Rigid(tissue(1e9, 0.3, 0.0))),
        (3, LabelUse::Tissue(tissue(8e3, 0.3, 0.0))),
    ]);
    build.fixes.push(lowest());
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// The lowest layer of nodes.
fn lowest() -> Fix {
    Fix { pose: Pose::identity(), half_extents: Vec3::new(1.0, 1.0, 0.1 * CELL_M), axes: [true; 3] }
}

fn desc((method, precision): (Method, Precision), threads: usize) -> SimDesc {
    SimDesc {
        method,
        precision,
        threads,
        gravity_m_s2: Vec3::new(0.0, -3.0, -9.81),
        rest_under_gravity: false,
        drag_per_s: 40.0,
        cut_nodes: 4000,
        ..SimDesc::default()
    }
}

/// A simulation, its tools and a renderer.
struct Rig {
    sim: Sim,
    tools: Vec<ToolPort>,
    surface: SurfacePort,
}

impl Rig {
    fn new(model: &Arc<Model>, desc: &SimDesc, tools: &[ToolDesc]) -> Self {
        let mut sim = Sim::new(model.clone(), desc).unwrap();
        let tools = tools.iter().map(|tool| sim.add_tool(tool).unwrap()).collect();
        Self { surface: sim.open_surface(0).unwrap(), sim, tools }
    }

    fn put(&mut self, tool: usize, at: Vec3) {
        let at = at * CELL_M;
        self.tools[tool].set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
    }

    /// A hash of all that a host sees: nodes, what cuts have left, the surface, forces and counters; but for clocks and versions.
    fn seen(&mut self) -> u64 {
        let mut hash = Hash(DefaultHasher::new());
        for field in [NodeField::Displacement, NodeField::Velocity] {
            self.sim.nodes(field).iter().for_each(|v| hash.vector(v));
        }
        for Part { id, volume_m3, mass_kg, velocity_m_s, is_held } in self.sim.parts() {
            hash.numbers([f64::from(id), volume_m3, mass_kg, f64::from(u8::from(is_held))]);
            hash.vector(&velocity_m_s);
        }
        for tool in &mut self.tools {
            let ToolForce { wrench, motion, time_s, sequence } = tool.force();
            [wrench.force_n, wrench.torque_n_m, motion.pose.translation.vector]
                .iter()
                .for_each(|v| hash.vector(v));
            hash.numbers([time_s, sequence as f64]);
        }
        hash.surface(&self.surface.map().unwrap());
        hash.numbers([self.sim.energy().tool_work_j]);
        let now = self.sim.statistics();
        hash.numbers([now.time_s, now.substep_s, now.stable_substep_s, now.max_strain, now.true_residual]);
        hash.numbers(now.volume_ratio);
        let counts = [now.steps, now.substeps, now.awake_bricks, now.divided_cells, now.copies];
        hash.numbers(counts.map(|count| count as f64));
        hash.numbers([now.contact_points, now.cg_iterations].map(f64::from));
        hash.0.finish()
    }

    /// What is seen after each of some steps, before which `act` says what happens.
    fn run(&mut self, steps: std::ops::Range<u32>, act: impl Fn(&mut Self, u32)) -> Vec<u64> {
        steps
            .map(|step| {
                act(self, step);
                self.sim.step().unwrap();
                self.seen()
            })
            .collect()
    }
}

struct Hash(DefaultHasher);

impl Hash {
    fn numbers(&mut self, numbers: impl IntoIterator<Item = f64>) {
        numbers.into_iter().for_each(|x| self.0.write_u64(x.to_bits()));
    }

    fn vector(&mut self, v: &Vec3) {
        self.numbers(v.iter().copied());
    }

    fn surface(&mut self, frame: &SurfaceFrame) {
        let [positions, normals] = [frame.positions, frame.normals].map(<[_]>::as_flattened);
        let single = positions.iter().chain(normals).chain(frame.scalars).chain(frame.uvs.as_flattened());
        single.for_each(|x| self.0.write_u32(x.to_bits()));
        frame.triangles.as_flattened().iter().for_each(|&vertex| self.0.write_u32(vertex));
        self.0.write(frame.materials);
        self.0.write_usize(frame.first_wall);
    }
}

/// A ball that presses and slides, and one that pulls at what it holds; the bone is driven, and all comes to rest again.
fn busy(rig: &mut Rig, step: u32) {
    let t = f64::from(step);
    rig.put(0, Vec3::new(4.0 + 0.02 * t, 3.5, 7.6 - 0.04 * t.min(25.0)));
    rig.put(1, Vec3::new(12.9 + 0.02 * t.min(40.0), 3.5, 3.0));
    if step == 3 {
        let tool = rig.tools[1].id();
        assert!(rig.sim.grasp(tool, 0.6 * CELL_M).unwrap() > 4);
    }
    if (10..50).contains(&step) {
        rig.sim.drive_region(BONE, &Pose::translation(0.0, 2e-5 * (t - 9.0), 0.0)).unwrap();
    }
}

fn balls() -> [ToolDesc; 2] {
    [0.3, 0.0].map(|friction| ToolDesc { friction, ..ToolDesc::sphere(2.0 * CELL_M) })
}

#[test]
fn what_follows_a_restore_is_what_followed_the_snapshot_to_the_last_bit() {
    let model = model();
    for case in cases() {
        let mut rig = Rig::new(&model, &desc(case, 1), &balls());
        rig.run(0..30, busy);
        let snapshot = rig.sim.snapshot().unwrap();
        let then = rig.run(30..60, busy);
        // In the same simulation, as often as one likes; and in another one, whatever its number of threads.
        for _ in 0..2 {
            rig.sim.restore(&snapshot).unwrap();
            assert!(rig.run(30..60, busy) == then, "{case:?}");
        }
        let mut other = Rig::new(&model, &desc(case, 2), &balls());
        other.sim.restore(&snapshot).unwrap();
        assert!(other.run(30..60, busy) == then, "{case:?}, another simulation");
    }
}

#[test]
fn tissue_that_sleeps_at_a_snapshot_sleeps_after_a_restore() {
    let model = model();
    let still = |_: &mut Rig, _: u32| ();
    let touch = |rig: &mut Rig, step: u32| rig.put(0, Vec3::new(4.0, 3.5, 9.5 - 0.04 * f64::from(step)));
    let desc = SimDesc { drag_per_s: 200.0, ..desc((Method::Lattice, Precision::Single), 1) };
    let mut rig = Rig::new(&model, &desc, &balls()[..1]);
    // Deformed by its weight.
    rig.sim.settle(0.01, 5000).unwrap();
    rig.run(0..40, still);
    let asleep = rig.sim.statistics().awake_nodes;
    assert!(asleep < rig.sim.statistics().node_count, "{asleep}");
    let snapshot = rig.sim.snapshot().unwrap();
    let then = rig.run(0..60, touch);
    for mut rig in [Rig::new(&model, &desc, &balls()[..1]), rig] {
        rig.sim.restore(&snapshot).unwrap();
        assert_eq!(rig.sim.statistics().awake_nodes, asleep);
        assert!(rig.run(0..60, touch) == then);
    }
}

#[test]
fn substeps_are_as_short_after_a_restore_as_strain_asked_for_before_the_snapshot() {
    let model = model();
    // Steps so long that their number tells.
    let desc = SimDesc { step_s: 1e-2, ..desc((Method::Lattice, Precision::Double), 1) };
    let press = |rig: &mut Rig, step: u32| rig.put(0, Vec3::new(4.0, 3.5, 8.0 - 0.1 * f64::from(step)));
    let mut rig = Rig::new(&model, &desc, &balls()[..1]);
    rig.run(0..25, press);
    let snapshot = rig.sim.snapshot().unwrap();
    let then = rig.run(25..30, press);
    let mut other = Rig::new(&model, &desc, &balls()[..1]);
    assert!(other.sim.statistics().substeps_per_step < rig.sim.statistics().substeps_per_step);
    other.sim.restore(&snapshot).unwrap();
    assert!(other.run(25..30, press) == then);
}

#[test]
fn tissue_settles_after_a_restore_as_it_did_after_the_snapshot() {
    let model = model();
    for case in cases() {
        let mut rig = Rig::new(&model, &desc(case, 1), &balls());
        // A second's implicit step takes long.
        let most = if case.0 == Method::Lattice { 120 } else { 8 };
        let settle = |rig: &mut Rig| {
            busy(rig, 15);
            (rig.sim.settle(1e-2, most).unwrap().to_bits(), rig.seen())
        };
        // From motion, and from the rest that settling leaves.
        rig.run(0..15, busy);
        for _ in 0..2 {
            let snapshot = rig.sim.snapshot().unwrap();
            let then = settle(&mut rig);
            rig.run(15..18, busy);
            rig.sim.restore(&snapshot).unwrap();
            assert!(settle(&mut rig) == then, "{case:?}");
        }
    }
}

#[test]
fn a_snapshot_outlives_its_simulation_and_may_be_another_threads() {
    let model = model();
    let case = (Method::Lattice, Precision::Single);
    let taken: Snapshot = {
        let mut rig = Rig::new(&model, &desc(case, 1), &balls());
        rig.run(0..20, busy);
        rig.sim.snapshot().unwrap()
    };
    let after = || {
        let mut rig = Rig::new(&model, &desc(case, 1), &balls());
        rig.sim.restore(&taken).unwrap();
        rig.run(20..25, busy)
    };
    let here = after();
    std::thread::scope(|scope| assert!(scope.spawn(after).join().unwrap() == here));
}
