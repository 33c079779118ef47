//! What changed from step to step: late readers, readers that lost messages, and messages that do not add up.

use std::time::Duration;

use cosplat_ipc::{
    Client, ServerPorts,
    assembly::{Assembly, AssemblyError, Placement},
    client::ChangesReader,
    schema::{
        CHANGE_FORM, CHANGE_GAUSSIANS, CHANGE_PLACED, ChangeSlot, ChangesHeader, GaussianState,
        ObjectChange, row_slots,
    },
    server::ChangesReaders,
};

use super::support::{COUNT, PATIENCE, TestDomain, serve};

/// A quarter turn about z.
const QUARTER: [f64; 4] = [
    0.0,
    0.0,
    std::f64::consts::FRAC_1_SQRT_2,
    std::f64::consts::FRAC_1_SQRT_2,
];

/// Publishes a step as a server does: all of it for who is new, a place otherwise.
fn send_changes(ports: &mut ServerPorts, step: u64) -> ChangesReaders {
    let readers = ports.changes_readers();
    let is_new = readers == ChangesReaders::New;
    let gaussians = if is_new { COUNT } else { 0 };
    if readers == ChangesReaders::None {
        return readers;
    }
    let mut loan = ports.loan_changes(1, gaussians).expect("memory");
    let (rows, own) = loan.parts_mut();
    rows[0] = ObjectChange {
        kind: if is_new { CHANGE_FORM } else { CHANGE_PLACED },
        count: COUNT as u32,
        slot: if is_new { row_slots(1) as u32 } else { 0 },
        position: [step as f64, 0.0, 0.0],
        rotation: QUARTER,
        ..ObjectChange::default()
    };
    for (gaussian, i) in own.iter_mut().zip(0..) {
        *gaussian = GaussianState {
            position: [i as f32, 0.0, 0.0],
            covariance: [4.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            rotation: [0.0, 0.0, 0.0, 1.0],
            index: i,
            ..GaussianState::default()
        };
    }
    let header = ChangesHeader {
        step,
        since: step - u64::from(!is_new),
        gaussians: COUNT as u32,
        ..ChangesHeader::default()
    };
    ports.send_changes(loan, &header, true).expect("sent");
    readers
}

/// Reads all that is there into `frame`; returns the steps.
fn read(reader: &mut ChangesReader, frame: &mut Assembly) -> Vec<u64> {
    let mut steps = Vec::new();
    let mut wait = PATIENCE;
    while let Some(changes) = reader.next(wait).expect("readable") {
        frame
            .apply(changes.header(), changes.items())
            .expect("it adds up");
        steps.push(changes.header().step);
        wait = Duration::ZERO;
    }
    steps
}

#[test]
fn a_late_reader_of_changes_begins_with_all_of_it() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "changes");
    // Nobody reads: nothing is made.
    assert_eq!(send_changes(&mut ports, 1), ChangesReaders::None);
    let client = Client::connect(&domain, "changes", "test", PATIENCE).expect("attached");
    let (mut early, mut seen) = (client.changes(64).expect("a reader"), Assembly::default());
    assert_eq!(send_changes(&mut ports, 2), ChangesReaders::New);
    assert_eq!(send_changes(&mut ports, 3), ChangesReaders::Same);
    assert_eq!(read(&mut early, &mut seen), [2, 3]);
    let header = seen.header().expect("a frame");
    assert_eq!((header.step, header.epoch), (3, ports.epoch()));
    let gaussian = seen.gaussians()[7];
    // Turned by a quarter, then moved: what is rounded is the root of two.
    let near = |a: f32, b: f32| (a - b).abs() < 1e-6;
    assert!(near(gaussian.position[0], 3.0) && near(gaussian.position[1], 7.0));
    assert!(near(gaussian.covariance[0], 1.0) && near(gaussian.covariance[3], 4.0));
    assert!(near(gaussian.rotation[2], QUARTER[2] as f32));
    assert_eq!(gaussian.index, 7);

    let (mut late, mut other) = (client.changes(64).expect("a reader"), Assembly::default());
    assert_eq!(send_changes(&mut ports, 4), ChangesReaders::New);
    assert_eq!(send_changes(&mut ports, 5), ChangesReaders::Same);
    assert_eq!(read(&mut late, &mut other), [4, 5]);
    assert_eq!(read(&mut early, &mut seen), [4, 5]);
    assert_eq!(seen.gaussians(), other.gaussians());
}

