//! How files are opened and written.
//!
//! A file in the making lies beside its place under a random name, and gets its own when it is complete. So a reader never sees
//! half a file, and a run that fails or a disk that is full leaves the file that was there. Only what is useful before it is
//! complete, a recording, has its own name from the beginning, and that only where nothing has it.

pub mod reading;

use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use tempfile::TempPath;

/// End of the name of a file in the making, behind its own name and random letters.
pub const UNFINISHED: &str = ".unfinished";

/// Most bytes of the own name in the name of a file in the making: a name has at most 255.
const MOST_OF_NAME: usize = 200;
/// Links that are followed one after the other, as the kernel does it.
const MOST_LINKS: usize = 40;

/// What becomes of a file that has the name already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// It stays, and writing is refused with [`io::ErrorKind::AlreadyExists`].
    Stays,
    /// It stays until the new one is complete.
    IsReplaced,
}

/// An output that is one of the files it is made of.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: it is the same file as {}, which it is made of; choose another output", output.display(), input.display())]
pub struct OntoInput {
    /// The output.
    pub output: PathBuf,
    /// The input that is the same file.
    pub input: PathBuf,
}

/// A file in the making. One that is dropped before [`finish`](Self::finish) leaves what was there.
#[derive(Debug)]
pub struct NewFile {
    file: File,
    place: Place,
}

/// Where the bytes go.
#[derive(Debug)]
enum Place {
    /// To the place itself: nothing was there, or it is no plain file and has nothing to lose.
    Own(PathBuf),
    /// Beside it.
    Beside {
        unfinished: TempPath,
        own: PathBuf,
        existing: Existing,
    },
}

impl NewFile {
    /// Begins a file beside its place. What is no plain file (a device, a pipe) is written to as it is.
    ///
    /// # Errors
    /// When the place is a folder, holds something that may not be replaced, or no file can be made beside it.
    pub fn create(path: &Path, existing: Existing) -> io::Result<Self> {
        Self::begin(path, existing, true)
    }

    /// Begins a file that is of use before it is complete. It has its own name at once where nothing has it. Otherwise it lies
    /// beside its place, and stays there if it is never completed.
    ///
    /// # Errors
    /// As in [`create`](Self::create).
    pub fn stream(path: &Path, existing: Existing) -> io::Result<Self> {
        if existing == Existing::IsReplaced && path.symlink_metadata().is_ok() {
            return Self::begin(path, existing, false);
        }
        Ok(Self {
            file: File::options().write(true).create_new(true).open(path)?,
            place: Place::Own(path.to_owned()),
        })
    }

    fn begin(path: &Path, existing: Existing, goes_with_failure: bool) -> io::Result<Self> {
        let own = own_place(path)?;
        let found = match own.metadata() {
            Ok(found) => Some(found),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(error),
        };
        if let Some(found) = &found {
            if found.is_dir() {
                return Err(io::ErrorKind::IsADirectory.into());
            }
            if existing == Existing::Stays {
                return Err(io::ErrorKind::AlreadyExists.into());
            }
            // One that may not be written is not replaced either.
            let file = File::options().append(true).open(&own)?;
            if !found.is_file() {
                let place = Place::Own(own);
                return Ok(Self { file, place });
            }
            if is_handle(&own) {
                // Behind what is there, but not at the end alone: formats go back in what they have written.
                let mut file = File::options().write(true).open(&own)?;
                file.seek(SeekFrom::End(0))?;
                let place = Place::Own(own);
                return Ok(Self { file, place });
            }
        }
        let mode = found.map_or(0o666, |found| found.permissions().mode() & 0o777);
        let name = own.file_name().unwrap_or_default().as_bytes();
        let mut start = OsString::from(OsStr::from_bytes(&name[..name.len().min(MOST_OF_NAME)]));
        start.push(".");
        let folder = own.parent().unwrap_or(Path::new("."));
        let made = tempfile::Builder::new()
            .prefix(&start)
            .suffix(UNFINISHED)
            .permissions(fs::Permissions::from_mode(mode))
            .disable_cleanup(!goes_with_failure)
            .tempfile_in(folder)?;
        let (file, unfinished) = made.into_parts();
        Ok(Self {
            file,
            place: Place::Beside {
                unfinished,
                own,
                existing,
            },
        })
    }

    /// The open file.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Where the bytes go at present.
    pub fn path(&self) -> &Path {
        match &self.place {
            Place::Own(path) => path,
            Place::Beside { unfinished, .. } => unfinished,
        }
    }

    /// Gives the file its name. What others buffer of it has to be written before.
    ///
    /// # Errors
    /// When something has that name and stays, or the system refuses; then what was there is as it was.
    pub fn finish(self) -> io::Result<()> {
        let Place::Beside {
            unfinished,
            own,
            existing,
        } = self.place
        else {
            return Ok(());
        };
        let named = match existing {
            Existing::Stays => unfinished.persist_noclobber(&own),
            Existing::IsReplaced => {
                if own.exists() {
                    // A name that is on the disk before its content would lose both files with the power.
                    self.file.sync_data()?;
                }
                unfinished.persist(&own)
            }
        };
        named.map_err(|refused| refused.error)
    }
}

/// Writes a whole file in place of what has that name.
///
/// # Errors
/// As [`NewFile`] says.
pub fn write(path: &Path, content: impl AsRef<[u8]>) -> io::Result<()> {
    write_with(path, |file| file.write_all(content.as_ref()))
}

/// Has a whole file written in place of what has that name.
///
/// # Errors
/// As [`NewFile`] says, or the error of `put`.
pub fn write_with<E: From<io::Error>>(
    path: &Path,
    put: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>,
) -> Result<(), E> {
    let new = NewFile::create(path, Existing::IsReplaced)?;
    let mut file = BufWriter::new(new.file());
    put(&mut file)?;
    file.flush()?;
    drop(file);
    Ok(new.finish()?)
}

/// Whether two paths lead to one file, by whatever links and mounts.
pub fn is_same(one: &Path, other: &Path) -> bool {
    let place = |path: &Path| path.metadata().map(|found| (found.dev(), found.ino()));
    matches!((place(one), place(other)), (Ok(one), Ok(other)) if one == other)
}

/// Makes sure that an output is none of the files that it is made of.
///
/// # Errors
/// When it is.
pub fn keep_apart<P: AsRef<Path>>(
    output: &Path,
    inputs: impl IntoIterator<Item = P>,
) -> Result<(), OntoInput> {
    let inputs = inputs.into_iter();
    match inputs
        .into_iter()
        .find(|input| is_same(output, input.as_ref()))
    {
        None => Ok(()),
        Some(input) => Err(OntoInput {
            output: output.to_owned(),
            input: input.as_ref().to_owned(),
        }),
    }
}

/// Where a file of this name would be made: behind links, as far as they lead.
fn own_place(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_owned();
    for _ in 0..MOST_LINKS {
        let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.canonicalize()?,
            _ => Path::new(".").canonicalize()?,
        };
        let own = folder.join(name);
        match fs::read_link(&own) {
            Ok(_) if is_handle(&own) => return Ok(own),
            Ok(next) => path = folder.join(next),
            Err(_) => return Ok(own),
        }
    }
    Err(io::Error::from_raw_os_error(
        rustix::io::Errno::LOOP.raw_os_error(),
    ))
}

/// Whether a place is an open file of a process, such as `/dev/stdout`: its name is not a file's.
fn is_handle(own: &Path) -> bool {
    own.starts_with("/proc")
}

#[cfg(test)]
mod tests;
