//! Simulations: created from a model, stepped by their owner.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use parking_lot::Mutex;

use super::boundary::{
    Desc, boundary, check_out, check_output, init_desc, panic_fault, read_desc, read_list, write_output,
};
use super::convert::{backend, check_bits, oriented_box, place_out, pose, vector};
use super::handle::{self, Handle};
use super::model::log_of;
use super::status::{
    Fault, PLP_ERR_INVALID_HANDLE, PLP_ERR_POISONED, PLP_NOTHING, PLP_OK, PLP_TRUNCATED, plp_status,
};
use super::types::*;
use crate::error::Error;
use crate::log::{self, Log};
use crate::sim::{LoadId, NodeField, Precision, Sim, SimDesc, Snapshot, ToolId};
use crate::solver::load::{Load, Region};
use crate::solver::method::{EfgDesc, Elasticity, Method, Scheme};

/// What a `plp_sim` stands for.
#[derive(Debug)]
pub(super) struct SimBody {
    pub sim: Sim,
    log: Log,
    /// Tools by the tag of their handle.
    tools: Vec<(u64, ToolId)>,
    /// Whether the log was told that cells turned over.
    is_overturned: bool,
    link: Arc<Link>,
}

/// What a simulation and its ports share, besides the channels of the ports themselves.
#[derive(Debug, Default)]
pub(super) struct Link {
    /// A panic left the simulation in an unknown state: its ports must not show what it computes.
    poisoned: AtomicBool,
    /// Tags of tools whose handles were destroyed, to be removed by the simulation's owner.
    pub departed: Mutex<Vec<u64>>,
}

impl Link {
    /// Whether a panic ended the simulation.
    pub fn is_poisoned(&self) -> bool {
        // Acquire pairs with the Release in `poison`: who sees the flag also sees that nothing was published
        // after it.
        self.poisoned.load(Ordering::Acquire)
    }

    fn poison(&self) {
        // Release: everything the failed call published stays before the flag.
        self.poisoned.store(true, Ordering::Release);
    }
}

impl Handle for plp_sim {
    const KIND: u32 = 0x504C_5053;
    const NAME: &'static str = "plp_sim";
    type Body = SimBody;
}

/// Runs a call of the simulation's owner: alone on the handle, with panics poisoning the simulation, and not at all on a lost device.
pub(super) fn with_sim(
    sim: *const plp_sim,
    call: impl FnOnce(&mut SimBody) -> Result<plp_status, Fault>,
) -> Result<plp_status, Fault> {
    with_any_sim(sim, |body| {
        body.remove_departed();
        body.sim.check()?;
        call(body)
    })
}

/// As [`with_sim`], on a lost device too.
pub(super) fn with_any_sim(
    sim: *const plp_sim,
    call: impl FnOnce(&mut SimBody) -> Result<plp_status, Fault>,
) -> Result<plp_status, Fault> {
    let mut body = handle::hold(sim).map_err(handle::fault::<plp_sim>)?;
    if body.link.is_poisoned() {
        return Err(Fault::new(PLP_ERR_POISONED, "an earlier call broke this simulation; destroy it"));
    }
    let done = catch_unwind(AssertUnwindSafe(|| call(&mut body)));
    done.unwrap_or_else(|panic| {
        body.link.poison();
        Err(panic_fault(panic.as_ref()))
    })
}

impl SimBody {
    /// Removes the tools whose handles were destroyed since the last call.
    fn remove_departed(&mut self) {
        let departed = std::mem::take(&mut *self.link.departed.lock());
        for tag in departed {
            if let Some(position) = self.tools.iter().position(|(known, _)| *known == tag) {
                let (_, tool) = self.tools.swap_remove(position);
                // A tool that the simulation no longer has is what is wanted.
                let _ = self.sim.remove_tool(tool);
            }
        }
    }

