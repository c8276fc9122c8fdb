//! Tissue cut on a GPU, against the processor in double precision.

use std::sync::Arc;

use palpate::error::Error;
use palpate::math::{Pose, Vec3};
use palpate::model::material::Material;
use palpate::model::{Fix, Model};
use palpate::sim::{Backend, NodeField, Part, Precision, Sim, SimDesc};
use palpate::solver::blade::Blade;
use palpate::solver::method::{EfgDesc, Method, Rows};
use palpate::solver::tool::{Shape, ToolDesc, ToolMotion};

use super::efg::SAME;
use super::gpu::has_gpu;
use super::{
    CELL_M, GPU, SAME_MOTION, SAME_SPEED, SAME_TIP_FORCE, block_of, desc, difference, largest, most,
};

/// Cells of the models.
const CELLS: [usize; 3] = [11, 9, 7];
/// Relative difference of a volume or a mass.
const EXACT: f64 = 1e-9;

/// A model's steps on a GPU, and how far displacements and velocities may differ from the processor's, relatively.
struct Case {
    method: Method,
    precision: Precision,
    same: [f64; 2],
}

/// Both models; the meshless one solved far beyond what is compared, in both precisions.
fn cases() -> [Case; 3] {
    let efg = |(precision, tolerance, [motion, speed, _]): (Precision, f64, [f64; 3])| Case {
        method: Method::Efg(EfgDesc { tolerance, max_iterations: 5000, ..EfgDesc::default() }),
        precision,
        same: [motion, speed],
    };
    let lattice =
        Case { method: Method::Lattice, precision: Precision::Single, same: [SAME_MOTION, SAME_SPEED] };
    let [double, single] = SAME.map(efg);
    [lattice, double, single]
}

/// What acts on blocks, in m/s²: it pulls the sides of cuts apart, ...
const PULLS: [f64; 3] = [-4.0, 2.0, 8.0];
/// ... or makes them lie on each other. A side is stopped where it would go on through the other, and rounding decides in which substep that is: for so long one
/// backend's side goes on and the other's does not.
const PRESSES: [f64; 3] = [4.0, -2.0, -8.0];
/// How fast sides close in at most, as a share of the fastest node's speed.
const CLOSING: f64 = 0.1;

/// Implicit steps are long.
fn step_s(method: Method) -> f64 {
    if method == Method::Lattice { 1e-3 } else { 4e-3 }
}

/// Something pulls, and there is room for cuts.
fn desc_of(method: Method, backend: Backend, precision: Precision) -> SimDesc {
    SimDesc {
        method,
        gravity_m_s2: PULLS.into(),
        drag_per_s: 0.0,
        step_s: step_s(method),
        // The same before and after a cut, for which the stable substep gets shorter.
        substeps: (method == Method::Lattice).then_some(8),
        cut_nodes: 6000,
        ..desc(backend, precision)
    }
}

fn simulation(model: &Arc<Model>, method: Method, backend: Backend, precision: Precision) -> Sim {
    Sim::new(model.clone(), &desc_of(method, backend, precision)).unwrap()
}

/// The processor in double precision, and twice the GPU.
fn simulations(model: &Arc<Model>, case: &Case, gravity_m_s2: [f64; 3]) -> [Sim; 3] {
    let exact = match case.method {
        Method::Lattice => Method::Lattice,
        Method::Efg(desc) => Method::Efg(EfgDesc { tolerance: 1e-12, ..desc }),
    };
    let new = |method, backend, precision| {
        let desc = SimDesc { gravity_m_s2: gravity_m_s2.into(), ..desc_of(method, backend, precision) };
        Sim::new(model.clone(), &desc).unwrap()
    };
    let gpu = || new(case.method, GPU, case.precision);
    [new(exact, Backend::Cpu, Precision::Double), gpu(), gpu()]
}

/// Places in cells, in the world.
fn places<const N: usize>(model: &Model, cells: [[f64; 3]; N]) -> [Vec3; N] {
    cells.map(|cells| model.frame().transform_point(&(Vec3::from(cells) * CELL_M).into()).coords)
}

