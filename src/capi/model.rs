//! Models: built from a desc, shared by simulations.

use std::collections::BTreeMap;
use std::ffi::{CString, c_char, c_void};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use nalgebra as na;

use super::boundary::{
    boundary, check_out, check_output, init_desc, read_array, read_desc, read_list, read_str, write_output,
};
use super::convert::{check_bits, fix_of, material, material_out, pose, pose_out};
use super::handle::{self, Handle};
use super::status::{Fault, PLP_OK, plp_status};
use super::types::*;
use crate::log::{self, Log};
use crate::math::Vec3;
use crate::model::grid::{LabelGrid, ResampleRule, voxel_count};
use crate::model::import;
use crate::model::intensity::HounsfieldRange;
use crate::model::material::Material;
use crate::model::mesh::TriangleMesh;
use crate::model::phantom::{thorax, thorax_uses};
use crate::model::{Build, Fix, LabelUse, Model, SurfaceSource};

/// Cells of the generated thorax where the host does not choose.
const PHANTOM_CELL_M: f64 = 0.006;

/// What a `plp_model` stands for.
#[derive(Debug)]
pub(super) struct ModelBody {
    pub model: Arc<Model>,
    /// The cap on Young's modulus, 0 for none, and how many materials it lowered.
    cap: (f64, u32),
}

impl Handle for plp_model {
    const KIND: u32 = 0x504C_504D;
    const NAME: &'static str = "plp_model";
    type Body = ModelBody;
}

/// Fills a desc with defaults. desc_size is sizeof(plp_model_desc).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_model_desc_init(desc: *mut plp_model_desc, desc_size: u32) -> plp_status {
    // SAFETY: the host offers `desc_size` bytes.
    boundary(|| unsafe { init_desc(desc, desc_size) })
}

/// Builds a model. Everything that the desc points to is copied; nothing is kept. May take seconds: the
/// desc's progress callback is told, and may cancel. The model is the caller's, to be given to
/// plp_model_destroy.
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_model_create(
    desc: *const plp_model_desc,
    model: *mut *mut plp_model,
) -> plp_status {
    boundary(|| {
        check_out(model, "model")?;
        // SAFETY: the host's desc is as long as it says.
        let desc = unsafe { read_desc(desc) }?;
        let started = Instant::now();

        let mut progress = |fraction: f32, stage: &str| report(&desc, fraction, stage);
        if !progress(0.0, "reading") {
            return Err(crate::error::Error::Cancelled.into());
        }
        // SAFETY: the host's pointers lead where the header says.
        let build = unsafe { build_of(&desc) }?;
        let built = build.run(&mut progress)?;

        let capped = capped(&build, built.materials());
        let cap = (desc.young_cap_pa, capped.len() as u32);
        let mut log = log_of(desc.log, desc.log_user);
        log.info(|| log::model_line(&built, started.elapsed().as_secs_f64()));
        if !capped.is_empty() {
            log.warning(|| {
                format!("model: Young's modulus of {} lowered to {} Pa", capped.join(", "), cap.0)
            });
        }

        // Finding them takes a while on a large model, which nobody should wait for who does not listen.
        if let Some(line) = desc.log.and_then(|_| log::loose_line(&built)) {
            log.warning(|| line);
        }

        let handle = handle::create::<plp_model>(ModelBody { model: Arc::new(built), cap }, 0, None);
        // SAFETY: checked not to be NULL; the host offers a pointer's room.
        unsafe { model.write_unaligned(handle) };
        Ok(PLP_OK)
    })
}

/// Writes a model to a file, which plp_model_load reads faster than plp_model_create builds. A file of that name is replaced. The file
/// depends on nothing but the model: it can be read on any machine, by a library of the same format version.
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_model_save(model: *const plp_model, path: *const c_char) -> plp_status {
    boundary(|| {
        let body = handle::share(model).map_err(handle::fault::<plp_model>)?;
        // SAFETY: the host's string, or NULL, which is refused.
        let path = unsafe { read_str(path, "path") }?;
        body.model.save(path)?;
        Ok(PLP_OK)
    })
}

