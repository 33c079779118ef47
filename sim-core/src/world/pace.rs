//! Substeps of an object's own: where something stiff asks for short ones, automatic objects that may take longer ones do.
//!
//! Slow objects take one substep while the others take [`Pace::every`]. What is apart from those takes it as any substep. Of what
//! is among them velocities stay on the grid meanwhile, where forces change them little by little, and contact, boundaries and
//! bodies as in every substep: so momentum is exchanged as always, and what rests on each other is in balance at any time. Their
//! particles move by where those velocities end, as in any substep, and are left alone until then.

use super::{
    Frame, World,
    frame::{SEGMENT, Step},
    time_step::PLANNED_TRAVEL,
};
use crate::{
    bodies::body::Body,
    colliders::Substep,
    grid::{Clock, NONE, Shared, Transfer},
    kinematics::kick,
};

/// Most substeps of others to one of a slow object. Fewer than those without an impulse after which a pair may count as
/// parted: two objects that are apart from others meet once in them.
const MOST: u32 = 7;
/// Cost of a particle's substep where forces are worked out apart, in common ones.
const COST: f64 = 1.5;
/// Share of particles in the cost of a substep among others, where contact and boundaries are worked out as often as before
/// (measured in heaps: 0.3 to 0.4).
const OFF_THE_GRID: f64 = 0.35;
/// How far out of a block of particles their nodes may be: particles drift, and reach beyond [cells].
const NODES_OUT: f64 = 3.0;
/// Offset 0 of the 27 around a block.
const HERE: usize = 13;
/// Least share of the cost of substeps that must be saved.
const WORTH: f64 = 0.1;

/// How an object takes substeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stride {
    /// As most do.
    Common,
    /// Longer ones, where nothing that takes common ones is near.
    Apart,
    /// Longer ones, with velocities that stay on the grid in between.
    Among,
}

/// Which objects take longer substeps than the others in a segment, and how far they are in one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pace {
    /// Substeps of the others to one of a slow object; 1 where all take the same.
    pub every: u32,
    /// Per object; common where there is none.
    strides: Vec<Stride>,
    /// How many the others took since slow objects began theirs.
    beat: u32,
    /// What is left of the frame where slow objects began theirs [s].
    begun: f64,
    /// Velocity that those of nodes were relative to in the first substep of the others since then [cells/s].
    carrier: [f64; 3],
    /// Largest velocity component on the grid since then [cells/s].
    fastest: f32,
}

impl Pace {
    /// All alike.
    pub fn common() -> Self {
        Self {
            every: 1,
            strides: vec![],
            beat: 0,
            begun: 0.0,
            carrier: [0.0; 3],
            fastest: 0.0,
        }
    }

    /// How an object takes substeps.
    fn stride(&self, object: usize) -> Stride {
        self.strides.get(object).copied().unwrap_or(Stride::Common)
    }

    fn is_slow(&self, object: usize) -> bool {
        self.stride(object) != Stride::Common
    }

    /// Substeps of others to one of the object.
    pub fn of(&self, object: usize) -> f64 {
        match self.is_slow(object) {
            true => f64::from(self.every),
            false => 1.0,
        }
    }

    /// Whether slow objects move at the end of the substep at hand.
    pub fn is_last(&self) -> bool {
        self.beat + 1 == self.every
    }

    /// Goes on to a substep in which slow objects begin theirs, with so much [s] left of the frame.
    pub fn begin(&mut self, remaining: f64) {
        (self.beat, self.begun, self.fastest) = (0, remaining, 0.0);
    }

    /// Goes on to the next substep of the others.
    pub fn go_on(&mut self) {
        self.beat += 1;
    }

    /// Takes in the largest velocity component of a substep [cells/s]; returns that of all since slow objects began theirs. NaN
    /// is the largest.
    pub fn fastest(&mut self, new: f32) -> f32 {
        self.fastest = f32::from_bits(self.fastest.to_bits().max(new.to_bits()));
        self.fastest
    }

    /// Size of the substep at hand of the others, of a slow one of `span` [s], with so much left of the frame: the last one takes
    /// what rounding left.
    pub fn share(&self, span: f64, remaining: f64) -> f64 {
        match (self.every, self.is_last()) {
            (1, _) => span,
            (_, true) => remaining - (self.begun - span),
            (every, false) => f64::from((span / f64::from(every)) as f32),
        }
    }
}

/// Objects whose particles are moved in the same way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Class {
    pub stride: Stride,
    /// How far velocities are behind positions [s].
    lag: f64,
}

/// The classes of a substep, and per object the one that it belongs to, if its particles are to be moved.
pub(super) struct Classes {
    pub all: Vec<Class>,
    pub of: Vec<Option<usize>>,
}