    /// Makes all what it was.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), Error> {
        self.sim.restore(snapshot)?;
        self.is_overturned = false;
        Ok(())
    }

    /// Notes a tool and gives its handle's tag and link.
    pub fn admit_tool(&mut self, tool: ToolId) -> (u64, Arc<Link>) {
        // Relaxed: only uniqueness within the process matters.
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let tag = NEXT.fetch_add(1, Ordering::Relaxed);
        self.tools.push((tag, tool));
        (tag, self.link.clone())
    }

    /// A tool of this simulation. Its thread may be inside it.
    pub fn tool(&self, tool: *const plp_tool) -> Result<ToolId, Fault> {
        let tag = handle::tag(tool).map_err(handle::fault::<plp_tool>)?;
        let found = self.tools.iter().find(|(known, _)| *known == tag);
        found
            .map(|(_, id)| *id)
            .ok_or_else(|| Fault::new(PLP_ERR_INVALID_HANDLE, "the plp_tool belongs to another simulation"))
    }

    /// The id by which a host knows a tool; 0 where its handle is gone.
    pub fn id_of(&self, tool: ToolId) -> u64 {
        self.tools.iter().find(|(_, known)| *known == tool).map_or(0, |(tag, _)| *tag)
    }

    /// What ports of this simulation share with it.
    pub fn link(&self) -> Arc<Link> {
        self.link.clone()
    }
}

/// Fills a desc with defaults. desc_size is sizeof(plp_sim_desc).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_desc_init(desc: *mut plp_sim_desc, desc_size: u32) -> plp_status {
    // SAFETY: the host offers `desc_size` bytes.
    boundary(|| unsafe { init_desc(desc, desc_size) })
}

/// Creates a simulation of a model, at rest at time 0. desc may be NULL for defaults (@nullable desc). The
/// simulation is the caller's, to be given to plp_sim_destroy; the model may be destroyed before it. On a GPU it may answer
/// PLP_ERR_NO_DEVICE, PLP_ERR_DEVICE, PLP_ERR_LIMIT (memory) or PLP_ERR_UNSUPPORTED (double precision).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_create(
    model: *const plp_model,
    desc: *const plp_sim_desc,
    sim: *mut *mut plp_sim,
) -> plp_status {
    boundary(|| {
        let model = handle::share(model).map_err(handle::fault::<plp_model>)?;
        check_out(sim, "sim")?;
        let desc = if desc.is_null() {
            plp_sim_desc::with_defaults()
        } else {
            // SAFETY: the host's desc is as long as it says.
            unsafe { read_desc(desc) }?
        };
        let settings = settings_of(&desc)?;

        let created = Sim::new(model.model.clone(), &settings)?;
        let mut log = log_of(desc.log, desc.log_user);
        let place = created.place();
        if let Some(line) = log::fallback_line(place) {
            log.info(|| line);
        }
        log.info(|| log::sim_line(&settings, place, &created.statistics()));

        let body =
            SimBody { sim: created, log, tools: Vec::new(), is_overturned: false, link: Arc::default() };
        // SAFETY: checked not to be NULL; the host offers a pointer's room.
        unsafe { sim.write_unaligned(handle::create::<plp_sim>(body, 0, None)) };
        Ok(PLP_OK)
    })
}

/// Ends a simulation. Its tools and surfaces stay valid handles that answer PLP_STOPPED until they are
/// destroyed. NULL is fine.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_destroy(sim: *mut plp_sim) -> plp_status {
    boundary(|| {
        drop(handle::destroy(sim).map_err(handle::fault::<plp_sim>)?);
        Ok(PLP_OK)
    })
}

/// Advances by one step of plp_sim_desc.step_s. Tools move to their newest poses over the step.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_step(sim: *mut plp_sim) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            let stepped = body.sim.step();
            if let Err(error @ (Error::Diverged { .. } | Error::Device(_))) = &stepped {
                body.log.warning(|| error.to_string());
            }
            if body.sim.statistics().volume_ratio[0] <= 0.0
                && !std::mem::replace(&mut body.is_overturned, true)
            {
                body.log.warning(|| log::OVERTURNED.to_owned());
            }
            stepped?;
            Ok(PLP_OK)
        })
    })
}

/// Lets the tissue come to rest under its loads, tools where they are, without simulated time passing. Stops
/// when no node accelerates by more than tolerance_m_s2, or after max_substeps. The largest acceleration left
/// goes to residual_m_s2 (@nullable residual_m_s2).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_settle(
    sim: *mut plp_sim,
    tolerance_m_s2: f64,
    max_substeps: u64,
    residual_m_s2: *mut f64,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            if !(tolerance_m_s2.is_finite() && tolerance_m_s2 > 0.0) {
                return Err(Fault::argument(format!("tolerance_m_s2 {tolerance_m_s2} is not positive")));
            }
            let residual = body.sim.settle(tolerance_m_s2, max_substeps)?;
            if residual > tolerance_m_s2 {
                body.log
                    .warning(|| format!("settle: {residual:.3} m/s² are left after {max_substeps} substeps"));
            }
            if !residual_m_s2.is_null() {
                // SAFETY: the host offers room for a double.
                unsafe { residual_m_s2.write_unaligned(residual) };
            }
            Ok(PLP_OK)
        })
    })
}

