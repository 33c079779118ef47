//! What dead processes leave: their nodes, and all that belongs to these.
//!
//! iceoryx2 clears away a node whose files are complete. A process that is killed while it attaches, which is mostly
//! spent on flushing those files, leaves them incomplete, and iceoryx2 0.10.0 leaves them as they are: it takes a node
//! without a finished monitor file for one that is just being made, and gives up on the folder of a dead one when it
//! holds a tag without its final mode, each time anew. Neither ever goes, and each try costs a millisecond.

use std::{
    collections::{BTreeMap, BTreeSet, VecDeque},
    fs, io,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

use iceoryx2::{
    node::{Node, NodeState, NodeView},
    prelude::CallbackProgression,
};
use rustix::{io::Errno, process::Pid};

use crate::Service;

/// Pause after the first failure; it doubles with each.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
/// Longest pause between two tries.
const LONGEST_PAUSE: Duration = Duration::from_secs(60);
/// Tries that iceoryx2 gets, because another process may just be clearing away the same node.
const TRIES: u32 = 3;
/// A node that is not complete after this time never will be, if its process is gone. The time is for processes in
/// containers that see each other's files and not each other: making a node takes some ten milliseconds.
const BIRTH: Duration = Duration::from_secs(5);
/// Mode of a tag or of details that are not finished.
const UNFINISHED_MODE: u32 = 0o600;

/// Dead nodes that are remembered: a port goes right after its node was seen to be dead.
const REMEMBERED: usize = 256;

/// The nodes that are not alive, and when to try them again.
#[derive(Default)]
pub(super) struct DeadNodes {
    seen: BTreeMap<u128, Seen>,
    fallen: Fallen,
}

/// The nodes that were seen to be dead of late. The ports of a dead node vanish like those of one that was ended in order;
/// who wants to know which of the two it was asks here.
#[derive(Clone, Default)]
pub(super) struct Fallen(Arc<Mutex<VecDeque<u128>>>);

impl Fallen {
    fn add(&self, id: u128) {
        let mut ids = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !ids.contains(&id) {
            ids.truncate(REMEMBERED - 1);
            ids.push_front(id);
        }
    }

    /// Whether the process of the node `id` died, as far as this process saw: another one may have cleared the node away.
    pub fn contains(&self, id: u128) -> bool {
        let ids = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        ids.contains(&id)
    }
}

struct Seen {
    first: Instant,
    due: Instant,
    failures: u32,
}

/// What one look did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Outcome {
    /// Nodes that were tried.
    pub tried: u64,
    /// Nodes that are gone.
    pub cleared: u64,
}

impl DeadNodes {
    /// None seen yet; `fallen` is told of them.
    pub fn new(fallen: Fallen) -> Self {
        Self {
            fallen,
            ..Self::default()
        }
    }

    /// Clears away what is dead in the domain of `node` and due at `now`.
    pub fn clear(&mut self, node: &Node<Service>, now: Instant) -> Outcome {
        let global = &node.config().global;
        let place = Place {
            folder: PathBuf::from(global.node_dir().to_string()),
            prefix: global.prefix.to_string(),
        };
        // Before their states: what comes into being between the two is then not looked at.
        let present = place.ids();
        let mut alive = BTreeSet::new();
        let mut dead = BTreeMap::new();
        let listed = Node::<Service>::list(node.config(), |state| {
            let id = state.node_id().value();
            match state {
                NodeState::Dead(view) => drop(dead.insert(id, view)),
                NodeState::Alive(view) => drop(alive.insert(view.id().value())),
                NodeState::Inaccessible(_) | NodeState::Undefined(_) => {}
            }
            CallbackProgression::Continue
        });
        let mut outcome = Outcome::default();
        if let Err(error) = listed {
            tracing::debug!(?error, "nodes cannot be listed");
            return outcome;
        }
        self.seen
            .retain(|id, _| present.contains(id) && !alive.contains(id));
        for id in present.difference(&alive) {
            let seen = self.seen.entry(*id).or_insert(Seen {
                first: now,
                due: now,
                failures: 0,
            });
            let view = dead.remove(id);
            let is_ripe = view.is_some() || (now - seen.first >= BIRTH && is_gone(*id));
            if now < seen.due || !is_ripe {
                continue;
            }
            outcome.tried += 1;
            let cleared = match view {
                Some(view) => {
                    // Before its ports vanish.
                    self.fallen.add(*id);
                    place.remove_unfinished_tags(*id);
                    let tried = view.try_remove_stale_resources();
                    tried.is_ok() || (seen.failures >= TRIES && place.remove(*id).is_ok())
                }
                None => place.remove(*id).is_ok(),
            };
            if cleared {
                outcome.cleared += 1;
                self.seen.remove(id);
            } else {
                seen.failures += 1;
                seen.due = now + pause(seen.failures);
                tracing::debug!(id, seen.failures, "a dead node cannot be cleared away");
            }
        }
        outcome
    }
}

