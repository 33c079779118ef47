//! Orders and what they are on the wire.

use super::*;

fn wired(order: &Order) -> Result<wire::Command, OrderError> {
    order.to_wire(&Lookup {
        objects: &["left".into(), "right".into()],
        colliders: &["floor".into(), "gripper".into()],
        materials: &|value| match value.law.as_deref() {
            Some("von_mises") => Ok(wire::MaterialSpec {
                law: 3,
                parameters: [value.numbers["yield_stress_pa"], 0.0, 0.0, 0.0],
                ..Default::default()
            }),
            _ => Err(format!("no material {value:?}")),
        },
    })
}

#[test]
fn objects_go_by_name_or_id() {
    let push = |object: &str| Order::Push {
        object: object.parse().expect("infallible"),
        impulse: [1.0, 2.0, 3.0],
        point: None,
        radius: None,
    };
    assert_eq!(wired(&push("right")).map(|c| c.object), Ok(1));
    assert_eq!(wired(&push("0")).map(|c| c.object), Ok(0));
    let error = wired(&push("middle")).expect_err("no such object");
    assert!(error.to_string().contains("left, right"), "{error}");
}

#[test]
fn colliders_go_by_name_and_turn_by_a_rotation_vector() {
    let order = Order::MoveCollider {
        collider: ObjectRef::Name("gripper".into()),
        translation: [1.0, 2.0, 3.0],
        rotation_deg: [0.0, 90.0, 0.0],
    };
    let command = wired(&order).expect("valid");
    assert_eq!(
        (command.kind, command.object),
        (wire::COMMAND_MOVE_COLLIDER, 1)
    );
    assert_eq!(command.vector, [1.0, 2.0, 3.0]);
    let turn = command.point[1] - std::f64::consts::FRAC_PI_2;
    assert!(turn.abs() < 1e-12, "{:?}", command.point);
    let order = Order::MoveCollider {
        collider: ObjectRef::Name("left".into()),
        translation: [0.0; 3],
        rotation_deg: [0.0; 3],
    };
    let error = wired(&order).expect_err("an object is no collider");
    assert!(error.to_string().contains("floor, gripper"), "{error}");
}

#[test]
fn a_pin_without_a_point_holds_the_whole_object() {
    let pin = |point| Order::Pin {
        object: ObjectRef::Id(1),
        point,
        radius: None,
    };
    let command = wired(&pin(None)).expect("valid");
    assert_eq!((command.kind, command.radius), (wire::COMMAND_PIN, 0.0));
    let command = wired(&pin(Some([0.0; 3]))).expect("valid");
    assert_eq!(command.radius, DEFAULT_PUSH_RADIUS);
}

#[test]
fn a_grab_pulls_nowhere_until_it_is_told_where_to() {
    let grab = |to| Order::Grab {
        object: ObjectRef::Name("right".into()),
        point: [0.1, 0.2, 0.3],
        to,
        radius: None,
        steps: 90,
    };
    let command = wired(&grab(None)).expect("valid");
    assert_eq!((command.kind, command.object), (wire::COMMAND_GRAB, 1));
    assert_eq!(
        (command.vector, command.point),
        ([0.1, 0.2, 0.3], [0.1, 0.2, 0.3])
    );
    assert_eq!(
        (command.radius, command.material.region),
        (DEFAULT_PUSH_RADIUS, 90)
    );
    let command = wired(&grab(Some([1.0; 3]))).expect("valid");
    assert_eq!(command.vector, [1.0; 3]);
    let right = ObjectRef::Id(1);
    let drag = Order::Drag {
        object: right.clone(),
        to: [4.0; 3],
    };
    let command = wired(&drag).expect("valid");
    assert_eq!(
        (command.kind, command.vector),
        (wire::COMMAND_DRAG, [4.0; 3])
    );
    let command = wired(&Order::LetGo { object: right }).expect("valid");
    assert_eq!((command.kind, command.object), (wire::COMMAND_LET_GO, 1));
}

#[test]
fn a_point_makes_a_local_push() {
    let order = Order::Push {
        object: ObjectRef::Id(0),
        impulse: [1.0, 0.0, 0.0],
        point: Some([0.0, 1.0, 0.0]),
        radius: None,
    };
    let command = wired(&order).expect("valid");
    assert_eq!(command.kind, wire::COMMAND_IMPULSE_AT);
    assert_eq!(command.radius, DEFAULT_PUSH_RADIUS);
}

