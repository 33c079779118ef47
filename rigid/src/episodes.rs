//! Episodes: a pair of objects from first touch to parting, and the restitution that is asked of it.

use serde::{Deserialize, Serialize};

use crate::{
    ledger::Received,
    mat3::{dot, unit},
    motion::RigidMotion,
};

/// From here on numbers are those of colliders, before those of objects.
pub const COLLIDERS: u32 = 1 << 31;

/// A pair `a`, `b`, the lower number first, and what `b` received in a substep.
pub type PairExchange = ([u32; 2], Received);

/// Objects that meet, and colliders.
pub trait Movers {
    /// Rigid part of the motion of one, of a collider that at a place; none of what is held or is not there.
    fn motion(&self, number: u32, place: [f64; 3]) -> Option<RigidMotion>;

    /// Gives one of this motion an impulse at a place that moves it as a rigid body, and scales what it vibrates with by `keep`.
    /// Momentum and angular momentum change by what the impulse brings.
    fn push(
        &mut self,
        number: u32,
        motion: &RigidMotion,
        place: [f64; 3],
        impulse: [f64; 3],
        keep: f64,
    );
}

/// Substeps without an impulse after which a pair may count as parted: elastic bodies part and touch again a few
/// times while the last waves run through them.
const QUIET: u32 = 8;
/// Radii of the smaller body that the approach would cover in the time after which contact counts as lasting. Elastic
/// bodies part within some passages of sound, in which they approach by less than a radius.
const LASTING: f64 = 4.0;
/// Age, in ages at parting, up to which vibration that turns up may still raise the speed of parting.
const PATIENCE: f64 = 1.5;
/// Share of the vibration that restitution may use up.
const USABLE: f64 = 0.98;

/// What is asked of a pair.
#[derive(Clone, Copy, Debug)]
pub struct RequestedRestitution {
    /// Restitution; none: as it comes.
    pub restitution: Option<f64>,
    /// Whether both are solids, whose rigid motion may be corrected.
    pub solid: bool,
    /// Whether both are elastic: what is not rigid motion is vibration.
    pub elastic: bool,
}

/// A pair in contact, in units of mass and length of its [`Movers`], and s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Episode {
    fields: [u32; 2],
    /// Velocity of `a` relative to `b`, of the rigid parts, where they first touched.
    before: [f64; 3],
    /// Radius of the smaller one.
    radius: f64,
    /// Impulse that `b` received so far.
    impulse: [f64; 3],
    /// Part of it along normals.
    normal_impulse: [f64; 3],
    /// Where they last pressed, carried along.
    point: [f64; 3],
    /// What carries it.
    drift: [f64; 3],
    /// Since first touch.
    age: f64,
    /// Speed of parting before it was corrected, once they parted.
    natural: Option<f64>,
    /// Kinetic energy that corrections took.
    lost: f64,
    /// Age until when what is missing of the restitution may be raised.
    deadline: f64,
    /// Substeps since the last impulse, and how long they were.
    quiet: u32,
    since: f64,
    /// Whether it was reported as lasting.
    lasting: bool,
}

/// An episode that ended, or became lasting, in the same units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Closed {
    /// The objects.
    pub fields: [u32; 2],
    /// Impulse that the second received.
    pub impulse: [f64; 3],
    /// Speed of approach at first touch, of the rigid parts along the mean normal.
    pub before: f64,
    /// Speed of parting at the end; none when they stay together.
    pub after: Option<f64>,
    /// Speed of parting without control.
    pub natural: Option<f64>,
    /// What was asked.
    pub requested: Option<f64>,
    /// Kinetic energy that control took.
    pub lost: f64,
    /// Length.
    pub duration: f64,
    /// When.
    pub time: f64,
}

/// All pairs in contact, and those that parted since the last report.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Episodes {
    /// By fields.
    open: Vec<Episode>,
    /// In the order it happened.
    closed: Vec<Closed>,
}

