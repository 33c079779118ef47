//! What is prescribed for chosen particles: held, moved, pushed, let go one layer after the other.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{
    Substep,
    commanded::CommandedForce,
    springs::{Kick, Spring},
};
use crate::{
    expression::{Formulas, Snapshot, VectorField},
    mat3::{cross, dot},
    rotation::{from_rotation_vector, rotate},
    scene::{ImpulseAmount, Scene, TimeSpan},
};

/// Shortest duration of an impulse [s]: long against the round-off of times, short against any substep.
const SHORTEST: f64 = 1e-9;

/// A set of particles, one bit each; plain data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Members(Vec<u64>);

impl Members {
    /// Those with these ids.
    pub fn new(ids: &[u32]) -> Self {
        let mut members = Self::default();
        members.extend(ids);
        members
    }

    /// Adds particles.
    pub fn extend(&mut self, ids: &[u32]) {
        for &id in ids {
            let word = id as usize / 64;
            if word >= self.0.len() {
                self.0.resize(word + 1, 0);
            }
            self.0[word] |= 1 << (id % 64);
        }
    }

    /// Whether a particle is one of them.
    #[inline]
    pub fn contains(&self, id: u32) -> bool {
        self.0
            .get(id as usize / 64)
            .is_some_and(|bits| bits >> (id % 64) & 1 == 1)
    }

    /// The bits, 64 particles each.
    pub fn bits(&self) -> &[u64] {
        &self.0
    }
}

/// A rigid velocity field in the solver's units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    linear: [f64; 3],
    angular: [f64; 3],
    center: [f64; 3],
}

impl Field {
    const REST: Self = Self {
        linear: [0.0; 3],
        angular: [0.0; 3],
        center: [0.0; 3],
    };

    /// Velocity at a point.
    pub fn velocity(&self, x: [f64; 3]) -> [f64; 3] {
        let r = std::array::from_fn(|a| x[a] - self.center[a]);
        let turn = cross(self.angular, r);
        std::array::from_fn(|a| self.linear[a] + turn[a])
    }

    /// Where a point is after `dt` [s].
    pub fn moved(&self, x: [f64; 3], dt: f64) -> [f64; 3] {
        if self.angular == [0.0; 3] {
            return std::array::from_fn(|a| x[a] + dt * self.linear[a]);
        }
        let r = std::array::from_fn(|a| x[a] - self.center[a]);
        let turned = rotate(from_rotation_vector(self.angular.map(|w| dt * w)), r);
        std::array::from_fn(|a| self.center[a] + turned[a] + dt * self.linear[a])
    }

    /// Its gradient, row-major.
    pub fn gradient(&self) -> [f64; 9] {
        let [x, y, z] = self.angular;
        [0.0, -z, y, z, 0.0, -x, -y, x, 0.0]
    }
}

#[derive(Clone, Debug)]
struct Prescribed {
    members: Members,
    field: Field,
    span: TimeSpan,
}

#[derive(Clone, Debug)]
struct Release {
    members: Members,
    /// Particles, ascending, each with the number of its layer.
    layer: Vec<(u32, u32)>,
    layers: f64,
    span: TimeSpan,
}

#[derive(Clone, Debug)]
struct Impulse {
    members: Members,
    /// Velocity change per second while it lasts [units/s^2].
    rate: [f64; 3],
    /// Impulse per object [kg m/s], in SI units.
    per_object: Vec<(usize, [f64; 3])>,
    span: TimeSpan,
}

#[derive(Clone, Debug)]
struct Acceleration {
    /// Number of its first particle.
    first: usize,
    /// Its particles at rest [m].
    rest: Vec<[f64; 3]>,
    /// In SI units.
    field: VectorField,
    /// Metres per unit.
    unit: f64,
}

impl Acceleration {
    /// Which of its particles this is, if it is one of them.
    fn number(&self, id: u32) -> Option<usize> {
        let number = (id as usize).checked_sub(self.first)?;
        (number < self.rest.len()).then_some(number)
    }
}

