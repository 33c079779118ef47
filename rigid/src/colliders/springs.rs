//! Springs by which clients hold patches of objects, through the frame at hand.
//!
//! Every particle of a patch is pulled to its place beside the target, as critically damped as an object of the effective
//! mass at the patch: `F = m (w^2 d - 2 w v)`, shared by mass. In sum that is the force of one spring on the centre of the
//! patch; what turns against the patch is damped. Places are those at which it was taken hold of, turned by the rotation that
//! the patch has made until the start of the frame: an object may turn in the hand, and no force jumps from frame to frame.

use std::sync::atomic::{AtomicU64, Ordering};

use super::Substep;
use crate::mat3::{Mat3, cross, dot, length};

/// Natural frequency `w` of a spring [rad/s]: 1000 N/m per kilogram, of the springs that other simulators give a mouse.
pub const FREQUENCY: f64 = 31.622_776_601_683_793;

/// A spring on a patch of an object.
#[derive(Debug)]
pub struct Spring {
    /// The object.
    pub object: usize,
    /// Particles of the patch, ascending.
    particles: Vec<u32>,
    /// What each of them is to it.
    members: Vec<Member>,
    /// Mass of all of them [kg].
    mass: f64,
    /// Mass that the object has there in each direction [kg].
    effective: Mat3<f64>,
    /// Largest force [N].
    max_force: f64,
    /// Where the centre is pulled to when the frame begins, and when it ends [m].
    way: [[f64; 3]; 2],
    /// When that is [s].
    span: [f64; 2],
}

/// A particle of a patch.
#[derive(Debug)]
struct Member {
    /// Its place from the centre [m].
    place: [f64; 3],
    /// Its mass [kg].
    mass: f64,
    /// The kick at hand: impulse [N s], and half of its work as far as the velocity before goes [J].
    kick: [Shared; 4],
    /// Kicks before that: impulse [N s], and work [J].
    given: [Shared; 4],
}

/// A number that one thread writes at a time: whoever has the particle.
#[derive(Debug, Default)]
struct Shared(AtomicU64);

impl Shared {
    fn get(&self) -> f64 {
        f64::from_bits(self.0.load(Ordering::Relaxed))
    }

    fn set(&self, value: f64) {
        self.0.store(value.to_bits(), Ordering::Relaxed);
    }
}

/// A particle that a spring is to hold.
#[derive(Clone, Copy, Debug)]
pub struct Grasped {
    /// Its number in the scene.
    pub id: u32,
    /// Where it is [m].
    pub x: [f64; 3],
    /// Its mass [kg].
    pub mass: f64,
}

/// A particle that a spring holds.
#[derive(Clone, Copy, Debug)]
pub struct PatchPoint {
    /// Its number in the scene.
    pub id: u32,
    /// Its place from the centre of the patch [m].
    pub place: [f64; 3],
    /// Its mass [kg].
    pub mass: f64,
}

/// What a spring is made for.
#[derive(Clone, Copy, Debug)]
pub struct Hold {
    /// The object that it holds.
    pub object: usize,
    /// Where the centre of the patch is pulled to at the start and the end of the frame [m].
    pub way: [[f64; 3]; 2],
    /// Start and end of the frame [s].
    pub span: [f64; 2],
    /// Largest force [N].
    pub max_force: f64,
}

/// Impulse [N s] and work [J] of springs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Given {
    /// Impulse [N s].
    pub impulse: [f64; 3],
    /// Work [J].
    pub work: f64,
}

impl Given {
    /// Adds more.
    pub fn add(&mut self, more: &Self) {
        for a in 0..3 {
            self.impulse[a] += more.impulse[a];
        }
        self.work += more.work;
    }
}

/// Inverse of a symmetric matrix.
fn inverse(m: &Mat3<f64>) -> Mat3<f64> {
    let (det, cofactor) = (m.det(), m.cofactor());
    Mat3(cofactor.0.map(|row| row.map(|x| x / det)))
}

