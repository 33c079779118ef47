//! The one file of a domain whose name anybody can foretell: the counter from which iceoryx2 numbers its nodes.
//!
//! iceoryx2 0.10.0 makes it for all users (mode 0666) and believes what it finds. Another user could write to it, and
//! nobody could join any more; empty it, and whoever joined would wait for ever; or make it first. So it is made here,
//! for its owner alone, and looked at before every join. A process maps it only while it makes a node, and a number
//! need not be new: ids also hold the time and the process. A wrong one is therefore replaced without harm to anybody.

use std::{
    fs,
    hash::{BuildHasher, RandomState},
    io::{self, Write},
    os::unix::fs::{MetadataExt, OpenOptionsExt},
    path::{Path, PathBuf},
};

use crate::{Domain, DomainError, shm::SHM_DIR};

/// Name after the prefix: SHA-1 of iceoryx2's `iceoryx2::node::global_management_segment::State`, `node`, release.
const NAME: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt";
/// What the file begins with: `major << 32 | minor << 16 | patch`. The counter and four unused bytes follow.
const VERSION: u64 = 10 << 16;
const LENGTH: usize = 16;
const MODE: u32 = 0o600;

/// Makes the file, or makes sure that it is this user's alone and sound.
///
/// # Errors
/// When it belongs to somebody else, or cannot be made; both name it.
pub(crate) fn claim(domain: &Domain) -> Result<(), DomainError> {
    let path = file(domain);
    let failed = |cause| DomainError::File {
        path: path.clone(),
        cause,
    };
    if !is_sound(&path)? {
        let new = make_new(domain).map_err(failed)?;
        // In one go: others are joining. The folder lets nobody but its owner replace a file.
        if let Err(error) = fs::rename(&new, &path) {
            let _ = fs::remove_file(&new);
            return Err(failed(error));
        }
    }
    Ok(())
}

/// Path of the file.
fn file(domain: &Domain) -> PathBuf {
    Path::new(SHM_DIR).join(format!("{}{NAME}", domain.prefix()))
}

/// Whether nobody else can have written to the file and iceoryx2 takes it.
fn is_sound(path: &Path) -> Result<bool, DomainError> {
    let failed = |cause| DomainError::File {
        path: path.into(),
        cause,
    };
    let found = match fs::symlink_metadata(path) {
        Ok(found) => found,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(failed(error)),
    };
    let (owner, user) = (found.uid(), rustix::process::getuid().as_raw());
    if owner != user {
        return Err(DomainError::ForeignFile {
            path: path.into(),
            owner,
            user,
        });
    }
    if !found.is_file() || found.mode() & 0o7777 != MODE || found.len() != LENGTH as u64 {
        return Ok(false);
    }
    match fs::read(path) {
        Ok(content) => Ok(content.starts_with(&VERSION.to_le_bytes())),
        // Another process was just replacing it.
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(failed(error)),
    }
}

/// A sound file under a name that nobody can foretell.
fn make_new(domain: &Domain) -> io::Result<PathBuf> {
    let number = RandomState::new().hash_one(std::process::id());
    let path = Path::new(SHM_DIR).join(format!("{}{number:040x}_new", domain.prefix()));
    let mut file = fs::OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(MODE)
        .open(&path)?;
    let mut content = [0; LENGTH];
    content[..8].copy_from_slice(&VERSION.to_le_bytes());
    let written = file.write_all(&content);
    if let Err(error) = written {
        let _ = fs::remove_file(&path);
        return Err(error);
    }
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iceoryx2_counts_in_the_file_made_here() {
        let name = format!("cpmg{}_", std::process::id());
        let domain = Domain::new(format!("/tmp/{name}"), &name).expect("a domain");
        let first = domain.join("test").expect("joined");
        let second = domain.join("test").expect("joined");
        let all = fs::read_dir(SHM_DIR).expect("shared memory").flatten();
        let files: Vec<PathBuf> = all
            .filter(|file| file.file_name().to_string_lossy().starts_with(&name))
            .map(|file| file.path())
            .filter(|path| path.extension().is_some_and(|e| e == "global_mgmt"))
            .collect();
        assert_eq!(files, [file(&domain)]);
        let mode = fs::metadata(&files[0]).expect("metadata").mode();
        assert_eq!(mode & 0o7777, MODE);
        let mut counted = [0; LENGTH];
        counted[..8].copy_from_slice(&VERSION.to_le_bytes());
        counted[8] = 2;
        assert_eq!(fs::read(&files[0]).expect("content"), counted);
        drop((first, second));
        domain.discard();
    }
}
