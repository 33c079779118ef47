//! Fidelity: objects that nothing moves are put to sleep, with all that rests on them, and woken by what comes near.
//!
//! One tolerance decides, relative to the radius of an object: what it has not moved by within [`REST`] seconds counts
//! as no motion. A sleeping object keeps its particles as they are and costs nothing per substep.

use std::{borrow::Cow, collections::VecDeque};

use bytemuck::bytes_of;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use super::{Frame, State, World};
use crate::{
    mat3::dot,
    particles::{BLOCK, Block, Extremes, Motion, NO_PARTICLE, Particles},
    report::{Level, ObjectState},
    scene::{Fidelity, Object},
    simd::F32x16,
};

/// How long an object must have been still before it sleeps [s].
const REST: f64 = 0.25;
/// Looks at an object within that time at most.
const LOOKS: f64 = 16.0;
/// What sums of frame lengths may be off by, relative.
const ROUNDING: f64 = 1e-9;
/// Particles that are watched per object at most.
const SAMPLES: usize = 64;
/// Reach of matter through the grid: the stencils of two particles, and the drift of one of them [cells].
const REACH: f64 = 4.0;

/// How an object is modelled at present, and since when it has been still.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Standing {
    /// Where it sleeps.
    asleep: Option<Box<Asleep>>,
    /// Where its samples were of late, latest last.
    looks: VecDeque<Look>,
    /// Since the latest look [s].
    unseen: f64,
    /// Its samples in the frame of its mean rotation when its shape last changed [m].
    pub shape: Vec<[f32; 3]>,
    /// For how long it has kept its shape [s].
    pub steady: f64,
    /// Elastic energy of its matter when a body took its place, as long as that does [J].
    pub stand_in: Option<f64>,
}

/// Where the samples of an object were at some time.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Look {
    /// Time since the look before [s].
    after: f64,
    /// Positions [m].
    places: Vec<[f32; 3]>,
}

/// A sleeping object.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Asleep {
    particles: Particles,
    /// Of its parts, in their order.
    extremes: Vec<Extremes>,
}

impl Standing {
    /// Adds what no particle shows to a hash.
    pub fn add_to(&self, hash: &mut Xxh3) {
        hash.update(&[u8::from(self.asleep.is_some())]);
        for look in &self.looks {
            hash.update(bytes_of(&look.after));
            hash.update(bytemuck::cast_slice(&look.places));
        }
        hash.update(bytes_of(&self.unseen));
        hash.update(bytes_of(&[self.steady, self.stored_energy()]));
        hash.update(bytemuck::cast_slice(&self.shape));
    }

    /// Looks at its samples after another `frame` [s], if it is time to.
    fn look(&mut self, frame: f64, places: impl FnOnce() -> Vec<[f32; 3]>) {
        self.unseen += frame;
        if !self.looks.is_empty() && self.unseen < REST / LOOKS {
            return;
        }
        self.looks.push_back(Look {
            after: self.unseen,
            places: places(),
        });
        self.unseen = 0.0;
        // As many as REST takes.
        let mut span: f64 = self.looks.iter().skip(2).map(|look| look.after).sum();
        while self.looks.len() > 1 && span >= REST * (1.0 - ROUNDING) {
            self.looks.pop_front();
            span -= self.looks.get(1).map_or(span, |look| look.after);
        }
    }

    /// Forgets what it saw.
    pub fn look_anew(&mut self) {
        self.looks.clear();
        self.unseen = 0.0;
    }