/// A matrix times a number.
fn scaled(m: &Mat3<f64>, factor: f64) -> Mat3<f64> {
    Mat3(m.0.map(|row| row.map(|x| factor * x)))
}

/// Mass that a point of a rigid body has in each direction [kg]: the inverse of the velocity there per impulse there. `arm` is
/// from the centre of mass [m], `inertia` about it [kg m^2].
pub fn effective_mass(mass: f64, inertia: &Mat3<f64>, arm: [f64; 3]) -> Mat3<f64> {
    let turning = inverse(inertia);
    let column = |axis: usize| {
        let j: [f64; 3] = std::array::from_fn(|a| if a == axis { 1.0 } else { 0.0 });
        let turn = cross(turning.mul_vec(cross(arm, j)), arm);
        std::array::from_fn(|a| j[a] / mass + turn[a])
    };
    inverse(&Mat3::from_columns(column(0), column(1), column(2)))
}

/// Centre of what is grasped [m], and its mass [kg].
pub fn centre(grasped: &[Grasped]) -> ([f64; 3], f64) {
    let mass: f64 = grasped.iter().map(|p| p.mass).sum();
    let mut centre = [0.0; 3];
    for p in grasped {
        for a in 0..3 {
            centre[a] += p.mass / mass * p.x[a];
        }
    }
    (centre, mass)
}

impl Spring {
    /// A spring on these particles, in the order of their numbers; `effective` is the mass that the object has at their centre.
    pub fn new(hold: &Hold, held: &[PatchPoint], effective: Mat3<f64>) -> Self {
        let members = held.iter().map(|p| Member {
            place: p.place,
            mass: p.mass,
            kick: Default::default(),
            given: Default::default(),
        });
        Self {
            object: hold.object,
            particles: held.iter().map(|p| p.id).collect(),
            members: members.collect(),
            mass: held.iter().map(|p| p.mass).sum(),
            effective,
            max_force: hold.max_force,
            way: hold.way,
            span: hold.span,
        }
    }

    /// Which member a particle is.
    pub fn number(&self, id: u32) -> Option<usize> {
        self.particles.binary_search(&id).ok()
    }