/// What impulses and body forces give to particles in one substep.
#[derive(Clone, Debug, Default)]
pub struct Pushes<'a> {
    /// Velocity change of the members [units/s].
    impulses: Vec<(&'a Members, [f64; 3])>,
    forces: Vec<(&'a Acceleration, Force)>,
    commanded: &'a [CommandedForce],
    springs: Vec<(&'a Spring, Kick)>,
    /// How long forces act [s].
    kick: f64,
    /// Length of the substep [s].
    dt: f64,
}

/// A body force in one substep.
#[derive(Clone, Debug)]
enum Force {
    /// The same velocity change for all of its particles [units/s].
    Same([f64; 3]),
    /// An acceleration that depends on where a particle is at rest [m/s^2].
    ByPlace(Formulas),
}

impl Pushes<'_> {
    /// Velocity that a particle is given [units/s].
    pub fn on(&self, id: u32) -> [f64; 3] {
        let mut change = [0.0; 3];
        let mut add = |given: [f64; 3]| {
            for a in 0..3 {
                change[a] += given[a];
            }
        };
        for (members, given) in &self.impulses {
            if members.contains(id) {
                add(*given);
            }
        }
        for (of, force) in &self.forces {
            let Some(number) = of.number(id) else {
                continue;
            };
            match force {
                Force::Same(given) => add(*given),
                Force::ByPlace(formulas) => add(of.change(formulas.at(of.rest[number]), self.kick)),
            }
        }
        for rate in self.commanded.iter().filter_map(|held| held.rate(id)) {
            add(rate.map(|rate| self.dt * rate));
        }
        change
    }

    /// Velocity that springs give to a particle at `x` with the velocity `v`, in units of `unit` metres.
    pub fn pull(&self, id: u32, x: [f64; 3], v: [f64; 3], unit: f64) -> [f64; 3] {
        let mut change = [0.0; 3];
        for (spring, kick) in &self.springs {
            if let Some(member) = spring.number(id) {
                let [x, v] = [x, v].map(|u| u.map(|u| unit * u));
                let pulled = spring.pull(kick, member, x, v);
                for a in 0..3 {
                    change[a] += pulled[a] / unit;
                }
            }
        }
        change
    }

    /// Tells springs the velocity that a particle has after their kick, in units of `unit` metres.
    pub fn settle(&self, id: u32, v: [f64; 3], unit: f64) {
        for (spring, _) in &self.springs {
            if let Some(member) = spring.number(id) {
                spring.settle(member, v.map(|v| unit * v));
            }
        }
    }
}

impl Acceleration {
    /// Velocity change [units/s] by an acceleration [m/s^2] that acts for `kick` [s].
    fn change(&self, acceleration: [f64; 3], kick: f64) -> [f64; 3] {
        acceleration.map(|x| kick * x / self.unit)
    }
}

/// Everything prescribed for particles of a scene.
#[derive(Clone, Debug, Default)]
pub struct Rules {
    prescribed: Vec<Prescribed>,
    releases: Vec<Release>,
    impulses: Vec<Impulse>,
    accelerations: Vec<Acceleration>,
    /// Forces of the frame at hand. Each is given in every substep for all of its length: all of it is.
    pub commanded: Vec<CommandedForce>,
    /// Springs of the frame at hand.
    pub springs: Arc<Vec<Spring>>,
}

/// What commands hold at present, per object; plain data, part of the world's state.
pub type Pins = Vec<Option<Members>>;

/// How long a span and a substep overlap [s].
fn overlap(span: &TimeSpan, start: f64, end: f64) -> f64 {
    (end.min(span.end) - start.max(span.start)).max(0.0)
}

impl Rules {
    /// The rules of a scene in units of `unit` metres.
    pub fn new(scene: &Scene, unit: f64) -> Self {
        let conditions = &scene.conditions;
        let scaled = |v: [f64; 3]| v.map(|x| x / unit);
        let prescribed = conditions.prescribed.iter().map(|rule| Prescribed {
            members: Members::new(&rule.selection.particles(scene)),
            field: Field {
                linear: scaled(rule.linear),
                angular: rule.angular,
                center: scaled(rule.center),
            },
            span: rule.span,
        });
        let releases = conditions.releases.iter().map(|rule| {
            let depth = |id: u32| {
                let along = dot(scene.particles.position[id as usize], rule.axis);
                (along - rule.start_position) / (rule.end_position - rule.start_position)
            };
            let layers = f64::from(rule.layers);
            let mut held = rule.selection.particles(scene);
            held.retain(|&id| depth(id) >= 0.0);
            let layer = |&id: &u32| (id, (depth(id) * layers).min(layers - 1.0) as u32);
            Release {
                members: Members::new(&held),
                layer: held.iter().map(layer).collect(),
                layers,
                span: rule.span,
            }
        });
        let impulses = conditions.impulses.iter().map(|rule| {
            let ids = rule.selection.particles(scene);
            let mut masses: Vec<(usize, f64)> = Vec::new();
            for (object, o) in scene.objects.iter().enumerate() {
                let first = ids.partition_point(|&id| (id as usize) < o.particles.start);
                let end = ids.partition_point(|&id| (id as usize) < o.particles.end);
                let mass = ids[first..end]
                    .iter()
                    .map(|&id| scene.particles.volume[id as usize] * o.density_of(id as usize));
                masses.push((object, mass.sum()));
            }
            let total: f64 = masses.iter().map(|m| m.1).sum();
            let impulse = match rule.amount {
                ImpulseAmount::Total(impulse) => impulse,
                ImpulseAmount::PerParticle(each) => each.map(|x| x * ids.len() as f64),
            };
            let change = impulse.map(|x| if total > 0.0 { x / total } else { 0.0 });
            let duration = rule.duration.max(SHORTEST);
            Impulse {
                members: Members::new(&ids),
                rate: change.map(|v| v / unit / duration),
                per_object: masses
                    .iter()
                    .map(|(object, mass)| (*object, change.map(|v| mass * v)))
                    .collect(),
                span: TimeSpan {
                    start: rule.start,
                    end: rule.start + duration,
                },
            }
        });
        let accelerations = scene.objects.iter().filter_map(|object| {
            Some(Acceleration {
                first: object.particles.start,
                rest: scene.particles.position[object.particles.clone()].to_vec(),
                field: object.body_force.clone()?,
                unit,
            })
        });
        Self {
            accelerations: accelerations.collect(),
            prescribed: prescribed.collect(),
            releases: releases.collect(),
            impulses: impulses.collect(),
            commanded: vec![],
            springs: Arc::default(),
        }
    }

    /// Whether any rule, ever, concerns a particle.
    pub fn concern(&self, pins: &Pins, id: u32) -> bool {
        self.prescribed.iter().any(|r| r.members.contains(id))
            || self.releases.iter().any(|r| r.members.contains(id))
            || self.impulses.iter().any(|r| r.members.contains(id))
            || self.accelerations.iter().any(|a| a.number(id).is_some())
            || self.commanded.iter().any(|held| held.concerns(id))
            || pins.iter().flatten().any(|p| p.contains(id))
    }

    /// Whether any rule of the scene concerns a particle after `time` [s].
    pub fn concern_after(&self, time: f64, id: u32) -> bool {
        let later = |span: &TimeSpan, members: &Members| span.end > time && members.contains(id);
        self.prescribed.iter().any(|r| later(&r.span, &r.members))
            || self.releases.iter().any(|r| later(&r.span, &r.members))
            || self.impulses.iter().any(|r| later(&r.span, &r.members))
            || self.accelerations.iter().any(|a| a.number(id).is_some())
            || self.commanded.iter().any(|held| held.concerns(id))
    }

    /// Whether there is no rule at all.
    pub fn are_empty(&self, pins: &Pins) -> bool {
        self.prescribed.is_empty()
            && self.releases.is_empty()
            && self.impulses.is_empty()
            && self.accelerations.is_empty()
            && self.commanded.is_empty()
            && pins.iter().all(Option::is_none)
    }

    /// Velocity field that a particle follows in a substep, if one is prescribed.
    pub fn field(&self, pins: &Pins, substep: &Substep, id: u32) -> Option<Field> {
        if pins.iter().flatten().any(|pin| pin.contains(id)) {
            return Some(Field::REST);
        }
        if self.releases.iter().any(|r| r.holds(substep, id)) {
            return Some(Field::REST);
        }
        let mut last = self.prescribed.iter().rev();
        let found = last.find(|rule| substep.is_in(&rule.span) && rule.members.contains(id));
        found.map(|rule| rule.field)
    }

    /// Whether a velocity may be prescribed in a substep.
    pub fn hold_in(&self, pins: &Pins, substep: &Substep) -> bool {
        pins.iter().any(Option::is_some)
            || self.releases.iter().any(|r| substep.is_in(&r.span))
            || self.prescribed.iter().any(|r| substep.is_in(&r.span))
    }

    /// What impulses and body forces add to velocities in a substep: a force acts as long as forces do, an impulse is given
    /// in the substeps in which it lasts, so that all of it is. Formulas are worked out here as far as they do not
    /// depend on the particle.
    pub fn pushes(&self, substep: &Substep) -> Pushes<'_> {
        self.pushes_at(substep, substep.time)
    }

    /// The same, with body forces as they are at a moment [s].
    pub fn pushes_at(&self, substep: &Substep, moment: f64) -> Pushes<'_> {
        let impulses = self.impulses.iter().filter_map(|impulse| {
            let lasts = overlap(&impulse.span, substep.time, substep.time + substep.dt);
            (lasts > 0.0).then(|| (&impulse.members, impulse.rate.map(|rate| lasts * rate)))
        });
        let forces = self.accelerations.iter().map(|of| {
            let force = match of.field.at_time(moment) {
                Snapshot::Uniform(acceleration) => {
                    Force::Same(of.change(acceleration, substep.kick))
                }
                Snapshot::Varying(formulas) => Force::ByPlace(formulas),
            };
            (of, force)
        });
        Pushes {
            impulses: impulses.collect(),
            forces: forces.collect(),
            commanded: &self.commanded,
            springs: (self.springs.iter())
                .map(|spring| (spring, spring.kick(substep)))
                .collect(),
            kick: substep.kick,
            dt: substep.dt,
        }
    }

    /// Whether an impulse or a body force acts in a substep.
    pub fn push_in(&self, substep: &Substep) -> bool {
        let acts = |i: &Impulse| overlap(&i.span, substep.time, substep.time + substep.dt) > 0.0;
        let forces = !self.accelerations.is_empty() || !self.commanded.is_empty();
        forces || !self.springs.is_empty() || self.impulses.iter().any(acts)
    }

    /// Moments within a span at which something begins or ends to be prescribed, or pushed [s].
    pub fn changes(&self, start: f64, end: f64) -> Vec<f64> {
        let ends = |span: &TimeSpan| [span.start, span.end];
        let prescribed = self.prescribed.iter().flat_map(|rule| ends(&rule.span));
        let impulses = self.impulses.iter().flat_map(|rule| ends(&rule.span));
        let releases = self.releases.iter().flat_map(|rule| {
            let layer = (rule.span.end - rule.span.start) / rule.layers;
            let layers = (0..=rule.layers as u32).map(move |n| f64::from(n) * layer);
            layers.map(|passed| rule.span.start + passed)
        });
        let all = prescribed.chain(impulses).chain(releases);
        all.filter(|time| start < *time && *time < end).collect()
    }

    /// Whether what is prescribed, or pushes, may vary between such moments.
    pub fn vary(&self) -> bool {
        let turns = |rule: &Prescribed| rule.field.angular != [0.0; 3];
        self.prescribed.iter().any(turns) || !self.accelerations.is_empty()
    }

    /// Momentum that impulses and commanded forces give to every object from `start` to `end` [kg m/s].
    pub fn given(&self, start: f64, end: f64) -> Vec<(usize, [f64; 3])> {
        let given = self.impulses.iter().flat_map(|impulse| {
            let part = overlap(&impulse.span, start, end) / (impulse.span.end - impulse.span.start);
            let objects = impulse.per_object.iter();
            objects.map(move |(object, j)| (*object, j.map(|x| part * x)))
        });
        let commanded = self.commanded.iter();
        let commanded = commanded.map(|held| (held.object, held.force.map(|f| (end - start) * f)));
        let all = given.chain(commanded);
        all.filter(|(_, j)| *j != [0.0; 3]).collect()
    }

    /// Largest speed that each prescribed motion may give during a frame of `length` [s] to particles that are at
    /// `positions` now [units/s].
    pub fn speeds(&self, positions: &[[f64; 3]], length: f64) -> Vec<f64> {
        let speed = |rule: &Prescribed| {
            let Field {
                linear,
                angular,
                center,
            } = rule.field;
            let (linear, angular) = (dot(linear, linear).sqrt(), dot(angular, angular).sqrt());
            if angular == 0.0 {
                return linear;
            }
            let members = positions.iter().enumerate();
            let distances = members
                .filter(|(id, _)| rule.members.contains(*id as u32))
                .map(|(_, x)| {
                    let r: [f64; 3] = std::array::from_fn(|a| x[a] - center[a]);
                    dot(r, r)
                });
            let reach = distances.fold(0.0, f64::max).sqrt();
            linear + angular * (reach + linear * length)
        };
        self.prescribed.iter().map(speed).collect()
    }

    /// Largest of `speeds` that acts in a substep.
    pub fn speed(&self, speeds: &[f64], substep: &Substep) -> f64 {
        let rules = self.prescribed.iter().zip(speeds);
        let active = rules.filter(|(rule, _)| substep.is_in(&rule.span));
        active.map(|(_, speed)| *speed).fold(0.0, f64::max)
    }
}

