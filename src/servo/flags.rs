//! What a tick of the servo loop did to the force.

use std::ops::{BitOr, BitOrAssign};

/// A set of things that happened in one tick. The bits are part of the C interface: new ones are added at the end, and none changes its meaning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Flags(pub u32);

impl Flags {
    /// Nothing happened.
    pub const NONE: Self = Self(0);
    /// The motion, the time stamp or the contact model was not finite, or time went backwards or stood still: no force, until the tool engages again.
    pub const NOT_FINITE: Self = Self(1);
    /// The servo loop paused: no force, until the tool engages again.
    pub const PAUSED: Self = Self(1 << 1);
    /// The simulation is gone, has failed or was reset: no force, until the tool engages again.
    pub const STOPPED: Self = Self(1 << 2);
    /// The newest contact model is old: the last force is held and no longer follows the tool.
    pub const HELD: Self = Self(1 << 3);
    /// It is so old that the force decays, or is gone.
    pub const DECAYING: Self = Self(1 << 4);
    /// The device moved faster than is believed: no force, until the tool engages again.
    pub const TOO_FAST: Self = Self(1 << 5);
    /// There is no force yet: the tool engages when the force has been small for a while.
    pub const WAITING: Self = Self(1 << 6);
    /// The force is rising to its full share after the tool engaged.
    pub const RAMPING: Self = Self(1 << 7);
    /// The force was lowered to what the motors bear for long.
    pub const AVERAGED: Self = Self(1 << 8);
    /// Force or torque was clamped to the device's largest.
    pub const CLAMPED: Self = Self(1 << 9);
    /// Force or torque changed as fast as it may, and is not where it should be yet.
    pub const SLEWED: Self = Self(1 << 10);
    /// The dead-man switch is not held: no force at once, until the tool engages again.
    pub const RELEASED: Self = Self(1 << 11);
    /// The passivity controller added damping.
    pub const DAMPED: Self = Self(1 << 12);

    /// Whether all of `other` is in it.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether any of `other` is in it.
    pub const fn intersects(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Itself where `holds`, nothing elsewhere.
    pub const fn when(self, holds: bool) -> Self {
        if holds { self } else { Self::NONE }
    }
}

impl BitOr for Flags {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for Flags {
    fn bitor_assign(&mut self, other: Self) {
        *self = *self | other;
    }
}