/// Reads a model from a file that plp_model_save wrote. What simulations of it compute is the same to the last bit. Materials are as
/// they were simulated, so that plp_model_info.young_cap_pa is 0. A file that is damaged, or made to deceive, is refused with PLP_ERR_FORMAT. The model is
/// the caller's, to be given to plp_model_destroy.
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_model_load(path: *const c_char, model: *mut *mut plp_model) -> plp_status {
    boundary(|| {
        check_out(model, "model")?;
        // SAFETY: the host's string, or NULL, which is refused.
        let loaded = Model::load(unsafe { read_str(path, "path") }?)?;
        let handle =
            handle::create::<plp_model>(ModelBody { model: Arc::new(loaded), cap: (0.0, 0) }, 0, None);
        // SAFETY: checked not to be NULL; the host offers a pointer's room.
        unsafe { model.write_unaligned(handle) };
        Ok(PLP_OK)
    })
}

/// Gives a model back. Simulations made from it keep what they need. NULL is fine.
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_model_destroy(model: *mut plp_model) -> plp_status {
    boundary(|| {
        drop(handle::destroy(model).map_err(handle::fault::<plp_model>)?);
        Ok(PLP_OK)
    })
}

/// What a model turned out to be. info_size is sizeof(plp_model_info).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_model_get_info(
    model: *const plp_model,
    info: *mut plp_model_info,
    info_size: u32,
) -> plp_status {
    boundary(|| {
        let body = handle::share(model).map_err(handle::fault::<plp_model>)?;
        check_output(info, info_size)?;
        // SAFETY: checked above; the host offers `info_size` bytes.
        unsafe { write_output(info, info_size, &info_of(&body)) };
        Ok(PLP_OK)
    })
}

/// Material number `index` of a model, from 1 to plp_model_info.material_count, as it is simulated (after the
/// cap).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_model_get_material(
    model: *const plp_model,
    index: u32,
    material: *mut plp_material,
) -> plp_status {
    boundary(|| {
        let body = handle::share(model).map_err(handle::fault::<plp_model>)?;
        check_out(material, "material")?;
        let materials = body.model.materials();
        let found = (index as usize).checked_sub(1).and_then(|position| materials.get(position));
        let found = found.ok_or_else(|| {
            Fault::argument(format!("material {index} does not exist: they are 1 to {}", materials.len()))
        })?;
        // SAFETY: checked not to be NULL; the host offers room for a material.
        unsafe { material.write_unaligned(material_out(found)) };
        Ok(PLP_OK)
    })
}

