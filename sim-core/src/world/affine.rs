//! Affine objects: matter that stretches and shears as one while nothing is near, without grid and transfers.
//!
//! Before it touches anything its matter comes back, and it is affine again once it has been free for a while. What it is in
//! the frame to come is worked out before the frame begins: then it is known where it will reach, and a flight in which it
//! would turn inside out is not begun.

use serde::{Deserialize, Serialize};

use super::{
    Frame, World,
    bodies::{Loose, Member, turned},
    stand_in::STEADY,
};
use crate::{
    bodies::affine::{Affine, Bulk, Loosened, Lump},
    mat3::{Mat3, dot, length},
    materials::{Coefficients, polar},
    moments::quaternion,
    particles::Block,
    report::ObjectState,
    scene::{CoherentMode, Fidelity, Part},
};

/// An object as one affine body.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct AffineObject {
    pub motion: Affine,
    /// Its particles, places and deformations as they were when it became affine, in axes of the world.
    pub members: Vec<Member>,
    /// Elastic energy that its matter had then beyond that of the mean deformation [J]: it stays as long as it is affine.
    pub stored: f64,
}

impl AffineObject {
    /// Whether it has particles, in places, and is somewhere.
    pub fn is_sound(&self) -> bool {
        let Affine {
            com,
            velocity,
            map,
            rate,
        } = &self.motion;
        let finite = |x: &[f64; 3]| x.iter().all(|x| x.is_finite());
        let vectors = map.iter().chain(rate).chain([com, velocity]);
        !self.members.is_empty()
            && vectors.into_iter().all(finite)
            && self.members.iter().all(|member| finite(&member.place))
            && self.motion.map().det() > 0.0
            && self.stored.is_finite()
    }
}

/// A row-major matrix in double precision.
fn matrix(m: &[f32; 9]) -> Mat3<f64> {
    Mat3(std::array::from_fn(|i| {
        std::array::from_fn(|j| f64::from(m[3 * i + j]))
    }))
}

/// Adds `s m`.
fn add(sum: &mut Mat3<f64>, s: f64, m: &Mat3<f64>) {
    *sum = sum.blend(1.0, m, s);
}

/// Adds `s a b^T`.
fn add_outer(sum: &mut Mat3<f64>, s: f64, a: [f64; 3], b: [f64; 3]) {
    for i in 0..3 {
        for j in 0..3 {
            sum.0[i][j] += s * a[i] * b[j];
        }
    }
}

impl World {
    /// Lets matter of affine objects come back where something is near, or where they could not be followed, and makes those
    /// affine that have been free for long enough.
    pub(super) fn settle_affine(&mut self, frame: &mut Frame) {
        frame.fidelity_loss += std::mem::take(&mut self.workspace.lost);
        let count = self.scene.objects.len();
        self.workspace.flown = vec![None; count];
        for object in 0..count {
            let asked = self.scene.objects[object].fidelity == Fidelity::Affine
                && self.scene.contact.method.tells_apart();
            if self.state.affine[object].is_none() {
                if !asked || self.meets_something(object, frame) {
                    if asked {
                        self.state.standing[object].steady = 0.0;
                    }
                    continue;
                }
                let steady = self.state.standing[object].steady;
                self.state.standing[object].steady = steady + frame.length;
                if steady >= STEADY && self.may_be_affine(object, frame) {
                    self.form_affine(object, frame);
                }
            } else if !asked || !self.flies(object, frame) {
                self.bring_back(object);
                frame.fidelity_loss += std::mem::take(&mut self.workspace.lost);
            }
        }
    }

