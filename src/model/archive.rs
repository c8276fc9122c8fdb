//! Archives: a model as bytes, so that it need not be built again.
//!
//! ```text
//! "PLPMODEL"   version u32   length of the contents u64   their CRC-32 u32   contents
//! ```
//!
//! Numbers are little-endian; the contents are a [`Contents`] in the format of the crate `postcard`. What follows from them is computed anew when
//! an archive is loaded, by the code that builds it the first time: springs, laws, the rows of whole cells. So a loaded model is the same to the last bit, and a
//! forged archive cannot contradict itself. Of a version that this build does not know nothing is read.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use nalgebra as na;
use serde::{Deserialize, Serialize};

use super::Model;
use super::build::MAX_CELLS;
use super::grid::voxel_count;
use super::import;
use super::lattice::{Lattice, flag};
use super::law::CellLaw;
use super::material::{MAX_MATERIALS, Material};
use super::mesh::TriangleMesh;
use super::placement::Placement;
use super::surface::{ROW, Row, Surface};
use crate::error::{Error, Result};
use crate::math::{Pose, Quat, Vec3};

/// What an archive begins with.
const MAGIC: [u8; 8] = *b"PLPMODEL";
/// The version that is written, and the only one that is read.
const VERSION: u32 = 1;
/// Bytes before the contents.
const HEADER: usize = 24;
/// Flags of a node in a rigid region; other nodes have those of held axes alone.
const FLAGS: u8 = flag::FIX_ALL | flag::DRIVEN;
/// How far the weights of a vertex may be from one in sum: rounding of weights that are extrapolated over a few cells.
const WEIGHTS: f64 = 1e-4;
/// How far a quaternion may be from a unit one.
const UNIT: f64 = 1e-9;

/// What a model cannot do without.
#[derive(Debug, Serialize, Deserialize)]
struct Contents {
    cell_m: f64,
    /// Cells of the bounding grid along x, y, z.
    cells: [u64; 3],
    materials: Vec<Tissue>,
    /// Material of each cell of the bounding grid, x fastest.
    cell_materials: Vec<u8>,
    /// Flags of each node, in the order of slots.
    flags: Vec<u8>,
    /// The nodes of each rigid region, in the order of slots.
    regions: BTreeMap<u16, Vec<u32>>,
    surfaces: Vec<Skin>,
    contact_surface: u64,
    /// Translation, then rotation as x y z w.
    frame: [f64; 7],
}

/// A material.
#[derive(Debug, Serialize, Deserialize)]
struct Tissue {
    name: String,
    young_pa: f64,
    poisson: f64,
    density_kg_m3: f64,
    damping_s: f64,
    is_rigid: bool,
}

/// A surface.
#[derive(Debug, Serialize, Deserialize)]
struct Skin {
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    uvs: Vec<[f32; 2]>,
    materials: Vec<u8>,
    rows: Vec<([u32; ROW], [f32; ROW])>,
}

impl Model {
    /// Writes the model to a file.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        std::fs::write(path, self.to_bytes()?).map_err(|reason| Error::Io { path: path.into(), reason })
    }

    /// Reads a model from a file that [`Self::save`] wrote.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let (file, length) = import::open(path)?;
        let mut bytes = Vec::new();
        file.take(length)
            .read_to_end(&mut bytes)
            .map_err(|reason| Error::Io { path: path.into(), reason })?;
        Self::from_bytes(&path.display().to_string(), &bytes)
    }

    /// The model as an archive.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let contents = postcard::to_allocvec(&Contents::of(self))
            .map_err(|reason| Error::Defect(format!("a model cannot be written: {reason}")))?;
        let mut bytes = Vec::with_capacity(HEADER + contents.len());
        bytes.extend(MAGIC);
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend((contents.len() as u64).to_le_bytes());
        bytes.extend(crc32fast::hash(&contents).to_le_bytes());
        bytes.extend(contents);
        Ok(bytes)
    }

    /// The model of an archive. `what` names it in errors.
    pub fn from_bytes(what: &str, bytes: &[u8]) -> Result<Self> {
        let contents = contents_of(bytes).map_err(|reason| Error::format(what, reason))?;
        let read = postcard::take_from_bytes::<Contents>(contents);
        let (contents, rest) = read.map_err(|_| Error::format(what, "the contents are no model"))?;
        if !rest.is_empty() {
            return Err(Error::format(what, format!("{} bytes follow the model", rest.len())));
        }
        contents.model().map_err(|error| Error::format(what, error.to_string()))
    }
}

