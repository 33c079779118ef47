//! Limits of the system and of a session, in sentences: iceoryx2 names the port or the file that it could not make.

use rustix::process::{Resource, getrlimit};

use crate::session::{MAX_ATTACHED, MAX_ENDS, MAX_NODES, MAX_SENDERS, MAX_SUBSCRIBERS};

/// Descriptors that a server holds, with a listener for each reader, and some to spare.
pub(crate) const SERVER_FILES: u64 = 240;
/// With fewer free descriptors, a step of iceoryx2 may have failed for want of one.
pub(crate) const FEW_FILES: u64 = 16;

/// A limit on sizes from this on is none that sessions meet [byte].
const LARGE: u64 = 16 << 30;

/// A limit that keeps a process from taking part.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LimitReached {
    /// The process may open no more files.
    #[error(
        "this process has {open} files open and may have {limit}, expected room for {needed} more: raise the limit with `ulimit -n {}`",
        open.saturating_add(*needed).clamp(1024, 1 << 20)
    )]
    Files {
        /// Files that are open.
        open: u64,
        /// Files that may be open.
        limit: u64,
        /// Files that are needed.
        needed: u64,
    },
    /// The process may make no files as large as a session needs.
    #[error(
        "this process may make files of {limit} bytes at most, and shared memory is made of files: raise the limit with `ulimit -f unlimited`"
    )]
    FileSize {
        /// Largest file [byte].
        limit: u64,
    },
    /// The process may map no more memory.
    #[error(
        "this process may have {limit} bytes of address space and has {used}: raise the limit with `ulimit -v unlimited`"
    )]
    AddressSpace {
        /// Largest size [byte].
        limit: u64,
        /// Size at present [byte].
        used: u64,
    },
    /// The session takes no more of them.
    #[error("all {max} places for {what} are taken: end one of these programs, then try again")]
    Places {
        /// Who takes the places.
        what: &'static str,
        /// How many there are.
        max: usize,
    },
}

impl LimitReached {
    /// The limit on descriptors, if fewer than `needed` are free.
    pub(crate) fn files(needed: u64) -> Option<Self> {
        let limit = getrlimit(Resource::Nofile).current?;
        let open = open_below(limit).unwrap_or(limit);
        (limit.saturating_sub(open) < needed).then_some(Self::Files {
            open,
            limit,
            needed,
        })
    }

    /// The limit that made a step of iceoryx2 fail, going by what it says and by what is left.
    pub(crate) fn behind(reason: &str) -> Option<Self> {
        let attached = ["hello: ", "status: ", "scene/"];
        let readers = match attached.iter().any(|stream| reason.starts_with(stream)) {
            true => MAX_ATTACHED,
            false => MAX_SUBSCRIBERS,
        };
        [
            ("ExceedsMaxSupportedSubscribers", "readers", readers),
            ("ExceedsMaxSupportedClients", "command senders", MAX_SENDERS),
            ("ExceedsMaxSupportedListeners", "listeners", MAX_ENDS),
            ("ExceedsMaxSupportedNotifiers", "notifiers", MAX_ENDS),
            ("ExceedsMaxNumberOfNodes", "processes", MAX_NODES),
        ]
        .into_iter()
        .find(|(word, ..)| reason.contains(word))
        .map(|(_, what, max)| Self::Places { what, max })
        .or_else(|| Self::files(FEW_FILES))
        .or_else(Self::size)
    }

    /// The limit on sizes that may be behind a failure of iceoryx2, which says of none why it failed.
    fn size() -> Option<Self> {
        let limit = |resource| getrlimit(resource).current.filter(|limit| *limit < LARGE);
        if let Some(limit) = limit(Resource::Fsize) {
            return Some(Self::FileSize { limit });
        }
        let limit = limit(Resource::As)?;
        let used = address_space().unwrap_or(0);
        Some(Self::AddressSpace { limit, used })
    }
}

/// Address space of this process [byte].
fn address_space() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let size = status
        .lines()
        .find_map(|line| line.strip_prefix("VmSize:"))?;
    let kib: u64 = size.split_whitespace().next()?.parse().ok()?;
    kib.checked_mul(1024)
}

/// Descriptors that are open and count against `limit`, which is one on their numbers; `None` when there is none
/// left to look with.
fn open_below(limit: u64) -> Option<u64> {
    let names = std::fs::read_dir("/proc/self/fd").ok()?.flatten();
    let numbers = names.filter_map(|entry| entry.file_name().to_str()?.parse::<u64>().ok());
    // Looking takes one as well.
    Some((numbers.filter(|number| *number < limit).count() as u64).saturating_sub(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_session_and_full_tables_have_sentences() {
        let full = LimitReached::behind("SubscriberCreateError::ExceedsMaxSupportedSubscribers");
        let expected =
            "all 32 places for readers are taken: end one of these programs, then try again";
        assert_eq!(full.expect("a limit").to_string(), expected);
        // The tests have descriptors left.
        assert_eq!(LimitReached::behind("InternalFailure"), None);
        let files = LimitReached::files(u64::MAX).expect("a limit").to_string();
        assert!(files.contains("raise the limit with `ulimit -n"), "{files}");
    }
}
