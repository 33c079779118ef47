//! A thread that looks after connections while the server computes: late joiners get the history, what dead
//! processes held comes back, and the heartbeat goes on.

use std::{
    sync::{
        Arc, Condvar, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

use iceoryx2::{node::Node, port::update_connections::UpdateConnections};

use super::{
    lock::Entry,
    nodes::{DeadNodes, Fallen},
    status::StatusPort,
};
use crate::{Domain, DomainError, Service};

/// History reaches a late joiner within this time.
const CONNECT_PERIOD: Duration = Duration::from_millis(20);
/// Dead processes are noticed within this time.
const CLEANUP_PERIOD: Duration = Duration::from_millis(100);

/// A port whose connections need care.
pub(super) type Port = Arc<dyn UpdateConnections + Send + Sync>;

#[derive(Default)]
struct State {
    ports: Vec<Port>,
    scene: Vec<Port>,
    cleanup_asked: bool,
    stop: bool,
}

struct Shared {
    state: Mutex<State>,
    wake: Condvar,
    /// Whether the session's files were found to be gone.
    is_lost: AtomicBool,
}

/// The running thread; stops when dropped.
pub(super) struct Monitor {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Monitor {
    pub fn start(
        domain: &Domain,
        ports: Vec<Port>,
        status: Arc<StatusPort>,
        fallen: Fallen,
        entry: Entry,
    ) -> Result<Self, DomainError> {
        let node = domain.join("monitor")?;
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                ports,
                ..State::default()
            }),
            wake: Condvar::new(),
            is_lost: AtomicBool::new(false),
        });
        let thread = std::thread::Builder::new()
            .name("cosplat-monitor".into())
            .spawn({
                let shared = shared.clone();
                move || run(&shared, &node, &status, fallen, &entry)
            })
            .map_err(|cause| DomainError::Io {
                path: domain.root().into(),
                cause,
            })?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// Keeps the publishers of the current scene, and drops those of the former.
    pub fn set_scene(&self, scene: Vec<Port>) {
        let former = std::mem::replace(&mut self.lock().scene, scene);
        drop(former);
    }

    /// Looks after another publisher as well.
    pub fn add(&self, port: Option<Port>) {
        self.lock().ports.extend(port);
    }

    /// Looks for dead processes at once.
    pub fn ask_cleanup(&self) {
        self.lock().cleanup_asked = true;
        self.shared.wake.notify_all();
    }

    /// Whether somebody removed the files by which others find the session.
    pub fn is_lost(&self) -> bool {
        self.shared.is_lost.load(Ordering::Relaxed)
    }

    /// Serves late joiners now.
    pub fn update_connections(&self) {
        update(&self.lock());
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.shared
            .state
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        self.lock().stop = true;
        self.shared.wake.notify_all();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the monitor thread panicked");
        }
    }
}

fn update(state: &State) {
    for port in state.ports.iter().chain(&state.scene) {
        if let Err(error) = port.update_connections() {
            tracing::debug!(?error, "a connection could not be updated");
        }
    }
}

fn run(shared: &Shared, node: &Node<Service>, status: &StatusPort, fallen: Fallen, entry: &Entry) {
    let mut cleaned = Instant::now();
    let mut dead = DeadNodes::new(fallen);
    let mut state = shared.state.lock().unwrap_or_else(PoisonError::into_inner);
    while !state.stop {
        if state.cleanup_asked || cleaned.elapsed() >= CLEANUP_PERIOD {
            state.cleanup_asked = false;
            drop(state);
            let outcome = dead.clear(node, Instant::now());
            if outcome.cleared > 0 {
                tracing::info!(
                    count = outcome.cleared,
                    "cleaned up after processes that died"
                );
            }
            if !entry.is_there() {
                shared.is_lost.store(true, Ordering::Relaxed);
            }
            cleaned = Instant::now();
            state = shared.state.lock().unwrap_or_else(PoisonError::into_inner);
        }
        update(&state);
        status.keep_alive();
        if state.stop || state.cleanup_asked {
            continue;
        }
        state = shared
            .wake
            .wait_timeout(state, CONNECT_PERIOD)
            .unwrap_or_else(PoisonError::into_inner)
            .0;
    }
}