/// The contents behind a sound header.
fn contents_of(bytes: &[u8]) -> std::result::Result<&[u8], String> {
    if bytes.len() < HEADER || bytes[..8] != MAGIC {
        return Err("not an archive of a model".into());
    }
    let four = |at: usize| u32::from_le_bytes(std::array::from_fn(|n| bytes[at + n]));
    let version = four(8);
    if version != VERSION {
        return Err(format!("an archive of version {version}; this build reads version {VERSION}"));
    }
    let length = u64::from(four(12)) | u64::from(four(16)) << 32;
    let contents = &bytes[HEADER..];
    if length != contents.len() as u64 {
        return Err(format!("{length} bytes of contents are promised and {} are there", contents.len()));
    }
    if crc32fast::hash(contents) != four(20) {
        return Err("the archive is damaged: its checksum is wrong".into());
    }
    Ok(contents)
}

impl Contents {
    fn of(model: &Model) -> Self {
        let lattice = model.lattice();
        let cells = lattice.cells();
        let mut cell_materials = vec![0; cells.iter().product()];
        for ([i, j, k], material) in lattice.occupied() {
            cell_materials[i + cells[0] * (j + cells[1] * k)] = material;
        }
        let tissue = |(index, material): (usize, &Material)| Tissue {
            name: material.name.clone(),
            young_pa: material.young_pa,
            poisson: material.poisson,
            density_kg_m3: material.density_kg_m3,
            damping_s: material.damping_s,
            is_rigid: model.laws()[index + 1].shear_pa == 0.0,
        };
        let (place, turn) = (model.frame().translation.vector, model.frame().rotation.coords);
        Self {
            cell_m: lattice.cell_m(),
            cells: cells.map(|n| n as u64),
            materials: model.materials().iter().enumerate().map(tissue).collect(),
            cell_materials,
            flags: lattice.slots().map(|slot| lattice.flags()[slot as usize]).collect(),
            regions: model.regions().clone(),
            surfaces: model.surfaces().iter().map(|surface| Skin::of(surface)).collect(),
            contact_surface: model.contact_surface() as u64,
            frame: [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w],
        }
    }

    /// The model, after the checks that a build makes.
    fn model(self) -> Result<Model> {
        let cells = self.cells.map(|n| usize::try_from(n).unwrap_or(usize::MAX));
        let frame = self.placed(cells)?;
        let lattice = self.lattice(cells)?;
        let materials: Vec<Material> = self.materials.iter().map(Tissue::material).collect::<Result<_>>()?;
        let mut laws = [CellLaw::default(); 16];
        for ((law, tissue), material) in laws[1..].iter_mut().zip(&self.materials).zip(&materials) {
            let of = if tissue.is_rigid { CellLaw::rigid } else { CellLaw::of };
            *law = of(material, self.cell_m);
        }
        for (label, nodes) in &self.regions {
            let is_held =
                |&slot: &u32| is_node(&lattice, slot) && lattice.flags()[slot as usize] & FLAGS == FLAGS;
            if nodes.is_empty() || !nodes.is_sorted_by(|a, b| a < b) || !nodes.iter().all(is_held) {
                return Err(Error::argument(format!("region {label} holds what are no nodes of its own")));
            }
        }
        let count = materials.len();
        let surfaces = self
            .surfaces
            .into_iter()
            .map(|skin| skin.surface(&lattice, count).map(Arc::new))
            .collect::<Result<Vec<_>>>()?;
        let contact_surface = usize::try_from(self.contact_surface).ok().filter(|&n| n < surfaces.len());
        let contact_surface =
            contact_surface.ok_or_else(|| Error::argument("the contact surface does not exist"))?;
        Ok(Model { lattice, materials, laws, regions: self.regions, surfaces, contact_surface, frame })
    }