    /// Its particles.
    pub fn held(&self) -> impl Iterator<Item = PatchPoint> + '_ {
        let all = self.particles.iter().zip(&self.members);
        all.map(|(&id, member)| PatchPoint {
            id,
            place: member.place,
            mass: member.mass,
        })
    }

    /// Where the centre is pulled to at a time [m].
    fn target(&self, time: f64) -> [f64; 3] {
        let [start, end] = self.span;
        let passed = ((time - start) / (end - start)).clamp(0.0, 1.0);
        let [from, to] = self.way;
        std::array::from_fn(|a| from[a] + passed * (to[a] - from[a]))
    }

    /// Velocity change [m/s] in a kick, of what is at `x` [m] beside its `place` and has the velocity `v` [m/s].
    ///
    /// Damping is that of the whole kick however strong it is, by the second diagonal Padé approximant with a vanishing limit.
    pub fn change(&self, at: &Kick, place: [f64; 3], x: [f64; 3], v: [f64; 3]) -> [f64; 3] {
        let wanted =
            std::array::from_fn(|a| 0.5 * FREQUENCY * (at.target[a] + place[a] - x[a]) - v[a]);
        capped(at.gain.mul_vec(wanted), at.max_change)
    }

    /// The kick of a substep.
    ///
    /// Its gain is in proportion to its length: two halves between which nothing moves, as at the end of a frame, give what a whole
    /// one does. Else a stretched patch would tremble there, and what springs give and what the patch gets would differ.
    pub fn kick(&self, now: &Substep) -> Kick {
        let whole = match now.dt > 0.0 {
            true => now.kick.max(now.dt),
            false => 2.0 * now.kick,
        };
        let z = scaled(&self.effective, 2.0 * FREQUENCY * whole / self.mass);
        // 1 - 1 / (1 + z + z^2 / 2)
        let mut rest = scaled(&z.mul(&z), 0.5);
        for a in 0..3 {
            for b in 0..3 {
                rest.0[a][b] += z.0[a][b];
            }
        }
        let mut damped = rest;
        for a in 0..3 {
            damped.0[a][a] += 1.0;
        }
        let gain = inverse(&damped).mul(&rest);
        Kick {
            target: self.target(now.time),
            gain: scaled(&gain, if whole > 0.0 { now.kick / whole } else { 0.0 }),
            max_change: now.kick * self.max_force / self.mass,
        }
    }

    /// Velocity change of a particle [m/s] in a kick, which is noted.
    pub fn pull(&self, at: &Kick, member: usize, x: [f64; 3], v: [f64; 3]) -> [f64; 3] {
        let Member {
            place, mass, kick, ..
        } = &self.members[member];
        let change = self.change(at, *place, x, v);
        let impulse = change.map(|dv| mass * dv);
        for a in 0..3 {
            kick[a].set(impulse[a]);
        }
        kick[3].set(0.5 * dot(impulse, v));
        change
    }

    /// Takes note of the velocity [m/s] that a particle has after its kick.
    pub fn settle(&self, member: usize, v: [f64; 3]) {
        let Member { kick, given, .. } = &self.members[member];
        let impulse = [0, 1, 2].map(|a| kick[a].get());
        for a in 0..3 {
            given[a].set(given[a].get() + impulse[a]);
        }
        given[3].set(given[3].get() + kick[3].get() + 0.5 * dot(impulse, v));
        kick.iter().for_each(|number| number.set(0.0));
    }

    /// What particles were given since the last call.
    pub fn take(&self) -> Given {
        let mut sum = Given::default();
        for member in &self.members {
            let [x, y, z, work] = [0, 1, 2, 3].map(|n| member.given[n].get());
            sum.add(&Given {
                impulse: [x, y, z],
                work,
            });
            member.given.iter().for_each(|number| number.set(0.0));
        }
        sum
    }

    /// Forgets what particles were given: it was undone.
    pub fn forget(&self) {
        for member in &self.members {
            let all = member.kick.iter().chain(&member.given);
            all.for_each(|number| number.set(0.0));
        }
    }

    /// Force [N] on a particle of a rigid body during the next `dt` [s], that is at `x` [m] with the velocity `v` [m/s]: what
    /// the spring has in the middle of that time, where gravity [m/s^2] pulls as well (the implicit midpoint rule).
    pub fn force(
        &self,
        member: usize,
        [time, dt]: [f64; 2],
        [x, v]: [[f64; 3]; 2],
        gravity: [f64; 3],
    ) -> [f64; 3] {
        let Member { place, mass, .. } = &self.members[member];
        let (w, target) = (FREQUENCY, self.target(time + 0.5 * dt));
        let h = w * dt;
        let pull = std::array::from_fn(|a| {
            let way = w * w * (target[a] + place[a] - x[a]);
            let slowed = way - w * (2.0 + 0.5 * h) * v[a] - h * (1.0 + 0.25 * h) * gravity[a];
            slowed / (1.0 + 0.5 * h).powi(2)
        });
        let share = mass / self.mass;
        let force = self.effective.mul_vec(pull).map(|f| share * f);
        capped(force, share * self.max_force)
    }
}

/// A spring in one kick.
#[derive(Clone, Copy, Debug)]
pub struct Kick {
    /// Where the centre is pulled to [m].
    target: [f64; 3],
    /// Share of a velocity that the kick takes.
    gain: Mat3<f64>,
    /// Largest change [m/s].
    max_change: f64,
}

