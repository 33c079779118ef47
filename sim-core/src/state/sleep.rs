//! How an object is modelled at present, and since when it has been still.
//!
//! One tolerance decides, relative to the radius of an object: what it has not moved by within [`REST`] seconds counts
//! as no motion.

use std::collections::VecDeque;

use bytemuck::bytes_of;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use crate::particles::{Extremes, Particles};

/// How long an object must have been still before it sleeps [s].
const REST: f64 = 0.25;
/// Poses that are kept of that time, at most.
const MAX_POSES: f64 = 16.0;
/// What sums of frame lengths may be off by, relative.
const ROUNDING: f64 = 1e-9;

/// How an object is modelled at present, and since when it has been still.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct SleepState {
    /// Where it sleeps.
    pub asleep: Option<Box<Asleep>>,
    /// Where its samples were of late, latest last.
    poses: VecDeque<PoseSample>,
    /// Since the latest pose [s].
    since_pose: f64,
    /// Its samples in the frame of its mean rotation when its shape last changed [m].
    pub shape: Vec<[f32; 3]>,
    /// For how long it has kept its shape [s].
    pub steady: f64,
    /// Elastic energy of its matter when a rigid proxy took its place, as long as that does [J].
    pub proxy: Option<f64>,
}

/// Where the samples of an object were at some time.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct PoseSample {
    /// Time since the pose before [s].
    after: f64,
    /// Positions [m].
    places: Vec<[f32; 3]>,
}

/// A sleeping object.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Asleep {
    pub particles: Particles,
    /// Of its parts, in their order.
    pub extremes: Vec<Extremes>,
}

impl SleepState {
    /// Adds what no particle shows to a hash.
    pub fn add_to(&self, hash: &mut Xxh3) {
        hash.update(&[u8::from(self.asleep.is_some())]);
        for pose in &self.poses {
            hash.update(bytes_of(&pose.after));
            hash.update(bytemuck::cast_slice(&pose.places));
        }
        hash.update(bytes_of(&self.since_pose));
        hash.update(bytes_of(&[self.steady, self.stored_energy()]));
        hash.update(bytemuck::cast_slice(&self.shape));
    }

    /// Takes its pose after another `frame` [s], if it is time to.
    pub fn sample_pose(&mut self, frame: f64, places: impl FnOnce() -> Vec<[f32; 3]>) {
        self.since_pose += frame;
        if !self.poses.is_empty() && self.since_pose < REST / MAX_POSES {
            return;
        }
        self.poses.push_back(PoseSample {
            after: self.since_pose,
            places: places(),
        });
        self.since_pose = 0.0;
        // As many as REST takes.
        let mut span: f64 = self.poses.iter().skip(2).map(|pose| pose.after).sum();
        while self.poses.len() > 1 && span >= REST * (1.0 - ROUNDING) {
            self.poses.pop_front();
            span -= self.poses.get(1).map_or(span, |pose| pose.after);
        }
    }

    /// Forgets what it saw.
    pub fn forget_poses(&mut self) {
        self.poses.clear();
        self.since_pose = 0.0;
    }

    /// Whether it has been still for [`REST`]: no sample was farther than `limit` [m] from the middle of where it was, and
    /// what it went without coming back counts whole. So vibration may be as large as what is tolerated, and the
    /// turning point of a slow swing does not pass for rest.
    pub fn is_still(&self, limit: f64) -> bool {
        let span: f64 = self.poses.iter().skip(1).map(|pose| pose.after).sum();
        let Some(latest) = self.poses.back() else {
            return false;
        };
        let all = self.poses.iter();
        let complete = all.clone().all(|l| l.places.len() == latest.places.len());
        span >= REST * (1.0 - ROUNDING)
            && complete
            && (0..latest.places.len()).all(|sample| {
                let (mut to_and_fro, mut one_way) = (0.0, 0.0);
                for a in 0..3 {
                    let way = all.clone().map(|pose| f64::from(pose.places[sample][a]));
                    let ([low, high], turned) = range(way);
                    let squared = (high - low).powi(2);
                    to_and_fro += 0.25 * squared;
                    one_way += if turned { 0.0 } else { squared };
                }
                to_and_fro.max(one_way) <= limit * limit
            })
    }

