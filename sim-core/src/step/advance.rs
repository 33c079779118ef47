//! Motion of sixteen particles by what they gathered, and what it is checked against.

use super::{
    constitutive::Answer,
    gather::{Gathered, gather},
    lanes::{load3, load9, store3, store9},
    pass::Pass,
    stencil::Stencil,
    touch::{LaneConditions, LaneIds},
};
use crate::{
    grid::Tile,
    kinematics::advance_deformation,
    mat3::{Mat3, dot},
    num::Real,
    particles::{BLOCK, Block, Extremes, Group, Motion},
    simd::{F32x16, Lanes},
};

/// Extremes of a run, one lane each.
pub(super) struct Largest<V> {
    pub speed: V,
    rate: V,
    stretch: V,
    min_j: V,
    max_j: V,
    stiffness: V,
    reach: V,
}

impl<V: Lanes> Largest<V> {
    #[inline(always)]
    pub fn none() -> Self {
        let zero = V::broadcast(0.0);
        Self {
            speed: zero,
            rate: zero,
            stretch: zero,
            min_j: V::broadcast(f32::INFINITY),
            max_j: zero,
            stiffness: zero,
            reach: zero,
        }
    }

    /// Takes in where particles are in the end; unused lanes are at the centre.
    #[inline(always)]
    pub fn take_place(&mut self, x: [V; 3]) {
        let [x, y, z] = x;
        self.reach = self.reach.max(x.abs().max(y.abs().max(z.abs())));
    }

    /// Takes in speed and velocity gradient of moved particles.
    #[inline(always)]
    pub fn take_motion(&mut self, live: V::Mask, speed_squared: V, rate_squared: V) {
        let zero = V::broadcast(0.0);
        self.speed = self.speed.max(V::select(live, speed_squared, zero));
        self.rate = self.rate.max(V::select(live, rate_squared, zero));
    }

    /// Takes in the law's answer about group `n` of a pair; returns the lanes that are turned inside out.
    #[inline(always)]
    pub fn take_answer(&mut self, live: V::Mask, answer: &Answer, n: usize) -> V::Mask {
        let zero = V::broadcast(0.0);
        let stretch = V::load(&answer.stretch_squared[n]);
        let stiffness = V::load(&answer.stiffness[n]);
        let j = V::load(&answer.j[n]);
        self.stretch = self.stretch.max(V::select(live, stretch, zero));
        self.stiffness = self.stiffness.max(V::select(live, stiffness, zero));
        self.max_j = self.max_j.max(V::select(live, j, zero));
        self.min_j = self.min_j.min(V::select(live, j, self.min_j));
        // Written so that NaN counts as bad.
        !zero.lt(j)
    }

    #[inline(always)]
    pub fn extremes(self) -> Extremes {
        let fold = |v: V, f: fn(f32, f32) -> f32| {
            let mut lanes = F32x16::ZERO;
            v.store(&mut lanes);
            lanes.0.into_iter().reduce(f).unwrap_or(0.0)
        };
        Extremes {
            speed_squared: fold(self.speed, f32::max),
            rate_squared: fold(self.rate, f32::max),
            stretch_squared: fold(self.stretch, f32::max),
            min_j: fold(self.min_j, f32::min),
            max_j: fold(self.max_j, f32::max),
            stiffness: fold(self.stiffness, f32::max),
            reach: fold(self.reach, f32::max),
        }
    }
}

/// What a moved particle is checked against.
pub(super) struct Limits<V> {
    pub dt: V,
    /// Frame velocity [cells/s] and displacement [cells].
    frame_velocity: [[V; 3]; 2],
    /// Square of the largest `dt |C|`.
    strain_squared: V,
    /// Corners of the domain, relative to the block's centre [cells].
    domain: [[V; 3]; 2],
}

