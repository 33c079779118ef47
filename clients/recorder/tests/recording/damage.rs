//! A recording cut off or damaged anywhere becomes a valid file with everything that was whole.

use std::path::{Path, PathBuf};

use cosplat_recorder::chunks::Chunks;
use cosplat_recorder::compact::compact;
use cosplat_recorder::messages::GapReason;
use cosplat_recorder::reader::{Event, Recording};
use cosplat_recorder::recover::{RecoverReport, recover};
use cosplat_recorder::topics::GAUSSIANS_TOPIC;
use cosplat_recorder::writer::{Compression, RecordingWriter, WriterOptions};
use cosplat_recorder::{Damage, RecordingError};

use super::synthetic::Run;

const RUN: Run = Run {
    steps: 12,
    gaussians: 20,
    epoch: 5,
};

/// Two or three frames per chunk.
fn options(compression: Compression) -> WriterOptions {
    WriterOptions {
        compression,
        chunk_bytes: 10_000,
        ..Default::default()
    }
}

/// Every frame of `file` as (step, end of its message, end of its chunk), from the reader of the mcap crate.
fn frames_of(file: &[u8]) -> Vec<(u64, usize, usize)> {
    let summary = mcap::Summary::read(file).unwrap().unwrap();
    let mut frames = Vec::new();
    for chunk in &summary.chunk_indexes {
        // The first chunk holds schemas and channels only.
        if chunk.message_index_offsets.is_empty() {
            continue;
        }
        let chunk_end = (chunk.chunk_start_offset + chunk.chunk_length) as usize;
        let data = chunk.compressed_data_offset().unwrap();
        let indexes = summary.read_message_indexes(file, chunk).unwrap();
        let of_frames = indexes
            .into_iter()
            .filter(|(channel, _)| channel.topic == GAUSSIANS_TOPIC);
        for (_, entries) in of_frames {
            for entry in entries {
                let message = summary.seek_message(file, chunk, &entry).unwrap();
                // Opcode, length, header, content.
                let end = data + entry.offset + 9 + 22 + message.data.len() as u64;
                frames.push((u64::from(message.sequence), end as usize, chunk_end));
            }
        }
    }
    frames.sort_unstable();
    frames
}

struct Bench {
    folder: tempfile::TempDir,
    bytes: Vec<u8>,
}

impl Bench {
    fn new(compression: Compression) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("whole.mcap");
        RUN.write(&path, &options(compression));
        let bytes = std::fs::read(&path).unwrap();
        Self { folder, bytes }
    }

    fn input(&self) -> PathBuf {
        self.folder.path().join("damaged.mcap")
    }

    fn output(&self) -> PathBuf {
        self.folder.path().join("recovered.mcap")
    }

    /// Recovers a file of these bytes; the output is read back whole and checked bit for bit.
    fn recover(&self, bytes: &[u8]) -> (RecoverReport, Vec<u64>) {
        std::fs::write(self.input(), bytes).unwrap();
        let report = recover(&self.input(), &self.output(), true).unwrap();
        let steps = RUN.checked_steps(&self.output());
        assert_eq!(report.frames, steps.len() as u64);
        assert_eq!(report.first_step, steps.first().copied());
        assert_eq!(report.last_step, steps.last().copied());
        let output = std::fs::read(self.output()).unwrap();
        let summary = mcap::Summary::read(&output).unwrap().unwrap();
        assert_eq!(
            summary.stats.unwrap().message_count,
            report.messages + report.lost_steps.len() as u64
        );
        (report, steps)
    }
}

#[test]
fn a_file_cut_at_any_byte_keeps_every_whole_message() {
    let bench = Bench::new(Compression::None);
    let frames = frames_of(&bench.bytes);
    assert_eq!(frames.len(), RUN.steps as usize);
    // Every offset near a border of something, and a stride that is coprime to all sizes elsewhere.
    let borders: Vec<usize> = frames.iter().flat_map(|f| [f.1, f.2]).collect();
    let near = |cut: usize| borders.iter().any(|&b| cut.abs_diff(b) < 40);
    let total = bench.bytes.len();
    for cut in (8..total).filter(|&c| c % 97 == 0 || near(c) || c > total - 40) {
        let (report, steps) = bench.recover(&bench.bytes[..cut]);
        let expected: Vec<u64> = frames.iter().filter(|f| f.1 <= cut).map(|f| f.0).collect();
        assert_eq!(steps, expected, "cut at byte {cut} of {total}");
        assert!(!report.was_intact, "cut at byte {cut} of {total}");
        assert_eq!(report.chunks_damaged, 0);
    }
}

