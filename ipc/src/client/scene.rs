//! The scene, mapped from the server's memory.

use std::{
    fmt::Debug,
    time::{Duration, Instant},
};

use iceoryx2::{port::subscriber::Subscriber, prelude::ZeroCopySend, sample::Sample};

use super::{Client, ConnectError, RETRY_PERIOD, deadline, origin::Origin};
use crate::{
    Service,
    schema::{GaussianRest, ObjectInfo, SceneFile, SceneHeader},
    session::{self, Stream},
};

type Block<T> = Sample<Service, [T], SceneHeader>;

/// The scene of one epoch, checked against its header. It stays valid when the server goes.
#[derive(Debug)]
pub struct SceneView {
    gaussians: Block<GaussianRest>,
    sh: Block<f32>,
    objects: Block<ObjectInfo>,
    source: Block<u8>,
    files: Block<SceneFile>,
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

    /// The files that the server read beside the scene file.
    pub fn files(&self) -> &[SceneFile] {
        self.files.payload()
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

/// Finds the scene of a session, block by block. What has come stays between calls: where a process gets little time,
/// many short ones lead as far as a long one.
#[derive(Default)]
pub struct SceneReader {
    search: Option<Search>,
}

impl SceneReader {
    /// The scene that messages of `epoch` belong to, waiting up to `timeout` for it; `None` when a newer run of the server
    /// has published its own, and the messages are leftovers.
    ///
    /// # Errors
    /// [`ConnectError::Timeout`], with the seconds since this scene was first asked for, when it is not there yet: ask
    /// again. Any other when it cannot be read.
    pub fn of(
        &mut self,
        client: &Client,
        epoch: u64,
        timeout: Duration,
    ) -> Result<Option<SceneView>, ConnectError> {
        self.find(client, Some(epoch), timeout)
    }

    /// The scene that is there, or the next one, waiting up to `timeout` for it.
    ///
    /// # Errors
    /// As [`of`](Self::of).
    pub fn any(&mut self, client: &Client, timeout: Duration) -> Result<SceneView, ConnectError> {
        match self.find(client, None, timeout)? {
            Some(scene) => Ok(scene),
            None => Err(self.timeout(client)),
        }
    }

    fn find(
        &mut self,
        client: &Client,
        epoch: Option<u64>,
        timeout: Duration,
    ) -> Result<Option<SceneView>, ConnectError> {
        let deadline = deadline(timeout);
        let search = self.search.get_or_insert_with(|| Search::new(epoch));
        if search.epoch != epoch {
            (search.epoch, search.since) = (epoch, Instant::now());
        }
        loop {
            search.look(client)?;
            match (search.found(), epoch) {
                (Some(found), Some(wanted)) if found > wanted => return Ok(None),
                (Some(found), wanted) if wanted.is_none_or(|wanted| wanted == found) => break,
                _ => {}
            }
            if Instant::now() >= deadline {
                return Err(self.timeout(client));
            }
            std::thread::sleep(RETRY_PERIOD);
        }
        // The ports go with the search: the server has room for few.
        let Some(view) = self.search.take().and_then(Search::view) else {
            return Ok(None);
        };
        match view.check() {
            Ok(()) => Ok(Some(view)),
            Err(reason) => Err(ConnectError::Transport {
                session: client.session().into(),
                reason,
            }),
        }
    }

    fn timeout(&self, client: &Client) -> ConnectError {
        let search = self.search.as_ref();
        ConnectError::Timeout {
            session: client.session().into(),
            what: search.map_or("its scene", Search::missing),
            seconds: search.map_or(0.0, |search| search.since.elapsed().as_secs_f64()),
        }
    }
}

/// The blocks of a scene that are found so far; they belong together when their headers are equal.
struct Search {
    /// What is asked for.
    epoch: Option<u64>,
    /// Since when.
    since: Instant,
    gaussians: Asked<GaussianRest>,
    sh: Asked<f32>,
    objects: Asked<ObjectInfo>,
    source: Asked<u8>,
    files: Asked<SceneFile>,
    features: Asked<f32>,
}

impl Search {
    fn new(epoch: Option<u64>) -> Self {
        Self {
            epoch,
            since: Instant::now(),
            gaussians: Asked::new(session::SCENE_GAUSSIANS),
            sh: Asked::new(session::SCENE_SH),
            objects: Asked::new(session::SCENE_OBJECTS),
            source: Asked::new(session::SCENE_SOURCE),
            files: Asked::new(session::SCENE_FILES),
            features: Asked::new(session::SCENE_FEATURES),
        }
    }

    /// Takes what has come. All are asked for together: the server answers all that it finds in one turn of its monitor.
    fn look(&mut self, client: &Client) -> Result<(), ConnectError> {
        self.gaussians.look(client)?;
        self.sh.look(client)?;
        self.objects.look(client)?;
        self.source.look(client)?;
        self.files.look(client)?;
        if self.has_features() {
            self.features.look(client)?;
        }
        Ok(())
    }

    fn has_features(&self) -> bool {
        self.gaussians.header().is_some_and(|h| h.feature_dim > 0)
    }

    /// Headers of the blocks that make up a scene.
    fn headers(&self) -> impl Iterator<Item = Option<&SceneHeader>> {
        [
            Some(self.gaussians.header()),
            Some(self.sh.header()),
            Some(self.objects.header()),
            Some(self.source.header()),
            Some(self.files.header()),
            self.has_features().then(|| self.features.header()),
        ]
        .into_iter()
        .flatten()
    }

    /// Epoch of the scene whose blocks are all there.
    fn found(&self) -> Option<u64> {
        let first = self.gaussians.header()?;
        let agree = self.headers().all(|header| header == Some(first));
        agree.then_some(first.epoch)
    }

    /// What is waited for.
    fn missing(&self) -> &'static str {
        let names = [
            "its scene",
            "the spherical harmonics of its scene",
            "the objects of its scene",
            "the file of its scene",
            "the list of files of its scene",
            "the features of its scene",
        ];
        let missing = self.headers().zip(names).find(|(h, _)| h.is_none());
        missing.map_or("the scene of its newest run", |(_, name)| name)
    }

    fn view(self) -> Option<SceneView> {
        let features = match self.has_features() {
            true => Some(self.features.newest?),
            false => None,
        };
        Some(SceneView {
            gaussians: self.gaussians.newest?,
            sh: self.sh.newest?,
            objects: self.objects.newest?,
            source: self.source.newest?,
            files: self.files.newest?,
            features,
        })
    }
}

/// A reader of a block.
struct Port<T: Debug + ZeroCopySend + 'static> {
    subscriber: Subscriber<Service, [T], SceneHeader>,
    origin: Origin<T, SceneHeader>,
}

