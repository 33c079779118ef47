//! Limits of the system and of a session, in sentences: iceoryx2 names the port or the file that it could not make.

use rustix::process::{Resource, getrlimit};

use crate::session::{MAX_ATTACHED, MAX_ENDS, MAX_NODES, MAX_SENDERS, MAX_SUBSCRIBERS};

/// Descriptors that a server holds, with a listener for each reader, and some to spare.
pub(crate) const SERVER_FILES: u64 = 240;
/// With fewer free descriptors, a step of iceoryx2 may have failed for want of one.
const FEW_FILES: u64 = 16;

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
    }
}
        let attached = ["hello: ", "status: ", "scene/"];
        let readers = match attached.iter().any(|stream| reason.starts_with(stream)) {
            true => MAX_ATTACHED,
            false => MAX_SUBSCRIBERS,
        };

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
