//! The thread that reads the session. It reads frames only while some page asks for them: without one the server makes no
//! `changes`, and this process costs nothing.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;
use cosplat_ipc::Client;
use cosplat_ipc::assembly::{Placement, change_gaussians, rows};
use cosplat_ipc::client::{
    ChangesReader, ConnectError, FrameReader, ObjectsReader, ReadError, SceneReader, SceneView,
    StatusReader,
};
use cosplat_ipc::schema::{
    CHANGE_FORM, CHANGE_GAUSSIANS, CHANGE_PLACED, ChangeSlot, ChangesHeader, FrameHeader,
    GaussianState, str_from_padded,
};
use half::f16;
use serde_json::{Value, json};
use tokio::sync::watch;

use crate::latest::Latest;

/// Frames are read as long as the last page that asked for one did so no longer ago.
const INTEREST: Duration = Duration::from_secs(3);
/// How long one wait lasts before the stop flag is looked at.
const GLANCE: Duration = Duration::from_millis(50);
/// How often a dead or absent server is looked for.
const RETRY: Duration = Duration::from_millis(200);

/// What the threads of this process share.
pub struct Shared {
    latest: Mutex<Latest>,
    /// When a page last asked.
    asked: Mutex<Option<Instant>>,
    ask: Condvar,
    news: watch::Sender<u32>,
}

impl Shared {
    /// Nothing yet.
    pub fn new() -> Arc<Shared> {
        Arc::new(Shared {
            latest: Mutex::new(Latest::new()),
            asked: Mutex::new(None),
            ask: Condvar::new(),
            news: watch::Sender::new(0),
        })
    }

    /// The newest state.
    pub fn latest(&self) -> MutexGuard<'_, Latest> {
        // A thread that panicked left it as it was between two records: pages see at most one wrong frame.
        self.latest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A page wants frames; the receiver hears of each change.
    pub fn ask(&self) -> watch::Receiver<u32> {
        *self.asked.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        self.ask.notify_one();
        self.news.subscribe()
    }

    fn is_asked(&self) -> bool {
        let asked = self.asked.lock().unwrap_or_else(PoisonError::into_inner);
        asked.is_some_and(|at| at.elapsed() < INTEREST)
    }

    /// Waits a while for a page that asks.
    fn wait_for_page(&self) {
        let asked = self.asked.lock().unwrap_or_else(PoisonError::into_inner);
        drop(self.ask.wait_timeout(asked, GLANCE));
    }

    fn tell(&self) {
        let version = self.latest().version();
        self.news.send_replace(version);
    }
}

/// The streams of an attached session.
struct Feed<'a> {
    shared: &'a Shared,
    client: Client,
    status: StatusReader,
    objects: ObjectsReader,
    frames: Option<Frames>,
    scenes: SceneReader,
    /// Epoch of the scene that pages have.
    epoch: Option<u64>,
}

/// Where frames come from.
enum Frames {
    Changes(ChangesReader),
    /// Of a server that sends no `changes`, such as a replay: the newest, and the one before it.
    Whole(FrameReader, Vec<GaussianState>),
}

