//! Small bodies and the one handle on a running simulation that all tests share.

use std::collections::BTreeMap;
use std::sync::Arc;

use palpate::math::{Pose, Vec3};
use palpate::model::grid::LabelGrid;
use palpate::model::material::Material;
use palpate::model::mesh::TriangleMesh;
use palpate::model::{Build, Fix, LabelUse, Model, SurfaceSource};
use palpate::sim::{NodeField, Precision, Sim, SimDesc, ToolPort};
use palpate::solver::load::Region;
use palpate::solver::tool::{ToolForce, ToolMotion};

/// A material without damping.
pub fn material(young_pa: f64, poisson: f64, density_kg_m3: f64) -> Material {
    Material::new("tissue", young_pa, poisson, density_kg_m3).unwrap()
}

/// Cells of edge `h` from the label of each; the lowest corner is the world's origin, so that model frame and world agree.
pub fn voxels(
    cells: [usize; 3],
    h: f64,
    label: impl Fn([usize; 3]) -> u16,
    uses: &[(u16, LabelUse)],
) -> Build {
    let count: usize = cells.iter().product();
    let labels = (0..count)
        .map(|n| label([n % cells[0], n / cells[0] % cells[1], n / (cells[0] * cells[1])]))
        .collect();
    let frame = Pose::translation(0.5 * h, 0.5 * h, 0.5 * h);
    let grid = LabelGrid::new(cells, Vec3::repeat(h), frame, labels).unwrap();
    let mut build = Build::new(grid);
    build.cell_m = Some(h);
    build.uses = BTreeMap::from([(0, LabelUse::Empty)]);
    build.uses.extend(uses.iter().cloned());
    build
}

/// A block of one material.
pub fn block(cells: [usize; 3], h: f64, tissue: Material) -> Build {
    voxels(cells, h, |_| 1, &[(1, LabelUse::Tissue(tissue))])
}

/// An ellipsoid that fills its box of cells.
pub fn ellipsoid(cells: [usize; 3], h: f64, tissue: Material) -> Build {
    let half = Vec3::from_fn(|a, _| cells[a] as f64 / 2.0);
    let inside = |cell: [usize; 3]| {
        let p = Vec3::from_fn(|a, _| (cell[a] as f64 + 0.5 - half[a]) / half[a]);
        u16::from(p.norm() < 1.0)
    };
    voxels(cells, h, inside, &[(1, LabelUse::Tissue(tissue))])
}

/// Random cells of two materials, reproducible.
pub fn ragged(cells: [usize; 3], h: f64, seed: u64, fill: f64, tissue: [Material; 2]) -> Build {
    let [one, two] = tissue;
    let draw = |cell: [usize; 3]| {
        let mut noise = Noise(seed + (cell[0] + 100 * cell[1] + 10_000 * cell[2]) as u64 * 7919);
        noise.next();
        if 0.5 * (noise.next() + 1.0) > fill { 0 } else { 1 + u16::from(noise.next() > 0.0) }
    };
    voxels(cells, h, draw, &[(1, LabelUse::Tissue(one)), (2, LabelUse::Tissue(two))])
}

/// The block's top, z = its height, as the contact surface: one square a cell, with the nodes themselves as vertices. The smoothed
/// surface of the labels would be rounded where a plane of symmetry cuts the block.
pub fn touch_flat_top(build: &mut Build, cells: [usize; 3], h: f64) {
    let (nx, ny) = (cells[0] + 1, cells[1] + 1);
    let at = |n: usize| Vec3::new((n % nx) as f64, (n / nx) as f64, cells[2] as f64) * h;
    let mut triangles = Vec::new();
    for cell in 0..cells[0] * cells[1] {
        let n = (cell % cells[0] + cell / cells[0] * nx) as u32;
        let (right, back) = (n + 1, n + nx as u32);
        triangles.extend([[n, right, back], [right, back + 1, back]]);
    }
    let mesh = TriangleMesh { positions: (0..nx * ny).map(at).collect(), triangles, uvs: Vec::new() };
    build.surfaces = vec![SurfaceSource::Mesh(mesh)];
    build.contact_surface = Some(0);
}

/// Holds the nodes of the box between two corners along the named axes.
pub fn hold(build: &mut Build, low: Vec3, high: Vec3, axes: [bool; 3]) {
    let middle = 0.5 * (low + high);
    build.fixes.push(Fix {
        pose: Pose::translation(middle.x, middle.y, middle.z),
        half_extents: 0.5 * (high - low),
        axes,
    });
}

/// Holds the plane through the origin across an axis, along that axis: a plane of symmetry, or a frictionless wall.
pub fn roller(build: &mut Build, axis: usize) {
    let low = Vec3::from_fn(|a, _| if a == axis { 0.0 } else { -1.0 });
    let high = Vec3::from_fn(|a, _| if a == axis { 0.0 } else { 1.0 });
    hold(build, low, high, std::array::from_fn(|a| a == axis));
}

