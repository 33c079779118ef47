//! Scene files with colliders and prescribed motion: what becomes of their keys.

use cosplat_sim_core::{
    Scene,
    scene::{
        ColliderMotion, ColliderShape, DomainPolicy, ImpulseAmount, Pose, Surface, TimeSpan,
        TriangleMesh,
    },
};

use super::*;

const HEAD: &str = r#"version = 1
dx = 0.1
[[objects]]
name = "ball"
shape = { kind = "sphere", radius = 0.5 }
material = "jelly"
"#;

fn built(text: &str) -> (Scene, BuildReport) {
    let text = format!("{HEAD}{text}");
    let file = SceneFile::parse(&text).unwrap_or_else(|e| panic!("{e}"));
    let corner = TriangleMesh {
        points: vec![[0.0; 3], [2.0, 0.0, 0.0], [0.0, 0.0, 4.0]],
        triangles: vec![[0, 1, 2]],
    };
    let no_objects = &mut |_: &str, _: &str, _: usize| Err("no objects".into());
    let load_mesh = &mut |path: &str| {
        assert_eq!(path, "wall.obj");
        Ok(corner.clone())
    };
    let load = &mut |_: &str| Err("no assets".into());
    build_with_files(&file, load, load_mesh, no_objects).unwrap_or_else(|e| panic!("{e}"))
}

fn errors(text: &str) -> String {
    let error = SceneFile::parse(&format!("{HEAD}{text}")).expect_err("wrong");
    error.to_string()
}

#[test]
fn colliders_take_shape_pose_surface_and_motion_from_their_keys() {
    let (scene, report) = built(
        r#"
[[colliders]]
name = "lid"
shape = "capsule"
radius = 0.1
height = 0.5
translation = [0, 2, 0]
surface = "slip"
friction = 0.2
restitution = 0.7
start_time = 1
end_time = 3
motion = { angular_velocity = [0, 1, 0], end_time = 2 }
[[colliders]]
name = "wall"
shape = "mesh"
path = "wall.obj"
up = "z"
scale = 0.5
anchor = "center"
translation = [3, 0, 0]
motion = { keyframes = [{ time = 1, translation = [4, 0, 0] }] }
"#,
    );
    // The lid meets a ball of matter alone.
    let [warning] = &report.warnings[..] else {
        panic!("{:?}", report.warnings)
    };
    assert!(warning.message.contains("restitution 0.7"), "{warning}");
    let [lid, wall] = &scene.colliders[..] else {
        panic!("two colliders")
    };
    assert_eq!(
        lid.shape,
        ColliderShape::Capsule {
            radius: 0.1,
            half_height: 0.15
        }
    );
    assert_eq!((lid.surface, lid.friction), (Surface::Slip, Some(0.2)));
    assert_eq!(lid.restitution, 0.7);
    assert_eq!(
        lid.span,
        TimeSpan {
            start: 1.0,
            end: 3.0
        }
    );
    let ColliderMotion::Velocity { angular, span, .. } = lid.motion else {
        panic!("{:?}", lid.motion)
    };
    assert_eq!(angular, [0.0, 1.0, 0.0]);
    assert_eq!(
        span,
        TimeSpan {
            start: 0.0,
            end: 2.0
        }
    );
    let ColliderShape::Mesh(mesh) = &wall.shape else {
        panic!("{:?}", wall.shape)
    };
    // Half as large, z up, its box centred: x spans 1, the height 2 comes from z.
    let expected = [[-0.5, -1.0, 0.0], [0.5, -1.0, 0.0], [-0.5, 1.0, 0.0]];
    for (point, expected) in mesh.points.iter().zip(expected) {
        let near = (0..3).all(|a| (point[a] - expected[a]).abs() < 1e-12);
        assert!(near, "{point:?}, expected {expected:?}");
    }
    let ColliderMotion::Keyframes(frames) = &wall.motion else {
        panic!("{:?}", wall.motion)
    };
    assert_eq!(frames[0].pose, Pose::at([4.0, 0.0, 0.0]));
}

