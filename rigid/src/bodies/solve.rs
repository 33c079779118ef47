//! Impulses at points of contact: one point by the bilinear law, several by projected Gauss-Seidel sweeps.

use super::vector::{Vec3, add, along, length, scaled, solve, sub};
use crate::mat3::{Mat3, cross, dot};

/// Most sweeps over the points of bodies.
const SWEEPS: usize = 40;
/// Points below which more sweeps are allowed, as many as cost the same: the two rims of a disk that lies on its side
/// and what rubs on them depend on each other so much that each sweep leaves 0.87 of the error.
const FEW: usize = 20;
/// Sweeps end when no impulse changes by more than this part of the largest.
const DONE: f64 = 1e-11;

/// How a body answers to impulses, and how it moves.
#[derive(Clone, Copy, Debug)]
pub struct Mover {
    /// 0 of what nothing moves.
    pub inverse_mass: f64,
    /// Of its world frame, likewise [1/(kg m^2)].
    pub inverse_inertia: Mat3<f64>,
    /// Of its centre of mass [m/s].
    pub velocity: Vec3,
    /// Angular velocity [rad/s].
    pub spin: Vec3,
}

/// A point where body `a` meets body `b`, or a wall.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// The body.
    pub a: usize,
    /// The other; none: a wall.
    pub b: Option<usize>,
    /// Out of `b` into `a`.
    pub normal: Vec3,
    /// From the two centres of mass.
    pub arms: [Vec3; 2],
    /// Velocity of the wall, where there is no `b`; else what `b` has besides that of its motion.
    pub wall: Vec3,
    /// Coulomb coefficient `mu_f`.
    pub friction: f64,
    /// Restitution `e`, 0 to 1.
    pub restitution: f64,
    /// Least normal velocity that [`sweep`] leaves.
    pub target: f64,
    /// Whether it holds `a` back too.
    pub holds: bool,
    /// Whether it holds `a` along the surface.
    pub sticks: bool,
    /// Impulse on `a` along the normal [N s].
    pub normal_impulse: f64,
    /// Impulse on `a` across it [N s].
    pub friction_impulse: Vec3,
    /// Relative velocity before.
    pub before: Vec3,
}

impl Point {
    /// Velocity of `a` relative to `b`.
    pub fn relative(&self, movers: &[Mover]) -> Vec3 {
        let at = |n: usize, r: Vec3| add(movers[n].velocity, cross(movers[n].spin, r));
        let other = match self.b {
            Some(b) => add(at(b, self.arms[1]), self.wall),
            None => self.wall,
        };
        sub(at(self.a, self.arms[0]), other)
    }

    /// Velocity change at the point per impulse along `n`, in the direction of `n`.
    fn inverse_effective_mass(&self, movers: &[Mover], n: Vec3) -> f64 {
        let of = |m: &Mover, r: Vec3| {
            let lever = cross(r, n);
            m.inverse_mass + dot(lever, m.inverse_inertia.mul_vec(lever))
        };
        let other = self.b.map_or(0.0, |b| of(&movers[b], self.arms[1]));
        of(&movers[self.a], self.arms[0]) + other
    }

    /// The matrix `K`: velocity change at the point per impulse.
    fn delassus(&self, movers: &[Mover]) -> Mat3<f64> {
        let mut k = Mat3::diagonal([0.0; 3]);
        let both = [Some(self.a), self.b];
        for (n, r) in both.into_iter().zip(self.arms) {
            let Some(n) = n else { continue };
            let [x, y, z] = r;
            let arm = Mat3([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]);
            // -[r] I^-1 [r] = [r] I^-1 [r]^T
            let turn = arm.mul(&movers[n].inverse_inertia).mul_transposed(&arm);
            let move_ = Mat3::diagonal([movers[n].inverse_mass; 3]);
            k = k.blend(1.0, &turn.blend(1.0, &move_, 1.0), 1.0);
        }
        k
    }

    /// Gives both an impulse, `j` on `a`.
    pub fn push(&self, movers: &mut [Mover], j: Vec3) {
        let mut give = |n: usize, r: Vec3, j: Vec3| {
            let m = &mut movers[n];
            m.velocity = along(m.velocity, m.inverse_mass, j);
            m.spin = add(m.spin, m.inverse_inertia.mul_vec(cross(r, j)));
        };
        give(self.a, self.arms[0], j);
        if let Some(b) = self.b {
            give(b, self.arms[1], scaled(j, -1.0));
        }
    }

    /// Impulse so far.
    pub fn impulse(&self) -> Vec3 {
        along(self.friction_impulse, self.normal_impulse, self.normal)
    }
}

