//! What holds matter back or moves it from outside: colliders, held regions, prescribed motion, impulses.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Scene, TurnedBox};
use crate::{mat3::dot, rotation::from_rotation_vector};

/// Part of the simulated time, `start <= t < end` [s].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeSpan {
    /// First moment.
    pub start: f64,
    /// First moment after it; may be infinite.
    pub end: f64,
}

impl TimeSpan {
    /// The whole simulation.
    pub const ALWAYS: Self = Self {
        start: 0.0,
        end: f64::INFINITY,
    };

    /// Whether the moment `t` [s] belongs to it.
    pub fn contains(&self, t: f64) -> bool {
        self.start <= t && t < self.end
    }

    /// How much of it has passed at `t` [s], at most its length.
    pub fn elapsed(&self, t: f64) -> f64 {
        (t.min(self.end) - self.start).max(0.0)
    }
}

impl Default for TimeSpan {
    fn default() -> Self {
        Self::ALWAYS
    }
}

/// Where a collider is: `world_from_collider`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// World position of the collider's origin [m].
    pub translation: [f64; 3],
    /// Rotation, unit quaternion xyzw.
    pub rotation: [f64; 4],
}

impl Pose {
    /// At the world's origin, not turned.
    pub const IDENTITY: Self = Self {
        translation: [0.0; 3],
        rotation: [0.0, 0.0, 0.0, 1.0],
    };

    /// At a point, turned by a rotation vector [rad].
    pub fn turned(translation: [f64; 3], rotation_vector: [f64; 3]) -> Self {
        Self {
            translation,
            rotation: from_rotation_vector(rotation_vector),
        }
    }

    /// At a point, not turned.
    pub const fn at(translation: [f64; 3]) -> Self {
        Self {
            translation,
            ..Self::IDENTITY
        }
    }
}

/// A rigid boundary; its id is its index in the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Collider {
    /// Unique name.
    pub name: String,
    /// Shape, in the collider's frame.
    pub shape: ColliderShape,
    /// Pose at time 0.
    pub pose: Pose,
    /// What it does to matter that touches it.
    pub surface: Surface,
    /// Coulomb coefficient `mu_f`, >= 0; no effect on sticky surfaces. Where absent, that of the object that it meets, and
    /// 0 when that states none either; where both state one, the geometric mean counts.
    pub friction: Option<f64>,
    /// Part of the approach speed that is given back to rigid bodies and to particles, 0..=1; no effect on sticky surfaces.
    pub restitution: f64,
    /// How it moves by itself.
    pub motion: ColliderMotion,
    /// When it is there.
    pub span: TimeSpan,
}

impl Collider {
    /// A collider at rest, always there, without restitution and a friction of its own.
    pub fn fixed(name: &str, shape: ColliderShape, pose: Pose, surface: Surface) -> Self {
        Self {
            name: name.into(),
            shape,
            pose,
            surface,
            friction: None,
            restitution: 0.0,
            motion: ColliderMotion::Static,
            span: TimeSpan::ALWAYS,
        }
    }
}

/// Shapes of colliders in their own frame; all but the half-space are centred at its origin.
#[derive(Clone, Debug, PartialEq)]
pub enum ColliderShape {
    /// All points with `x . normal < 0` are inside.
    HalfSpace {
        /// Outward unit normal.
        normal: [f64; 3],
    },
    /// Box along the axes.
    Box {
        /// Half the edge lengths [m].
        half_extents: [f64; 3],
    },
    /// Ball.
    Sphere {
        /// Radius [m].
        radius: f64,
    },
    /// Cylinder along y.
    Cylinder {
        /// Radius [m].
        radius: f64,
        /// Half the height [m].
        half_height: f64,
    },
    /// All points within `radius` of a segment along y.
    Capsule {
        /// Radius [m].
        radius: f64,
        /// Half the length of the segment [m]: the capsule reaches `radius` further.
        half_height: f64,
    },
    /// Triangles; a closed surface has an inside, an open one is a wall without thickness.
    Mesh(Arc<TriangleMesh>),
}

