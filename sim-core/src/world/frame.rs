//! The substeps of a frame: segments of fused substeps, guarded, rolled back and retried.

use std::time::Instant;

use super::{
    State, World,
    pace::Pace,
    time_step::{Limit, MAX_TRAVEL},
};
use crate::{
    bodies::{body::Body, engine::Remembered, near::Fields},
    contact::{self, Episodes},
    particles::{Extremes, Flags, Motion, NO_PARTICLE, Run},
    report::{DtLimit, StepReport, Timings, Work},
    simd::LANES,
    step::{particle_pass::Stage, shapes::limit_shapes, sort::sort},
};

/// Largest distance out of its block at which a particle may still be scattered [cells]: the drift margin of the tiles,
/// less the round-off of positions.
const MARGIN: f64 = 0.999;
/// Drift beyond which a new segment sorts first [cells].
const SORT_DRIFT: f64 = 0.5;
/// Substeps of a segment at most: the work that a rollback may repeat.
pub(super) const SEGMENT: usize = 32;
/// Times that a failing substep is halved before its bad particles are quarantined.
const RETRIES: u32 = 6;

/// What happens during one frame.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    /// Its length [s].
    pub length: f64,
    /// Wall time per phase.
    pub timings: Timings,
    /// What is left of it [s].
    remaining: f64,
    /// Substeps that a rolled-back segment had accepted: to be taken again.
    replay: Vec<f64>,
    /// Largest substep after failures, and why.
    cap: Limit,
    /// Failures of the substep at hand.
    failures: u32,
    substeps: u32,
    rollbacks: u32,
    /// Steps of particles.
    pub updates: u64,
    /// Work of contact on the grid.
    pub contact_work: contact::Work,
    /// Particles that sleep through it.
    pub asleep: usize,
    /// Per object how long forces acted on its particles in it [s]: from the moment of their velocities before it to that
    /// after it.
    pub kicked: Vec<f64>,
    /// Kinetic energy that objects lost by being modelled with less [J].
    pub fidelity_loss: f64,
    /// Work done.
    pub work: Work,
    last_dt: f64,
    smallest: Limit,
    quarantined: Vec<u32>,
    left_domain: Vec<u32>,
    /// Whether it was undone because a particle would have left the domain.
    stopped: bool,
    /// Who is slow in the segment at hand.
    pub pace: Pace,
    /// Whether a segment of slow objects failed: no other is begun.
    alike: bool,
}

/// A substep.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    /// Its size [s].
    pub dt: f64,
    /// That of slow objects, which may have begun earlier.
    pub span: f64,
    /// What limits it.
    limit: Limit,
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
            timings: Timings::default(),
            remaining: length,
            replay: vec![],
            cap: Limit::FRAME,
            failures: 0,
            substeps: 0,
            rollbacks: 0,
            updates: 0,
            contact_work: contact::Work::default(),
            asleep: 0,
            kicked: vec![],
            fidelity_loss: 0.0,
            work: Work::default(),
            last_dt: 0.0,
            smallest: Limit::FRAME,
            quarantined: vec![],
            left_domain: vec![],
            stopped: false,
            pace: Pace::common(),
            alike: false,
        }
    }

    /// Whether objects may take substeps of their own: nothing failed.
    pub fn may_differ(&self) -> bool {
        !self.alike && self.replay.is_empty() && self.cap == Limit::FRAME
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
            timings: self.timings,
            rollbacks: self.rollbacks,
            updates: self.updates,
            work: self.work,
            stopped: true,
            ..Self::new(0.0)
        };
    }

    /// Whether particles left the domain.
    pub fn lost_particles(&self) -> bool {
        !self.left_domain.is_empty()
    }

    /// What is left of it [s].
    pub fn remaining(&self) -> f64 {
        self.remaining
    }

    /// Whether it was undone.
    pub fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// The frame's share of a report.
    pub fn report(&self, state: &State) -> StepReport {
        let smallest = self.smallest.dt.min(self.last_dt);
        StepReport {
            step: state.steps,
            sim_time: state.sim_time,
            dt: self.last_dt,
            dt_min: smallest,
            dt_limit: self.smallest.cause,
            dt_object: self.smallest.object,
            substeps: self.substeps,
            rollbacks: self.rollbacks,
            particle_updates: self.updates,
            fidelity_loss: self.fidelity_loss,
            left_domain: self.left_domain.clone(),
            stopped: self.stopped,
            quarantined: self.quarantined.clone(),
            timings: self.timings,
            work: Work {
                contact_nodes: self.contact_work.nodes,
                contact_particles: self.contact_work.particles,
                ..self.work
            },
            ..StepReport::default()
        }
    }

    fn accept(&mut self, dt: f64, limit: Limit) {
        self.remaining -= dt;
        self.substeps += 1;
        self.last_dt = dt;
        self.failures = 0;
        if dt < self.smallest.dt {
            self.smallest = Limit { dt, ..limit };
        }
    }
}