impl Episodes {
    /// The objects of all pairs.
    pub fn fields(&self) -> impl Iterator<Item = u32> {
        let open = self.open.iter().flat_map(|episode| episode.fields);
        open.chain(self.closed.iter().flat_map(|closed| closed.fields))
    }

    /// Takes out the pairs of which one is among some.
    pub fn take_of(&mut self, among: impl Fn(u32) -> bool) -> Self {
        let has = |episode: &Episode| episode.fields.into_iter().any(&among);
        let (open, left) = self.open.drain(..).partition(has);
        self.open = left;
        let closed = vec![];
        Self { open, closed }
    }

    /// Puts others in, of other pairs.
    pub fn put_back(&mut self, others: Self) {
        self.open.extend(others.open);
        self.open.sort_by_key(|episode| episode.fields);
        self.closed.extend(others.closed);
    }

    /// Forgets pairs of which none is among some.
    pub fn retain(&mut self, among: impl Fn(u32) -> bool) {
        self.open.retain(|e| e.fields.into_iter().any(&among));
    }

    /// Pairs that have touched and not parted for good.
    pub fn pairs(&self) -> impl Iterator<Item = [u32; 2]> {
        self.open.iter().map(|episode| episode.fields)
    }

    /// Takes what is to be reported.
    pub fn take_closed(&mut self) -> Vec<Closed> {
        std::mem::take(&mut self.closed)
    }

    /// Numbers that tell one state from another.
    pub fn bits(&self) -> Vec<u64> {
        let episodes = self.open.iter().flat_map(|e| {
            let flags = u64::from(e.quiet) << 1 | u64::from(e.lasting);
            let fields = e.fields.map(u64::from);
            let vectors = [e.before, e.impulse, e.normal_impulse, e.point, e.drift];
            let numbers = vectors.into_iter().flatten().chain([
                e.age,
                e.radius,
                e.natural.unwrap_or(f64::NAN),
                e.lost,
                e.deadline,
                e.since,
            ]);
            let numbers = numbers.map(f64::to_bits);
            fields
                .into_iter()
                .chain([flags])
                .chain(numbers)
                .collect::<Vec<_>>()
        });
        episodes.collect()
    }

    /// Books the impulses of a substep of `dt` [s]. Movers are as they were before them, and their velocities relative to
    /// `frame_velocity`.
    pub fn take_in(
        &mut self,
        movers: &dyn Movers,
        exchanged: &[PairExchange],
        frame_velocity: [f64; 3],
        dt: f64,
    ) {
        for episode in &mut self.open {
            episode.age += dt;
            episode.since += dt;
            episode.quiet += 1;
            for a in 0..3 {
                episode.point[a] += dt * episode.drift[a];
            }
        }
        for (fields, exchange) in exchanged {
            let per_weight = |sum: [f64; 3]| sum.map(|s| s / exchange.weight);
            let point = per_weight(exchange.moment);
            let at = match self.open.binary_search_by_key(fields, |e| e.fields) {
                Ok(at) => at,
                Err(at) => {
                    let [Some(a), Some(b)] = fields.map(|field| movers.motion(field, point)) else {
                        continue;
                    };
                    let (v_a, v_b) = (a.at(point), b.at(point));
                    let begun = Episode {
                        fields: *fields,
                        before: std::array::from_fn(|i| v_a[i] - v_b[i]),
                        radius: a.radius.min(b.radius),
                        impulse: [0.0; 3],
                        normal_impulse: [0.0; 3],
                        point,
                        drift: frame_velocity,
                        age: dt,
                        natural: None,
                        lost: 0.0,
                        deadline: f64::INFINITY,
                        quiet: 0,
                        since: 0.0,
                        lasting: false,
                    };
                    self.open.insert(at, begun);
                    at
                }
            };
            let episode = &mut self.open[at];
            (episode.quiet, episode.since) = (0, 0.0);
            (episode.natural, episode.deadline) = (None, f64::INFINITY);
            episode.point = point;
            for i in 0..3 {
                episode.impulse[i] += exchange.impulse[i];
                episode.normal_impulse[i] += exchange.normal_impulse[i];
            }
        }
        for episode in self.open.iter_mut().filter(|e| e.quiet == 1) {
            let motions = episode.fields.map(|n| movers.motion(n, episode.point));
            if let [Some(a), Some(b)] = motions {
                let (v_a, v_b) = (a.at(episode.point), b.at(episode.point));
                episode.drift =
                    std::array::from_fn(|i| frame_velocity[i] + 0.5 * (v_a[i] + v_b[i]));
            }
        }
    }