/// Triangles in the frame of their collider.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Corners [m].
    pub points: Vec<[f64; 3]>,
    /// Indices into `points`, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Velocity condition at a collider, relative to the collider's own motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surface {
    /// No relative motion.
    Sticky,
    /// No motion along the normal, in either direction; friction acts while pressed on.
    Slip,
    /// No motion into the collider, free to leave; friction acts while pressed on.
    Separate,
}

/// How a collider moves by itself; a command takes over from it.
#[derive(Clone, Debug, PartialEq)]
pub enum ColliderMotion {
    /// Not at all.
    Static,
    /// Constant velocity and spin while the span lasts, at rest before and after.
    Velocity {
        /// Velocity of its origin [m/s].
        linear: [f64; 3],
        /// Angular velocity about its origin [rad/s], world frame.
        angular: [f64; 3],
        /// When it moves.
        span: TimeSpan,
    },
    /// Through poses, linearly in position and at constant angular velocity from one to the next; at rest
    /// before the first and after the last.
    Keyframes(Vec<Keyframe>),
}

/// A pose at a moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keyframe {
    /// When [s]; ascending.
    pub time: f64,
    /// Where.
    pub pose: Pose,
}

/// A box whose grid nodes are given a velocity; it moves along with that velocity while its span lasts, and
/// acts only then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinnedRegion {
    /// The box at the start of the span [m].
    pub bounds: TurnedBox,
    /// Velocity of nodes and box [m/s].
    pub velocity: [f64; 3],
    /// When it acts.
    pub span: TimeSpan,
}

impl PinnedRegion {
    /// Nodes held at rest, always.
    pub fn fixed(bounds: impl Into<TurnedBox>) -> Self {
        Self {
            bounds: bounds.into(),
            velocity: [0.0; 3],
            span: TimeSpan::ALWAYS,
        }
    }
}

/// What happens to a particle at a face of the domain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DomainPolicy {
    /// It is taken out and reported.
    #[default]
    Delete,
    /// The faces are frictionless separating walls.
    Bounce,
    /// The simulation stops before the frame in which it would leave.
    Stop,
}

/// How velocities travel between particles and grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Transfer {
    /// Velocity and affine velocity `C`: linear fields come back as they went (Jiang et al. 2015).
    #[default]
    Apic,
    /// Velocity alone: every transfer averages (Harlow 1964).
    Pic,
}

/// Everything prescribed for particles, what the domain's faces do, transfers and damping.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Conditions {
    /// See [`DomainPolicy`].
    pub domain_policy: DomainPolicy,
    /// Rate at which all velocities decay towards rest [1/s], >= 0.
    pub damping: f64,
    /// How long everything comes to rest before time 0 [s], with velocities damped and nothing moved but by gravity; 0:
    /// matter begins without stress. Only where no rule and no collider moves by itself.
    pub settle: f64,
    /// See [`Transfer`].
    pub transfer: Transfer,
    /// Part of the strain rate of `C` that every APIC transfer to the grid drops, 0..=1 (the RPIC damping of
    /// PhysGaussian): at 1 only the rotation is left. PIC has nothing that it could drop.
    pub rpic_damping: f64,
    /// Particles with a prescribed velocity; a later one wins where several act.
    pub prescribed: Vec<PrescribedMotion>,
    /// Impulses and forces on particles.
    pub impulses: Vec<RegionImpulse>,
    /// Particles held and let go layer by layer.
    pub releases: Vec<SequentialRelease>,
}

impl Conditions {
    /// What a substep of `dt` [s] leaves of a velocity; exactly 1 without damping.
    pub fn damping_factor(&self, dt: f64) -> f64 {
        (-self.damping * dt).exp()
    }

    /// What a transfer makes of the affine velocity, `C' = a C + b C^T`, as `[a, b]`; none where it keeps it.
    pub fn affine_kept(&self) -> Option<[f64; 2]> {
        if self.transfer == Transfer::Pic {
            return Some([0.0; 2]);
        }
        let d = self.rpic_damping;
        (d > 0.0).then(|| {
            let half = 0.5 * d.min(1.0);
            [1.0 - half, -half]
        })
    }