/// A block that is waited for.
struct Asked<T: Debug + ZeroCopySend + 'static> {
    stream: Stream,
    port: Option<Port<T>>,
    newest: Option<Block<T>>,
}

impl<T: Debug + ZeroCopySend + 'static> Asked<T> {
    fn new(stream: Stream) -> Self {
        Self {
            stream,
            port: None,
            newest: None,
        }
    }

    fn header(&self) -> Option<&SceneHeader> {
        self.newest.as_ref().map(|block| block.user_header())
    }

    /// Takes the newest sample, if there is one.
    fn look(&mut self, client: &Client) -> Result<(), ConnectError> {
        let failed = |reason: String| {
            let reason = format!("{}: {reason}", self.stream.name);
            ConnectError::transport(client.session(), reason)
        };
        if self.port.is_none() {
            let Client { node, session, .. } = client;
            match session::pub_sub::<T, SceneHeader>(node, session, self.stream, false) {
                Ok(service) => {
                    let subscriber = service.subscriber_builder().buffer_size(1).create();
                    self.port = Some(Port {
                        subscriber: subscriber.map_err(|e| failed(e.to_string()))?,
                        origin: Origin::new(client.hello_service.clone(), service),
                    });
                }
                Err(error) => match ConnectError::open(client.session(), error) {
                    error if error.may_pass() => {}
                    error => return Err(error),
                },
            }
        }
        if let Some(Port { subscriber, origin }) = &mut self.port {
            while let Some(sample) = subscriber.receive().map_err(|e| failed(e.to_string()))? {
                if origin.is_servers(sample.origin()) {
                    self.newest = Some(sample);
                }
            }
        }
        Ok(())
    }
}
