//! What is written is what is read back, and what the schemas say.

use super::*;

/// Numbers whose shortest decimal form is long, very large, very small, or negative zero.
fn awkward(i: usize) -> f64 {
    [
        0.1,
        -0.0,
        5e-324,
        f64::MAX,
        1.0 / 3.0,
        123_456_789.123_456_79,
        -2.5e-17,
    ][i % 7]
}

#[test]
fn objects_come_back_bit_for_bit() {
    let v = |o: usize| [awkward(o), awkward(o + 1), awkward(o + 2)];
    let object = wire::ObjectState {
        id: 7,
        fidelity: 2,
        mass: awkward(0),
        com: v(1),
        rotation: [awkward(2), awkward(3), awkward(4), awkward(5)],
        linear_velocity: v(3),
        angular_velocity: v(4),
        inertia: std::array::from_fn(awkward),
        radius: awkward(6),
        kinetic_energy: awkward(2),
        elastic_energy: awkward(4),
        contact_impulse: v(5),
    };
    let json = serde_json::to_vec(&Twin(object)).unwrap();
    let back: ObjectRecord = serde_json::from_slice(&json).unwrap();
    assert_eq!(bytemuck::bytes_of(&back.0), bytemuck::bytes_of(&object));
}

/// A wire type with another number in every byte, and zero in reserved ones; no number is NaN.
fn counted<W: wire::Wire>() -> W {
    let mut value = W::zeroed();
    for (n, field) in W::FIELDS.iter().enumerate() {
        let bytes = &mut bytemuck::bytes_of_mut(&mut value)[field.offset..][..field.size];
        if field.field != "reserved" {
            let numbers = (0..field.size).map(|at| (7 * n + 13 * at + 1) as u8 % 127);
            bytes.iter_mut().zip(numbers).for_each(|(to, n)| *to = n);
        }
    }
    value
}

#[test]
fn no_field_of_the_wire_is_lost() {
    fn comes_back<W: wire::Wire + PartialEq + std::fmt::Debug>() {
        let value: W = counted();
        let json = serde_json::to_vec(&Twin(value)).unwrap();
        let back: Twin<W> = serde_json::from_slice(&json).unwrap();
        assert_eq!(bytemuck::bytes_of(&back.0), bytemuck::bytes_of(&value));
        // What is missing is an error but where older recorders did not write it.
        let whole: serde_json::Map<_, _> = serde_json::from_slice(&json).unwrap();
        for field in W::FIELDS.iter().filter(|field| field.field != "reserved") {
            let mut less = whole.clone();
            less.remove(field.field).expect("every field is there");
            let read = serde_json::from_value::<Twin<W>>(less.into());
            assert_eq!(read.is_ok(), is_added(field), "{}", field.field);
        }
    }
    comes_back::<wire::Status>();
    comes_back::<wire::ObjectState>();
    comes_back::<wire::MaterialSpec>();
    let header: wire::FrameHeader = counted();
    let record = StatusRecord::new(&header, None);
    assert_eq!(
        bytemuck::bytes_of(&record.header()),
        bytemuck::bytes_of(&header)
    );
    let header: wire::ObjectsHeader = counted();
    let record = ObjectsRecord::new(&header, &[]);
    assert_eq!(
        bytemuck::bytes_of(&record.header()),
        bytemuck::bytes_of(&header)
    );
    let entry = JournalEntry {
        applied: counted(),
        epoch: Some(1),
        index: Some(2),
    };
    let back = JournalEntry::from(&JournalRecord::from(&entry));
    assert_eq!(back, entry);
}