    /// Whether a pair may be corrected after the substep at hand that asks for it.
    pub fn is_due(&self, asks: impl Fn([u32; 2]) -> bool) -> bool {
        let mut open = self.open.iter();
        open.any(|e| e.has_come_apart() && !e.lasting && asks(e.fields))
    }

    /// Ends the episodes of pairs that parted, with the restitution that is asked. `resting` is the speed below which
    /// no restitution is given; what is free falls by `gravity`. Adds what it gives to `exchanged`.
    pub fn part(
        &mut self,
        movers: &mut dyn Movers,
        wish: &dyn Fn([u32; 2]) -> RequestedRestitution,
        (resting, gravity): (f64, [f64; 3]),
        time: f64,
        exchanged: &mut Vec<PairExchange>,
    ) {
        let mut open = std::mem::take(&mut self.open);
        open.retain_mut(|episode| {
            let normal = unit(episode.normal_impulse);
            let before = dot(episode.before, normal);
            if !episode.lasting && episode.age * before.abs() > LASTING * episode.radius {
                episode.lasting = true;
                self.closed
                    .push(episode.close(before, wish(episode.fields).restitution, time));
            }
            if !episode.has_come_apart() {
                return true;
            }
            if episode.lasting {
                return false;
            }
            let wish = wish(episode.fields);
            let motions = episode.fields.map(|n| movers.motion(n, episode.point));
            let [Some(a), Some(b)] = motions else {
                self.closed
                    .push(episode.close(before, wish.restitution, time));
                return false;
            };
            let (x, n) = (episode.point, normal);
            let (v_a, v_b) = (a.at(x), b.at(x));
            let parting = -dot(std::array::from_fn(|i| v_a[i] - v_b[i]), n);
            if parting < 0.0 && episode.quiet < 4 * QUIET {
                // About to touch again.
                return true;
            }
            // What falls has lost speed since they touched last, by how far it has gone.
            let falls = |motion: &RigidMotion| f64::from(u8::from(motion.mass.is_finite()));
            let lost = episode.since * (falls(&a) - falls(&b)) * dot(gravity, n);
            let squares = lost * (2.0 * parting + lost);
            let natural = *episode.natural.get_or_insert(parting + lost);
            episode.deadline = episode.deadline.min(PATIENCE * episode.age);
            let mut after = parting + lost;
            let wanted = wish
                .restitution
                .filter(|_| wish.solid && parting > 0.0 && before > resting);
            let mut reached = true;
            if let Some(e) = wanted {
                let k = a.inverse_effective_mass(x, n) + b.inverse_effective_mass(x, n);
                let available = match wish.elastic {
                    true => a.vibration + b.vibration,
                    false => 0.0,
                };
                let wanted = ((e * before).powi(2) - squares).max(0.0).sqrt();
                let change = correction(wanted, parting, k, available);
                exchanged.push(episode.push(movers, [&a, &b], n, &change));
                let now = parting + k * change.impulse;
                after = (now * now + squares).max(0.0).sqrt();
                reached = !wish.elastic || after >= 0.999 * e * before;
            }
            if !reached && episode.age < episode.deadline {
                // Vibration that is strain now is motion soon.
                return true;
            }
            let mut closed = episode.close(before, wish.restitution, time);
            (closed.natural, closed.after) = (Some(natural), Some(after));
            self.closed.push(closed);
            false
        });
        self.open = open;
    }
}

