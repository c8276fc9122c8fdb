//! How the device holds the tool that the physics knows.
//!
//! **Direct**: the tool is where the device is, and the device renders what the tissue answers. The physics puts tissue outside a tool within the
//! substep, so no tool is ever seen or felt inside tissue, and no proxy is needed for that: soft tissue is rendered exactly as soft as
//! it is. But a tool that is forced against bone squeezes what lies between without bound, and the device feels a stiffness that it cannot render.
//!
//! **Virtual coupling** (Colgate, Stanley and Brown 1995): the tool is a proxy, held by the device through a spring and a damper, and the
//! device feels those. The proxy stands still where tissue and spring balance, as in the god-object method (Zilles and Salisbury 1995):
//! bone holds it, the device goes on, and the stiffness that is felt never exceeds the spring's, whatever the tissue's. The price is a
//! spring in series: tissue of K feels like K K_vc / (K + K_vc), 106 N/m of 125 N/m with 700 N/m. Friction comes through undiminished,
//! because a spring in series takes no force away.
//!
//! The proxy has no mass: at each tick its velocity is what makes spring, damper and tissue balance, taken implicitly, so that it is stable whatever
//! the stiffness (as the quasi-static tools of Wan and McNeely 2003). In the air the balance is no force at all: a free tool feels free.
//! The spring pulls the proxy with no more than the device renders: tissue shall not bear what no hand feels.

use nalgebra::Cholesky;

use super::contact_model::{ContactModel, StraightLaw};
use super::device::DeviceDesc;
use super::impedance::{
    BlockLimit, ImpedanceLimits, angular, displacement, isotropic, linear, stacked, velocity, wrench,
};
use super::safety::at_most;
use crate::error::{Error, Result};
use crate::math::{Mat3, Mat6, Pose, Quat, Vec3, Vec6, all_finite};
use crate::solver::tool::{ToolMotion, Wrench};

/// How the tool follows the device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coupling {
    /// The tool is where the device is: for tissue that is nowhere stiffer than the device renders.
    Direct,
    /// The tool hangs on a spring and a damper.
    Virtual(VirtualCoupling),
}

/// A spring and a damper between device and proxy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VirtualCoupling {
    /// K_vc in N/m, above 0.
    pub stiffness_n_per_m: f64,
    /// B_vc in N s/m.
    pub damping_n_s_per_m: f64,
    /// Torsional stiffness in N m/rad. With 0 the proxy turns with the device, which is what a device without torque needs.
    pub stiffness_n_m_per_rad: f64,
    /// Torsional damping in N m s/rad.
    pub damping_n_m_s_per_rad: f64,
}

/// Stiffest tissue that a proxy is told of, in N/m: bone under a fingertip. What it feels like is the coupling's to limit; a proxy that is
/// told less than the truth would bounce off it.
pub(super) const STIFFEST_N_PER_M: f64 = 1e6;
/// Likewise the damping, in N s/m.
const MOST_DAMPING_N_S_PER_M: f64 = 1e3;
/// Arm at which the same limits hold for rotation, in m: a finger's breadth.
pub(super) const LEVER_M: f64 = 0.01;

impl Coupling {
    /// What contact models may say to this coupling. A device that feels the tissue directly is told no more than it renders; a device that
    /// feels a spring is safe behind it, and its proxy needs the truth.
    pub fn limits(&self, desc: &DeviceDesc) -> ImpedanceLimits {
        let turning = |of: BlockLimit| BlockLimit { angular: of.linear * LEVER_M * LEVER_M, ..of };
        match self {
            // A device without torque turns as well: what that does to its force is limited by the arm.
            Self::Direct if desc.has_torque() => {
                ImpedanceLimits { stiffness: desc.max_stiffness, damping: desc.max_damping }
            }
            Self::Direct => {
                ImpedanceLimits { stiffness: turning(desc.max_stiffness), damping: turning(desc.max_damping) }
            }
            Self::Virtual(_) => ImpedanceLimits {
                stiffness: turning(BlockLimit { linear: STIFFEST_N_PER_M, angular: 0.0 }),
                damping: turning(BlockLimit { linear: MOST_DAMPING_N_S_PER_M, angular: 0.0 }),
            },
        }
    }
}

