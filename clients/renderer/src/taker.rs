//! Takes frames of a session: which of them are drawn, and when, without ever holding the server up.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, TryRecvError};
use std::time::{Duration, Instant};

use cosplat_ipc::client::SceneView;
use cosplat_ipc::schema::{FRAME_FLAG_LAST, GaussianState};

use crate::client::{Options, RenderError};
use crate::courtesy::Courtesy;
use crate::drawing::{Scene, Summary};
use crate::output::{Plan, Wanted};
use crate::painter::{Painted, Shot};
use crate::source::{GLANCE, Next, Source};

/// Copies of frames of chosen steps that wait for their picture, all together [byte].
const BACKLOG: usize = 256 << 20;
/// Copies of other frames: one is drawn, the next one is there when that is done.
const AHEAD: usize = 2;
/// Frames that may wait to be taken where steps are chosen: an eighth of a second at 60 per second.
const DEPTH: usize = 8;

/// How often a frame that waits for its turn is looked at again.
const RETRY: Duration = Duration::from_millis(4);

/// Takes frames and hands copies of them to the painter.
pub(crate) struct Taker<'a> {
    options: &'a Options,
    plan: Plan,
    shots: Sender<Shot>,
    painted: Receiver<Painted>,
    courtesy: Courtesy,
    /// Before that no frame is taken whose step was not chosen.
    not_before: Option<Instant>,
    /// The newest frame, while there is no time for it.
    pending: Option<(Next, Arc<Scene>)>,
    scene: Option<Arc<Scene>>,
    /// Memory of frames that were drawn.
    free: Vec<Vec<GaussianState>>,
    /// Frames handed over, and those of them that came back.
    handed: u64,
    returned: u64,
    /// Frames left out for lack of time.
    left_out: u64,
    seen: Summary,
}

impl<'a> Taker<'a> {
    pub fn new(options: &'a Options, shots: Sender<Shot>, painted: Receiver<Painted>) -> Self {
        Self {
            options,
            plan: Plan::new(&options.look),
            shots,
            painted,
            courtesy: Courtesy::default(),
            not_before: None,
            pending: None,
            scene: None,
            free: Vec::new(),
            handed: 0,
            returned: 0,
            left_out: 0,
            seen: Summary::default(),
        }
    }

    /// Hands frames over until the last one, enough of them, or `stop`; or until the painter gives up, for a reason that it
    /// has itself.
    pub fn watch(&mut self, stop: &AtomicBool) -> Result<(), RenderError> {
        let is_every = self.options.participant.is_none() && self.plan.chooses_steps();
        let depth = if is_every { DEPTH } else { 1 };
        let Some(mut source) = Source::attach(self.options, depth, stop)? else {
            return Ok(());
        };
        let goal = self.options.frames.unwrap_or(u64::MAX);
        while self.handed < goal && !stop.load(Ordering::Relaxed) {
            if !self.take_back() {
                break;
            }
            let patience = match self.pending {
                Some(_) => RETRY,
                None => GLANCE,
            };
            let Some(next) = source.next(patience)? else {
                if !self.take_pending() {
                    break;
                }
                // Of a frame that found no memory there is nothing to draw: the step goes without a picture.
                let is_idle = self.pending.is_none();
                if is_idle && (source.is_over()? || !source.permit_step(stop)?) {
                    break;
                }
                continue;
            };
            let header = *next.frame.header();
            self.courtesy.note(&header);
            let Some((next, scene)) = source.with_scene(next)? else {
                continue;
            };
            let scene = self.copied(scene);
            self.seen.runs = source.frames.runs();
            self.seen.frames_missed = source.missed() + self.left_out;
            if !self.see(next, scene) {
                break;
            }
            let is_last = header.flags & FRAME_FLAG_LAST != 0;
            if is_last || self.handed >= goal || !source.permit_step(stop)? {
                break;
            }
        }
        Ok(())
    }

    /// Lets the painter come to its end, and says what was seen.
    pub fn end(self) -> Summary {
        self.seen
    }