#[test]
fn a_force_turns_the_whole_or_pushes_at_a_point() {
    let force = |point| Order::Force {
        object: ObjectRef::Id(1),
        force: [1.0, 0.0, 0.0],
        torque: [0.0, 0.0, 2.0],
        point,
        radius: None,
    };
    let command = wired(&force(None)).expect("valid");
    assert_eq!(
        (command.kind, command.point),
        (wire::COMMAND_FORCE, [0.0, 0.0, 2.0])
    );
    let command = wired(&force(Some([0.0, 1.0, 0.0]))).expect("valid");
    assert_eq!(
        (command.kind, command.point),
        (wire::COMMAND_FORCE_AT, [0.0, 1.0, 0.0])
    );
    let command = wired(&Order::Step { count: 7 }).expect("valid");
    assert_eq!((command.kind, command.object), (wire::COMMAND_STEP, 7));
}

#[test]
fn a_material_is_a_name_or_a_table_and_may_be_for_a_region() {
    let order = |material: &str| {
        let text = format!("action = 'set-material'\nobject = 'left'\n{material}");
        toml::from_str::<Order>(&text).expect("valid")
    };
    let material = "region = 2\nmaterial = { law = 'von_mises', yield_stress_pa = 5 }";
    let command = wired(&order(material)).expect("known");
    assert_eq!((command.material.law, command.material.region), (3, 2));
    assert_eq!(command.material.parameters[0], 5.0);
    let error = wired(&order("material = 'unobtainium'")).expect_err("no such preset");
    assert!(error.to_string().contains("unobtainium"), "{error}");
}

#[test]
fn a_pose_is_for_what_it_names_and_edits_have_words() {
    let read = |text: &str| wired(&toml::from_str::<Order>(text).expect("valid")).expect("known");
    let command = read("action = 'set-pose'\nobject = 'right'\nposition = [1.0, 2.0, 3.0]");
    assert_eq!((command.kind, command.object), (wire::COMMAND_SET_POSE, 1));
    assert_eq!(command.vector, [1.0, 2.0, 3.0]);
    assert_eq!(command.material.region, wire::POSE_KEEP_ROTATION);
    let command = read("action = 'bring-in'\nobject = 1\nrotation_deg = [0.0, 0.0, 90.0]");
    assert_eq!(command.kind, wire::COMMAND_BRING_IN);
    assert_eq!(command.material.region, wire::POSE_KEEP_PLACE);
    assert!((command.point[2] - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    let command = read("action = 'set-fidelity'\nobject = 0\nfidelity = 'rigid'");
    assert_eq!(command.kind, wire::COMMAND_SET_FIDELITY);
    assert_eq!(command.material.region, 4);
    assert_eq!(read("action = 'remove'\nobject = 1").object, 1);
    assert_eq!(read("action = 'undo'").kind, wire::COMMAND_UNDO);
    assert_eq!(read("action = 'redo'").kind, wire::COMMAND_REDO);
    let cancel = read("action = 'cancel'");
    assert_eq!((cancel.kind, cancel.object), (wire::COMMAND_CANCEL, 1));
    assert!(
        "matter"
            .parse::<Level>()
            .expect_err("no level")
            .contains("mpm")
    );
}

#[test]
fn a_patch_of_a_material_is_a_ball_or_a_box() {
    let set = |point, radius, half| {
        wired(&Order::SetMaterial {
            object: ObjectRef::Id(1),
            region: 0,
            material: MaterialRef::Value(MaterialValue {
                law: Some("von_mises".into()),
                numbers: [("yield_stress_pa".to_owned(), 7.0)].into(),
                ..Default::default()
            }),
            point,
            radius,
            half,
        })
    };
    let place = |command: &wire::Command| (command.point, command.radius, command.vector);
    let (at, none) = ([1.0, 2.0, 3.0], [0.0; 3]);
    let whole = set(None, None, None).expect("valid");
    assert_eq!(place(&whole), (none, 0.0, none));
    let ball = set(Some(at), Some(0.2), None).expect("valid");
    assert_eq!(place(&ball), (at, 0.2, none));
    let unsaid = set(Some(at), None, None).expect("valid");
    assert_eq!(place(&unsaid), (at, DEFAULT_PUSH_RADIUS, none));
    let in_box = set(Some(at), None, Some([0.1, 0.2, 0.3])).expect("valid");
    assert_eq!(place(&in_box), (at, 0.0, [0.1, 0.2, 0.3]));
    assert_eq!(set(None, None, Some(at)), Err(OrderError::NoCentre));
}