/// The boundary faces of a plane across an axis.
pub fn faces_at(axis: usize, at: f64) -> Region {
    let mut place = Vec3::zeros();
    place[axis] = at;
    Region {
        pose: Pose::translation(place.x, place.y, place.z),
        half_extents_m: Vec3::from_fn(|a, _| if a == axis { 0.0 } else { 1.0 }),
    }
}

/// Double precision, one thread, nothing that takes energy away and nobody asleep.
pub fn exact() -> SimDesc {
    SimDesc {
        precision: Precision::Double,
        threads: 1,
        drag_per_s: 0.0,
        sleeping: false,
        ..SimDesc::default()
    }
}

/// As [`exact`], with drag that brings the body to rest.
pub fn dragged(drag_per_s: f64) -> SimDesc {
    SimDesc { drag_per_s, ..exact() }
}

/// As [`exact`], with steps of one substep of this length.
pub fn with_dt(dt: f64) -> SimDesc {
    SimDesc { step_s: dt, substeps: Some(1), ..exact() }
}

/// A running body and what a test asks of it.
pub struct Body {
    pub sim: Sim,
    pub slots: Vec<u32>,
    pub rest: Vec<Vec3>,
    pub mass: Vec<f64>,
}

impl Body {
    pub fn new(build: &Build, desc: &SimDesc) -> Self {
        Self::of(&Arc::new(build.run(&mut |_, _| true).unwrap()), desc)
    }

    pub fn of(model: &Arc<Model>, desc: &SimDesc) -> Self {
        let lattice = model.lattice();
        let slots: Vec<u32> =
            (0..lattice.slot_count() as u32).filter(|&s| lattice.words()[s as usize] != 0).collect();
        let laws = model.laws();
        let mass =
            slots.iter().map(|&slot| lattice.node_mass(slot, |m| laws[usize::from(m)].corner_kg)).collect();
        let rest = slots.iter().map(|&slot| lattice.rest_position(slot)).collect();
        Self { sim: Sim::new(model.clone(), desc).unwrap(), slots, rest, mass }
    }

    /// Gives every node a displacement and a velocity by its rest position.
    pub fn set(&mut self, state: impl Fn(Vec3) -> (Vec3, Vec3)) {
        for (&slot, &x) in self.slots.iter().zip(&self.rest) {
            let (u, v) = state(x);
            self.sim.set_node(slot, u, v).unwrap();
        }
    }

    pub fn u(&self) -> Vec<Vec3> {
        self.sim.nodes(NodeField::Displacement)
    }

    pub fn v(&self) -> Vec<Vec3> {
        self.sim.nodes(NodeField::Velocity)
    }

    pub fn steps(&mut self, count: usize) {
        for _ in 0..count {
            self.sim.step().unwrap();
        }
    }

    /// Σ m v and Σ m |v|.
    pub fn momentum(&self) -> (Vec3, f64) {
        let v = self.v();
        let sum = v.iter().zip(&self.mass).map(|(v, m)| v * *m).sum();
        (sum, v.iter().zip(&self.mass).map(|(v, m)| v.norm() * m).sum())
    }

    /// Σ x × m v and Σ |x| m |v|.
    pub fn angular_momentum(&self) -> (Vec3, f64) {
        let (u, v) = (self.u(), self.v());
        let at = |i: usize| self.rest[i] + u[i];
        let sum = (0..v.len()).map(|i| at(i).cross(&(v[i] * self.mass[i]))).sum();
        (sum, (0..v.len()).map(|i| at(i).norm() * v[i].norm() * self.mass[i]).sum())
    }

    /// Mean of a nodal quantity over an end plane of a block, weighted by the area around each node.
    pub fn mean_over_plane(&self, axis: usize, at: f64, field: &[Vec3]) -> Vec3 {
        let near = 1e-6 * self.sim.model().lattice().cell_m();
        // On an end plane every node's mass is in proportion to its share of the plane.
        let picked: Vec<usize> =
            (0..field.len()).filter(|&i| (self.rest[i][axis] - at).abs() < near).collect();
        let sum: Vec3 = picked.iter().map(|&i| field[i] * self.mass[i]).sum();
        sum / picked.iter().map(|&i| self.mass[i]).sum::<f64>()
    }

    pub fn total_energy(&self) -> f64 {
        let energy = self.sim.energy();
        energy.kinetic_j + energy.elastic_j + energy.gravity_j
    }
}

/// Places a tool, upright and at rest.
pub fn place(port: &mut ToolPort, at: Vec3) {
    port.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z))).unwrap();
}

/// Moves a tool to a place, takes a step and gives what it feels.
pub fn step_to(body: &mut Body, port: &mut ToolPort, at: Vec3) -> ToolForce {
    place(port, at);
    body.steps(1);
    port.force()
}

/// A reproducible sequence in [-1, 1).
pub struct Noise(pub u64);

impl Noise {
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        // Half the bits are dropped: the low ones of such a sequence repeat early.
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    pub fn vec3(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }
}
