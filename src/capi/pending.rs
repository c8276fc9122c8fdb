//! Stand-ins for parts that other branches bring. Goes away at the merge.

use std::collections::BTreeMap;
use std::path::Path;

use crate::error::{Error, Result};
use crate::model::LabelUse;
use crate::model::grid::LabelGrid;
use crate::model::material::Material;
use crate::model::mesh::TriangleMesh;

#[derive(Debug)]
pub struct Preset {
    pub name: &'static str,
    pub source: &'static str,
}
impl Preset {
    pub fn material(&self) -> Material {
        Material::new(self.name, 5e3, 0.45, 1000.0).unwrap()
    }
}
pub const PRESETS: &[Preset] = &[
    Preset { name: "lung", source: "pending" },
    Preset { name: "liver", source: "pending" },
    Preset { name: "bone", source: "pending" },
];
pub struct HounsfieldRange {
    pub low: f64,
    pub high: f64,
    pub label: u16,
}
pub struct IntensityGrid;
impl IntensityGrid {
    pub fn to_labels(&self, _: &[HounsfieldRange]) -> Result<LabelGrid> {
        Err(Error::Unsupported("pending".into()))
    }
}
pub fn read_labels(path: &Path) -> Result<LabelGrid> {
    let source = std::fs::File::open(path).err().unwrap_or_else(|| std::io::Error::other("pending"));
    Err(Error::Io { path: path.to_owned(), source })
}
pub fn read_intensities(path: &Path) -> Result<IntensityGrid> {
    read_labels(path).map(|_| IntensityGrid)
}
pub fn read_mesh(path: &Path, _: f64) -> Result<TriangleMesh> {
    read_labels(path).map(|_| TriangleMesh::default())
}
pub fn from_affine(_: [usize; 3], _: &nalgebra::Matrix3x4<f64>, _: Vec<u16>) -> Result<LabelGrid> {
    Err(Error::Unsupported("pending".into()))
}
pub fn thorax(voxel_m: f64) -> Result<LabelGrid> {
    let n = (0.1 / voxel_m) as usize;
    LabelGrid::new(
        [n; 3],
        crate::math::Vec3::repeat(voxel_m),
        crate::math::Pose::identity(),
        vec![1; n * n * n],
    )
}
pub fn thorax_uses() -> BTreeMap<u16, LabelUse> {
    BTreeMap::from([(1, LabelUse::Tissue(PRESETS[1].material()))])
}
