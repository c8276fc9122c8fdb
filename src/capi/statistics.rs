//! How a simulation is doing: counts and gauges, times of steps, energies.

use super::boundary::{boundary, check_output, write_output};
use super::sim::with_sim;
use super::status::{PLP_OK, plp_status};
use super::types::*;

/// How the simulation is doing. statistics_size is sizeof(plp_statistics).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_get_statistics(
    sim: *const plp_sim,
    statistics: *mut plp_statistics,
    statistics_size: u32,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            check_output(statistics, statistics_size)?;
            let now = body.sim.statistics();
            let now = plp_statistics {
                steps: now.steps,
                substeps: now.substeps,
                time_s: now.time_s,
                substep_s: now.substep_s,
                stable_substep_s: now.stable_substep_s,
                step_wall_s: now.step_wall_s,
                step_device_s: now.step_device_s,
                real_time_factor: now.real_time_factor,
                node_count: now.node_count,
                awake_node_count: now.awake_nodes,
                awake_brick_count: now.awake_bricks,
                node_bytes: now.node_bytes,
                max_strain: now.max_strain,
                min_volume_ratio: now.volume_ratio[0],
                max_volume_ratio: now.volume_ratio[1],
                substeps_per_step: now.substeps_per_step,
                contact_point_count: now.contact_points,
                dropped_point_count: now.dropped_points,
                bytes_to_device: now.copied.to_device,
                bytes_to_host: now.copied.to_host,
                overrun_count: now.overruns,
                dropped_s: now.dropped_s,
                dropped_event_count: now.dropped_events,
                true_residual: now.true_residual,
                cg_iterations: now.cg_iterations,
                reserved: 0,
                cut_wall_s: now.cut_wall_s,
                divided_cell_count: now.divided_cells,
                copy_count: now.copies,
                removed_m3: now.removed_m3,
                removed_kg: now.removed_kg,
            };
            // SAFETY: checked above; the host offers `statistics_size` bytes.
            unsafe { write_output(statistics, statistics_size, &now) };
            Ok(PLP_OK)
        })
    })
}

/// How long the steps took since creation or plp_sim_reset_latency; plp_sim_reset leaves it alone. latency_size is
/// sizeof(plp_latency).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_get_latency(
    sim: *const plp_sim,
    latency: *mut plp_latency,
    latency_size: u32,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            check_output(latency, latency_size)?;
            let found = body.sim.latency();
            let found = plp_latency {
                step_count: found.steps(),
                p50_s: found.quantile_s(0.5),
                p99_s: found.quantile_s(0.99),
                p999_s: found.quantile_s(0.999),
                max_s: found.max_s(),
                counts: *found.counts(),
            };
            // SAFETY: checked above; the host offers `latency_size` bytes.
            unsafe { write_output(latency, latency_size, &found) };
            Ok(PLP_OK)
        })
    })
}

/// Counts the times of steps from none on, as for a measurement that begins.
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_reset_latency(sim: *mut plp_sim) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            body.sim.reset_latency();
            Ok(PLP_OK)
        })
    })
}

/// The energies now. Visits every spring: for tests and plots, not for every step. energy_size is
/// sizeof(plp_energy).
///
/// @thread owner
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plp_sim_get_energy(
    sim: *const plp_sim,
    energy: *mut plp_energy,
    energy_size: u32,
) -> plp_status {
    boundary(|| {
        with_sim(sim, |body| {
            check_output(energy, energy_size)?;
            let now = body.sim.energy();
            body.sim.check()?;
            let now = plp_energy {
                kinetic_j: now.kinetic_j,
                elastic_j: now.elastic_j,
                gravity_j: now.gravity_j,
                tool_work_j: now.tool_work_j,
            };
            // SAFETY: checked above; the host offers `energy_size` bytes.
            unsafe { write_output(energy, energy_size, &now) };
            Ok(PLP_OK)
        })
    })
}