    /// What is left of a stable time step where transfers keep only a share `k` of the strain rate of `C`.
    ///
    /// The affine mode of an isolated particle then has `C' = k C - dt omega^2 e` and `e' = e + dt C'`, which is stable
    /// for `(omega dt)^2 < 2 (1 + k)`, and where viscosity damps it for `dt` less by `(1 + k) / 2`.
    pub fn time_step_kept(&self, viscous: bool) -> f64 {
        let share = self.affine_kept().map_or(1.0, |[a, b]| 0.5 * (1.0 + a + b));
        if viscous { share } else { share.sqrt() }
    }
}

/// Which particles are meant, by their position at rest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Selection {
    /// Only those of this object.
    pub object: Option<usize>,
    /// Only those in this region.
    pub region: Option<Region>,
}

/// A region of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Region {
    /// Box.
    Box(TurnedBox),
    /// Ball.
    Sphere {
        /// Centre [m].
        center: [f64; 3],
        /// Radius [m].
        radius: f64,
    },
    /// Cylinder about an axis.
    Cylinder {
        /// Centre [m].
        center: [f64; 3],
        /// Unit vector along the axis.
        axis: [f64; 3],
        /// Radius [m].
        radius: f64,
        /// Half the height [m].
        half_height: f64,
    },
}

impl Region {
    /// Whether a point [m] is inside, faces included.
    pub fn contains(&self, x: [f64; 3]) -> bool {
        let from = |c: [f64; 3]| -> [f64; 3] { std::array::from_fn(|a| x[a] - c[a]) };
        match *self {
            Self::Box(b) => b.contains(x),
            Self::Sphere { center, radius } => {
                let r = from(center);
                dot(r, r) <= radius * radius
            }
            Self::Cylinder {
                center,
                axis,
                radius,
                half_height,
            } => {
                let r = from(center);
                let along = dot(r, axis);
                along.abs() <= half_height && dot(r, r) - along * along <= radius * radius
            }
        }
    }
}

impl Selection {
    /// The particles meant, ascending, by their position at rest.
    pub fn particles(&self, scene: &Scene) -> Vec<u32> {
        let chosen = |id: usize| self.object.is_none_or(|object| object == id);
        let objects = scene
            .objects
            .iter()
            .enumerate()
            .filter(|(id, _)| chosen(*id));
        let all = objects.flat_map(|(_, object)| object.particles.clone());
        let inside = |p: &usize| {
            self.region
                .is_none_or(|region| region.contains(scene.particles.position[*p]))
        };
        all.filter(inside).map(|p| p as u32).collect()
    }
}

/// Particles that move at `linear + angular x (x - center)` while the span lasts, whatever acts on them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrescribedMotion {
    /// Whom.
    pub selection: Selection,
    /// Velocity [m/s].
    pub linear: [f64; 3],
    /// Angular velocity [rad/s].
    pub angular: [f64; 3],
    /// A point of the axis [m]; it does not move.
    pub center: [f64; 3],
    /// When.
    pub span: TimeSpan,
}

/// An impulse spread over particles as equal velocity change, at a constant rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionImpulse {
    /// Whom.
    pub selection: Selection,
    /// How much.
    pub amount: ImpulseAmount,
    /// When it begins [s].
    pub start: f64,
    /// How long it lasts [s]; 0 for a kick.
    pub duration: f64,
}

/// Strength of a [`RegionImpulse`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImpulseAmount {
    /// On all particles together [N s].
    Total([f64; 3]),
    /// Times the number of particles selected [N s].
    PerParticle([f64; 3]),
}

/// Particles held at rest in layers of equal thickness that are let go one after the other, the layer at
/// `start_position` first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequentialRelease {
    /// Whom; those before `start_position` are never held.
    pub selection: Selection,
    /// Unit vector across the layers.
    pub axis: [f64; 3],
    /// Where the first layer begins, `x . axis` [m].
    pub start_position: f64,
    /// Where the last layer ends [m]; may be less than `start_position`.
    pub end_position: f64,
    /// Number of layers, >= 1.
    pub layers: u32,
    /// Layer i of n is let go at `start + (i + 1) / n (end - start)`; finite.
    pub span: TimeSpan,
}
