//! A recorder killed with SIGKILL at seeded moments, and what is left of its file.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use cosplat_ipc::Domain;
use cosplat_recorder::client::record;
use cosplat_recorder::recover::recover;
use cosplat_recorder::topics::GAUSSIANS_TOPIC;
use rand_core::Rng;
use rand_pcg::Pcg32;

use super::live::{Server, TestDomain, assert_holes_are_told, gaps_of, options, wait_for};

/// Names domain and output to the child process that records.
const CHILD: &str = "COSPLAT_TEST_RECORDER";

#[test]
fn a_recorder_killed_at_any_moment_costs_at_most_the_open_chunk() {
    if let Ok(order) = std::env::var(CHILD) {
        record_as_child(&order);
        return;
    }
    let domain = TestDomain::new();
    let folder = tempfile::tempdir().unwrap();
    let mut rng = Pcg32::new(20_260_801, 1);
    let mut server = Server::start(&domain.domain, u64::MAX, 500);
    let run = server.run;
    let mut step = 0;
    let mut kept = 0;
    for round in 0..8 {
        let path = folder.path().join(format!("{round}.mcap"));
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "--nocapture"])
            .arg("recording::killed::a_recorder_killed_at_any_moment_costs_at_most_the_open_chunk")
            .env(CHILD, format!("{} {}", domain.name, path.display()))
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let frames = std::sync::Arc::new(AtomicU32::new(0));
        let counter = frames.clone();
        let output = BufReader::new(child.stdout.take().unwrap());
        let listener = std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                counter.fetch_add(u32::from(line == "frame"), Ordering::Relaxed);
            }
        });
        // A chunk holds 6 frames of 32 kB: these moments lie in all parts of it.
        let moment = 3 + rng.next_u32() % 60;
        wait_for("the child to record", || {
            server.publish(step);
            step += 1;
            frames.load(Ordering::Relaxed) >= moment
        });
        child.kill().unwrap();
        child.wait().unwrap();
        listener.join().unwrap();

        let bytes = std::fs::read(&path).unwrap();
        let in_finished_chunks = steps_in_finished_chunks(&bytes);
        let recovered = folder.path().join(format!("{round}.recovered.mcap"));
        let report = recover(&path, &recovered, false).unwrap();
        assert!(!report.was_intact);
        assert_eq!(report.chunks_damaged, 0);
        let steps = run.checked_steps(&recovered);
        if !steps.is_empty() {
            assert_eq!((report.attachments, report.metadata), (5, 1));
        }
        assert_holes_are_told(&steps, &gaps_of(&recovered));
        assert!(
            steps.starts_with(&in_finished_chunks),
            "{steps:?} lacks some of {in_finished_chunks:?}"
        );
        kept += in_finished_chunks.len();
    }
    assert!(
        kept > 50,
        "only {kept} frames in finished chunks: the test kills too early"
    );
}

fn record_as_child(order: &str) {
    let (domain, output) = order.split_once(' ').unwrap();
    let options = options(&Domain::named(domain).unwrap(), &PathBuf::from(output));
    let outcome = record(&options, &AtomicBool::new(false), |_| println!("frame"));
    panic!("the recorder ended before it was killed: {outcome:?}");
}

/// Steps of the frames in chunks that were finished, by nothing but the lengths in the file.
fn steps_in_finished_chunks(bytes: &[u8]) -> Vec<u64> {
    let mut steps = Vec::new();
    let mut topics = std::collections::BTreeMap::new();
    let mut at = mcap::MAGIC.len();
    while at + 9 <= bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        let Some(body) = length
            .checked_add(at + 9)
            .and_then(|end| bytes.get(at + 9..end))
        else {
            break;
        };
        // The writer was killed while it put the sizes into the chunk's header.
        let Ok(record) = mcap::parse_record(bytes[at], body) else {
            break;
        };
        if let mcap::records::Record::Chunk { data, .. } = record {
            for record in mcap::read::LinearReader::sans_magic(&data) {
                match record.unwrap() {
                    mcap::records::Record::Channel(channel) => {
                        topics.insert(channel.id, channel.topic);
                    }
                    mcap::records::Record::Message { header, .. }
                        if topics[&header.channel_id] == GAUSSIANS_TOPIC =>
                    {
                        steps.push(u64::from(header.sequence));
                    }
                    _ => {}
                }
            }
        }
        at += 9 + length;
    }
    steps
}
