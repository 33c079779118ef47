//! Recordings of older recorders read as before: `tests/older` has one for each change of the format.
//!
//! A change of the format comes with the file that the recorder before it writes, which stays as it is.

use std::path::{Path, PathBuf};

use cosplat_ipc::schema::Status;
use cosplat_recorder::compact::compact;
use cosplat_recorder::reader::{Event, Recording};
use cosplat_recorder::recover::recover;

use super::synthetic::Run;

const RUN: Run = Run {
    steps: 8,
    gaussians: 6,
    epoch: 5,
};

/// What a file of the older ones has, beside frames.
struct Older {
    name: &'static str,
    /// Whether commands have an epoch and a number, and objects a state hash.
    is_numbered: bool,
    /// Whether the status board has the work of hands and what edits brought in.
    has_work: bool,
}

const OLDER: [Older; 4] = [
    // Materials of commands have neither a region nor parameters.
    Older {
        name: "1-first.mcap",
        is_numbered: false,
        has_work: false,
    },
    Older {
        name: "2-regions.mcap",
        is_numbered: false,
        has_work: false,
    },
    Older {
        name: "3-numbered.mcap",
        is_numbered: true,
        has_work: false,
    },
    // With all fields of the status board; steps by what changed are in `4-changes.mcap`.
    Older {
        name: "5-board.mcap",
        is_numbered: true,
        has_work: true,
    },
];

fn older(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/older")).join(name)
}

/// The status board of a step of the file with all fields.
pub fn board(step: u64) -> Status {
    Status {
        step,
        kinetic_energy: 0.1 * step as f64,
        frame_readers: 2,
        has_changes: 1,
        spring_work: 0.3 * step as f64,
        edit_energy: -1.5,
        edit_mass: 0.25,
        ..Default::default()
    }
}

#[test]
fn recordings_of_older_recorders_read_as_they_did() {
    for file in &OLDER {
        let path = older(file.name);
        assert_eq!(RUN.checked_steps(&path), (0..8).collect::<Vec<_>>());
        let (mut told, mut commands) = (0, 0);
        for event in Recording::open(&path).unwrap() {
            match event.unwrap() {
                Event::Frame(frame) => {
                    let step = frame.header.step;
                    let found = frame.board.unwrap().0;
                    let expected = match file.has_work {
                        true => board(step),
                        // What was not written is 0.
                        false => Status {
                            step,
                            kinetic_energy: 0.1 * step as f64,
                            ..Default::default()
                        },
                    };
                    assert_eq!(found, expected, "{}", file.name);
                }
                Event::Objects(header, states) => {
                    let (mut expected, objects) = RUN.objects(told);
                    if !file.is_numbered {
                        expected.state_hash = 0;
                    }
                    assert_eq!((header, states), (expected, objects), "{}", file.name);
                    told += 1;
                }
                Event::Journal(entry) => {
                    let applied = entry.applied;
                    assert_eq!(Some(applied), RUN.command(applied.step));
                    let place = file.is_numbered.then_some((RUN.epoch, commands));
                    assert_eq!(entry.epoch.zip(entry.index), place, "{}", file.name);
                    commands += 1;
                }
                Event::Metadata { .. } | Event::Attachment { .. } | Event::Gap(_) => {}
            }
        }
        assert_eq!((told, commands), (8, 1), "{}", file.name);
    }
}

#[test]
fn frames_by_what_changed_of_an_older_recorder_read_as_they_did() {
    let path = older("4-changes.mcap");
    let events = Recording::open(&path).unwrap();
    let frames: Vec<_> = events
        .filter_map(|event| match event.unwrap() {
            Event::Frame(frame) => Some(frame),
            _ => None,
        })
        .collect();
    let live = super::moved::frames(8);
    assert_eq!(frames.len(), live.len());
    for (frame, live) in frames.iter().zip(&live) {
        let step = frame.header.step;
        assert!(super::moved::is_same(&frame.gaussians, live), "{step}");
        assert_eq!(frame.is_whole, step == 0);
        let board = frame.board.unwrap().0;
        assert_eq!((board.step, board.spring_work), (step, 0.0));
    }
}

#[test]
fn recordings_of_older_recorders_are_recovered_and_compacted() {
    let folder = tempfile::tempdir().unwrap();
    let names = OLDER.iter().map(|file| file.name);
    for name in names.chain(["4-changes.mcap"]) {
        let [whole, small] = ["whole", "small"].map(|end| folder.path().join(end));
        let report = recover(&older(name), &whole, true).unwrap();
        assert_eq!((report.was_intact, report.frames), (true, 8), "{name}");
        assert_eq!(
            compact(&older(name), &small, true, |_, _| {})
                .unwrap()
                .frames,
            8
        );
    }
}