/// What a rollback returns to, besides the groups in the workspace.
struct Checkpoint {
    bodies: Vec<Option<Body>>,
    pressing: Vec<Remembered>,
    remaining: f64,
    substeps: u32,
    drift: f64,
    lag: f64,
    lags: Vec<f64>,
    carrier: [f64; 3],
    grid_speed: f64,
    extremes: Vec<Extremes>,
    episodes: Episodes,
}

impl World {
    /// Advances the particles by one frame.
    pub(super) fn advance(&mut self, frame: &mut Frame) {
        #[cfg(test)]
        self.workspace.substeps.clear();
        if frame.remaining == 0.0 {
            return;
        }
        self.workspace.prescribed = self.rules.speeds(&self.published.cells, frame.length);
        self.recentre();
        if self.state.particles.groups.is_empty() {
            self.state.lag = 0.0;
        }
        self.keep_up();
        let lags = self.state.lags.clone();
        while frame.remaining > 0.0 {
            if !self.state.particles.groups.is_empty() {
                self.meet_as_spheres(frame);
                self.segment(frame);
            } else if self.has_bodies() {
                self.bodies_alone(frame);
            } else {
                break;
            }
        }
        let now = lags.iter().zip(&self.state.lags);
        frame.kicked = now
            .map(|(before, now)| frame.length + before - now)
            .collect();
        self.keep_up();
        self.take_out_bodies(frame);
        let laws = self.laws(0.0);
        limit_shapes(self.isa, &mut self.state.particles, &laws, frame.length);
    }

    /// What is left of a frame in which there are bodies and nothing else.
    fn bodies_alone(&mut self, frame: &mut Frame) {
        let start = Instant::now();
        let dt = frame.remaining;
        let substep = self.substep(frame, dt);
        self.move_bodies(&substep, Fields::default());
        frame.accept(dt, Limit::FRAME);
        frame.timings.bodies += start.elapsed().as_secs_f64();
    }

