//! The servo loop's side of a tool: from a device's motion to the force on its motors, at 1 kHz or faster, whatever the physics' rate.
//!
//! ```text
//!  device ──▶ coupling ──▶ tool's motion ──▶ physics ──▶ contact model ─┐
//!    ▲            ▲                                                     │
//!    │            └── follower: the law that fades to the newest model ◀┘
//!    └── safety chain ◀── passivity ◀── wrench at the device's motion now
//! ```
//!
//! The physics publishes a [`ContactModel`] with every solve, with the stiffness that its [`stiffness::StiffnessEstimator`] found.
//! [`Servo::tick`] follows the newest one, couples the device to the tool, watches the energy and bounds the force. Nothing here knows how
//! tissue is solved or how threads meet. A tick takes no lock, no clock and no memory, calls no system, has no loop without a bound, and
//! cannot panic.
//!
//! Nor does it call much: where a stage hands three numbers to the next through memory, they are often stored as two and one and loaded as one and two, and the
//! processor waits until they have arrived there. So the stages are inlined, and what is rare is left out of line.
//!
//! ```
//! use palpate::channel::latest::latest;
//! use palpate::servo::contact_model::ContactModel;
//! use palpate::servo::device::DeviceDesc;
//! use palpate::servo::patch::{Patch, Tissue};
//! use palpate::servo::stiffness::StiffnessEstimator;
//! use palpate::servo::{DeviceState, Servo, ServoOptions};
//! # use palpate::math::{Pose, Vec3};
//! # use palpate::solver::tool::{Contact, ToolMotion, Wrench};
//!
//! let device = DeviceDesc::touch();
//! let options = ServoOptions::of(&device);
//! let mut servo = Servo::new(&device, &options)?;
//! let mut estimator = StiffnessEstimator::new(&options.coupling.limits(&device));
//! let (mut models, mut newest) = latest(ContactModel::none());
//!
//! // On the simulation's thread, after a solve:
//! # let (motion, wrench, contacts) = (ToolMotion::at(Pose::identity()), Wrench::default(), Vec::<Contact>::new());
//! # let (time_s, period_s, stamp_s, sequence) = (0.0, 1e-3, 0.0, 1);
//! let tissue =
//!     |_material| Tissue { young_pa: 10e3, poisson: 0.45, relaxation_s: 0.0, density_kg_m3: 1000.0 };
//! let patch = Patch::of(&contacts, tissue, |_| false, 0.2, 4e-3);
//! let found = estimator.update(patch.as_ref(), &motion, &wrench, period_s);
//! models.publish(ContactModel {
//!     wrench,
//!     motion,
//!     stiffness: found.stiffness,
//!     damping: found.damping,
//!     push: patch.map_or(Vec3::zeros(), |patch| patch.normal),
//!     time_s,
//!     period_s,
//!     stamp_s,
//!     sequence,
//!     epoch: 0,
//! });
//!
//! // On the servo's thread, at each tick:
//! # let (is_held, is_live) = (true, true);
//! let state = DeviceState { motion, stamp_s, is_held };
//! let out = servo.tick(&state, newest.read().0, is_live);
//! // out.tool goes to the simulation with stamp_s, out.wrench to the motors.
//! assert!(out.wrench.force_n.norm() <= device.max_force_n);
//! # Ok::<(), palpate::error::Error>(())
//! ```

pub mod clock;
pub mod contact_model;
pub mod coupling;
pub mod device;
pub mod flags;
pub mod follower;
pub mod impedance;
pub mod lead;
pub mod passivity;
pub mod patch;
pub mod safety;
pub mod stiffness;

use clock::{Clock, Tick};
use contact_model::ContactModel;
use coupling::{Coupling, Proxy, VirtualCoupling};
use device::DeviceDesc;
use flags::Flags;
use follower::Follower;
use passivity::Observer;
use safety::{Asked, DISENGAGING, SafetyChain};

use crate::error::Result;
use crate::math::{Pose, Vec3};
use crate::solver::tool::{ToolMotion, Wrench};

/// What a device says at a tick of its servo loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceState {
    /// Where it is and how it moves, world frame.
    pub motion: ToolMotion,
    /// When that was, in seconds on the host's clock, from any start.
    pub stamp_s: f64,
    /// Whether the dead-man switch is held; `true` for a device without one.
    pub is_held: bool,
}