#[test]
fn a_compressed_file_cut_at_any_byte_keeps_every_whole_chunk() {
    for compression in [Compression::Lz4, Compression::Zstd] {
        let bench = Bench::new(compression);
        let frames = frames_of(&bench.bytes);
        for cut in (8..bench.bytes.len()).step_by(173) {
            let (_, steps) = bench.recover(&bench.bytes[..cut]);
            let whole = frames.iter().filter(|f| f.2 <= cut).count();
            assert!(
                steps.len() >= whole,
                "{compression:?} cut at {cut}: {steps:?}"
            );
            assert_eq!(steps, (0..steps.len() as u64).collect::<Vec<_>>());
        }
    }
}

/// The writer is forgotten like by SIGKILL: no destructor runs, what its buffer holds is lost.
#[test]
fn a_killed_writer_loses_no_finished_chunk() {
    let bench = Bench::new(Compression::None);
    let frames = frames_of(&bench.bytes);
    for killed_after in 0..RUN.steps {
        let path = bench.folder.path().join(format!("{killed_after}.mcap"));
        let mut writer = RecordingWriter::create(&path, &options(Compression::None)).unwrap();
        RUN.begin(&mut writer);
        (0..killed_after).for_each(|step| RUN.step(&mut writer, step));
        let _unfinished = std::mem::ManuallyDrop::new(writer);
        let (report, steps) = bench.recover(&std::fs::read(&path).unwrap());
        assert!(!report.was_intact);
        assert_eq!((report.attachments, report.metadata), (5, 1));
        // A chunk is finished when its last frame is written.
        let in_finished_chunks = frames
            .iter()
            .filter(|f| frames.iter().all(|g| g.2 != f.2 || g.0 < killed_after))
            .count();
        assert!(
            steps.len() >= in_finished_chunks,
            "{steps:?} of {killed_after}"
        );
        assert_eq!(steps, (0..steps.len() as u64).collect::<Vec<_>>());
    }
}

/// Finishing a chunk takes several writes; a kill may come between any two.
#[test]
fn a_writer_killed_as_it_finishes_a_chunk_loses_nothing() {
    let bench = Bench::new(Compression::None);
    let summary = mcap::Summary::read(&bench.bytes).unwrap().unwrap();
    let chunk = &summary.chunk_indexes[2];
    let start = chunk.chunk_start_offset as usize;
    let end = start + chunk.chunk_length as usize;
    let expected = frames_of(&bench.bytes)
        .iter()
        .filter(|f| f.2 <= end)
        .count();
    // Offsets of the fields in the order of writing, with the placeholders that stand there before.
    let header = start + 9;
    let fields = [
        (start + 1..start + 9, 0xff),
        (header..header + 16, 0x00),
        (header + 16..header + 28, 0xff),
        (header + 32..header + 40, 0xff),
    ];
    for first_unwritten in 0..fields.len() {
        let mut bytes = bench.bytes[..end].to_vec();
        for (range, placeholder) in &fields[first_unwritten..] {
            bytes[range.clone()].fill(*placeholder);
        }
        let (report, steps) = bench.recover(&bytes);
        assert_eq!(steps.len(), expected, "from field {first_unwritten} on");
        assert_eq!(report.chunks_damaged, 0);
    }
}

/// It is detected.
#[test]
fn a_flipped_bit_in_a_frame_costs_its_chunk_only() {
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let bench = Bench::new(compression);
        let frames = frames_of(&bench.bytes);
        let middle = frames[5];
        let mut bytes = bench.bytes.clone();
        bytes[middle.2 - 200] ^= 0x10;
        std::fs::write(bench.input(), &bytes).unwrap();
        let error = Recording::open(&bench.input())
            .unwrap()
            .find_map(Result::err)
            .expect("damage is not noticed");
        assert!(matches!(error, RecordingError::Damaged { .. }), "{error}");

        let (report, steps) = bench.recover(&bytes);
        let kept: Vec<u64> = frames
            .iter()
            .filter(|f| f.2 != middle.2)
            .map(|f| f.0)
            .collect();
        assert_eq!(steps, kept, "{compression:?}");
        assert_eq!(report.chunks_damaged, 1);
        assert!(!report.was_intact && report.lost_bytes > 0);
        let lost: Vec<u64> = frames
            .iter()
            .filter(|f| f.2 == middle.2)
            .map(|f| f.0)
            .collect();
        let [gap] = &report.lost_steps[..] else {
            panic!("expected one gap, found {:?}", report.lost_steps);
        };
        assert_eq!(
            (gap.from_step, gap.to_step),
            (lost[0], lost.last().copied())
        );
        assert_eq!(gap.reason, GapReason::Damaged);
        let recorded = Recording::open(&bench.output())
            .unwrap()
            .any(|event| matches!(event, Ok(Event::Gap(record)) if record == *gap));
        assert!(recorded, "the gap is in the file");
    }
}

