//! Blades that go anywhere, through tissue that moves.

use palpate::math::Vec3;
use palpate::sim::NodeField;
use palpate::solver::method::Method;

use super::{CELL_M, DENSITY_KG_M3, EXACT, METHODS, beam, simulation};

/// Numbers from −1 to 1, the same each time.
fn noise() -> impl FnMut() -> f64 {
    let mut seed = 7_u64;
    move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

#[test]
fn the_meshless_model_stays_sound_under_two_hundred_random_cuts() {
    stays_sound(METHODS[1]);
}

fn stays_sound(method: Method) {
    let cells = [8, 6, 6];
    let model = beam(cells, true);
    let mut sim = simulation(&model, method, -9.81 * Vec3::z());
    let mut noise = noise();
    let mut place = || Vec3::from(cells.map(|n| n as f64 * (0.5 + 0.7 * noise()))) * CELL_M;
    for cut in 0..200 {
        let [a, b, c, d] = [(); 4].map(|()| place());
        sim.cut(&[a, b], &[c, d]).unwrap();
        sim.step().unwrap_or_else(|error| panic!("after {cut} cuts: {error}"));
    }
    assert!(sim.nodes(NodeField::Displacement).iter().flatten().all(|x| x.is_finite()));
    // Crumbs are gone, and counted.
    let gone = sim.statistics().removed_kg;
    assert!(
        sim.parts().iter().all(|part| part.is_held || part.volume_m3 >= 0.999 * CELL_M.powi(3)) && gone > 0.0
    );
    let mass = sim.parts().iter().map(|part| part.mass_kg).sum::<f64>() + gone;
    let expected = cells.iter().product::<usize>() as f64 * CELL_M.powi(3) * DENSITY_KG_M3;
    assert!(sim.parts().len() > 1 && (mass / expected - 1.0).abs() < EXACT);
}

#[test]
fn the_lattice_stays_sound_under_two_hundred_random_cuts() {
    stays_sound(METHODS[0]);
}
