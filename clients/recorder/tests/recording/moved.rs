//! A recording of what moved gives back every whole frame, from any step on, and after damage.

use std::path::{Path, PathBuf};

use cosplat_ipc::assembly::Assembly;
use cosplat_ipc::schema::{
    CHANGE_FORM, CHANGE_GAUSSIANS, CHANGE_PLACED, ChangeSlot, ChangesHeader, GaussianState,
    ObjectChange, ObjectState, ObjectsHeader, row_slots,
};
use cosplat_recorder::chunks::Chunks;
use cosplat_recorder::compact::compact;
use cosplat_recorder::messages::GapReason;
use cosplat_recorder::reader::{Event, Recording};
use cosplat_recorder::recover::recover;
use cosplat_recorder::tape::Tape;
use cosplat_recorder::writer::{RecordingWriter, WriterOptions};
use rand_core::Rng;
use rand_pcg::Pcg32;

use super::synthetic::Run;

/// Gaussians of an object.
const EACH: usize = 10;
/// One that stands, one of matter, a body, one that sleeps most of the time.
const OBJECTS: usize = 4;
/// Two whole frames come by the number of steps.
const STEPS: u64 = 700;
const RUN: Run = Run {
    steps: STEPS,
    gaussians: OBJECTS * EACH,
    epoch: 9,
};

/// What happens to an object in a step.
fn kind(object: usize, step: u64) -> Option<u32> {
    match object {
        _ if step == 0 && object != 2 => Some(CHANGE_GAUSSIANS),
        1 => Some(CHANGE_GAUSSIANS),
        2 if step.is_multiple_of(40) => Some(CHANGE_FORM),
        2 => Some(CHANGE_PLACED),
        3 if step < 20 || (60..70).contains(&step) => Some(CHANGE_GAUSSIANS),
        _ => None,
    }
}

/// Random bits, NaN included, but for places.
fn gaussians(object: usize, step: u64) -> Vec<GaussianState> {
    let mut rng = Pcg32::new(step, object as u64);
    let mut all = vec![GaussianState::default(); EACH];
    rng.fill_bytes(bytemuck::cast_slice_mut(&mut all));
    for (n, gaussian) in all.iter_mut().enumerate() {
        gaussian.position = std::array::from_fn(|_| rng.next_u32() as f32 / 1e9);
        // Which of many NaN comes of an operation is not the same everywhere.
        gaussian.covariance = std::array::from_fn(|_| rng.next_u32() as f32 / 1e12);
        gaussian.rotation = std::array::from_fn(|_| rng.next_u32() as f32 / 1e10);
        gaussian.index = (object * EACH + n) as u32;
    }
    all
}

/// The message of a step; of a step that is complete by itself all objects are in it.
pub fn message(step: u64, is_complete: bool) -> (ChangesHeader, Vec<ChangeSlot>) {
    let (mut rows, mut own) = (Vec::new(), Vec::new());
    for object in 0..OBJECTS {
        // The step in which it came to be what it is.
        let last = (0..=step)
            .rev()
            .find(|&s| kind(object, s).is_some_and(|kind| kind != CHANGE_PLACED || !is_complete));
        let told = if is_complete { last } else { Some(step) };
        let Some((from, kind)) = told.and_then(|s| Some((s, kind(object, s)?))) else {
            continue;
        };
        let is_body = kind != CHANGE_GAUSSIANS;
        let turn = step as f64 * 0.01;
        rows.push(ObjectChange {
            object: object as u32,
            kind,
            first: (object * EACH) as u32,
            count: EACH as u32,
            position: if is_body { [turn, 0.5, -0.1] } else { [0.0; 3] },
            rotation: match is_body {
                true => [0.0, turn.sin(), 0.0, turn.cos()],
                false => [0.0; 4],
            },
            ..ObjectChange::default()
        });
        if kind != CHANGE_PLACED {
            own.extend(gaussians(object, from));
        }
    }
    let begin = row_slots(rows.len());
    let mut slot = begin;
    for row in rows.iter_mut().filter(|row| row.kind != CHANGE_PLACED) {
        row.slot = slot as u32;
        slot += EACH;
    }
    let mut slots = vec![ChangeSlot::default(); slot];
    let told: &[u8] = bytemuck::cast_slice(&rows);
    bytemuck::cast_slice_mut::<_, u8>(&mut slots)[..told.len()].copy_from_slice(told);
    bytemuck::cast_slice_mut(&mut slots[begin..]).copy_from_slice(&own);
    let frame = RUN.header(step);
    let header = ChangesHeader {
        step,
        sim_time: frame.sim_time,
        dt: frame.dt,
        epoch: frame.epoch,
        state_hash: frame.state_hash,
        publish_ns: frame.publish_ns,
        since: if is_complete { step } else { step - 1 },
        count: slots.len() as u32,
        objects: rows.len() as u32,
        gaussians: frame.count,
        substeps: frame.substeps,
        flags: frame.flags,
        reserved: 0,
    };
    (header, slots)
}

