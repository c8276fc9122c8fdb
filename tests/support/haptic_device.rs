//! A haptic device and the hand that holds it, in motion.
//!
//! Masses, friction and encoders of the size that a 3D Systems Touch has; the hand is a mass on a spring and a damper that hangs on where the
//! person wants it to be. Integrated much faster than the servo loop, whose force stands still meanwhile, as a real device's does.

use palpate::math::{Pose, Vec3};
use palpate::solver::tool::ToolMotion;

/// The device, as its tip feels.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    /// Apparent mass in kg.
    pub mass_kg: f64,
    /// Viscous friction in N s/m.
    pub viscous_n_s_per_m: f64,
    /// Coulomb friction in N.
    pub coulomb_n: f64,
    /// One step of the encoders, in m; 0 for perfect ones.
    pub encoder_m: f64,
    /// Time constant of the filter behind the velocity that the device tells, in s.
    pub filter_s: f64,
}

impl Default for Body {
    /// A Touch with half of its friction.
    fn default() -> Self {
        Self { mass_kg: 0.045, viscous_n_s_per_m: 0.05, coulomb_n: 0.13, encoder_m: 5.5e-5, filter_s: 2e-3 }
    }
}

/// A hand that holds the device firmly.
#[derive(Clone, Copy, Debug)]
pub struct Hand {
    /// Mass that moves with the device, in kg.
    pub mass_kg: f64,
    /// Stiffness towards where it wants to be, in N/m.
    pub stiffness_n_per_m: f64,
    /// Damping in N s/m.
    pub damping_n_s_per_m: f64,
}

impl Hand {
    /// A relaxed grip.
    pub const LOOSE: Self = Self { mass_kg: 0.15, stiffness_n_per_m: 100.0, damping_n_s_per_m: 2.0 };
    /// A tight one.
    pub const TIGHT: Self = Self { mass_kg: 0.15, stiffness_n_per_m: 500.0, damping_n_s_per_m: 10.0 };
}

/// Steps of integration in a second.
const RATE_HZ: f64 = 20_000.0;

/// A device in motion.
#[derive(Clone, Debug)]
pub struct HapticDevice {
    pub body: Body,
    pub hand: Option<Hand>,
    pub position_m: Vec3,
    pub velocity_m_s: Vec3,
    wish_m: Vec3,
    read_m: Option<Vec3>,
    told_m_s: Vec3,
}

impl HapticDevice {
    /// At rest, with the hand where it wants to be.
    pub fn new(body: Body, hand: Option<Hand>, at: Vec3) -> Self {
        let still = Vec3::zeros();
        Self { body, hand, position_m: at, velocity_m_s: still, wish_m: at, read_m: None, told_m_s: still }
    }

    /// `seconds` under the motors' force, while the hand's wish moves evenly to `wish_m` and something pushes the device by `push_n`.
    pub fn advance(&mut self, motors_n: Vec3, wish_m: Vec3, push_n: Vec3, seconds: f64) {
        let count = (seconds * RATE_HZ).round().max(1.0) as u32;
        let dt = seconds / f64::from(count);
        let wish_m_s = (wish_m - self.wish_m) / seconds;
        let mass = self.body.mass_kg + self.hand.map_or(0.0, |hand| hand.mass_kg);
        for _ in 0..count {
            self.wish_m += wish_m_s * dt;
            let held = self.hand.map_or(Vec3::zeros(), |hand| {
                (self.wish_m - self.position_m) * hand.stiffness_n_per_m
                    + (wish_m_s - self.velocity_m_s) * hand.damping_n_s_per_m
            });
            let force = motors_n + push_n + held - self.velocity_m_s * self.body.viscous_n_s_per_m;
            let free = self.velocity_m_s + force * (dt / mass);
            // Dry friction takes what speed it can, and holds what it can stop.
            let stopped = self.body.coulomb_n * dt / mass;
            let speed = free.norm();
            self.velocity_m_s = if speed <= stopped { Vec3::zeros() } else { free * (1.0 - stopped / speed) };
            self.position_m += self.velocity_m_s * dt;
        }
    }

    /// What the device tells its servo loop, `dt` seconds after the last time.
    pub fn read(&mut self, dt: f64) -> ToolMotion {
        let step = self.body.encoder_m;
        let at =
            if step > 0.0 { self.position_m.map(|x| (x / step).round() * step) } else { self.position_m };
        let moved = self.read_m.replace(at).map_or(Vec3::zeros(), |last| at - last) / dt;
        self.told_m_s += (moved - self.told_m_s) * (1.0 - (-dt / self.body.filter_s).exp());
        ToolMotion { linear_m_s: self.told_m_s, ..ToolMotion::at(Pose::translation(at.x, at.y, at.z)) }
    }
}