/// A single impact by the bilinear law of Chatterjee and Ruina (1998): restitution `e` along the normal, friction
/// within Coulomb's cone, and never a gain of energy wherever the point is.
pub(crate) fn impact(point: &mut Point, movers: &mut [Mover]) {
    let u = point.relative(movers);
    let n = point.normal;
    let u_n = dot(u, n);
    if u_n >= 0.0 && !point.holds {
        return;
    }
    let k = point.delassus(movers);
    let k_n = k.mul_vec(n);
    let free = scaled(n, -u_n / dot(n, k_n));
    let stuck = scaled(solve(&k, u), -1.0);
    let slip = sub(stuck, free);
    let e = point.restitution;
    let mut j = if point.sticks {
        stuck
    } else if u_n >= 0.0 {
        // Held back from leaving: nothing presses, nothing rubs.
        free
    } else {
        along(slip, 1.0 + e, free)
    };
    let across = |j: Vec3| along(j, -dot(j, n), n);
    if !point.sticks && u_n < 0.0 && length(across(j)) > point.friction * dot(j, n) {
        // The share of sticking at which friction is just what it may be.
        let bound = length(across(slip)) - point.friction * dot(slip, n);
        let share = point.friction * (1.0 + e) * dot(free, n) / bound;
        j = along(
            scaled(free, 1.0 + e),
            if bound > 0.0 { share } else { 0.0 },
            slip,
        );
    }
    // No gain, to round-off.
    let (work, bend) = (dot(u, j), dot(j, k.mul_vec(j)));
    if work + 0.5 * bend > 0.0 && bend > 0.0 {
        j = scaled(j, (-2.0 * work / bend).clamp(0.0, 1.0));
    }
    point.normal_impulse += dot(j, n);
    point.friction_impulse = add(point.friction_impulse, across(j));
    point.push(movers, j);
}

/// Most sweeps over so many points.
pub(super) fn sweeps(points: usize) -> usize {
    SWEEPS * (FEW / points.max(1)).max(1)
}

/// Several points together: each in turn gets the impulse that brings its normal velocity to its
/// target or more; sums of impulses press and never pull, and rub no more than Coulomb's law allows.
pub fn sweep(points: &mut [Point], movers: &mut [Mover], sweeps: usize) {
    let yields: Vec<f64> = points
        .iter()
        .map(|p| p.inverse_effective_mass(movers, p.normal))
        .collect();
    for _ in 0..sweeps {
        let (mut most, mut change) = (0.0_f64, 0.0_f64);
        for (point, k_n) in points.iter_mut().zip(&yields) {
            if *k_n <= 0.0 {
                continue;
            }
            let n = point.normal;
            let u = point.relative(movers);
            let wanted = point.normal_impulse + (point.target - dot(u, n)) / k_n;
            let total = if point.holds { wanted } else { wanted.max(0.0) };
            let step = total - point.normal_impulse;
            point.normal_impulse = total;
            point.push(movers, scaled(n, step));
            most = most.max(total.abs());
            change = change.max(step.abs());
            let limit = if point.sticks {
                f64::INFINITY
            } else {
                point.friction * total.max(0.0)
            };
            if limit > 0.0 || point.friction_impulse != [0.0; 3] {
                let step = apply_friction(point, movers, limit);
                most = most.max(length(point.friction_impulse));
                change = change.max(step);
            }
        }
        if change <= DONE * most {
            break;
        }
    }
}

/// Friction of one point against its tangential velocity; returns how much it changed.
fn apply_friction(point: &mut Point, movers: &mut [Mover], limit: f64) -> f64 {
    let n = point.normal;
    let u = point.relative(movers);
    let slide = along(u, -dot(u, n), n);
    let speed = length(slide);
    let mut wanted = point.friction_impulse;
    if speed > 0.0 {
        let direction = scaled(slide, 1.0 / speed);
        let k = point.inverse_effective_mass(movers, direction);
        wanted = along(wanted, -speed / k, direction);
    }
    let size = length(wanted);
    if size > limit {
        wanted = scaled(wanted, limit / size);
    }
    let step = sub(wanted, point.friction_impulse);
    point.friction_impulse = wanted;
    point.push(movers, step);
    length(step)
}

/// Work of the impulses in the frames of what the bodies meet: what kinetic energy they add. The second part of the
/// pair is that of impulses of the same size on bodies at rest.
fn work(points: &[Point], movers: &[Mover]) -> (f64, f64) {
    let (mut given, mut bend) = (0.0, 0.0);
    for point in points {
        let j = point.impulse();
        given += dot(j, point.before);
        bend += dot(j, sub(point.relative(movers), point.before));
    }
    (given + 0.5 * bend, bend)
}

/// Scales all impulses back to where they add no kinetic energy, if they do.
pub(crate) fn settle_energy(points: &mut [Point], movers: &mut [Mover]) {
    let (gain, bend) = work(points, movers);
    if gain <= 0.0 || bend <= 0.0 {
        return;
    }
    // gain = g + b / 2 with g the linear part; s g + s^2 b / 2 = 0.
    let keep = (1.0 - 2.0 * gain / bend).clamp(0.0, 1.0);
    for point in points {
        let back = scaled(point.impulse(), keep - 1.0);
        point.push(movers, back);
        point.normal_impulse *= keep;
        point.friction_impulse = scaled(point.friction_impulse, keep);
    }
}
