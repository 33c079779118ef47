//! Signed distance and outward normal of every shape, in the collider's frame and unit.

use parry3d_f64::{math::Vector, shape::SharedShape};

use super::{
    mesh::Mesh,
    primitives::{Distance, ball, box_distance, cylinder_distance, unit},
};
use crate::{mat3::dot, scene::ColliderShape};

/// A shape of [`ColliderShape`] with lengths in the solver's unit.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Half of space, up to a plane through the origin.
    HalfSpace {
        /// Unit normal, outwards.
        normal: [f64; 3],
    },
    /// A box about the origin.
    Box {
        /// Half its edges.
        half_extents: [f64; 3],
    },
    /// A sphere about the origin.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// A cylinder along y.
    Cylinder {
        /// Its radius.
        radius: f64,
        /// Half its length.
        half_height: f64,
    },
    /// A cylinder along y with half a sphere at either end.
    Capsule {
        /// Its radius.
        radius: f64,
        /// Half the length of the cylinder.
        half_height: f64,
    },
    /// Triangles.
    Mesh(Box<Mesh>),
}

impl Shape {
    /// The scene's shape with lengths in units of `scale` metres.
    pub fn new(shape: &ColliderShape, scale: f64) -> Self {
        match shape {
            ColliderShape::HalfSpace { normal } => Self::HalfSpace {
                normal: unit(*normal, dot(*normal, *normal).sqrt()),
            },
            ColliderShape::Box { half_extents } => Self::Box {
                half_extents: half_extents.map(|x| x / scale),
            },
            ColliderShape::Sphere { radius } => Self::Sphere {
                radius: radius / scale,
            },
            ColliderShape::Cylinder {
                radius,
                half_height,
            } => Self::Cylinder {
                radius: radius / scale,
                half_height: half_height / scale,
            },
            ColliderShape::Capsule {
                radius,
                half_height,
            } => Self::Capsule {
                radius: radius / scale,
                half_height: half_height / scale,
            },
            ColliderShape::Mesh(mesh) => Self::Mesh(Box::new(Mesh::new(mesh, scale))),
        }
    }

    /// Distance from a point of the shape's frame.
    pub fn distance(&self, x: [f64; 3]) -> Distance {
        match *self {
            Self::HalfSpace { normal } => Distance {
                value: dot(normal, x),
                normal,
            },
            Self::Box { half_extents } => box_distance(half_extents, x),
            Self::Sphere { radius } => ball(x, radius),
            Self::Cylinder {
                radius,
                half_height,
            } => cylinder_distance(radius, half_height, x),
            Self::Capsule {
                radius,
                half_height,
            } => {
                let y = x[1] - x[1].clamp(-half_height, half_height);
                ball([x[0], y, x[2]], radius)
            }
            Self::Mesh(ref mesh) => mesh.distance(x),
        }
    }

    /// The shape as parry knows it; none of a mesh without triangles.
    pub fn for_contact(&self) -> Option<SharedShape> {
        Some(match *self {
            Self::HalfSpace { normal } => SharedShape::halfspace(Vector::from(normal)),
            Self::Box {
                half_extents: [x, y, z],
            } => SharedShape::cuboid(x, y, z),
            Self::Sphere { radius } => SharedShape::ball(radius),
            Self::Cylinder {
                radius,
                half_height,
            } => SharedShape::cylinder(half_height, radius),
            Self::Capsule {
                radius,
                half_height,
            } => SharedShape::capsule_y(half_height, radius),
            Self::Mesh(ref mesh) => SharedShape(mesh.surface()?.clone()),
        })
    }

    /// Radius of a ball about the origin that holds the shape; infinite for a half-space.
    pub fn radius(&self) -> f64 {
        match *self {
            Self::HalfSpace { .. } => f64::INFINITY,
            Self::Box { half_extents } => dot(half_extents, half_extents).sqrt(),
            Self::Sphere { radius } => radius,
            Self::Cylinder {
                radius,
                half_height,
            } => radius.hypot(half_height),
            Self::Capsule {
                radius,
                half_height,
            } => radius + half_height,
            Self::Mesh(ref mesh) => mesh.radius(),
        }
    }

