//! Small scenes built in code, for tests of this crate and of those that compare it with another solver.

pub use crate::num::random;

use crate::{
    mat3::dot,
    materials::{Law, Material},
    scene::{
        Aabb, Collider, ColliderShape, Object, Pose, PrescribedMotion, Region, Scene, Selection,
        Surface, TimeSpan, TriangleMesh,
    },
};

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
        loss: 0.0,
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

/// A ball [m] of a lattice of eight pieces per cell, cut ones with their volume and centroid by sampling.
pub fn ball(dx: f64, center: [f64; 3], radius: f64) -> Vec<([f64; 3], f64)> {
    const SAMPLES: i32 = 8;
    let edge = 0.5 * dx;
    let reach = (radius / edge).ceil() as i32;
    let mut pieces = vec![];
    for x in -reach..reach {
        for y in -reach..reach {
            for z in -reach..reach {
                let (mut count, mut sum) = (0, [0.0; 3]);
                for n in 0..SAMPLES.pow(3) {
                    let o = [n / SAMPLES.pow(2), n / SAMPLES % SAMPLES, n % SAMPLES];
                    let part = |a: usize| (f64::from(o[a]) + 0.5) / f64::from(SAMPLES);
                    let r = [x, y, z].map(f64::from);
                    let r: [f64; 3] = std::array::from_fn(|a| edge * (r[a] + part(a)));
                    if dot(r, r) < radius * radius {
                        count += 1;
                        sum = std::array::from_fn(|a| sum[a] + r[a]);
                    }
                }
                if count > 0 {
                    let centroid = std::array::from_fn(|a| center[a] + sum[a] / f64::from(count));
                    let share = f64::from(count) / f64::from(SAMPLES.pow(3));
                    pieces.push((centroid, share * edge.powi(3)));
                }
            }
        }
    }
    pieces
}
