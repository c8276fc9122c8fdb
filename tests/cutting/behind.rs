//! Surfaces that cannot follow a cut: they stay as they were, but for what is removed, and one is told.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::mesh::TriangleMesh;
use palpate::model::{Build, Fix, LabelUse, Model, SurfaceSource};
use palpate::sim::{Event, NodeField, Sim, SurfacePort};

use super::closed::{check_closed, points, there};
use super::{CELL_M, DENSITY_KG_M3, METHODS, POISSON, YOUNG_PA, simulation};

const CELLS: [usize; 3] = [14, 4, 4];
/// Where the first surface has a hole, and where it has none, in cells along the beam.
const AT_HOLE: f64 = 5.35;
const ELSEWHERE: f64 = 9.35;

/// A beam, held at x = 0, in two surfaces: one that lacks a triangle, and one that is closed and that tools touch.
fn torn() -> Arc<Model> {
    let middle = Pose::translation(0.5 * CELL_M, 0.5 * CELL_M, 0.5 * CELL_M);
    let labels = vec![1; CELLS.iter().product()];
    let mut build = Build::new(LabelGrid::new(CELLS, Vec3::repeat(CELL_M), middle, labels).unwrap());
    let tissue = Material::new("tissue", YOUNG_PA, POISSON, DENSITY_KG_M3).unwrap();
    build.uses = BTreeMap::from([(1, LabelUse::Tissue(tissue))]);
    let half_extents = Vec3::new(0.1 * CELL_M, 1.0, 1.0);
    build.fixes.push(Fix { pose: Pose::identity(), half_extents, axes: [true; 3] });
    let whole = build.clone().run(&mut |_, _| true).unwrap();
    let (frame, closed) = (whole.frame(), &whole.surfaces()[0]);
    let positions: Vec<Vec3> =
        closed.positions.iter().map(|p| frame.transform_point(&(*p).into()).coords).collect();
    let mut triangles = closed.triangles.clone();
    let is_crossed = |t: &[u32; 3]| {
        let x = t.map(|v| positions[v as usize].x / CELL_M - AT_HOLE);
        x.iter().any(|x| *x < 0.0) && x.iter().any(|x| *x > 0.0)
    };
    triangles.remove(triangles.iter().position(is_crossed).unwrap());
    let mesh = TriangleMesh { positions, triangles, uvs: Vec::new() };
    build.surfaces = vec![SurfaceSource::Mesh(mesh), SurfaceSource::Labels(Vec::new())];
    build.contact_surface = Some(1);
    Arc::new(build.run(&mut |_, _| true).unwrap())
}

/// Cuts a beam through at x. Gives how many cells were divided.
fn sever(sim: &mut Sim, x: f64) -> usize {
    let blade = |y: f64| [-99.0, 99.0].map(|z| Vec3::new(x, y, z) * CELL_M);
    sim.cut(&blade(-1.0), &blade(5.0)).unwrap()
}

/// What was told of surfaces since the last time.
fn told(sim: &mut Sim) -> Vec<usize> {
    let events = std::iter::from_fn(|| sim.poll_event());
    let behind = events.filter_map(|event| match event {
        Event::SurfaceBehind { surface, .. } => Some(surface),
        _ => None,
    });
    behind.collect()
}

/// The triangles that are shown of a surface, how many of them are walls, and where vertices are.
fn shown(port: &mut SurfacePort) -> (Vec<[u32; 3]>, usize, Vec<Vec3>) {
    let frame = port.map().unwrap();
    let walls = there(&frame.triangles[frame.first_wall..]).count();
    (there(frame.triangles).copied().collect(), walls, points(&frame))
}

#[test]
fn a_surface_that_cannot_follow_stays_is_told_of_once_and_loses_what_is_removed() {
    for method in METHODS {
        let model = torn();
        let mut sim = simulation(&model, method, 9.81 * Vec3::x());
        let [mut open, mut closed] = [0, 1].map(|index| sim.open_surface(index).unwrap());
        let (whole, ..) = shown(&mut open);
        // Where it has no hole it follows a cut, and says nothing.
        assert_eq!(sever(&mut sim, ELSEWHERE), 16);
        let (divided, walls, _) = shown(&mut open);
        assert!(walls > 0 && told(&mut sim).is_empty());
        // Where it has one it stays as it was. The tissue is cut, and the other surface shows that.
        let (_, walls_before, _) = shown(&mut closed);
        assert_eq!(sever(&mut sim, AT_HOLE), 16);
        assert_eq!(told(&mut sim), [0]);
        assert_eq!(shown(&mut open).0, divided);
        assert!(shown(&mut closed).1 > walls_before);
        assert_eq!(sim.parts().len(), 3);
        // The next cut is not told of again.
        assert_eq!(sever(&mut sim, 2.35), 16);
        assert!(told(&mut sim).is_empty() && shown(&mut open).0 == divided);
        (0..5).for_each(|_| sim.step().unwrap());

        // The end is removed: its triangles go from both surfaces, and nothing that is left hangs on it.
        let end =
            *sim.parts().iter().find(|part| (part.volume_m3 / CELL_M.powi(3) - 74.4).abs() < 0.1).unwrap();
        sim.remove_part(end.id).unwrap();
        let (left, _, at) = shown(&mut open);
        let furthest = left.iter().flatten().map(|&v| at[v as usize].x / CELL_M).fold(0.0, f64::max);
        assert!(left.len() < divided.len() && furthest > 8.5 && furthest < ELSEWHERE + 0.2, "{furthest}");
        let frame = closed.map().unwrap();
        check_closed(&frame, &points(&frame));
        assert!(told(&mut sim).is_empty());
        (0..5).for_each(|_| sim.step().unwrap());
        assert!(shown(&mut open).2.iter().flatten().all(|x| x.is_finite()));

        // A reset makes it whole, and what it cannot follow then is told again.
        sim.reset();
        assert_eq!(shown(&mut open).0, whole);
        sever(&mut sim, AT_HOLE);
        assert_eq!((told(&mut sim), shown(&mut open).0), (vec![0], whole));
    }
}

#[test]
fn a_snapshot_of_a_surface_that_is_behind_is_one_and_what_follows_it_is_the_same() {
    for method in METHODS {
        let model = torn();
        let fresh = || simulation(&model, method, 9.81 * Vec3::x());
        let mut first = fresh();
        sever(&mut first, AT_HOLE);
        (0..5).for_each(|_| first.step().unwrap());
        assert_eq!(told(&mut first), [0]);
        let snapshot = first.snapshot().unwrap();
        // The end falls on, is cut further, and goes.
        let go_on = |sim: &mut Sim| {
            let mut open = sim.open_surface(0).unwrap();
            (0..5).for_each(|_| sim.step().unwrap());
            sever(sim, ELSEWHERE);
            let (before, ..) = shown(&mut open);
            let free = sim.parts().iter().find(|part| !part.is_held).unwrap().id;
            sim.remove_part(free).unwrap();
            sim.step().unwrap();
            let (after, walls, at) = shown(&mut open);
            assert!(after.len() < before.len() && told(sim).is_empty());
            (before, after, walls, at, sim.nodes(NodeField::Displacement))
        };
        let expected = go_on(&mut first);
        for mut sim in [first, fresh()] {
            sim.restore(&snapshot).unwrap();
            assert!(go_on(&mut sim) == expected);
        }
    }
}
