//! Recordings: read, surveyed, read from any chunk on, recovered.

use std::{
    fs::File,
    os::{fd::AsRawFd, unix::fs::FileExt},
    path::{Path, PathBuf},
};

use cosplat_ipc::{
    schema::{
        AppliedCommand, CHANGE_FORM, CHANGE_GAUSSIANS, CHANGE_PLACED, COMMAND_IMPULSE, ChangeSlot,
        ChangesHeader, Command, FrameHeader, GaussianRest, GaussianState, ObjectChange, ObjectInfo,
        ObjectState, ObjectsHeader, SceneHeader, Status, padded, row_slots,
    },
    server::SceneBlocks,
};
use cosplat_recorder::{
    RecordingError,
    chunks::Chunks,
    compact::compact,
    messages::{GapReason, GapRecord, Hex64, JournalEntry},
    reader::Recording,
    recover::recover,
    writer::{Compression, RecordingWriter, WriterOptions},
};
use cosplat_replay::survey::Survey;
use rustix::fs::{MemfdFlags, memfd_create};

/// Opcodes of the records that are looked into here.
const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHUNK: u8 = 0x06;
const ATTACHMENT: u8 = 0x09;
const DATA_END: u8 = 0x0f;
/// Opcodes of indexes and sums, which no reader here looks at.
const INDEXES: [u8; 6] = [0x07, 0x08, 0x0a, 0x0b, 0x0d, 0x0e];
/// First bytes of a file, and of records that follow [byte].
const MAGIC: usize = 8;
/// Opcode and length in front of a record [byte].
const FRAMING: usize = 9;
/// Header of a chunk without compression [byte].
const CHUNK_HEADER: usize = 40;

/// A file in memory.
struct MemoryFile(File);

impl MemoryFile {
    fn new() -> Self {
        let file = memfd_create("recording", MemfdFlags::CLOEXEC);
        Self(file.expect("a file in memory can be made").into())
    }

    /// A path at which it can be opened.
    fn path(&self) -> PathBuf {
        format!("/proc/self/fd/{}", self.0.as_raw_fd()).into()
    }
}

thread_local! {
    static FILES: [MemoryFile; 2] = [MemoryFile::new(), MemoryFile::new()];
}

/// Reads all events; the error that ended it.
fn read_all(path: &Path) -> Option<RecordingError> {
    match Recording::open(path) {
        Err(error) => Some(error),
        Ok(events) => events.filter_map(Result::err).next(),
    }
}

/// Reads every chunk for itself.
fn read_chunks(path: &Path) -> Result<(), RecordingError> {
    let mut chunks = Chunks::open(path)?;
    chunks.matter()?;
    (0..chunks.count()).try_for_each(|chunk| chunks.read(chunk).map(drop))
}

/// A file: read and surveyed, which may fail, and recovered, after which no byte of it is damaged.
pub fn read(data: &[u8]) {
    FILES.with(|[input, output]| {
        let written = input
            .0
            .set_len(0)
            .and_then(|()| input.0.write_all_at(data, 0));
        written.expect("memory takes any bytes");
        let path = input.path();
        // What is wrong with it is one matter of many; that it is said is all.
        let error = read_all(&path);
        if error.is_none()
            && let Err(error) = Survey::of(&path)
        {
            panic!("it can be read and not surveyed: {error}");
        }
        drop(read_chunks(&path));
        if let Ok(report) = recover(&path, &output.path(), true)
            && let Some(RecordingError::Damaged { cause, .. }) = read_all(&output.path())
        {
            panic!("recovered and damaged: {cause}; {report:?}");
        }
    });
}

/// A short recording in a file of its own, by what `step` writes of each step.
fn recording(compression: Compression, step: fn(&mut RecordingWriter, u64)) -> Vec<u8> {
    let file = MemoryFile::new();
    let options = WriterOptions {
        compression,
        chunk_bytes: 1 << 10,
        overwrite: true,
    };
    let mut writer = RecordingWriter::create(&file.path(), &options).expect("a writer");
    begin(&mut writer);
    for number in [0, 2] {
        write_objects(&mut writer, number);
        step(&mut writer, number);
    }
    let gap = GapRecord {
        epoch: Hex64(EPOCH),
        from_step: 1,
        to_step: Some(1),
        reason: GapReason::Missed,
    };
    writer.gap(&gap).expect("written");
    writer.finish().expect("written");
    std::fs::read(file.path()).expect("read back")
}

