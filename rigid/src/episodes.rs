//! Episodes: a pair of objects from first touch until it parts, and how fast it met and parted.

use serde::{Deserialize, Serialize};

use crate::{
    ledger::Received,
    mat3::{dot, unit},
    motion::RigidMotion,
};

/// A pair `a`, `b`, the lower number first, and what `b` received in a substep.
pub type PairExchange = ([u32; 2], Received);

/// Substeps without an impulse after which a pair counts as parted: elastic bodies part and touch again a few times
/// while the last waves run through them.
const QUIET: u32 = 8;
/// The same of a pair that still closes when it has touched last, and so is about to touch again.
const QUIET_CLOSING: u32 = 4 * QUIET;
/// Radii of the smaller body that the pair would close by in the time after which contact counts as lasting. Elastic
/// bodies part within some passages of sound, in which they close by less than a radius.
const LASTING: f64 = 4.0;

/// A pair in contact, in the units of mass and length of its impulses, and s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Episode {
    fields: [u32; 2],
    /// Velocity of `a` relative to `b`, of the rigid parts, where they first touched.
    closing: [f64; 3],
    /// The same where they pressed last, after that; none before they came apart, and of what then is not there.
    separating: Option<[f64; 3]>,
    /// Radius of the smaller one.
    radius: f64,
    /// Impulse that `b` received so far.
    impulse: [f64; 3],
    /// Part of it along normals.
    normal_impulse: [f64; 3],
    /// Where they last pressed.
    point: [f64; 3],
    /// Since first touch.
    age: f64,
    /// Substeps since the last impulse.
    quiet: u32,
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
    /// Closing speed at first touch, of the rigid parts along the mean normal.
    pub closing_speed: f64,
    /// Speed of separation at the end; none when they stay together.
    pub separation_speed: Option<f64>,
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

/// Velocity of the first of a pair relative to the second where they press, and the radius of the smaller one.
fn relative_motion(motions: [Option<RigidMotion>; 2], point: [f64; 3]) -> Option<([f64; 3], f64)> {
    let [Some(a), Some(b)] = motions else {
        return None;
    };
    let (v_a, v_b) = (a.at(point), b.at(point));
    let relative = std::array::from_fn(|i| v_a[i] - v_b[i]);
    Some((relative, a.radius.min(b.radius)))
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

    /// Whether a pair, the smaller number first, has touched and not parted for good.
    pub fn has(&self, pair: [u32; 2]) -> bool {
        self.open.binary_search_by_key(&pair, |e| e.fields).is_ok()
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
            let separating = e.separating.unwrap_or([f64::NAN; 3]);
            let vectors = [e.closing, separating, e.impulse, e.normal_impulse, e.point];
            let numbers = vectors.into_iter().flatten().chain([e.age, e.radius]);
            let fields = e.fields.map(u64::from);
            let all = fields.into_iter().chain([flags]);
            all.chain(numbers.map(f64::to_bits)).collect::<Vec<_>>()
        });
        episodes.collect()
    }

    /// Books the impulses of a substep of `dt` [s] that ends at `time` [s]. `motion` tells the rigid part of the motion of an object
    /// before they act, and none of what is held or is not there.
    pub fn book(
        &mut self,
        exchanged: &[PairExchange],
        motion: impl Fn(u32) -> Option<RigidMotion>,
        [dt, time]: [f64; 2],
    ) {
        for episode in &mut self.open {
            episode.age += dt;
            episode.quiet += 1;
        }
        for (fields, exchange) in exchanged {
            let point = exchange.moment.map(|m| m / exchange.weight);
            let at = match self.open.binary_search_by_key(fields, |e| e.fields) {
                Ok(at) => at,
                Err(at) => {
                    let Some((closing, radius)) = relative_motion(fields.map(&motion), point)
                    else {
                        continue;
                    };
                    let begun = Episode {
                        fields: *fields,
                        closing,
                        separating: None,
                        radius,
                        impulse: [0.0; 3],
                        normal_impulse: [0.0; 3],
                        point,
                        age: dt,
                        quiet: 0,
                        lasting: false,
                    };
                    self.open.insert(at, begun);
                    at
                }
            };
            let episode = &mut self.open[at];
            (episode.quiet, episode.point) = (0, point);
            for i in 0..3 {
                episode.impulse[i] += exchange.impulse[i];
                episode.normal_impulse[i] += exchange.normal_impulse[i];
            }
        }
        for episode in self.open.iter_mut().filter(|e| e.quiet == 1) {
            let relative = relative_motion(episode.fields.map(&motion), episode.point);
            episode.separating = relative.map(|(velocity, _)| velocity);
        }
        let closed = &mut self.closed;
        self.open.retain_mut(|episode| {
            if episode.becomes_lasting() {
                episode.lasting = true;
                closed.push(episode.close(None, time));
            }
            if !episode.has_parted() {
                return true;
            }
            if !episode.lasting {
                closed.push(episode.close(episode.separation_speed(), time));
            }
            false
        });
    }
}

