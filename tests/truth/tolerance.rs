//! Every tolerance of the truth tests, with its reason, and the one way to apply them.
//!
//! `PLP_TOL_SCALE` multiplies all of them: 0 prints every residual and fails every test.

/// How far a claim may be off.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    pub name: &'static str,
    pub limit: f64,
    pub reason: &'static str,
}

const fn tolerance(name: &'static str, limit: f64, reason: &'static str) -> Tolerance {
    Tolerance { name, limit, reason }
}

// ---- Elasticity --------------------------------------------------

/// Five roundings of each spring's squared change: the unit is (1 + κ / E) (|u| / h) E h² (κ = λ − μ).
pub const ROTATION_F32: Tolerance = tolerance("ROTATION_F32", 3e-7, "five roundings of 6e-8");
pub const ROTATION_F64: Tolerance = tolerance("ROTATION_F64", 6e-16, "five roundings of 1.1e-16");
pub const AFFINE_ENERGY: Tolerance =
    tolerance("AFFINE_ENERGY", 1e-6, "springs are nonlinear by the strain, 1e-7, times a few");
pub const AFFINE_FORCE: Tolerance = tolerance("AFFINE_FORCE", 1e-6, "as AFFINE_ENERGY");
pub const CORNER_ARTEFACT: Tolerance =
    tolerance("CORNER_ARTEFACT", 1e-5, "k3 gamma h / 3 is exact but for 1e-7");
pub const MODULI: Tolerance =
    tolerance("MODULI", 1e-3, "a strain of 1e-4 and what the nonlinear law adds to it");
pub const UNIFORM: Tolerance = tolerance("UNIFORM", 1e-6, "one uniform strain is an exact equilibrium");
pub const LARGE_STRAIN: Tolerance = tolerance("LARGE_STRAIN", 5e-4, "four digits of the reference stress");
pub const BEAM_REFERENCE: Tolerance =
    tolerance("BEAM_REFERENCE", 2e-3, "three digits, and what e^-5 of drag leaves");
pub const BEAM_CONVERGED: Tolerance = tolerance("BEAM_CONVERGED", 2e-2, "8 cells through the thickness");
pub const LOAD_IMPULSE: Tolerance =
    tolerance("LOAD_IMPULSE", 2e-7, "weights of point loads are single precision");
pub const SETTLED: Tolerance = tolerance("SETTLED", 1e-4, "what was asked for");
pub const SAG: Tolerance =
    tolerance("SAG", 1e-3, "what is left after settling, and stretch from 3e-4 strain");
pub const SETTLED_MOTION: Tolerance =
    tolerance("SETTLED_MOTION", 1e-3, "SETTLED, over a mode a quarter wave long");

// ---- Dynamics ----------------------------------------------------

pub const MOMENTUM_F32: Tolerance =
    tolerance("MOMENTUM_F32", 1e-5, "roundings of 1e5 substeps, as a random walk");
pub const ANGULAR_F32: Tolerance = tolerance("ANGULAR_F32", 1e-5, "as MOMENTUM_F32");
pub const MOMENTUM_F64: Tolerance = tolerance("MOMENTUM_F64", 1e-12, "roundings of 1e5 substeps");
pub const ANGULAR_F64: Tolerance = tolerance("ANGULAR_F64", 1e-12, "as MOMENTUM_F64");
pub const ENERGY_SWING: Tolerance =
    tolerance("ENERGY_SWING", 1e-3, "a quarter of (omega dt)^2, omega dt < 0.03");
pub const ENERGY_ORDER: Tolerance = tolerance("ENERGY_ORDER", 0.05, "the next order of the step");
pub const ENERGY_DRIFT: Tolerance =
    tolerance("ENERGY_DRIFT", 1e-4, "beats of the swing that a tenth leaves over");
pub const FREQUENCY_4: Tolerance =
    tolerance("FREQUENCY_4", 0.04, "half of what 4 cells lack in compliance, 0.066");
pub const FREQUENCY_8: Tolerance =
    tolerance("FREQUENCY_8", 0.012, "half of what 8 cells lack in compliance, 0.017");
pub const DISPERSION: Tolerance = tolerance("DISPERSION", 1e-6, "springs are nonlinear by the strain, 1e-8");
pub const PHASE_SPEED: Tolerance = tolerance("PHASE_SPEED", 5e-5, "four digits of the reference");
pub const STABLE_STEP: Tolerance = tolerance("STABLE_STEP", 1e-2, "a Ritz value approaches from below");
pub const BOUNDED: Tolerance =
    tolerance("BOUNDED", 100.0, "times the noise; 1/sin of the phase at 0.99 is 7");

// ---- Contact -----------------------------------------------------

pub const INDENTATION: Tolerance =
    tolerance("INDENTATION", 0.05, "six cells in the radius of contact, walls at ten radii");
