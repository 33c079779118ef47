//! One number for the complete state.

use bytemuck::bytes_of;
use rayon::prelude::*;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::published::Published;
use crate::state::State;

/// Particles per partial hash; fixed, so that the hash does not depend on the thread count.
const CHUNK: usize = 4096;

/// Hash (XXH3) of every particle in scene order, of gravity, materials, time and what commands did to colliders and pins.
pub(super) fn state_hash(published: &Published, state: &State) -> u64 {
    let count = published.cells.len();
    let parts: Vec<u64> = (0..count.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let range = chunk * CHUNK..count.min((chunk + 1) * CHUNK);
            let elastic = match published.elastic.get(range.clone()) {
                Some(elastic) => xxh3_64(bytemuck::cast_slice(elastic)),
                None => 0,
            };
            let fields = [
                elastic,
                xxh3_64(bytemuck::cast_slice(&published.memory[range.clone()])),
                xxh3_64(bytemuck::cast_slice(&published.cells[range.clone()])),
                xxh3_64(bytemuck::cast_slice(&published.velocity[range.clone()])),
                xxh3_64(bytemuck::cast_slice(&published.affine[range.clone()])),
                xxh3_64(bytemuck::cast_slice(&published.deformation[range])),
            ];
            xxh3_64(bytes_of(&fields))
        })
        .collect();
    let mut hash = Xxh3::new();
    hash.update(bytemuck::cast_slice(&parts));
    hash.update(bytemuck::cast_slice(&state.matter.removed));
    hash.update(bytes_of(&state.commanded.gravity));
    hash.update(bytes_of(&state.motion.frame_velocity));
    hash.update(bytes_of(&state.progress.sim_time));
    hash.update(bytes_of(&state.motion.velocity_offset));
    for material in &state.commanded.materials {
        hash.update(bytes_of(&(material.law.id())));
        hash.update(bytes_of(&[
            material.youngs_modulus,
            material.poisson_ratio,
            material.density,
        ]));
        hash.update(bytes_of(&material.law.parameters()));
    }
    for rigid in &state.bodies.of {
        hash.update(&[u8::from(rigid.is_some())]);
        if let Some(rigid) = rigid {
            let body = &rigid.body;
            hash.update(bytes_of(&body.com));
            hash.update(bytes_of(&body.rotation));
            hash.update(bytes_of(&body.velocity));
            hash.update(bytes_of(&body.angular_momentum));
        }
    }
    hash_solids(&mut hash, state);
    // Zeros where versions with affine objects said more: the same motion keeps the hash it had.
    hash.update(&vec![0; state.bodies.of.len()]);
    hash_warm_start(&mut hash, state);
    for level in &state.levels {
        level.add_to(&mut hash);
    }
    hash.update(bytemuck::cast_slice(&state.in_contact.bits()));
    for path in &state.commanded.paths {
        let pose = path.map(|path| path.to);
        hash.update(&[u8::from(pose.is_some())]);
        if let Some(pose) = pose {
            hash.update(bytes_of(&pose.translation));
            hash.update(bytes_of(&pose.rotation));
        }
    }
    for pin in &state.commanded.pins {
        let bits = pin.as_ref().map_or(&[][..], |members| members.bits());
        hash.update(bytes_of(&(bits.len() as u64)));
        hash.update(bytemuck::cast_slice(bits));
    }
    hash_grabs(&mut hash, state);
    hash.digest()
}

/// Adds what points of contact of rigid bodies bore.
fn hash_warm_start(hash: &mut Xxh3, state: &State) {
    for known in &state.bodies.warm_start {
        hash.update(bytes_of(&known.pair));
        hash.update(bytes_of(&known.normal_impulse));
        hash.update(bytes_of(&known.friction_impulse));
        hash.update(bytes_of(&known.places));
        hash.update(bytes_of(&known.normal));
        hash.update(bytes_of(&known.twist));
    }
}

/// Adds the patches that clients hold, and what they edited.
fn hash_grabs(hash: &mut Xxh3, state: &State) {
    for grab in &state.commanded.grabs {
        hash.update(bytes_of(&[grab.object as u64, grab.holder]));
        hash.update(bytemuck::cast_slice(&grab.particles));
        hash.update(bytemuck::cast_slice(&grab.places));
        hash.update(bytes_of(&[grab.offset, grab.from, grab.target]));
        hash.update(bytes_of(&[grab.steps, grab.steps_left]));
    }
    hash_edits(hash, state);
}

/// Adds what edits made of objects; nothing where there was none, so that the same motion keeps the hash it had.
fn hash_edits(hash: &mut Xxh3, state: &State) {
    let commanded = &state.commanded;
    for entry in &commanded.painted {
        hash.update(bytes_of(&[entry.part as u64, entry.particles.len() as u64]));
        hash.update(bytemuck::cast_slice(&entry.particles));
    }
    for object in 0..commanded.fidelity.len() {
        if let Some(fidelity) = commanded.fidelity[object] {
            hash.update(bytes_of(&[object as u64, fidelity as u64]));
        }
        if let Some(away) = &commanded.away[object] {
            hash.update(bytes_of(&(object as u64)));
            hash.update(bytes_of(&away.com));
            hash.update(bytes_of(&away.rotation));
        }
        if let Some(pose) = &commanded.shown[object] {
            hash.update(bytes_of(&(object as u64)));
            hash.update(bytes_of(&pose.translation));
            hash.update(bytes_of(&pose.rotation));
        }
    }
}

/// Adds the nodes of solids, and who was one.
fn hash_solids(hash: &mut Xxh3, state: &State) {
    for (object, _) in state
        .gone_over
        .iter()
        .enumerate()
        .filter(|(_, gone)| **gone)
    {
        hash.update(bytes_of(&(object as u64)));
    }
    for solid in state.solids.iter().flatten() {
        hash.update(bytemuck::cast_slice(&solid.nodes));
        for memory in &solid.memory {
            hash.update(bytemuck::cast_slice(memory));
        }
        hash.update(bytemuck::cast_slice(&solid.relaxed));
        hash.update(bytes_of(&[solid.shift, solid.velocity]));
        hash.update(bytes_of(&[solid.tangent, solid.rate]));
        for grip in &solid.springs {
            hash.update(bytes_of(&grip.with));
            hash.update(bytes_of(&grip.stretch));
            hash.update(bytes_of(&[grip.energy, grip.pressure, grip.depth]));
            hash.update(bytes_of(&grip.side));
        }
        for overlap in &solid.overlaps.all {
            hash.update(bytes_of(&[overlap.point, overlap.with]));
            hash.update(bytes_of(&[overlap.depth, overlap.speed]));
        }
    }
}