/// Back to the rest state at time 0. Loads, tools and gravity stay.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_reset(sim: *mut plp_sim) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            body.sim.reset();
            body.is_overturned = false;
            Ok(PLP_OK)
        })
    })
}

/// Changes gravity: three doubles in m/s^2, world frame.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_set_gravity(sim: *mut plp_sim, gravity_m_s2: *const f64) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            // SAFETY: the host passes NULL or three doubles.
            let gravity = unsafe { read_triple(gravity_m_s2, "gravity_m_s2") }?;
            body.sim.set_gravity(vector(&gravity, "gravity_m_s2")?)?;
            Ok(PLP_OK)
        })
    })
}

/// Adds a load. Its id, never 0 and never used again in this simulation, goes to `id`.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_add_load(
    sim: *mut plp_sim,
    load: *const plp_load,
    id: *mut u64,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            check_out(id, "id")?;
            // SAFETY: the host's desc is as long as it says.
            let load = load_of(&unsafe { read_desc(load) }?)?;
            let added = body.sim.add_load(&load)?;
            // SAFETY: checked not to be NULL; the host offers room for an id.
            unsafe { id.write_unaligned(added.0) };
            Ok(PLP_OK)
        })
    })
}

/// Fills a load with defaults: none of any kind. load_size is sizeof(plp_load).
///
/// @thread any
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_load_init(load: *mut plp_load, load_size: u32) -> plp_status {
    // SAFETY: the host offers `load_size` bytes.
    boundary(|| unsafe { init_desc(load, load_size) })
}

/// Removes a load.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_remove_load(sim: *mut plp_sim, id: u64) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            body.sim.remove_load(LoadId(id))?;
            Ok(PLP_OK)
        })
    })
}

/// Moves the rigid region of a label: `motion` takes it, in the world frame, from its rest place to its new
/// one, which it reaches at the end of the next step.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_drive_region(
    sim: *mut plp_sim,
    label: u32,
    motion: *const plp_pose,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            if motion.is_null() {
                return Err(Fault::null("motion"));
            }
            // SAFETY: not NULL; the host passes a pose.
            let motion = pose(&unsafe { motion.read_unaligned() }, "motion")?;
            let label =
                u16::try_from(label).map_err(|_| Fault::argument(format!("label {label} is above 65535")))?;
            body.sim.drive_region(label, &motion)?;
            Ok(PLP_OK)
        })
    })
}

/// The first triangle of the contact surface, as deformed now, that a ray meets. origin_m and direction are
/// three doubles each, world frame; direction need not be of unit length. Answers PLP_NOTHING where the ray
/// meets none.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_pick(
    sim: *const plp_sim,
    origin_m: *const f64,
    direction: *const f64,
    pick: *mut plp_pick,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            check_out(pick, "pick")?;
            // SAFETY: the host passes NULL or three doubles, twice.
            let (origin, along) =
                unsafe { (read_triple(origin_m, "origin_m")?, read_triple(direction, "direction")?) };
            let (origin, along) = (vector(&origin, "origin_m")?, vector(&along, "direction")?);
            let Some(along) = along.try_normalize(1e-150) else {
                return Err(Fault::argument("direction has no length"));
            };
            let Some(met) = body.sim.pick(origin, along)? else { return Ok(PLP_NOTHING) };
            let met = plp_pick {
                point_m: met.point_m.into(),
                normal: met.normal.into(),
                distance_m: met.distance_m,
                triangle: met.triangle,
                material: met.material.into(),
            };
            // SAFETY: checked not to be NULL; the host offers room for a pick.
            unsafe { pick.write_unaligned(met) };
            Ok(PLP_OK)
        })
    })
}

/// Where the simulation runs, and why not on a GPU. place_size is sizeof(plp_place).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_get_place(
    sim: *const plp_sim,
    place: *mut plp_place,
    place_size: u32,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            check_output(place, place_size)?;
            let found = place_out(body.sim.place());
            // SAFETY: checked above; the host offers `place_size` bytes.
            unsafe { write_output(place, place_size, &found) };
            Ok(PLP_OK)
        })
    })
}