impl VirtualCoupling {
    /// The stiffest coupling that a device renders, so that least is lost of the tissue's stiffness, without damping, which would only add
    /// the noise of the velocity: tissue and hand damp.
    pub fn of(desc: &DeviceDesc) -> Self {
        Self {
            stiffness_n_per_m: desc.max_stiffness.linear,
            damping_n_s_per_m: 0.0,
            stiffness_n_m_per_rad: if desc.has_torque() { desc.max_stiffness.angular } else { 0.0 },
            damping_n_m_s_per_rad: 0.0,
        }
    }

    /// Refuses springs that are none, and more than the device renders.
    pub fn check(&self, desc: &DeviceDesc) -> Result<()> {
        let within = [
            ("stiffness", self.stiffness_n_per_m, desc.max_stiffness.linear),
            ("damping", self.damping_n_s_per_m, desc.max_damping.linear),
            ("torsional stiffness", self.stiffness_n_m_per_rad, desc.max_stiffness.angular),
            ("torsional damping", self.damping_n_m_s_per_rad, desc.max_damping.angular),
        ];
        for (name, value, most) in within {
            if !(0.0..=most).contains(&value) {
                return Err(Error::argument(format!(
                    "a {name} of {value} is not between 0 and the device's {most}"
                )));
            }
        }
        if desc.has_torque() && self.stiffness_n_m_per_rad == 0.0 {
            return Err(Error::argument(
                "a device that renders torque needs torsional stiffness in its coupling",
            ));
        }
        if !desc.has_torque() && self.stiffness_n_m_per_rad > 0.0 {
            return Err(Error::argument(
                "a device that renders no torque turns its tool by hand: its coupling has no torsional stiffness",
            ));
        }
        if self.stiffness_n_per_m == 0.0 {
            return Err(Error::argument("a coupling without stiffness holds nothing"));
        }
        Ok(())
    }
}

/// Farthest that a proxy may be from its device, in m: an arm's length. No tissue holds it there, but a law gone wild would throw it.
const REACH_M: f64 = 0.5;

/// The tool that hangs on a [`VirtualCoupling`].
#[derive(Clone, Debug)]
pub struct Proxy {
    spring: VirtualCoupling,
    stiffness: Mat6,
    damping: Mat6,
    /// How far from its device the spring pulls the proxy with all that the device renders, in m and rad. Farther away it pulls no more.
    stretch: BlockLimit,
    /// As fast as the device may: tissue throws the proxy no faster, and it falls back into tissue no faster, in m/s.
    fastest_m_s: f64,
    turns_freely: bool,
    motion: ToolMotion,
}

impl Proxy {
    /// Where the device is.
    pub fn new(coupling: &VirtualCoupling, desc: &DeviceDesc, device: &ToolMotion) -> Self {
        Self {
            stretch: BlockLimit {
                linear: desc.max_force_n / coupling.stiffness_n_per_m,
                // Without a torsional spring nothing is pulled.
                angular: desc.max_torque_n_m / coupling.stiffness_n_m_per_rad.max(f64::MIN_POSITIVE),
            },
            fastest_m_s: desc.max_speed_m_s,
            spring: *coupling,
            stiffness: isotropic(coupling.stiffness_n_per_m, coupling.stiffness_n_m_per_rad),
            damping: isotropic(coupling.damping_n_s_per_m, coupling.damping_n_m_s_per_rad),
            turns_freely: coupling.stiffness_n_m_per_rad > 0.0,
            motion: *device,
        }
    }

    /// Where the proxy is: the tool's motion for the physics.
    pub fn motion(&self) -> &ToolMotion {
        &self.motion
    }

    /// Puts it where the device is, without any force.
    pub fn reset(&mut self, device: &ToolMotion) {
        self.motion = *device;
    }

    /// Whether it has a spring against turning; without, it turns with its device, and [`Self::advance_straight`] will do.
    pub fn turns_freely(&self) -> bool {
        self.turns_freely
    }

    /// Where it is, turned as the device: what a law for [`Self::advance_straight`] is made around.
    #[inline]
    pub fn turned(&self, device: &ToolMotion) -> ToolMotion {
        ToolMotion {
            pose: Pose::from_parts(self.motion.pose.translation, device.pose.rotation),
            linear_m_s: self.motion.linear_m_s,
            angular_rad_s: device.angular_rad_s,
        }
    }