impl Episode {
    /// Gives both what parts them as is asked, along a normal, and returns what it gave.
    fn push(
        &mut self,
        movers: &mut dyn Movers,
        motions: [&RigidMotion; 2],
        normal: [f64; 3],
        change: &Correction,
    ) -> PairExchange {
        let given = normal.map(|n| change.impulse * n);
        for ((motion, field), sign) in motions.into_iter().zip(self.fields).zip([-1.0, 1.0]) {
            let impulse = given.map(|j| sign * j);
            movers.push(field, motion, self.point, impulse, change.keep);
        }
        for i in 0..3 {
            self.impulse[i] += given[i];
        }
        self.lost += change.lost;
        let out = normal.map(|n| n * change.impulse.signum());
        let received = Received::at(self.point, out, change.impulse.abs(), given);
        (self.fields, received)
    }

    /// Whether they have touched for so long no more that they may have parted.
    fn has_come_apart(&self) -> bool {
        self.quiet > 0 && self.quiet.is_multiple_of(QUIET)
    }

    fn close(&self, before: f64, requested: Option<f64>, time: f64) -> Closed {
        Closed {
            fields: self.fields,
            impulse: self.impulse,
            before,
            after: None,
            natural: None,
            requested,
            lost: self.lost,
            duration: self.age,
            time,
        }
    }
}

/// What makes bodies part with another speed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Correction {
    /// Impulse along the normal that pushes them apart; negative: holds them back.
    impulse: f64,
    /// What is left of vibration velocities.
    keep: f64,
    /// Kinetic energy lost.
    lost: f64,
}

/// Impulse after which bodies with compliance `k` that part with speed `parting` part with speed `wanted`. Kinetic
/// energy of rigid motion changes by `J (parting + k J / 2)`; what it gains is taken from the `available` vibration,
/// as far as that goes.
fn correction(wanted: f64, parting: f64, k: f64, available: f64) -> Correction {
    let impulse = (wanted - parting) / k;
    if impulse <= 0.0 {
        return Correction {
            impulse,
            keep: 1.0,
            lost: -impulse * (parting + 0.5 * k * impulse),
        };
    }
    let most = ((parting * parting + 2.0 * k * USABLE * available).sqrt() - parting) / k;
    let impulse = impulse.min(most);
    let gained = impulse * (parting + 0.5 * k * impulse);
    Correction {
        impulse,
        keep: if gained > 0.0 {
            (1.0 - gained / available).max(0.0).sqrt()
        } else {
            1.0
        },
        lost: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn restitution_is_lowered_exactly_and_the_energy_is_booked() {
        // Two masses of 1: compliance 2, reduced mass 1/2.
        let change = correction(0.3, 0.8, 2.0, 0.0);
        assert!((0.8 + 2.0 * change.impulse - 0.3).abs() < 1e-15);
        assert!((change.lost - 0.25 * (0.64 - 0.09)).abs() < 1e-15);
        assert_eq!(change.keep, 1.0);
    }

    #[test]
    fn restitution_is_raised_as_far_as_vibration_goes() {
        let enough = correction(1.0, 0.8, 2.0, 1.0);
        assert!((0.8 + 2.0 * enough.impulse - 1.0).abs() < 1e-15);
        assert!((1.0 - enough.keep.powi(2) - 0.25 * (1.0 - 0.64)).abs() < 1e-15);
        let scarce = correction(1.0, 0.8, 2.0, 0.05);
        let after = 0.8 + 2.0 * scarce.impulse;
        assert!((0.25 * (after * after - 0.64) - 0.98 * 0.05).abs() < 1e-15);
        assert_eq!(correction(1.0, 0.8, 2.0, 0.0).impulse, 0.0);
    }
}