impl Release {
    fn holds(&self, substep: &Substep, id: u32) -> bool {
        if !substep.is_in(&self.span) || !self.members.contains(id) {
            return false;
        }
        let Ok(at) = self.layer.binary_search_by_key(&id, |(id, _)| *id) else {
            return false;
        };
        let layer = f64::from(self.layer[at].1);
        let length = self.span.end - self.span.start;
        let until = self.span.start + (layer + 1.0) / self.layers * length;
        substep.time + 0.5 * substep.dt < until
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::{
        expression::Expression,
        materials::Law,
        scene::{Conditions, RegionImpulse, Selection, SequentialRelease},
        test_scenes::{add_box, elastic, empty},
    };

    fn substep(time: f64, dt: f64) -> Substep {
        Substep {
            time,
            dt,
            kick: dt,
            frame_start: 0.0,
            frame_length: 1.0,
        }
    }

    #[test]
    fn layers_are_let_go_from_the_start_to_the_end() {
        let mut scene = empty(0.1);
        let jelly = elastic(Law::FixedCorotated, 1e5, 0.3);
        add_box(&mut scene, jelly, [0.0; 3], 0.1, [1, 1, 8]);
        scene.conditions = Conditions {
            releases: vec![SequentialRelease {
                selection: Selection::default(),
                axis: [0.0, 0.0, 1.0],
                start_position: 0.8,
                end_position: 0.0,
                layers: 4,
                span: TimeSpan {
                    start: 1.0,
                    end: 3.0,
                },
            }],
            ..Default::default()
        };
        let rules = Rules::new(&scene, scene.dx);
        let held = |t: f64| -> Vec<u32> {
            let now = substep(t, 1e-3);
            (0..8)
                .filter(|&id| rules.field(&vec![], &now, id).is_some())
                .collect()
        };
        assert!(held(0.9).is_empty());
        assert_eq!(held(1.1), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(held(1.6), [0, 1, 2, 3, 4, 5]);
        assert_eq!(held(2.6), [0, 1]);
        assert!(held(3.1).is_empty());
    }

    #[test]
    fn an_impulse_is_given_whole_however_time_is_cut() {
        let mut scene = empty(0.1);
        let jelly = elastic(Law::FixedCorotated, 1e5, 0.3);
        add_box(&mut scene, jelly, [0.0; 3], 0.1, [2, 2, 2]);
        for duration in [0.0, 0.13] {
            scene.conditions.impulses = vec![RegionImpulse {
                selection: Selection::default(),
                amount: ImpulseAmount::Total([4.0, 0.0, 0.0]),
                start: 0.3,
                duration,
            }];
            let rules = Rules::new(&scene, scene.dx);
            // 8 kg in cells of 0.1 m: 0.5 m/s are 5 cells/s.
            for dt in [0.1, 0.017, 0.3] {
                let (mut t, mut v) = (0.0, 0.0);
                while t < 1.0 {
                    v += rules.pushes(&substep(t, dt)).on(3)[0];
                    t += dt;
                }
                assert!((v - 5.0).abs() < 1e-5, "{v} with substeps of {dt} s");
            }
            let given = rules.given(0.0, 1.0);
            assert!((given[0].1[0] - 4.0).abs() < 1e-9, "{given:?}");
        }
    }

    #[test]
    fn a_force_that_is_the_same_everywhere_is_worked_out_once() {
        let mut scene = empty(0.1);
        let jelly = elastic(Law::FixedCorotated, 1e5, 0.3);
        add_box(&mut scene, jelly, [0.0; 3], 0.1, [2, 2, 2]);
        for (text, once) in [("2*t + pi", true), ("2*t + pi + 0*X", false)] {
            let parts = [text, "-1", "0"].map(|text| Expression::parse(text).expect(text));
            scene.objects[0].body_force = Some(VectorField::new(parts));
            let rules = Rules::new(&scene, scene.dx);
            let now = substep(0.7, 1e-3);
            let pushes = rules.pushes(&now);
            assert_eq!(matches!(pushes.forces[0].1, Force::Same(_)), once, "{text}");
            // In cells of 0.1 m, and only for the particles of the object.
            assert_eq!(pushes.on(3), [1e-3 * (1.4 + PI) / 0.1, -1e-3 / 0.1, 0.0]);
            assert_eq!(pushes.on(8), [0.0; 3]);
        }
    }
}
