//! palpate: soft tissue that can be seen, touched and cut in real time.
//!
//! ```text
//!  host servo thread                    owner's thread                       host render thread
//!  tool pose ──▶ channel::latest ──▶  sim::Sim::step ──▶ solver (cpu, cuda)
//!  force     ◀── channel::latest ◀──        │
//!                                           └──────────── sim::SurfacePort::map ──▶ vertices, normals
//! ```
//!
//! [`model`] says what is simulated, immutable and shared; [`cut`] what blades make of it; [`solver`] how a step is asked for; [`cpu`] and [`cuda`] where it is computed;
//! [`sim`] who drives; [`servo`] how a haptic device feels it; [`channel`] how threads meet. [`capi`] is the C interface over all of it,
//! and nothing imports it. What the tissue obeys is described in [`model::law`].
//!
//! ```
//! use std::sync::Arc;
//!
//! use palpate::math::{Pose, Vec3};
//! use palpate::model::{Build, phantom};
//! use palpate::sim::{Sim, SimDesc};
//! use palpate::solver::tool::{ToolDesc, ToolMotion};
//!
//! // The generated chest in cells of 8 mm; ribs are rigid, and what is stiffer than 20 kPa is taken as 20 kPa.
//! let mut build = Build::new(phantom::thorax(0.008)?);
//! build.uses = phantom::thorax_uses();
//! build.young_cap_pa = Some(20e3);
//! let model = Arc::new(build.run(&mut |_, _| true)?);
//!
//! // A ball of 15 mm radius, 5 mm deep in the skin below the breast bone.
//! let mut sim = Sim::new(model, &SimDesc::default())?;
//! let skin = sim.pick(Vec3::new(0.0, 0.3, -0.08), -Vec3::y())?.expect("the chest is there").point_m;
//! let mut ball = sim.add_tool(&ToolDesc::sphere(0.015))?;
//! for step in 0..100 {
//!     let at = skin + Vec3::y() * (0.015 - 5e-5 * f64::from(step));
//!     ball.set_motion(&ToolMotion::at(Pose::translation(at.x, at.y, at.z)))?;
//!     sim.step()?;
//! }
//! assert!(ball.force().wrench.force_n.y > 0.0, "the chest pushes back");
//! # Ok::<(), palpate::error::Error>(())
//! ```

pub mod capi;
pub mod channel;
pub mod cpu;
pub mod cuda;
pub mod cut;
pub mod error;
pub mod log;
pub mod math;
pub mod model;
#[cfg(test)]
mod noise;
pub mod servo;
pub mod sim;
pub mod solver;
mod trace;
