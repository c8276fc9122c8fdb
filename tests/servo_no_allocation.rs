//! A servo loop, and what a simulation does for it at each solve, allocate nothing.

use palpate::channel::latest::latest;
use palpate::channel::ring::ring;
use palpate::servo::ServoOptions;
use palpate::servo::contact_model::ContactModel;
use palpate::servo::coupling::Coupling;
use palpate::servo::device::DeviceDesc;

#[path = "../benches/common/allocations.rs"]
#[allow(dead_code, reason = "all threads are counted")]
mod allocations;
#[path = "support/bare_loop.rs"]
mod bare_loop;
#[path = "support/haptic_device.rs"]
#[allow(dead_code, reason = "the hands serve elsewhere")]
mod haptic_device;
#[path = "servo/physics.rs"]
#[allow(dead_code, reason = "one tissue serves here")]
mod physics;
#[path = "servo/rig.rs"]
#[allow(dead_code, reason = "one outcome serves here")]
mod rig;

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;

#[test]
fn a_servo_loop_and_its_channels_allocate_nothing() {
    let person = rig::Person {
        body: haptic_device::Body::default(),
        hand: Some(haptic_device::Hand::LOOSE),
        push_n: 0.0,
    };
    let tissue = physics::Tissue::Layered { soft_n_per_m: 125.0, hard_n_per_m: 5000.0, depth_m: 4e-3 };
    let (mut writer, mut reader) = latest(ContactModel::none());
    let (mut producer, mut consumer) = ring(4);

    let couplings = [Coupling::Direct, ServoOptions::of(&DeviceDesc::touch()).coupling];
    let press = |coupling| rig::press(&person, tissue, 2, coupling, true).force_n;
    // Once for the test's own thread to come to rest.
    let _ = couplings.map(press);

    let before = allocations::count();
    let felt = couplings.map(press);
    for _ in 0..10 {
        writer.publish(ContactModel::none());
        assert!(reader.read().1);
        assert!(producer.push(*reader.read().0).is_ok() && consumer.pop().is_some());
    }
    assert_eq!(allocations::count() - before, 0);
    assert!(felt.iter().all(|force| *force > 0.2), "something was felt: {felt:?}");
}
