//! One run of a recording, played step by step from any of its steps on.

use std::collections::VecDeque;

use cosplat_ipc::schema::{AppliedCommand, ObjectState, ObjectsHeader};

use crate::RecordingError;
use crate::chunks::Chunks;
use crate::reader::{Event, RecordedFrame};

/// One recorded step.
#[derive(Clone, Debug)]
pub struct TapeStep {
    /// Its frame.
    pub frame: Box<RecordedFrame>,
    /// Its objects, where they are recorded.
    pub objects: Option<(ObjectsHeader, Vec<ObjectState>)>,
    /// Commands that took effect since the step before.
    pub journal: Vec<AppliedCommand>,
}

/// Where a frame is.
#[derive(Clone, Copy, Debug)]
struct Place {
    step: u64,
    /// The chunk in which what belongs to the step begins, or to the whole frame that it builds on.
    chunk: usize,
}

/// The steps of one run.
pub struct Tape {
    chunks: Chunks,
    epoch: u64,
    /// In the order of steps.
    places: Vec<Place>,
    /// Which of them comes next.
    next: usize,
    /// What was read and not used yet.
    queue: VecDeque<Event>,
    /// The chunk to be read next.
    chunk: usize,
}

impl Tape {
    /// Finds the steps of the run with this `epoch`; `progress` is told how many chunks of how many were looked through.
    ///
    /// # Errors
    /// When a chunk cannot be read or is damaged.
    pub fn open(
        mut chunks: Chunks,
        epoch: u64,
        mut progress: impl FnMut(usize, usize),
    ) -> Result<Self, RecordingError> {
        let mut places: Vec<Place> = Vec::new();
        let mut begin = None;
        let mut whole = None;
        for chunk in 0..chunks.count() {
            progress(chunk, chunks.count());
            for event in chunks.headers(chunk)? {
                begin.get_or_insert(chunk);
                let Event::Frame(frame) = event else { continue };
                let step = frame.header.step;
                // The last frame of a session may come twice.
                let is_new = places.last().is_none_or(|last| step > last.step);
                let first = begin.take().unwrap_or(chunk);
                if frame.is_whole || whole.is_none() {
                    whole = Some(first);
                }
                if frame.header.epoch == epoch && is_new {
                    let chunk = whole.unwrap_or(first);
                    places.push(Place { step, chunk });
                }
            }
        }
        Ok(Self {
            chunks,
            epoch,
            places,
            next: 0,
            queue: VecDeque::new(),
            chunk: 0,
        })
    }

    /// How many steps there are.
    pub fn count(&self) -> usize {
        self.places.len()
    }

    /// First and last step.
    pub fn range(&self) -> Option<[u64; 2]> {
        let (first, last) = (self.places.first()?, self.places.last()?);
        Some([first.step, last.step])
    }

    /// The step that comes next; `None` at the end.
    pub fn next_step(&self) -> Option<u64> {
        self.places.get(self.next).map(|place| place.step)
    }

    /// Goes to `step`, or to the first one behind it that is recorded, and returns that; `None`, and nothing changes, when
    /// there is none.
    pub fn seek(&mut self, step: u64) -> Option<u64> {
        let next = self.places.partition_point(|place| place.step < step);
        let place = self.places.get(next)?;
        (self.next, self.chunk) = (next, place.chunk);
        self.queue.clear();
        Some(place.step)
    }

    /// The next step; `None` at the end.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn advance(&mut self) -> Result<Option<TapeStep>, RecordingError> {
        let Some(place) = self.places.get(self.next).copied() else {
            return Ok(None);
        };
        // What is left of the steps before a seek does not count.
        let before = self.next.checked_sub(1).map(|last| self.places[last].step);
        let is_new = |step: u64| before.is_none_or(|before| step > before);
        let (mut objects, mut journal) = (None, Vec::new());
        let mut found = None;
        let ours = self.epoch;
        let is_ours = |epoch: u64, step: u64| epoch == ours && step == place.step;
        while let Some(event) = self.event()? {
            match event {
                Event::Frame(frame) if is_ours(frame.header.epoch, frame.header.step) => {
                    found = Some(frame);
                    break;
                }
                Event::Objects(header, states) if is_ours(header.epoch, header.step) => {
                    objects = Some((header, states));
                }
                Event::Journal(entry) if entry.epoch.is_none_or(|epoch| epoch == self.epoch) => {
                    let step = entry.applied.step;
                    if is_new(step) && step <= place.step {
                        journal.push(entry.applied);
                    }
                }
                _ => {}
            }
        }
        let Some(frame) = found else {
            return Ok(None);
        };
        self.next += 1;
        // Objects may come behind the frame.
        let is_frame = |event: &Event| matches!(event, Event::Frame(_));
        let rest = self.queue.iter().take_while(|event| !is_frame(event));
        for event in rest {
            if let Event::Objects(header, states) = event
                && is_ours(header.epoch, header.step)
            {
                objects = Some((*header, states.clone()));
            }
        }
        Ok(Some(TapeStep {
            frame,
            objects,
            journal,
        }))
    }

    /// The next message of the file.
    fn event(&mut self) -> Result<Option<Event>, RecordingError> {
        while self.queue.is_empty() && self.chunk < self.chunks.count() {
            self.queue.extend(self.chunks.read(self.chunk)?.sound()?);
            self.chunk += 1;
        }
        Ok(self.queue.pop_front())
    }
}