    /// The scene, copied once per run.
    fn copied(&mut self, scene: &SceneView) -> Arc<Scene> {
        let epoch = scene.header().epoch;
        match &self.scene {
            Some(known) if known.header.epoch == epoch => Arc::clone(known),
            _ => {
                let copy = Arc::new(Scene {
                    header: *scene.header(),
                    objects: scene.objects().to_vec(),
                    sh: scene.sh().to_vec(),
                });
                self.scene = Some(Arc::clone(&copy));
                copy
            }
        }
    }

    /// Hands a frame over if it is needed and there is time, else keeps it in mind; false when the painter has given up.
    fn see(&mut self, mut next: Next, scene: Arc<Scene>) -> bool {
        let header = *next.frame.header();
        let is_last = header.flags & FRAME_FLAG_LAST != 0;
        let (step, sim_time) = (header.step, header.sim_time);
        (self.seen.last_step, self.seen.sim_time) = (step, sim_time);
        if let Some((former, _)) = self.pending.take() {
            next.is_new_run |= former.is_new_run;
            self.leave_out();
        }
        let wanted = self.plan.wants(step, sim_time, next.is_new_run, is_last);
        if !wanted.anything() {
            return true;
        }
        if is_last || self.has_time(wanted, size_of_val(next.frame.gaussians())) {
            return self.hand_over(&next, scene, wanted);
        }
        if wanted.is_chosen {
            // Another step is not what was asked for.
            self.plan.pass(step);
            self.seen.pictures_missed += 1;
            self.leave_out();
        } else {
            self.pending = Some((next, scene));
        }
        true
    }

    /// Hands the newest frame over if there is time now; false when the painter has given up.
    fn take_pending(&mut self) -> bool {
        match self.pending.take() {
            Some((next, scene)) => self.see(next, scene),
            None => true,
        }
    }

    fn leave_out(&mut self) {
        self.left_out += 1;
        self.seen.frames_missed += 1;
    }

    /// Hands over a copy of a frame; false when the painter has given up.
    fn hand_over(&mut self, next: &Next, scene: Arc<Scene>, wanted: Wanted) -> bool {
        let header = *next.frame.header();
        self.plan.commit(wanted, header.step);
        let mut copy = self.free.pop().unwrap_or_default();
        copy.clear();
        copy.extend_from_slice(next.frame.gaussians());
        let shot = Shot {
            header,
            gaussians: Arc::new(copy),
            scene,
            wanted,
            frames_missed: self.seen.frames_missed,
            runs: self.seen.runs,
        };
        self.handed += 1;
        let is_handed = self.shots.send(shot).is_ok();
        if self.options.participant.is_none() {
            return is_handed;
        }
        // The step is not permitted before its picture is there.
        let painted = self.painted.recv();
        painted.map(|painted| self.put_away(painted)).is_ok()
    }

    fn has_time(&self, wanted: Wanted, bytes: usize) -> bool {
        let waiting = (self.handed - self.returned) as usize;
        if self.options.participant.is_some() {
            return true;
        }
        if wanted.is_chosen {
            return waiting < AHEAD || waiting * bytes < BACKLOG;
        }
        let ahead = match self.courtesy.is_standing_aside() {
            true => 1,
            false => AHEAD,
        };
        waiting < ahead && self.not_before.is_none_or(|then| Instant::now() >= then)
    }

    /// Takes back what was drawn; false when the painter has given up.
    fn take_back(&mut self) -> bool {
        loop {
            match self.painted.try_recv() {
                Ok(painted) => self.put_away(painted),
                Err(error) => return error == TryRecvError::Empty,
            }
        }
    }

    fn put_away(&mut self, painted: Painted) {
        self.returned += 1;
        self.not_before = Some(Instant::now() + self.courtesy.wait(painted.busy));
        // An idle thread that came too late may still look at it.
        if let Ok(memory) = Arc::try_unwrap(painted.gaussians)
            && self.free.len() < AHEAD
        {
            self.free.push(memory);
        }
    }
}
