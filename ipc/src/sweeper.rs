//! What a process was just making when it was killed: shared memory, and sockets.
//!
//! iceoryx2 makes a segment in three moves: an empty file that its owner may only write, its size, its content
//! and the right to read. Who opens one waits for the third. Waiting ends after `creation_timeout`, with an
//! error, but for an empty file it has no end (0.10.0), and nothing ever removes either. So one `kill -9` at the
//! wrong moment would hold up every process that meets the file: a server that starts, a monitor, a reader.
//!
//! A listener's socket is bound before its port is registered, so that of a process killed in between is nobody's.

use std::{
    collections::BTreeMap,
    fs,
    io::ErrorKind,
    os::unix::{
        fs::{FileTypeExt, MetadataExt, PermissionsExt},
        net::UnixDatagram,
    },
    path::{Path, PathBuf},
    sync::{Mutex, Once, PoisonError},
    time::{Duration, Instant},
};

use crate::{Domain, shm::SHM_DIR};

/// How often the sweeper looks.
const PERIOD: Duration = Duration::from_millis(50);
/// Looks that see a segment unfinished before it goes. Making one takes well under a millisecond.
const LOOKS: u32 = 5;
/// Looks that find nobody behind a socket before it goes: iceoryx2 is to remove those that it knows first.
const SOCKET_LOOKS: u32 = 60;
/// Only a crowd of processes that start and die all the time keeps one from joining as long as this.
const PATIENCE: Duration = Duration::from_secs(5);
/// Mode of a file that is not finished: iceoryx2 lets its owner read it last.
const UNFINISHED_MODE: u32 = 0o200;

/// Domains that this process uses: prefixes and root folders.
static WATCHED: Mutex<Vec<(String, PathBuf)>> = Mutex::new(Vec::new());

/// Removes segments of `domain` that stay unfinished, and sockets that stay without an owner, from now on and for as long as this process lives, and
/// waits until there is none.
pub(crate) fn watch(domain: &Domain) {
    static THREAD: Once = Once::new();
    {
        let mut watched = WATCHED.lock().unwrap_or_else(PoisonError::into_inner);
        if !watched.iter().any(|(prefix, _)| prefix == domain.prefix()) {
            watched.push((domain.prefix().into(), domain.root().into()));
        }
    }
    THREAD.call_once(|| {
        let thread = std::thread::Builder::new().name("cosplat-sweeper".into());
        if let Err(error) = thread.spawn(run) {
            tracing::warn!(%error, "shared memory that killed processes left unfinished is not removed");
        }
    });
    let start = Instant::now();
    while !unfinished(|name| name.starts_with(domain.prefix())).is_empty()
        && start.elapsed() < PATIENCE
    {
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Forgets `domain`.
pub(crate) fn forget(domain: &Domain) {
    let mut watched = WATCHED.lock().unwrap_or_else(PoisonError::into_inner);
    watched.retain(|(prefix, _)| prefix != domain.prefix());
}

fn run() {
    // Looks by path and inode: a name may be used again. Counting looks instead of comparing times leaves out
    // the time for which the machine sleeps.
    let mut looks: BTreeMap<(PathBuf, u64), u32> = BTreeMap::new();
    loop {
        let watched = WATCHED
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone();
        let segments =
            unfinished(|name| watched.iter().any(|(prefix, _)| name.starts_with(prefix)));
        let sockets = watched.iter().flat_map(|(_, root)| orphans(root));
        let found: Vec<_> = (segments.into_iter().map(|key| (key, LOOKS)))
            .chain(sockets.map(|key| (key, SOCKET_LOOKS)))
            .collect();
        looks.retain(|key, _| found.iter().any(|(other, _)| other == key));
        for (key, enough) in found {
            let seen = looks.entry(key.clone()).or_default();
            *seen += 1;
            if *seen >= enough && still(&key) {
                tracing::info!(file = %key.0.display(), "removing what a killed process left unfinished");
                // Another process's sweeper may have been faster.
                let _ = fs::remove_file(&key.0);
            }
        }
        std::thread::sleep(PERIOD);
    }
}

/// Paths and inodes of the segments that are not finished and whose names are `ours`.
fn unfinished(ours: impl Fn(&str) -> bool) -> Vec<(PathBuf, u64)> {
    let files = fs::read_dir(SHM_DIR).into_iter().flatten().flatten();
    files
        .filter(|file| file.file_name().to_str().is_some_and(&ours))
        .filter_map(|file| Some((file.path(), inode(&file.path())?)))
        .collect()
}

/// Paths and inodes of the sockets in `root` that nobody listens to.
fn orphans(root: &Path) -> Vec<(PathBuf, u64)> {
    let files = fs::read_dir(root).into_iter().flatten().flatten();
    files
        .filter_map(|file| Some((file.path(), orphan(&file.path())?)))
        .collect()
}

/// Inode of the socket if nobody listens to it. One whose owner is stopped takes connections; one of another user is out of
/// reach. Files of other kinds refuse as well, hence the look at the kind.
fn orphan(path: &Path) -> Option<u64> {
    let found = fs::symlink_metadata(path).ok()?;
    if !found.file_type().is_socket() {
        return None;
    }
    let refused = UnixDatagram::unbound().ok()?.connect(path).err()?;
    (refused.kind() == ErrorKind::ConnectionRefused).then_some(found.ino())
}

/// Whether it is as it was found.
fn still((path, found): &(PathBuf, u64)) -> bool {
    inode(path).or_else(|| orphan(path)) == Some(*found)
}

/// Inode of the file if it is not finished. What another user puts there is none of ours, and holds nobody up.
fn inode(path: &Path) -> Option<u64> {
    let found = fs::symlink_metadata(path).ok()?;
    let is_ours = found.uid() == rustix::process::getuid().as_raw();
    let is_unfinished = found.permissions().mode() & 0o777 == UNFINISHED_MODE;
    (is_ours && is_unfinished).then_some(found.ino())
}
