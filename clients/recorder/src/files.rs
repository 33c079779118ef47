//! The files that a run was made of, as attachments: with them it can be simulated again elsewhere.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read;
use std::path::Path;

use cosplat_ipc::schema::{SCENE_FILE_ASSET, SCENE_FILE_CHECKPOINT, SceneFile};
use xxhash_rust::xxh3::xxh3_64;

use crate::reader::LENGTH_LIMIT;
use crate::topics::FILES_PREFIX;

/// Kind of a file in the metadata: a splat or mesh that the scene names.
pub const ASSET: &str = "asset";
/// Kind of a file in the metadata: the checkpoint that the run began with.
pub const CHECKPOINT: &str = "checkpoint";

/// A file that the server read, as the recording keeps it.
pub(crate) struct KeptFile {
    kind: &'static str,
    name: String,
    bytes: u64,
    hash: u64,
    /// Name of its attachment.
    pub attachment: String,
    /// What is to be attached: nothing more where the recording has it already; or why it cannot be had.
    pub content: Result<Vec<u8>, String>,
}

impl KeptFile {
    /// Reads `file` unless `attached` names its attachment.
    pub fn read(file: &SceneFile, attached: &BTreeSet<String>) -> Self {
        let name = file.name().unwrap_or_default().to_owned();
        let last = Path::new(&name).file_name().unwrap_or_default();
        let attachment = format!("{FILES_PREFIX}{:016x}/{}", file.hash, last.display());
        let content = match attached.contains(&attachment) {
            true => Ok(Vec::new()),
            false => content(file),
        };
        if let Err(reason) = &content {
            tracing::warn!("the recording cannot be verified: {reason}");
        }
        Self {
            kind: match file.kind {
                SCENE_FILE_ASSET => ASSET,
                SCENE_FILE_CHECKPOINT => CHECKPOINT,
                _ => "unknown",
            },
            name,
            bytes: file.length,
            hash: file.hash,
            attachment,
            content,
        }
    }
}

/// The content of a file, if it still is what the server read. Another process named it: nothing but a plain file of the
/// announced length is opened, and nothing but the announced content is kept.
fn content(file: &SceneFile) -> Result<Vec<u8>, String> {
    let path = file
        .path()
        .map_err(|e| format!("the path of a file of the scene is no text: {e}"))?;
    let unreadable = |e: std::io::Error| format!("cannot read {path}: {e}");
    let found = std::fs::metadata(path).map_err(unreadable)?;
    let changed = |what: &str, found: String, expected: String| {
        format!("{path} is not what the server read: its {what} is {found}, expected {expected}")
    };
    if !found.is_file() {
        return Err(format!("{path} is no plain file"));
    }
    if found.len() != file.length {
        let (found, expected) = (found.len().to_string(), file.length.to_string());
        return Err(changed("length", found, expected));
    }
    if file.length > LENGTH_LIMIT as u64 {
        return Err(format!(
            "{path} has {} bytes, an attachment at most {LENGTH_LIMIT}",
            file.length
        ));
    }
    let mut content = Vec::new();
    File::open(path)
        .and_then(|f| f.take(file.length).read_to_end(&mut content))
        .map_err(unreadable)?;
    let hash = xxh3_64(&content);
    if hash != file.hash {
        let (found, expected) = (format!("{hash:016x}"), format!("{:016x}", file.hash));
        return Err(changed("hash", found, expected));
    }
    Ok(content)
}

/// Puts the list of files into the metadata of a run.
pub(crate) fn describe(files: &[KeptFile], metadata: &mut BTreeMap<String, String>) {
    metadata.insert("file_count".to_owned(), files.len().to_string());
    for (n, file) in files.iter().enumerate() {
        let mut put = |key: &str, value: String| metadata.insert(format!("file.{n}.{key}"), value);
        put("kind", file.kind.to_owned());
        put("name", file.name.clone());
        put("bytes", file.bytes.to_string());
        put("hash", format!("{:016x}", file.hash));
        match &file.content {
            Ok(_) => put("attachment", file.attachment.clone()),
            Err(reason) => put("missing", reason.clone()),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(path: &Path, content: &[u8]) -> KeptFile {
        let (path, hash) = (path.to_str().expect("text"), xxh3_64(content));
        let length = content.len() as u64;
        let file = SceneFile::new(SCENE_FILE_ASSET, "../a/vase.ply", path, length, hash);
        KeptFile::read(&file, &BTreeSet::new())
    }

    #[test]
    fn only_what_the_server_read_is_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("vase.ply");
        std::fs::write(&path, b"splats").expect("written");
        let same = kept(&path, b"splats");
        assert_eq!(same.content.as_deref(), Ok(&b"splats"[..]));
        let hash = xxh3_64(b"splats");
        assert_eq!(same.attachment, format!("files/{hash:016x}/vase.ply"));
        for (announced, words) in [
            (&b"splash"[..], "hash"),
            (b"splats and more", "length is 6, expected 15"),
        ] {
            let reason = kept(&path, announced).content.expect_err("another file");
            assert!(reason.contains("not what the server read"), "{reason}");
            assert!(reason.contains(words), "{words:?} not in {reason}");
        }
        let reason = kept(&folder.path().join("gone"), b"").content;
        assert!(reason.expect_err("no file").contains("No such file"));
        let reason = kept("/dev/zero".as_ref(), b"").content;
        assert!(reason.expect_err("a device").contains("no plain file"));
    }
}