/// A recording with packed point clouds.
fn compacted(recording: &[u8]) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let [input, output] = ["a", "b"].map(|name| folder.path().join(name));
    std::fs::write(&input, recording).expect("written");
    compact(&input, &output, true, |_, _| {}).expect("a sound recording");
    std::fs::read(output).expect("read back")
}

const EPOCH: u64 = 7;

fn begin(writer: &mut RecordingWriter) {
    let object = ObjectInfo {
        particle_count: 8,
        gaussian_count: 2,
        law: 1,
        name: padded("vase"),
        material: padded("clay"),
        ..bytemuck::Zeroable::zeroed()
    };
    let scene = SceneBlocks {
        header: SceneHeader {
            epoch: EPOCH,
            scene_hash: 42,
            frame_rate: 60.0,
            dx: 0.01,
            gaussian_count: 2,
            object_count: 1,
            ..Default::default()
        },
        gaussians: &[GaussianRest {
            opacity: 0.5,
            scale: [0.01; 3],
            rotation: [0.0, 0.0, 0.0, 1.0],
            ..Default::default()
        }; 2],
        sh: &[0.5; 6],
        features: &[],
        objects: &[object],
        source: "version = 1\n",
        files: &[],
    };
    writer.begin_epoch("fuzz", &scene).expect("written");
}

/// A command and the objects of a step.
fn write_objects(writer: &mut RecordingWriter, step: u64) {
    let entry = JournalEntry {
        applied: AppliedCommand {
            step,
            client: 1,
            command: Command {
                kind: COMMAND_IMPULSE,
                sequence: step,
                ..Default::default()
            },
        },
        epoch: Some(EPOCH),
        index: Some(step),
    };
    writer.journal(&entry).expect("written");
    let objects = ObjectsHeader {
        step,
        epoch: EPOCH,
        count: 1,
        state_hash: step + 1,
        ..Default::default()
    };
    let object = ObjectState {
        mass: 1.0,
        ..Default::default()
    };
    writer.objects(&objects, &[object]).expect("written");
}

/// A whole frame in one message.
fn write_frame(writer: &mut RecordingWriter, step: u64) {
    let header = FrameHeader {
        step,
        epoch: EPOCH,
        state_hash: step + 1,
        count: 2,
        ..Default::default()
    };
    let status = Status {
        step,
        ..Default::default()
    };
    let gaussians = [GaussianState::default(); 2];
    let written = writer.frame(&header, &gaussians, Some(&status));
    written.expect("written");
}

/// Matter that moves and a body that is placed; all of it in the first step.
fn write_changes(writer: &mut RecordingWriter, step: u64) {
    let is_complete = step == 0;
    let begin = row_slots(2);
    let row = |object: u32, kind: u32| ObjectChange {
        object,
        kind,
        first: object,
        count: 1,
        slot: match kind {
            CHANGE_PLACED => 0,
            _ => begin as u32 + object,
        },
        rotation: [0.0, 0.0, 0.0, 1.0],
        ..Default::default()
    };
    let body = match is_complete {
        true => CHANGE_FORM,
        false => CHANGE_PLACED,
    };
    let rows = [row(0, CHANGE_GAUSSIANS), row(1, body)];
    let mut slots = vec![ChangeSlot::default(); begin];
    let told: &[u8] = bytemuck::cast_slice(&rows);
    bytemuck::cast_slice_mut::<_, u8>(&mut slots)[..told.len()].copy_from_slice(told);
    let gaussians: [GaussianState; 2] = std::array::from_fn(|n| GaussianState {
        object: n as u32,
        index: n as u32,
        ..Default::default()
    });
    slots.extend_from_slice(bytemuck::cast_slice(&gaussians));
    let header = ChangesHeader {
        step,
        epoch: EPOCH,
        state_hash: step + 1,
        // Step 1 is missing, and what changed in it is told with step 2.
        since: 0,
        count: slots.len() as u32,
        objects: 2,
        gaussians: 2,
        ..Default::default()
    };
    writer.changes(&header, &slots, None).expect("written");
}

