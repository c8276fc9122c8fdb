//! Every interleaving of a few operations, and every value that the memory model allows them to see.
//!
//! loom also follows who may touch which slot when: an access that no ordering puts after the other thread's last one fails, which is
//! what a torn value would come from. Run by `tests/channels.sh`.

use super::latest::latest;
use super::ring::ring;

#[test]
fn three_publishes_against_three_reads_are_never_torn_and_never_go_back() {
    loom::model(|| {
        let (mut writer, mut reader) = latest([0_u8; 2]);
        let publishing = loom::thread::spawn(move || (1..=3).for_each(|n| writer.publish([n; 2])));
        let mut last = 0;
        let mut look = || {
            let (&[first, second], is_fresh) = reader.read();
            assert_eq!(first, second, "torn");
            assert!(first >= last, "{first} after {last}");
            assert_eq!(is_fresh, first > last, "fresh is what was not seen before");
            last = first;
            first
        };
        (0..3).for_each(|_| _ = look());
        publishing.join().unwrap();
        assert_eq!(look(), 3, "the last value is seen");
    });
}

#[test]
fn three_pushes_against_three_pops_come_out_whole_once_and_in_order() {
    // One slot makes every push but the first use a slot again; two leave one end ahead of the other.
    for capacity in [1, 2] {
        loom::model(move || {
            let (mut producer, mut consumer) = ring(capacity);
            let pushing = loom::thread::spawn(move || {
                let mut accepted = 0;
                // What a full ring gives back is tried once more later, as the next value.
                for _ in 0..3 {
                    if let Err(value) = producer.push([accepted + 1; 2]) {
                        assert_eq!(value, [accepted + 1; 2], "the value itself is given back");
                    } else {
                        accepted += 1;
                    }
                }
                accepted
            });
            let mut taken = 0;
            let mut take = || {
                consumer
                    .pop()
                    .inspect(|value| {
                        taken += 1;
                        assert_eq!(*value, [taken; 2]);
                    })
                    .is_some()
            };
            (0..3).for_each(|_| _ = take());
            let accepted = pushing.join().unwrap();
            while take() {}
            assert_eq!(taken, accepted, "nothing is lost");
        });
    }
}
