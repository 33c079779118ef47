//! Forces that commands hold during a frame, shared over the particles they act on.

use crate::mat3::{Mat3, cross};

/// Smallest determinant of an inertia, over that of a ball with the same trace: below, particles lie on a line.
const THIN: f64 = 1e-9;

/// A force and a torque on an object during the frame at hand.
#[derive(Clone, Debug)]
pub struct CommandedForce {
    /// The object.
    pub object: usize,
    /// The force [N].
    pub force: [f64; 3],
    /// Number of its first particle.
    first: usize,
    /// Velocity change of each of its particles per second [units/s^2].
    rates: Vec<[f64; 3]>,
}

/// A particle that a force may act on.
#[derive(Clone, Copy, Debug)]
pub struct Loaded {
    /// Where it is [m].
    pub place: [f64; 3],
    /// Its mass [kg]; 0 where the force does not act.
    pub mass: f64,
}

/// Total mass [kg] and centre of mass [m].
fn centre(particles: &[Loaded]) -> (f64, [f64; 3]) {
    let mass: f64 = particles.iter().map(|p| p.mass).sum();
    let mut com = [0.0; 3];
    for p in particles {
        for a in 0..3 {
            com[a] += p.mass * p.place[a] / mass;
        }
    }
    (mass, com)
}

/// Angular acceleration by a torque [N m] about the centre of mass [rad/s^2]; none when the particles lie on a line.
pub fn angular_acceleration(particles: &[Loaded], torque: [f64; 3]) -> Option<[f64; 3]> {
    if torque == [0.0; 3] {
        return Some([0.0; 3]);
    }
    let (_, com) = centre(particles);
    let mut inertia = Mat3::diagonal([0.0; 3]);
    for p in particles {
        let r: [f64; 3] = std::array::from_fn(|a| p.place[a] - com[a]);
        let square: f64 = r.iter().map(|x| x * x).sum();
        for i in 0..3 {
            inertia.0[i][i] += p.mass * square;
            for j in 0..3 {
                inertia.0[i][j] -= p.mass * r[i] * r[j];
            }
        }
    }
    let det = inertia.det();
    let third = (0..3).map(|i| inertia.0[i][i]).sum::<f64>() / 3.0;
    let is_solid = det > THIN * third.powi(3);
    // Symmetric: the inverse is the matrix of cofactors over the determinant.
    is_solid.then(|| inertia.cofactor().mul_vec(torque).map(|x| x / det))
}

impl CommandedForce {
    /// A force [N] and a torque about the centre of mass [N m] on an object whose particles, from `first` on, are these; in
    /// units of `unit` metres. The force gives all of them the same acceleration. The torque gives them that of a rigid
    /// body about where they are now, and no momentum.
    pub fn new(
        object: usize,
        first: usize,
        particles: &[Loaded],
        force: [f64; 3],
        torque: [f64; 3],
        unit: f64,
    ) -> Option<Self> {
        let (mass, com) = centre(particles);
        let turning = angular_acceleration(particles, torque)?;
        let rates = particles.iter().map(|p| {
            if p.mass <= 0.0 {
                return [0.0; 3];
            }
            let turn = cross(turning, std::array::from_fn(|a| p.place[a] - com[a]));
            std::array::from_fn(|a| (force[a] / mass + turn[a]) / unit)
        });
        (mass > 0.0).then(|| Self {
            object,
            force,
            first,
            rates: rates.collect(),
        })
    }

    /// Whether it is on a particle's object.
    pub fn concerns(&self, id: u32) -> bool {
        self.rate(id).is_some()
    }

    /// Velocity change of a particle per second [units/s^2], where the force is on its object.
    pub fn rate(&self, id: u32) -> Option<[f64; 3]> {
        let number = (id as usize).checked_sub(self.first)?;
        self.rates.get(number).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners() -> Vec<Loaded> {
        let corner = |n: u32| Loaded {
            place: [0, 1, 2].map(|a| f64::from(n >> a & 1) + f64::from(a) * 0.1),
            mass: 2.0,
        };
        (0..8).map(corner).collect()
    }

    #[test]
    fn a_force_gives_momentum_and_a_torque_only_spin() {
        let particles = corners();
        let (force, torque) = ([3.0, -1.0, 2.0], [0.5, 0.25, -1.0]);
        let held = CommandedForce::new(0, 10, &particles, force, torque, 0.1).expect("solid");
        let (_, com) = centre(&particles);
        let (mut momentum, mut spin) = ([0.0; 3], [0.0; 3]);
        for (n, p) in particles.iter().enumerate() {
            let rate = held.rate(10 + n as u32).expect("its particle");
            let gained = rate.map(|v| 0.1 * v * p.mass);
            let r = std::array::from_fn(|a| p.place[a] - com[a]);
            let turn = cross(r, gained);
            for a in 0..3 {
                momentum[a] += gained[a];
                spin[a] += turn[a];
            }
        }
        for a in 0..3 {
            assert!((momentum[a] - force[a]).abs() < 1e-12, "{momentum:?}");
            assert!((spin[a] - torque[a]).abs() < 1e-12, "{spin:?}");
        }
        assert!(!held.concerns(9) && !held.concerns(18));
    }

    #[test]
    fn particles_on_a_line_cannot_be_turned() {
        let on_line = |n: u32| Loaded {
            place: [f64::from(n), 0.0, 0.0],
            mass: 1.0,
        };
        let line: Vec<Loaded> = (0..4).map(on_line).collect();
        assert_eq!(angular_acceleration(&line, [0.0, 0.0, 1.0]), None);
        let push = CommandedForce::new(0, 0, &line, [1.0; 3], [0.0; 3], 1.0);
        push.expect("a force needs no arm");
    }
}