/// Objects of which one moves.
pub fn objects(step: u64) -> (ObjectsHeader, Vec<ObjectState>) {
    let (header, mut states) = RUN.objects(step);
    for (state, n) in states.iter_mut().zip(0..) {
        let moves = if n == 1 { step } else { step / 100 };
        state.com[0] = moves as f64 * 0.1;
    }
    (header, states)
}

/// Writes the run; step 350 is told whole, as to a second reader. Returns every frame as readers of the wire have it.
fn write(path: &Path) -> Vec<Vec<GaussianState>> {
    let options = WriterOptions {
        chunk_bytes: 20_000,
        ..Default::default()
    };
    let mut writer = RecordingWriter::create(path, &options).unwrap();
    RUN.begin(&mut writer);
    let (mut live, mut frames) = (Assembly::default(), Vec::new());
    for step in 0..STEPS {
        let (header, states) = objects(step);
        writer.objects(&header, &states).unwrap();
        let (header, slots) = message(step, step == 0 || step == 350);
        writer.changes(&header, &slots, None).unwrap();
        live.apply(&header, &slots).unwrap();
        frames.push(live.gaussians().to_vec());
    }
    writer.finish().unwrap();
    frames
}

pub fn is_same(a: &[GaussianState], b: &[GaussianState]) -> bool {
    bytemuck::cast_slice::<_, u8>(a) == bytemuck::cast_slice::<_, u8>(b)
}

/// The first frames of the run as readers of the wire have them.
pub fn frames(count: u64) -> Vec<Vec<GaussianState>> {
    let mut live = Assembly::default();
    let frame = |step| {
        let (header, slots) = message(step, step == 0);
        live.apply(&header, &slots).unwrap();
        live.gaussians().to_vec()
    };
    (0..count).map(frame).collect()
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    (folder, path)
}

#[test]
fn every_frame_and_object_comes_back_bit_for_bit() {
    let (_folder, path) = folder();
    let frames = write(&path);
    let (mut steps, mut told) = (0, 0);
    for event in Recording::open(&path).unwrap() {
        match event.unwrap() {
            Event::Frame(frame) => {
                assert_eq!(frame.header, RUN.header(steps));
                assert!(
                    is_same(&frame.gaussians, &frames[steps as usize]),
                    "{steps}"
                );
                steps += 1;
            }
            Event::Objects(header, states) => {
                assert_eq!((header, states), objects(told));
                told += 1;
            }
            _ => {}
        }
    }
    assert_eq!((steps, told), (STEPS, STEPS));
    // A quarter of the objects has Gaussians in most steps, and a body now and then.
    let mut recording = Recording::open(&path).unwrap();
    assert!(recording.by_ref().all(|event| event.is_ok()));
    let of_objects = recording
        .traffic()
        .iter()
        .filter(|(topic, _)| topic.starts_with("/gaussians/"));
    let bytes: u64 = of_objects.map(|(_, traffic)| traffic.messages).sum();
    assert!(bytes < STEPS * 3 / 2, "{bytes} messages with Gaussians");
}

#[test]
fn a_tape_goes_to_any_step_of_what_moved() {
    let (_folder, path) = folder();
    let frames = write(&path);
    let mut tape = Tape::open(Chunks::open(&path).unwrap(), RUN.epoch, |_, _| {}).unwrap();
    for step in [699, 0, 350, 351, 299, 300, 301, 61, 640] {
        assert_eq!(tape.seek(step), Some(step));
        let played = tape.advance().unwrap().unwrap();
        assert_eq!(played.frame.header.step, step);
        assert!(
            is_same(&played.frame.gaussians, &frames[step as usize]),
            "{step}"
        );
        assert_eq!(played.objects, Some(objects(step)), "{step}");
    }
}

