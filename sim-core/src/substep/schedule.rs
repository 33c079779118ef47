//! Where the loop is in a frame: the substep at hand, and the one after it.

use super::limit::{Limit, time_step};
use crate::{
    colliders::Substep,
    kinematics::kick,
    state::{Given, GridMotion, Matter},
};

/// Substeps of a segment at most: the work that a rollback may repeat.
const SEGMENT: usize = 32;
/// Largest distance out of its block at which a particle may still be scattered [cells]: the drift margin of the tiles,
/// less the round-off of positions.
const MARGIN: f64 = 0.999;

/// What stays the same from one rollback, or sort, to the next.
#[derive(Clone, Debug)]
pub(crate) struct Segment {
    /// Length of the frame [s].
    pub length: f64,
    /// Smallest substep that is planned [s].
    pub smallest_dt: f64,
    /// Largest substep after failures, and why.
    pub cap: Limit,
    /// Substeps that a rolled-back segment had accepted, to be taken again: then it ends [s].
    pub replay: Vec<f64>,
    /// Substeps accepted so far [s].
    pub taken: Vec<f64>,
    /// Whether the first substep is not tried again if it fails.
    pub last_try: bool,
    /// Particles that sleep through the frame.
    pub asleep: usize,
}

/// The substep at hand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Schedule {
    /// Its size [s].
    pub dt: f64,
    /// What limits it.
    pub limit: Limit,
    /// What is left of the frame where it begins [s].
    pub remaining: f64,
}

/// A substep among what it reads.
pub(super) struct Context<'a> {
    pub given: Given<'a>,
    pub segment: &'a Segment,
    pub schedule: &'a Schedule,
    pub now: Substep,
    /// Time by which velocities are behind positions at its end [s].
    pub velocity_offset: f64,
}

impl<'a> Context<'a> {
    /// A substep of a segment, before which velocities are behind positions by `offset` [s].
    pub fn new(
        given: Given<'a>,
        segment: &'a Segment,
        schedule: &'a Schedule,
        offset: f64,
    ) -> Self {
        let Schedule { dt, remaining, .. } = *schedule;
        let [kick, velocity_offset] = kick(offset, dt, given.model.scene.cfl);
        Self {
            now: Substep {
                time: given.time + (segment.length - remaining),
                dt,
                kick,
                frame_start: given.time,
                frame_length: segment.length,
            },
            velocity_offset,
            given,
            segment,
            schedule,
        }
    }

    /// The substep that begins where this one ends.
    pub fn after(&self, next: &Schedule) -> Substep {
        let now = &self.now;
        Substep {
            time: now.time + now.dt,
            dt: next.dt,
            kick: kick(self.velocity_offset, next.dt, self.given.model.scene.cfl)[0],
            ..*now
        }
    }
}

impl Segment {
    /// The first substep, with so much left of the frame [s].
    pub fn first(
        &self,
        given: &Given<'_>,
        matter: &Matter,
        motion: &GridMotion,
        remaining: f64,
    ) -> Schedule {
        let limit = time_step(given, matter, motion);
        self.choose(limit, self.replay.first(), remaining)
    }

    /// The substep after the one at hand.
    pub(super) fn next(&self, at: &Context<'_>, matter: &Matter, motion: &GridMotion) -> Schedule {
        let limit = time_step(&at.given, matter, motion);
        let remaining = at.schedule.remaining - at.schedule.dt;
        self.choose(limit, self.replay.get(self.taken.len() + 1), remaining)
    }

    /// Whether the substep at hand is not tried again if it fails.
    pub fn is_last_try(&self) -> bool {
        self.last_try && self.taken.is_empty()
    }

    /// The size of a substep: equal shares of what is left of the frame, rounded to the precision of the kernels so that the
    /// shares add up to the frame.
    fn choose(&self, limit: Limit, replayed: Option<&f64>, remaining: f64) -> Schedule {
        let limit = match self.cap.dt < limit.dt {
            true => self.cap,
            false => limit,
        };
        let of = |dt: f64, limit: Limit| Schedule {
            dt,
            limit,
            remaining,
        };
        if let Some(&dt) = replayed {
            return of(dt, limit);
        }
        let largest = limit.dt.max(self.smallest_dt.min(self.cap.dt));
        // A share may exceed the limit by rounding: better than one substep more.
        let shares = (remaining / largest - 1e-6).ceil().max(1.0);
        if shares <= 1.0 {
            return of(remaining, Limit::FRAME);
        }
        of(f64::from((remaining / shares) as f32), limit)
    }

    /// Whether the segment ends with a substep in which particles `drift` out of their blocks [cells] and travel on.
    pub(super) fn ends(&self, at: &Schedule, drift: f64, travel: f64) -> bool {
        let count = self.taken.len() + 1;
        let replayed = !self.replay.is_empty() && count == self.replay.len();
        let is_full = count == SEGMENT;
        replayed || is_full || at.dt >= at.remaining || drift + travel > MARGIN
    }
}