/// A quantity of all nodes (PLP_NODES_ value), three doubles each, always in the same order. Writes at most
/// `capacity` nodes to xyz and the number of all to node_count; answers PLP_TRUNCATED where capacity is less.
/// xyz may be NULL with a capacity of 0 (@nullable xyz).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_get_nodes(
    sim: *const plp_sim,
    field: u32,
    xyz: *mut f64,
    capacity: u64,
    node_count: *mut u64,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            let field = match field {
                PLP_NODES_REST_POSITION => NodeField::RestPosition,
                PLP_NODES_DISPLACEMENT => NodeField::Displacement,
                PLP_NODES_VELOCITY => NodeField::Velocity,
                other => {
                    return Err(Fault::argument(format!("field {other} is no PLP_NODES_ value")));
                }
            };
            let triples: Vec<[f64; 3]> = body.sim.nodes(field).into_iter().map(Into::into).collect();
            body.sim.check()?;
            // SAFETY: the host offers `capacity` nodes of three doubles, and room for a count.
            unsafe { write_list(&triples, xyz.cast(), capacity, node_count, "xyz") }
        })
    })
}

/// The contacts of a tool in the last substep. Writes at most `capacity` of them and the number of all to
/// contact_count; answers PLP_TRUNCATED where capacity is less. contacts may be NULL with a capacity of 0
/// (@nullable contacts). The tool's thread may be using it meanwhile.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_get_contacts(
    sim: *const plp_sim,
    tool: *const plp_tool,
    contacts: *mut plp_contact,
    capacity: u64,
    contact_count: *mut u64,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            let tool = body.tool(tool)?;
            let touched: Vec<_> = body
                .sim
                .contacts(tool)?
                .iter()
                .map(|contact| plp_contact {
                    point_m: contact.point_m.into(),
                    normal: contact.normal.into(),
                    depth_m: contact.depth_m,
                    force_n: contact.force_n.into(),
                    material: contact.material.into(),
                    reserved: 0,
                })
                .collect();
            // SAFETY: the host offers `capacity` contacts and room for a count.
            unsafe { write_list(&touched, contacts, capacity, contact_count, "contacts") }
        })
    })
}

/// Writes as much of a list as fits, and its length.
///
/// # Safety
/// `out` is NULL or has room for `capacity` elements, `count` is NULL or has room for a number.
pub(super) unsafe fn write_list<T: Copy>(
    list: &[T],
    out: *mut T,
    capacity: u64,
    count: *mut u64,
    what: &str,
) -> Result<plp_status, Fault> {
    check_out(count, "the count")?;
    if capacity > 0 {
        check_out(out, what)?;
    }
    let fits = list.len().min(usize::try_from(capacity).unwrap_or(usize::MAX));
    for (i, element) in list[..fits].iter().enumerate() {
        // SAFETY: i is below `capacity`, and the pointer is not NULL then.
        unsafe { out.add(i).write_unaligned(*element) };
    }
    // SAFETY: checked not to be NULL.
    unsafe { count.write_unaligned(list.len() as u64) };
    Ok(if fits < list.len() { PLP_TRUNCATED } else { PLP_OK })
}

/// Three doubles.
///
/// # Safety
/// `from` is NULL or leads to three doubles.
unsafe fn read_triple(from: *const f64, what: &str) -> Result<[f64; 3], Fault> {
    // SAFETY: promised by the caller.
    let values = unsafe { read_list(from.cast::<[f64; 3]>(), 1, what) }?;
    Ok(values[0])
}

