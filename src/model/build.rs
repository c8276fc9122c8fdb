//! From anatomy to a model: what each label becomes, how large a cell is, what is held, which surfaces are drawn.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::fix::Fix;
use super::grid::{LabelGrid, ResampleRule};
use super::lattice::{Lattice, flag};
use super::law::CellLaw;
use super::material::{MAX_MATERIALS, Material};
use super::mesh::TriangleMesh;
use super::pieces::loose_pieces;
use super::surface::Surface;
use crate::error::{Error, Result};
use crate::math::Pose;

/// Most cells of a model's bounding grid, empty ones included: some gigabytes of state.
pub const MAX_CELLS: usize = 1 << 27;

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
    pub(crate) laws: [CellLaw; 16],
    pub(crate) regions: BTreeMap<u16, Vec<u32>>,
    pub(crate) surfaces: Vec<Arc<Surface>>,
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

    /// What a cell of each material contributes `[16]`, index 0 being empty.
    pub fn laws(&self) -> &[CellLaw; 16] {
        &self.laws
    }

    /// The nodes of each rigid region, by label, in slot order.
    pub fn regions(&self) -> &BTreeMap<u16, Vec<u32>> {
        &self.regions
    }

    /// Cells of each piece of tissue that hangs on nothing: joined to the largest piece by no node, and held by none.
    /// Largest first. They are simulated as bodies of their own; nothing is removed.
    pub fn loose_pieces(&self) -> Vec<usize> {
        loose_pieces(&self.lattice)
    }

    /// Render surfaces in the order of [`Build::surfaces`]; one more follows when contact needed a surface of its own.
    pub fn surfaces(&self) -> &[Arc<Surface>] {
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
        let mut stage =
            |done: f32, name: &str| if progress(done, name) { Ok(()) } else { Err(Error::Cancelled) };
        stage(0.0, "check labels")?;
        self.check()?;

        stage(0.05, "resample")?;
        let cell_m = self.cell_m.unwrap_or_else(|| self.grid.spacing().min());
        self.check_cell_count(cell_m)?;
        let grid = self.grid.resample(cell_m, self.rule)?;
        let frame = grid.frame() * Pose::translation(-0.5 * cell_m, -0.5 * cell_m, -0.5 * cell_m);

        stage(0.3, "assemble cells")?;
        let palette = self.palette(&grid, cell_m)?;
        let cells: Vec<u8> = grid.labels().iter().map(|label| palette.index_of[label]).collect();
        let mut lattice = Lattice::new(grid.dims(), cell_m, &cells)?;

        stage(0.5, "hold nodes")?;
        let regions = self.hold_regions(&grid, &mut lattice);
        self.hold_faces(&mut lattice);
        self.hold_boxes(&mut lattice, &frame)?;

        let mut surfaces = Vec::new();
        let count = self.surfaces.len() as f32;
        for (index, source) in self.surfaces.iter().enumerate() {
            stage(0.6 + 0.3 * index as f32 / count, "bind surfaces")?;
            surfaces.push(Arc::new(self.surface(source, &grid, &lattice, &frame)?));
        }
        let contact_surface = match self.contact_surface {
            Some(index) if index < surfaces.len() => index,
            Some(index) => {
                return Err(Error::argument(format!(
                    "contact surface {index} of {} does not exist",
                    surfaces.len()
                )));
            }
            None => {
                stage(0.9, "extract the contact surface")?;
                let all = SurfaceSource::Labels(Vec::new());
                surfaces.push(Arc::new(self.surface(&all, &grid, &lattice, &frame)?));
                surfaces.len() - 1
            }
        };
        stage(1.0, "done")?;
        Ok(Model {
            lattice,
            materials: palette.materials,
            laws: palette.laws,
            regions,
            surfaces,
            contact_surface,
            frame,
        })
    }

    /// Whether the voxels of a label become something.
    fn is_occupied(&self, label: u16) -> bool {
        !matches!(self.uses.get(&label), None | Some(LabelUse::Empty))
    }

    /// Refuses labels and materials that cannot be simulated, before anything large is done.
    fn check(&self) -> Result<()> {
        let mut present = vec![false; 1 << 16];
        self.grid.labels().iter().for_each(|&label| present[usize::from(label)] = true);
        if let Some(label) = (0..=u16::MAX).find(|l| present[usize::from(*l)] && !self.uses.contains_key(l)) {
            return Err(Error::argument(format!(
                "label {label} occurs in the grid but nothing says what it becomes; name it, if only as empty"
            )));
        }
        for usage in self.uses.values() {
            if let LabelUse::Tissue(material) | LabelUse::Rigid(material) = usage {
                material.check()?;
            }
        }
        if let Some(cap) = self.young_cap_pa.filter(|cap| !(cap.is_finite() && *cap >= 1.0)) {
            return Err(Error::argument(format!(
                "a cap of {cap} Pa on Young's modulus is not at least 1 Pa"
            )));
        }
        Ok(())
    }

    /// Refuses more cells than [`MAX_CELLS`] before memory is taken for them.
    fn check_cell_count(&self, cell_m: f64) -> Result<()> {
        let (dims, spacing) = (self.grid.dims(), self.grid.spacing());
        let count: f64 = (0..3).map(|a| (dims[a] as f64 * spacing[a] / cell_m).ceil()).product();
        // A size that is not a number above 0 is refused where the grid is resampled.
        if count > MAX_CELLS as f64 {
            return Err(Error::Limit(format!(
                "cells of {cell_m} m would divide the grid into {count:.3e} cells, more than {MAX_CELLS}"
            )));
        }
        Ok(())
    }

    /// Numbers the materials that occur, in the order of their labels.
    fn palette(&self, grid: &LabelGrid, cell_m: f64) -> Result<Palette> {
        let mut occurs = vec![false; 1 << 16];
        grid.labels().iter().for_each(|&label| occurs[usize::from(label)] = true);
        // Cells outside the voxel grid count as label 0.
        let mut palette = Palette {
            materials: Vec::new(),
            laws: [CellLaw::default(); 16],
            index_of: BTreeMap::from([(0, 0)]),
        };
        let mut known: Vec<&LabelUse> = Vec::new();
        for (&label, usage) in self.uses.iter().filter(|(label, _)| occurs[usize::from(**label)]) {
            let (LabelUse::Tissue(material) | LabelUse::Rigid(material)) = usage else {
                palette.index_of.insert(label, 0);
                continue;
            };
            let position = known.iter().position(|other| *other == usage).unwrap_or_else(|| {
                known.push(usage);
                palette.materials.push(self.capped(material, matches!(usage, LabelUse::Rigid(_))));
                known.len() - 1
            });
            if position >= MAX_MATERIALS {
                return Err(Error::Limit(format!("a model has at most {MAX_MATERIALS} materials")));
            }
            let capped = &palette.materials[position];
            palette.laws[position + 1] = match usage {
                LabelUse::Rigid(_) => CellLaw::rigid(capped, cell_m),
                _ => CellLaw::of(capped, cell_m),
            };
            palette.index_of.insert(label, position as u8 + 1);
        }
        Ok(palette)
    }

    fn capped(&self, material: &Material, is_rigid: bool) -> Material {
        let mut capped = material.clone();
        if let Some(cap) = self.young_cap_pa.filter(|_| !is_rigid) {
            capped.young_pa = capped.young_pa.min(cap);
        }
        capped
    }

    /// Holds every node of the rigid cells; gives the nodes of each label.
    fn hold_regions(&self, grid: &LabelGrid, lattice: &mut Lattice) -> BTreeMap<u16, Vec<u32>> {
        let mut regions: BTreeMap<u16, Vec<u32>> = BTreeMap::new();
        let cells: Vec<[usize; 3]> = lattice.occupied().map(|(cell, _)| cell).collect();
        for cell in cells {
            let label = grid.label(cell[0], cell[1], cell[2]);
            if matches!(self.uses.get(&label), Some(LabelUse::Rigid(_))) {
                for slot in lattice.corners(cell) {
                    lattice.flags[slot as usize] |= flag::FIX_ALL | flag::DRIVEN;
                    regions.entry(label).or_default().push(slot);
                }
            }
        }
        for nodes in regions.values_mut() {
            nodes.sort_unstable();
            nodes.dedup();
        }
        regions
    }

    fn hold_faces(&self, lattice: &mut Lattice) {
        if self.fix_faces == [false; 6] {
            return;
        }
        let cells = lattice.cells();
        for slot in 0..lattice.slot_count() as u32 {
            let node = lattice.node_of(slot);
            let on_face = |axis: usize| {
                (self.fix_faces[2 * axis] && node[axis] == 0)
                    || (self.fix_faces[2 * axis + 1] && node[axis] == cells[axis])
            };
            if (0..3).any(on_face) {
                lattice.flags[slot as usize] |= flag::FIX_ALL;
            }
        }
    }

    fn hold_boxes(&self, lattice: &mut Lattice, frame: &Pose) -> Result<()> {
        for fix in &self.fixes {
            for slot in fix.slots(lattice, frame)? {
                lattice.flags[slot as usize] |= fix.bits();
            }
        }
        Ok(())
    }

    fn surface(
        &self,
        source: &SurfaceSource,
        grid: &LabelGrid,
        lattice: &Lattice,
        frame: &Pose,
    ) -> Result<Surface> {
        match source {
            SurfaceSource::Labels(labels) if labels.is_empty() => {
                Surface::from_labels(grid.labels(), |label| self.is_occupied(label), lattice)
            }
            SurfaceSource::Labels(labels) => {
                Surface::from_labels(grid.labels(), |label| labels.contains(&label), lattice)
            }
            SurfaceSource::Mesh(mesh) => {
                mesh.check()?;
                let mut local = mesh.clone();
                for p in &mut local.positions {
                    *p = frame.inverse_transform_point(&(*p).into()).coords;
                }
                Surface::from_mesh(local, lattice)
            }
        }
    }
}

/// Materials of a model by number.
struct Palette {
    materials: Vec<Material>,
    laws: [CellLaw; 16],
    index_of: BTreeMap<u16, u8>,
}