impl<V: Lanes> Limits<V> {
    #[inline(always)]
    pub fn new(pass: &Pass<'_>, block: &Block) -> Self {
        let mut domain = [[V::broadcast(0.0); 3]; 2];
        let mut frame_velocity = domain;
        for a in 0..3 {
            frame_velocity[0][a] = V::broadcast(pass.frame_velocity[a] as f32);
            frame_velocity[1][a] =
                V::broadcast((f64::from(pass.dt) * pass.frame_velocity[a]) as f32);
        }
        for n in 0..2 {
            for a in 0..3 {
                let centre = f64::from(BLOCK * block.index[a]) + 1.5;
                domain[n][a] = V::broadcast((pass.domain[n][a] - centre) as f32);
            }
        }
        Self {
            dt: V::broadcast(pass.dt),
            frame_velocity,
            strain_squared: V::broadcast(pass.max_strain * pass.max_strain),
            domain,
        }
    }
}

/// Sixteen particles after gathering and advancing.
pub(super) struct Moved<V: Real> {
    pub v: [V; 3],
    pub c: Mat3<V>,
    pub bad: V::Mask,
    pub outside: V::Mask,
}

/// Gathers from the grid and advances position and deformation; lanes that are not `live` stay as they are.
#[expect(
    clippy::too_many_arguments,
    reason = "a kernel: the caller's borrows of its buffers stay split"
)]
#[inline(always)]
pub(super) fn advance<V: Lanes>(
    group: &mut Group,
    shape: Option<&mut [F32x16; 9]>,
    deforms: bool,
    live: V::Mask,
    velocities: &Tile,
    limits: &Limits<V>,
    touch: Option<(&LaneConditions<'_>, LaneIds<'_>)>,
    largest: &mut Largest<V>,
) -> Moved<V> {
    let zero = V::broadcast(0.0);
    let x = load3::<V>(&group.x);
    let Gathered { mut v, mut c, .. } = gather(velocities, &Stencil::new(x));
    if let Some((touch, ids)) = touch {
        let mut gathered = Motion::REST;
        store3(v, &mut gathered.v);
        store9(&c, &mut gathered.c);
        touch.shield(ids, &group.x, velocities, &mut gathered);
        (v, c) = (load3(&gathered.v), load9(&gathered.c));
    }
    let dt = V::select(live, limits.dt, zero);
    let shift = &limits.frame_velocity[1];
    let x = [
        dt.mul_add(v[0], V::select(live, shift[0], zero)) + x[0],
        dt.mul_add(v[1], V::select(live, shift[1], zero)) + x[1],
        dt.mul_add(v[2], V::select(live, shift[2], zero)) + x[2],
    ];
    store3(x, &mut group.x);
    let mut increment = c;
    for i in 0..3 {
        for j in 0..3 {
            increment.0[i][j] = dt * c.0[i][j];
        }
    }
    if deforms {
        store9(
            &advance_deformation(&load9(&group.f), &increment),
            &mut group.f,
        );
    }
    if let Some(shape) = shape {
        store9(&advance_deformation(&load9(shape), &increment), shape);
    }
    judge(x, v, c, increment.norm_squared(), live, limits, largest)
}

/// Checks moved particles against the limits.
#[inline(always)]
fn judge<V: Lanes>(
    x: [V; 3],
    v: [V; 3],
    c: Mat3<V>,
    strain_squared: V,
    live: V::Mask,
    limits: &Limits<V>,
    largest: &mut Largest<V>,
) -> Moved<V> {
    let u = &limits.frame_velocity[0];
    let total = [v[0] + u[0], v[1] + u[1], v[2] + u[2]];
    let bad = !strain_squared.lt(limits.strain_squared);
    let mut outside = bad;
    for a in 0..3 {
        outside = outside | x[a].lt(limits.domain[0][a]) | limits.domain[1][a].lt(x[a]);
    }
    largest.take_motion(live, dot(total, total), c.norm_squared());
    Moved { v, c, bad, outside }
}

/// Lanes whose motion is NaN, infinite or too fast for any substep.
#[inline(always)]
pub(super) fn absurd<V: Lanes>(pass: &Pass<'_>, motion: &Motion) -> V::Mask {
    let v = load3::<V>(&motion.v);
    let speed = dot(v, v).lt(V::broadcast(pass.max_speed * pass.max_speed));
    let rate = load9::<V>(&motion.c).norm_squared();
    !(speed & rate.lt(V::broadcast(pass.max_rate * pass.max_rate)))
}
