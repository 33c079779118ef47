//! Segments of substeps: the loop round the substep, with rollback and retry.

use super::{World, frame::Frame};
use crate::{
    bodies::{body::Body, warm_start::CachedImpulse},
    colliders::Substep,
    coupling::near::Watch,
    interruption::Interruption,
    kinematics::kick,
    ledger::Ledger,
    particles::Extremes,
    state::{GridMotion, in_contact::InContact},
    step::{shapes::limit_shapes, volume::correct_fluid_volume},
    substep::{Failure, Limit, OffGrid, Schedule, Segment, move_bodies, smallest_dt, substep},
    timed,
};

/// Drift beyond which a new segment sorts first [cells].
const SORT_DRIFT: f64 = 0.5;

/// What a rollback returns to, besides the particles and solids in the workspace.
struct Start {
    bodies: Vec<Option<Body>>,
    warm_start: Vec<CachedImpulse>,
    ledger: Ledger,
    remaining: f64,
    substeps: u32,
    drift: f64,
    motion: GridMotion,
    extremes: Vec<Extremes>,
    in_contact: InContact,
}

impl World {
    /// Advances by one frame, segment after segment; one that is interrupted is left where it is.
    pub(super) fn advance(&mut self, frame: &mut Frame, interruption: &Interruption<'_>) {
        self.workspace.substeps.clear();
        if frame.remaining == 0.0 {
            return;
        }
        frame.smallest_dt = smallest_dt(&self.given(), frame.length);
        let cells = &self.published.cells;
        self.workspace.prescribed = self.model.rules.speeds(cells, frame.length);
        self.recentre();
        if self.state.matter.particles.groups.is_empty() {
            self.state.motion.velocity_offset = 0.0;
        }
        let offset = self.state.motion.velocity_offset;
        let solids: Vec<bool> = self.state.solids.iter().map(Option::is_some).collect();
        while frame.remaining > 0.0 {
            if !self.state.matter.particles.groups.is_empty() {
                self.meet_as_spheres(frame);
                self.segment(frame, interruption);
            } else if self.state.bodies.any() || self.has_solids() {
                self.off_grid_alone(frame, interruption);
            } else {
                break;
            }
            if interruption.was_due() || frame.remaining > 0.0 && interruption.is_due() {
                return;
            }
        }
        frame.kicked = frame.length + offset - self.state.motion.velocity_offset;
        self.take_out_bodies(frame);
        self.cohere_solids(frame.length);
        self.take_out_solids(&solids, frame);
        frame.count_solids();
        let laws = &self.model.constants.laws;
        let particles = &mut self.state.matter.particles;
        limit_shapes(self.model.isa, particles, laws, frame.length);
    }

    /// What is left of a frame in which nothing is on the grid: rigid bodies and solids.
    fn off_grid_alone(&mut self, frame: &mut Frame, interruption: &Interruption<'_>) {
        let dt = frame.remaining;
        let now = self.next_substep(frame, dt);
        let (given, moving) = self.state.split(&self.model, interruption);
        let (matter, motion) = (moving.matter, moving.motion);
        let off_grid = OffGrid {
            episodes: &mut moving.in_contact.of_solids,
            bodies: moving.bodies,
            solids: moving.solids,
        };
        let (workspace, tally) = (&mut self.workspace, &mut frame.tally);
        move_bodies(&given, &now, matter, motion, off_grid, workspace, tally);
        frame.accept(dt, Limit::FRAME);
    }

    /// The substep of this size [s] that comes next in a frame.
    pub(super) fn next_substep(&self, frame: &Frame, dt: f64) -> Substep {
        let start = self.state.progress.sim_time;
        let offset = self.state.motion.velocity_offset;
        Substep {
            time: start + (frame.length - frame.remaining),
            dt,
            kick: kick(offset, dt, self.model.scene.cfl)[0],
            frame_start: start,
            frame_length: frame.length,
        }
    }