/// Moves a straight blade along y, a little askew, from x = `from` to x = `to`, at a height of `height` cells; gives how many cells it divided.
fn slit(sim: &mut Sim, from: f64, to: f64, height: f64) -> usize {
    let model = sim.model().clone();
    let edge = |x: f64| places(&model, [[x, -1.0, height - 0.2], [x + 0.3, 10.0, height + 0.3]]);
    sim.cut(&edge(from), &edge(to)).unwrap()
}

/// All have come to the same, the GPU twice to the same bits.
fn compare(sims: &[Sim; 3], peaks: &mut [f64; 2], same: [f64; 2], what: &str) {
    let fields = [NodeField::Displacement, NodeField::Velocity];
    for ((field, peak), same) in fields.into_iter().zip(&mut *peaks).zip(same) {
        let [cpu, gpu, again] = sims.each_ref().map(|sim| sim.nodes(field));
        assert!(gpu == again, "{what}: the same GPU gives the same bits");
        *peak = peak.max(largest(&cpu));
        let found = difference(&cpu, &gpu) / *peak;
        println!("{what}: {field:?} {found:e} of {peak:e}");
        assert!(found < same, "{what}: {field:?} {found:e}");
    }
    let [cpu, gpu, _] = sims.each_ref().map(Sim::parts);
    assert_eq!(cpu.len(), gpu.len(), "{what}");
    for (a, b) in cpu.iter().zip(&gpu) {
        let off = (a.velocity_m_s - b.velocity_m_s).norm();
        assert!((a.mass_kg - b.mass_kg).abs() < 1e-6 * a.mass_kg && a.is_held == b.is_held, "{what}: {b:?}");
        // A small part is as light as a node.
        assert!(off < same[1] * peaks[1], "{what}: {off:e} m/s of {a:?}");
    }
}

#[test]
fn tissue_cut_on_a_gpu_moves_as_on_the_processor() {
    if !has_gpu("tissue_cut_on_a_gpu_moves_as_on_the_processor") {
        return;
    }
    for (damping_s, case) in [0.0, 1e-4].into_iter().flat_map(|damping_s| cases().map(|c| (damping_s, c))) {
        let model = block_of(CELLS, 0.45, damping_s);
        let mut sims = simulations(&model, &case, PULLS);
        let what = format!("{} {:?} damping {damping_s}", name(case.method), case.precision);
        let mut peaks = [0.0; 2];
        let mut divided = 0;
        for step in 0..40 {
            // On and on, half a cell at a time, while it falls; then across.
            let x = 11.5 - 0.5 * f64::from(step);
            let cells = sims.each_mut().map(|sim| match step {
                0..26 => slit(sim, x, x - 0.5, 3.2),
                30 => {
                    let model = sim.model().clone();
                    let edge = |y: f64| places(&model, [[5.4, y, -1.0], [5.7, y, 9.0]]);
                    sim.cut(&edge(-1.0), &edge(4.6)).unwrap()
                }
                _ => 0,
            });
            assert!(cells.iter().all(|count| *count == cells[0]), "{what}, step {step}: {cells:?}");
            divided += cells[0];
            sims.iter_mut().for_each(|sim| sim.step().unwrap());
            // The first steps are small ones.
            if step > 4 {
                compare(&sims, &mut peaks, case.same, &format!("{what}, step {step}"));
            }
        }
        assert!(divided > 99, "{what}: {divided}");
        assert_eq!(sims[1].parts().len(), 2, "{what}");
        let [cpu, gpu, _] = sims.each_ref().map(Sim::statistics);
        // Displacements are rounded by so much of a cell, the more the farther what was cut off has gone; a strain takes a few of them.
        let ulp = if case.precision == Precision::Single { f64::from(f32::EPSILON) } else { f64::EPSILON };
        let rounded = 8.0 * ulp * peaks[0] / CELL_M;
        let off = (cpu.max_strain - gpu.max_strain).abs();
        assert!(off < 1e-3 * cpu.max_strain + rounded, "{what}: {cpu:?} {gpu:?}");
        assert!((cpu.volume_ratio[0] - gpu.volume_ratio[0]).abs() < 1e-4, "{what}: {cpu:?} {gpu:?}");
    }
}