pub const THIRD_LAW_F32: Tolerance = tolerance(
    "THIRD_LAW_F32",
    1e-6,
    "velocities are rounded, and the weights of a point sum to 1 within 6e-8",
);
pub const THIRD_LAW_F64: Tolerance =
    tolerance("THIRD_LAW_F64", 2e-7, "the single precision weights of a point sum to 1 within 6e-8");
pub const TORQUE: Tolerance =
    tolerance("TORQUE", 5e-2, "the tool moves 0.2 mm in the step that its force is a mean of");
pub const TUNNELLING: Tolerance = tolerance("TUNNELLING", 0.5, "contact points are half a radius apart");
pub const LOOP_LOSS: Tolerance = tolerance("LOOP_LOSS", 0.5, "between nothing and all of the work");
pub const STICKING: Tolerance =
    tolerance("STICKING", 0.05, "sticking is by velocity: it creeps while pressed down");
pub const SLIDING: Tolerance = tolerance("SLIDING", 2e-3, "a few points at the rim stick for a moment");
pub const COGGING: Tolerance = tolerance("COGGING", 0.25, "a node yields less than a face's middle");
pub const COGGING_ALONG: Tolerance =
    tolerance("COGGING_ALONG", 0.4, "the slope of COGGING, by half its wavelength over the depth pressed");
pub const COGGING_STEP: Tolerance = tolerance("COGGING_STEP", 0.05, "no jumps: 20 um of a cell of 4 mm");
pub const PINCH: Tolerance = tolerance("PINCH", 2e-2, "the body has come to rest between the tools");
pub const COMPOUND: Tolerance = tolerance("COMPOUND", 1e-6, "the order of contact points, in eight sweeps");
pub const TORQUE_ARM: Tolerance =
    tolerance("TORQUE_ARM", 0.02, "contacts of the last substep against a step's mean");

// ---- The meshless model ------------------------------------------

pub const POTENTIAL: Tolerance = tolerance("POTENTIAL", 1e-6, "a central difference over 1e-6 of a cell");
pub const STEP_LOSS: Tolerance = tolerance("STEP_LOSS", 1e-9, "the tolerance of the solution, over 50 steps");
pub const IMPLICIT_MOMENTUM: Tolerance =
    tolerance("IMPLICIT_MOMENTUM", 1e-8, "the tolerance of the solution, over 200 steps");
pub const EFG_INDENTATION: Tolerance =
    tolerance("EFG_INDENTATION", 0.2, "two to four cells in the radius of contact, a layer of six radii");
pub const TRUE_RESIDUAL: Tolerance = tolerance("TRUE_RESIDUAL", 1e-4, "what was asked for");
pub const SINGLE_FORCE: Tolerance = tolerance(
    "SINGLE_FORCE",
    5e-3,
    "contacts that are taken up again are settled to SETTLED, 5e-3 of the largest",
);

// ---- Sleep and shapes --------------------------------------------

pub const SLEEP_HIDES: Tolerance = tolerance("SLEEP_HIDES", 1e-2, "the promise of the sleep thresholds");
pub const SLEEP_ENERGY: Tolerance = tolerance("SLEEP_ENERGY", 1e-4, "energy swings with the step");
pub const ROUNDING: Tolerance = tolerance("ROUNDING", 1e-12, "sums in double precision");
pub const ENERGY_NEAR_LIMIT: Tolerance =
    tolerance("ENERGY_NEAR_LIMIT", 0.3, "(omega dt)^2 / 4 of modes near the limit");
pub const HALF_WAY: Tolerance =
    tolerance("HALF_WAY", 1e-2, "symmetric but for the nonlinear springs at 1e-2 strain");

/// The checks of one test. Each prints its residual; the test fails at the end, so that one run shows all of them.
#[derive(Debug)]
pub struct Claim {
    name: &'static str,
    scale: f64,
    failed: Vec<String>,
}

impl Claim {
    pub fn new(name: &'static str) -> Self {
        let scale = std::env::var("PLP_TOL_SCALE").ok().map_or(1.0, |text| {
            text.parse().unwrap_or_else(|_| panic!("PLP_TOL_SCALE must be a number, not '{text}'"))
        });
        Self { name, scale, failed: Vec::new() }
    }

    /// Checks |`residual`| against a tolerance. NaN fails.
    pub fn check(&mut self, tolerance: Tolerance, case: &str, residual: f64) {
        let limit = tolerance.limit * self.scale;
        let line = format!(
            "{}: {case}: residual {residual:.3e}, {} {limit:.3e} ({})",
            self.name, tolerance.name, tolerance.reason
        );
        // With all tolerances 0 even an exact result is reported as failed, so that none is left out.
        let holds = residual.abs() <= limit && self.scale > 0.0;
        println!("{} {line}", if holds { "ok  " } else { "FAIL" });
        if !holds {
            self.failed.push(line);
        }
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            assert!(self.failed.is_empty(), "\n{}", self.failed.join("\n"));
        }
    }
}