#[test]
fn damage_costs_the_frames_that_build_on_what_is_lost() {
    let (folder, path) = folder();
    let frames = write(&path);
    let mut bytes = std::fs::read(&path).unwrap();
    let wanted = gaussians(1, 400);
    let pattern = bytemuck::bytes_of(&wanted[3]);
    let at = bytes
        .windows(64)
        .position(|window| window == pattern)
        .unwrap();
    bytes[at] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    let output = folder.path().join("recovered.mcap");
    let report = recover(&path, &output, false).unwrap();
    assert_eq!(report.chunks_damaged, 1);
    let mut steps = Vec::new();
    let mut gaps = Vec::new();
    for event in Recording::open(&output).unwrap() {
        match event.unwrap() {
            Event::Frame(frame) => {
                let step = frame.header.step;
                assert!(is_same(&frame.gaussians, &frames[step as usize]), "{step}");
                steps.push(step);
            }
            Event::Gap(gap) => gaps.push((gap.from_step, gap.to_step, gap.reason)),
            _ => {}
        }
    }
    let [(from, Some(to), GapReason::Damaged)] = gaps[..] else {
        panic!("{gaps:?}");
    };
    assert!(from <= 400 && 400 <= to, "{from} to {to}");
    let expected: Vec<u64> = (0..from).chain(to + 1..STEPS).collect();
    assert_eq!(steps, expected);
    assert_eq!(
        (report.frames, report.last_step),
        (steps.len() as u64, Some(699))
    );
}

#[test]
fn a_compacted_recording_reads_as_the_one_that_it_was_made_of() {
    let (folder, path) = folder();
    let frames = write(&path);
    let small = folder.path().join("small.mcap");
    let mut seen = (0, 0);
    let report = compact(&path, &small, false, |at, total| seen = (at, total)).unwrap();
    assert_eq!(report.frames, STEPS);
    // Both halves are told, to the last chunk at least.
    assert!(seen.1 / 2 < seen.0 && seen.0 <= seen.1, "{seen:?}");
    assert!(report.ratio > 1.0, "{report:?}");
    let events = |path: &Path| -> Vec<Event> {
        let recording = Recording::open(path).unwrap();
        recording.map(|event| event.unwrap()).collect()
    };
    let steps: Vec<u64> = events(&small)
        .iter()
        .filter_map(|event| match event {
            Event::Frame(frame) => {
                let step = frame.header.step;
                assert!(is_same(&frame.gaussians, &frames[step as usize]), "{step}");
                Some(step)
            }
            _ => None,
        })
        .collect();
    assert_eq!(steps, (0..STEPS).collect::<Vec<_>>());
    let mut tape = Tape::open(Chunks::open(&small).unwrap(), RUN.epoch, |_, _| {}).unwrap();
    for step in [699, 0, 350, 131, 640, 301] {
        assert_eq!(tape.seek(step), Some(step));
        let played = tape.advance().unwrap().unwrap();
        assert!(
            is_same(&played.frame.gaussians, &frames[step as usize]),
            "{step}"
        );
        assert_eq!(played.objects, Some(objects(step)), "{step}");
    }
    // Once more changes nothing, and what is damaged or there already is left alone.
    let again = folder.path().join("again.mcap");
    let report = compact(&small, &again, false, |_, _| {}).unwrap();
    assert_eq!(report.frames, STEPS);
    assert!(compact(&path, &again, false, |_, _| {}).is_err());
    assert!(compact(&path, &path, true, |_, _| {}).is_err());
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    let before = std::fs::read(&again).unwrap();
    assert!(compact(&path, &again, true, |_, _| {}).is_err());
    assert!(
        std::fs::read(&again).unwrap() == before,
        "what was there stays"
    );
}

#[test]
fn whole_frames_of_older_recorders_are_compacted_as_well() {
    let (folder, path) = folder();
    RUN.write(&path, &WriterOptions::default());
    let small = folder.path().join("small.mcap");
    compact(&path, &small, false, |_, _| {}).unwrap();
    assert_eq!(RUN.checked_steps(&small), (0..STEPS).collect::<Vec<_>>());
    let mut tape = Tape::open(Chunks::open(&small).unwrap(), RUN.epoch, |_, _| {}).unwrap();
    tape.seek(333);
    let played = tape.advance().unwrap().unwrap();
    assert!(is_same(&played.frame.gaussians, &RUN.frame(333)));
}

/// Found by `fuzz/run recording`: memory was set aside for as many Gaussians as a frame announced.
#[test]
fn a_whole_frame_takes_the_memory_of_what_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("boast.mcap");
    let mut writer = RecordingWriter::create(&path, &WriterOptions::default()).unwrap();
    RUN.begin(&mut writer);
    let (header, slots) = message(0, true);
    let header = ChangesHeader {
        gaussians: u32::MAX,
        ..header
    };
    writer.changes(&header, &slots, None).unwrap();
    writer.finish().unwrap();
    let error = Recording::open(&path).unwrap().find_map(Result::err);
    let words = error.expect("a refusal").to_string();
    let expected = format!("tells {} Gaussians, but", RUN.gaussians);
    assert!(words.contains(&expected), "{words}");
    assert!(words.contains(&u32::MAX.to_string()), "{words}");
}
