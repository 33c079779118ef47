//! A recording in parts.

use std::sync::atomic::AtomicBool;

use cosplat_recorder::client::RecordOptions;
use cosplat_recorder::parts::{Split, part_path};
use cosplat_recorder::reader::{Event, Recording};

use super::live::{Server, TestDomain, options, record_while};

#[test]
fn a_recording_in_parts_is_whole_and_each_part_reads_by_itself() {
    let domain = TestDomain::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut server = Server::start(&domain.domain, 300, 100);
    let run = server.run;
    let parted = RecordOptions {
        split: Split {
            bytes: Some(600_000),
            seconds: Some(1.5),
        },
        ..options(&domain.domain, &path)
    };
    let first = part_path(&path, 1);
    let summary = record_while(&parted, &AtomicBool::new(false), |recorded| {
        server.publish_all(&first, 1..run.steps, recorded);
    });
    assert_eq!((summary.frames_recorded, summary.gaps), (run.steps, 0));
    assert!(!path.exists(), "all parts have numbers");
    let (mut steps, mut commands) = (Vec::new(), 0);
    let parts = (1..)
        .map(|n| part_path(&path, n))
        .take_while(|p| p.exists());
    let parts: Vec<_> = parts.collect();
    // 100 Gaussians and what goes with them are some 9 kB a step; 1.5 s are 90 steps.
    assert!((4..=6).contains(&parts.len()), "{} parts", parts.len());
    for part in &parts {
        steps.extend(run.checked_steps(part));
        let mut attachments = 0;
        for event in Recording::open(part).unwrap() {
            match event.unwrap() {
                Event::Attachment { .. } => attachments += 1,
                Event::Journal(entry) => {
                    // With the frame that shows it.
                    assert!(run.checked_steps(part).contains(&entry.applied.step));
                    commands += 1;
                }
                _ => {}
            }
        }
        assert!(attachments >= 4, "{attachments} attachments");
        assert!(std::fs::metadata(part).unwrap().len() < 900_000);
    }
    assert_eq!(steps, (0..run.steps).collect::<Vec<_>>());
    assert_eq!(commands, summary.journal_entries);
}
