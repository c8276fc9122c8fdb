//! Nodes that are held.

use super::lattice::{Lattice, flag};
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};

/// Nodes that are held: those whose rest position lies in an oriented box.
#[derive(Clone, Debug)]
pub struct Fix {
    /// The box's centre and axes, world frame.
    pub pose: Pose,
    /// Half its edge lengths in metres.
    pub half_extents: Vec3,
    /// Which axes of the **model frame** are held there.
    pub axes: [bool; 3],
}

impl Fix {
    /// The flags of the axes.
    pub(crate) fn bits(&self) -> u8 {
        (0..3).filter(|&a| self.axes[a]).fold(0, |bits, a| bits | flag::FIX_X << a)
    }

    /// The slots in the box, of which one at least is a node; `frame` is the lattice's.
    pub(crate) fn slots(&self, lattice: &Lattice, frame: &Pose) -> Result<Vec<u32>> {
        let good = self.half_extents.iter().all(|x| *x >= 0.0)
            && self.pose.to_homogeneous().iter().all(|x| x.is_finite());
        if !good {
            return Err(Error::argument(
                "a box of held nodes needs a finite pose and half extents of at least 0",
            ));
        }
        if self.axes == [false; 3] {
            return Err(Error::argument("a box of held nodes must hold at least one axis"));
        }
        let to_box = self.pose.inverse() * frame;
        // A node on the border is inside, whatever rounding says.
        let reach = self.half_extents + Vec3::repeat(1e-6 * lattice.cell_m());
        let is_inside = |slot: &u32| {
            let p = to_box.transform_point(&lattice.rest_position(*slot).into()).coords;
            (0..3).all(|a| p[a].abs() <= reach[a])
        };
        let slots: Vec<u32> = (0..lattice.slot_count() as u32).filter(is_inside).collect();
        if slots.iter().all(|&slot| lattice.words()[slot as usize] == 0) {
            return Err(Error::argument("a box of held nodes holds no node of the tissue"));
        }
        Ok(slots)
    }
}