fn info_of(body: &ModelBody) -> plp_model_info {
    let (model, lattice) = (&body.model, body.model.lattice());
    let cells = lattice.cells();
    let size = Vec3::from(cells.map(|n| n as f64)) * lattice.cell_m();

    // The box around the eight corners of the grid.
    let (mut low, mut high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
    for corner in 0..8_u8 {
        let local = Vec3::from_fn(|axis, _| if corner >> axis & 1 == 1 { size[axis] } else { 0.0 });
        let world = (model.frame() * na::Point3::from(local)).coords;
        (low, high) = (low.inf(&world), high.sup(&world));
    }

    plp_model_info {
        node_count: lattice.node_count() as u64,
        cell_count: lattice.cell_count() as u64,
        cell_m: lattice.cell_m(),
        frame: pose_out(&model.frame()),
        bounds_min_m: low.into(),
        bounds_max_m: high.into(),
        young_cap_pa: body.cap.0,
        capped_material_count: body.cap.1,
        material_count: model.materials().len() as u32,
        surface_count: model.surfaces().len() as u32,
        contact_surface: model.contact_surface() as u32,
        cells: cells.map(|n| n as u32),
        reserved: 0,
    }
}

/// The materials of a model that the cap lowered: those that a use gives with a higher modulus.
fn capped(build: &Build, materials: &[Material]) -> Vec<String> {
    let Some(cap) = build.young_cap_pa else { return Vec::new() };
    let is_capped = |material: &&Material| {
        build.uses.values().any(|used| match used {
            LabelUse::Tissue(given) if given.young_pa > cap => {
                **material == Material { young_pa: cap, ..given.clone() }
            }
            LabelUse::Tissue(_) | LabelUse::Rigid(_) | LabelUse::Empty => false,
        })
    };
    materials.iter().filter(is_capped).map(|material| material.name.clone()).collect()
}

/// A log that calls a host's function.
pub(super) fn log_of(function: plp_log_fn, user: *mut c_void) -> Log {
    struct User(*mut c_void);
    // SAFETY: the pointer is only handed back to the host, in calls that the host makes from a thread of its
    // choice.
    unsafe impl Send for User {}

    let Some(function) = function else { return Log::default() };
    let user = User(user);
    Log::to(move |level, line| {
        let user = &user;
        let level = match level {
            log::Level::Info => PLP_LOG_INFO,
            log::Level::Warning => PLP_LOG_WARNING,
        };
        let line = CString::new(line.replace('\0', " ")).unwrap_or_default();
        // SAFETY: the host gave this function for this signature, and its pointer with it.
        unsafe { function(user.0, level, line.as_ptr()) };
    })
}

/// Tells the host's progress function, if there is one. Whether to go on.
fn report(desc: &plp_model_desc, fraction: f32, stage: &str) -> bool {
    let Some(function) = desc.progress else { return true };
    let stage = CString::new(stage.replace('\0', " ")).unwrap_or_default();
    // SAFETY: the host gave this function for this signature, and its pointer with it.
    let answer = unsafe { function(desc.progress_user, fraction, stage.as_ptr()) };
    answer == 0
}

/// The build that a desc describes.
///
/// # Safety
/// Every pointer of the desc is NULL or leads to what the header says.
unsafe fn build_of(desc: &plp_model_desc) -> Result<Build, Fault> {
    check_bits(desc.fix_faces, 63, "fix_faces")?;
    // SAFETY: promised by the caller, here and below.
    let (grid, own_uses) = unsafe { anatomy(desc) }?;
    let mut build = Build::new(grid);

    build.cell_m = positive(desc.cell_m, "cell_m")?;
    build.young_cap_pa = positive(desc.young_cap_pa, "young_cap_pa")?;
    build.rule = match desc.resample {
        PLP_RESAMPLE_MAJORITY => ResampleRule::Majority,
        PLP_RESAMPLE_NEAREST => ResampleRule::Nearest,
        other => return Err(Fault::argument(format!("resample {other} is no PLP_RESAMPLE_ value"))),
    };

    // The generated thorax, and a solid, bring what labels are; the host's word comes first.
    build.uses = own_uses.unwrap_or_default();
    // SAFETY: promised by the caller.
    build.uses.extend(unsafe { uses(desc) }?);
    // SAFETY: promised by the caller.
    build.fixes = unsafe { fixes(desc) }?;
    build.fix_faces = std::array::from_fn(|face| desc.fix_faces >> face & 1 == 1);

    if desc.surface_count > 0 {
        // SAFETY: promised by the caller.
        build.surfaces = unsafe { surfaces(desc) }?;
    }
    build.contact_surface = match usize::try_from(desc.contact_surface) {
        Ok(index) if index < build.surfaces.len() => Some(index),
        Err(_) if desc.contact_surface == -1 => None,
        _ => {
            return Err(Fault::argument(format!(
                "contact_surface {} is neither -1 nor one of {} surfaces",
                desc.contact_surface,
                build.surfaces.len()
            )));
        }
    };
    Ok(build)
}

/// A length or modulus where 0 means none.
fn positive(value: f64, what: &str) -> Result<Option<f64>, Fault> {
    if value.is_finite() && value >= 0.0 {
        Ok((value > 0.0).then_some(value))
    } else {
        Err(Fault::argument(format!("{what} {value} is neither 0 nor positive")))
    }
}

/// The label grid, and what its labels are where it knows that itself.
///
/// # Safety
/// As [`build_of`].
unsafe fn anatomy(desc: &plp_model_desc) -> Result<(LabelGrid, Option<BTreeMap<u16, LabelUse>>), Fault> {
    let given =
        [desc.grid.is_null(), desc.labels_path.is_null(), desc.ct_path.is_null(), desc.solid.is_null()];
    let given = given.map(|is_null| !is_null);
    match given {
        // SAFETY: promised by the caller.
        [true, false, false, false] => Ok((unsafe { grid_in_memory(&desc.grid.read_unaligned()) }?, None)),
        [false, true, false, false] => {
            // SAFETY: promised by the caller.
            let path = unsafe { read_str(desc.labels_path, "labels_path") }?;
            Ok((import::read_labels(Path::new(path))?, None))
        }
        [false, false, true, false] => {
            // SAFETY: promised by the caller.
            let (path, ranges) = unsafe { (read_str(desc.ct_path, "ct_path")?, hu_ranges(desc)?) };
            Ok((import::read_intensities(Path::new(path))?.to_labels(&ranges)?, None))
        }
        [false, false, false, true] => {
            let Some(cell_m) = positive(desc.cell_m, "cell_m")? else {
                return Err(Fault::argument("a solid needs cell_m, the edge of its cells"));
            };
            // SAFETY: promised by the caller.
            match unsafe { surface(&desc.solid.read_unaligned(), "solid") }? {
                SurfaceSource::Mesh(mesh) => {
                    let around = BTreeMap::from([(0, LabelUse::Empty)]);
                    Ok((LabelGrid::from_solid(&mesh, cell_m)?, Some(around)))
                }
                SurfaceSource::Labels(_) => {
                    Err(Fault::argument("solid must be PLP_SURFACE_MESH or PLP_SURFACE_FILE"))
                }
            }
        }
        [false, false, false, false] => {
            // The phantom is drawn on voxels of the cells' size, as far as it can be.
            let cell_m = positive(desc.cell_m, "cell_m")?.unwrap_or(PHANTOM_CELL_M);
            Ok((thorax(cell_m.clamp(0.001, 0.010))?, Some(thorax_uses())))
        }
        _ => Err(Fault::argument("give only one of grid, labels_path, ct_path and solid")),
    }
}

/// # Safety
/// As [`build_of`], for the grid's pointers.
unsafe fn grid_in_memory(grid: &plp_label_grid) -> Result<LabelGrid, Fault> {
    let voxels = grid.voxels.map(|n| n as usize);
    // Before anything is read: dims that promise too much must not be believed.
    let count = voxel_count(voxels)?;
    // SAFETY: promised by the caller.
    let labels = unsafe {
        match grid.label_bytes {
            1 => {
                let bytes = read_list(grid.labels.cast::<u8>(), count, "grid.labels")?;
                bytes.into_iter().map(u16::from).collect()
            }
            2 => read_list(grid.labels.cast::<u16>(), count, "grid.labels")?,
            other => return Err(Fault::argument(format!("label_bytes is {other}, not 1 or 2"))),
        }
    };
    if grid.index_to_world.is_null() {
        let frame = pose(&grid.frame, "grid.frame")?;
        return Ok(LabelGrid::new(voxels, grid.spacing_m.into(), frame, labels)?);
    }
    // SAFETY: promised by the caller.
    let rows = unsafe { read_list(grid.index_to_world, 12, "grid.index_to_world") }?;
    Ok(LabelGrid::from_affine(voxels, &na::Matrix3x4::from_row_slice(&rows), labels)?)
}

/// # Safety
/// As [`build_of`].
unsafe fn hu_ranges(desc: &plp_model_desc) -> Result<Vec<HounsfieldRange>, Fault> {
    // SAFETY: promised by the caller.
    let ranges = unsafe { read_list(desc.hu_ranges, desc.hu_range_count as usize, "hu_ranges") }?;
    if ranges.is_empty() {
        return Err(Fault::argument("a CT needs hu_ranges to become labels"));
    }
    ranges
        .iter()
        .enumerate()
        .map(|(i, range)| {
            check_bits(range.reserved, 0, "hu_ranges.reserved")?;
            // Before a large file is read for nothing.
            if range.low_hu.is_nan() || range.high_hu.is_nan() || range.low_hu > range.high_hu {
                return Err(Fault::argument(format!(
                    "hu_ranges[{i}] from {} to {} is empty",
                    range.low_hu, range.high_hu
                )));
            }
            Ok(HounsfieldRange {
                low: range.low_hu,
                high: range.high_hu,
                label: label(range.label, &format!("hu_ranges[{i}]"))?,
            })
        })
        .collect()
}

fn label(value: u32, what: &str) -> Result<u16, Fault> {
    u16::try_from(value).map_err(|_| Fault::argument(format!("{what}: label {value} is above 65535")))
}

/// # Safety
/// As [`build_of`].
unsafe fn uses(desc: &plp_model_desc) -> Result<BTreeMap<u16, LabelUse>, Fault> {
    // SAFETY: promised by the caller.
    let list = unsafe { read_list(desc.uses, desc.use_count as usize, "uses") }?;
    let mut map = BTreeMap::new();
    for (i, one) in list.iter().enumerate() {
        let what = format!("uses[{i}]");
        let used = match one.kind {
            PLP_USE_EMPTY => LabelUse::Empty,
            PLP_USE_TISSUE => LabelUse::Tissue(material(&one.material, &what)?),
            PLP_USE_RIGID => LabelUse::Rigid(material(&one.material, &what)?),
            other => return Err(Fault::argument(format!("{what}: kind {other} is no PLP_USE_ value"))),
        };
        if map.insert(label(one.label, &what)?, used).is_some() {
            return Err(Fault::argument(format!("{what}: label {} was named before", one.label)));
        }
    }
    Ok(map)
}

/// # Safety
/// As [`build_of`].
unsafe fn fixes(desc: &plp_model_desc) -> Result<Vec<Fix>, Fault> {
    // SAFETY: promised by the caller.
    let list = unsafe { read_list(desc.fixes, desc.fix_count as usize, "fixes") }?;
    list.iter().enumerate().map(|(i, fix)| fix_of(fix, &format!("fixes[{i}]"))).collect()
}

/// # Safety
/// As [`build_of`].
unsafe fn surfaces(desc: &plp_model_desc) -> Result<Vec<SurfaceSource>, Fault> {
    // SAFETY: promised by the caller.
    let list = unsafe { read_list(desc.surfaces, desc.surface_count as usize, "surfaces") }?;
    // SAFETY: promised by the caller.
    list.iter().enumerate().map(|(i, source)| unsafe { surface(source, &format!("surfaces[{i}]")) }).collect()
}

/// # Safety
/// As [`build_of`], for the source's pointers.
unsafe fn surface(source: &plp_surface_source, what: &str) -> Result<SurfaceSource, Fault> {
    match source.kind {
        PLP_SURFACE_LABELS => {
            // SAFETY: promised by the caller.
            let labels = unsafe { read_list(source.labels, source.label_count as usize, what) }?;
            Ok(SurfaceSource::Labels(labels))
        }
        // SAFETY: promised by the caller.
        PLP_SURFACE_MESH => Ok(SurfaceSource::Mesh(unsafe { mesh(source, what) }?)),
        PLP_SURFACE_FILE => {
            // SAFETY: promised by the caller.
            let path = unsafe { read_str(source.path, &format!("{what}.path")) }?;
            let Some(scale) = positive(source.scale_to_m, &format!("{what}.scale_to_m"))? else {
                return Err(Fault::argument(format!("{what}.scale_to_m is 0")));
            };
            Ok(SurfaceSource::Mesh(import::read_mesh(Path::new(path), scale)?))
        }
        other => Err(Fault::argument(format!("{what}: kind {other} is no PLP_SURFACE_ value"))),
    }
}

/// # Safety
/// As [`surface`].
unsafe fn mesh(source: &plp_surface_source, what: &str) -> Result<TriangleMesh, Fault> {
    let stride = |given: u32, packed: usize| if given == 0 { packed } else { given as usize };
    let vertices = source.vertex_count as usize;

    // SAFETY: promised by the caller, for all three arrays.
    let (positions, triangles, uvs) = unsafe {
        (
            read_array(
                source.positions.cast::<[f32; 3]>(),
                vertices,
                stride(source.position_stride, 12),
                &format!("{what}.positions"),
            )?,
            read_list(
                source.triangles.cast::<[u32; 3]>(),
                source.triangle_count as usize,
                &format!("{what}.triangles"),
            )?,
            if source.uvs.is_null() {
                Vec::new()
            } else {
                read_array(
                    source.uvs.cast::<[f32; 2]>(),
                    vertices,
                    stride(source.uv_stride, 8),
                    &format!("{what}.uvs"),
                )?
            },
        )
    };
    let positions = positions.into_iter().map(|p| Vec3::from(p.map(f64::from))).collect();
    let mesh = TriangleMesh { positions, triangles, uvs };
    mesh.check()?;
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use std::ffi::{CStr, c_char};

    use super::super::boundary::Desc;
    use super::super::status::PLP_ERR_ARGUMENT;
    use super::*;

    #[test]
    fn the_cap_names_the_materials_that_it_lowered() {
        let labels: Vec<u16> = (1..=4).collect();
        let grid =
            LabelGrid::new([4, 1, 1], Vec3::repeat(0.01), crate::math::Pose::identity(), labels).unwrap();
        let mut build = Build::new(grid);
        let stiff = Material::new("stiff", 1e6, 0.3, 1000.0).unwrap();
        let soft = Material::new("soft", 1e3, 0.3, 1000.0).unwrap();
        build.uses.insert(1, LabelUse::Tissue(stiff.clone()));
        build.uses.insert(2, LabelUse::Tissue(stiff.clone()));
        build.uses.insert(3, LabelUse::Tissue(soft));
        build.uses.insert(4, LabelUse::Rigid(stiff.clone()));
        build.uses.insert(5, LabelUse::Tissue(stiff)); // does not occur
        let lowered =
            |build: &Build| capped(build, build.run(&mut |_, _| true).expect("four cells").materials());
        assert!(lowered(&build).is_empty());
        build.young_cap_pa = Some(1e5);
        assert_eq!(lowered(&build), ["stiff"]);
    }

    /// Collects what the library says in a vector.
    unsafe extern "C" fn listen(user: *mut c_void, level: i32, line: *const c_char) {
        // SAFETY: the tests pass a vector and the library a string.
        let (lines, line) = unsafe { (&mut *user.cast::<Vec<(i32, String)>>(), CStr::from_ptr(line)) };
        lines.push((level, line.to_str().unwrap().to_owned()));
    }

    #[test]
    fn a_log_reaches_the_hosts_function() {
        let mut lines: Vec<(i32, String)> = Vec::new();
        let mut log = log_of(Some(listen), (&raw mut lines).cast());
        log.warning(|| "soft".into());
        log_of(None, std::ptr::null_mut()).info(|| unreachable!("nobody listens"));
        assert_eq!(lines, [(PLP_LOG_WARNING, "soft".to_owned())]);
    }

    #[test]
    fn a_closed_mesh_becomes_tissue_and_one_with_a_hole_is_refused() {
        // A double pyramid: corners at 0.1 m along all axes.
        let positions: [[f32; 3]; 6] = [
            [0.1, 0.0, 0.0],
            [-0.1, 0.0, 0.0],
            [0.0, 0.1, 0.0],
            [0.0, -0.1, 0.0],
            [0.0, 0.0, 0.1],
            [0.0, 0.0, -0.1],
        ];
        let triangles: [[u32; 3]; 8] =
            [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        let mut mesh = plp_surface_source {
            kind: PLP_SURFACE_MESH,
            label_count: 0,
            labels: std::ptr::null(),
            positions: positions.as_ptr().cast(),
            uvs: std::ptr::null(),
            triangles: triangles.as_ptr().cast(),
            vertex_count: 6,
            triangle_count: 8,
            position_stride: 0,
            uv_stride: 0,
            path: std::ptr::null(),
            scale_to_m: 0.0,
        };
        let jelly = material_out(&Material::new("jelly", 1e3, 0.3, 1e3).unwrap());
        let tissue = plp_label_use { label: 1, kind: PLP_USE_TISSUE, material: jelly };
        let build = |mesh: &plp_surface_source, cell_m: f64| {
            let desc = plp_model_desc {
                solid: std::ptr::from_ref(mesh),
                uses: &raw const tissue,
                use_count: 1,
                cell_m,
                ..plp_model_desc::with_defaults()
            };
            // SAFETY: everything that the desc points to lives until the call returns.
            let built =
                unsafe { build_of(&desc) }.map_err(|fault| (fault.status, fault.message.into_owned()))?;
            built.run(&mut |_, _| true).map_err(|error| (PLP_OK, error.to_string()))
        };
        let model = build(&mesh, 0.0101).unwrap();
        // Its volume is (2 · 0.1)³ / 6; cells of its sides are in it or not by their centres.
        let volume = model.lattice().cell_count() as f64 * 0.0101_f64.powi(3);
        assert!((volume / (0.008 / 6.0) - 1.0).abs() < 0.05, "{volume} m³");

        assert!(build(&mesh, 0.0).unwrap_err().1.contains("needs cell_m"));
        mesh.triangle_count = 7;
        let (status, message) = build(&mesh, 0.01).unwrap_err();
        assert!(status == PLP_ERR_ARGUMENT && message.contains("not closed"), "{message}");
        mesh.kind = PLP_SURFACE_LABELS;
        assert!(build(&mesh, 0.01).unwrap_err().1.contains("PLP_SURFACE_FILE"));
    }

    #[test]
    fn a_loose_piece_of_tissue_is_a_warning() {
        let mut lines: Vec<(i32, String)> = Vec::new();
        let labels = [1_u8, 1, 1, 0, 1];
        let still = plp_pose { position_m: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] };
        let grid = plp_label_grid {
            labels: labels.as_ptr().cast(),
            label_bytes: 1,
            voxels: [5, 1, 1],
            spacing_m: [0.01; 3],
            frame: still,
            index_to_world: std::ptr::null(),
        };
        let jelly = material_out(&Material::new("jelly", 1e3, 0.3, 1e3).unwrap());
        let uses = [(0, PLP_USE_EMPTY), (1, PLP_USE_TISSUE)].map(|(label, kind)| plp_label_use {
            label,
            kind,
            material: jelly,
        });
        let desc = plp_model_desc {
            grid: &raw const grid,
            uses: uses.as_ptr(),
            use_count: 2,
            log: Some(listen),
            log_user: (&raw mut lines).cast(),
            ..plp_model_desc::with_defaults()
        };
        let mut model = std::ptr::null_mut();
        // SAFETY: everything that the desc points to lives until the calls return.
        unsafe {
            assert_eq!(plp_model_create(&raw const desc, &raw mut model), PLP_OK);
            assert_eq!(plp_model_destroy(model), PLP_OK);
        }
        assert!(
            lines
                .iter()
                .any(|(level, line)| *level == PLP_LOG_WARNING && line.contains("loose pieces of tissue: 1"))
        );
    }
}