/// Pause after so many failures in a row.
fn pause(failures: u32) -> Duration {
    let doublings = failures.saturating_sub(1).min(16);
    (FIRST_PAUSE * (1 << doublings)).min(LONGEST_PAUSE)
}

/// Whether the process that made the node `id` has ended. A number that is in use again counts as the process.
fn is_gone(id: u128) -> bool {
    // iceoryx2's `UniqueSystemId`: seconds, nanoseconds, process, counter, 32 bits each.
    let process = i32::try_from((id >> 64) as u32).ok();
    match process.and_then(Pid::from_raw) {
        Some(pid) => rustix::process::test_kill_process(pid) == Err(Errno::SRCH),
        None => true,
    }
}

/// Where the nodes of a domain are.
struct Place {
    folder: PathBuf,
    prefix: String,
}

impl Place {
    /// Ids of all nodes of which there is anything.
    fn ids(&self) -> BTreeSet<u128> {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        entries
            .filter_map(|entry| {
                let name = entry.file_name().into_string().ok()?;
                let name = name.strip_prefix(&self.prefix).unwrap_or(&name);
                name.split('.').next()?.parse().ok()
            })
            .collect()
    }

    fn details(&self, id: u128) -> PathBuf {
        self.folder.join(id.to_string())
    }

    /// Removes the tags without final mode, which stand for nothing: a process finishes the tag before it makes what
    /// the tag is for.
    fn remove_unfinished_tags(&self, id: u128) {
        for entry in fs::read_dir(self.details(id))
            .into_iter()
            .flatten()
            .flatten()
        {
            if is_tag(&entry.path()) && is_unfinished(&entry) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }

    /// Removes the files of a node that belongs to no service.
    ///
    /// # Errors
    /// When it does belong to one, which only iceoryx2 can undo, or a file cannot be removed.
    fn remove(&self, id: u128) -> io::Result<()> {
        let folder = self.details(id);
        let absent_is_fine = |done: io::Result<()>| match done {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            other => other,
        };
        for entry in fs::read_dir(&folder).into_iter().flatten() {
            let entry = entry?;
            if is_tag(&entry.path()) && !is_unfinished(&entry) {
                return Err(io::ErrorKind::ResourceBusy.into());
            }
            absent_is_fine(fs::remove_file(entry.path()))?;
        }
        absent_is_fine(fs::remove_dir(&folder))?;
        for suffix in ["", "_owner_lock", "_context"] {
            let name = format!("{}{id}.node_monitor{suffix}", self.prefix);
            absent_is_fine(fs::remove_file(self.folder.join(name)))?;
        }
        Ok(())
    }
}

/// Whether the file says that a node uses a service or has a port.
fn is_tag(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e == "service_tag" || e == "port_tag")
}