    /// Whether it has been still for [`REST`]: no sample was farther than `limit` [m] from the middle of where it was, and
    /// what it went without coming back counts whole. So vibration may be as large as what is tolerated, and the
    /// turning point of a slow swing does not pass for rest.
    fn is_still(&self, limit: f64) -> bool {
        let span: f64 = self.looks.iter().skip(1).map(|look| look.after).sum();
        let Some(latest) = self.looks.back() else {
            return false;
        };
        let all = self.looks.iter();
        let complete = all.clone().all(|l| l.places.len() == latest.places.len());
        span >= REST * (1.0 - ROUNDING)
            && complete
            && (0..latest.places.len()).all(|sample| {
                let (mut to_and_fro, mut one_way) = (0.0, 0.0);
                for a in 0..3 {
                    let way = all.clone().map(|look| f64::from(look.places[sample][a]));
                    let ([low, high], turned) = range(way);
                    let squared = (high - low).powi(2);
                    to_and_fro += 0.25 * squared;
                    one_way += if turned { 0.0 } else { squared };
                }
                to_and_fro.max(one_way) <= limit * limit
            })
    }

    /// Elastic energy that a body holds for its matter [J].
    pub fn stored_energy(&self) -> f64 {
        self.stand_in.unwrap_or(0.0)
    }

    /// Parts of which it holds what a sleeping object must remember.
    pub fn remembered_parts(&self) -> usize {
        self.asleep
            .as_ref()
            .map_or(0, |asleep| asleep.extremes.len())
    }

    /// Its sleeping particles, if it sleeps.
    pub fn sleeping(&self) -> Option<&Particles> {
        self.asleep.as_ref().map(|asleep| &asleep.particles)
    }
}

impl State {
    /// Whether an object sleeps.
    pub(super) fn sleeps(&self, object: usize) -> bool {
        self.standing[object].asleep.is_some()
    }
}

/// The particles of an object that are watched, spread over all of them.
pub(super) fn samples(object: &Object) -> impl Iterator<Item = usize> {
    let range = object.particles.clone();
    let stride = range.len().div_ceil(SAMPLES).max(1);
    range.step_by(stride)
}

/// The extremes of a coordinate, and whether it came back from both.
fn range(way: impl ExactSizeIterator<Item = f64>) -> ([f64; 2], bool) {
    let last = way.len().saturating_sub(1);
    let (mut low, mut high) = ((f64::INFINITY, 0), (f64::NEG_INFINITY, 0));
    for (n, x) in way.enumerate() {
        if x < low.0 {
            low = (x, n);
        }
        if x > high.0 {
            high = (x, n);
        }
    }
    let inside = |n: usize| n > 0 && n < last;
    ([low.0, high.0], inside(low.1) && inside(high.1))
}

/// Whether all samples are within `limit` [m] of where they were.
pub(super) fn stayed(here: &[[f32; 3]], before: &[[f32; 3]], limit: f64) -> bool {
    let near = |(x, y): (&[f32; 3], &[f32; 3])| {
        let way: [f64; 3] = std::array::from_fn(|a| f64::from(x[a]) - f64::from(y[a]));
        dot(way, way) <= limit * limit
    };
    here.len() == before.len() && here.iter().zip(before).all(near)
}

fn count(particles: &Particles) -> usize {
    let ids = particles.fixed.iter().flat_map(|fixed| fixed.id);
    ids.filter(|&id| id != NO_PARTICLE).count()
}

/// Smallest and largest block index, or `None` without blocks.
pub(super) fn extent(blocks: &[Block]) -> Option<[[i32; 3]; 2]> {
    let first = blocks.first()?.index;
    let mut extent = [first; 2];
    for block in blocks {
        for a in 0..3 {
            extent[0][a] = extent[0][a].min(block.index[a]);
            extent[1][a] = extent[1][a].max(block.index[a]);
        }
    }
    Some(extent)
}