impl World {
    /// Who is slow in a segment that begins now: where that saves most.
    pub(super) fn pace(&self, frame: &Frame) -> Pace {
        let objects = self.scene.objects.len();
        if !(0..objects).any(|id| self.is_automatic(id)) || !frame.may_differ() {
            return Pace::common();
        }
        let mut own = vec![f64::INFINITY; objects];
        let mut counts = vec![0.0; objects];
        for (id, part) in self.parts.iter().enumerate() {
            if self.is_simulated(id) {
                own[part.object] = own[part.object].min(self.limit_of(id).dt);
                counts[part.object] += part.particles.len() as f64;
            }
        }
        let shortest = own.iter().copied().fold(f64::INFINITY, f64::min);
        let total: f64 = counts.iter().sum();
        for (object, own) in own.iter_mut().enumerate() {
            if *own < 2.0 * shortest || counts[object] == 0.0 || !self.may_be_slow(object) {
                *own = 0.0;
            }
        }
        // Nobody's substep is longer than this, and mostly it is nothing.
        let longest = own.iter().copied().fold(0.0, f64::max);
        let longest = longest
            .min(frame.remaining())
            .min(PLANNED_TRAVEL / self.state.grid_speed);
        if longest < 2.0 * shortest {
            return Pace::common();
        }
        // Twice, as objects may become faster meanwhile.
        let time = frame.remaining().min(SEGMENT as f64 * shortest);
        let waded = self.waded(2.0 * time);
        let mut best = (WORTH * total, Pace::common());
        for every in (2..=MOST).take_while(|&every| f64::from(every) * shortest <= longest) {
            let slow = own.iter().map(|&own| own >= f64::from(every) * shortest);
            let strides = self.strides(&slow.collect::<Vec<_>>(), &waded);
            let saved = strides
                .iter()
                .zip(&counts)
                .map(|(stride, count)| match stride {
                    Stride::Common => 0.0,
                    Stride::Apart => count * (1.0 - f64::from(every).recip()),
                    Stride::Among => count * OFF_THE_GRID * (1.0 - COST / f64::from(every)),
                });
            let saved = saved.sum();
            if saved > best.0 {
                let pace = Pace {
                    every,
                    strides,
                    ..Pace::common()
                };
                best = (saved, pace);
            }
        }
        best.1
    }

    /// Whether an object may take substeps of its own: one that is modelled as it needs, and that no rule moves.
    fn may_be_slow(&self, object: usize) -> bool {
        self.is_automatic(object) && !self.is_ruled(object)
    }

    /// Per object, whether a body may come to its matter within some time [s]: bodies meet nodes in every common substep.
    fn waded(&self, time: f64) -> Vec<bool> {
        let dx = self.scene.dx;
        let bodies: Vec<(usize, &Body, f64)> = (0..self.scene.objects.len())
            .filter_map(|id| {
                let (rigid, shape) = (self.state.rigid[id].as_ref()?, self.shapes[id].as_ref()?);
                Some((id, &rigid.body, shape.radius))
            })
            .collect();
        let is_near = |object: usize| {
            let near = |(id, body, radius): &(usize, &Body, f64)| {
                let reach = radius + time * (self.fastest(*id) + self.fastest(object));
                let com = body.com.map(|x| x / dx);
                let mut blocks = self.blocks_of_particles(object).iter();
                blocks.any(|block| block.distance(com, NODES_OUT) <= reach / dx)
            };
            bodies.iter().any(near)
        };
        (0..self.scene.objects.len()).map(is_near).collect()
    }

    /// How objects take substeps of which some could take longer ones, and some may meet bodies.
    fn strides(&self, slow: &[bool], waded: &[bool]) -> Vec<Stride> {
        // What may share nodes with one that takes common ones, or with what does, is among them: particles reach nodes of
        // their block and of those around it.
        let grid = &self.workspace.grid;
        let sharers = |place: &Shared| {
            let sharers = grid.sharers[place.nodes.clone()].iter();
            sharers.map(|&node| &grid.nodes[node as usize])
        };
        let is_met = |place: &&Shared| sharers(place).any(|node| node.tiles[HERE] != NONE);
        let met: Vec<&Shared> = grid.shared.iter().filter(is_met).collect();
        let mut among: Vec<bool> = slow
            .iter()
            .zip(waded)
            .map(|(slow, waded)| !slow || *waded)
            .collect();
        loop {
            let mut grows = false;
            for place in &met {
                if sharers(place).any(|node| among[node.field as usize]) {
                    for node in sharers(place) {
                        grows |= !std::mem::replace(&mut among[node.field as usize], true);
                    }
                }
            }
            if !grows {
                break;
            }
        }
        // Grains give way to stress anew whenever it is asked for.
        let lasts = |object: usize| {
            let parts = self.parts.iter().zip(&self.state.materials);
            let mut mine = parts.filter(|(part, _)| part.object == object);
            mine.all(|(_, material)| material.law.is_solid() || material.law.is_fluid())
        };
        let objects = slow.iter().zip(among).enumerate();
        objects
            .map(|(object, (&slow, among))| match (slow, among) {
                (true, false) => Stride::Apart,
                (true, true) if lasts(object) => Stride::Among,
                _ => Stride::Common,
            })
            .collect()
    }

