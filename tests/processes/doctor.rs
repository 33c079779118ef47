//! Recordings rewritten with one thing changed, every checksum made anew.

use std::{borrow::Cow, collections::BTreeMap, fs, path::Path};

/// A message of a recording.
pub struct Message {
    pub topic: String,
    pub step: u32,
    pub data: Vec<u8>,
}

/// Writes the recording `from` to `to` with metadata and messages as `change` leaves them; a message is left out where
/// it says `false`.
pub fn rewrite(
    from: &Path,
    to: &Path,
    metadata: impl Fn(&mut BTreeMap<String, String>),
    change: impl FnMut(&mut Message) -> bool,
) {
    rewrite_all(from, to, metadata, |_, _| {}, change);
}

/// Writes the recording `from` to `to` with attachments as `change` leaves them, by their names.
pub fn rewrite_scene(from: &Path, to: &Path, change: impl FnMut(&str, &mut Vec<u8>)) {
    rewrite_all(from, to, |_| {}, change, |_| true);
}

fn rewrite_all(
    from: &Path,
    to: &Path,
    metadata: impl Fn(&mut BTreeMap<String, String>),
    mut attached: impl FnMut(&str, &mut Vec<u8>),
    mut change: impl FnMut(&mut Message) -> bool,
) {
    let bytes = fs::read(from).expect("a recording");
    let summary = mcap::Summary::read(&bytes)
        .expect("a summary")
        .expect("one");
    let file = fs::File::create(to).expect("a file");
    let options = mcap::WriteOptions::new().compression(None);
    let mut writer = options
        .create(std::io::BufWriter::new(file))
        .expect("a writer");
    for index in &summary.metadata_indexes {
        let mut record = mcap::read::metadata(&bytes, index).expect("metadata");
        metadata(&mut record.metadata);
        writer.write_metadata(&record).expect("written");
    }
    for index in &summary.attachment_indexes {
        let mut attachment = mcap::read::attachment(&bytes, index).expect("an attachment");
        attached(&attachment.name, attachment.data.to_mut());
        writer.attach(&attachment).expect("written");
    }
    for message in mcap::MessageStream::new(&bytes).expect("messages") {
        let mut message = message.expect("a message");
        let mut changed = Message {
            topic: message.channel.topic.clone(),
            step: message.sequence,
            data: message.data.into_owned(),
        };
        if change(&mut changed) {
            let mut channels = summary.channels.values();
            let channel = channels.find(|channel| channel.topic == changed.topic);
            message.channel = channel.expect("a topic of the file").clone();
            message.data = Cow::Owned(changed.data);
            writer.write(&message).expect("written");
        }
    }
    writer.finish().expect("finished");
}
