//! The way of one particle past one collider: no surface is crossed, however thin or fast.
//!
//! In the collider's frame the particle goes straight from where it was to where it wants to be. Where that
//! segment meets the surface, the velocity condition acts and the rest of the way is gone with what is left.

use super::{Placed, shape::Shape};
use crate::{mat3::dot, rotation::rotate, scene::Pose};

/// Distance that particles keep from surfaces [cells]: a thousand times the round-off of positions.
pub const SKIN: f64 = 1e-3;
/// Bisections: the place of a contact is then as exact as positions.
const BISECTIONS: usize = 40;
/// Surfaces that one particle may meet on one mesh in one substep; it stops at the last.
const BOUNCES: usize = 4;

/// A particle during a substep, in units of the solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// Where it was.
    pub from: [f64; 3],
    /// Where it goes.
    pub to: [f64; 3],
    /// Its velocity there.
    pub v: [f64; 3],
}

fn along(from: [f64; 3], to: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|a| from[a] + t * (to[a] - from[a]))
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

impl Shape {
    /// Part of the way from `from` to `to` at which the surface is met from outside, and the normal there.
    pub(super) fn first_contact(
        &self,
        from: [f64; 3],
        to: [f64; 3],
        skin: f64,
    ) -> Option<(f64, [f64; 3])> {
        match self {
            Self::Mesh(mesh) => mesh.crossing(from, to),
            Self::HalfSpace { .. }
            | Self::Box { .. }
            | Self::Sphere { .. }
            | Self::Cylinder { .. }
            | Self::Capsule { .. } => self.first_contact_of_convex(from, to, skin),
        }
    }

    /// The same of what is [convex](Self::is_convex), by the distance alone.
    fn first_contact_of_convex(
        &self,
        from: [f64; 3],
        to: [f64; 3],
        skin: f64,
    ) -> Option<(f64, [f64; 3])> {
        // The distance from a convex body is a convex function of the way: the first half of a bracket that
        // ends inside holds the crossing.
        let start = self.distance(from);
        let way = minus(to, from);
        let length = dot(way, way).sqrt();
        if start.value <= 0.0 || start.value > length {
            return None;
        }
        let mut inside = 1.0;
        let end = self.distance(to);
        if end.value > 0.0 {
            // Both ends are outside: is the lowest point between them inside?
            if dot(start.normal, way) >= 0.0 || dot(end.normal, way) <= 0.0 {
                return None;
            }
            let (mut low, mut high) = (0.0, 1.0);
            let mut found = None;
            for _ in 0..BISECTIONS {
                let t = 0.5 * (low + high);
                let here = self.distance(along(from, to, t));
                if here.value <= 0.0 {
                    found = Some(t);
                    break;
                }
                if here.value > 0.5 * (high - low) * length {
                    return None;
                }
                if dot(here.normal, way) < 0.0 {
                    low = t;
                } else {
                    high = t;
                }
            }
            inside = found?;
        }
        let mut outside = 0.0;
        for _ in 0..BISECTIONS {
            if (inside - outside) * length < 1e-3 * skin {
                break;
            }
            let t = 0.5 * (outside + inside);
            if self.distance(along(from, to, t)).value > 0.0 {
                outside = t;
            } else {
                inside = t;
            }
        }
        let normal = self.distance(along(from, to, outside)).normal;
        Some((outside, normal))
    }
}

