//! Where processes meet: root folder, file prefix and the iceoryx2 configuration made from them.

use std::{
    fs,
    os::unix::fs::{DirBuilderExt, MetadataExt},
    path::{Path as FsPath, PathBuf},
    sync::Once,
};

use iceoryx2::prelude::*;

use crate::{LimitReached, Service, management, sweeper};

/// Longest root path and prefix together [byte]: with `/`, an id of 39 digits and `.event` a socket's path must
/// fit the 107 bytes of a Unix address.
pub const MAX_ROOT_LENGTH: usize = 107 - 1 - 39 - 6;

/// Longest name of a named domain [byte]: root and prefix both carry it, and six digits of a user id.
const MAX_NAME_LENGTH: usize = 12;

/// Where a domain has its configuration, below its root folder.
const CONFIGURATION: &str = "config/iceoryx2.toml";

/// A group of processes that see each other's sessions, and nobody else's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Domain {
    root: PathBuf,
    prefix: String,
}

/// Why a domain cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DomainError {
    /// The root path leaves no room for socket names.
    #[error("the root path {} has {length} bytes, at most {max} are possible: choose a shorter COSPLAT_DOMAIN", path.display())]
    RootTooLong {
        /// The path.
        path: PathBuf,
        /// Its length [byte].
        length: usize,
        /// Possible length [byte].
        max: usize,
    },
    /// The root path is relative or holds characters that iceoryx2 does not accept.
    #[error("the root path {} is not usable: expected an absolute path of plain characters", path.display())]
    BadRoot {
        /// The path.
        path: PathBuf,
    },
    /// The name or prefix holds other characters than letters, digits, `-` and `_`.
    #[error("{name:?} is not a domain name: expected 1 to 12 of the characters a-z A-Z 0-9 - _")]
    BadName {
        /// The name.
        name: String,
    },
    /// The root folder belongs to somebody else.
    #[error("the folder {} belongs to user {owner}, expected user {user}: set COSPLAT_DOMAIN to another folder", path.display())]
    ForeignRoot {
        /// The folder.
        path: PathBuf,
        /// Its owner's id.
        owner: u32,
        /// This process's user id.
        user: u32,
    },
    /// The root folder is a link or a file.
    #[error("{} is a link or a file, expected a folder: set COSPLAT_DOMAIN to a folder", path.display())]
    NotAFolder {
        /// The path.
        path: PathBuf,
    },
    /// The root folder holds something else.
    #[error(
        "the folder {} holds {found:?} and is no domain: set COSPLAT_DOMAIN to an empty or a new folder, or to a name of 1 to 12 of the characters a-z A-Z 0-9 - _",
        path.display()
    )]
    NotADomain {
        /// The folder.
        path: PathBuf,
        /// A file or folder in it.
        found: String,
    },
    /// Other users may enter the root folder.
    #[error(
        "the folder {0} has mode {mode:03o}, expected 700, so that nobody else can enter: run `chmod 700 {0}` if it is not shared, or set COSPLAT_DOMAIN to another folder",
        path.display()
    )]
    OpenRoot {
        /// The folder.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A file that the domain needs belongs to somebody else.
    #[error("the file {} belongs to user {owner}, expected user {user}: have it removed, or set COSPLAT_DOMAIN to another folder", path.display())]
    ForeignFile {
        /// The file.
        path: PathBuf,
        /// Its owner's id.
        owner: u32,
        /// This process's user id.
        user: u32,
    },
    /// A file that the domain needs cannot be made or read.
    #[error("the file {} cannot be used: {cause}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The root folder cannot be made or read.
    #[error("the folder {} cannot be used: {cause}", path.display())]
    Io {
        /// The folder.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// The process has reached a limit.
    #[error("cannot join the domain at {}: {limit}", path.display())]
    Limit {
        /// Root folder.
        path: PathBuf,
        /// The limit.
        limit: LimitReached,
    },
    /// iceoryx2 refused to join.
    #[error("cannot join the domain at {}: {reason}", path.display())]
    Node {
        /// Root folder.
        path: PathBuf,
        /// What iceoryx2 says.
        reason: String,
    },
}

impl Domain {
    /// The domain that `COSPLAT_DOMAIN` names: unset or empty for the user's own, an absolute path for a
    /// root folder, anything else for [`named`](Self::named).
    pub fn from_env() -> Result<Self, DomainError> {
        match std::env::var("COSPLAT_DOMAIN") {
            Ok(value) if value.starts_with('/') => Self::at(value.into()),
            Ok(value) if !value.is_empty() => Self::named(&value),
            _ => Self::at(user_root().into()),
        }
    }

    /// A domain beside the user's own, for tests and separate groups; `name` is 1 to 12 of `a-z A-Z 0-9 - _`.
    pub fn named(name: &str) -> Result<Self, DomainError> {
        check_name(name, MAX_NAME_LENGTH)?;
        Self::at(format!("{}-{name}", user_root()).into())
    }

    /// A domain whose prefix is the name of its root folder and `_`. Files in shared memory have one folder for
    /// all domains, and each domain needs a prefix of its own: with a shared one, clearing away a dead process
    /// in one domain removes files that another is just making.
    fn at(root: PathBuf) -> Result<Self, DomainError> {
        let Some(name) = root.file_name().and_then(|name| name.to_str()) else {
            return Err(DomainError::BadRoot { path: root });
        };
        let prefix = format!("{name}_");
        Self::new(root, &prefix)
    }

    /// A domain with an explicit root folder, which separates it from other domains, and an explicit prefix of
    /// its files in shared memory.
    pub fn new(root: impl Into<PathBuf>, prefix: &str) -> Result<Self, DomainError> {
        let root = root.into();
        check_name(prefix, 64)?;
        let length = root.as_os_str().len();
        let max = MAX_ROOT_LENGTH.saturating_sub(prefix.len());
        if length > max {
            return Err(DomainError::RootTooLong {
                path: root,
                length,
                max,
            });
        }
        if !root.is_absolute() || iceoryx_path(&root).is_none() {
            return Err(DomainError::BadRoot { path: root });
        }
        Ok(Self {
            root,
            prefix: prefix.into(),
        })
    }

    /// Root folder.
    pub fn root(&self) -> &FsPath {
        &self.root
    }

    /// Prefix of every file in shared memory.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// The iceoryx2 configuration of this domain.
    pub fn config(&self) -> Config {
        let mut config = Config::default();
        if let Some(root) = iceoryx_path(&self.root) {
            config.global.set_root_path(&root);
        }
        if let Ok(prefix) = FileName::new(self.prefix.as_bytes()) {
            config.global.prefix = prefix;
        }
        config
    }

    /// Removes everything that the domain left on this machine. Only for domains of one's own, when no process
    /// uses it any more.
    pub fn discard(&self) {
        sweeper::forget(self);
        // iceoryx2 never removes its management file, and the dead leave more.
        let ours = |name: &str| {
            let rest = name.strip_prefix(&self.prefix).unwrap_or("");
            let hash = rest.split('_').next().unwrap_or("");
            hash.len() == 40 && hash.bytes().all(|b| b.is_ascii_hexdigit())
        };
        let files = fs::read_dir(crate::shm::SHM_DIR).into_iter().flatten();
        for file in files.flatten() {
            if ours(&file.file_name().to_string_lossy()) {
                let _ = fs::remove_file(file.path());
            }
        }
        let _ = fs::remove_dir_all(&self.root);
    }

    /// Joins the domain; `role` becomes the node's name `cosplat-<role>`.
    pub(crate) fn join(&self, role: &str) -> Result<Node<Service>, DomainError> {
        static QUIET: Once = Once::new();
        // Refused opens are normal while a client waits for a server, and our errors say more.
        QUIET.call_once(|| set_log_level_from_env_or(LogLevel::Fatal));
        self.claim_root()?;
        self.write_config();
        sweeper::watch(self);
        management::claim(self)?;
        let failed = |reason: String| {
            let path = self.root.clone();
            match LimitReached::behind(&reason) {
                Some(limit) => DomainError::Limit { path, limit },
                None => DomainError::Node { path, reason },
            }
        };
        let name = NodeName::new(&format!("cosplat-{role}"))
            .map_err(|error| failed(format!("the role {role:?} is not a node name ({error:?})")))?;
        NodeBuilder::new()
            .name(&name)
            .config(&self.config())
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Service>()
            .map_err(|error| failed(format!("{error}")))
    }

    /// Puts the configuration where `iox2`, the command line of iceoryx2, finds it when run in the root folder;
    /// and makes it this process's default, which iceoryx2 uses to clean up after nodes that died too early to
    /// have left their own.
    fn write_config(&self) {
        static DEFAULT: Once = Once::new();
        let folder = self.root.join("config");
        let file = self.root.join(CONFIGURATION);
        let text = format!(
            "[global]\nroot-path = {:?}\nprefix = {:?}\n",
            self.root, self.prefix
        );
        let write = || -> std::io::Result<()> {
            if fs::read_to_string(&file).is_ok_and(|old| old == text) {
                return Ok(());
            }
            fs::create_dir_all(&folder)?;
            // In one go: others may be reading.
            let new = folder.join(format!("new-{}", std::process::id()));
            fs::write(&new, &text)?;
            fs::rename(&new, &file)
        };
        if let Err(error) = write() {
            tracing::warn!(%error, "{} cannot be written", file.display());
        }
        DEFAULT.call_once(|| {
            let path = FilePath::new(file.as_os_str().as_encoded_bytes());
            if path.is_ok_and(|path| Config::setup_global_config_from_file(&path).is_err()) {
                tracing::warn!("{} cannot be read", file.display());
            }
        });
    }

    /// Makes the root folder for this user alone, or checks that it is.
    fn claim_root(&self) -> Result<(), DomainError> {
        let io = |cause| DomainError::Io {
            path: self.root.clone(),
            cause,
        };
        fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&self.root)
            .map_err(io)?;
        let found = fs::symlink_metadata(&self.root).map_err(io)?;
        if !found.is_dir() {
            return Err(DomainError::NotAFolder {
                path: self.root.clone(),
            });
        }
        let owner = found.uid();
        let user = rustix::process::getuid().as_raw();
        if owner != user {
            return Err(DomainError::ForeignRoot {
                path: self.root.clone(),
                owner,
                user,
            });
        }
        let mode = found.mode() & 0o777;
        if mode & 0o077 != 0 {
            return Err(DomainError::OpenRoot {
                path: self.root.clone(),
                mode,
            });
        }
        match stranger(&self.root).map_err(io)? {
            Some(found) => Err(DomainError::NotADomain {
                path: self.root.clone(),
                found,
            }),
            None => Ok(()),
        }
    }
}