/// What went wrong with a session that may come back.
#[derive(Debug, thiserror::Error)]
enum FeedError {
    #[error("another server has the session")]
    Anew,
    #[error(transparent)]
    Connect(#[from] ConnectError),
    #[error(transparent)]
    Read(#[from] ReadError),
}

/// Reads the session until `stop`: attaches again whenever it fails.
pub fn run(
    shared: &Shared,
    first: Client,
    connect: impl Fn() -> Result<Client, ConnectError>,
    stop: &AtomicBool,
) {
    let mut client = Some(first);
    while !stop.load(Ordering::Relaxed) {
        let attached = client.take().map_or_else(&connect, Ok);
        let opened = attached.map_err(FeedError::from).and_then(|client| {
            let mut feed = Feed::open(shared, client)?;
            while !stop.load(Ordering::Relaxed) {
                feed.turn()?;
            }
            Ok(())
        });
        if let Err(error) = opened {
            tracing::debug!(%error, "attaches again");
            shared.latest().note_status(None, false);
            std::thread::sleep(RETRY);
        }
    }
}

impl<'a> Feed<'a> {
    fn open(shared: &'a Shared, client: Client) -> Result<Self, FeedError> {
        Ok(Feed {
            shared,
            status: client.status()?,
            objects: client.objects(1)?,
            frames: None,
            scenes: SceneReader::default(),
            epoch: None,
            client,
        })
    }

    /// Takes over what comes within a short while.
    fn turn(&mut self) -> Result<(), FeedError> {
        if !self.shared.is_asked() {
            self.frames = None;
            self.shared.wait_for_page();
            return Ok(());
        }
        let status = self.status.newest()?;
        let is_alive = self.status.is_server_alive()?;
        self.shared.latest().note_status(status, is_alive);
        let Some(status) = status else {
            std::thread::sleep(GLANCE);
            return Ok(());
        };
        if status.epoch != self.client.hello().epoch {
            return Err(FeedError::Anew);
        }
        if self.epoch != Some(status.epoch) && !self.take_scene(status.epoch)? {
            return Ok(());
        }
        if self.frames.is_none() {
            self.frames = Some(match status.has_changes {
                0 => Frames::Whole(self.client.frames(1)?, Vec::new()),
                _ => Frames::Changes(self.client.changes(64)?),
            });
        }
        let changed = self.take_frames()?;
        if let Some(message) = self.objects.next(Duration::ZERO)? {
            self.shared.latest().note_objects(message.items());
        }
        if changed {
            self.shared.tell();
        }
        Ok(())
    }

    /// Reads the scene of a run; false while it is not there.
    fn take_scene(&mut self, epoch: u64) -> Result<bool, FeedError> {
        let scene = match self.scenes.of(&self.client, epoch, GLANCE) {
            Ok(Some(scene)) => scene,
            Ok(None) | Err(ConnectError::Timeout { .. }) => return Ok(false),
            Err(error) => return Err(error.into()),
        };
        let ranges: Vec<_> = scene
            .objects()
            .iter()
            .map(|info| (info.id, info.gaussian_first, info.gaussian_count))
            .collect();
        let about = about(&scene, &self.client);
        let harmonics = harmonics(&scene);
        self.shared.latest().begin(about, harmonics, &ranges);
        self.frames = None;
        self.epoch = Some(epoch);
        self.shared.tell();
        Ok(true)
    }

    /// Takes over the next message; whether it changed anything that is seen.
    fn take_frames(&mut self) -> Result<bool, FeedError> {
        let epoch = self.epoch;
        let read = match &mut self.frames {
            None => return Ok(false),
            Some(Frames::Changes(reader)) => reader.next(GLANCE).map(|message| {
                let message = message.filter(|m| Some(m.header().epoch) == epoch)?;
                let mut latest = self.shared.latest();
                Some(take_changes(&mut latest, message.header(), message.items()))
            }),
            Some(Frames::Whole(reader, before)) => reader.next(GLANCE).map(|message| {
                let message = message.filter(|m| Some(m.header().epoch) == epoch)?;
                let mut latest = self.shared.latest();
                let (header, gaussians) = (message.header(), message.gaussians());
                Some(take_whole(&mut latest, header, gaussians, before))
            }),
        };
        match read {
            Ok(changed) => Ok(changed.unwrap_or(false)),
            Err(error @ ReadError::Malformed { .. }) => {
                tracing::warn!(%error, "frame left out");
                Ok(false)
            }
            Err(error) => Err(error.into()),
        }
    }
}

/// Takes over a message of `changes`; whether anything in it is seen.
fn take_changes(latest: &mut Latest, header: &ChangesHeader, slots: &[ChangeSlot]) -> bool {
    latest.advance(header.frame());
    let changes = rows(header, slots);
    if changes.is_empty() {
        return false;
    }
    latest.next_version();
    for change in changes {
        let place = Placement {
            position: change.position,
            rotation: change.rotation,
        };
        let gaussians = change_gaussians(change, slots);
        let taken = match (change.kind, gaussians) {
            (CHANGE_GAUSSIANS, Some(gaussians)) => latest.set(change.object, gaussians, None),
            (CHANGE_FORM, Some(gaussians)) => latest.set(change.object, gaussians, Some(place)),
            (CHANGE_PLACED, _) => latest.place(change.object, place),
            _ => None,
        };
        if taken.is_none() {
            let (object, kind, count) = (change.object, change.kind, change.count);
            tracing::warn!(object, kind, count, "a change fits no object, left out");
        }
    }
    true
}

/// Takes over a whole frame: what of it is not as in the one `before`; whether there is any.
fn take_whole(
    latest: &mut Latest,
    header: &FrameHeader,
    gaussians: &[GaussianState],
    before: &mut Vec<GaussianState>,
) -> bool {
    latest.advance(*header);
    let mut has_changed = false;
    let is_first = before.len() != gaussians.len();
    let mut first = 0;
    for own in gaussians.chunk_by(|a, b| a.object == b.object) {
        let range = first..first + own.len();
        first = range.end;
        let is_same = !is_first
            && bytemuck::cast_slice::<_, u8>(own) == bytemuck::cast_slice::<_, u8>(&before[range]);
        if is_same {
            continue;
        }
        if !has_changed {
            latest.next_version();
            has_changed = true;
        }
        if latest.set(own[0].object, own, None).is_none() {
            let (object, count) = (own[0].object, own.len());
            tracing::warn!(object, count, "Gaussians fit no object, left out");
        }
    }
    if has_changed {
        before.clear();
        before.extend_from_slice(gaussians);
    }
    has_changed
}

/// What pages have to know of a scene.
fn about(scene: &SceneView, client: &Client) -> Value {
    let (header, hello) = (scene.header(), client.hello());
    let objects: Vec<Value> = scene
        .objects()
        .iter()
        .map(|info| {
            json!({
                "id": info.id,
                "name": str_from_padded(&info.name).unwrap_or_default(),
                "material": str_from_padded(&info.material).unwrap_or_default(),
                "law": info.law,
                "youngs_modulus": info.youngs_modulus,
                "poisson_ratio": info.poisson_ratio,
                "density": info.density,
                "fidelity": info.fidelity,
                "particles": info.particle_count,
                "first": info.gaussian_first,
                "count": info.gaussian_count,
            })
        })
        .collect();
    json!({
        "session": client.session(),
        "recorded": (hello.recorded_last > 0).then_some([hello.recorded_first, hello.recorded_last]),
        "gaussians": header.gaussian_count,
        "particles": header.particle_count,
        "frame_rate": header.frame_rate,
        "gravity": header.gravity,
        "low": header.bounds_min,
        "high": header.bounds_max,
        "sh_degree": header.sh_degree,
        "objects": objects,
    })
}

fn harmonics(scene: &SceneView) -> Bytes {
    padded_harmonics(scene.header().sh_degree, scene.sh())
}

/// Spherical harmonics in half precision, `[gaussian][coefficient][rgb]`, each Gaussian padded to whole texels of eight;
/// none for degree 0, whose colours frames have.
pub fn padded_harmonics(degree: u32, sh: &[f32]) -> Bytes {
    if degree == 0 {
        return Bytes::new();
    }
    let own = 3 * (degree as usize + 1).pow(2);
    let mut bytes = Vec::new();
    for values in sh.chunks_exact(own) {
        let padding = std::iter::repeat_n(0.0, own.next_multiple_of(8) - own);
        for value in values.iter().copied().chain(padding) {
            bytes.extend_from_slice(&f16::from_f32(value).to_le_bytes());
        }
    }
    bytes.into()
}