    /// Who is moved at the end of a substep, or comes to the grid before one; all at the start of a segment.
    pub(super) fn classes(&self, pace: &Pace, all_move: bool) -> Classes {
        let mut classes = Classes {
            all: vec![],
            of: Vec::with_capacity(self.state.lags.len()),
        };
        for (object, &lag) in self.state.lags.iter().enumerate() {
            let stride = pace.stride(object);
            let class = Class { stride, lag };
            let moves = all_move || stride == Stride::Common || pace.is_last();
            classes.of.push(moves.then(|| {
                let known = classes.all.iter().position(|known| *known == class);
                known.unwrap_or_else(|| {
                    classes.all.push(class);
                    classes.all.len() - 1
                })
            }));
        }
        classes
    }

    /// The substep of a class that ends and the one that begins; at the start of a segment both are the one that begins.
    pub(super) fn of_class(
        &self,
        frame: &Frame,
        class: &Class,
        now: &Step,
        next: Option<&Step>,
    ) -> [Substep; 2] {
        let cfl = self.scene.cfl;
        let [dt, passed] = match class.stride {
            Stride::Common => [now.dt, frame.remaining()],
            Stride::Apart | Stride::Among => [now.span, frame.pace.begun],
        };
        let [long, lag] = kick(class.lag, dt, cfl);
        let ends = Substep {
            time: self.state.sim_time + (frame.length - passed),
            dt,
            kick: long,
            frame_start: self.state.sim_time,
            frame_length: frame.length,
        };
        let begins = next.map_or(ends, |next| {
            let dt = match class.stride {
                Stride::Common => next.dt,
                Stride::Apart | Stride::Among => next.span,
            };
            Substep {
                time: ends.time + ends.dt,
                dt,
                kick: kick(lag, dt, cfl)[0],
                ..ends
            }
        });
        [ends, begins]
    }

    /// Per object the substep that its node velocities act for.
    pub(super) fn clocks(&self, frame: &Frame, step: &Step) -> Vec<Clock> {
        let pace = &frame.pace;
        let passed = match pace.beat {
            0 => 0.0,
            _ => pace.begun - frame.remaining(),
        };
        let objects = 0..self.state.lags.len();
        let clock = |object| match pace.stride(object) {
            Stride::Common => Clock::of(step.dt),
            stride => Clock {
                span: step.span,
                passed,
                waits: stride == Stride::Apart && pace.beat > 0,
            },
        };
        objects.map(clock).collect()
    }

    /// Per object what becomes of velocities on the grid. The carrier is that of before the substep, and becomes `carrier`
    /// [cells/s].
    pub(super) fn transfers(
        &self,
        pace: &mut Pace,
        clocks: &[Clock],
        carrier: [f64; 3],
    ) -> Vec<Transfer> {
        if pace.beat == 0 {
            pace.carrier = carrier;
        }
        let shift = |from: [f64; 3]| std::array::from_fn(|a| (from[a] - carrier[a]) as f32);
        let conditions = &self.scene.conditions;
        let lags = self.state.lags.iter().zip(clocks).enumerate();
        lags.map(|(object, (&lag, clock))| {
            let goes_on = pace.stride(object) == Stride::Among;
            let count = if goes_on { f64::from(pace.every) } else { 1.0 };
            let kick = kick(lag, clock.span, self.scene.cfl)[0] / count;
            let mine = self.carrier_after(kick);
            Transfer {
                keep: conditions.damping_factor(kick) as f32,
                carrier: mine,
                shift: match (clock.waits, pace.is_last()) {
                    (false, _) => shift(mine),
                    (true, true) => shift(pace.carrier),
                    (true, false) => [0.0; 3],
                },
                goes_on: goes_on.then_some(kick as f32),
            }
        })
        .collect()
    }

    /// Takes note of how far velocities are behind after a substep.
    pub(super) fn fall_behind(&mut self, pace: &Pace, step: &Step) {
        self.state.lag = self.lag_after(step.dt);
        let cfl = self.scene.cfl;
        for (object, lag) in self.state.lags.iter_mut().enumerate() {
            match pace.is_slow(object) {
                true if pace.is_last() => *lag = kick(*lag, step.span, cfl)[1],
                true => {}
                false => *lag = kick(*lag, step.dt, cfl)[1],
            }
        }
        // What differs by rounding alone is one class again.
        let common = self.state.lag;
        for lag in &mut self.state.lags {
            if (*lag - common).abs() < 1e-9 * step.dt {
                *lag = common;
            }
        }
    }

    /// Objects without particles in motion begin anew with what the others have.
    pub(super) fn keep_up(&mut self) {
        let mut moves = vec![false; self.state.lags.len()];
        for (id, part) in self.parts.iter().enumerate() {
            moves[part.object] |= self.is_simulated(id);
        }
        for (lag, moves) in self.state.lags.iter_mut().zip(moves) {
            if !moves {
                *lag = self.state.lag;
            }
        }
    }
}
