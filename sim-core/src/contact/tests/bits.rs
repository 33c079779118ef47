//! The same bits, whoever computes them and whenever it was interrupted.

use super::*;
use crate::Isa;

fn hashes(isa: Isa, threads: usize, frames: usize) -> (Vec<u64>, usize) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.expect("a small pool").install(|| {
        let scene = glancing();
        let mut world = World::with_isa(scene, isa).expect("valid scene");
        let mut meetings = 0;
        let hashes = (0..frames)
            .map(|_| {
                let report = world.step(1.0 / 60.0, &[]);
                meetings += report.contacts.len();
                report.state_hash
            })
            .collect();
        (hashes, meetings)
    })
}

#[test]
fn threads_and_instruction_sets_never_show_in_contact() {
    let (expected, meetings) = hashes(Isa::Portable, 1, 40);
    assert!(meetings > 0, "nothing met");
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        for threads in [1, 3] {
            let (found, _) = hashes(isa, threads, 40);
            assert_eq!(found, expected, "{isa} on {threads} threads");
        }
    }
}

#[test]
fn a_checkpoint_in_contact_goes_on_with_the_same_bits() {
    let scene = glancing();
    let mut world = World::new(scene.clone()).expect("valid scene");
    let mut restored = World::new(scene).expect("valid scene");
    let mut inside = 0;
    for _ in 0..40 {
        restored
            .restore(&world.checkpoint())
            .expect("its own checkpoint");
        let (a, b) = (world.step(1.0 / 60.0, &[]), restored.step(1.0 / 60.0, &[]));
        assert_eq!(a.state_hash, b.state_hash, "step {}", a.step);
        assert_eq!(a.contacts, b.contacts);
        inside += usize::from(norm(a.objects[0].contact_impulse) > 0.0 && a.contacts.is_empty());
    }
    assert!(inside > 2, "no checkpoint fell into contact");
}
