//! What was published is what is read back.

use cosplat_recorder::RecordingError;
use cosplat_recorder::messages::{GapReason, GapRecord, Hex64};
use cosplat_recorder::reader::{Event, Recording};
use cosplat_recorder::topics::*;
use cosplat_recorder::writer::{Compression, RecordingWriter, WriterOptions};

use super::synthetic::{Run, SCENE_SOURCE};

const RUN: Run = Run {
    steps: 20,
    gaussians: 100,
    epoch: 5,
};

#[test]
fn everything_published_comes_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        let options = WriterOptions {
            compression,
            chunk_bytes: 30_000,
            ..Default::default()
        };
        RUN.write(&path, &options);
        assert_eq!(
            RUN.checked_steps(&path),
            (0..RUN.steps).collect::<Vec<_>>(),
            "{compression:?}"
        );

        let (mut objects, mut journal, mut attachments) = (Vec::new(), Vec::new(), Vec::new());
        for event in Recording::open(&path).unwrap() {
            match event.unwrap() {
                Event::Objects(header, states) => objects.push((header, states)),
                Event::Journal(entry) => journal.push(entry.applied),
                Event::Attachment { name, data } => attachments.push((name, data)),
                Event::Metadata { name, values } => {
                    assert_eq!(name, RUN_METADATA);
                    assert_eq!(values["session"], "test");
                    assert_eq!(values["epoch"], "0000000000000005");
                    assert_eq!(values["object.1.name"], "vase");
                }
                _ => {}
            }
        }
        assert_eq!(
            objects,
            (0..RUN.steps).map(|s| RUN.objects(s)).collect::<Vec<_>>()
        );
        assert_eq!(
            journal,
            (0..RUN.steps)
                .filter_map(|s| RUN.command(s))
                .collect::<Vec<_>>()
        );
        let names: Vec<_> = attachments.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(
            names,
            [
                SCENE_PLY,
                SCENE_TOML,
                SCENE_GAUSSIANS,
                SCENE_SH,
                SCENE_OBJECTS
            ]
        );
        assert_eq!(attachments[1].1, SCENE_SOURCE.as_bytes());
        assert_eq!(attachments[2].1, bytemuck::cast_slice::<_, u8>(&RUN.rest()));
        assert_eq!(attachments[3].1, bytemuck::cast_slice::<_, u8>(&RUN.sh()));
        assert_eq!(
            attachments[4].1,
            bytemuck::cast_slice::<_, u8>(&RUN.object_table())
        );
    }
}

#[test]
fn the_index_lets_a_reader_jump_to_any_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    RUN.write(&path, &WriterOptions::default());
    let bytes = std::fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let stats = summary.stats.as_ref().unwrap();
    let count = |topic: &str| {
        let channel = summary
            .channels
            .values()
            .find(|c| c.topic == topic)
            .unwrap();
        stats
            .channel_message_counts
            .get(&channel.id)
            .copied()
            .unwrap_or(0)
    };
    for topic in [
        GAUSSIANS_TOPIC,
        STATUS_TOPIC,
        OBJECTS_TOPIC,
        TRANSFORMS_TOPIC,
    ] {
        assert_eq!(count(topic), RUN.steps, "{topic}");
    }
    assert_eq!(count(GAPS_TOPIC), 0);
    assert_eq!(
        stats.message_end_time,
        (19.0 / 60.0 * 1e9_f64).round() as u64
    );
    assert_eq!((stats.attachment_count, stats.metadata_count), (5, 1));
}

#[test]
fn a_restarted_server_continues_time_and_shares_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let second = Run { epoch: 6, ..RUN };
    let mut writer = RecordingWriter::create(&path, &WriterOptions::default()).unwrap();
    RUN.begin(&mut writer);
    (0..5).for_each(|step| RUN.step(&mut writer, step));
    let gap = GapRecord {
        epoch: Hex64(5),
        from_step: 5,
        to_step: None,
        reason: GapReason::ServerRestarted,
    };
    writer.gap(&gap).unwrap();
    second.begin(&mut writer);
    (0..5).for_each(|step| second.step(&mut writer, step));
    writer.finish().unwrap();

    let (mut times, mut attachments, mut epochs, mut gaps) =
        (Vec::new(), 0, Vec::new(), Vec::new());
    for event in Recording::open(&path).unwrap() {
        match event.unwrap() {
            Event::Frame(frame) => {
                times.push(frame.log_time);
                let run = if frame.header.epoch == 5 { RUN } else { second };
                assert_eq!(frame.header, run.header(frame.header.step));
            }
            Event::Attachment { .. } => attachments += 1,
            Event::Metadata { values, .. } => {
                epochs.push((values["epoch"].clone(), values["scene_attached"].clone()))
            }
            Event::Gap(record) => gaps.push(record),
            _ => {}
        }
    }
    assert!(times.is_sorted_by(|a, b| a < b), "{times:?}");
    assert_eq!(times.len(), 10);
    assert_eq!(attachments, 5, "the same scene is attached once");
    let text = |e: &str, a: &str| (e.to_owned(), a.to_owned());
    assert_eq!(
        epochs,
        [
            text("0000000000000005", "true"),
            text("0000000000000006", "false")
        ]
    );
    assert_eq!(gaps, [gap]);
}

#[test]
fn an_existing_file_is_not_overwritten_unless_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    std::fs::write(&path, "precious").unwrap();
    let refused = RecordingWriter::create(&path, &WriterOptions::default());
    assert!(matches!(refused, Err(RecordingError::Exists { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    let options = WriterOptions {
        overwrite: true,
        ..Default::default()
    };
    RUN.write(&path, &options);
    assert_eq!(RUN.checked_steps(&path).len(), 20);
}

#[test]
fn a_full_disk_is_an_error_that_says_so() {
    let options = WriterOptions {
        overwrite: true,
        ..Default::default()
    };
    let frame = RUN.frame(0);
    let error = RecordingWriter::create("/dev/full".as_ref(), &options)
        .and_then(|mut writer| {
            (0..10_000).try_for_each(|step| writer.frame(&RUN.header(step), &frame, None))
        })
        .expect_err("10,000 frames fit on a full disk");
    let sentence = error.to_string();
    assert!(
        sentence.contains("/dev/full") && sentence.contains("No space left"),
        "{sentence}"
    );
}

#[test]
fn missing_folders_and_files_that_are_no_recordings_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("missing/run.mcap");
    let Err(error) = RecordingWriter::create(&path, &WriterOptions::default()) else {
        panic!("created a file in a folder that does not exist");
    };
    assert!(error.to_string().contains("missing/run.mcap"), "{error}");
    let path = folder.path().join("picture.png");
    std::fs::write(&path, b"\x89PNG").unwrap();
    let Err(error) = Recording::open(&path) else {
        panic!("opened a picture");
    };
    assert!(matches!(error, RecordingError::NotMcap { .. }), "{error}");
}
