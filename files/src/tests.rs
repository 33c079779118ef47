//! What was there stays until the new file is complete, whatever happens on the way.

use std::os::unix::fs::{MetadataExt, symlink};

use super::*;

const OLD: &str = "what was there";

/// A folder with a file in it.
fn with_file() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    fs::write(&path, OLD).expect("written");
    (folder, path)
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).expect("a file")
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a folder");
    let mut names: Vec<_> = entries
        .map(|entry| entry.expect("an entry").file_name())
        .map(|name| name.to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn the_old_file_stays_until_the_new_one_is_complete() {
    let (folder, path) = with_file();
    let new = NewFile::create(&path, Existing::IsReplaced).expect("begun");
    new.file().write_all(b"new").expect("written");
    assert_eq!(read(&path), OLD);
    let unfinished = names(folder.path()).pop().expect("a second file");
    assert!(unfinished.starts_with("run.mcap.") && unfinished.ends_with(UNFINISHED));
    new.finish().expect("named");
    assert_eq!(read(&path), "new");
    assert_eq!(names(folder.path()), ["run.mcap"]);
}

#[test]
fn a_file_that_fails_on_the_way_leaves_nothing() {
    let (folder, path) = with_file();
    let full = io::ErrorKind::StorageFull;
    let failed = write_with(&path, |file| {
        file.write_all(b"half")?;
        Err(io::Error::from(full))
    });
    assert_eq!(failed.expect_err("a full disk").kind(), full);
    assert_eq!(read(&path), OLD);
    assert_eq!(names(folder.path()), ["run.mcap"]);
}

#[test]
fn what_stays_is_not_written_to() {
    let (folder, path) = with_file();
    for begun in [NewFile::create, NewFile::stream] {
        let refused = begun(&path, Existing::Stays).expect_err("there is one");
        assert_eq!(refused.kind(), io::ErrorKind::AlreadyExists);
    }
    // One that came meanwhile stays as well.
    let late = folder.path().join("late");
    let new = NewFile::create(&late, Existing::Stays).expect("begun");
    fs::write(&late, OLD).expect("written");
    let refused = new.finish().expect_err("there is one");
    assert_eq!(refused.kind(), io::ErrorKind::AlreadyExists);
    assert_eq!(read(&late), OLD);
    assert_eq!(names(folder.path()), ["late", "run.mcap"]);
}

#[test]
fn a_stream_has_its_name_at_once_where_nothing_is_lost() {
    let (folder, path) = with_file();
    let new = folder.path().join("new");
    let stream = NewFile::stream(&new, Existing::IsReplaced).expect("begun");
    assert_eq!(stream.path(), new);
    stream.finish().expect("complete");
    // Beside an old one it stays where it is if it is never completed.
    let stream = NewFile::stream(&path, Existing::IsReplaced).expect("begun");
    let unfinished = stream.path().to_owned();
    stream.file().write_all(b"half").expect("written");
    drop(stream);
    assert_eq!((&*read(&path), &*read(&unfinished)), (OLD, "half"));
}

#[test]
fn one_file_is_known_by_all_its_names() {
    let (folder, path) = with_file();
    let of = |name: &str| folder.path().join(name);
    let (hard, soft, other) = (of("hard"), of("soft"), of("other"));
    fs::hard_link(&path, &hard).expect("a link");
    symlink(&path, &soft).expect("a link");
    fs::write(&other, OLD).expect("written");
    for output in [&path, &hard, &soft] {
        let refused = keep_apart(output, [&other, &path]).expect_err("the same file");
        assert_eq!(refused.input, path);
    }
    keep_apart(&other, [&path]).expect("another file");
    keep_apart(&of("none"), [&path, &of("none")]).expect("no file");
    // Written to nevertheless, a second name loses its hold on the first, which keeps its content.
    write(&hard, "new").expect("written");
    assert_eq!((&*read(&path), &*read(&hard)), (OLD, "new"));
}

#[test]
fn links_are_followed_and_stay_links() {
    let (folder, path) = with_file();
    let (link, dangling) = (folder.path().join("link"), folder.path().join("dangling"));
    symlink("run.mcap", &link).expect("a link");
    symlink("absent", &dangling).expect("a link");
    write(&link, "new").expect("written");
    write(&dangling, "new").expect("written");
    assert_eq!(read(&path), "new");
    assert_eq!(
        names(folder.path()),
        ["absent", "dangling", "link", "run.mcap"]
    );
    assert!(link.is_symlink() && dangling.is_symlink());
    let ring = folder.path().join("ring");
    symlink("ring", &ring).expect("a link");
    assert!(write(&ring, "new").is_err());
}

#[test]
fn the_rights_of_the_old_file_are_kept() {
    let (_folder, path) = with_file();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).expect("changed");
    write(&path, "new").expect("written");
    assert_eq!(path.metadata().expect("a file").mode() & 0o777, 0o640);
}

#[test]
fn what_is_no_plain_file_is_written_to_as_it_is() {
    write(Path::new("/dev/null"), "new").expect("a device");
    assert!(!Path::new("/dev/null").metadata().expect("there").is_file());
    let (folder, path) = with_file();
    let file = File::options().append(true).open(&path).expect("a file");
    let handle = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&file));
    write(Path::new(&handle), ", and more").expect("an open file");
    assert_eq!(read(&path), format!("{OLD}, and more"));
    assert!(write(folder.path(), "new").is_err());
    assert!(write(&path.join("below a file"), "new").is_err());
}