    /// As [`Self::advance`] for a proxy that turns with its device: three numbers to balance instead of six. `law` is around
    /// [`Self::turned`]. Gives the forces alone: what the device feels, and what of it lasts.
    #[inline]
    pub fn advance_straight(&mut self, law: &StraightLaw, device: &ToolMotion, dt: f64) -> [Vec3; 2] {
        let goal = device.pose.translation.vector;
        let (mut at, mut v) = (self.motion.pose.translation.vector, self.motion.linear_m_s);
        if dt > 0.0 {
            let (way, _) = at_most(goal - at, self.stretch.linear);
            let balanced = self.balance(law, way, device, dt);
            // As below.
            let wanted = if law.has_left(balanced, dt) { self.fall(way, device, dt) } else { balanced };
            v = self.kept_slow(wanted, goal - at, &law.push);
            at += v * dt;
            // Should rounding or a wild law have thrown it, the tool is where the device is.
            if !is_within_reach(at, v, goal) {
                (at, v) = (goal, device.linear_m_s);
            }
            self.motion = ToolMotion {
                pose: Pose::from_parts(at.into(), device.pose.rotation),
                linear_m_s: v,
                angular_rad_s: device.angular_rad_s,
            };
        }
        let pull = (at - goal) * self.spring.stiffness_n_per_m;
        [pull + (v - device.linear_m_s) * self.spring.damping_n_s_per_m, pull]
    }

    /// A velocity near tissue that pushes along `push`, `away` from the device: no faster than the device may be, unless the device itself draws the proxy out.
    #[inline]
    fn kept_slow(&self, v: Vec3, away: Vec3, push: &Vec3) -> Vec3 {
        if *push == Vec3::zeros() || away.dot(push) > 0.0 { v } else { at_most(v, self.fastest_m_s).0 }
    }

    /// The velocity of (b + B + dt (k + K)) v = F + B v₀ + k way + b v_d; NaN where there is none.
    #[inline]
    fn balance(&self, law: &StraightLaw, way: Vec3, device: &ToolMotion, dt: f64) -> Vec3 {
        let VirtualCoupling { stiffness_n_per_m: k, damping_n_s_per_m: b, .. } = self.spring;
        let resistance = law.damping + law.stiffness * dt + Mat3::from_diagonal_element(b + k * dt);
        let load = law.force_n + law.damping * law.linear_m_s + way * k + device.linear_m_s * b;
        solve(&resistance, load)
    }

    /// The same against nothing.
    fn fall(&self, way: Vec3, device: &ToolMotion, dt: f64) -> Vec3 {
        let VirtualCoupling { stiffness_n_per_m: k, damping_n_s_per_m: b, .. } = self.spring;
        (way * k + device.linear_m_s * b) / (b + k * dt)
    }

    /// Moves the proxy to where spring, damper and tissue balance after `dt` seconds, and gives the wrench that the device feels, and what of it lasts: the
    /// spring's share, without the damper's, which goes with the motion. `law` is the tissue's, around the proxy's motion.
    pub fn advance(&mut self, law: &ContactModel, device: &ToolMotion, dt: f64) -> [Wrench; 2] {
        if !self.turns_freely {
            // A proxy that turns with the device has no spring to tell the torque.
            let forces = self.advance_straight(&law.straight(&self.turned(device)), device, dt);
            let torque_n_m = law.evaluate(&self.motion).torque_n_m;
            return forces.map(|force_n| Wrench { force_n, torque_n_m });
        }
        if dt > 0.0 {
            let start = self.motion;
            self.move_against(law, &law.push, device, dt);
            if law.has_left(&self.motion) {
                // The line through the tissue's force would have to pull to hold it there: it is in the air.
                self.motion = start;
                self.move_against(&ContactModel::none(), &law.push, device, dt);
            }
        }
        let pull = self.stiffness * displacement(&device.pose, &self.motion.pose);
        let faster = velocity(&self.motion) - velocity(device);
        [pull + self.damping * faster, pull].map(|w| wrench(&w))
    }