fn settings_of(desc: &plp_sim_desc) -> Result<SimDesc, Fault> {
    check_bits(desc.flags, PLP_SIM_SLEEPING | PLP_SIM_REST_UNDER_GRAVITY, "flags")?;
    check_bits(desc.reserved, 0, "reserved")?;
    let precision = match desc.precision {
        PLP_PRECISION_SINGLE => Precision::Single,
        PLP_PRECISION_DOUBLE => Precision::Double,
        other => return Err(Fault::argument(format!("precision {other} is no PLP_PRECISION_ value"))),
    };
    let within = |value: f64, low: f64, high: f64, what: &str| {
        if (low..=high).contains(&value) {
            Ok(value)
        } else {
            Err(Fault::argument(format!("{what} {value} is not between {low} and {high}")))
        }
    };
    Ok(SimDesc {
        backend: backend(desc.backend, desc.device)?,
        method: method(desc)?,
        precision,
        threads: desc.threads as usize,
        step_s: within(desc.step_s, 1e-6, 1.0, "step_s")?,
        substeps: (desc.substeps > 0).then_some(desc.substeps),
        gravity_m_s2: vector(&desc.gravity_m_s2, "gravity_m_s2")?,
        rest_under_gravity: desc.flags & PLP_SIM_REST_UNDER_GRAVITY != 0,
        drag_per_s: desc.drag_per_s,
        sleeping: desc.flags & PLP_SIM_SLEEPING != 0,
        cut_nodes: usize::try_from(desc.cut_nodes).unwrap_or(usize::MAX),
        least_part_cells: desc.least_part_cells,
    })
}

fn method(desc: &plp_sim_desc) -> Result<Method, Fault> {
    let elasticity = match desc.elasticity {
        PLP_ELASTICITY_COROTATED => Elasticity::Corotated,
        PLP_ELASTICITY_LINEAR => Elasticity::Linear,
        PLP_ELASTICITY_ST_VENANT_KIRCHHOFF => Elasticity::StVenantKirchhoff,
        other => return Err(Fault::argument(format!("elasticity {other} is no PLP_ELASTICITY_ value"))),
    };
    let scheme = match desc.scheme {
        PLP_SCHEME_BACKWARD_EULER => Scheme::BackwardEuler,
        PLP_SCHEME_PAPER => Scheme::Paper,
        other => return Err(Fault::argument(format!("scheme {other} is no PLP_SCHEME_ value"))),
    };
    let (tolerance, max_iterations) = (desc.tolerance, desc.max_iterations);
    match desc.method {
        PLP_METHOD_LATTICE => Ok(Method::Lattice),
        PLP_METHOD_EFG => {
            Ok(Method::Efg(EfgDesc { elasticity, scheme, tolerance, max_iterations, ..EfgDesc::default() }))
        }
        other => Err(Fault::argument(format!("method {other} is no PLP_METHOD_ value"))),
    }
}