    /// Elastic energy that a body holds for its matter [J].
    pub fn stored_energy(&self) -> f64 {
        self.proxy.unwrap_or(0.0)
    }

    /// Parts of which it holds what a sleeping object must remember.
    pub fn remembered_parts(&self) -> usize {
        self.asleep
            .as_ref()
            .map_or(0, |asleep| asleep.extremes.len())
    }

    /// Whether it sleeps.
    pub fn is_asleep(&self) -> bool {
        self.asleep.is_some()
    }

    /// Its sleeping particles, if it sleeps.
    pub fn sleeping(&self) -> Option<&Particles> {
        self.asleep.as_ref().map(|asleep| &asleep.particles)
    }
}

/// The extremes of a coordinate, and whether it came back from both.
fn range(way: impl ExactSizeIterator<Item = f64>) -> ([f64; 2], bool) {
    let last = way.len().saturating_sub(1);
    let (mut low, mut high) = ((f64::INFINITY, 0), (f64::NEG_INFINITY, 0));
    for (n, x) in way.enumerate() {
        if x < low.0 {
            low = (x, n);
        }
        if x > high.0 {
            high = (x, n);
        }
    }
    let inside = |n: usize| n > 0 && n < last;
    ([low.0, high.0], inside(low.1) && inside(high.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether one sample that moves as `way` says [m] passes for still, looked at in frames of `frame` [s] until `end`.
    fn rests(way: impl Fn(f64) -> f64, frame: f64, end: f64, limit: f64) -> bool {
        let mut state = SleepState::default();
        for n in 0..=(end / frame).round() as usize {
            state.sample_pose(frame, || vec![[0.0, way(n as f64 * frame) as f32, 1.0]]);
        }
        state.is_still(limit)
    }

    #[test]
    fn vibration_within_the_tolerance_is_rest_wherever_it_began() {
        for frame in [1.0 / 60.0, 1.0 / 300.0] {
            for phase in 0..12 {
                let way = |t: f64| (31.0 * t + 0.5 * f64::from(phase)).sin();
                // One period takes 0.2 s: within half of one more it has turned at both ends.
                let soon = (0..6).any(|n| rests(way, frame, 0.25 + 0.017 * f64::from(n), 1.02));
                assert!(soon, "{frame} {phase}");
                assert!(!rests(way, frame, 0.5, 0.9), "{frame} {phase}");
                assert!(!rests(way, frame, 0.2, 1.02), "too soon: {frame} {phase}");
            }
        }
    }

    #[test]
    fn drift_counts_whole_and_so_does_a_slow_swing_as_it_turns() {
        let frame = 1.0 / 64.0;
        let creep = |t: f64| t / 0.25;
        assert!(rests(creep, frame, 1.0, 1.01) && !rests(creep, frame, 1.0, 0.99));
        // Around the turning point, an eighth of a second to each side.
        let swing = |t: f64| 1.0 - (2.0 * (t - 1.0)).cos();
        let range = swing(1.125);
        assert!(rests(swing, frame, 1.125, 1.1 * range));
        assert!(!rests(swing, frame, 1.125, 0.9 * range));
    }

    #[test]
    fn no_more_is_remembered_than_it_takes() {
        for frame in [0.5, 0.1, 1.0 / 60.0, 1e-3] {
            let mut state = SleepState::default();
            for _ in 0..1000 {
                state.sample_pose(frame, || vec![[0.0; 3]]);
            }
            assert!(state.poses.len() <= 18, "{} poses", state.poses.len());
            assert!(state.is_still(0.0), "{frame}");
        }
    }
}
