//! Recordings and checkpoints that are damaged, and whether anything of them can still be used.

use std::{
    io::Read,
    path::{Path, PathBuf},
};

use cosplat_recorder::{RecordingError, reader::Recording, recover::recover};
use rand_core::Rng;

/// Bytes of a recording that are looked at.
const LOOKED_AT: u64 = 1 << 20;
/// Bytes that any recording begins with; less holds nothing.
const LEAST: u64 = 9;

/// The beginning of a file.
fn beginning(path: &Path) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).ok()?;
    file.take(LOOKED_AT).read_to_end(&mut bytes).ok()?;
    (bytes.len() as u64 >= LEAST).then_some(bytes)
}

/// What cannot be read of a recording as a fault left it; nothing where its recorder was killed before the first byte.
pub fn unreadable(path: &Path) -> Option<String> {
    let length = std::fs::metadata(path).map_or(0, |m| m.len());
    if length < LEAST {
        return None;
    }
    let mut repaired = PathBuf::from(path);
    repaired.set_extension("repaired");
    let found = match recover(path, &repaired, true) {
        Err(error) => Some(format!("recovery: {error}")),
        Ok(_) => damaged(&repaired),
    };
    let _ = std::fs::remove_file(&repaired);
    found
}

/// What is damaged in a recording.
pub fn damaged(path: &Path) -> Option<String> {
    let events = match Recording::open(path) {
        Ok(recording) => recording.without_gaussians(),
        Err(error) => return Some(error.to_string()),
    };
    let errors = events.filter_map(Result::err);
    // What a message means was for its recorder to check; that its bytes are whole is for the file.
    let mut damage = errors.filter(|e| !matches!(e, RecordingError::Message { .. }));
    damage.next().map(|error| error.to_string())
}

/// Flips, cuts or overwrites bytes behind the first `kept`.
pub fn damage(bytes: &mut Vec<u8>, kept: usize, rng: &mut impl Rng) {
    let mut place = || kept + rng.next_u64() as usize % (bytes.len() - kept).max(1);
    let places = [place(), place(), place()];
    match places[2] % 3 {
        0 => bytes.truncate(places[0]),
        1 => {
            for at in places {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << (at % 8);
                }
            }
        }
        _ => {
            let end = bytes.len().min(places[0] + 4096);
            bytes[places[0].min(end)..end].fill(places[1] as u8);
        }
    }
}

/// A damaged copy of a recording: what recovery does with it. The first bytes stay: without them it is no recording.
pub fn damaged_copy(path: &Path, copy: &Path, rng: &mut impl Rng) -> Option<String> {
    let mut bytes = beginning(path)?;
    damage(&mut bytes, LEAST as usize, rng);
    std::fs::write(copy, bytes).ok()?;
    let outcome = std::panic::catch_unwind(|| unreadable(copy));
    outcome.unwrap_or_else(|_| Some("the recovery panicked".into()))
}
