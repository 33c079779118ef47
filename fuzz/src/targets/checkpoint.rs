//! Checkpoints, with right checksums: what is behind them comes from anywhere.

use std::cell::RefCell;

use cosplat_sim_core::World;
use xxhash_rust::xxh3::xxh3_64;

use super::world;

/// Bytes of magic, version, digest and length; see `sim-core/src/world/checkpoint.rs`.
const HEADER: usize = 38;
/// Length of the step from a state that was taken [s]: up to eight of the smallest substeps there are. What fails in one fails in more.
const FRAME: f64 = 2e-6;

thread_local! {
    static STAGE: RefCell<(World, Vec<u8>)> = RefCell::new({
        let world = world::new();
        let header = world.checkpoint()[..HEADER].to_vec();
        (world, header)
    });
}

/// Content of a checkpoint: a refusal changes nothing, and what is accepted can be stepped and published.
pub fn read(data: &[u8]) {
    STAGE.with_borrow_mut(|(world, header)| {
        let before = world.report().state_hash;
        let mut bytes = header.clone();
        bytes.extend(data);
        bytes[HEADER - 8..HEADER].copy_from_slice(&(data.len() as u64).to_le_bytes());
        bytes.extend(xxh3_64(&bytes).to_le_bytes());
        if world.restore(&bytes).is_err() {
            assert_eq!(
                world.report().state_hash,
                before,
                "a refusal changed the state"
            );
            return;
        }
        world::check(world);
        world::step(world, FRAME);
    });
}

/// The world before its first step, in the air, in contact, and at rest.
pub fn seeds() -> Vec<Vec<u8>> {
    let mut world = world::new();
    let mut seeds = Vec::new();
    for steps in [0, 1, 20, 60] {
        for _ in 0..steps {
            world.step(1.0 / 60.0, &[]);
        }
        let bytes = world.checkpoint();
        seeds.push(bytes[HEADER..bytes.len() - 8].to_vec());
    }
    seeds
}