/// How a servo loop is run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoOptions {
    /// How the tool follows the device.
    pub coupling: Coupling,
    /// Whether the passivity controller damps when the loop has given energy. The observer always runs.
    pub controls_passivity: bool,
}

impl ServoOptions {
    /// What is safe whatever the tissue: the stiffest coupling that the device renders, kept passive.
    pub fn of(desc: &DeviceDesc) -> Self {
        Self { coupling: Coupling::Virtual(VirtualCoupling::of(desc)), controls_passivity: true }
    }
}

/// What comes of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// Force and torque for the device's motors. Always finite and within its limits.
    pub wrench: Wrench,
    /// The tool's motion, for the physics.
    pub tool: ToolMotion,
    /// Whether it is one: the device has said where it is.
    pub is_placed: bool,
    /// What happened to the force.
    pub flags: Flags,
}

/// What a servo loop knows about itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ServoStatistics {
    /// Ticks so far.
    pub ticks: u64,
    /// How many of them came after a pause, the first included.
    pub pauses: u64,
    /// Energy that the hand has put into the loop, in J.
    pub energy_j: f64,
    /// The least it ever was: a passive loop stays at or above zero.
    pub least_energy_j: f64,
    /// Root of the mean square of the force, over the device's window, in N.
    pub average_force_n: f64,
    /// Time since the newest contact model arrived, in s; infinite before the first.
    pub age_s: f64,
    /// Time from a motion's stamp to the tick that saw the first contact model computed with it, in s: the newest, ...
    pub latency_s: f64,
    /// ... and the longest so far. Zero where models carry no stamps.
    pub longest_latency_s: f64,
}

/// One tool's servo loop.
#[derive(Clone, Debug)]
pub struct Servo {
    desc: DeviceDesc,
    options: ServoOptions,
    clock: Clock,
    follower: Follower,
    proxy: Option<Proxy>,
    observer: Observer,
    chain: SafetyChain,
    /// Where the device last said that it was, and whether it ever did.
    pose: Pose,
    is_placed: bool,
    /// That of the newest model: another one, and what was engaged with is no more.
    epoch: u64,
    /// What is counted; the rest is asked of the stages.
    statistics: ServoStatistics,
}

impl Servo {
    /// A loop for a device. Refuses limits and couplings that contradict each other.
    pub fn new(desc: &DeviceDesc, options: &ServoOptions) -> Result<Self> {
        desc.check()?;
        let motion = ToolMotion::at(Pose::identity());
        let proxy = match &options.coupling {
            Coupling::Direct => None,
            Coupling::Virtual(coupling) => {
                coupling.check(desc)?;
                Some(Proxy::new(coupling, desc, &motion))
            }
        };
        Ok(Self {
            desc: *desc,
            options: *options,
            clock: Clock::new(desc.tick_s()),
            follower: Follower::new(desc.tick_s()),
            proxy,
            observer: Observer::default(),
            chain: SafetyChain::new(desc),
            pose: motion.pose,
            is_placed: false,
            epoch: 0,
            statistics: ServoStatistics::default(),
        })
    }

    /// One tick: what the device says and the physics' newest model in, the motors' wrench and the tool's motion out. `is_live` says
    /// whether the simulation runs and has not failed.
    pub fn tick(&mut self, device: &DeviceState, newest: &ContactModel, is_live: bool) -> Output {
        let tick = self.clock.tick(device.stamp_s);
        let is_motion = device.motion.is_valid();
        // A device that says nonsense is where it last was, and stands.
        let standing = ToolMotion::at(self.pose);
        let motion = if is_motion { &device.motion } else { &standing };
        self.pose = motion.pose;
        self.is_placed |= is_motion;
        if tick == Tick::Fresh {
            self.restart(motion);
        }

        let is_same = std::mem::replace(&mut self.epoch, newest.epoch) == newest.epoch;
        let is_model = self.follow(newest, motion, device.stamp_s);
        self.observer.look(motion);
        let dt = match tick {
            Tick::Steady(dt) => dt,
            Tick::Fresh | Tick::Unknown => 0.0,
        };
        let [wrench, lasting] = self.couple(motion, dt);
        let (wrench, damped) = self.keep_passive(wrench, motion, dt);

        let (wrench, flags) = self.chain.pass(&Asked {
            wrench,
            lasting,
            motion: *motion,
            tick,
            age_s: self.follower.age_s(self.clock.now_s()),
            period_s: self.follower.newest().period_s,
            is_finite: is_motion && is_model,
            is_live: is_live && is_same,
            is_held: device.is_held,
        });
        if flags.intersects(DISENGAGING) {
            self.release_proxy(motion);
        }
        self.observer.render(motion, &wrench);
        self.statistics.ticks += 1;
        self.statistics.pauses += u64::from(tick == Tick::Fresh);
        let tool = self.proxy.as_ref().map_or(*motion, |proxy| *proxy.motion());
        Output { wrench, tool, is_placed: self.is_placed, flags: flags | damped }
    }

