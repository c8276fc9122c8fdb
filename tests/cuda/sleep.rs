//! Sleep on a GPU: what it hides, and what wakes tissue.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::{Build, Fix, LabelUse, Model};
use palpate::sim::{NodeField, Sim, SimDesc, ToolPort};
use palpate::solver::tool::{ToolDesc, ToolMotion};

use super::gpu::has_gpu;
use super::{CELL_M, GPU, difference};

/// What sleep may hide of a displacement in this press, in cells, as on the processor; its thresholds promise three times that at worst.
const SLEEP_HIDES: f64 = 1e-2;
/// Radius of the tool in m.
const RADIUS_M: f64 = 6e-3;
const CELLS: [usize; 3] = [64, 16, 12];

/// A long block, held below.
fn beam() -> Arc<Model> {
    let labels = vec![1; CELLS.iter().product()];
    let grid = LabelGrid::new(CELLS, Vec3::repeat(CELL_M), Pose::identity(), labels).unwrap();
    let mut build = Build::new(grid);
    build.uses = BTreeMap::from([(1, LabelUse::Tissue(Material::new("tissue", 5e3, 0.45, 1000.0).unwrap()))]);
    build.fixes.push(Fix {
        pose: Pose::identity(),
        half_extents: Vec3::new(1.0, 1.0, 0.5 * CELL_M),
        axes: [true; 3],
    });
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

fn simulation(model: &Arc<Model>, sleeping: bool) -> (Sim, ToolPort) {
    let desc = SimDesc {
        backend: GPU,
        sleeping,
        drag_per_s: 100.0,
        rest_under_gravity: false,
        ..SimDesc::default()
    };
    let mut sim = Sim::new(model.clone(), &desc).unwrap();
    let tool = sim.add_tool(&ToolDesc::sphere(RADIUS_M)).unwrap();
    (sim, tool)
}

/// One step with the tool this high above one end of the top.
fn step(sim: &mut Sim, tool: &mut ToolPort, height: f64) {
    let top = CELLS[2] as f64 * CELL_M + RADIUS_M;
    let at = Pose::translation(8.0 * CELL_M, 8.0 * CELL_M, top + height);
    tool.set_motion(&ToolMotion::at(at)).unwrap();
    sim.step().unwrap();
}

#[test]
fn sleep_on_a_gpu_moves_no_node_by_more_than_a_hundredth_of_a_cell() {
    if !has_gpu("sleep_on_a_gpu_moves_no_node_by_more_than_a_hundredth_of_a_cell") {
        return;
    }
    let model = beam();
    let [mut asleep, mut again, mut awake] = [true, true, false].map(|sleeping| simulation(&model, sleeping));
    let (mut furthest, mut fewest) = (0.0_f64, u64::MAX);
    for number in 0..1600 {
        // Down in 0.2 s, held, up again in 0.2 s, away.
        let t = f64::from(number) * 1e-3;
        let depth = 5e-3 * (t / 0.2).min(1.0).min((1.2 - t) / 0.2);
        for (sim, tool) in [&mut asleep, &mut again, &mut awake] {
            step(sim, tool, -depth);
        }
        assert_eq!(asleep.1.force().wrench, again.1.force().wrench, "the same GPU gives the same bits");
        if number % 20 == 0 {
            let [one, two] = [&asleep, &awake].map(|(sim, _)| sim.nodes(NodeField::Displacement));
            furthest = furthest.max(difference(&one, &two));
        }
        fewest = fewest.min(asleep.0.statistics().awake_nodes);
    }
    println!("{} cells, {fewest} awake at least", furthest / CELL_M);
    assert!(furthest < SLEEP_HIDES * CELL_M, "{} cells", furthest / CELL_M);
    let all = asleep.0.statistics().node_count;
    assert!(fewest < all / 2, "{fewest} of {all} were awake at least");
    assert_eq!(awake.0.statistics().awake_nodes, all);
}

#[test]
fn a_body_at_rest_on_a_gpu_sleeps_and_wakes_where_it_is_touched() {
    if !has_gpu("a_body_at_rest_on_a_gpu_sleeps_and_wakes_where_it_is_touched") {
        return;
    }
    let model = beam();
    let (mut sim, mut tool) = simulation(&model, true);
    for _ in 0..60 {
        step(&mut sim, &mut tool, 0.1);
    }
    let statistics = sim.statistics();
    assert_eq!((statistics.awake_nodes, statistics.awake_bricks), (0, 0));
    println!(
        "asleep: {:e} s for a substep",
        statistics.step_device_s / f64::from(statistics.substeps_per_step)
    );
    let moved = sim.nodes(NodeField::Displacement).iter().map(Vec3::norm).fold(0.0, f64::max);
    assert!(moved < 1e-3 * SLEEP_HIDES * CELL_M, "rounding alone moved it, by {moved} m");

    step(&mut sim, &mut tool, 1e-3);
    step(&mut sim, &mut tool, -1e-3);
    assert!(tool.force().wrench.force_n.z > 0.0, "the first touch is felt at once");
    let awake = sim.statistics().awake_nodes;
    assert!(awake > 0 && awake < sim.statistics().node_count, "what is far sleeps on: {awake}");

    for _ in 0..600 {
        step(&mut sim, &mut tool, 0.1);
    }
    assert_eq!(sim.statistics().awake_nodes, 0, "quiet again");
    sim.set_gravity(Vec3::new(0.0, 0.0, -1.0)).unwrap();
    step(&mut sim, &mut tool, 0.1);
    assert_eq!(sim.statistics().awake_nodes, sim.statistics().node_count);
    let down: f64 = sim.nodes(NodeField::Velocity).iter().map(|v| v.z).sum();
    assert!(down < 0.0, "gravity pulls");
}
