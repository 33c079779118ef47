//! Where frames and their scenes come from: a session that comes, is started anew, and ends.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cosplat_ipc::Client;
use cosplat_ipc::client::{
    ConnectError, Frame, FrameReader, Participant, ReadError, SceneReader, SceneView, SendError,
    StatusReader, StepError, Until,
};
use cosplat_ipc::schema::{FRAME_FLAG_LAST, SERVER_STOPPING};

use crate::client::{Options, RenderError};

/// How long one wait lasts before the stop flag is looked at [s].
pub(crate) const GLANCE: Duration = Duration::from_millis(100);

/// A frame, and what is known of it.
pub(crate) struct Next {
    pub frame: Frame,
    /// Whether no frame of this run of the server was drawn before.
    pub is_new_run: bool,
}

/// An attached session.
pub(crate) struct Source<'a> {
    options: &'a Options,
    /// Its part in lock-step, if it has one.
    participant: Option<Participant>,
    client: Client,
    pub frames: FrameReader,
    status: StatusReader,
    scenes: SceneReader,
    scene: Option<SceneView>,
    /// The newest frame while its scene has not come.
    waiting: Option<Next>,
    /// Of the newest frame.
    epoch: u64,
    /// Frames that were given up for newer ones before their scene came.
    given_up: u64,
    attached: Instant,
}

impl<'a> Source<'a> {
    /// Waits for the server; `None` when stopped before it came. Up to `depth` frames wait to be taken, the newest ones.
    pub fn attach(
        options: &'a Options,
        depth: usize,
        stop: &AtomicBool,
    ) -> Result<Option<Self>, RenderError> {
        let deadline = Instant::now() + options.patience;
        loop {
            let attempt = Client::connect(&options.domain, &options.session, "view", GLANCE);
            let error = match attempt.and_then(|client| Self::open(options, depth, client)) {
                Ok(mut source) => {
                    if let Some(name) = &options.participant {
                        let part = source.client.participate(name, options.patience)?;
                        source.participant = Some(part);
                    }
                    return Ok(Some(source));
                }
                Err(error) if error.may_pass() => error,
                Err(error) => return Err(error.into()),
            };
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            if Instant::now() >= deadline {
                return Err(error.into());
            }
            std::thread::sleep(GLANCE / 10);
        }
    }

    fn open(options: &'a Options, depth: usize, client: Client) -> Result<Self, ConnectError> {
        Ok(Self {
            options,
            frames: client.frames(depth)?,
            participant: None,
            status: client.status()?,
            client,
            scenes: SceneReader::default(),
            scene: None,
            waiting: None,
            epoch: 0,
            given_up: 0,
            attached: Instant::now(),
        })
    }

    /// As a participant, permits a step and waits until it is made, or `stop`; false when none follows. The newest frame
    /// is then the one of that step.
    pub fn permit_step(&mut self, stop: &AtomicBool) -> Result<bool, RenderError> {
        let Some(participant) = &mut self.participant else {
            return Ok(true);
        };
        while !stop.load(Ordering::Relaxed) {
            let until = Until::default().timeout(GLANCE);
            match participant.step_until(1, &[], until) {
                Ok(stepped) if stepped.is_last() => return Ok(false),
                Ok(stepped) if stepped.done.frames > 0 => return Ok(true),
                Ok(_) => {}
                // A session that ended without a word, or before it heard of the request.
                Err(StepError::Send(
                    SendError::ServerEnded { .. } | SendError::NoServer { .. },
                )) => {
                    return Ok(false);
                }
                // What a server lets go of unanswered is lost, unless it ends.
                Err(StepError::Send(SendError::AnswerLost { .. }))
                    if self
                        .status
                        .newest()?
                        .is_some_and(|status| status.server_state == SERVER_STOPPING) =>
                {
                    return Ok(false);
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(false)
    }

    /// The next frame, or the one that waits for its scene; `None` when there is none within `patience`.
    pub fn next(&mut self, patience: Duration) -> Result<Option<Next>, RenderError> {
        let patience = match self.waiting {
            Some(_) => Duration::ZERO,
            None => patience,
        };
        let frame = match self.frames.next(patience) {
            Ok(Some(frame)) => frame,
            Ok(None) => return Ok(self.waiting.take()),
            Err(error @ ReadError::Malformed { .. }) => {
                tracing::warn!(%error, "frame left out");
                return Ok(None);
            }
            Err(error) => return Err(error.into()),
        };
        let mut is_new_run = frame.is_new_run();
        if let Some(former) = self.waiting.take() {
            self.given_up += 1;
            is_new_run |= former.is_new_run;
        }
        self.epoch = frame.header().epoch;
        Ok(Some(Next { frame, is_new_run }))
    }

    /// A frame and the scene that it belongs to; `None` when that has not come yet, and the frame waits for it.
    ///
    /// # Errors
    /// When the scene does not come in time, or will not come any more.
    pub fn with_scene(&mut self, next: Next) -> Result<Option<(Next, &SceneView)>, RenderError> {
        let header = *next.frame.header();
        if self.scene.as_ref().map(|scene| scene.header().epoch) != Some(header.epoch) {
            // Not two at a time: the server keeps room for few.
            self.scene = None;
            match self.scenes.of(&self.client, header.epoch, GLANCE) {
                Ok(Some(scene)) => self.scene = Some(scene),
                // A leftover of a server that was replaced.
                Ok(None) => self.given_up += 1,
                Err(error @ ConnectError::Timeout { seconds, .. }) => {
                    let is_last = header.flags & FRAME_FLAG_LAST != 0;
                    let has_gone = is_last && !self.status.is_server_alive()?;
                    if has_gone || self.status.has_ended(header.epoch)? {
                        return Err(RenderError::Ended {
                            session: self.options.session.clone(),
                            reason: error.to_string(),
                        });
                    }
                    if seconds >= self.options.patience.as_secs_f64() {
                        return Err(error.into());
                    }
                    self.waiting = Some(next);
                    return Ok(None);
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(self.scene.as_ref().map(|scene| (next, scene)))
    }

    /// Whether the session is over though no frame said that it is the last one: that was lost when its memory was in use.
    ///
    /// # Errors
    /// When no frame at all came in time.
    pub fn is_over(&mut self) -> Result<bool, RenderError> {
        if self.frames.runs() == 0 && self.attached.elapsed() >= self.options.patience {
            return Err(RenderError::Connect(ConnectError::Timeout {
                session: self.options.session.clone(),
                what: "its first frame",
                seconds: self.options.patience.as_secs_f64(),
            }));
        }
        Ok(self.status.has_ended(self.epoch)?)
    }

    /// Frames published since attaching and not drawn, because a newer one was there.
    pub fn missed(&self) -> u64 {
        self.frames.missed() + self.given_up
    }
}