    /// How the loop has done so far.
    #[inline]
    pub fn statistics(&self) -> ServoStatistics {
        ServoStatistics {
            energy_j: self.observer.energy_j(),
            least_energy_j: self.observer.least_j(),
            average_force_n: self.chain.average_force_n(),
            age_s: self.follower.age_s(self.clock.now_s()),
            ..self.statistics
        }
    }

    /// The device that the loop was made for.
    pub fn device(&self) -> &DeviceDesc {
        &self.desc
    }

    /// What was done while the loop paused is not known: the motors were their own, and the hand may have gone anywhere.
    fn restart(&mut self, device: &ToolMotion) {
        self.observer.pause();
        self.release_proxy(device);
    }

    fn release_proxy(&mut self, device: &ToolMotion) {
        if let Some(proxy) = &mut self.proxy {
            proxy.reset(device);
        }
    }

    /// Takes the newest model, and says whether it can be believed.
    fn follow(&mut self, newest: &ContactModel, device: &ToolMotion, stamp_s: f64) -> bool {
        // Before the first solve there is nothing to follow, and its age stays infinite.
        if newest.sequence == 0 {
            return true;
        }
        // One that was taken already was looked at then.
        if !self.follower.is_news(newest) {
            return true;
        }
        if !newest.is_finite() {
            return false;
        }
        let tool = self.proxy.as_ref().map_or(device, Proxy::motion);
        let is_new = self.follower.accept(newest, tool, self.clock.now_s());
        let latency = stamp_s - newest.stamp_s;
        if is_new && latency.is_finite() {
            self.statistics.latency_s = latency;
            self.statistics.longest_latency_s = self.statistics.longest_latency_s.max(latency);
        }
        true
    }

    /// The wrench that the device feels, and what of it lasts; and where the tool goes.
    #[inline]
    fn couple(&mut self, device: &ToolMotion, dt: f64) -> [Wrench; 2] {
        let now = self.clock.now_s();
        match &mut self.proxy {
            None if !self.desc.has_torque() => {
                let forces = self.follower.forces(device, now);
                forces.map(|force_n| Wrench { force_n, ..Wrench::default() })
            }
            None => [*device, ToolMotion::at(device.pose)].map(|motion| self.follower.evaluate(&motion, now)),
            Some(proxy) if !proxy.turns_freely() => {
                let law = self.follower.straight(&proxy.turned(device), now);
                let forces = proxy.advance_straight(&law, device, dt);
                // Only the tissue can tell the torque, where there are motors for it.
                let torque_n_m = if self.desc.has_torque() {
                    self.follower.evaluate(proxy.motion(), now).torque_n_m
                } else {
                    Vec3::zeros()
                };
                forces.map(|force_n| Wrench { force_n, torque_n_m })
            }
            Some(proxy) => {
                let law = self.follower.law(proxy.motion(), now);
                proxy.advance(&law, device, dt)
            }
        }
    }

    /// Adds the passivity controller's damping.
    #[inline]
    fn keep_passive(&self, wrench: Wrench, motion: &ToolMotion, dt: f64) -> (Wrench, Flags) {
        if !self.options.controls_passivity {
            return (wrench, Flags::NONE);
        }
        let most = self.desc.max_damping.linear;
        let (damper, is_acting) = passivity::control(self.observer.credit_j(), &wrench, motion, dt, most);
        (Wrench { force_n: wrench.force_n + damper.force_n, ..wrench }, Flags::DAMPED.when(is_acting))
    }
}