fn is_unfinished(entry: &fs::DirEntry) -> bool {
    let mode = entry.metadata().map(|found| found.permissions().mode());
    mode.is_ok_and(|mode| mode & 0o777 == UNFINISHED_MODE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Domain;

    /// A domain with a node of this process in it, and what others left beside it.
    struct Graveyard {
        domain: Domain,
        node: Node<Service>,
        place: Place,
    }

    impl Graveyard {
        fn new(name: &str) -> Self {
            let name = format!("{name}{}_", std::process::id());
            let domain = Domain::new(format!("/tmp/{name}"), &name).expect("a domain");
            let node = domain.join("test").expect("joined");
            let place = Place {
                folder: domain.root().join("nodes"),
                prefix: name,
            };
            Self {
                domain,
                node,
                place,
            }
        }

        /// The id of a node that `process` makes.
        fn id(process: u32, counter: u32) -> u128 {
            u128::from(process) << 64 | u128::from(counter) << 96 | 7
        }

        /// Puts a file with `mode` into the node's folder.
        fn put(&self, id: u128, name: &str, mode: u32) {
            let folder = self.place.details(id);
            fs::create_dir_all(&folder).expect("made");
            let path = folder.join(format!("{}{name}", self.place.prefix));
            fs::write(&path, "x").expect("written");
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).expect("set");
        }

        /// Makes the monitor files; with a context that is not finished, the process died before it was.
        fn put_monitor(&self, id: u128, context_mode: u32) {
            for (suffix, mode) in [("", 0o600), ("_owner_lock", 0o600), ("_context", 0o600)] {
                let name = format!("{}{id}.node_monitor{suffix}", self.place.prefix);
                let path = self.place.folder.join(name);
                fs::write(&path, [1; 16]).expect("written");
                let mode = if suffix == "_context" {
                    context_mode
                } else {
                    mode
                };
                fs::set_permissions(&path, fs::Permissions::from_mode(mode)).expect("set");
            }
        }
    }

    impl Drop for Graveyard {
        fn drop(&mut self) {
            self.domain.discard();
        }
    }

    /// The number of a process that has ended.
    fn ended_process() -> u32 {
        let mut child = std::process::Command::new("true")
            .spawn()
            .expect("a process");
        child.wait().expect("ended");
        child.id()
    }

    #[test]
    fn what_died_in_its_birth_goes_and_what_lives_stays() {
        let yard = Graveyard::new("cpbirth");
        let own = yard.node.id().value();
        let ended = ended_process();
        let [folder, starting, unborn, registered] =
            [1, 2, 3, 4].map(|counter| Graveyard::id(ended, counter));
        yard.put(folder, "node.details", 0o600);
        yard.put(starting, "node.details", 0o400);
        yard.put_monitor(starting, 0o200);
        // This process might still finish it.
        let unborn = unborn & !(u128::from(u32::MAX) << 64) | u128::from(std::process::id()) << 64;
        yard.put(unborn, "node.details", 0o600);
        // Only iceoryx2 can take a node out of a service.
        yard.put(registered, "0.service_tag", 0o400);
        let all = BTreeSet::from([own, folder, starting, unborn, registered]);
        assert_eq!(yard.place.ids(), all);

        let mut dead = DeadNodes::default();
        let start = Instant::now();
        let young = dead.clear(&yard.node, start);
        assert_eq!(young, Outcome::default());
        assert_eq!(yard.place.ids(), all);
        let old = dead.clear(&yard.node, start + BIRTH);
        assert_eq!((old.tried, old.cleared), (3, 2));
        let left = BTreeSet::from([own, unborn, registered]);
        assert_eq!(yard.place.ids(), left);
    }

    #[test]
    fn a_node_that_will_not_go_is_tried_ever_less_often() {
        let yard = Graveyard::new("cpstuck");
        let id = Graveyard::id(ended_process(), 1);
        yard.put_monitor(id, 0o400);
        // Neither iceoryx2 nor we remove what we do not know.
        fs::create_dir_all(yard.place.details(id).join("a folder")).expect("made");
        let mut dead = DeadNodes::default();
        let start = Instant::now();
        let mut tried = 0;
        for look in 0..600 {
            let outcome = dead.clear(&yard.node, start + FIRST_PAUSE * look);
            assert_eq!(outcome.cleared, 0);
            tried += outcome.tried;
        }
        // After 0, 0.1, 0.3, 0.7, ... 51.1 s of the minute.
        assert_eq!(tried, 10);
        assert_eq!(pause(1), FIRST_PAUSE);
        assert_eq!(pause(u32::MAX), LONGEST_PAUSE);
        fs::remove_dir(yard.place.details(id).join("a folder")).expect("removed");
        let outcome = dead.clear(&yard.node, start + 2 * LONGEST_PAUSE);
        assert_eq!((outcome.tried, outcome.cleared), (1, 1));
        assert_eq!(yard.place.ids().len(), 1);
    }
}