#[test]
fn journal_and_status_come_back_bit_for_bit() {
    let entry = wire::AppliedCommand {
        step: u64::MAX >> 12,
        client: u64::MAX - 1,
        command: wire::Command {
            kind: wire::COMMAND_SET_MATERIAL,
            object: 3,
            sequence: 9,
            apply_at_step: 12,
            vector: [awkward(0), awkward(1), awkward(2)],
            point: [awkward(4), awkward(5), awkward(6)],
            radius: awkward(4),
            material: wire::MaterialSpec {
                law: 6,
                region: 2,
                youngs_modulus: 1e6 / 3.0,
                poisson_ratio: 0.3,
                parameters: [awkward(3), awkward(1), 0.4, 0.0],
            },
        },
    };
    let numbered = JournalEntry {
        applied: entry,
        epoch: Some(u64::MAX),
        index: Some(4),
    };
    let json = serde_json::to_vec(&JournalRecord::from(&numbered)).unwrap();
    let back: JournalRecord = serde_json::from_slice(&json).unwrap();
    assert_eq!(
        bytemuck::bytes_of(&wire::AppliedCommand::from(&back)),
        bytemuck::bytes_of(&entry)
    );
    assert_eq!(JournalEntry::from(&back), numbered);

    let header = wire::FrameHeader {
        step: 5,
        sim_time: 5.0 / 60.0,
        dt: 1.0 / 777.0,
        epoch: u64::MAX,
        state_hash: 0xdead_beef_dead_beef,
        publish_ns: 77,
        count: 4,
        substeps: 13,
        flags: wire::FRAME_FLAG_LAST,
        ..Default::default()
    };
    let status: wire::Status = counted();
    let json = serde_json::to_vec(&StatusRecord::new(&header, Some(&status))).unwrap();
    let back: StatusRecord = serde_json::from_slice(&json).unwrap();
    assert_eq!(
        bytemuck::bytes_of(&back.header()),
        bytemuck::bytes_of(&header)
    );
    let board = back.board.unwrap().0;
    assert_eq!(bytemuck::bytes_of(&board), bytemuck::bytes_of(&status));
}

#[test]
fn numbers_that_are_not_finite_do_not_make_a_message_unreadable() {
    let status = wire::Status {
        kinetic_energy: f64::INFINITY,
        linear_momentum: [1.0, f64::NAN, 3.0],
        ..Default::default()
    };
    let header = wire::FrameHeader {
        dt: f64::NAN,
        ..Default::default()
    };
    let json = serde_json::to_vec(&StatusRecord::new(&header, Some(&status))).unwrap();
    let back: StatusRecord = serde_json::from_slice(&json).unwrap();
    assert!(back.dt.is_nan());
    let board = back.board.unwrap();
    assert!(board.kinetic_energy.is_nan() && board.linear_momentum[1].is_nan());
    assert_eq!(
        (board.linear_momentum[0], board.linear_momentum[2]),
        (1.0, 3.0)
    );
    let short = r#"{"law": 1, "youngs_modulus": null}"#;
    assert!(serde_json::from_str::<MaterialRecord>(short).is_err());
}

#[test]
fn every_schema_names_exactly_the_fields_that_are_written() {
    let board = Twin(wire::Status::default());
    let status = StatusRecord {
        board: Some(board),
        since: Some(1),
        ..StatusRecord::new(&wire::FrameHeader::default(), None)
    };
    let of_many = wire::ObjectsHeader {
        count: 3,
        ..Default::default()
    };
    let objects = ObjectsRecord::new(&of_many, &[Default::default()]);
    let journal = JournalRecord::from(&JournalEntry {
        applied: Default::default(),
        epoch: Some(1),
        index: Some(2),
    });
    let gap = GapRecord {
        epoch: Hex64(1),
        from_step: 2,
        to_step: Some(3),
        reason: GapReason::Missed,
    };
    check(&status, crate::topics::STATUS_SCHEMA);
    check(&objects, crate::topics::OBJECTS_SCHEMA);
    check(&journal, crate::topics::JOURNAL_SCHEMA);
    check(&gap, crate::topics::GAPS_SCHEMA);

    fn check(value: &impl Serialize, schema: &str) {
        let schema: serde_json::Value = serde_json::from_str(schema).unwrap();
        same_shape(&serde_json::to_value(value).unwrap(), &schema, "");
    }

    fn same_shape(value: &serde_json::Value, schema: &serde_json::Value, at: &str) {
        use serde_json::Value;
        let kinds = match &schema["type"] {
            Value::String(one) => vec![one.as_str()],
            Value::Array(many) => many.iter().filter_map(Value::as_str).collect(),
            other => panic!("{at}: schema type is {other}"),
        };
        let kind = match value {
            Value::Object(_) => "object",
            Value::Array(_) => "array",
            Value::String(_) => "string",
            Value::Number(n) if n.is_f64() => "number",
            Value::Number(_) => "integer",
            other => panic!("{at}: unexpected value {other}"),
        };
        assert!(
            kinds.contains(&kind),
            "{at}: value is {kind}, schema {kinds:?}"
        );
        if let Value::Object(map) = value {
            let properties = schema["properties"].as_object().unwrap();
            let names: Vec<_> = properties.keys().collect();
            assert_eq!(map.keys().collect::<Vec<_>>(), names, "fields at {at}");
            for (name, inner) in map {
                same_shape(inner, &properties[name], &format!("{at}/{name}"));
            }
        }
        if let Value::Array(items) = value {
            same_shape(&items[0], &schema["items"], &format!("{at}[]"));
        }
    }
}