#[test]
fn tissue_cut_on_a_gpu_lies_on_itself_as_on_the_processor() {
    if !has_gpu("tissue_cut_on_a_gpu_lies_on_itself_as_on_the_processor") {
        return;
    }
    for case in cases() {
        let model = block_of(CELLS, 0.45, 1e-4);
        let mut sims = simulations(&model, &case, PRESSES);
        let what = format!("{} {:?}, pressed", name(case.method), case.precision);
        let mut peaks = [0.0_f64; 2];
        sims.iter_mut().for_each(|sim| assert!(slit(sim, 12.0, -2.0, 3.2) >= 99));
        // After so long it has slid by less than a cell.
        let steps = (30e-3 / step_s(case.method)) as u32;
        for step in 0..steps {
            sims.iter_mut().for_each(|sim| sim.step().unwrap());
            if step > 4 {
                // No node goes further in a substep than the fastest; and a side that is not yet stopped is as fast as it closed in.
                let statistics = sims[0].statistics();
                let way = statistics.substep_s * peaks[1].max(largest(&sims[0].nodes(NodeField::Velocity)));
                let same = [way / peaks[0].max(largest(&sims[0].nodes(NodeField::Displacement))), CLOSING];
                compare(&sims, &mut peaks, same, &format!("{what}, step {step}"));
            }
        }
        // The upper part may slide, but does not go on through the lower one.
        let [a, b] = [0, 1].map(|part| sims[1].parts()[part].velocity_m_s);
        let down = model.frame() * Vec3::z();
        let fallen = down.dot(&Vec3::from(PRESSES)) * f64::from(steps) * step_s(case.method);
        assert!(down.dot(&(a - b)).abs() < 0.5 * fallen.abs(), "{what}: {a:?} {b:?}");
    }
}

fn name(method: Method) -> &'static str {
    if method == Method::Lattice { "lattice" } else { "meshless" }
}

#[test]
fn what_is_cut_off_on_a_gpu_falls_and_nothing_else_acts_on_it() {
    if !has_gpu("what_is_cut_off_on_a_gpu_falls_and_nothing_else_acts_on_it") {
        return;
    }
    for case in cases() {
        let model = block_of(CELLS, 0.45, 0.0);
        let [mut cpu, mut sim, _] = simulations(&model, &case, PULLS);
        for sim in [&mut cpu, &mut sim] {
            (0..10).for_each(|_| sim.step().unwrap());
            assert!(slit(sim, 12.0, -2.0, 3.2) >= 99);
        }
        let parts = sim.parts();
        let [volume, mass] = [|part: &Part| part.volume_m3, |part: &Part| part.mass_kg]
            .map(|of| parts.iter().map(of).sum::<f64>());
        let expected = CELLS.iter().product::<usize>() as f64 * CELL_M.powi(3);
        assert!((volume / expected - 1.0).abs() < EXACT && (mass / expected / 1000.0 - 1.0).abs() < EXACT);
        let free = parts.iter().position(|part| !part.is_held).expect("what was cut off is free");
        assert_eq!((parts.len(), parts[1 - free].is_held), (2, true));
        let gained = Vec3::from(PULLS) * step_s(case.method);
        let mut alone = 0;
        for _ in 0..30 {
            // What springs back touches the other side once more; the processor says when, and by how much.
            let [of_cpu, of_gpu] = [&mut cpu, &mut sim].map(|sim| {
                let before = sim.parts()[free].velocity_m_s;
                sim.step().unwrap();
                sim.parts()[free].velocity_m_s - before - gained
            });
            let off = (of_gpu - of_cpu).norm() / gained.norm();
            println!("{} {:?}: {off:e}", name(case.method), case.precision);
            assert!(off < case.same[1], "{} {:?}: {off:e}", name(case.method), case.precision);
            alone += u32::from(of_gpu.norm() < case.same[1] * gained.norm());
        }
        assert!(alone > 20, "{} {:?}: {alone}", name(case.method), case.precision);
    }
}