    /// One implicit step: (B_vc + B + dt (K_vc + K)) v = F₀ − K (x − x₀) + B v₀ + K_vc (x_d − x) + B_vc v_d, near tissue that pushes along `push`.
    fn move_against(&mut self, law: &ContactModel, push: &Vec3, device: &ToolMotion, dt: f64) {
        let resistance = self.damping + law.damping + (self.stiffness + law.stiffness) * dt;
        let load = stacked(&law.wrench) - law.stiffness * displacement(&law.motion.pose, &self.motion.pose)
            + law.damping * velocity(&law.motion)
            + self.stiffness * self.stretched(&displacement(&self.motion.pose, &device.pose))
            + self.damping * velocity(device);
        let moving = Cholesky::new(resistance).map(|factor| factor.solve(&load));
        let moved = moving.map(|v| {
            let away = device.pose.translation.vector - self.motion.pose.translation.vector;
            let slow = self.kept_slow(linear(&v), away, push);
            self.moved(slow, angular(&v), dt)
        });
        let moved = moved.filter(|moved| {
            let goal = device.pose.translation.vector;
            moved.is_valid() && is_within_reach(moved.pose.translation.vector, moved.linear_m_s, goal)
        });
        // The spring makes the matrix positive definite; should rounding or a wild law say otherwise, the tool is where the device is.
        self.motion = moved.unwrap_or(*device);
    }

    /// What of a way to the device the spring answers.
    fn stretched(&self, way: &Vec6) -> Vec6 {
        let (near, _) = at_most(linear(way), self.stretch.linear);
        let (turn, _) = at_most(angular(way), self.stretch.angular);
        Vec6::new(near.x, near.y, near.z, turn.x, turn.y, turn.z)
    }

    /// Where a velocity leads.
    fn moved(&self, linear_m_s: Vec3, angular_rad_s: Vec3, dt: f64) -> ToolMotion {
        let at = self.motion.pose.translation.vector + linear_m_s * dt;
        let mut rotation = Quat::from_scaled_axis(angular_rad_s * dt) * self.motion.pose.rotation;
        rotation.renormalize_fast();
        ToolMotion { pose: Pose::from_parts(at.into(), rotation), linear_m_s, angular_rad_s }
    }
}

/// x of A x = b, where A is symmetric and positive definite, NaN where it is not; by A = L D Lᵀ, written out, because it is most of what a tick computes.
#[inline]
fn solve(a: &Mat3, b: Vec3) -> Vec3 {
    let d0 = a[(0, 0)];
    let r0 = 1.0 / d0;
    let (l10, l20) = (a[(1, 0)] * r0, a[(2, 0)] * r0);
    let d1 = a[(1, 1)] - l10 * a[(1, 0)];
    let r1 = 1.0 / d1;
    let below = a[(2, 1)] - l20 * a[(1, 0)];
    let l21 = below * r1;
    let d2 = a[(2, 2)] - l20 * a[(2, 0)] - l21 * below;
    let y1 = b.y - l10 * b.x;
    let z = (b.z - l20 * b.x - l21 * y1) / d2;
    let y = y1 * r1 - l21 * z;
    // Written so that a NaN has no solution.
    let is_definite = (d0 > 0.0) & (d1 > 0.0) & (d2 > 0.0);
    if is_definite { Vec3::new(b.x * r0 - l10 * y - l20 * z, y, z) } else { Vec3::repeat(f64::NAN) }
}