    /// Whether an object may be affine now.
    fn may_be_affine(&self, object: usize, frame: &Frame) -> bool {
        let parts = self.parts.iter().zip(&self.state.materials);
        let mut mine = parts.filter(|(part, _)| part.object == object);
        let pulled_rigid = self.scene.objects[object]
            .coherence
            .is_some_and(|coherence| coherence.mode == CoherentMode::Rigid);
        if pulled_rigid
            || !mine.all(|(_, material)| material.law.keeps_elastic())
            || self.is_ruled(object)
        {
            return false;
        }
        // However it turns: where that ball meets something, its matter would be needed again at once.
        let com = self.report.objects[object].com;
        let particles = self.scene.objects[object].particles.clone();
        let radius = particles
            .filter(|&p| self.published.volume[p] > 0.0)
            .map(|p| {
                let x = self.published.position[p];
                length(std::array::from_fn(|a| f64::from(x[a]) - com[a]))
            })
            .fold(0.0, f64::max);
        !self.reaches(object, com, [radius; 3], frame)
    }

    /// Whether an object in a box about a point [m] meets something, or the end of the domain.
    fn reaches(&self, object: usize, about: [f64; 3], half: [f64; 3], frame: &Frame) -> bool {
        let domain = &self.scene.domain;
        let inside = (0..3)
            .all(|a| about[a] - half[a] >= domain.min[a] && about[a] + half[a] <= domain.max[a]);
        !inside || self.is_met(object, &self.blocks_within(object, about, half), frame)
    }

    /// Whether an affine object can be followed through a frame and meets nothing; notes where it will be.
    fn flies(&mut self, object: usize, frame: &mut Frame) -> bool {
        let (Some(affine), Some(bulk)) = (&self.state.affine[object], &self.bulks[object]) else {
            return false;
        };
        let damping = self.scene.conditions.damping;
        let flight = bulk.flight(&affine.motion, self.state.gravity, damping, frame.length);
        let Some(flight) = flight else {
            frame.take_back();
            return false;
        };
        let (from, to) = (affine.motion.com, flight.end.com);
        let about = std::array::from_fn(|a| 0.5 * (from[a] + to[a]));
        let half = std::array::from_fn(|a| flight.half[a] + 0.5 * (to[a] - from[a]).abs());
        let flies = !self.reaches(object, about, half, frame);
        if flies {
            self.workspace.flown[object] = Some(flight.end);
        }
        flies
    }

    /// Makes an object affine, if it can be followed through the coming frame: momentum and angular momentum are those of its
    /// matter, and the kinetic energy of all of its motion that is not of this kind is lost.
    fn form_affine(&mut self, object: usize, frame: &mut Frame) {
        let d_p = 0.25 * self.scene.dx * self.scene.dx;
        let lag = self.state.lags[object];
        let which: Vec<bool> = self.parts.iter().map(|p| p.object == object).collect();
        let loose = self.take_away(object, &which);
        let Some(first) = loose.first() else {
            return;
        };
        let about = first.x;
        let (mut mass, mut com, mut velocity) = (0.0, [0.0; 3], [0.0; 3]);
        for p in &loose {
            let m = self.grain(object, p.id, p.x).mass;
            mass += m;
            for a in 0..3 {
                com[a] += m * (p.x[a] - about[a]);
                velocity[a] += m * p.v[a];
            }
        }
        let (com, velocity) = (com.map(|x| x / mass), velocity.map(|v| v / mass));
        let com: [f64; 3] = std::array::from_fn(|a| about[a] + com[a]);
        let mut moments = Mat3::diagonal([0.0; 3]);
        let mut members = Vec::with_capacity(loose.len());
        for p in &loose {
            let m = self.grain(object, p.id, p.x).mass;
            let place = std::array::from_fn(|a| p.x[a] - com[a]);
            let v = std::array::from_fn(|a| p.v[a] - velocity[a]);
            add_outer(&mut moments, m, v, place);
            add(&mut moments, m * d_p, &gradient_of(p));
            members.push(Member {
                id: p.id,
                place,
                visible: p.visible,
                elastic: p.elastic,
                memory: p.memory,
            });
        }
        let mut affine = AffineObject {
            motion: Affine {
                com,
                velocity,
                map: Mat3::identity().0,
                rate: [[0.0; 3]; 3],
            },
            members,
            stored: 0.0,
        };
        let Some(bulk) = self.bulk_of(object, &affine) else {
            self.put_back(object, &loose);
            return;
        };
        let rate = bulk.rate_of(&moments);
        let mut lost = 0.0;
        for p in &loose {
            let m = self.grain(object, p.id, p.x).mass;
            let orbit = rate.mul_vec(std::array::from_fn(|a| p.x[a] - com[a]));
            let v = std::array::from_fn(|a| p.v[a] - velocity[a] - orbit[a]);
            let c = gradient_of(p).sub(&rate);
            lost += 0.5 * m * (dot(v, v) + d_p * c.norm_squared());
        }
        let still = Mat3::identity();
        affine.stored = self.elastic_energy_of(object, &loose) - bulk.elastic_energy(&still);
        // Velocities of matter are behind by what forces have yet to add.
        let pull = bulk.pull(&still).filter(|_| lag > 0.0);
        affine.motion.rate = pull.map_or(rate, |pull| rate.blend(1.0, &pull, lag)).0;
        self.state.affine[object] = Some(affine);
        self.bulks[object] = Some(bulk);
        if self.flies(object, frame) {
            frame.fidelity_loss += lost;
        } else {
            (self.state.affine[object], self.bulks[object]) = (None, None);
            self.put_back(object, &loose);
            self.state.standing[object].steady = 0.0;
        }
    }

