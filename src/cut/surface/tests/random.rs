//! Random bodies under random cuts, each by its number: what holds after each cut.

use std::panic::catch_unwind;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::available_parallelism;

use parking_lot::Mutex;

use super::*;

/// Cuts of each body.
const CUTS: usize = 10;

/// A body of which about a sixth of the cells is missing, in its own surface, in a host's sphere or in a cuboid on the grid's planes.
fn body(noise: &mut Noise, number: u64) -> Tissue {
    let cells = [6, 5, 4];
    let size = Vec3::from(cells.map(|n| n as f64));
    let is_there: Vec<bool> = (0..cells.iter().product()).map(|_| noise.next() > -0.7).collect();
    let mesh = match number % 3 {
        0 => None,
        1 => Some(sphere(0.5 * size, 2.2 + 1.5 * noise.next(), 8)),
        _ => Some(cuboid(Vec3::zeros(), size)),
    };
    Tissue::new(cells, |[i, j, k]| is_there[i + cells[0] * (j + cells[1] * k)], mesh)
}

/// Cuts a body by triangles through all of it, and by some of the size of a cell.
fn cut_body(number: u64) {
    let mut noise = Noise(number);
    let mut body = body(&mut noise, number);
    let size = Vec3::from(body.lattice.cells().map(|n| n as f64));
    for cut in 0..CUTS {
        let (middle, reach) = match cut % 3 {
            2 => (Vec3::from_fn(|axis, _| size[axis] * (0.5 + 0.5 * noise.next())), Vec3::repeat(1.5)),
            _ => (0.5 * size, 0.9 * size),
        };
        let triangle = [(); 3].map(|()| middle + Vec3::from_fn(|axis, _| reach[axis] * noise.next()));
        body.cut(triangle, number.is_multiple_of(2));
        body.surface();
    }
}

/// Cuts bodies on all cores, and says which of them fail.
fn cut_bodies(count: u64) {
    let (next, failed) = (AtomicU64::new(0), Mutex::new(Vec::new()));
    let work = || {
        loop {
            // Relaxed: a number is given once, and nothing is read on the strength of it.
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= count {
                break;
            }
            if number.is_multiple_of(100) {
                println!("surfaces of bodies from {number} on");
            }
            if catch_unwind(|| cut_body(number)).is_err() {
                println!("the surface of body {number} fails");
                failed.lock().push(number);
            }
        }
    };
    std::thread::scope(|scope| {
        (0..available_parallelism().map_or(1, usize::from)).for_each(|_| drop(scope.spawn(work)));
    });
    let failed = failed.into_inner();
    assert!(failed.is_empty(), "{} of {count} bodies: {failed:?}", failed.len());
}

#[test]
fn surfaces_stay_closed_under_a_thousand_random_cuts() {
    cut_bodies(100);
}

#[test]
fn what_walls_and_a_surface_divide_each_other_into_does_not_hang_on_what_was_cut_before() {
    // Its surface lies on the grid's planes, and there cuts corners off walls that are as small as what points are moved by.
    cut_body(173);
}

#[test]
fn a_surface_comes_apart_with_its_tissue_where_it_spans_cells_that_are_missing() {
    cut_body(1_043);
}

#[test]
fn a_vertex_that_lies_on_a_wall_hangs_on_the_side_that_its_triangles_are_on() {
    cut_body(604);
}

#[test]
#[ignore = "takes a quarter of an hour; tests/long.sh runs it"]
fn surfaces_stay_closed_under_a_hundred_thousand_random_cuts() {
    cut_bodies(10_000);
}