/// Whether a proxy that moves so is one that a device could hold.
#[inline]
fn is_within_reach(at: Vec3, v: Vec3, device: Vec3) -> bool {
    // Written so that a NaN is out of reach.
    let is_near = (at - device).norm_squared() <= REACH_M * REACH_M;
    is_near & all_finite(v.as_slice())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::patch::{Patch, Tissue};

    const DT: f64 = 1e-3;

    #[test]
    fn the_written_out_solution_is_the_factored_one_and_refuses_what_is_not_definite() {
        let mut noise = crate::noise::Noise(5);
        for _ in 0..200 {
            let root = Mat3::from_fn(|_, _| noise.next());
            // From all directions alike to one five million times stiffer, as bone at a microsecond's tick.
            for least in [1.0, 2e-7] {
                let a = root * root.transpose() + Mat3::from_diagonal_element(least);
                let b = Vec3::from_fn(|_, _| noise.next());
                let found = solve(&a, b);
                let expected = Cholesky::new(a).unwrap().solve(&b);
                assert!((a * found - b).norm() < 1e-12 * a.norm() * (1.0 + found.norm()), "{a} {b}");
                assert!((found - expected).norm() < 1e-7 * expected.norm(), "{found} {expected}");
            }
        }
        let b = Vec3::x();
        for wild in [Mat3::from_diagonal(&Vec3::new(1.0, -1.0, 1.0)), Mat3::from_diagonal_element(f64::NAN)] {
            assert!(solve(&wild, b).iter().all(|x| x.is_nan()));
        }
    }

    #[test]
    fn a_proxy_that_turns_with_its_device_moves_as_the_whole_balance_says() {
        // Springs that couple all directions and turning, and damping; the device turns.
        let mut noise = crate::noise::Noise(9);
        let root = Mat6::from_fn(|_, _| 10.0 * noise.next());
        let law = ContactModel {
            wrench: Wrench { force_n: Vec3::new(0.2, -0.1, 0.5), ..Wrench::default() },
            motion: at(0.0, 0.0),
            stiffness: root * root.transpose(),
            damping: root * root.transpose() * 1e-3,
            ..ContactModel::none()
        };
        let mut proxy =
            Proxy::new(&VirtualCoupling::of(&DeviceDesc::touch()), &DeviceDesc::touch(), &at(0.0, 0.0));
        let turned = Pose::new(Vec3::new(1e-3, 0.0, -2e-3), Vec3::new(0.0, 2e-3, 1e-3));
        let device = ToolMotion { angular_rad_s: Vec3::new(0.0, 2.0, 1.0), ..ToolMotion::at(turned) };
        let felt = proxy.advance(&law, &device, DT)[0].force_n;
        // Massless: what the coupling pulls with is what the tissue pushes back with, where it then is.
        let tissue = law.evaluate(proxy.motion()).force_n;
        assert!((felt - tissue).norm() < 1e-9, "{felt} against {tissue}");
        assert_eq!(proxy.motion().pose.rotation, turned.rotation);
    }

    fn turning_device() -> DeviceDesc {
        DeviceDesc {
            max_torque_n_m: 0.2,
            max_stiffness: BlockLimit { linear: 700.0, angular: 1.0 },
            max_damping: BlockLimit { linear: 5.0, angular: 0.01 },
            ..DeviceDesc::touch()
        }
    }

    fn at(x: f64, z: f64) -> ToolMotion {
        ToolMotion::at(Pose::translation(x, 0.0, z))
    }

    /// A floor at z = 0: `soft` N/m down to 5 mm, `hard` N/m below, as the model of a tool at `tool`.
    fn floor(tool: &ToolMotion, soft: f64, hard: f64) -> ContactModel {
        let depth = -tool.pose.translation.z;
        let (force, slope) = if depth <= 5e-3 {
            (soft * depth.max(0.0), soft)
        } else {
            (soft * 5e-3 + hard * (depth - 5e-3), hard)
        };
        let touches = depth > 0.0;
        ContactModel {
            wrench: Wrench { force_n: Vec3::z() * force, ..Wrench::default() },
            motion: *tool,
            stiffness: if touches { Mat6::from_diagonal(&Vec6::z()) * slope } else { Mat6::zeros() },
            push: if touches { Vec3::z() } else { Vec3::zeros() },
            ..ContactModel::none()
        }
    }

    /// The force at the end of a slow way down.
    fn pressed(depth_m: f64, soft: f64, hard: f64) -> (f64, f64) {
        let mut proxy =
            Proxy::new(&VirtualCoupling::of(&DeviceDesc::touch()), &DeviceDesc::touch(), &at(0.0, 0.01));
        let mut felt = 0.0;
        for tick in 0..=2000 {
            let device = at(0.0, 0.01 - (depth_m + 0.01) * (f64::from(tick) / 1000.0).min(1.0));
            felt = proxy.advance(&floor(proxy.motion(), soft, hard), &device, DT)[0].force_n.z;
        }
        (felt, -proxy.motion().pose.translation.z)
    }

    #[test]
    fn tissue_and_coupling_are_felt_as_springs_in_series() {
        let (felt, depth) = pressed(4e-3, 125.0, 125.0);
        let series = 125.0 * 700.0 / 825.0;
        assert!(
            (felt - series * 4e-3).abs() < 1e-6 && (depth - felt / 125.0).abs() < 1e-6,
            "{felt} N, {depth} m"
        );
    }

    #[test]
    fn a_stiff_inclusion_below_soft_tissue_is_felt_and_not_gone_through() {
        // The tool meets it when the device is 5 mm + 0.625 N ÷ 700 N/m deep.
        let (before, _) = pressed(5.8e-3, 125.0, 1e5);
        let (after, depth) = pressed(6.8e-3, 125.0, 1e5);
        let slope = (after - before) / 1e-3;
        assert!(slope > 600.0 && slope <= 700.0, "{slope} N/m, the coupling's and not the soft tissue's 106");
        assert!(depth < 5.1e-3, "{depth} m");
    }

    #[test]
    fn a_free_tool_follows_without_any_force() {
        let desc = DeviceDesc::touch();
        let coupling = VirtualCoupling { damping_n_s_per_m: 3.0, ..VirtualCoupling::of(&desc) };
        let mut proxy = Proxy::new(&coupling, &desc, &at(0.0, 0.0));
        for tick in 0..100 {
            let mut device = at(1e-4 * f64::from(tick), 0.0);
            device.linear_m_s = Vec3::x() * 0.1;
            let [felt, _] = proxy.advance(&ContactModel::none(), &device, DT);
            assert!(felt.force_n.norm() < 1e-9, "{felt:?} at tick {tick}");
        }
        let lag = 99e-4 - proxy.motion().pose.translation.x;
        assert!(lag.abs() < 1e-4, "{lag} m");
    }

    #[test]
    fn leaving_tissue_never_pulls() {
        let mut proxy =
            Proxy::new(&VirtualCoupling::of(&DeviceDesc::touch()), &DeviceDesc::touch(), &at(0.0, 0.0));
        for tick in 0..400 {
            // In and out in a fifth of a second, stale by two ticks at a time.
            let device = at(0.0, 2e-3 - 8e-3 * (f64::from(tick) * 0.0157).sin().abs());
            let law = floor(&proxy.motion().clone(), 200.0, 200.0);
            for _ in 0..2 {
                let [felt, _] = proxy.advance(&law, &device, DT);
                assert!(felt.force_n.z > -1e-9, "{felt:?} at tick {tick}");
            }
        }
    }

    #[test]
    fn bone_is_pressed_with_no_more_than_the_device_renders() {
        for desc in [turning_device(), DeviceDesc::touch()] {
            let mut proxy = Proxy::new(&VirtualCoupling::of(&desc), &desc, &at(0.0, 0.0));
            for tick in 0..2000 {
                let device = at(0.0, -2e-2 * (f64::from(tick) / 1000.0).min(1.0));
                proxy.advance(&floor(proxy.motion(), 1e5, 1e5), &device, DT);
            }
            let pressed = -1e5 * proxy.motion().pose.translation.z;
            assert!((pressed - desc.max_force_n).abs() < 1e-3, "{pressed} N, 20 mm behind the surface");
        }
    }

    #[test]
    fn what_lasts_is_the_springs_share_and_not_the_dampers() {
        for desc in [turning_device(), DeviceDesc::touch()] {
            let coupling = VirtualCoupling { damping_n_s_per_m: 3.0, ..VirtualCoupling::of(&desc) };
            let mut proxy = Proxy::new(&coupling, &desc, &at(0.0, 0.0));
            for tick in 1..=100 {
                let mut device = at(0.0, -5e-5 * f64::from(tick));
                device.linear_m_s = Vec3::z() * -0.05;
                let [felt, lasts] = proxy.advance(&floor(proxy.motion(), 200.0, 200.0), &device, DT);
                let offset = proxy.motion().pose.translation.z - device.pose.translation.z;
                assert!((lasts.force_n.z - 700.0 * offset).abs() < 1e-9, "{lasts:?}");
                let damped = (felt.force_n.z - lasts.force_n.z).abs();
                assert!(damped > 1e-3 || tick < 10, "{felt:?} and {lasts:?}");
            }
        }
    }

    #[test]
    fn friction_is_felt_in_full() {
        // Coulomb friction of 0.4 at 1 N: sticks by 500 N/m to where it last slid, and slides.
        let mut proxy =
            Proxy::new(&VirtualCoupling::of(&DeviceDesc::touch()), &DeviceDesc::touch(), &at(0.0, 0.0));
        let (mut anchor, mut felt) = (0.0, Vec3::zeros());
        for tick in 0..1000 {
            let x = proxy.motion().pose.translation.x;
            anchor = f64::clamp(anchor, x - 0.4 / 500.0, x + 0.4 / 500.0);
            let is_sliding = (x - anchor).abs() > 0.399 / 500.0;
            let law = ContactModel {
                wrench: Wrench { force_n: Vec3::new(-500.0 * (x - anchor), 0.0, 1.0), ..Wrench::default() },
                motion: *proxy.motion(),
                stiffness: Mat6::from_diagonal(&(Vec6::x() * if is_sliding { 0.0 } else { 500.0 })),
                push: Vec3::z(),
                ..ContactModel::none()
            };
            felt = proxy.advance(&law, &at(2e-5 * f64::from(tick), 0.0), DT)[0].force_n;
        }
        assert!((felt.x + 0.4).abs() < 1e-3, "{felt}");
    }

    #[test]
    fn torque_comes_through_a_torsional_spring_or_straight_from_the_tissue() {
        for desc in [turning_device(), DeviceDesc::touch()] {
            let mut proxy = Proxy::new(&VirtualCoupling::of(&desc), &desc, &at(0.0, 0.0));
            let device = ToolMotion::at(Pose::rotation(Vec3::z() * 0.1));
            let law =
                ContactModel { stiffness: isotropic(0.0, 0.5), motion: at(0.0, 0.0), ..ContactModel::none() };
            let felt = (0..100).fold(Wrench::default(), |_, _| proxy.advance(&law, &device, DT)[0]);
            let stiffness = if desc.has_torque() { 0.5 / 1.5 } else { 0.5 };
            assert!((felt.torque_n_m + Vec3::z() * 0.1 * stiffness).norm() < 1e-6, "{felt:?}");
        }
    }

    #[test]
    fn a_stylus_pressed_at_its_tip_is_felt_with_the_torque_of_its_lever() {
        let desc = turning_device();
        let coupling = VirtualCoupling::of(&desc);
        let mut proxy = Proxy::new(&coupling, &desc, &at(0.0, 0.0));
        // The tip is 40 mm aside and 30 mm below, in tissue that holds it in all directions.
        let tip = Patch {
            point_m: Vec3::new(0.04, 0.0, -0.03),
            normal: Vec3::z(),
            radius_m: 5e-3,
            tissue: Tissue { young_pa: 10e3, poisson: 0.45, relaxation_s: 0.0, density_kg_m3: 1000.0 },
            sticks: true,
            cell_m: 0.0,
            wall_n_per_m: 0.0,
            wall_share: 0.0,
        };
        let law = ContactModel { stiffness: tip.stiffness(&Pose::identity()), ..ContactModel::none() };
        let way = Vec6::new(1e-3, 0.0, -2e-3, 0.01, -0.02, 0.0);
        let device = ToolMotion::at(Pose::new(linear(&way), angular(&way)));
        let felt = (0..2000).fold(Wrench::default(), |_, _| proxy.advance(&law, &device, DT)[0]);
        // Both springs take the same wrench: K_vc (x_d − x) = K x. Small turns, so that rotation vectors add.
        let springs = isotropic(coupling.stiffness_n_per_m, coupling.stiffness_n_m_per_rad);
        let tool = (springs + law.stiffness).try_inverse().unwrap() * springs * way;
        let expected = -law.stiffness * tool;
        let missed = (stacked(&felt) - expected).norm();
        assert!(missed < 1e-3 * expected.norm(), "{felt:?} instead of {expected}");
        assert!(felt.torque_n_m.norm() > 1e-3, "and there is a torque: {felt:?}");
    }

    #[test]
    fn a_coupling_beyond_the_device_is_refused() {
        let desc = turning_device();
        let good = VirtualCoupling::of(&desc);
        good.check(&desc).unwrap();
        for bad in [
            VirtualCoupling { stiffness_n_per_m: 701.0, ..good },
            VirtualCoupling { stiffness_n_per_m: 0.0, ..good },
            VirtualCoupling { stiffness_n_per_m: f64::NAN, ..good },
            VirtualCoupling { damping_n_s_per_m: -1.0, ..good },
            VirtualCoupling { stiffness_n_m_per_rad: 1.1, ..good },
            VirtualCoupling { damping_n_m_s_per_rad: f64::INFINITY, ..good },
        ] {
            bad.check(&desc).unwrap_err();
        }
        // A spring that never pulls would hold the tool's turn.
        let without = DeviceDesc { max_torque_n_m: 0.0, ..desc };
        VirtualCoupling { stiffness_n_m_per_rad: 0.5, ..good }.check(&without).unwrap_err();
        VirtualCoupling { stiffness_n_m_per_rad: 0.0, ..good }.check(&without).unwrap();
    }
}