    /// What never changes of an affine object, from its members alone: the same whenever it is made.
    pub(super) fn bulk_of(&self, object: usize, affine: &AffineObject) -> Option<Bulk> {
        let d_p = 0.25 * self.scene.dx * self.scene.dx;
        let (mut mass, mut reach) = (0.0, 0.0_f64);
        let (mut spread, mut visible) = (Mat3::diagonal([0.0; 3]), Mat3::diagonal([0.0; 3]));
        let mut lumps = Vec::new();
        let parts = self.parts.iter().zip(&self.state.materials);
        for (part, material) in parts.filter(|(part, _)| part.object == object) {
            let (mut volume, mut turned) = (0.0, Mat3::diagonal([0.0; 3]));
            let mut stretch = Mat3::diagonal([0.0; 3]);
            for member in affine.members.iter().filter(|m| is_of(part, m.id)) {
                let grain = self.grain(object, member.id, member.place);
                let f = matrix(&member.elastic);
                mass += grain.mass;
                volume += grain.volume;
                reach = reach.max(length(member.place));
                add_outer(&mut spread, grain.mass, member.place, member.place);
                add(&mut visible, grain.mass, &matrix(&member.visible));
                add(&mut turned, grain.volume, &f);
                let own = polar::rotation(&f).transpose().mul(&f);
                add(&mut stretch, grain.volume, &own);
            }
            if volume > 0.0 {
                // Stretches are averaged apart: where matter is bent, the mean of its rotations would pass for compression.
                let elastic = polar::rotation(&turned).mul(&stretch);
                lumps.push(Lump {
                    volume,
                    material: material.clone(),
                    elastic: elastic.blend(1.0 / volume, &elastic, 0.0),
                });
            }
        }
        let visible = visible.blend(1.0 / mass, &visible, 0.0);
        Bulk::new(mass, spread, mass * d_p, reach, visible, lumps)
    }

    /// Elastic energy of particles of an object [J].
    fn elastic_energy_of(&self, object: usize, loose: &[Loose]) -> f64 {
        let mut energy = 0.0;
        let parts = self.parts.iter().zip(&self.state.materials);
        for (part, material) in parts.filter(|(part, _)| part.object == object) {
            let k = Coefficients::new(material);
            for p in loose.iter().filter(|p| is_of(part, p.id)) {
                let volume = self.scene.particles.volume[p.id as usize];
                let (f, memory) = (matrix(&p.elastic), f64::from(p.memory));
                energy += volume * material.law.energy_density(&f, memory, &k);
            }
        }
        energy
    }

