//! Loads, node by node.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::cuda::body::Body;
use crate::cuda::layout::{self, Pressed, Pushed};
use crate::cuda::memory::{Buffer, Stream};
use crate::error::Result;
use crate::math::Vec3;
use crate::model::Model;
use crate::model::lattice::{Lattice, flag};
use crate::solver::load::NodalLoads;

/// Loads as the device knows them.
#[derive(Debug)]
pub struct Pushes {
    model: Arc<Model>,
    /// Whether they are those in force.
    are_known: bool,
    nodes: Buffer<Pushed>,
    faces: Buffer<Pressed>,
    count: u32,
    acceleration: f64,
}

/// All loads, as they are on the device.
#[derive(Debug, Default)]
struct List {
    nodes: Vec<Pushed>,
    faces: Vec<Pressed>,
    /// Largest acceleration of a node, in m/s².
    acceleration: f64,
}

impl Pushes {
    /// No loads.
    pub fn new(model: &Arc<Model>, stream: &Arc<Stream>) -> Result<Self> {
        Ok(Self {
            model: model.clone(),
            are_known: true,
            nodes: Buffer::zeros(stream, 0)?,
            faces: Buffer::zeros(stream, 0)?,
            count: 0,
            acceleration: 0.0,
        })
    }

    /// Other loads are in force from now on.
    pub fn forget(&mut self) {
        self.are_known = false;
    }

    /// The device's record of the loads in force, and how much they accelerate a node at most, in m/s².
    pub fn prepare(&mut self, loads: &[NodalLoads], body: &Body) -> Result<(layout::Push, f64)> {
        if !self.are_known {
            let list = List::of(loads, self.model.lattice(), body);
            self.nodes.replace(&list.nodes)?;
            self.faces.replace(&list.faces)?;
            (self.count, self.acceleration) = (list.nodes.len() as u32, list.acceleration);
            self.are_known = true;
        }
        if self.count == 0 {
            return Ok(Default::default());
        }
        let push = layout::Push { count: self.count, nodes: self.nodes.at(), faces: self.faces.at() };
        Ok((push, self.acceleration))
    }
}

impl List {
    /// Gathers loads in their order, so that sums are always the same.
    fn of(loads: &[NodalLoads], lattice: &Lattice, body: &Body) -> Self {
        let mut gathered: BTreeMap<u32, (Vec3, Vec<Pressed>)> = BTreeMap::new();
        for load in loads {
            for &(slot, force) in &load.forces {
                gathered.entry(slot).or_default().0 += force;
            }
            for &(corners, pressure) in &load.pressed {
                let face = Pressed::of(corners, corners.map(|slot| lattice.rest_position(slot)), pressure);
                corners.into_iter().for_each(|slot| gathered.entry(slot).or_default().1.push(face));
            }
        }
        let mut list = Self::default();
        // A corner's quarter of a face at rest.
        let share = 0.25 * lattice.cell_m() * lattice.cell_m();
        for (slot, (force, pressed)) in gathered {
            let flags = body.flags[slot as usize];
            let inverse = body.node_mass(slot).recip();
            let mobility =
                Vec3::from_fn(|axis, _| if flags & (flag::FIX_X << axis) == 0 { inverse } else { 0.0 });
            let acceleration = force.component_mul(&mobility);
            let pressure: f64 = pressed.iter().map(|face| face.pressure.abs()).sum();
            list.acceleration =
                list.acceleration.max(acceleration.norm() + pressure * share * mobility.max());
            list.nodes.push(Pushed {
                slot,
                start: list.faces.len() as u32,
                count: pressed.len() as u32,
                force: force.into(),
                mobility: mobility.into(),
            });
            list.faces.extend(pressed);
        }
        list
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pose;
    use crate::model::grid::LabelGrid;
    use crate::model::material::Material;
    use crate::model::{Build, Fix, LabelUse};

    /// Three cells in a row along x; the nodes at their beginning are held along y.
    fn row() -> Arc<Model> {
        let grid = LabelGrid::new([3, 1, 1], Vec3::repeat(0.5), Pose::identity(), vec![1; 3]).unwrap();
        let mut build = Build::new(grid);
        let tissue = Material::new("tissue", 1e3, 0.3, 1000.0).unwrap();
        build.uses = BTreeMap::from([(1, LabelUse::Tissue(tissue))]);
        build.fixes.push(Fix {
            // A grid's origin is the middle of its first voxel.
            pose: Pose::translation(-0.25, 0.0, 0.0),
            half_extents: Vec3::new(0.1, 9.0, 9.0),
            axes: [false, true, false],
        });
        Arc::new(build.run(&mut |_, _| true).unwrap())
    }

    #[test]
    fn all_that_loads_do_to_a_node_comes_together_and_spares_held_axes() {
        let model = row();
        let lattice = model.lattice();
        let [held, free] = [[0, 0, 0], [1, 0, 0]].map(|node| lattice.slot(node).unwrap());
        // Below the first cell, seen from outside.
        let face = [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]].map(|node| lattice.slot(node).unwrap());
        let loads = [
            NodalLoads { forces: vec![(free, Vec3::new(1.0, 2.0, 3.0))], pressed: vec![(face, 8.0)] },
            NodalLoads {
                forces: vec![(held, Vec3::repeat(5.0)), (free, Vec3::repeat(4.0))],
                pressed: vec![(face, 16.0)],
            },
        ];
        let list = List::of(&loads, model.lattice(), &Body::of(&model, 0));
        assert!(list.nodes.is_sorted_by_key(|node| node.slot), "each node once");
        assert_eq!(list.nodes.len(), 4);
        let of = |slot: u32| *list.nodes.iter().find(|node| node.slot == slot).unwrap();

        // 125 kg a cell, an eighth of which lies on each corner.
        let mass = 125.0 / 8.0;
        let near = |found: [f64; 3], expected: [f64; 3]| {
            found.iter().zip(expected).all(|(f, e)| (f - e).abs() <= 1e-12 * e.abs())
        };
        assert!(near(of(held).mobility, [1.0 / mass, 0.0, 1.0 / mass]));
        assert_eq!(of(held).force, [5.0; 3]);
        assert!(near(of(free).mobility, [0.5 / mass; 3]), "two cells meet there");
        assert_eq!(of(free).force, [5.0, 6.0, 7.0]);
        for node in &list.nodes {
            let faces = &list.faces[node.start as usize..][..node.count as usize];
            assert_eq!(faces.iter().map(|face| face.pressure).collect::<Vec<_>>(), [8.0, 16.0]);
            for face in faces {
                assert_eq!(face.diagonals, [[0.5, 0.5, 0.0], [0.5, -0.5, 0.0]]);
            }
        }
        // The held end bears 5 N along two axes, and 24 Pa on a quarter of 0.25 m².
        let most = (50.0_f64.sqrt() + 24.0 / 16.0) / mass;
        assert!((list.acceleration - most).abs() < 1e-6 * most, "{}", list.acceleration);
    }
}
