//! Opens files that are read whole: plain ones of a size that one can mean, whatever a name leads to.

use std::{
    fs::{File, OpenOptions},
    io::{self, Read},
    os::unix::fs::OpenOptionsExt,
    path::Path,
};

use rustix::fs::OFlags;

/// Largest file of text that is read [byte]: more than any scene has, and what a reader of text may take many times over.
pub const LARGEST_TEXT: u64 = 64 << 20;
/// Largest file of splats, meshes, arrays or pictures that is read [byte].
pub const LARGEST_DATA: u64 = 16 << 30;

/// Opens a plain file of at most so many bytes.
///
/// # Errors
/// Those of the operating system; [`io::ErrorKind::InvalidInput`] for a device, a pipe or a socket, none of which is waited for, and
/// [`io::ErrorKind::FileTooLarge`] for a larger file.
pub fn open(path: &Path, most: u64) -> io::Result<File> {
    // A pipe without a writer would keep whoever opens it waiting.
    let flags = (OFlags::NONBLOCK | OFlags::NOCTTY).bits();
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(flags.cast_signed())
        .open(path)?;
    let found = file.metadata()?;
    if found.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    if !found.is_file() {
        let what = "a device, a pipe or a socket, expected a plain file";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    within(found.len(), most)?;
    Ok(file)
}

/// The content of a plain file of at most so many bytes.
///
/// # Errors
/// Those of [`open`] and of reading.
pub fn read(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = open(path, most)?;
    let expected = usize::try_from(file.metadata()?.len()).unwrap_or(usize::MAX);
    let mut content = Vec::new();
    let room = content.try_reserve_exact(expected);
    room.map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
    // It may grow while it is read, and some of the system's say that they are empty.
    file.take(most.saturating_add(1))
        .read_to_end(&mut content)?;
    within(content.len() as u64, most)?;
    Ok(content)
}

/// The text of a plain file of at most [`LARGEST_TEXT`].
///
/// # Errors
/// Those of [`read`], and [`io::ErrorKind::InvalidData`] for what is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let content = read(path, LARGEST_TEXT)?;
    String::from_utf8(content).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
}

fn within(found: u64, most: u64) -> io::Result<()> {
    if found <= most {
        return Ok(());
    }
    let what = format!("has {found} bytes or more, expected at most {most}");
    Err(io::Error::new(io::ErrorKind::FileTooLarge, what))
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixListener;

    use rustix::fs::{CWD, FileType, Mode, mknodat};

    use super::*;

    #[test]
    fn a_plain_file_is_read_whole() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("some.toml");
        std::fs::write(&path, "äöü").expect("written");
        let link = folder.path().join("link.toml");
        std::os::unix::fs::symlink(&path, &link).expect("linked");
        for path in [&path, &link] {
            assert_eq!(read_text(path).expect("a text"), "äöü");
            assert_eq!(read(path, 6).expect("its size").len(), 6);
            let error = read(path, 5).expect_err("longer");
            assert_eq!(error.kind(), io::ErrorKind::FileTooLarge);
            assert_eq!(error.to_string(), "has 6 bytes or more, expected at most 5");
        }
        std::fs::write(&path, [0xff]).expect("written");
        let error = read_text(&path).expect_err("no text");
        assert_eq!(error.kind(), io::ErrorKind::InvalidData);
        let error = read_text(&folder.path().join("none")).expect_err("nothing there");
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn what_is_no_plain_file_is_refused_at_once() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [pipe, socket] = ["pipe", "socket"].map(|name| folder.path().join(name));
        mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR, 0).expect("a pipe");
        let _listener = UnixListener::bind(&socket).expect("a socket");
        for path in [&pipe, Path::new("/dev/zero"), Path::new("/dev/null")] {
            let error = read(path, LARGEST_DATA).expect_err("no file");
            assert_eq!(error.kind(), io::ErrorKind::InvalidInput, "{error}");
            assert!(error.to_string().contains("expected a plain file"));
        }
        // The system refuses sockets itself.
        assert!(read(&socket, LARGEST_DATA).is_err());
        let error = read(folder.path(), LARGEST_DATA).expect_err("a folder");
        assert_eq!(error.kind(), io::ErrorKind::IsADirectory);
        // Of a length that nobody means, though it takes no room on the disk.
        let sparse = folder.path().join("sparse.ply");
        let file = File::create(&sparse).expect("made");
        file.set_len(LARGEST_DATA + 1).expect("set");
        let error = read(&sparse, LARGEST_DATA).expect_err("too large");
        assert_eq!(error.kind(), io::ErrorKind::FileTooLarge);
    }
}
