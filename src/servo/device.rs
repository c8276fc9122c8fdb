//! What a haptic device can bear, and what it may be asked for.

use super::impedance::BlockLimit;
use crate::error::{Error, Result};
use crate::math::Vec3;

/// The limits of a haptic device. All forces are at its tip; torques about the tool's origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceDesc {
    /// Largest force in N.
    pub max_force_n: f64,
    /// Largest torque in N m; 0 for a device that renders none.
    pub max_torque_n_m: f64,
    /// Largest force that the motors bear for long, in N: a root mean square over [`window_s`](Self::window_s), as heat goes with the
    /// square.
    pub continuous_force_n: f64,
    /// The same of the torque, in N m.
    pub continuous_torque_n_m: f64,
    /// Time over which the continuous limits average, in s.
    pub window_s: f64,
    /// Largest stiffness that it renders stably at its servo rate: N/m, and N m/rad.
    pub max_stiffness: BlockLimit,
    /// Largest damping: N s/m, and N m s/rad.
    pub max_damping: BlockLimit,
    /// Fastest change of the force, in N/s.
    pub slew_n_per_s: f64,
    /// Fastest change of the torque, in N m/s.
    pub slew_n_m_per_s: f64,
    /// Rate of the servo loop, in Hz.
    pub servo_rate_hz: f64,
    /// Fastest motion of the tool that is believed, in m/s.
    pub max_speed_m_s: f64,
    /// Where it can go.
    pub workspace: Workspace,
}

/// The region that a device reaches, around its middle. A host that maps it onto a scene takes its scale from here; the servo loop works in
/// the scene and has no use for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Workspace {
    /// A ball.
    Ball {
        /// Radius in m.
        radius_m: f64,
    },
    /// A box along the device's axes.
    Box {
        /// Half its edges, in m.
        half_extents_m: Vec3,
    },
}

/// Longest time in which any force falls to zero under the slew limit, in s. A failure takes a tick to be seen and this to be gone, 35 ms in
/// all at the slowest servo rate.
pub const LONGEST_FALL_S: f64 = 0.03;

/// Slowest servo rate, in Hz. Hands feel the steps of slower ones, and a failure would take longer than 35 ms.
pub const SLOWEST_SERVO_HZ: f64 = 200.0;

impl DeviceDesc {
    /// A 3D Systems Touch, the former SensAble Phantom Omni: three degrees of force at 1 kHz.
    ///
    /// Limits of force, stiffness and damping are those that CHAI3D's driver states (`cHapticDeviceInfo` of its Phantom class); the
    /// continuous force is the data sheet's 0.88 N. The window of 2 s, the slew of 1 N in a millisecond and the speed of 1 m/s are this
    /// project's: eight times what tissue of 125 N/m asks for at that speed.
    pub fn touch() -> Self {
        Self {
            max_force_n: 3.3,
            max_torque_n_m: 0.0,
            continuous_force_n: 0.88,
            continuous_torque_n_m: 0.0,
            window_s: 2.0,
            max_stiffness: BlockLimit { linear: 700.0, angular: 0.0 },
            max_damping: BlockLimit { linear: 5.0, angular: 0.0 },
            slew_n_per_s: 1000.0,
            slew_n_m_per_s: 0.0,
            servo_rate_hz: 1000.0,
            max_speed_m_s: 1.0,
            workspace: Workspace::Ball { radius_m: 0.1 },
        }
    }

    /// Whether it renders torque.
    pub fn has_torque(&self) -> bool {
        self.max_torque_n_m > 0.0
    }

    /// Time between two ticks of the servo loop, in s.
    pub fn tick_s(&self) -> f64 {
        1.0 / self.servo_rate_hz
    }

