//! The servo loop against scripted tissue, a simulated device and a simulated hand.

#[path = "../support/bare_loop.rs"]
mod bare_loop;
mod behaviour;
mod bounds;
#[path = "../support/haptic_device.rs"]
mod haptic_device;
mod physics;
mod prediction;
mod rig;
mod stability;
