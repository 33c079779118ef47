//! What the tests share: a domain per test, a small scene, frames that can be told apart.

use std::{
    sync::{
        atomic::{AtomicU32, Ordering},
        mpsc::{RecvTimeoutError, Sender, channel},
    },
    time::{Duration, Instant},
};

use bytemuck::Zeroable;
use cosplat_ipc::{
    Domain, ServerPorts,
    schema::{
        FrameHeader, GaussianRest, GaussianState, ObjectInfo, SCENE_FILE_ASSET, SceneFile,
        SceneHeader, padded,
    },
    server::{CreateError, PoolPlan, SceneBlocks},
};

/// Long enough for a loaded machine; only a hang reaches it.
pub const PATIENCE: Duration = Duration::from_secs(20);
/// Time for a whole test, many times what the longest takes.
const WATCHDOG: Duration = Duration::from_secs(240);
/// Gaussians in the test scene.
pub const COUNT: usize = 100;
/// Text of the test scene's file.
pub const SOURCE: &str = "name = \"test\"\n";

/// A domain that no other test uses; its files go with it. A test that never ends becomes one that fails: calls
/// into shared memory that others left in disorder cannot be given a timeout.
pub struct TestDomain {
    domain: Domain,
    _running: Sender<()>,
}

impl TestDomain {
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("cpt{}_{number}_", std::process::id());
        let (running, ended) = channel();
        let test = std::thread::current().name().unwrap_or("").to_owned();
        std::thread::spawn(move || {
            if ended.recv_timeout(WATCHDOG) == Err(RecvTimeoutError::Timeout) {
                eprintln!("{test} hangs: it has not ended after {WATCHDOG:?}");
                std::process::abort();
            }
        });
        Self {
            domain: Domain::new(format!("/tmp/{name}"), &name).expect("a domain"),
            _running: running,
        }
    }
}

impl std::ops::Deref for TestDomain {
    type Target = Domain;
    fn deref(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for TestDomain {
    fn drop(&mut self) {
        self.discard();
    }
}

/// The parts of the test scene.
pub struct TestScene {
    gaussians: Vec<GaussianRest>,
    sh: Vec<f32>,
    objects: Vec<ObjectInfo>,
    features: Vec<f32>,
    files: Vec<SceneFile>,
}

impl TestScene {
    pub fn new() -> Self {
        let gaussian = |i| GaussianRest {
            position: [i as f32, 0.0, 0.0],
            opacity: 1.0,
            ..GaussianRest::zeroed()
        };
        Self {
            gaussians: (0..COUNT).map(gaussian).collect(),
            sh: (0..COUNT * 3).map(|i| i as f32).collect(),
            objects: vec![ObjectInfo {
                gaussian_count: COUNT as u32,
                name: padded("vase"),
                ..ObjectInfo::zeroed()
            }],
            features: (0..COUNT * 2).map(|i| -(i as f32)).collect(),
            files: vec![SceneFile::new(
                SCENE_FILE_ASSET,
                "vase.ply",
                "/data/vase.ply",
                5,
                9,
            )],
        }
    }

    pub fn blocks(&self) -> SceneBlocks<'_> {
        SceneBlocks {
            header: SceneHeader {
                feature_dim: 2,
                scene_hash: 7,
                ..SceneHeader::default()
            },
            gaussians: &self.gaussians,
            sh: &self.sh,
            objects: &self.objects,
            features: &self.features,
            source: SOURCE,
            files: &self.files,
        }
    }
}

/// A server of the test scene.
pub fn serve(domain: &Domain, session: &str) -> ServerPorts {
    let scene = TestScene::new();
    let plan = PoolPlan::new(&scene.blocks());
    let start = Instant::now();
    // A child that another test starts holds the lock of a server that this process has just ended, until it runs its program.
    let created = loop {
        match ServerPorts::create(domain, session, &plan) {
            Err(CreateError::AlreadyServed { .. }) if start.elapsed() < PATIENCE => {
                std::thread::sleep(Duration::from_millis(1));
            }
            created => break created,
        }
    };
    let mut ports = created.expect("a server");
    ports.publish_scene(&scene.blocks()).expect("a scene");
    ports
}

/// Publishes the frame of `step`.
pub fn send_frame(ports: &ServerPorts, step: u64) {
    let header = FrameHeader {
        step,
        ..FrameHeader::default()
    };
    write_frame(ports, &header);
}

/// Publishes a frame in which every Gaussian carries the step in its place and its height.
pub fn write_frame(ports: &ServerPorts, header: &FrameHeader) {
    let mut loan = ports.loan_frame_within(COUNT, PATIENCE).expect("memory");
    for (i, gaussian) in loan.gaussians_mut().iter_mut().enumerate() {
        *gaussian = GaussianState {
            position: [header.step as f32, i as f32, header.step as f32],
            index: i as u32,
            ..GaussianState::zeroed()
        };
    }
    loan.send(header).expect("sent");
}
