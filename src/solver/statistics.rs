//! What a host can read at any time about how the simulation is doing.

/// Counters and gauges of a running simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Steps taken since creation.
    pub steps: u64,
    /// Substeps taken since creation.
    pub substeps: u64,
    /// Simulated time in seconds.
    pub time_s: f64,
    /// Length of the last substep in seconds.
    pub substep_s: f64,
    /// Substeps in the last step.
    pub substeps_per_step: u32,
    /// Largest stable substep at rest, in seconds, damping included.
    pub stable_substep_s: f64,
    /// Wall-clock time of the last step in seconds: from the call, waiting for a surface that is being mapped included, until the
    /// forces can be read. [`Sim::latency`](crate::sim::Sim::latency) counts these times.
    pub step_wall_s: f64,
    /// How long the device was at work on the last step, in seconds: on a GPU by its own clock (which may tick but once in a
    /// microsecond), from the start of the first kernel until the report; on the processor wall-clock time, from the first
    /// substep to the last. The rest of [`Self::step_wall_s`] is spent on asking and answering.
    pub step_device_s: f64,
    /// Simulated time over wall-clock time of the last step.
    pub real_time_factor: f64,
    /// Nodes that were integrated in the last substep.
    pub awake_nodes: u64,
    /// Bricks of 8 × 4 × 4 places for nodes that were integrated in the last substep.
    pub awake_bricks: u64,
    /// All nodes of the model, without those whose tissue was removed.
    pub node_count: u64,
    /// Largest |1 - L / l| of an edge spring in the last substep, l being its length and L its rest length; of the meshless model the largest strain along a cell's
    /// own axes when the last step began.
    pub max_strain: f64,
    /// Smallest and largest volume ratio J of a cell with ν > ¼ in the last substep.
    pub volume_ratio: [f64; 2],
    /// Iterations of the last substep's solution; 0 where steps are explicit.
    pub cg_iterations: u32,
    /// Share of the first residual that the last solution left, computed from what was found; no more than the tolerance where what is left is less than
    /// rounding makes. 0 where steps are explicit.
    pub true_residual: f64,
    /// Surface points in contact in the last substep.
    pub contact_points: u32,
    /// Surface points in tools since creation that were left out, because more were touched at once than a backend has room for. A
    /// force is then too small; a larger rounding of the tool's edges or a coarser surface helps.
    pub dropped_points: u64,
    /// Bytes resident for the state and topology of nodes.
    pub node_bytes: u64,
    /// Steps of the simulation's own thread that ended after the next one was due.
    pub overruns: u64,
    /// Wall-clock time that this thread has let go because it fell too far behind, in seconds.
    pub dropped_s: f64,
    /// Events that nobody read in time.
    pub dropped_events: u64,
    /// Wall-clock time that cutting took in the last step, in seconds; part of [`Self::step_wall_s`].
    pub cut_wall_s: f64,
    /// Cells that cuts have divided.
    pub divided_cells: u64,
    /// Copies of nodes that cuts have made.
    pub copies: u64,
    /// Volume at rest of the tissue that was removed since the last reset, in m³: what is left of the parts and this is what the model had.
    pub removed_m3: f64,
    /// Mass of that tissue, in kg.
    pub removed_kg: f64,
    /// Bytes copied between the host and the GPU since creation, that included; on the processor only the meshless model's rows, to where steps read them.
    pub copied: Copied,
}

/// Bytes copied between the host and a GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Copied {
    /// From the host to the GPU.
    pub to_device: u64,
    /// From the GPU to the host, what it reports of each step included.
    pub to_host: u64,
}

/// Energies in J, computed on request in double precision.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energy {
    /// ½ Σ m v².
    pub kinetic_j: f64,
    /// Springs and volume terms.
    pub elastic_j: f64,
    /// -Σ m g·u with the gravity in force (gravity that the rest shape balances counts as none).
    pub gravity_j: f64,
    /// Work that tools have done on the tissue since creation.
    pub tool_work_j: f64,
}
