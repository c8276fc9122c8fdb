//! When a device may begin to push, and how gently.
//!
//! A device that is switched on inside tissue must not kick. As in CHAI3D (`cGenericTool::setWaitForSmallForce`), it waits until the force
//! is small, here for a while; then its share of the force rises from nothing to all.

use crate::servo::flags::Flags;

/// How long the force must stay small, in s.
pub const QUIET_S: f64 = 0.1;
/// How long the force takes to rise to its full share, in s.
pub const RAMP_S: f64 = 0.5;
/// What is small, as a share of the device's largest force: 0.1 N of the 3.3 N of a Touch, well below its friction.
pub const SMALL: f64 = 0.03;

/// The share of the force that a device may give.
#[derive(Clone, Debug)]
pub enum Engage {
    /// The force has been small for so many seconds.
    Waiting(f64),
    /// It is rising for so many seconds.
    Ramping(f64),
    /// The device gives all of it.
    Engaged,
}

impl Engage {
    /// Not yet.
    pub fn new() -> Self {
        Self::Waiting(0.0)
    }

    /// Whether the force that is asked for matters yet.
    pub fn is_waiting(&self) -> bool {
        matches!(self, Self::Waiting(_))
    }

    /// The share, `dt` seconds after the last call. `load` is the wanted force over the device's largest, or the torque likewise, whichever is
    /// more.
    pub fn share(&mut self, load: f64, dt: f64) -> (f64, Flags) {
        *self = match *self {
            // Written so that a NaN is not small.
            Self::Waiting(quiet) if load <= SMALL => {
                if quiet + dt >= QUIET_S {
                    Self::Ramping(0.0)
                } else {
                    Self::Waiting(quiet + dt)
                }
            }
            Self::Waiting(_) => Self::Waiting(0.0),
            Self::Ramping(risen) if risen + dt < RAMP_S => Self::Ramping(risen + dt),
            Self::Ramping(_) | Self::Engaged => Self::Engaged,
        };
        match *self {
            Self::Waiting(_) => (0.0, Flags::WAITING),
            Self::Ramping(risen) => (risen / RAMP_S, Flags::RAMPING),
            Self::Engaged => (1.0, Flags::NONE),
        }
    }

    /// Starts again.
    pub fn reset(&mut self) {
        *self = Self::new();
    }
}

impl Default for Engage {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1e-3;

    fn pass(engage: &mut Engage, load: f64, seconds: f64) -> (f64, Flags) {
        let count = (seconds / DT).round() as u32;
        (0..count).fold((0.0, Flags::NONE), |_, _| engage.share(load, DT))
    }

    #[test]
    fn a_tool_inside_tissue_never_engages() {
        assert_eq!(pass(&mut Engage::new(), 0.04, 5.0), (0.0, Flags::WAITING));
        assert_eq!(pass(&mut Engage::new(), f64::NAN, 5.0), (0.0, Flags::WAITING));
    }

    #[test]
    fn the_force_must_stay_small() {
        let mut engage = Engage::new();
        for _ in 0..20 {
            assert_eq!(pass(&mut engage, 0.0, 0.09), (0.0, Flags::WAITING));
            engage.share(0.5, DT);
        }
        pass(&mut engage, 0.0, 0.105);
        assert!(matches!(engage, Engage::Ramping(_)));
    }

    #[test]
    fn the_share_rises_evenly_to_all_whatever_the_force() {
        let mut engage = Engage::new();
        while matches!(engage, Engage::Waiting(_)) {
            assert_eq!(engage.share(0.0, DT).0, 0.0);
        }
        let (mut last, mut ticks) = (0.0, 0);
        while last < 1.0 {
            let (share, _) = engage.share(1.0, DT);
            assert!(share > last && share - last < 1.001 * DT / RAMP_S, "{share} after {last}");
            (last, ticks) = (share, ticks + 1);
        }
        assert!((499..=501).contains(&ticks), "{ticks} ms");
        assert_eq!(engage.share(1.0, DT), (1.0, Flags::NONE));
        engage.reset();
        assert_eq!(engage.share(0.0, DT), (0.0, Flags::WAITING));
    }
}