    /// The model's frame.
    fn placed(&self, cells: [usize; 3]) -> Result<Pose> {
        let [x, y, z, i, j, k, w] = self.frame;
        let turn = na::Quaternion::new(w, i, j, k);
        let off = (turn.norm() - 1.0).abs();
        if off.is_nan() || off > UNIT {
            return Err(Error::argument("the frame's rotation is no unit quaternion"));
        }
        // As it was, not brought to unit length once more.
        let frame = Pose::from_parts(Vec3::new(x, y, z).into(), Quat::new_unchecked(turn));
        Ok(Placement::new(cells, Vec3::repeat(self.cell_m), frame)?.frame)
    }

    fn lattice(&self, cells: [usize; 3]) -> Result<Lattice> {
        let count = voxel_count(cells)?;
        if count > MAX_CELLS || count != self.cell_materials.len() {
            return Err(Error::argument(format!(
                "{} cells for a grid of {cells:?} cells",
                self.cell_materials.len()
            )));
        }
        let known = self.materials.len();
        if known > MAX_MATERIALS || self.cell_materials.iter().any(|&m| usize::from(m) > known) {
            return Err(Error::argument(format!("a cell's material is none of {known}")));
        }
        let mut lattice = Lattice::new(cells, self.cell_m, &self.cell_materials)?;
        let is_known = |&flags: &u8| flags & !flag::FIX_ALL == 0 || flags == FLAGS;
        if self.flags.len() != lattice.node_count() || !self.flags.iter().all(is_known) {
            return Err(Error::argument("the flags of nodes are unknown, or of other nodes"));
        }
        let slots: Vec<u32> = lattice.slots().collect();
        for (slot, &flags) in slots.into_iter().zip(&self.flags) {
            lattice.flags[slot as usize] = flags;
        }
        Ok(lattice)
    }
}

/// Whether a slot exists and holds a node.
fn is_node(lattice: &Lattice, slot: u32) -> bool {
    lattice.words().get(slot as usize).is_some_and(|&word| word != 0)
}

impl Tissue {
    fn material(&self) -> Result<Material> {
        let material = Material {
            name: self.name.clone(),
            young_pa: self.young_pa,
            poisson: self.poisson,
            density_kg_m3: self.density_kg_m3,
            damping_s: self.damping_s,
        };
        material.check()?;
        Ok(material)
    }
}

impl Skin {
    fn of(surface: &Surface) -> Self {
        Self {
            positions: surface.positions.iter().map(|&p| p.into()).collect(),
            triangles: surface.triangles.clone(),
            uvs: surface.uvs.clone(),
            materials: surface.materials.clone(),
            rows: surface.rows.iter().map(|row| (row.nodes, row.weights)).collect(),
        }
    }

    fn surface(self, lattice: &Lattice, materials: usize) -> Result<Surface> {
        let is_sound = |(nodes, weights): &([u32; ROW], [f32; ROW])| {
            let sum: f64 = weights.iter().map(|&w| f64::from(w)).sum();
            (sum - 1.0).abs() <= WEIGHTS && nodes.iter().all(|&slot| is_node(lattice, slot))
        };
        if !self.rows.iter().all(is_sound) {
            return Err(Error::argument(
                "a vertex hangs on what are no nodes, or by weights that are not one in sum",
            ));
        }
        if self.materials.iter().any(|&m| m == 0 || usize::from(m) > materials) {
            return Err(Error::argument(format!("a vertex's material is none of {materials}")));
        }
        let mesh = TriangleMesh {
            positions: self.positions.into_iter().map(Vec3::from).collect(),
            triangles: self.triangles,
            uvs: self.uvs,
        };
        mesh.check()?;
        let rows = self.rows.into_iter().map(|(nodes, weights)| Row { nodes, weights }).collect();
        Surface::bound(mesh, rows, self.materials)
    }
}