fn load_of(load: &plp_load) -> Result<Load, Fault> {
    let region = || -> Result<Region, Fault> {
        let (pose, half_extents_m) = oriented_box(&load.region, "region")?;
        Ok(Region { pose, half_extents_m })
    };
    match load.kind {
        PLP_LOAD_POINT => {
            Ok(Load::Point { at_m: vector(&load.at_m, "at_m")?, force_n: vector(&load.force_n, "force_n")? })
        }
        PLP_LOAD_TRACTION => {
            Ok(Load::Traction { region: region()?, traction_pa: vector(&load.traction_pa, "traction_pa")? })
        }
        PLP_LOAD_PRESSURE if load.pressure_pa.is_finite() => {
            Ok(Load::Pressure { region: region()?, pressure_pa: load.pressure_pa })
        }
        PLP_LOAD_PRESSURE => Err(Fault::argument("pressure_pa is not finite")),
        other => Err(Fault::argument(format!("kind {other} is no PLP_LOAD_ value"))),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::model::plp_model_create;
    use super::super::status::{PLP_ERR_PANIC, PLP_STOPPED};
    use super::super::surface::{
        plp_surface_create, plp_surface_destroy, plp_surface_map, plp_surface_unmap,
    };
    use super::super::tool::{plp_tool_create, plp_tool_destroy, plp_tool_get_force};
    use super::*;

    /// A simulation of a single cell, and a tool of it, with a device or without (NULL).
    pub(in crate::capi) fn cell_and_tool(haptic: *const plp_haptic_desc) -> (*mut plp_sim, *mut plp_tool) {
        let still = plp_pose { position_m: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] };
        let mut jelly = [0; 64];
        jelly[0] = b'j'.cast_signed() as std::ffi::c_char;
        let material =
            plp_material { young_pa: 1e3, poisson: 0.3, density_kg_m3: 1e3, damping_s: 0.0, name: jelly };
        let used = plp_label_use { label: 1, kind: PLP_USE_TISSUE, material };
        let grid = plp_label_grid {
            labels: (&raw const used.label).cast(), // the bytes of a 1
            label_bytes: 2,
            voxels: [1; 3],
            spacing_m: [0.01; 3],
            frame: still,
            index_to_world: std::ptr::null(),
        };
        let what = plp_model_desc {
            grid: &raw const grid,
            uses: &raw const used,
            use_count: 1,
            ..plp_model_desc::with_defaults()
        };
        let ball = plp_tool_part {
            kind: PLP_SHAPE_SPHERE,
            reserved: 0,
            pose: still,
            radius_m: 0.01,
            half_length_m: 0.0,
            half_extents_m: [0.0; 3],
        };
        let probe =
            plp_tool_desc { part_count: 1, parts: &raw const ball, haptic, ..plp_tool_desc::with_defaults() };
        let (mut model, mut sim, mut tool) =
            (std::ptr::null_mut(), std::ptr::null_mut(), std::ptr::null_mut());
        // SAFETY: the structs above live until the calls return.
        unsafe {
            assert_eq!(plp_model_create(&raw const what, &raw mut model), PLP_OK);
            assert_eq!(plp_sim_create(model, std::ptr::null(), &raw mut sim), PLP_OK);
            assert_eq!(plp_tool_create(sim, &raw const probe, &raw mut tool), PLP_OK);
            assert_eq!(super::super::model::plp_model_destroy(model), PLP_OK);
        }
        (sim, tool)
    }

    #[test]
    fn cells_that_turn_over_are_warned_of_once() {
        let (sim, tool) = cell_and_tool(std::ptr::null());
        let lines = Arc::new(Mutex::new(Vec::new()));
        let heard = lines.clone();
        let turned = boundary(|| {
            with_sim(sim, |body| {
                body.log = Log::to(move |_, line| heard.lock().push(line.to_owned()));
                // The cell is seen in a mirror: its springs are as long as they were.
                let lattice = body.sim.model().lattice();
                let tops: Vec<_> =
                    lattice.slots().filter(|&slot| lattice.rest_position(slot).z > 0.005).collect();
                for slot in tops {
                    body.sim.set_node(
                        slot,
                        crate::math::Vec3::new(0.0, 0.0, -0.02),
                        crate::math::Vec3::zeros(),
                    )?;
                }
                Ok(PLP_OK)
            })
        });
        assert_eq!(turned, PLP_OK);
        // SAFETY: living handles.
        unsafe {
            assert_eq!((plp_sim_step(sim), plp_sim_step(sim)), (PLP_OK, PLP_OK));
            assert_eq!((plp_tool_destroy(tool), plp_sim_destroy(sim)), (PLP_OK, PLP_OK));
        }
        assert_eq!(*lines.lock(), [log::OVERTURNED]);
    }

    #[test]
    fn a_panic_poisons_the_simulation_with_its_surfaces_and_lets_go_of_its_tools() {
        let (sim, tool) = cell_and_tool(std::ptr::null());
        let (mut surface, mut view) = (std::ptr::null_mut(), std::mem::MaybeUninit::uninit());
        let view_size = size_of::<plp_surface_view>() as u32;
        // SAFETY: living handles, and room for a view.
        unsafe {
            assert_eq!(plp_surface_create(sim, 0, &raw mut surface), PLP_OK);
            assert_eq!(plp_surface_map(surface, view.as_mut_ptr(), view_size), PLP_OK);
            assert_eq!(plp_surface_unmap(surface), PLP_OK);
        }
        let status = boundary(|| with_sim(sim, |_| panic!("a defect")));
        assert_eq!(status, PLP_ERR_PANIC);
        let mut force = std::mem::MaybeUninit::uninit();
        // SAFETY: living handles, and room for a force.
        unsafe {
            assert_eq!(plp_sim_step(sim), PLP_ERR_POISONED);
            assert_eq!(plp_tool_get_force(tool, force.as_mut_ptr()), PLP_STOPPED);
            assert_eq!(force.assume_init().force_n, [0.0; 3]);
            assert_eq!(plp_surface_map(surface, view.as_mut_ptr(), view_size), PLP_ERR_POISONED);
            assert_eq!(plp_surface_destroy(surface), PLP_OK);
            assert_eq!(plp_sim_destroy(sim), PLP_OK);
            assert_eq!(plp_tool_destroy(tool), PLP_OK);
        }
    }
}