#[test]
fn a_reader_that_lost_messages_is_given_all_again() {
    let domain = TestDomain::new();
    let mut ports = serve(&domain, "overrun");
    let client = Client::connect(&domain, "overrun", "test", PATIENCE).expect("attached");
    let (mut reader, mut frame) = (client.changes(2).expect("a reader"), Assembly::default());
    for step in 1..=8 {
        send_changes(&mut ports, step);
    }
    // The complete message was among those that its short queue lost.
    assert!(reader.next(Duration::ZERO).expect("readable").is_none());
    for step in 9..=10 {
        send_changes(&mut ports, step);
    }
    assert_eq!(read(&mut reader, &mut frame), [9, 10]);
    let step = frame.header().expect("a frame").step;
    assert_eq!(frame.gaussians()[0].position[0], step as f32);
}

/// A message of one row and `gaussians` Gaussians.
fn message(row: ObjectChange, since: u64, gaussians: usize) -> (ChangesHeader, Vec<ChangeSlot>) {
    let mut slots = vec![ChangeSlot::default(); row_slots(1) + gaussians];
    bytemuck::cast_slice_mut::<_, u8>(&mut slots)[..80].copy_from_slice(bytemuck::bytes_of(&row));
    let header = ChangesHeader {
        step: 5,
        since,
        count: slots.len() as u32,
        objects: 1,
        gaussians: 4,
        ..ChangesHeader::default()
    };
    (header, slots)
}

#[test]
fn changes_that_do_not_add_up_are_refused_with_a_reason() {
    let whole = ObjectChange {
        object: 1,
        kind: CHANGE_GAUSSIANS,
        count: 4,
        slot: row_slots(1) as u32,
        ..ObjectChange::default()
    };
    let refusal = |row: ObjectChange, since| {
        let mut frame = Assembly::default();
        let (header, slots) = message(whole, 5, 4);
        frame.apply(&header, &slots).expect("a whole frame");
        let (mut header, slots) = message(row, since, 4);
        if since != 5 {
            header.step = 6;
        }
        let error = frame
            .apply(&header, &slots)
            .expect_err("it does not add up");
        // What came half way is no frame.
        assert_eq!(frame.header(), None);
        error
    };
    let placed = ObjectChange {
        kind: CHANGE_PLACED,
        ..whole
    };
    assert_eq!(refusal(placed, 5), AssemblyError::NoForm { object: 1 });
    let missed = AssemblyError::Missed {
        step: 6,
        since: 4,
        expected: Some(5),
    };
    assert_eq!(refusal(whole, 4), missed);
    let unknown = ObjectChange { kind: 9, ..whole };
    assert!(matches!(
        refusal(unknown, 5),
        AssemblyError::UnknownKind { kind: 9, .. }
    ));
    let few = ObjectChange { count: 3, ..whole };
    assert_eq!(
        refusal(few, 5),
        AssemblyError::Incomplete {
            actual: 3,
            expected: 4
        }
    );
    for bad in [
        ObjectChange { first: 1, ..whole },
        ObjectChange { slot: 3, ..whole },
        ObjectChange {
            slot: u32::MAX,
            ..whole
        },
        ObjectChange {
            count: u32::MAX,
            ..whole
        },
        ObjectChange {
            first: u32::MAX,
            kind: CHANGE_FORM,
            ..whole
        },
    ] {
        assert!(
            matches!(refusal(bad, 5), AssemblyError::Range { .. }),
            "{bad:?}"
        );
    }
    // Rows that are not there are no rows.
    let mut frame = Assembly::default();
    let (header, _) = message(whole, 5, 4);
    assert!(frame.apply(&header, &[]).is_err());
}

#[test]
fn a_place_without_turn_or_way_changes_no_bit() {
    let own = GaussianState {
        position: [0.1, -0.2, 0.3],
        covariance: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
        rotation: [0.5, 0.5, 0.5, 0.5],
        ..GaussianState::default()
    };
    let mut world = [GaussianState::default()];
    let nowhere = Placement {
        position: [0.0; 3],
        rotation: [0.0, 0.0, 0.0, 1.0],
    };
    nowhere.place(&[own], &mut world);
    assert_eq!(world[0], own);
}
