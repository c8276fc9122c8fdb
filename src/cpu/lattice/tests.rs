//! The kernel against the energy that it is the gradient of, and against itself on every route.

use std::sync::Arc;

use super::super::nodes::Nodes;
use super::*;
use crate::math::{Pose, Vec3};
use crate::model::lattice::Lattice;
use crate::model::material::Material;
use crate::model::{Model, energy};
use crate::noise::Noise;

fn model_of(lattice: Lattice) -> Arc<Model> {
    Arc::new(Model {
        lattice,
        materials: Vec::new(),
        laws: [CellLaw::default(); 16],
        regions: Default::default(),
        surfaces: Vec::new(),
        contact_surface: 0,
        frame: Pose::identity(),
    })
}

/// Accelerations that the kernel finds, on all runs of at most `longest` bricks.
fn accelerations<R: CpuReal>(
    bricks: &Bricks,
    laws: &[CellLaw; 16],
    nodes: &mut Nodes<R>,
    longest: usize,
    kernel: Kernel<R>,
) -> Vec<Vec3> {
    let lattice = bricks.model.lattice();
    let tables = LawTables::<R>::new(laws, lattice.cell_m());
    let mut marks = vec![Mark::default(); bricks.count()];
    let mut scratch = Scratch::new();
    let mut v_next = nodes.v.clone();
    let pieces = Pieces::default();
    let pass = Pass {
        pieces: &pieces,
        bricks,
        flags: lattice.flags(),
        laws: &tables,
        u: nodes.u.0.as_ptr(),
        v: nodes.v.0.as_ptr(),
        u_next: nodes.u_next.0.as_mut_ptr(),
        v_next: v_next.0.as_mut_ptr(),
        marks: marks.as_mut_ptr(),
        dt: 1.0,
        gravity: [0.0; 3],
        keep: 1.0,
        watch: false,
    };
    let mut runs = Vec::new();
    bricks.list_runs(longest, |_| true, &mut runs);
    for run in runs {
        // SAFETY: one thread, fields of the right size, a kernel for this processor.
        unsafe { kernel(&pass, run, None, &mut scratch) };
    }
    (0..lattice.slot_count() as u32).map(|slot| v_next.vec3(slot) - nodes.v.vec3(slot)).collect()
}

/// A ragged body of random cells and materials that spans several bricks on every axis.
fn ragged() -> (Arc<Model>, [CellLaw; 16]) {
    let cells = [37, 11, 9];
    let mut noise = Noise(7);
    let materials: Vec<u8> =
        (0..cells.iter().product()).map(|_| ((noise.next() + 1.0) * 8.0 - 4.0).max(0.0) as u8).collect();
    let h = 2e-3;
    let laws = std::array::from_fn(|m| {
        if m == 0 {
            return CellLaw::default();
        }
        let mut material =
            Material::new("m", 1e3 * m as f64, 0.25 + 0.015 * m as f64, 900.0 + 50.0 * m as f64).unwrap();
        material.damping_s = 1e-4 * m as f64;
        CellLaw::of(&material, h)
    });
    (model_of(Lattice::new(cells, h, &materials).unwrap()), laws)
}

#[test]
fn kernel_force_is_the_gradient_of_the_energy() {
    let (model, mut laws) = ragged();
    laws.iter_mut().for_each(|law| law.damping_s = 0.0);
    let lattice = model.lattice();
    let bricks = Bricks::new(model.clone(), 0);
    let mut nodes = Nodes::<f64>::at_rest(bricks.count(), false);
    let mut noise = Noise(3);
    let slots: Vec<u32> =
        (0..lattice.slot_count() as u32).filter(|&s| lattice.words()[s as usize] != 0).collect();
    for &slot in &slots {
        nodes.u.set(slot, Vec3::from_fn(|_, _| 4e-4 * noise.next()));
    }

    let tables = LawTables::<f64>::new(&laws, lattice.cell_m());
    let found = accelerations(&bricks, &laws, &mut nodes, MAX_RUN, f64::kernel(&tables));
    let mass = |slot| lattice.node_mass(slot, |m| laws[usize::from(m)].corner_kg);
    let scale = slots.iter().map(|&s| (found[s as usize] * mass(s)).norm()).fold(0.0, f64::max);

    // Central differences of the energy of the whole body, at nodes spread over all bricks.
    for &slot in slots.iter().step_by(97) {
        let rest = nodes.u.vec3(slot);
        for axis in 0..3 {
            let eps = 1e-7;
            let energy_at = |shift: f64| {
                let mut moved = rest;
                moved[axis] += shift;
                energy::elastic_j(lattice, &laws, |s| if s == slot { moved } else { nodes.u.vec3(s) })
            };
            let expected = -(energy_at(eps) - energy_at(-eps)) / (2.0 * eps);
            let force = found[slot as usize][axis] * mass(slot);
            assert!(
                (force - expected).abs() < 1e-5 * scale,
                "slot {slot} axis {axis}: {force:e} against {expected:e}"
            );
        }
    }
}

