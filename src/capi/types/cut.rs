//! Blades, what cuts leave, and what is removed.

/// The cutting edge of a tool.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct plp_blade {
    /// The points of a polyline, x, y, z in metres, tool frame [point_count * 3]. It cuts what it sweeps, in both directions.
    pub edge_m: *const f64,
    /// Number of points, 2 to 64.
    pub point_count: u32,
    /// Must be 0.
    pub reserved: u32,
    /// The toughness that tissue has for this edge, in J/m^2, which is N for each metre of edge: up to that force tissue sticks to the edge, then it is cut. 0 cuts
    /// freely. Measured values: 76 to 186 for a pig's liver, some 2000 for skin.
    pub toughness_j_m2: f64,
}

/// A part of the tissue that hangs together.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_part {
    /// Its volume at rest in m^3.
    pub volume_m3: f64,
    /// Its mass in kg.
    pub mass_kg: f64,
    /// Velocity of its centre of mass in m/s, world frame.
    pub velocity_m_s: [f64; 3],
    /// 1 where nodes of it are held, along all axes; otherwise 0.
    pub is_held: u32,
    /// Names it for plp_sim_remove_part. A part that is cut further leaves its name to one of what it becomes.
    pub id: u32,
}

/// How much tissue was removed.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct plp_removed {
    /// Its volume at rest in m^3.
    pub volume_m3: f64,
    /// Its mass in kg.
    pub mass_kg: f64,
}
