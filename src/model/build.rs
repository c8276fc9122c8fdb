//! From anatomy to a model: what each label becomes, how large a cell is, what is held, which surfaces are drawn.

use std::collections::BTreeMap;

use super::grid::{LabelGrid, ResampleRule};
use super::lattice::Lattice;
use super::material::Material;
use super::mesh::TriangleMesh;
use super::surface::Surface;
use crate::error::Result;
use crate::math::{Pose, Vec3};

/// What the voxels of one label become.
#[derive(Clone, Debug, PartialEq)]
pub enum LabelUse {
    /// Nothing: air, gas, outside.
    Empty,
    /// Deformable tissue.
    Tissue(Material),
    /// A rigid region, such as a bone: held in place until the host drives it. The material serves pictures and contact lists.
    Rigid(Material),
}

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

/// Where a surface comes from.
#[derive(Clone, Debug)]
pub enum SurfaceSource {
    /// The smoothed boundary of the union of these labels; all labels that are not empty when the list is empty.
    Labels(Vec<u16>),
    /// A mesh from the host, world frame.
    Mesh(TriangleMesh),
}

/// Everything that a model is built from. See [`Build::run`].
#[derive(Clone, Debug)]
pub struct Build {
    /// The anatomy.
    pub grid: LabelGrid,
    /// Edge length of a cubic cell in metres; the smallest voxel spacing when `None`.
    pub cell_m: Option<f64>,
    /// How a cell takes its label from the voxels.
    pub rule: ResampleRule,
    /// What each label becomes. Every label that occurs must be named.
    pub uses: BTreeMap<u16, LabelUse>,
    /// Nodes that are held, besides rigid regions.
    pub fixes: Vec<Fix>,
    /// Whether all nodes on the six faces of the grid are held: −x, +x, −y, +y, −z, +z.
    pub fix_faces: [bool; 6],
    /// Render surfaces, in the order in which hosts will name them.
    pub surfaces: Vec<SurfaceSource>,
    /// Which of `surfaces` tools touch; a surface of all labels is extracted for contact when `None`.
    pub contact_surface: Option<usize>,
    /// A cap on Young's modulus in Pa (an explicit method's step shrinks with √E). Reported by the model.
    pub young_cap_pa: Option<f64>,
}

/// An immutable model, ready to be simulated any number of times.
#[derive(Debug)]
pub struct Model {
    pub(crate) lattice: Lattice,
    pub(crate) materials: Vec<Material>,
    pub(crate) surfaces: Vec<Surface>,
    pub(crate) contact_surface: usize,
    pub(crate) frame: Pose,
}

impl Model {
    /// The cells and nodes.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Materials `[≤ 15]`; a cell's material index is one more than the position here, 0 being empty.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// Render surfaces in the order of [`Build::surfaces`]; one more follows when contact needed a surface of its own.
    pub fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    /// The index in [`Self::surfaces`] of the surface that tools touch.
    pub fn contact_surface(&self) -> usize {
        self.contact_surface
    }

    /// Model frame to world. The model frame's origin is the lowest corner of the lattice.
    pub fn frame(&self) -> Pose {
        self.frame
    }
}

impl Build {
    /// A build with defaults: majority rule, nothing held, one surface of all labels.
    pub fn new(grid: LabelGrid) -> Self {
        Self {
            grid,
            cell_m: None,
            rule: ResampleRule::Majority,
            uses: BTreeMap::new(),
            fixes: Vec::new(),
            fix_faces: [false; 6],
            surfaces: vec![SurfaceSource::Labels(Vec::new())],
            contact_surface: Some(0),
            young_cap_pa: None,
        }
    }

    /// Builds the model. `progress` is told the finished fraction in [0, 1] and the stage's name, and stops the build by
    /// answering `false`.
    pub fn run(&self, progress: &mut dyn FnMut(f32, &str) -> bool) -> Result<Model> {
        let _ = progress;
        todo!()
    }
}