impl Episode {
    fn normal(&self) -> [f64; 3] {
        unit(self.normal_impulse)
    }

    fn closing_speed(&self) -> f64 {
        dot(self.closing, self.normal())
    }

    fn separation_speed(&self) -> Option<f64> {
        self.separating
            .map(|velocity| -dot(velocity, self.normal()))
    }

    fn becomes_lasting(&self) -> bool {
        !self.lasting && self.age * self.closing_speed().abs() > LASTING * self.radius
    }

    /// Whether they have touched for so long no more that they have parted.
    fn has_parted(&self) -> bool {
        let closes = self.separation_speed().is_some_and(|speed| speed < 0.0);
        match closes && !self.lasting {
            true => self.quiet >= QUIET_CLOSING,
            false => self.quiet >= QUIET,
        }
    }

    fn close(&self, separation_speed: Option<f64>, time: f64) -> Closed {
        Closed {
            fields: self.fields,
            impulse: self.impulse,
            closing_speed: self.closing_speed(),
            separation_speed,
            duration: self.age,
            time,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.01;

    /// Motion of something that only flies along x.
    fn flying(speed: f64) -> RigidMotion {
        RigidMotion {
            com: [0.0; 3],
            velocity: [speed, 0.0, 0.0],
            spin: [0.0; 3],
            radius: 1.0,
        }
    }

    /// Books substeps in which the first of a pair flies at these speeds; it is pressed at some of them.
    fn booked(speeds: impl IntoIterator<Item = (f64, bool)>) -> Episodes {
        let mut episodes = Episodes::default();
        let pressed = [(
            [3, 5],
            Received::at([0.0; 3], [1.0, 0.0, 0.0], 0.5, [0.5, 0.0, 0.0]),
        )];
        for (n, (speed, presses)) in (1..).zip(speeds) {
            let exchanged = if presses { &pressed[..] } else { &[] };
            let motion = |field: u32| Some(flying(if field == 3 { speed } else { 0.0 }));
            episodes.book(exchanged, motion, [DT, f64::from(n) * DT]);
        }
        episodes
    }

    #[test]
    fn a_pair_that_parts_is_told_with_both_speeds() {
        let presses = [(2.0, true), (0.5, true), (-1.0, true)];
        // What happens to it after the last touch is no part of it.
        let quiet = (0..8).map(|n| (-1.5 - f64::from(n), false));
        let mut all: Vec<(f64, bool)> = presses.into_iter().chain(quiet).collect();
        let last = all.pop().expect("the last");
        assert_eq!(booked(all.clone()).pairs().collect::<Vec<_>>(), [[3, 5]]);
        all.push(last);
        let mut episodes = booked(all);
        assert_eq!(episodes.pairs().count(), 0);
        let [closed] = episodes.take_closed()[..] else {
            panic!("one episode");
        };
        assert_eq!(
            (closed.closing_speed, closed.separation_speed),
            (2.0, Some(1.5))
        );
        assert_eq!((closed.fields, closed.impulse), ([3, 5], [1.5, 0.0, 0.0]));
        assert!((closed.duration - 11.0 * DT).abs() < 1e-12 && closed.time == 11.0 * DT);
    }

    #[test]
    fn a_pair_that_closes_again_has_not_parted() {
        let again = |quiet: usize| {
            let touch = [(2.0, true), (0.5, true)].into_iter();
            let pause = std::iter::repeat_n((0.1, false), quiet);
            touch.chain(pause).chain([(0.1, true)])
        };
        assert!(booked(again(31)).take_closed().is_empty());
        let closed = booked(again(32)).take_closed();
        assert_eq!(closed[0].separation_speed, Some(-0.1));
    }

    #[test]
    fn a_pair_that_stays_together_is_told_once() {
        let rests = std::iter::repeat_n((0.0, true), 400);
        let all = [(2.0, true)].into_iter().chain(rests);
        let mut episodes = booked(all);
        let closed = episodes.take_closed();
        assert_eq!(closed.len(), 1);
        assert_eq!(closed[0].separation_speed, None);
        // Two metres a second go four radii in two seconds.
        assert!((closed[0].time - 2.0).abs() < 0.02, "{closed:?}");
        assert_eq!(episodes.pairs().count(), 1);
    }
}