/// Whether some blocks of two sorted lists are at most `reach` blocks apart along every axis.
pub(super) fn are_near(one: &[Block], other: &[Block], reach: i32) -> bool {
    let (Some(a), Some(b)) = (extent(one), extent(other)) else {
        return false;
    };
    let apart = |n: usize| a[0][n] > b[1][n] + reach || b[0][n] > a[1][n] + reach;
    if (0..3).any(apart) {
        return false;
    }
    let (few, many) = match one.len() <= other.len() {
        true => (one, other),
        false => (other, one),
    };
    few.iter().any(|block| {
        let [x, y, z] = block.index;
        (-reach..=reach).any(|i| {
            (-reach..=reach).any(|j| {
                let column = [x + i, y + j, z - reach];
                let at = many.partition_point(|b| b.index < column);
                many.get(at).is_some_and(|found| {
                    let [fx, fy, fz] = found.index;
                    [fx, fy] == [x + i, y + j] && fz <= z + reach
                })
            })
        })
    })
}

impl World {
    /// Whether an object may be modelled with less than all of its particles.
    pub(super) fn is_automatic(&self, object: usize) -> bool {
        self.scene.contact.method.tells_apart()
            && self.scene.objects[object].fidelity == Fidelity::Auto
    }

    /// How an object of which this mass is left [kg] is modelled.
    pub(super) fn level(&self, object: usize, mass: f64) -> Level {
        match self.scene.objects[object].fidelity {
            Fidelity::Static => Level::Static,
            _ if mass <= 0.0 => Level::Gone,
            _ if self.state.sleeps(object) => Level::Asleep,
            _ if self.is_one_body(object) => Level::Rigid,
            Fidelity::Mpm | Fidelity::Auto | Fidelity::Rigid => Level::Mpm,
        }
    }

    /// Wakes what is about to be touched, then lets islands of still objects fall asleep.
    pub(super) fn settle_fidelity(&mut self, frame: &mut Frame) {
        let objects = 0..self.scene.objects.len();
        // What a checkpoint brought along of a scene that asked for less.
        for object in objects.clone() {
            if self.is_automatic(object) {
                continue;
            }
            if self.state.sleeps(object) {
                self.wake(object);
            }
            if self.state.standing[object].stand_in.is_some() {
                self.bring_back(object);
            }
        }
        if !objects.clone().any(|id| self.is_automatic(id)) {
            return;
        }
        self.wake_disturbed(frame);
        for object in objects.clone() {
            if self.is_automatic(object) && !self.state.sleeps(object) {
                self.watch(object, frame.length);
            }
        }
        let awake: Vec<usize> = objects
            .filter(|&id| !self.state.sleeps(id) && !self.blocks_of(id).is_empty())
            .collect();
        self.settle_stand_ins(frame);
        for island in self.islands(&awake, frame.length) {
            if island.iter().all(|&object| self.may_sleep(object)) {
                for object in island {
                    self.put_to_sleep(object, frame);
                }
            }
        }
        let asleep = self.state.standing.iter().filter_map(Standing::sleeping);
        frame.asleep = asleep.map(count).sum();
    }