#[test]
fn a_broken_length_does_not_end_the_recovery() {
    let bench = Bench::new(Compression::None);
    let summary = mcap::Summary::read(&bench.bytes).unwrap().unwrap();
    // Chunk 0 holds the channels only; make the record of chunk 1 claim other lengths, or be no record.
    let at = summary.chunk_indexes[1].chunk_start_offset as usize;
    let frames = frames_of(&bench.bytes);
    let chunk_end = at + summary.chunk_indexes[1].chunk_length as usize;
    let later = frames.iter().filter(|f| f.2 > chunk_end).count();
    for (byte, value) in [(at + 8, 0x7f), (at + 5, 0x01), (at + 1, 0xff), (at, 0x00)] {
        let mut bytes = bench.bytes.clone();
        bytes[byte] = value;
        let (report, steps) = bench.recover(&bytes);
        assert!(!report.was_intact);
        assert!(steps.len() >= later, "byte {byte} = {value}: {steps:?}");
        assert_eq!(steps.last(), Some(&(RUN.steps - 1)));
        assert!(steps.is_sorted_by(|a, b| a < b), "{steps:?}");
    }
}

#[test]
fn an_intact_file_is_said_to_be_intact_and_loses_nothing() {
    let bench = Bench::new(Compression::None);
    let (report, steps) = bench.recover(&bench.bytes);
    assert!(report.was_intact, "{report:?}");
    assert_eq!(steps.len(), RUN.steps as usize);
    assert_eq!(
        (report.attachments, report.metadata, report.lost_bytes),
        (5, 1, 0)
    );
    assert_eq!(report.messages_unverified, 0);
}

#[test]
fn a_damaged_attachment_is_dropped_and_counted() {
    let bench = Bench::new(Compression::None);
    let summary = mcap::Summary::read(&bench.bytes).unwrap().unwrap();
    let ply = &summary.attachment_indexes[0];
    // In the data, then in the length of its name.
    for byte in [ply.offset + ply.length - 20, ply.offset + 9 + 16 + 2] {
        let mut bytes = bench.bytes.clone();
        bytes[byte as usize] ^= 0x40;
        let (report, steps) = bench.recover(&bytes);
        assert_eq!((report.attachments, report.attachments_damaged), (4, 1));
        assert_eq!(steps.len(), RUN.steps as usize);
    }
}

#[test]
fn nonsense_is_refused_and_an_input_is_never_its_own_output() {
    let bench = Bench::new(Compression::None);
    std::fs::write(bench.input(), b"no recording at all").unwrap();
    let error = recover(&bench.input(), &bench.output(), true).unwrap_err();
    assert!(matches!(error, RecordingError::NotMcap { .. }), "{error}");
    let whole: &Path = &bench.folder.path().join("whole.mcap");
    let (hard, soft) = (
        bench.folder.path().join("hard"),
        bench.folder.path().join("soft"),
    );
    std::fs::hard_link(whole, &hard).unwrap();
    std::os::unix::fs::symlink("hard", &soft).unwrap();
    for output in [whole, &hard, &soft] {
        let compacted = compact(whole, output, true, |_, _| {}).map(drop);
        for refused in [recover(whole, output, true).map(drop), compacted] {
            let error = refused.unwrap_err();
            assert!(matches!(error, RecordingError::OntoInput(_)), "{error}");
            assert_eq!(std::fs::read(whole).unwrap(), bench.bytes);
        }
    }
}

#[test]
fn what_fails_on_the_way_leaves_the_file_that_was_there() {
    let bench = Bench::new(Compression::None);
    std::fs::write(bench.output(), "precious").unwrap();
    // Its header and first records are sound.
    std::fs::write(bench.input(), &bench.bytes[..bench.bytes.len() / 2]).unwrap();
    compact(&bench.input(), &bench.output(), true, |_, _| {}).unwrap_err();
    let overwrite = WriterOptions {
        overwrite: true,
        ..options(Compression::None)
    };
    let mut writer = RecordingWriter::create(&bench.output(), &overwrite).unwrap();
    writer.frame(&RUN.header(0), &RUN.frame(0), None).unwrap();
    writer.flush().unwrap();
    drop(writer);
    assert_eq!(std::fs::read(bench.output()).unwrap(), b"precious");
    // The recorder's part lies beside it, to be recovered; nothing is left of what was made of a recording.
    let names = bench.folder.path().read_dir().unwrap();
    let names = names.map(|entry| entry.unwrap().path());
    let unfinished: Vec<_> = names
        .filter(|path| path.extension().is_some_and(|end| end == "unfinished"))
        .collect();
    let [part] = &unfinished[..] else {
        panic!("{unfinished:?}");
    };
    let repaired = bench.folder.path().join("repaired.mcap");
    assert_eq!(recover(part, &repaired, false).unwrap().frames, 1);
    recover(&bench.input(), &bench.output(), true).unwrap();
    assert!(std::fs::read(bench.output()).unwrap() != b"precious");
}