    /// Takes substeps until velocities must be written out: the frame ends, particles drifted too far from
    /// their blocks, or enough work has piled up. After a failure the state is that of the segment's start.
    fn segment(&mut self, frame: &mut Frame, interruption: &Interruption<'_>) {
        if self.state.matter.drift > SORT_DRIFT {
            self.sort(frame);
        }
        let start = self.start(frame);
        self.workspace.watches.iter_mut().for_each(Watch::restart);
        let mut segment = frame.begin_segment();
        let matter = &self.state.matter;
        let mut at = segment.first(&self.given(), matter, &self.state.motion, frame.remaining);
        loop {
            let (state, workspace) = (&mut self.state, &mut self.workspace);
            let taken = substep(
                &self.model,
                &segment,
                &at,
                (state, interruption),
                workspace,
                &mut frame.tally,
            );
            let next = match taken {
                Ok(next) => next,
                Err(failure) => return self.retry(frame, segment, &at, failure, &start),
            };
            frame.accept(at.dt, at.limit);
            segment.taken.push(at.dt);
            match next {
                Some(next) => at = next,
                None => break,
            }
            if interruption.is_due() {
                return;
            }
        }
        self.end_segment(frame, &segment);
    }

    /// Undoes a segment whose substep `at` failed, and says how it is tried again.
    fn retry(
        &mut self,
        frame: &mut Frame,
        segment: Segment,
        at: &Schedule,
        failure: Failure,
        start: &Start,
    ) {
        if failure == Failure::Absurd {
            // No retry can help.
            self.quarantine(frame);
            return;
        }
        self.roll_back(frame, start);
        frame.halve(at, failure.cause(), self.first_flagged_object());
        if segment.is_last_try() {
            self.quarantine(frame);
            frame.retry.cap = Limit::FRAME;
            frame.retry.failures = 0;
        }
        frame.retry.replay = segment.taken;
    }

    /// Writes velocities out, and does what is done between segments.
    fn end_segment(&mut self, frame: &mut Frame, segment: &Segment) {
        let elapsed = segment.taken.iter().sum();
        self.workspace.substeps.extend(&segment.taken);
        let particles = &mut self.state.matter.particles;
        std::mem::swap(&mut particles.motion, &mut self.workspace.motion);
        self.cohere(frame, elapsed);
        self.correct_fluid_volume(frame);
        let flags = &self.state.matter.particles.flags;
        if flags.iter().any(|f| f.outside != 0) {
            let left = self.take_out(|flags| flags.outside);
            frame.left_domain.extend(left);
        }
    }

    /// Lets the volume ratio of fluids give way to what the grid holds.
    fn correct_fluid_volume(&mut self, frame: &mut Frame) {
        timed(&mut frame.tally.timings.particles, || {
            correct_fluid_volume(
                self.model.isa,
                &self.model.constants.laws,
                &mut self.state.matter.particles,
                &mut self.workspace.grid,
            );
        });
    }

    /// What a rollback returns to.
    fn start(&mut self, frame: &Frame) -> Start {
        let state = &self.state;
        self.workspace.solids_before.clone_from(&state.solids);
        Start {
            bodies: state.bodies.places(),
            warm_start: state.bodies.warm_start.clone(),
            ledger: state.bodies.ledger.clone(),
            remaining: frame.remaining,
            substeps: frame.substeps(),
            drift: state.matter.drift,
            motion: state.motion.clone(),
            extremes: state.matter.extremes.clone(),
            in_contact: state.in_contact.clone(),
        }
    }

    /// Restores the state at the start of the segment.
    fn roll_back(&mut self, frame: &mut Frame, to: &Start) {
        frame.roll_back(to.substeps, to.remaining);
        let state = &mut self.state;
        state.matter.drift = to.drift;
        state.matter.extremes.clone_from(&to.extremes);
        state.motion.clone_from(&to.motion);
        state.in_contact.clone_from(&to.in_contact);
        for (rigid, body) in state.bodies.of.iter_mut().zip(&to.bodies) {
            if let (Some(rigid), Some(body)) = (rigid, body) {
                rigid.body = *body;
            }
        }
        state.solids.clone_from(&self.workspace.solids_before);
        for scratch in self.workspace.solids.iter_mut().flatten() {
            scratch.search.restart();
        }
        self.workspace.at_solids.clear();
        state.bodies.warm_start.clone_from(&to.warm_start);
        state.bodies.ledger.clone_from(&to.ledger);
        self.workspace.backup.restore(&mut state.matter.particles);
    }
}