#[test]
fn copies_on_a_gpu_are_held_freed_and_weighed_as_on_the_processor() {
    if !has_gpu("copies_on_a_gpu_are_held_freed_and_weighed_as_on_the_processor") {
        return;
    }
    for case in cases() {
        let model = block_of(CELLS, 0.45, 0.0);
        let mut sims = simulations(&model, &case, PULLS);
        let what = format!("{} {:?}", name(case.method), case.precision);
        let side = Fix {
            pose: model.frame(),
            half_extents: Vec3::new(0.6 * CELL_M, 1.0, 1.0),
            axes: [true, false, true],
        };
        let mut peaks = [0.0; 2];
        let mut step = |sims: &mut [Sim; 3], what: String| {
            sims.iter_mut().for_each(|sim| (0..5).for_each(|_| sim.step().unwrap()));
            compare(sims, &mut peaks, case.same, &what);
        };
        sims.iter_mut().for_each(|sim| assert!(slit(sim, 12.0, -2.0, 3.2) >= 99));
        step(&mut sims, format!("{what} cut"));
        let held = sims.each_mut().map(|sim| sim.fix(&side).unwrap());
        assert!(held[0] > 0 && held.iter().all(|count| *count == held[0]), "{held:?}");
        step(&mut sims, format!("{what} held"));
        // Cut where it is held, and hangs.
        let again = sims.each_mut().map(|sim| slit(sim, 12.0, -2.0, 5.6));
        assert!(again[0] > 0 && again.iter().all(|count| *count == again[0]), "{again:?}");
        step(&mut sims, format!("{what} cut again"));
        let freed = sims.each_mut().map(|sim| sim.free(&side).unwrap());
        assert!(freed.iter().all(|count| *count == freed[0] && *count >= held[0]), "{freed:?}");
        let heavy = Material::new("heavy", 4e3, 0.4, 2000.0).unwrap();
        sims.iter_mut().for_each(|sim| sim.set_material(1, &heavy).unwrap());
        step(&mut sims, format!("{what} freed"));
    }
}

