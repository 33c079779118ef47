//! Small scenes built in code, for tests of this crate and of those that compare it with another solver.

use crate::{
    Action,
    materials::{Law, Material},
    scene::{
        Aabb, Collider, ColliderMotion, ColliderShape, DomainPolicy, ImpulseAmount, Object, Pose,
        PrescribedMotion, Region, RegionImpulse, Scene, Selection, Surface, TimeSpan, TriangleMesh,
    },
};

/// Numbers between -1 and 1 by a fixed linear congruence.
pub fn random(seed: &mut u64) -> f64 {
    *seed = seed
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// A scene without objects, gravity or boundaries in a cube of 200 m.
pub fn empty(dx: f64) -> Scene {
    Scene::empty("test", dx)
}

/// A material of density 1000 kg/m^3.
pub fn elastic(law: Law, youngs_modulus: f64, poisson_ratio: f64) -> Material {
    Material {
        name: "elastic".into(),
        law,
        youngs_modulus,
        poisson_ratio,
        density: 1000.0,
    }
}

/// One of each law, soft enough for some hundred substeps per simulated second on a grid of 0.1 m.
pub fn one_of_each() -> Vec<Material> {
    let laws = [
        Law::FixedCorotated,
        Law::NeoHookean,
        Law::VonMises {
            yield_stress: 3e3,
            hardening: 1e4,
        },
        Law::DruckerPrager {
            friction_angle: 30.0,
            cohesion: 50.0,
        },
        Law::Snow {
            critical_compression: 0.025,
            critical_stretch: 0.0075,
            hardening: 10.0,
        },
        Law::Foam {
            yield_stress: 1e3,
            viscosity: 300.0,
            exponent: 0.6,
        },
        Law::Plasticine {
            yield_stress: 3e3,
            softening: 2e3,
        },
        Law::Fluid {
            bulk_modulus: 2e5,
            viscosity: 2.0,
        },
        Law::Rigid,
        Law::Hencky,
    ];
    let of = |law: Law| match law {
        Law::Fluid { .. } | Law::Rigid => elastic(law, 0.0, 0.0),
        _ => elastic(law, 3e5, 0.3),
    };
    laws.into_iter().map(of).collect()
}

/// Adds a box of `cells` lattice cells with spacing `h` [m], lowest corner at `corner`; returns its object id.
pub fn add_box(
    scene: &mut Scene,
    material: Material,
    corner: [f64; 3],
    h: f64,
    cells: [usize; 3],
) -> usize {
    let start = scene.particles.position.len();
    for i in 0..cells[0] {
        for j in 0..cells[1] {
            for k in 0..cells[2] {
                let lattice = [i, j, k].map(|c| (c as f64 + 0.5) * h);
                scene
                    .particles
                    .position
                    .push(std::array::from_fn(|a| corner[a] + lattice[a]));
                scene.particles.volume.push(h * h * h);
            }
        }
    }
    let name = format!("box{}", scene.objects.len());
    let particles = start..scene.particles.position.len();
    scene.objects.push(Object::new(name, material, particles));
    scene.objects.len() - 1
}

/// The velocity gradient of a rigid spin [1/s].
pub fn spin([x, y, z]: [f64; 3]) -> [[f64; 3]; 3] {
    [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
}

/// Adds a half-space below `point`.
pub fn add_plane(
    scene: &mut Scene,
    point: [f64; 3],
    normal: [f64; 3],
    surface: Surface,
    friction: f64,
) {
    let shape = ColliderShape::HalfSpace { normal };
    scene.colliders.push(Collider {
        friction: Some(friction),
        ..Collider::fixed("plane", shape, Pose::at(point), surface)
    });
}

/// Adds a collider at the origin.
pub fn add_collider(scene: &mut Scene, shape: ColliderShape, surface: Surface) {
    let collider = Collider::fixed("collider", shape, Pose::IDENTITY, surface);
    scene.colliders.push(collider);
}

/// A box about the origin; its first two triangles are the top (+y).
pub fn box_mesh(half: [f64; 3]) -> TriangleMesh {
    let corner = |i: usize| -> [f64; 3] {
        std::array::from_fn(|a| if i >> a & 1 == 0 { -half[a] } else { half[a] })
    };
    let quads = [
        [2, 6, 7, 3],
        [0, 1, 5, 4],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    TriangleMesh {
        points: (0..8).map(corner).collect(),
        triangles: quads
            .iter()
            .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
            .collect(),
    }
}

/// A block of particles that falls and spins onto a floor with friction.
pub fn falling_block(law: Law) -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    add_box(
        &mut scene,
        elastic(law, 1e5, 0.3),
        [-0.2, -0.17, 0.06],
        0.05,
        [8, 7, 6],
    );
    scene.objects[0].linear_velocity = [0.7, 0.3, -1.0];
    scene.objects[0].velocity_gradient = spin([2.0, -3.0, 1.0]);
    add_plane(
        &mut scene,
        [0.0; 3],
        [0.0, 0.0, 1.0],
        Surface::Separate,
        0.3,
    );
    scene
}

/// A jelly cube of 0.4 m in the air.
pub fn cube() -> Scene {
    let mut scene = empty(0.1);
    scene.gravity = [0.0, 0.0, -9.81];
    let jelly = elastic(Law::FixedCorotated, 1e5, 0.3);
    add_box(&mut scene, jelly, [-0.2, -0.2, 0.0], 0.05, [8; 3]);
    scene
}

/// The upper quarter of the [`cube`].
pub fn upper_quarter() -> Selection {
    Selection {
        object: Some(0),
        region: Some(Region::Box(
            Aabb {
                min: [-1.0, -1.0, 0.3],
                max: [1.0; 3],
            }
            .into(),
        )),
    }
}

/// A velocity that the upper quarter of the [`cube`] has for some time.
pub fn held(linear: [f64; 3], span: TimeSpan) -> PrescribedMotion {
    PrescribedMotion {
        selection: upper_quarter(),
        linear,
        angular: [0.0; 3],
        center: [0.0; 3],
        span,
    }
}

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