impl Placed<'_> {
    /// Corrects the way of a particle where it meets this collider during a substep of `dt` [s]; `cell` is the
    /// cell size. Returns whether it did.
    pub fn stop(&self, way: &mut Way, dt: f64, cell: f64) -> bool {
        let skin = SKIN * cell;
        if self.clears(way, skin) {
            return false;
        }
        let mut from = self.start.inverse_point(way.from);
        let mut to = self.end.inverse_point(way.to);
        let mut met = false;
        let mut left = 1.0;
        for bounce in 0..BOUNCES {
            let Some((t, normal)) = self.body.shape.first_contact(from, to, skin) else {
                break;
            };
            met = true;
            left *= 1.0 - t;
            let surface = along(from, to, t);
            from = std::array::from_fn(|a| surface[a] + skin * normal[a]);
            let relative = self.react(way, from, normal);
            let rest = if bounce + 1 == BOUNCES {
                0.0
            } else {
                left * dt
            };
            to = std::array::from_fn(|a| from[a] + rest * relative[a]);
        }
        let end = self.body.shape.distance(to);
        if end.value < skin {
            // What starts inside is let out slowly, so that nothing jumps.
            let out = (skin - end.value).min(skin);
            to = std::array::from_fn(|a| to[a] + out * end.normal[a]);
            self.react(way, to, end.normal);
            met = true;
        }
        if met {
            way.to = self.end.point(to);
        }
        met
    }

    /// Whether both ends of a way, and so all of it, are in front of a half-space that is not turned.
    fn clears(&self, way: &Way, skin: f64) -> bool {
        let heights = [(&self.start, way.from), (&self.end, way.to)].map(|(pose, x)| {
            let Shape::HalfSpace { normal } = self.body.shape else {
                return f64::NEG_INFINITY;
            };
            match pose.rotation == Pose::IDENTITY.rotation {
                true => dot(minus(x, pose.translation), normal),
                false => f64::NEG_INFINITY,
            }
        });
        heights.iter().all(|&height| height >= skin)
    }

    /// Applies the velocity condition at a point of the collider's frame; returns the relative velocity after it
    /// in that frame.
    fn react(&self, way: &mut Way, local: [f64; 3], normal: [f64; 3]) -> [f64; 3] {
        let x = self.start.point(local);
        let u = self.velocity(x);
        let normal = rotate(self.end.rotation, normal);
        let relative = self.contact().resolve(minus(way.v, u), normal);
        way.v = std::array::from_fn(|a| u[a] + relative[a]);
        rotate(crate::rotation::conjugate(self.end.rotation), relative)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{
        colliders::{Body, Boundaries, Substep},
        scene::{Collider, ColliderMotion, ColliderShape, Surface, TimeSpan, TriangleMesh},
        test_scenes::box_mesh,
    };

    const NOW: Substep = Substep {
        time: 0.0,
        dt: 0.01,
        kick: 0.01,
        frame_start: 0.0,
        frame_length: 1.0,
    };

    fn boundaries(collider: Collider) -> Boundaries {
        Boundaries {
            bodies: vec![Body::new(&collider, 1.0, 1.0)],
            faced_regions: vec![],
            frictions: Default::default(),
            regions: vec![],
            unit: 1.0,
            cell: 1.0,
        }
    }

    fn thin_shapes() -> Vec<ColliderShape> {
        let sheet = TriangleMesh {
            points: vec![
                [-9.0, 0.0, -9.0],
                [9.0, 0.0, -9.0],
                [9.0, 0.0, 9.0],
                [-9.0, 0.0, 9.0],
            ],
            triangles: vec![[0, 2, 1], [0, 3, 2]],
        };
        vec![
            ColliderShape::Box {
                half_extents: [9.0, 0.05, 9.0],
            },
            ColliderShape::Cylinder {
                radius: 9.0,
                half_height: 0.05,
            },
            ColliderShape::Mesh(Arc::new(box_mesh([9.0, 0.05, 9.0]))),
            ColliderShape::Mesh(Arc::new(sheet)),
        ]
    }

    #[test]
    fn no_thin_wall_is_crossed_from_either_side_at_any_angle() {
        for shape in thin_shapes() {
            let wall = Collider::fixed("wall", shape, Pose::IDENTITY, Surface::Separate);
            let boundaries = boundaries(wall);
            let [wall] = &boundaries.on_particles(&vec![], &NOW)[..] else {
                panic!("a thin wall acts on particles")
            };
            for n in 0..500 {
                let part = |s: f64| (f64::from(n) * s).fract();
                let side = if n % 2 == 0 { 1.0 } else { -1.0 };
                let from = [
                    8.0 * part(0.31) - 4.0,
                    side * (0.06 + part(0.77)),
                    8.0 * part(0.53) - 4.0,
                ];
                // Up to the largest travel of a substep and beyond.
                let v = [
                    80.0 * part(0.19) - 40.0,
                    -side * 120.0 * part(0.41),
                    80.0 * part(0.67) - 40.0,
                ];
                let to = std::array::from_fn(|a| from[a] + NOW.dt * v[a]);
                let mut way = Way { from, to, v };
                wall.stop(&mut way, NOW.dt, 1.0);
                assert!(side * way.to[1] > 0.0, "{from:?} to {way:?}");
                if way.v != v {
                    assert!((way.v[1]).abs() < 1e-9, "{way:?}");
                    assert!((way.v[0] - v[0]).abs() < 1e-9, "{way:?}");
                }
            }
        }
    }

    #[test]
    fn a_particle_that_stays_clear_is_left_alone() {
        for shape in thin_shapes() {
            let wall = Collider::fixed("wall", shape, Pose::IDENTITY, Surface::Separate);
            let boundaries = boundaries(wall);
            let wall = boundaries.on_particles(&vec![], &NOW)[0];
            let mut way = Way {
                from: [0.3, 0.5, 0.2],
                to: [0.8, 0.1, 0.2],
                v: [50.0, -40.0, 0.0],
            };
            let before = way;
            assert!(!wall.stop(&mut way, NOW.dt, 1.0));
            assert_eq!(way, before);
        }
    }

    #[test]
    fn restitution_turns_the_rest_of_the_way_round() {
        let mut floor = Collider::fixed(
            "floor",
            ColliderShape::HalfSpace {
                normal: [0.0, 1.0, 0.0],
            },
            Pose::IDENTITY,
            Surface::Separate,
        );
        floor.restitution = 0.5;
        let boundaries = boundaries(floor);
        let floor = boundaries.on_particles(&vec![], &NOW)[0];
        let mut way = Way {
            from: [0.0, 0.2, 0.0],
            to: [0.0, -0.2, 0.0],
            v: [0.0, -40.0, 0.0],
        };
        assert!(floor.stop(&mut way, NOW.dt, 1.0));
        assert!((way.v[1] - 20.0).abs() < 1e-12, "{way:?}");
        // Half the way was left and is gone at half the speed.
        assert!((way.to[1] - 0.1 - SKIN).abs() < 1e-5, "{way:?}");
    }

    #[test]
    fn a_moving_wall_sweeps_up_what_stands_in_its_way() {
        for shape in thin_shapes() {
            let mut paddle = Collider::fixed("paddle", shape, Pose::IDENTITY, Surface::Separate);
            paddle.motion = ColliderMotion::Velocity {
                linear: [0.0, 70.0, 0.0],
                angular: [0.0; 3],
                span: TimeSpan::ALWAYS,
            };
            let boundaries = boundaries(paddle);
            let paddle = boundaries.on_particles(&vec![], &NOW)[0];
            let mut way = Way {
                from: [0.0, 0.3, 0.0],
                to: [0.0, 0.3, 0.0],
                v: [0.0; 3],
            };
            assert!(paddle.stop(&mut way, NOW.dt, 1.0));
            assert!((way.v[1] - 70.0).abs() < 1e-9, "{way:?}");
            assert!(way.to[1] > 0.7, "{way:?}");
        }
    }

    #[test]
    fn a_spinning_blade_pushes_with_the_speed_of_the_place_it_hits() {
        let blade = ColliderShape::Box {
            half_extents: [5.0, 0.05, 1.0],
        };
        let mut blade = Collider::fixed("blade", blade, Pose::IDENTITY, Surface::Separate);
        blade.motion = ColliderMotion::Velocity {
            linear: [0.0; 3],
            angular: [0.0, 0.0, 10.0],
            span: TimeSpan::ALWAYS,
        };
        let boundaries = boundaries(blade);
        let blade = boundaries.on_particles(&vec![], &NOW)[0];
        let mut way = Way {
            from: [4.0, 0.2, 0.0],
            to: [4.0, 0.2, 0.0],
            v: [0.0; 3],
        };
        assert!(blade.stop(&mut way, NOW.dt, 1.0));
        // 40 units/s along a normal that turned by 0.1 rad meanwhile.
        let along = dot(way.v, [-(0.1_f64.sin()), 0.1_f64.cos(), 0.0]);
        assert!((along - 40.0).abs() < 1.0, "{way:?}");
    }
}