#[test]
fn prescribed_particles_are_selected_by_object_and_region() {
    let (scene, report) = built(
        r#"
[domain]
policy = "stop"
[[prescribed]]
object = "ball"
box = { min = [-1, 0, -1], max = [1, 1, 1] }
[[prescribed]]
sphere = { center = [9, 9, 9], radius = 0.1 }
[[impulses]]
force = [0, 2, 0]
duration = 0.5
[[impulses]]
impulse_per_particle = [1, 0, 0]
[[releases]]
axis = [0, 2, 0]
start_position = 0.5
end_position = -0.5
end_time = 1
"#,
    );
    let conditions = &scene.conditions;
    assert_eq!(conditions.domain_policy, DomainPolicy::Stop);
    let count = scene.particles.position.len();
    let upper = conditions.prescribed[0].selection.particles(&scene);
    assert!(
        upper.len().abs_diff(count / 2) < count / 20,
        "{}",
        upper.len()
    );
    let above = |p: &u32| scene.particles.position[*p as usize][1] >= 0.0;
    assert!(upper.iter().all(above));
    let warnings: Vec<_> = report.warnings.iter().map(|w| &w.at.field).collect();
    assert_eq!(warnings, ["prescribed[1]"]);
    assert_eq!(
        conditions
            .impulses
            .iter()
            .map(|i| i.amount)
            .collect::<Vec<_>>(),
        [
            ImpulseAmount::Total([0.0, 1.0, 0.0]),
            ImpulseAmount::PerParticle([1.0, 0.0, 0.0])
        ]
    );
    let release = conditions.releases[0];
    assert_eq!((release.axis, release.layers), ([0.0, 1.0, 0.0], 50));
}

#[test]
fn what_is_wrong_with_boundaries_is_said_with_its_place() {
    for (text, expected) in [
        (
            "[[colliders]]\nname = \"a\"\nshape = \"box\"",
            "`size` is missing",
        ),
        (
            "[[colliders]]\nname = \"a\"\nshape = \"sphere\"\nradius = 1\nsize = [1, 1, 1]",
            "colliders[0].size: unknown key",
        ),
        (
            "[[colliders]]\nname = \"a\"\nshape = \"capsule\"\nradius = 1\nheight = 1",
            "height is 1 m, expected at least 2 m",
        ),
        (
            "[[colliders]]\nname = \"a\"\nnormal = [0, 1, 0]\nrestitution = 1.5",
            "colliders[0].restitution: is 1.5, expected 0.0 to 1.0",
        ),
        (
            "[[colliders]]\nname = \"a\"\nnormal = [0, 1, 0]\nmotion = { keyframes = [{ time = 1, translation = [0, 0, 0] }, { time = 1, translation = [0, 1, 0] }] }",
            "expected ascending times",
        ),
        (
            "[[prescribed]]\nobject = \"bal\"",
            "prescribed[0].object: object `bal` does not exist: did you mean `ball`?",
        ),
        (
            "[[prescribed]]\nstart_time = 2\nend_time = 1",
            "start_time is 2 s, expected at most end_time",
        ),
        ("[[impulses]]\nforce = [0, 1, 0]", "`duration` is 0 s"),
        ("[[impulses]]", "has no strength"),
        (
            "[[releases]]\naxis = [0, 1, 0]\nstart_position = 0\nend_position = 1",
            "`end_time` is missing",
        ),
        ("[domain]\npolicy = \"explode\"", "`explode` is not known"),
        ("[domain]\nmin = [0, 0, 0]", "`max` is missing"),
    ] {
        let found = errors(text);
        assert!(found.contains(expected), "{expected:?} not in {found}");
        assert_eq!(found.lines().count(), 1, "{found}");
    }
}