#[test]
fn a_cut_on_a_gpu_is_seen_and_touched_as_on_the_processor() {
    if !has_gpu("a_cut_on_a_gpu_is_seen_and_touched_as_on_the_processor") {
        return;
    }
    for case in cases() {
        let model = block_of(CELLS, 0.45, 0.0);
        let what = format!("{} {:?}", name(case.method), case.precision);
        let mut sims = simulations(&model, &case, PRESSES);
        let mut ports = sims.each_mut().map(|sim| sim.open_surface(model.contact_surface()).unwrap());
        let radius = 2.5 * CELL_M;
        let desc = ToolDesc { friction: 0.3, ..ToolDesc::sphere(radius) };
        let mut tools = sims.each_mut().map(|sim| sim.add_tool(&desc).unwrap());
        // Squares, summed up: in single steps a point comes to touch, or goes, a step later here than there.
        let (mut force, mut apart) = (0.0_f64, 0.0_f64);
        for step in 0..60 {
            // From the top down to its middle, half a cell at a time, while a ball presses the lips.
            let cells = sims.each_mut().map(|sim| {
                let edge = |z: f64| places(&model, [[5.4, -1.0, z], [5.7, 10.0, z + 0.2]]);
                let z = 8.0 - 0.5 * f64::from(step);
                if step < 10 { sim.cut(&edge(z), &edge(z - 0.5)).unwrap() } else { 0 }
            });
            assert!(cells.iter().all(|count| *count == cells[0]), "{what}, step {step}: {cells:?}");
            let deep = (0.1 * f64::from(step)).min(2.0);
            let [at] = places(&model, [[5.2, 4.5, 7.0 + 2.5 + 0.2 - deep]]);
            for (sim, tool) in sims.iter_mut().zip(&mut tools) {
                tool.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
                sim.step().unwrap();
            }
            let [a, b, c] = tools.each_mut().map(|tool| tool.force().wrench.force_n);
            assert_eq!(b, c, "{what}: the same GPU gives the same bits");
            force += a.norm_squared();
            apart += (a - b).norm_squared();
            if step % 10 != 9 {
                continue;
            }
            let moved = largest(&sims[0].nodes(NodeField::Displacement));
            let [cpu, gpu, _] = ports.each_mut().map(|port| port.map().unwrap());
            assert!(cpu.triangles == gpu.triangles && cpu.first_wall < cpu.triangles.len(), "{what}");
            let pairs = cpu.positions.iter().flatten().zip(gpu.positions.iter().flatten());
            let off = most(pairs.map(|(a, b)| f64::from((a - b).abs())));
            println!("{what}, step {step}: {off:e} m of {moved:e} m; {apart:e} N² of {force:e} N²");
            // Light nodes beside a cut go where the impulses of a few points take them.
            assert!(off < SAME_TIP_FORCE * moved, "{what}, step {step}: {off:e} m");
        }
        assert!(force > 60.0 * 0.01_f64.powi(2), "it is pressed: {force:e} N²");
        assert!(apart < SAME_TIP_FORCE.powi(2) * force, "{what}: {apart:e} N² of {force:e} N²");
        // Points at the rim are in the tool or not by less than what both agree on.
        let touched = [0, 1].map(|i| sims[i].contacts(tools[i].id()).unwrap());
        let rim = SAME_TIP_FORCE * largest(&sims[0].nodes(NodeField::Displacement));
        let deep = touched.each_ref().map(|all| all.iter().filter(|point| point.depth_m > rim).count());
        assert!(
            deep[0] > 0 && deep.into_iter().zip([1, 0]).all(|(deep, other)| deep <= touched[other].len()),
            "{what}: {deep:?}"
        );
        // And whole again.
        sims.iter_mut().for_each(Sim::reset);
        let [cpu, gpu, _] = ports.each_mut().map(|port| port.map().unwrap());
        assert!(gpu.triangles == cpu.triangles && gpu.first_wall == gpu.triangles.len(), "{what}");
    }
}

#[test]
fn a_blade_on_a_gpu_meets_the_toughness_that_it_meets_on_the_processor() {
    if !has_gpu("a_blade_on_a_gpu_meets_the_toughness_that_it_meets_on_the_processor") {
        return;
    }
    for case in cases() {
        let model = block_of(CELLS, 0.45, 0.0);
        let what = format!("{} {:?}", name(case.method), case.precision);
        let mut sims = simulations(&model, &case, PULLS);
        let edge = vec![Vec3::new(0.0, -6.0, 0.0) * CELL_M, Vec3::new(0.0, 6.0, 0.0) * CELL_M];
        let desc = ToolDesc::blade(Blade { edge, toughness_j_m2: 5.0 });
        let mut blades = sims.each_mut().map(|sim| sim.add_tool(&desc).unwrap());
        let mut peaks = [0.0; 2];
        let (mut force, mut apart) = (0.0_f64, 0.0_f64);
        for step in 0..40 {
            let x = 12.0 - 0.15 * f64::from(step);
            let pose = model.frame() * Pose::translation(x * CELL_M, 4.5 * CELL_M, 4.3 * CELL_M);
            for (sim, blade) in sims.iter_mut().zip(&mut blades) {
                blade.set_motion(&ToolMotion::at(pose)).unwrap();
                sim.step().unwrap();
            }
            let [a, b, c] = blades.each_mut().map(|blade| blade.force().wrench.force_n);
            assert_eq!(b, c, "{what}: the same GPU gives the same bits");
            force = force.max(a.norm());
            apart = apart.max((a - b).norm());
            if step > 20 {
                // Tools are in single precision there, whatever the tissue is in.
                let same = case.same.map(|same| same.max(SAME_MOTION));
                compare(&sims, &mut peaks, same, &format!("{what}, blade, step {step}"));
            }
        }
        println!("{what}: {apart:e} N of {force:e} N");
        // Some eighteen millimetres of edge stand in tissue.
        assert!(force > 0.02 && apart < SAME_TIP_FORCE * force, "{what}: {apart:e} N of {force:e} N");
        assert!(sims[1].statistics().divided_cells > 20);
    }
}

