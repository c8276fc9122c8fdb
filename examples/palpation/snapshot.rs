//! The state of the tissue at one moment, copied for the pictures.

use palpate::math::{Pose, Vec3};
use palpate::model::Model;
use palpate::sim::{NodeField, Sim, SurfaceField, SurfacePort};
use palpate::solver::tool::Wrench;

/// One moment.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Surface positions `[vertex_count]`, world frame, metres.
    pub positions: Vec<Vec3>,
    /// Surface normals `[vertex_count]`.
    pub normals: Vec<Vec3>,
    /// Material index under each vertex `[vertex_count]`.
    pub materials: Vec<u8>,
    /// Length of the displacement of each vertex `[vertex_count]`, in metres.
    pub displacements_m: Vec<f32>,
    /// Surface triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Displacement of the node in each slot `[slot_count]`, in metres; 0 in slots without a node.
    pub node_displacements: Vec<Vec3>,
    /// Where the tool is.
    pub tool: Pose,
    /// How far it has gone in since first contact, in metres.
    pub indentation_m: f64,
    /// What it feels.
    pub wrench: Wrench,
}

/// Takes snapshots of one surface.
#[derive(Debug)]
pub struct Camcorder {
    port: SurfacePort,
}

impl Camcorder {
    /// Looks at the first surface of the model.
    pub fn new(sim: &mut Sim) -> anyhow::Result<Self> {
        let mut port = sim.open_surface(0)?;
        port.set_field(SurfaceField::Displacement);
        Ok(Self { port })
    }

    /// The tissue as it is now.
    pub fn shoot(
        &mut self,
        sim: &Sim,
        tool: Pose,
        indentation_m: f64,
        wrench: Wrench,
    ) -> anyhow::Result<Snapshot> {
        let frame = self.port.map()?;
        let vector = |v: &[f32; 4]| Vec3::new(v[0].into(), v[1].into(), v[2].into());
        Ok(Snapshot {
            positions: frame.positions.iter().map(vector).collect(),
            normals: frame.normals.iter().map(vector).collect(),
            materials: frame.materials.to_vec(),
            displacements_m: frame.scalars.to_vec(),
            triangles: frame.triangles.to_vec(),
            node_displacements: by_slot(sim.model(), &sim.nodes(NodeField::Displacement)),
            tool,
            indentation_m,
            wrench,
        })
    }
}

/// From one value for each node to one for each slot.
fn by_slot(model: &Model, values: &[Vec3]) -> Vec<Vec3> {
    let mut slots = vec![Vec3::zeros(); model.lattice().slot_count()];
    model.lattice().slots().zip(values).for_each(|(slot, value)| slots[slot as usize] = *value);
    slots
}