/// What makes the folder none of ours: something in it that whoever joins does not make. A domain would put hundreds of files
/// beside it.
fn stranger(root: &FsPath) -> std::io::Result<Option<String>> {
    let is_domain = root.join(CONFIGURATION).is_file()
        || ["nodes", "services"]
            .iter()
            .all(|name| root.join(name).is_dir());
    if is_domain {
        return Ok(None);
    }
    // Others may just be making it, or somebody has cleaned some of it away.
    let is_ours = |name: &str| {
        ["nodes", "services", "config"].contains(&name)
            || name.ends_with(".event")
            || (name.starts_with("session-") && name.ends_with(".lock"))
    };
    for entry in fs::read_dir(root)? {
        let name = entry?.file_name().to_string_lossy().into_owned();
        if !is_ours(&name) {
            return Ok(Some(name));
        }
    }
    Ok(None)
}

/// Releases of iceoryx2 other than ours that left their marks in the domain of `config`.
pub(crate) fn other_transports(config: &Config) -> Vec<String> {
    let ours = crate::ICEORYX2_VERSION.replace('.', "_");
    let prefix = config.global.prefix.to_string();
    let mut found: Vec<String> = fs::read_dir(crate::shm::SHM_DIR)
        .into_iter()
        .flatten()
        .filter_map(|file| file.ok()?.file_name().into_string().ok())
        .filter(|name| name.starts_with(&prefix))
        .filter_map(|name| {
            let rest = name.strip_suffix(".global_mgmt")?;
            Some(rest.rsplit_once('.')?.1.to_owned())
        })
        .filter(|version| *version != ours)
        .map(|version| version.replace('_', "."))
        .collect();
    found.sort();
    found.dedup();
    found
}