/// Found by `fuzz/run recording`: the length of a record may be less than the chunk's header in it takes.
#[test]
fn a_chunk_shorter_than_its_header_is_lost_and_no_more() {
    let bench = Bench::new(Compression::None);
    let mut bytes = bench.bytes.clone();
    let mut at = 8;
    while bytes[at] != mcap::records::op::CHUNK {
        let length = bytes[at + 1..at + 9].try_into().unwrap();
        at += 9 + u64::from_le_bytes(length) as usize;
    }
    bytes[at + 1..at + 9].copy_from_slice(&2_u64.to_le_bytes());
    let (input, output) = (
        bench.folder.path().join("short"),
        bench.folder.path().join("out"),
    );
    for end in [bytes.len(), at + 60, at + 11] {
        std::fs::write(&input, &bytes[..end]).unwrap();
        let report = recover(&input, &output, true).unwrap();
        assert!(report.lost_bytes > 0, "{report:?}");
        assert!(Recording::open(&output).unwrap().all(|event| event.is_ok()));
    }
}

/// Found by `fuzz/run recording`: the container's own reader ended in an overflow where a record does not end in its chunk.
#[test]
fn a_record_longer_than_its_chunk_is_an_error_of_its_own() {
    let bench = Bench::new(Compression::None);
    let summary = mcap::Summary::read(&bench.bytes).unwrap().unwrap();
    // Behind the chunk of declarations and one of frames.
    let chunk = summary.chunk_indexes[2].chunk_start_offset as usize;
    // Opcode and length, two times, a size, a checksum, no name, a size: then the first record.
    let mut bytes = bench.bytes.clone();
    let first = chunk + 9 + 40;
    assert_eq!(bytes[chunk], mcap::records::op::CHUNK);
    bytes[chunk + 33..chunk + 37].fill(0);
    bytes[first + 1..first + 9].copy_from_slice(&(1_u64 << 31).to_le_bytes());
    // What is in front of the chunk was not changed, and its checksum would say that something else was.
    std::fs::write(bench.input(), &bytes).unwrap();
    let error = Recording::open(&bench.input()).unwrap();
    let error = error.filter_map(Result::err).next().expect("damage");
    let RecordingError::Damaged {
        cause: Damage::RecordLength {
            length, available, ..
        },
        ..
    } = &error
    else {
        panic!("{error}");
    };
    assert_eq!(*length, 1 << 31);
    assert!(*available < *length && *available > 0, "{error}");
    let mut chunks = Chunks::open(&bench.input()).unwrap();
    let damaged = chunks.first_damaged().unwrap().expect("damage");
    assert!(damaged.events.is_empty());
    let output = bench.folder.path().join("smaller.mcap");
    let refused = compact(&bench.input(), &output, true, |_, _| {});
    assert!(matches!(refused, Err(RecordingError::Damaged { .. })));
    let (report, steps) = bench.recover(&bytes);
    assert_eq!((report.chunks_damaged, report.lost_steps.len()), (1, 1));
    assert_eq!([steps.first(), steps.last()], [Some(&0), Some(&11)]);
}

/// Found by the seeded mutations: what lay between a broken record and the chunk behind it was less than nothing.
#[test]
fn a_few_bytes_in_front_of_a_chunk_cost_no_frame() {
    let bench = Bench::new(Compression::None);
    let summary = mcap::Summary::read(&bench.bytes).unwrap().unwrap();
    let chunk = summary.chunk_indexes[2].chunk_start_offset as usize;
    for count in 1..12 {
        let mut bytes = bench.bytes.clone();
        // The opcode of a message, and a length that the chunk's own opcode makes too large.
        let stray = [&[mcap::records::op::MESSAGE][..], &vec![0; count - 1]].concat();
        bytes.splice(chunk..chunk, stray);
        let (report, steps) = bench.recover(&bytes);
        assert_eq!(steps.len() as u64, RUN.steps, "{count}: {report:?}");
    }
}