/// The records of a file or a chunk, as opcode and content.
fn records(bytes: &[u8]) -> Vec<(u8, &[u8])> {
    let (mut at, mut records) = (0, Vec::new());
    while let Some(length) = bytes.get(at + 1..at + FRAMING) {
        let length = u64::from_le_bytes(length.try_into().expect("eight bytes")) as usize;
        records.push((bytes[at], &bytes[at + FRAMING..][..length]));
        at += FRAMING + length;
    }
    records
}

fn put(to: &mut Vec<u8>, opcode: u8, content: &[u8]) {
    to.push(opcode);
    to.extend((content.len() as u64).to_le_bytes());
    to.extend(content);
}

/// A file without what no reader here looks at, indexes and the text of schemas, and with checksums that say that there is
/// none: what is changed in it is read all the same.
fn bare(file: &[u8]) -> Vec<u8> {
    let end = file.len() - MAGIC;
    let mut small = file[..MAGIC].to_vec();
    for (opcode, content) in records(&file[MAGIC..end]) {
        let mut content = content.to_vec();
        let checksum = match opcode {
            // The summary repeats the schemas.
            SCHEMA => continue,
            index if INDEXES.contains(&index) => continue,
            CHUNK => {
                content = without_schemas(&content);
                24
            }
            ATTACHMENT | FOOTER => content.len() - 4,
            DATA_END => 0,
            _ => {
                put(&mut small, opcode, &content);
                continue;
            }
        };
        content[checksum..checksum + 4].fill(0);
        put(&mut small, opcode, &content);
    }
    small.extend(&file[end..]);
    small
}

/// A chunk in which schemas are names alone; a compressed one as it is.
fn without_schemas(chunk: &[u8]) -> Vec<u8> {
    let name = u32::from_le_bytes(chunk[28..32].try_into().expect("four bytes"));
    if name != 0 {
        return chunk.to_vec();
    }
    let mut data = Vec::new();
    for (opcode, content) in records(&chunk[CHUNK_HEADER..]) {
        let mut content = content.to_vec();
        if opcode == SCHEMA {
            // A number, two strings, and the text.
            let mut text = 2;
            for _ in 0..2 {
                let length = content[text..text + 4].try_into().expect("four bytes");
                text += 4 + u32::from_le_bytes(length) as usize;
            }
            content.truncate(text + 4);
            content[text..].fill(0);
        }
        put(&mut data, opcode, &content);
    }
    let mut small = chunk[..CHUNK_HEADER].to_vec();
    small[16..24].copy_from_slice(&(data.len() as u64).to_le_bytes());
    small[32..40].copy_from_slice(&(data.len() as u64).to_le_bytes());
    small.extend(data);
    small
}

/// Recordings with and without checksums, by frames and by what moved, compressed, packed, and cut off.
pub fn seeds() -> Vec<Vec<u8>> {
    let plain = recording(Compression::None, write_frame);
    let moved = recording(Compression::None, write_changes);
    let small = bare(&moved);
    vec![
        small[..small.len() * 2 / 3].to_vec(),
        small,
        bare(&recording(Compression::Lz4, write_frame)),
        bare(&recording(Compression::Zstd, write_changes)),
        bare(&compacted(&moved)),
        bare(&plain),
        plain,
    ]
}

#[cfg(test)]
mod tests {
    use cosplat_recorder::reader::Event;

    use super::*;

    #[test]
    fn seeds_are_recordings_of_two_frames() {
        let seeds = seeds();
        let whole = &seeds[1..];
        for (n, seed) in whole.iter().enumerate() {
            let file = MemoryFile::new();
            file.0.write_all_at(seed, 0).expect("memory");
            let events: Result<Vec<_>, _> = Recording::open(&file.path()).expect("MCAP").collect();
            let events = events.unwrap_or_else(|error| panic!("{n}: {error}"));
            let frames = events
                .iter()
                .filter(|event| matches!(event, Event::Frame(_)));
            assert_eq!(frames.count(), 2, "seed {n}");
        }
        let sizes = seeds.iter().map(Vec::len);
        assert_eq!(
            sizes.filter(|&size| size < 16_384).count(),
            6,
            "of 7, the last has indexes"
        );
    }
}