/// A vector no longer than this.
fn capped(v: [f64; 3], max: f64) -> [f64; 3] {
    let size = length(v);
    match size > max {
        true => v.map(|x| x * (max / size)),
        false => v,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn on_one(mass: f64, patch: f64) -> Spring {
        let hold = Hold {
            object: 0,
            way: [[1.0, 0.0, 0.0]; 2],
            span: [0.0, 10.0],
            max_force: f64::INFINITY,
        };
        let held = PatchPoint {
            id: 5,
            place: [0.0; 3],
            mass: patch,
        };
        Spring::new(&hold, &[held], Mat3::diagonal([mass; 3]))
    }

    fn substep(n: u32, dt: f64, kick: f64) -> Substep {
        Substep {
            time: f64::from(n) * dt,
            dt,
            kick,
            frame_start: 0.0,
            frame_length: 10.0,
        }
    }

    #[test]
    fn two_halves_that_nothing_moves_between_are_a_whole() {
        let (spring, rest) = (on_one(50.0, 2.0), [0.0; 3]);
        let change = |dt, kick| {
            let kick = spring.kick(&substep(3, dt, kick));
            spring.change(&kick, rest, rest, rest)[0]
        };
        let (last, first) = (change(0.0, 5e-4), change(1e-3, 5e-4));
        assert!((last + first - change(1e-3, 1e-3)).abs() < 1e-12);
        assert!(last == first && last > 0.0);
    }

    #[test]
    fn a_mass_in_kicks_is_critically_damped() {
        // Velocities between positions: of second order in the kick.
        let error = |dt: f64| {
            let spring = on_one(2.0, 2.0);
            let (mut x, mut v, mut worst) = (0.0, 0.0, 0.0_f64);
            let count = (0.3 / dt).round() as u32;
            for n in 0..count {
                let length = if n == 0 { 0.5 * dt } else { dt };
                let kick = spring.kick(&substep(n, dt, length));
                v += spring.pull(&kick, 0, [x, 0.0, 0.0], [v, 0.0, 0.0])[0];
                x += dt * v;
                let wt = FREQUENCY * f64::from(n + 1) * dt;
                let exact = 1.0 - (1.0 + wt) * (-wt).exp();
                worst = worst.max((x - exact).abs());
            }
            worst
        };
        let (coarse, fine) = (error(2e-3), error(1e-3));
        assert!(coarse < 2e-3 && coarse > 3.5 * fine, "{coarse} {fine}");
    }

    #[test]
    fn a_light_patch_is_damped_however_long_the_kick() {
        for dt in [1e-4, 1e-3, 1e-2] {
            let spring = on_one(2.0, 2e-4);
            let (mut x, mut v) = (0.0, -3.0);
            for n in 0..(1.0 / dt) as u32 {
                let kick = spring.kick(&substep(n, dt, dt));
                v += spring.pull(&kick, 0, [x, 0.0, 0.0], [v, 0.0, 0.0])[0];
                x += dt * v;
                assert!((-0.1..1.0).contains(&x), "{dt}: {x}");
            }
            assert!((x - 1.0).abs() < 1e-4, "{dt}: {x}");
        }
    }

    #[test]
    fn work_is_the_kinetic_energy_of_what_nothing_else_moves() {
        let spring = on_one(2.0, 2.0);
        let (mut x, mut v) = (0.0, 0.5);
        for n in 0..37 {
            let kick = spring.kick(&substep(n, 1e-3, 1e-3));
            v += spring.pull(&kick, 0, [x, 0.0, 0.0], [v, 0.0, 0.0])[0];
            spring.settle(0, [v, 0.0, 0.0]);
            x += 1e-3 * v;
        }
        let given = spring.take();
        assert!((given.work - (v * v - 0.25)).abs() < 1e-12, "{given:?}");
        assert!((given.impulse[0] - 2.0 * (v - 0.5)).abs() < 1e-12);
        assert_eq!(spring.take(), Given::default());
    }

    #[test]
    fn a_point_far_out_is_lighter_across_than_along() {
        let inertia = Mat3::diagonal([0.4; 3]);
        let there = effective_mass(1.0, &inertia, [1.0, 0.0, 0.0]);
        // 1 / (1/m + r^2/I)
        let across = (1.0_f64 + 1.0 / 0.4).recip();
        let expected = [1.0, across, across];
        for a in 0..3 {
            assert!((there.0[a][a] - expected[a]).abs() < 1e-12, "{there:?}");
        }
    }
}