    /// Gives an affine object its matter back; notes what energy that takes.
    pub(super) fn loosen_affine(&mut self, object: usize) {
        let (Some(affine), Some(bulk)) =
            (self.state.affine[object].take(), self.bulks[object].take())
        else {
            return;
        };
        let Affine { com, velocity, .. } = affine.motion;
        let map = affine.motion.map();
        let mut loose: Vec<Loose> = affine
            .members
            .iter()
            .map(|member| {
                let arm = map.mul_vec(member.place);
                Loose {
                    id: member.id,
                    x: std::array::from_fn(|a| com[a] + arm[a]),
                    v: arm,
                    c: [0.0; 9],
                    visible: turned(&map, &member.visible),
                    elastic: turned(&map, &member.elastic),
                    memory: member.memory,
                }
            })
            .collect();
        let stored = bulk.elastic_energy(&map) + affine.stored;
        let gain = self.elastic_energy_of(object, &loose) - stored;
        let Loosened { gradient, lost } =
            bulk.loosened(&affine.motion, gain, self.state.lags[object]);
        for p in &mut loose {
            let orbit = gradient.mul_vec(p.v);
            p.v = std::array::from_fn(|a| velocity[a] + orbit[a]);
            p.c = std::array::from_fn(|n| gradient.0[n / 3][n % 3]);
        }
        self.workspace.lost += lost;
        self.put_back(object, &loose);
    }

    /// Moves affine objects to where the frame takes them.
    pub(super) fn move_affine(&mut self) {
        let flown = self.workspace.flown.iter_mut().map(Option::take);
        for (affine, flown) in self.state.affine.iter_mut().zip(flown) {
            if let (Some(affine), Some(flown)) = (affine, flown) {
                affine.motion = flown;
            }
        }
    }

    /// Whether there is any affine object.
    pub(super) fn has_affine(&self) -> bool {
        self.state.affine.iter().any(Option::is_some)
    }

    /// The blocks of cells that an affine object may reach into, sorted.
    pub(super) fn blocks_of_affine(&self, object: usize) -> Option<Vec<Block>> {
        let motion = &self.state.affine[object].as_ref()?.motion;
        let half = self.bulks[object].as_ref()?.half(&motion.map());
        Some(self.blocks_within(object, motion.com, half))
    }

    /// Mass of an affine object [kg]; 0 of others.
    pub(super) fn mass_of_affine(&self, object: usize) -> f64 {
        self.bulks[object].as_ref().map_or(0.0, |bulk| bulk.mass)
    }

    /// Writes the particles of all affine objects.
    pub(super) fn publish_affine(&mut self) {
        for affine in self.state.affine.iter().flatten() {
            self.published.update_affine(affine, self.scene.dx);
        }
    }

    /// Moments of an affine object.
    pub(super) fn affine_state(&self, object: usize) -> Option<ObjectState> {
        let AffineObject { motion, stored, .. } = self.state.affine[object].as_ref()?;
        let bulk = self.bulks[object].as_ref()?;
        let map = motion.map();
        let s = bulk.spread_at(&map).0;
        let spread = s[0][0] + s[1][1] + s[2][2];
        let inertia = [
            spread - s[0][0],
            -s[0][1],
            -s[0][2],
            spread - s[1][1],
            -s[1][2],
            spread - s[2][2],
        ];
        let angular_momentum = bulk.angular_momentum(motion);
        Some(ObjectState {
            mass: bulk.mass,
            com: motion.com,
            linear_velocity: motion.velocity,
            angular_momentum,
            angular_velocity: bulk.spin(&map, angular_momentum),
            inertia,
            rotation: quaternion(&polar::rotation(&map.mul(&bulk.visible))),
            radius: (5.0 / 3.0 * spread / bulk.mass).max(0.0).sqrt(),
            kinetic_energy: bulk.kinetic_energy(motion),
            elastic_energy: bulk.elastic_energy(&map) + stored,
            ..ObjectState::default()
        })
    }
}

/// Velocity gradient of a particle.
fn gradient_of(p: &Loose) -> Mat3<f64> {
    Mat3(std::array::from_fn(|i| {
        std::array::from_fn(|j| p.c[3 * i + j])
    }))
}

/// Whether a particle is of a part.
fn is_of(part: &Part, id: u32) -> bool {
    part.particles.contains(&(id as usize))
}