    /// Smallest thickness: what a point must cross at least from surface to surface; 0 for an open mesh.
    pub fn thickness(&self) -> f64 {
        match *self {
            Self::HalfSpace { .. } => f64::INFINITY,
            Self::Box { half_extents } => {
                2.0 * half_extents.into_iter().fold(f64::INFINITY, f64::min)
            }
            Self::Sphere { radius } | Self::Capsule { radius, .. } => 2.0 * radius,
            Self::Cylinder {
                radius,
                half_height,
            } => 2.0 * radius.min(half_height),
            Self::Mesh(ref mesh) => mesh.thickness(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{scene::TriangleMesh, test_scenes::box_mesh};

    /// Points, their distances and normals, worked out by hand.
    fn check(shape: &Shape, cases: &[([f64; 3], f64, [f64; 3])]) {
        for &(x, value, normal) in cases {
            let found = shape.distance(x);
            assert!((found.value - value).abs() < 1e-12, "{x:?}: {found:?}");
            for a in 0..3 {
                assert!(
                    (found.normal[a] - normal[a]).abs() < 1e-12,
                    "{x:?}: {found:?}"
                );
            }
        }
    }

    fn shapes() -> Vec<Shape> {
        let scene = [
            ColliderShape::HalfSpace {
                normal: [0.6, 0.8, 0.0],
            },
            ColliderShape::Box {
                half_extents: [1.0, 2.0, 3.0],
            },
            ColliderShape::Sphere { radius: 2.0 },
            ColliderShape::Cylinder {
                radius: 1.0,
                half_height: 2.0,
            },
            ColliderShape::Capsule {
                radius: 1.0,
                half_height: 2.0,
            },
            ColliderShape::Mesh(Arc::new(box_mesh([1.0, 2.0, 3.0]))),
        ];
        scene.iter().map(|shape| Shape::new(shape, 0.5)).collect()
    }

    #[test]
    fn distances_and_normals_are_those_of_the_closed_forms() {
        // In units of half a metre all lengths double.
        let [plane, cuboid, sphere, cylinder, capsule, mesh] = &shapes()[..] else {
            panic!("six shapes")
        };
        check(plane, &[([3.0, 4.0, 9.0], 5.0, [0.6, 0.8, 0.0])]);
        for cuboid in [cuboid, mesh] {
            check(
                cuboid,
                &[
                    ([3.0, 0.5, 0.5], 1.0, [1.0, 0.0, 0.0]),
                    ([5.0, -8.0, 1.0], 5.0, [0.6, -0.8, 0.0]),
                    ([0.5, -3.5, 0.2], -0.5, [0.0, -1.0, 0.0]),
                ],
            );
        }
        check(
            sphere,
            &[
                ([3.0, 0.0, 4.0], 1.0, [0.6, 0.0, 0.8]),
                ([0.0, -1.0, 0.0], -3.0, [0.0, -1.0, 0.0]),
            ],
        );
        check(
            cylinder,
            &[
                ([3.0, 1.0, 0.0], 1.0, [1.0, 0.0, 0.0]),
                ([0.0, 5.0, 1.0], 1.0, [0.0, 1.0, 0.0]),
                ([5.0, 8.0, 0.0], 5.0, [0.6, 0.8, 0.0]),
                ([0.0, 0.5, -1.5], -0.5, [0.0, 0.0, -1.0]),
            ],
        );
        check(
            capsule,
            &[
                ([0.0, 7.0, 0.0], 1.0, [0.0, 1.0, 0.0]),
                ([3.0, 8.0, 0.0], 3.0, [0.6, 0.8, 0.0]),
                ([0.0, 1.0, -1.0], -1.0, [0.0, 0.0, -1.0]),
            ],
        );
    }

    #[test]
    fn the_normal_is_the_gradient_of_the_distance() {
        for shape in shapes() {
            for n in 0..200 {
                let [a, b, c] = [0.37, 0.61, 0.83].map(|s| f64::from(n) * s);
                let x = [
                    a.fract() * 10.0 - 5.0,
                    b.fract() * 10.0 - 5.0,
                    c.fract() * 14.0 - 7.0,
                ];
                let here = shape.distance(x);
                let h = 1e-6;
                let gradient: [f64; 3] = std::array::from_fn(|a| {
                    let shifted = |s: f64| {
                        let mut y = x;
                        y[a] += s;
                        shape.distance(y).value
                    };
                    (shifted(h) - shifted(-h)) / (2.0 * h)
                });
                // Where two faces are equally near there is no gradient; the length tells.
                if (dot(gradient, gradient) - 1.0).abs() < 1e-6 {
                    for a in 0..3 {
                        let error = (gradient[a] - here.normal[a]).abs();
                        assert!(error < 1e-6, "{shape:?} at {x:?}: {gradient:?}, {here:?}");
                    }
                }
                // Along the normal lies the surface.
                let surface = std::array::from_fn(|a| x[a] - here.value * here.normal[a]);
                let left = shape.distance(surface).value;
                assert!(
                    left.abs() < 1e-9,
                    "{shape:?} at {x:?}: {here:?} leaves {left}"
                );
            }
        }
    }

    #[test]
    fn thickness_is_that_of_the_thinnest_part() {
        let found: Vec<f64> = shapes().iter().map(Shape::thickness).collect();
        let expected = [f64::INFINITY, 4.0, 8.0, 4.0, 4.0, 4.0];
        for (value, expected) in found.iter().zip(expected) {
            let near = *value == expected || (value - expected).abs() < 1e-6;
            assert!(near, "{found:?}");
        }
        let open = TriangleMesh {
            triangles: box_mesh([1.0; 3]).triangles[2..].to_vec(),
            ..box_mesh([1.0; 3])
        };
        let open = Shape::new(&ColliderShape::Mesh(Arc::new(open)), 1.0);
        assert_eq!(open.thickness(), 0.0);
        // From an open one the distance is positive on both sides.
        assert!((open.distance([0.9, 0.0, 0.0]).value - 0.1).abs() < 1e-12);
        assert!((open.distance([1.2, 0.0, 0.0]).value - 0.2).abs() < 1e-12);
    }
}