    /// Refuses limits that contradict each other, and forces that could not be withdrawn in time.
    pub fn check(&self) -> Result<()> {
        let above_zero = [
            ("the largest force", self.max_force_n),
            ("the averaging window", self.window_s),
            ("the largest stiffness", self.max_stiffness.linear),
            ("the largest speed", self.max_speed_m_s),
        ];
        for (name, value) in above_zero {
            require(value.is_finite() && value > 0.0, || format!("{name} must be above 0, not {value}"))?;
        }
        let not_below_zero = [
            ("the largest torque", self.max_torque_n_m),
            ("the largest damping", self.max_damping.linear),
            ("the largest torsional stiffness", self.max_stiffness.angular),
            ("the largest torsional damping", self.max_damping.angular),
        ];
        for (name, value) in not_below_zero {
            require(value.is_finite() && value >= 0.0, || format!("{name} must be 0 or more, not {value}"))?;
        }
        require(!self.has_torque() || self.max_stiffness.angular > 0.0, || {
            "a device that renders torque renders some torsional stiffness, which must be above 0".into()
        })?;
        for (name, continuous, largest) in [
            ("force", self.continuous_force_n, self.max_force_n),
            ("torque", self.continuous_torque_n_m, self.max_torque_n_m),
        ] {
            let is_inside = (0.0..=largest).contains(&continuous) && (continuous > 0.0 || largest == 0.0);
            require(is_inside, || {
                format!(
                    "the continuous {name} must lie above 0 and not above the largest, {largest}, not {continuous}"
                )
            })?;
        }
        require((SLOWEST_SERVO_HZ..=1e5).contains(&self.servo_rate_hz), || {
            format!("a servo rate of {} Hz is not between {SLOWEST_SERVO_HZ} and 100000", self.servo_rate_hz)
        })?;
        for (name, slew, largest) in [
            ("force", self.slew_n_per_s, self.max_force_n),
            ("torque", self.slew_n_m_per_s, self.max_torque_n_m),
        ] {
            let least = largest / LONGEST_FALL_S;
            require(slew.is_finite() && slew >= least, || {
                format!(
                    "{name} that changes by {slew} in a second takes more than {LONGEST_FALL_S} s to be gone; \
                     at least {least} is needed"
                )
            })?;
        }
        self.workspace.check()
    }
}

impl Workspace {
    fn check(&self) -> Result<()> {
        let size = |x: f64| x.is_finite() && x > 0.0;
        let good = match self {
            Self::Ball { radius_m } => size(*radius_m),
            Self::Box { half_extents_m } => half_extents_m.iter().all(|&x| size(x)),
        };
        require(good, || format!("{self:?}: a workspace must have a size"))
    }

    /// Radius of the largest ball inside, in m.
    pub fn radius_m(&self) -> f64 {
        match self {
            Self::Ball { radius_m } => *radius_m,
            Self::Box { half_extents_m } => half_extents_m.min(),
        }
    }
}

fn require(holds: bool, reason: impl FnOnce() -> String) -> Result<()> {
    if holds { Ok(()) } else { Err(Error::argument(reason())) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device with torques, so that their limits are looked at too.
    fn turning() -> DeviceDesc {
        DeviceDesc {
            max_torque_n_m: 0.2,
            continuous_torque_n_m: 0.05,
            max_stiffness: BlockLimit { linear: 700.0, angular: 1.0 },
            max_damping: BlockLimit { linear: 5.0, angular: 0.01 },
            slew_n_m_per_s: 20.0,
            ..DeviceDesc::touch()
        }
    }

    #[test]
    fn presets_and_sound_descriptions_pass() {
        DeviceDesc::touch().check().unwrap();
        turning().check().unwrap();
        assert!(turning().has_torque() && !DeviceDesc::touch().has_torque());
    }

    #[test]
    fn contradictions_and_nonsense_are_refused() {
        let spoil: [fn(&mut DeviceDesc); 16] = [
            |d| d.max_force_n = 0.0,
            |d| d.max_force_n = f64::NAN,
            |d| d.max_torque_n_m = -0.1,
            |d| d.continuous_force_n = 3.4,
            |d| d.continuous_force_n = 0.0,
            |d| d.continuous_torque_n_m = 0.3,
            |d| d.window_s = f64::INFINITY,
            |d| d.max_stiffness.linear = 0.0,
            |d| d.max_damping.linear = -1.0,
            |d| d.max_stiffness.angular = f64::NAN,
            |d| d.max_damping.angular = f64::NEG_INFINITY,
            |d| d.servo_rate_hz = 100.0,
            |d| d.max_speed_m_s = -1.0,
            |d| d.workspace = Workspace::Ball { radius_m: 0.0 },
            |d| d.workspace = Workspace::Box { half_extents_m: Vec3::new(0.1, f64::NAN, 0.1) },
            |d| d.slew_n_m_per_s = f64::NAN,
        ];
        for (which, spoil) in spoil.iter().enumerate() {
            let mut desc = turning();
            spoil(&mut desc);
            desc.check().expect_err(&format!("case {which}"));
        }
    }

    #[test]
    fn a_force_that_cannot_be_withdrawn_in_time_is_refused() {
        let desc = DeviceDesc { slew_n_per_s: 3.3 / LONGEST_FALL_S * 0.999, ..DeviceDesc::touch() };
        assert!(desc.check().unwrap_err().to_string().contains("to be gone"));
        const { assert!(LONGEST_FALL_S + 1.0 / SLOWEST_SERVO_HZ <= 0.035 + 1e-12) };
    }
}
