//! Small scenes built in code, and commands to them, for tests of this crate and of those that compare it with another solver.

pub use cosplat_matter::test_scenes::*;

use crate::{
    Action,
    scene::{
        Aabb, Collider, ColliderMotion, ColliderShape, DomainPolicy, ImpulseAmount, Pose,
        RegionImpulse, Scene, Surface, TimeSpan,
    },
};

/// Everything at once: thin and moving colliders, a commanded one, held and pushed particles, walls; and what is ordered
/// before which frame.
pub fn busy() -> (Scene, Vec<(usize, Action)>) {
    let mut scene = cube();
    scene.objects[0].velocity_gradient = spin([1.0, 2.0, -1.0]);
    scene.conditions.domain_policy = DomainPolicy::Bounce;
    scene.domain = Aabb {
        min: [-0.5, -0.5, -0.6],
        max: [0.5, 0.5, 1.0],
    };
    let plate = ColliderShape::Box {
        half_extents: [0.3, 0.3, 0.004],
    };
    scene.colliders.push(Collider {
        friction: Some(0.2),
        restitution: 0.3,
        motion: ColliderMotion::Velocity {
            linear: [0.0, 0.1, 0.2],
            angular: [0.3, 0.0, 2.0],
            span: TimeSpan {
                start: 0.05,
                end: 0.3,
            },
        },
        ..Collider::fixed(
            "plate",
            plate,
            Pose::at([0.05, 0.0, -0.1]),
            Surface::Separate,
        )
    });
    let ball = ColliderShape::Sphere { radius: 0.25 };
    scene.colliders.push(Collider {
        friction: Some(0.4),
        ..Collider::fixed("ball", ball, Pose::at([0.3, 0.1, -0.4]), Surface::Slip)
    });
    scene.conditions.impulses = vec![RegionImpulse {
        selection: upper_quarter(),
        amount: ImpulseAmount::Total([20.0, 10.0, 0.0]),
        start: 0.1,
        duration: 0.05,
    }];
    let span = TimeSpan {
        start: 0.0,
        end: 0.08,
    };
    scene.conditions.prescribed = vec![held([0.0, 0.1, 0.0], span)];
    let actions = vec![
        (
            9,
            Action::MoveCollider {
                collider: 1,
                pose: Pose::at([0.25, 0.05, -0.3]),
            },
        ),
        (
            12,
            Action::Pin {
                object: 0,
                point: [0.0, 0.0, 0.2],
                radius: 0.1,
            },
        ),
        (20, Action::Release { object: 0 }),
    ];
    (scene, actions)
}