    /// Takes substeps until velocities must be written out: the frame ends, particles drifted too far from
    /// their blocks, or enough work has piled up. After a failure the state is that of the segment's start.
    fn segment(&mut self, frame: &mut Frame) {
        if self.state.drift > SORT_DRIFT {
            self.sort(frame);
        }
        let checkpoint = Checkpoint {
            bodies: self.bodies(),
            pressing: self.state.pressing.clone(),
            remaining: frame.remaining,
            substeps: frame.substeps,
            drift: self.state.drift,
            lag: self.state.lag,
            lags: self.state.lags.clone(),
            carrier: self.state.carrier,
            grid_speed: self.state.grid_speed,
            extremes: self.state.extremes.clone(),
            episodes: self.state.episodes.clone(),
        };
        frame.pace = self.pace(frame);
        frame.pace.begin(frame.remaining);
        let replay = std::mem::take(&mut frame.replay);
        let mut taken: Vec<f64> = Vec::new();
        let mut step = self.choose(frame, replay.first());
        if self.particles(frame, Stage::Scatter, &step, &step).bad {
            // Such motion is absurd for any substep: no retry can help.
            self.quarantine(frame);
            return;
        }
        let every = frame.pace.every as usize;
        loop {
            let speed = self.nodes(frame, &step);
            let Step { dt, limit, .. } = step;
            let travel = dt * speed;
            // Slow objects go all of their way at the end of it, and the others twice until they are here again.
            let (ends_slow, farther) = (frame.pace.is_last(), self.state.drift + travel);
            let farthest = farther + travel * (2 * every - 2) as f64;
            let next = self.after(frame, &step, replay.get(taken.len() + 1));
            let replayed = !replay.is_empty() && taken.len() + 1 == replay.len();
            let is_full = taken.len() + 1 + every > SEGMENT;
            let ends =
                ends_slow && (replayed || is_full || dt >= frame.remaining || farthest > MARGIN);
            let stage = if ends { Stage::Gather } else { Stage::Fused };
            let in_bounds =
                travel * (every as f64) < MAX_TRAVEL && (ends_slow || farther <= MARGIN);
            let out_of_retries = taken.is_empty() && frame.failures >= RETRIES;
            let bad = !in_bounds && !out_of_retries || {
                let findings = self.particles(frame, stage, &step, &next);
                findings.bad || !in_bounds
            };
            if bad && every > 1 {
                // All alike first: where that fails as well it is known what to blame.
                self.roll_back(frame, &checkpoint);
                frame.alike = true;
                return;
            }
            if bad {
                self.roll_back(frame, &checkpoint);
                frame.cap = Limit {
                    dt: 0.5 * dt,
                    cause: if in_bounds {
                        DtLimit::Deformation
                    } else {
                        DtLimit::Velocity
                    },
                    object: self.first_flagged_object(),
                };
                frame.failures += 1;
                if out_of_retries {
                    self.quarantine(frame);
                    frame.cap = Limit::FRAME;
                    frame.failures = 0;
                }
                frame.replay = taken;
                return;
            }
            frame.accept(dt, limit);
            self.fall_behind(&frame.pace, &step);
            taken.push(dt);
            self.collect_extremes();
            if ends {
                break;
            }
            match ends_slow {
                true => frame.pace.begin(frame.remaining),
                false => frame.pace.go_on(),
            }
            step = next;
        }
        let elapsed = taken.iter().sum();
        #[cfg(test)]
        self.workspace.substeps.extend(taken);
        std::mem::swap(&mut self.state.particles.motion, &mut self.workspace.motion);
        self.cohere(frame, elapsed);
        self.share_volume(frame);
        if self.state.particles.flags.iter().any(|f| f.outside != 0) {
            let left = self.take_out(|flags| flags.outside);
            frame.left_domain.extend(left);
        }
    }

    /// The substep after this one.
    fn after(&self, frame: &mut Frame, step: &Step, replayed: Option<&f64>) -> Step {
        let (remaining, pace) = (frame.remaining, frame.pace.clone());
        frame.remaining -= step.dt;
        let next = if pace.is_last() {
            frame.pace.begin(frame.remaining);
            self.choose(frame, replayed)
        } else {
            frame.pace.go_on();
            Step {
                dt: frame.pace.share(step.span, frame.remaining),
                ..*step
            }
        };
        (frame.remaining, frame.pace) = (remaining, pace);
        next
    }

    /// Size of the coming substep, of slow objects where some are: equal shares of what is left of the frame, rounded to the
    /// precision of the kernels so that the shares add up to the frame.
    fn choose(&self, frame: &Frame, replayed: Option<&f64>) -> Step {
        let mut limit = self.time_step(&frame.pace);
        if frame.cap.dt < limit.dt {
            limit = frame.cap;
        }
        let of = |span: f64, limit: Limit| Step {
            dt: frame.pace.share(span, frame.remaining),
            span,
            limit,
        };
        if let Some(&dt) = replayed {
            return of(dt, limit);
        }
        let smallest = self.smallest_dt(frame.length);
        let largest = limit.dt.max(smallest.min(frame.cap.dt)) * f64::from(frame.pace.every);
        // A share may exceed the limit by rounding: better than one substep more.
        let shares = (frame.remaining / largest - 1e-6).ceil().max(1.0);
        if shares <= 1.0 {
            return of(frame.remaining, Limit::FRAME);
        }
        of(f64::from((frame.remaining / shares) as f32), limit)
    }