/// `TMPDIR` may differ between the terminals of one user, who would then wonder where the server is.
fn user_root() -> String {
    format!("/tmp/cosplat-{}", rustix::process::getuid().as_raw())
}

fn check_name(name: &str, max: usize) -> Result<(), DomainError> {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b == b'-' || b == b'_';
    if name.is_empty() || name.len() > max || !name.bytes().all(plain) {
        return Err(DomainError::BadName { name: name.into() });
    }
    Ok(())
}

fn iceoryx_path(path: &FsPath) -> Option<Path> {
    Path::new(path.as_os_str().as_encoded_bytes()).ok()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// The longest that leaves room for them works.
    #[test]
    fn a_root_too_long_for_sockets_is_refused() {
        let prefix = "cosplat_test_".to_string();
        let root = |length: usize| {
            let start = format!("/tmp/cplen{}", std::process::id());
            PathBuf::from(format!("{start}{}", "x".repeat(length - start.len())))
        };
        let max = MAX_ROOT_LENGTH - prefix.len();
        let error = Domain::new(root(max + 1), &prefix).expect_err("too long");
        assert!(error.to_string().contains(&format!(
            "has {} bytes, at most {max} are possible",
            max + 1
        )));
        let domain = Domain::new(root(max), &prefix).expect("a domain");
        let plan = crate::server::PoolPlan::default();
        // Makes sockets.
        let ports = crate::ServerPorts::create(&domain, &"s".repeat(64), &plan);
        assert!(ports.is_ok(), "{:?}", ports.err());
        drop(ports);
        domain.discard();
        let left = fs::read_dir(crate::shm::SHM_DIR).expect("shared memory");
        let ours = |name: &str| name.starts_with(&prefix);
        assert_eq!(
            left.flatten()
                .filter(|f| ours(&f.file_name().to_string_lossy()))
                .count(),
            0
        );
        assert!(!domain.root().exists());
    }

    #[test]
    fn the_command_line_of_iceoryx2_finds_the_domain() {
        let name = format!("conf{}", std::process::id());
        let domain = Domain::named(&name).expect("a domain");
        drop(domain.join("test").expect("joined"));
        let file = domain.root().join("config/iceoryx2.toml");
        let path = FilePath::new(file.as_os_str().as_encoded_bytes()).expect("a path");
        let found = Config::from_file(&path).expect("a configuration");
        assert_eq!(found, domain.config());
        domain.discard();
    }

    #[test]
    fn odd_names_are_refused() {
        for name in ["", "a b", "a/b", "ü", &"x".repeat(25)] {
            assert!(matches!(
                Domain::named(name),
                Err(DomainError::BadName { .. })
            ));
        }
        assert!(matches!(
            Domain::new("relative", "p"),
            Err(DomainError::BadRoot { .. })
        ));
    }

    #[test]
    fn a_root_that_is_open_to_others_or_a_link_is_refused() {
        let root = PathBuf::from(format!("/tmp/cpopen{}", std::process::id()));
        let link = PathBuf::from(format!("/tmp/cplink{}", std::process::id()));
        fs::create_dir(&root).expect("made");
        std::os::unix::fs::symlink(&root, &link).expect("linked");
        let refusal = |root: &FsPath| {
            let domain = Domain::new(root, "p").expect("a domain");
            domain.join("test").expect_err("refused")
        };
        for mode in [0o777, 0o1777, 0o755, 0o710, 0o701] {
            fs::set_permissions(&root, fs::Permissions::from_mode(mode)).expect("opened");
            let error = refusal(&root);
            assert!(
                matches!(error, DomainError::OpenRoot { mode: m, .. } if m == mode & 0o777),
                "{error}"
            );
            assert!(error.to_string().contains("chmod 700"), "{error}");
        }
        fs::set_permissions(&root, fs::Permissions::from_mode(0o700)).expect("closed");
        let error = refusal(&link);
        assert!(matches!(error, DomainError::NotAFolder { .. }), "{error}");
        // Nothing was put where the link leads.
        assert_eq!(fs::read_dir(&root).expect("a folder").count(), 0);
        fs::remove_file(&link).expect("removed");
        fs::remove_dir(&root).expect("removed");
    }

    #[test]
    fn a_folder_that_is_neither_empty_nor_a_domain_is_refused() {
        let name = format!("cphome{}", std::process::id());
        let root = PathBuf::from(format!("/tmp/{name}"));
        fs::DirBuilder::new()
            .mode(0o700)
            .create(&root)
            .expect("made");
        // A home folder may have one of these.
        fs::create_dir(root.join("config")).expect("made");
        fs::write(root.join(".bashrc"), "").expect("written");
        let domain = Domain::new(&root, &format!("{name}_")).expect("a domain");
        let error = domain.join("test").expect_err("refused");
        assert!(
            matches!(&error, DomainError::NotADomain { found, .. } if found == ".bashrc"),
            "{error}"
        );
        assert_eq!(fs::read_dir(&root).expect("a folder").count(), 2);
        fs::remove_file(root.join(".bashrc")).expect("removed");
        drop(domain.join("test").expect("it is just being made"));
        // What a user puts into a domain does not end it, and neither does who cleans its folder away.
        fs::write(root.join("notes"), "").expect("written");
        drop(domain.join("test").expect("it is a domain"));
        fs::remove_file(root.join("notes")).expect("removed");
        for name in ["config", "nodes", "services"] {
            let folder = root.join(name);
            if folder.exists() {
                fs::remove_dir_all(folder).expect("removed");
            }
        }
        fs::write(root.join("session-demo.lock"), "").expect("written");
        drop(domain.join("test").expect("joined"));
        domain.discard();
    }

    #[test]
    fn a_folder_of_another_user_is_refused() {
        if !rustix::process::getuid().is_root() {
            // Anybody else: the root folder of the system is root's.
            let domain = Domain::new("/", "p").expect("a domain");
            let error = domain.join("test").expect_err("not ours");
            assert!(matches!(error, DomainError::ForeignRoot { owner: 0, .. }));
            return;
        }
        let root = PathBuf::from(format!("/tmp/cpown{}", std::process::id()));
        fs::create_dir(&root).expect("made");
        std::os::unix::fs::chown(&root, Some(12345), None).expect("given away");
        let error = Domain::new(&root, "p")
            .expect("a domain")
            .join("test")
            .expect_err("not ours");
        assert!(matches!(
            error,
            DomainError::ForeignRoot { owner: 12345, .. }
        ));
        fs::remove_dir(&root).expect("removed");
    }
}
