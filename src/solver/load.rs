//! Loads that act until they are removed.

use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};
use crate::model::{Model, binding};

/// Largest magnitude of any number of a load: far beyond what tissue bears, far below what single precision holds.
const LARGEST: f64 = 1e9;

/// A load on the tissue. World frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Load {
    /// A force at a material point (given by its rest position, inside the tissue), in N.
    Point {
        /// Rest position in metres.
        at_m: Vec3,
        /// Force in N.
        force_n: Vec3,
    },
    /// A force per rest area on the boundary faces of the cells whose centres lie in a box, in Pa. Keeps its direction.
    Traction {
        /// Which boundary faces.
        region: Region,
        /// Force per area in Pa.
        traction_pa: Vec3,
    },
    /// A pressure on those faces, in Pa: pushes against the outward normal and follows the deformed surface.
    Pressure {
        /// Which boundary faces.
        region: Region,
        /// Pressure in Pa; negative pulls.
        pressure_pa: f64,
    },
}

/// Boundary faces (between an occupied and an empty cell) whose rest centre lies in an oriented box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// The box's centre and axes, world frame.
    pub pose: Pose,
    /// Half its edge lengths in metres.
    pub half_extents_m: Vec3,
}

/// A load resolved to nodes. Model frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodalLoads {
    /// Forces in N that keep their direction.
    pub forces: Vec<(u32, Vec3)>,
    /// Quadrilaterals, counter-clockwise seen from outside, and the pressure on each in Pa.
    pub pressed: Vec<([u32; 4], f64)>,
}

impl NodalLoads {
    /// Slots of the nodes that are loaded; some more than once.
    pub fn slots(&self) -> impl Iterator<Item = u32> {
        let pressed = self.pressed.iter().flat_map(|(corners, _)| corners);
        self.forces.iter().map(|(slot, _)| slot).chain(pressed).copied()
    }
}

impl Load {
    /// Finds the nodes that a load acts on.
    pub fn resolve(&self, model: &Model) -> Result<NodalLoads> {
        let lattice = model.lattice();
        let (frame, h) = (model.frame(), lattice.cell_m());
        let mut loads = NodalLoads::default();
        match *self {
            Self::Point { at_m, force_n } => {
                finite("a point load", &[at_m, force_n])?;
                let local = frame.inverse_transform_point(&at_m.into()).coords / h;
                let (rows, _) = binding::bind(&[local * h], lattice, |_| true)?;
                let force = frame.rotation.inverse() * force_n;
                let row = &rows[0];
                if row.weights.iter().any(|weight| *weight < -1e-4) {
                    return Err(Error::argument(format!(
                        "the point of a load, {at_m:?}, is not inside the tissue"
                    )));
                }
                let shares = row.nodes.iter().zip(row.weights).filter(|(_, weight)| *weight != 0.0);
                loads.forces.extend(shares.map(|(&slot, weight)| (slot, force * f64::from(weight))));
            }
            Self::Traction { region, traction_pa } => {
                finite("a traction", &[traction_pa])?;
                let share = frame.rotation.inverse() * traction_pa * (h * h / 4.0);
                for face in region.faces(model)? {
                    loads.forces.extend(face.map(|slot| (slot, share)));
                }
            }
            Self::Pressure { region, pressure_pa } => {
                finite("a pressure", &[Vec3::repeat(pressure_pa)])?;
                loads.pressed.extend(region.faces(model)?.into_iter().map(|face| (face, pressure_pa)));
            }
        }
        Ok(loads)
    }
}

impl Region {
    /// The faces of the region, each as four slots counter-clockwise seen from outside.
    fn faces(&self, model: &Model) -> Result<Vec<[u32; 4]>> {
        finite("a region", &[self.half_extents_m, self.pose.translation.vector])?;
        let lattice = model.lattice();
        let h = lattice.cell_m();
        let to_box = self.pose.inverse() * model.frame();
        let reach = self.half_extents_m + Vec3::repeat(1e-6 * h);
        let mut faces = Vec::new();
        for (cell, _) in lattice.occupied() {
            let corners = lattice.corners(cell);
            for (axis, side) in (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]) {
                let neighbour = cell[axis].checked_add_signed(if side == 0 { -1 } else { 1 });
                let is_covered = neighbour.is_some_and(|c| {
                    let mut other = cell;
                    other[axis] = c;
                    lattice.cell_material(other) != 0
                });
                let centre =
                    Vec3::from_fn(|a, _| cell[a] as f64 + if a == axis { side as f64 } else { 0.5 }) * h;
                let p = to_box.transform_point(&centre.into()).coords;
                if is_covered || (0..3).any(|a| p[a].abs() > reach[a]) {
                    continue;
                }
                // Around the axis, the other two follow in right-handed order.
                let (one, two) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
                let base = side << axis;
                let ring = [base, base | one, base | one | two, base | two].map(|c| corners[c]);
                faces.push(if side == 1 { ring } else { [ring[0], ring[3], ring[2], ring[1]] });
            }
        }
        if faces.is_empty() {
            return Err(Error::argument("no boundary face of the tissue lies in the region of a load"));
        }
        Ok(faces)
    }
}

fn finite(what: &str, vectors: &[Vec3]) -> Result<()> {
    let good = vectors.iter().all(|v| v.iter().all(|x| x.abs() <= LARGEST));
    good.then_some(())
        .ok_or_else(|| Error::argument(format!("the numbers of {what} must lie within ±{LARGEST:e}")))
}
