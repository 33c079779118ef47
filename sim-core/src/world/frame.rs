//! What happens during one frame.

use crate::{
    report::{DtLimit, GoneOver, StepReport},
    state::State,
    substep::{Limit, Schedule, Segment, Tally},
};

/// Times that a failing substep is halved before its bad particles are quarantined.
const RETRIES: u32 = 6;

/// What happens during one frame.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    /// Its length [s].
    pub length: f64,
    /// Time and work.
    pub tally: Tally,
    /// What is left of it [s].
    pub remaining: f64,
    /// What failures ask for.
    pub retry: Retry,
    substeps: u32,
    rollbacks: u32,
    last_dt: f64,
    smallest: Limit,
    /// What limited the smallest substep on the spatial grid.
    pub limit_on_grid: DtLimit,
    /// Smallest substep that is planned or tried [s].
    pub smallest_dt: f64,
    /// Particles that sleep through it.
    pub asleep: usize,
    /// How long forces acted on particles in it [s]: from the moment of their velocities before it to that after it.
    pub kicked: f64,
    /// Kinetic energy that objects lost by being modelled with less [J].
    pub fidelity_loss: f64,
    /// Solids that went over to the spatial grid.
    pub gone_over: Vec<GoneOver>,
    /// Particles frozen because they stayed bad.
    pub quarantined: Vec<u32>,
    /// Particles that left the domain.
    pub left_domain: Vec<u32>,
    /// Whether it was undone because a particle would have left the domain.
    stopped: bool,
}

/// What failures ask of the segments that follow.
#[derive(Clone, Debug)]
pub(super) struct Retry {
    /// Substeps that a rolled-back segment had accepted: to be taken again [s].
    pub replay: Vec<f64>,
    /// Largest substep after failures, and why.
    pub cap: Limit,
    /// Failures of the substep at hand.
    pub failures: u32,
}

impl Retry {
    /// Nothing failed.
    const NONE: Self = Self {
        replay: vec![],
        cap: Limit::FRAME,
        failures: 0,
    };
}

impl Frame {
    /// A frame of this length [s]; nothing happens in one that is not finite and positive.
    pub fn new(length: f64) -> Self {
        let length = if length > 0.0 && length.is_finite() {
            length
        } else {
            0.0
        };
        Self {
            length,
            tally: Tally::default(),
            remaining: length,
            retry: Retry::NONE,
            substeps: 0,
            rollbacks: 0,
            last_dt: 0.0,
            smallest: Limit::FRAME,
            limit_on_grid: DtLimit::Frame,
            smallest_dt: 0.0,
            asleep: 0,
            kicked: 0.0,
            fidelity_loss: 0.0,
            gone_over: vec![],
            quarantined: vec![],
            left_domain: vec![],
            stopped: false,
        }
    }

    /// Notes the particles of a body that left the domain, or, if it is not `somewhere`, failed.
    pub fn lose_body(&mut self, ids: Vec<u32>, somewhere: bool) {
        let list = match somewhere {
            true => &mut self.left_domain,
            false => &mut self.quarantined,
        };
        list.extend(ids);
        list.sort_unstable();
    }

    /// Makes it a frame in which nothing happens but that `left_domain` is reported.
    pub fn stop(&mut self) {
        *self = Self {
            left_domain: std::mem::take(&mut self.left_domain),
            gone_over: std::mem::take(&mut self.gone_over),
            tally: std::mem::take(&mut self.tally),
            rollbacks: self.rollbacks,
            stopped: true,
            ..Self::new(0.0)
        };
    }

    /// Whether particles left the domain.
    pub fn lost_particles(&self) -> bool {
        !self.left_domain.is_empty()
    }

    /// Whether it was undone.
    pub fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// The frame's share of a report.
    pub fn report(&self, state: &State) -> StepReport {
        let smallest = self.smallest.dt.min(self.last_dt);
        StepReport {
            step: state.progress.steps,
            sim_time: state.progress.sim_time,
            dt: self.last_dt,
            dt_min: smallest,
            dt_limit: self.smallest.cause,
            dt_object: self.smallest.object,
            substeps: self.substeps,
            rollbacks: self.rollbacks,
            particle_updates: self.tally.work.grid_to_particle,
            fidelity_loss: self.fidelity_loss,
            gone_over: self.gone_over.clone(),
            left_domain: self.left_domain.clone(),
            stopped: self.stopped,
            quarantined: self.quarantined.clone(),
            timings: self.tally.timings,
            work: self.tally.work,
            ..StepReport::default()
        }
    }

    /// A segment that begins now, with what failures before it ask for.
    pub fn begin_segment(&mut self) -> Segment {
        Segment {
            length: self.length,
            smallest_dt: self.smallest_dt,
            cap: self.retry.cap,
            replay: std::mem::take(&mut self.retry.replay),
            taken: vec![],
            last_try: self.is_last_try(),
            asleep: self.asleep,
        }
    }

    /// Takes note of a substep that stands.
    pub fn accept(&mut self, dt: f64, limit: Limit) {
        self.remaining -= dt;
        self.substeps += 1;
        self.last_dt = dt;
        self.retry.failures = 0;
        if dt < self.smallest.dt {
            self.smallest = Limit { dt, ..limit };
        }
    }

    /// Takes note of what moving solids came to: of their substeps, where they took more than all else.
    pub fn count_solids(&mut self) {
        let solids = &self.tally.solids;
        self.limit_on_grid = self.smallest.cause;
        self.rollbacks += solids.rollbacks;
        if solids.substeps > u64::from(self.substeps) {
            self.substeps = u32::try_from(solids.substeps).unwrap_or(u32::MAX);
            self.last_dt = self.length / solids.substeps as f64;
        }
        if solids.limit.dt < self.smallest.dt {
            self.smallest = solids.limit;
        }
    }

    /// Whether a failing substep is not halved again: it was often, or no smaller one is tried. Without the latter halves and
    /// successes could take turns until a frame is no longer in sight.
    pub fn is_last_try(&self) -> bool {
        self.retry.failures >= RETRIES || self.retry.cap.dt <= self.smallest_dt
    }

    /// Goes back to where so many substeps were taken, and so much was left [s].
    pub fn roll_back(&mut self, substeps: u32, remaining: f64) {
        self.rollbacks += 1;
        self.substeps = substeps;
        self.remaining = remaining;
    }

    /// Substeps accepted so far.
    pub fn substeps(&self) -> u32 {
        self.substeps
    }

    /// Takes note that the substep `at` failed for a `cause`: half of it is tried next, and none below the smallest.
    pub fn halve(&mut self, at: &Schedule, cause: DtLimit, object: Option<usize>) {
        self.retry.cap = Limit {
            dt: (0.5 * at.dt).max(self.smallest_dt),
            cause,
            object,
        };
        self.retry.failures += 1;
    }
}