    /// Blocks of an object, awake or not, as of the last sort; those around a body.
    pub(super) fn blocks_of(&self, object: usize) -> Cow<'_, [Block]> {
        if let Some(blocks) = self.blocks_of_body(object) {
            return Cow::Owned(blocks);
        }
        Cow::Borrowed(self.blocks_of_particles(object))
    }

    /// Blocks of its particles, awake or not, as of the last sort.
    pub(super) fn blocks_of_particles(&self, object: usize) -> &[Block] {
        if let Some(particles) = self.state.standing[object].sleeping() {
            return &particles.blocks;
        }
        let blocks = &self.state.particles.blocks;
        let field = object as u32;
        let first = blocks.partition_point(|b| b.field < field);
        let end = blocks.partition_point(|b| b.field <= field);
        &blocks[first..end]
    }

    /// Blocks that an object may cross within two frames, and reach beyond.
    pub(super) fn reach_of(&self, object: usize, frame: f64) -> i32 {
        let cells = 2.0 * frame * self.fastest(object) / self.scene.dx;
        ((cells.min(1e6) + REACH) / f64::from(BLOCK)).ceil() as i32
    }

    /// Wakes every sleeping object that one that is awake comes near to, or that a boundary disturbs.
    fn wake_disturbed(&mut self, frame: &Frame) {
        let objects = 0..self.scene.objects.len();
        let now = self.substep(frame, frame.length);
        let mut sleeping: Vec<usize> = objects
            .clone()
            .filter(|&id| self.state.sleeps(id))
            .collect();
        let mut rousers: Vec<usize> = objects.filter(|&id| !self.state.sleeps(id)).collect();
        let disturbed = |world: &Self, object: usize| {
            let Some([min, max]) = extent(&world.blocks_of(object)) else {
                return false;
            };
            let min = min.map(|i| f64::from(BLOCK * i) - REACH);
            let max = max.map(|i| f64::from(BLOCK * (i + 1)) + REACH);
            world.boundaries.disturb(&world.state.paths, &now, min, max)
        };
        let (roused, still): (Vec<usize>, Vec<usize>) = sleeping
            .iter()
            .partition(|&&object| disturbed(self, object));
        sleeping = still;
        for object in roused {
            self.wake(object);
            rousers.push(object);
        }
        // Whoever wakes may wake others.
        while let Some(rouser) = rousers.pop() {
            let reach = self.reach_of(rouser, frame.length);
            let blocks = self.blocks_of(rouser);
            let near = |&&object: &&usize| are_near(&self.blocks_of(object), &blocks, reach);
            let (roused, still): (Vec<usize>, Vec<usize>) =
                sleeping.iter().partition(|object| near(object));
            sleeping = still;
            for object in roused {
                self.wake(object);
                rousers.push(object);
            }
        }
    }

    /// Takes note of where an object is.
    pub(super) fn watch(&mut self, object: usize, frame: f64) {
        let position = &self.published.position;
        let samples = samples(&self.scene.objects[object]);
        self.state.standing[object].look(frame, || samples.map(|p| position[p]).collect());
    }

    /// Whether nothing speaks against an object's sleep but its neighbours.
    fn may_sleep(&self, object: usize) -> bool {
        let limit = self.scene.tolerance * self.report.objects[object].radius;
        self.is_automatic(object)
            && self.state.standing[object].is_still(limit)
            && !self.is_ruled(object)
    }

    /// Whether a command or a rule of the scene, now or later, has a say in how an object moves.
    pub(super) fn is_ruled(&self, object: usize) -> bool {
        let time = self.state.sim_time;
        let mut particles = self.scene.objects[object].particles.clone();
        self.state.pins[object].is_some()
            || particles.any(|p| self.rules.concern_after(time, p as u32))
    }

    /// Groups of objects of which each is near another.
    fn islands(&self, objects: &[usize], frame: f64) -> Vec<Vec<usize>> {
        let mut rest = objects.to_vec();
        let mut islands = Vec::new();
        while let Some(first) = rest.pop() {
            let mut island = vec![first];
            let mut next = 0;
            while next < island.len() {
                let blocks = self.blocks_of(island[next]);
                let reach = self.reach_of(island[next], frame);
                let (near, far): (Vec<usize>, Vec<usize>) = rest
                    .iter()
                    .partition(|&&other| are_near(&self.blocks_of(other), &blocks, reach));
                island.extend(near);
                rest = far;
                next += 1;
            }
            islands.push(island);
        }
        islands
    }

    fn put_to_sleep(&mut self, object: usize, frame: &mut Frame) {
        let mut particles = self.state.particles.take_field(object as u32);
        particles.motion.fill(Motion::REST);
        self.stop_body(object);
        for fixed in &particles.fixed {
            for &id in fixed.id.iter().filter(|&&id| id != NO_PARTICLE) {
                self.published.halt(id);
            }
        }
        let parts = self.parts.iter().zip(&self.state.extremes);
        let mine = parts.filter(|(part, _)| part.object == object);
        let extremes = mine.map(|(_, extremes)| *extremes).collect();
        self.state.standing[object].asleep = Some(Box::new(Asleep {
            particles,
            extremes,
        }));
        self.state.momentum[object] = [0.0; 3];
        let state = &mut self.report.objects[object];
        frame.fidelity_loss += state.kinetic_energy;
        *state = ObjectState {
            linear_velocity: [0.0; 3],
            angular_momentum: [0.0; 3],
            angular_velocity: [0.0; 3],
            kinetic_energy: 0.0,
            contact_impulse: [0.0; 3],
            ..*state
        };
        self.state.drift = f64::INFINITY;
    }

    /// Wakes an object, if it sleeps.
    pub(super) fn wake(&mut self, object: usize) {
        let standing = &mut self.state.standing[object];
        standing.look_anew();
        let Some(asleep) = standing.asleep.take() else {
            return;
        };
        let Asleep {
            mut particles,
            extremes,
        } = *asleep;
        for motion in &mut particles.motion {
            for a in 0..3 {
                motion.v[a] = F32x16::splat(-self.state.carrier[a] as f32);
            }
        }
        self.state.particles.put_field(particles);
        let parts = self.parts.iter().zip(&mut self.state.extremes);
        let mine = parts.filter(|(part, _)| part.object == object);
        for ((_, to), from) in mine.zip(extremes) {
            *to = from;
        }
        self.state.drift = f64::INFINITY;
    }

    /// Wakes all.
    pub(super) fn wake_all(&mut self) {
        for object in 0..self.scene.objects.len() {
            self.wake(object);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether one sample that moves as `way` says [m] passes for still, looked at in frames of `frame` [s] until `end`.
    fn rests(way: impl Fn(f64) -> f64, frame: f64, end: f64, limit: f64) -> bool {
        let mut standing = Standing::default();
        for n in 0..=(end / frame).round() as usize {
            standing.look(frame, || vec![[0.0, way(n as f64 * frame) as f32, 1.0]]);
        }
        standing.is_still(limit)
    }

    #[test]
    fn vibration_within_the_tolerance_is_rest_wherever_it_began() {
        for frame in [1.0 / 60.0, 1.0 / 300.0] {
            for phase in 0..12 {
                let way = |t: f64| (31.0 * t + 0.5 * f64::from(phase)).sin();
                // One period takes 0.2 s: within half of one more it has turned at both ends.
                let soon = (0..6).any(|n| rests(way, frame, 0.25 + 0.017 * f64::from(n), 1.02));
                assert!(soon, "{frame} {phase}");
                assert!(!rests(way, frame, 0.5, 0.9), "{frame} {phase}");
                assert!(!rests(way, frame, 0.2, 1.02), "too soon: {frame} {phase}");
            }
        }
    }

    #[test]
    fn drift_counts_whole_and_so_does_a_slow_swing_as_it_turns() {
        let frame = 1.0 / 64.0;
        let creep = |t: f64| t / 0.25;
        assert!(rests(creep, frame, 1.0, 1.01) && !rests(creep, frame, 1.0, 0.99));
        // Around the turning point, an eighth of a second to each side.
        let swing = |t: f64| 1.0 - (2.0 * (t - 1.0)).cos();
        let range = swing(1.125);
        assert!(rests(swing, frame, 1.125, 1.1 * range));
        assert!(!rests(swing, frame, 1.125, 0.9 * range));
    }

    #[test]
    fn no_more_is_remembered_than_it_takes() {
        for frame in [0.5, 0.1, 1.0 / 60.0, 1e-3] {
            let mut standing = Standing::default();
            for _ in 0..1000 {
                standing.look(frame, || vec![[0.0; 3]]);
            }
            assert!(standing.looks.len() <= 18, "{} looks", standing.looks.len());
            assert!(standing.is_still(0.0), "{frame}");
        }
    }
}
