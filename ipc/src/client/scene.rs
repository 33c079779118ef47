//! The scene, mapped from the server's memory.

use std::{
    fmt::Debug,
    time::{Duration, Instant},
};

use iceoryx2::{node::Node, port::subscriber::Subscriber, prelude::ZeroCopySend, sample::Sample};

use super::{ConnectError, RETRY_PERIOD};
use crate::{
    Service,
    schema::{GaussianRest, ObjectInfo, SceneHeader},
    session::{self, OpenError, SessionName, Stream},
};

type Block<T> = Sample<Service, [T], SceneHeader>;

/// The scene of one epoch, checked against its header. It stays valid when the server goes.
#[derive(Debug)]
pub struct SceneView {
    gaussians: Block<GaussianRest>,
    sh: Block<f32>,
    objects: Block<ObjectInfo>,
    source: Block<u8>,
    features: Option<Block<f32>>,
}

impl SceneView {
    /// The header.
    pub fn header(&self) -> &SceneHeader {
        self.gaussians.user_header()
    }

    /// Gaussians at rest.
    pub fn gaussians(&self) -> &[GaussianRest] {
        self.gaussians.payload()
    }

    /// Spherical harmonics `[gaussian][coefficient][rgb]`, `(sh_degree + 1)^2` coefficients.
    pub fn sh(&self) -> &[f32] {
        self.sh.payload()
    }

    /// Object table.
    pub fn objects(&self) -> &[ObjectInfo] {
        self.objects.payload()
    }

    /// Semantic features `[gaussian][feature_dim]`; empty when there are none.
    pub fn features(&self) -> &[f32] {
        self.features.as_ref().map_or(&[], |block| block.payload())
    }

    /// Text of the scene file; bytes that are not UTF-8 are replaced.
    pub fn source(&self) -> String {
        String::from_utf8_lossy(self.source.payload()).into_owned()
    }

    /// Why the blocks do not fit together.
    fn check(&self) -> Result<(), String> {
        let header = self.header();
        let count = header.gaussian_count as usize;
        if header.sh_degree > 3 {
            return Err(format!(
                "degree {} of the spherical harmonics, expected 0 to 3",
                header.sh_degree
            ));
        }
        let sh = count.saturating_mul((header.sh_degree as usize + 1).pow(2) * 3);
        let features = count.saturating_mul(header.feature_dim as usize);
        let lengths = [
            ("Gaussians", self.gaussians().len(), count),
            ("spherical-harmonics values", self.sh().len(), sh),
            (
                "objects",
                self.objects().len(),
                header.object_count as usize,
            ),
            ("feature values", self.features().len(), features),
        ];
        for (what, actual, expected) in lengths {
            if actual != expected {
                return Err(format!(
                    "the scene holds {actual} {what}, its header announces {expected}"
                ));
            }
        }
        Ok(())
    }
}

/// Waits for every block; they belong together when their headers are equal.
pub(super) fn read(
    node: &Node<Service>,
    session: &SessionName,
    timeout: Duration,
) -> Result<SceneView, ConnectError> {
    let deadline = Instant::now() + timeout;
    let wait = Wait {
        node,
        session,
        timeout,
        deadline,
    };
    loop {
        // Asked for together: the server answers all that it finds in one turn of its monitor.
        let mut gaussians = Asked::new(session::SCENE_GAUSSIANS);
        let mut sh = Asked::new(session::SCENE_SH);
        let mut objects = Asked::new(session::SCENE_OBJECTS);
        let mut source = Asked::new(session::SCENE_SOURCE);
        let (gaussians, sh, objects, source) = loop {
            let here = gaussians.look(&wait)?
                & sh.look(&wait)?
                & objects.look(&wait)?
                & source.look(&wait)?;
            if here
                && let (Some(gaussians), Some(sh)) = (gaussians.newest.take(), sh.newest.take())
                && let (Some(objects), Some(source)) = (objects.newest.take(), source.newest.take())
            {
                break (gaussians, sh, objects, source);
            }
            wait.rest()?;
        };
        let header = *gaussians.user_header();
        let features = match header.feature_dim > 0 {
            true => Some(wait.for_block(session::SCENE_FEATURES)?),
            false => None,
        };
        let view = SceneView {
            gaussians,
            sh,
            objects,
            source,
            features,
        };
        let others = [
            Some(view.sh.user_header()),
            Some(view.objects.user_header()),
            Some(view.source.user_header()),
            view.features.as_ref().map(|block| block.user_header()),
        ];
        if others.into_iter().flatten().all(|other| *other == header) {
            return match view.check() {
                Ok(()) => Ok(view),
                Err(reason) => Err(ConnectError::Transport {
                    session: session.as_str().into(),
                    reason,
                }),
            };
        }
        // The server is just publishing another scene.
        wait.rest()?;
    }
}

struct Wait<'a> {
    node: &'a Node<Service>,
    session: &'a SessionName,
    timeout: Duration,
    deadline: Instant,
}

impl Wait<'_> {
    /// Sleeps for a moment.
    ///
    /// # Errors
    /// When the time is over.
    fn rest(&self) -> Result<(), ConnectError> {
        if Instant::now() >= self.deadline {
            return Err(ConnectError::Timeout {
                session: self.session.as_str().into(),
                what: "its scene",
                seconds: self.timeout.as_secs_f64(),
            });
        }
        std::thread::sleep(RETRY_PERIOD);
        Ok(())
    }

    /// The newest sample of a block.
    fn for_block<T>(&self, stream: Stream) -> Result<Block<T>, ConnectError>
    where
        T: Debug + ZeroCopySend + 'static,
    {
        let mut asked = Asked::new(stream);
        loop {
            if asked.look(self)?
                && let Some(block) = asked.newest.take()
            {
                return Ok(block);
            }
            self.rest()?;
        }
    }
}

/// A block that is waited for.
struct Asked<T: Debug + ZeroCopySend + 'static> {
    stream: Stream,
    subscriber: Option<Subscriber<Service, [T], SceneHeader>>,
    newest: Option<Block<T>>,
}

impl<T: Debug + ZeroCopySend + 'static> Asked<T> {
    fn new(stream: Stream) -> Self {
        Self {
            stream,
            subscriber: None,
            newest: None,
        }
    }

    /// Takes the newest sample; whether there is one.
    fn look(&mut self, wait: &Wait<'_>) -> Result<bool, ConnectError> {
        let failed = |reason: String| ConnectError::Transport {
            session: wait.session.as_str().into(),
            reason: format!("{}: {reason}", self.stream.name),
        };
        if self.subscriber.is_none() {
            match session::pub_sub::<T, SceneHeader>(wait.node, wait.session, self.stream, false) {
                Ok(service) => {
                    let port = service.subscriber_builder().buffer_size(1).create();
                    self.subscriber = Some(port.map_err(|e| failed(e.to_string()))?);
                }
                Err(OpenError::Absent) => {}
                Err(error) => return Err(ConnectError::open(wait.session.as_str(), error)),
            }
        }
        if let Some(port) = &self.subscriber {
            while let Some(sample) = port.receive().map_err(|e| failed(e.to_string()))? {
                self.newest = Some(sample);
            }
        }
        Ok(self.newest.is_some())
    }
}