#[test]
fn damped_kernels_agree_on_every_route_and_run_length() {
    let (model, laws) = ragged();
    let bricks = Bricks::new(model.clone(), 0);
    let lattice = model.lattice();
    let (mut double, mut single) =
        (Nodes::<f64>::at_rest(bricks.count(), true), Nodes::<f32>::at_rest(bricks.count(), true));
    let mut noise = Noise(11);
    for slot in (0..lattice.slot_count() as u32).filter(|&s| lattice.words()[s as usize] != 0) {
        let (u, v) = (Vec3::from_fn(|_, _| 4e-4 * noise.next()), Vec3::from_fn(|_, _| noise.next()));
        double.u.set(slot, u);
        double.v.set(slot, v);
        single.u.set(slot, u);
        single.v.set(slot, v);
    }

    let tables = LawTables::<f64>::new(&laws, lattice.cell_m());
    let reference = accelerations(&bricks, &laws, &mut double, 1, advance::<Portable<f64>, true, true>);
    let scale = reference.iter().map(Vec3::norm).fold(0.0, f64::max);
    // A NaN, once met, stays: comparisons with it are false.
    let worse = |most: f64, x: f64| if x <= most { most } else { x };
    let furthest =
        |found: &[Vec3]| reference.iter().zip(found).map(|(a, b)| (a - b).norm() / scale).fold(0.0, worse);
    let long = accelerations(&bricks, &laws, &mut double, MAX_RUN, advance::<Portable<f64>, true, true>);
    assert_eq!(furthest(&long), 0.0, "the same sums in the same order");
    for route in f64::routes(&tables) {
        let found = accelerations(&bricks, &laws, &mut double, MAX_RUN, route);
        assert!(furthest(&found) < 1e-14);
    }
    let tables = LawTables::<f32>::new(&laws, lattice.cell_m());
    let routes = f32::routes(&tables);
    let found: Vec<_> =
        routes.iter().map(|&route| accelerations(&bricks, &laws, &mut single, MAX_RUN, route)).collect();
    assert!(found.iter().all(|a| furthest(a) < 1e-6));
    // All but the portable one, which is the last, do the very same operations.
    assert!(found[..routes.len() - 1].windows(2).all(|pair| pair[0] == pair[1]));
}

#[test]
fn a_body_that_is_where_nothing_was_is_at_rest() {
    // Moved by a cell, a node is where an empty place was that has no spring to it: so are those at every face and edge of the body.
    let (model, laws) = ragged();
    let (bricks, lattice) = (Bricks::new(model.clone(), 0), model.lattice());
    let slots: Vec<u32> =
        (0..lattice.slot_count() as u32).filter(|&s| lattice.words()[s as usize] != 0).collect();
    let tables = LawTables::<f32>::new(&laws, lattice.cell_m());
    for way in
        (0..27).map(|n| Vec3::new(f64::from(n % 3), f64::from(n / 3 % 3), f64::from(n / 9)).add_scalar(-1.0))
    {
        // There, and beside it by what single precision hardly tells apart, and by a little more.
        for aside in [0.0, 1e-7, 1e-5, 1e-3] {
            let moved = way * lattice.cell_m() * (1.0 + aside);
            for route in f32::routes(&tables) {
                let mut nodes = Nodes::<f32>::at_rest(bricks.count(), false);
                slots.iter().for_each(|&slot| nodes.u.set(slot, moved));
                let found = accelerations(&bricks, &laws, &mut nodes, MAX_RUN, route);
                assert!(slots.iter().all(|&slot| found[slot as usize] == Vec3::zeros()), "{way}, {aside}");
            }
        }
    }
}