    /// Restores the state at the start of the segment.
    fn roll_back(&mut self, frame: &mut Frame, to: &Checkpoint) {
        frame.rollbacks += 1;
        frame.substeps = to.substeps;
        frame.remaining = to.remaining;
        self.state.drift = to.drift;
        self.state.lag = to.lag;
        self.state.lags.clone_from(&to.lags);
        self.state.carrier = to.carrier;
        self.state.grid_speed = to.grid_speed;
        self.state.extremes.clone_from(&to.extremes);
        self.state.episodes.clone_from(&to.episodes);
        for (rigid, body) in self.state.rigid.iter_mut().zip(&to.bodies) {
            if let (Some(rigid), Some(body)) = (rigid, body) {
                rigid.body = *body;
            }
        }
        self.state.pressing.clone_from(&to.pressing);
        self.workspace.backup.restore(&mut self.state.particles);
    }

    fn sort(&mut self, frame: &mut Frame) {
        let start = Instant::now();
        self.rearrange();
        frame.timings.sort += start.elapsed().as_secs_f64();
    }

    /// Sorts the particles and builds the grid around them.
    pub(super) fn rearrange(&mut self) {
        let State {
            particles, shaped, ..
        } = &mut self.state;
        sort(particles, shaped, &mut self.workspace.sorted);
        std::mem::swap(particles, &mut self.workspace.sorted);
        self.fit_workspace();
        self.state.drift = 0.0;
    }

    /// Scratch memory and grid for the particles as they are arranged.
    pub(super) fn fit_workspace(&mut self) {
        let fixed = self.boundaries.fixed_on_nodes(&self.state.paths);
        let particles = &self.state.particles;
        self.workspace.backup.fit(particles);
        let count = particles.groups.len();
        self.workspace.motion.resize(count, Motion::REST);
        self.workspace.grid.rebuild(&particles.blocks, &fixed);
        self.survey();
    }

    /// Freezes the particles flagged as bad where they are.
    fn quarantine(&mut self, frame: &mut Frame) {
        if self.state.particles.flags.iter().all(|f| f.bad == 0) {
            self.flag_fastest_run();
        }
        let bad = self.take_out(|flags| flags.bad);
        frame.quarantined.extend(bad);
    }

    /// Object of the first particle flagged as bad.
    fn first_flagged_object(&self) -> Option<usize> {
        let particles = &self.state.particles;
        let flagged = |run: &&Run| {
            let flags = &particles.flags[run.groups.clone()];
            flags.iter().any(|f| f.bad != 0)
        };
        let run = particles.runs.iter().find(flagged)?;
        Some(self.parts[run.part].object)
    }

    /// Blames the run with the largest speed: the way out when the grid fails and no particle shows why.
    fn flag_fastest_run(&mut self) {
        let particles = &mut self.state.particles;
        let speed = |run: &Run| run.extremes.speed_squared;
        let fastest = particles
            .runs
            .iter()
            .max_by(|a, b| speed(a).total_cmp(&speed(b)));
        if let Some(run) = fastest {
            for flags in &mut particles.flags[run.groups.clone()] {
                flags.bad = u16::MAX;
            }
        }
    }

    /// Takes flagged particles out of the simulation; returns their ids in ascending order.
    pub(super) fn take_out(&mut self, which: fn(&Flags) -> u16) -> Vec<u32> {
        let particles = &mut self.state.particles;
        // Their last state is what is displayed from now on; flagged lanes hold it, or what led to it.
        self.published
            .update(particles, self.state.carrier, self.scene.dx);
        let mut ids = Vec::new();
        for group in 0..particles.groups.len() {
            let lanes = which(&particles.flags[group]);
            particles.flags[group] = Flags::default();
            for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
                let id = particles.fixed[group].id[lane];
                if id != NO_PARTICLE {
                    ids.push(id);
                    particles.remove(group, lane);
                    self.state.live -= 1;
                }
            }
        }
        ids.sort_unstable();
        for &id in &ids {
            self.published.freeze(id);
        }
        self.state.removed.extend(&ids);
        ids
    }
}