#[test]
fn a_reset_on_a_gpu_makes_tissue_whole_and_room_for_cuts_changes_nothing() {
    if !has_gpu("a_reset_on_a_gpu_makes_tissue_whole_and_room_for_cuts_changes_nothing") {
        return;
    }
    let mut methods: Vec<_> = cases().into_iter().map(|case| (case.method, case.precision)).collect();
    methods.push((Method::Efg(EfgDesc { rows: Rows::All, ..EfgDesc::default() }), Precision::Single));
    for (method, precision) in methods {
        let model = block_of(CELLS, 0.45, 0.0);
        let move_on = |sim: &mut Sim| {
            (0..20).for_each(|_| sim.step().unwrap());
            [NodeField::Displacement, NodeField::Velocity].map(|field| sim.nodes(field))
        };
        let whole = {
            let desc = SimDesc { cut_nodes: 0, ..desc_of(method, GPU, precision) };
            move_on(&mut Sim::new(model.clone(), &desc).unwrap())
        };
        let mut sim = simulation(&model, method, GPU, precision);
        assert!(move_on(&mut sim) == whole, "{method:?}: room for cuts changes nothing");
        for height in [3.2, 5.6] {
            slit(&mut sim, 12.0, -2.0, height);
            assert!(move_on(&mut sim) != whole);
            sim.reset();
            assert_eq!(sim.parts().len(), 1);
            assert!(move_on(&mut sim) == whole, "{method:?}: as if it had never been cut");
            sim.reset();
        }
    }
}

#[test]
fn tissue_removed_on_a_gpu_is_gone_as_on_the_processor_and_a_reset_brings_it_back() {
    if !has_gpu("tissue_removed_on_a_gpu_is_gone_as_on_the_processor_and_a_reset_brings_it_back") {
        return;
    }
    for case in cases() {
        let model = block_of(CELLS, 0.45, 0.0);
        let what = format!("{} {:?}", name(case.method), case.precision);
        let move_on = |sim: &mut Sim| {
            (0..20).for_each(|_| sim.step().unwrap());
            sim.nodes(NodeField::Displacement)
        };
        let mut sims = simulations(&model, &case, PULLS);
        let whole = move_on(&mut sims[1]);
        sims[1].reset();
        let mut ports = sims.each_mut().map(|sim| sim.open_surface(model.contact_surface()).unwrap());
        let mut peaks = [0.0; 2];
        for step in 0..40 {
            let removed = sims.each_mut().map(|sim| {
                let remove = |sim: &mut Sim, radius: f64, [x, y, z]: [f64; 3]| {
                    let pose = model.frame() * Pose::translation(x * CELL_M, y * CELL_M, z * CELL_M);
                    sim.ablate(&Shape::Sphere { radius_m: radius * CELL_M }, &pose).unwrap().mass_kg
                };
                match step {
                    5 => remove(sim, 2.3, [10.4, 4.6, 6.8]),
                    // What was removed is cut no more, what is left is.
                    10 => slit(sim, 12.0, 4.0, 5.2) as f64,
                    15 => remove(sim, 3.1, [8.2, 4.1, 5.3]),
                    20 => slit(sim, 12.0, -2.0, 3.2) as f64,
                    25 => {
                        let free = *sim.parts().iter().find(|part| !part.is_held).expect("what was cut off");
                        sim.remove_part(free.id).unwrap().mass_kg
                    }
                    _ => 0.0,
                }
            });
            assert!((step == 0 || step % 5 > 0 || step > 25) || removed[0] > 0.0, "{what}, step {step}");
            // A node that lies next to the ball's surface may be on either side of it.
            let off = most(removed.iter().map(|mass| (mass - removed[0]).abs()));
            assert!(off <= 1e-3 * removed[0], "{what}, step {step}: {removed:?}");
            sims.iter_mut().for_each(|sim| sim.step().unwrap());
            if step > 4 {
                compare(&sims, &mut peaks, case.same, &format!("{what}, step {step}"));
            }
            let [cpu, gpu, _] = ports.each_mut().map(|port| port.map().unwrap());
            assert!(cpu.triangles == gpu.triangles, "{what}, step {step}");
        }
        let expected = CELLS.iter().product::<usize>() as f64 * CELL_M.powi(3) * 1000.0;
        let mass: f64 = sims[1].parts().iter().map(|part| part.mass_kg).sum();
        assert!(((mass + sims[1].statistics().removed_kg) / expected - 1.0).abs() < EXACT, "{what}");
        sims[1].reset();
        assert!(move_on(&mut sims[1]) == whole, "{what}: as if nothing had ever been removed");
    }
}

#[test]
fn a_cut_copies_what_it_changes_alone() {
    if !has_gpu("a_cut_copies_what_it_changes_alone") {
        return;
    }
    for case in cases() {
        let model = block_of([44, 36, 26], 0.45, 0.0);
        let mut sim = simulation(&model, case.method, GPU, case.precision);
        sim.step().unwrap();
        slit(&mut sim, 46.0, 40.0, 20.2);
        let before = sim.statistics().copied.to_device;
        assert!(slit(&mut sim, 40.0, 39.0, 20.2) > 5);
        let copied = sim.statistics().copied.to_device - before;
        let whole = sim.statistics().node_bytes;
        println!("{} {:?}: {copied} of {whole} bytes", name(case.method), case.precision);
        assert!(20 * copied < whole, "{} {:?}: {copied} of {whole} bytes", name(case.method), case.precision);
    }
}

#[test]
fn what_a_gpu_has_no_room_for_is_not_cut() {
    if !has_gpu("what_a_gpu_has_no_room_for_is_not_cut") {
        return;
    }
    for case in cases() {
        let model = block_of(CELLS, 0.45, 0.0);
        let desc = SimDesc { cut_nodes: 1, ..desc_of(case.method, GPU, case.precision) };
        let [mut sim, mut whole] = [(); 2].map(|()| Sim::new(model.clone(), &desc).unwrap());
        let blade = |y: f64| places(&model, [[-1.0, y, 3.2], [12.0, y, 3.2]]);
        assert!(matches!(sim.cut(&blade(-1.0), &blade(10.0)), Err(Error::Limit(_))));
        for sim in [&mut sim, &mut whole] {
            (0..10).for_each(|_| sim.step().unwrap());
        }
        assert!(sim.nodes(NodeField::Displacement) == whole.nodes(NodeField::Displacement));
    }
}

#[test]
fn two_hundred_random_cuts_leave_a_gpu_sound() {
    if !has_gpu("two_hundred_random_cuts_leave_a_gpu_sound") {
        return;
    }
    for case in cases() {
        let model = block_of(CELLS, 0.45, 0.0);
        // With all crumbs.
        let desc =
            SimDesc { cut_nodes: 40_000, least_part_cells: 0.0, ..desc_of(case.method, GPU, case.precision) };
        let mut sim = Sim::new(model.clone(), &desc).unwrap();
        let mut seed = 7_u64;
        let mut noise = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        let mut place = || Vec3::from(CELLS.map(|n| n as f64 * (0.5 + 0.7 * noise())));
        let mut divided = 0;
        for _ in 0..200 {
            let [a, b, c, d] = [(); 4].map(|()| place());
            let [a, b, c, d] = places(&model, [a, b, c, d].map(Into::into));
            divided += sim.cut(&[a, b], &[c, d]).unwrap();
            sim.step().unwrap();
        }
        assert!(sim.nodes(NodeField::Displacement).iter().flat_map(|u| u.iter()).all(|x| x.is_finite()));
        let parts = sim.parts();
        println!("{}: {divided} cells divided, {} parts", name(case.method), parts.len());
        assert!(parts.len() > 9, "{}", parts.len());
        let mass = parts.iter().map(|part| part.mass_kg).sum::<f64>() + sim.statistics().removed_kg;
        assert!(
            (mass / (CELLS.iter().product::<usize>() as f64 * CELL_M.powi(3) * 1000.0) - 1.0).abs() < EXACT
        );
    }
}
