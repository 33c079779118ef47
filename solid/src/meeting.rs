//! What colliders do to a point of a solid's surface where it is: they hold it, or press on it.

use super::{
    bonds::{Bond, Bound, Hold, binds},
    grip::{Grip, NOTHING, OBJECTS},
    overlaps::Overlaps,
    penalty::{Account, NormalContact},
};
use crate::{
    colliders::{MovedPoint, Placed, primitives::Distance, shape::Shape},
    ledger::Received,
    mat3::dot,
    scene::Surface,
};

/// A point in contact: its spring, force [N], and what the ledger is told.
#[derive(Clone, Debug)]
pub(super) struct Pressed {
    pub point: usize,
    pub grip: Grip,
    pub force: [f64; 3],
    /// By the first collider that presses on it, and by others.
    pub received: Option<(usize, Received)>,
    pub more: Vec<(usize, Received)>,
    pub hold: Option<Hold>,
}

impl Pressed {
    /// A point that nothing acts on.
    fn none(point: usize) -> Self {
        Self {
            point,
            grip: Grip::NONE,
            force: [0.0; 3],
            received: None,
            more: vec![],
            hold: None,
        }
    }
}

/// A point on its way.
pub(super) struct At<'a> {
    pub x: [f64; 3],
    pub v: [f64; 3],
    /// Force per depth [N/m].
    pub stiffness: f64,
    /// Distance below which it is on a wall that holds it [m].
    pub touch: f64,
    /// What it was put into.
    pub overlaps: &'a Overlaps,
    /// Since the springs were last stretched [s].
    pub moved: f64,
}

impl At<'_> {
    /// How a collider holds it, if it does or begins to.
    fn hold(
        &self,
        point: usize,
        placed: &Placed<'_>,
        found: &Distance,
        stretch: Option<[f64; 3]>,
    ) -> Option<Hold> {
        if stretch.is_none() && found.value >= self.touch {
            return None;
        }
        // It stays as far from the wall as it met it: what pushed it out would do work on all that moves behind it.
        let slips = placed.contact().surface == Surface::Slip;
        let met = stretch.unwrap_or(found.normal.map(|n| found.value * n));
        let (with, in_front) = (placed.id as u32, dot(met, found.normal));
        if slips && matches!(placed.shape(), Shape::HalfSpace { .. }) {
            return Some(Hold::Flat(Bound {
                point,
                with,
                in_front,
            }));
        }
        Some(Hold::Point(Bond {
            point,
            with,
            x: self.x,
            v: self.v,
            normal: found.normal,
            gap: found.value,
            wall: placed.velocity(self.x),
            spin: placed.spin(),
            slips,
            stretch: match slips {
                true => found.normal.map(|n| in_front * n),
                false => met,
            },
        }))
    }

    /// Its velocity in the frame of a collider since it was last looked at [m/s].
    fn relative(&self, placed: &Placed<'_>) -> [f64; 3] {
        let u = placed.past_velocity(self.x);
        std::array::from_fn(|a| self.v[a] - u[a])
    }

    /// Its distance from a collider that it may leave, on the side that it is on, and the face that it is behind.
    fn separation(&self, placed: &Placed<'_>, before: Option<&Grip>) -> (Distance, [f32; 3]) {
        if !placed.is_thin() {
            return (placed.distance(self.x), [0.0; 3]);
        }
        let before = before.unwrap_or(&Grip::NONE);
        placed.separation(&MovedPoint {
            x: self.x,
            way: self.relative(placed).map(|v| self.moved * v),
            side: turned_side(placed, before.side, self.moved),
            depth: before.depth,
        })
    }

    /// Adds what a collider presses on it with at a depth [m] to what others do; returns what the point remembers of it, or of its end.
    fn press(
        &self,
        placed: &Placed<'_>,
        (depth, normal): (f64, [f64; 3]),
        (before, put_in): (&Grip, f64),
        kick: f64,
        out: &mut Pressed,
    ) -> Option<Grip> {
        let known = before.with == placed.id as u32;
        let surface = placed.contact();
        let leaves = surface.surface == Surface::Separate;
        // What was put in is led out, whatever work that takes; what slips on a wall that holds it hangs there as well.
        let remembers = leaves && put_in == 0.0 && (known || before.with == NOTHING);
        let account = remembers.then(|| Account::of(before, self.stiffness));
        if depth <= 0.0 && (leaves || !known) {
            let ended = account.filter(|_| known);
            return ended.map(|account| account.part(depth - before.depth));
        }
        let relative = self.relative(placed);
        let contact = NormalContact {
            stiffness: self.stiffness,
            depth,
            slope: 1.0,
            normal,
            friction: surface.friction,
            approach: match known {
                true => depth - before.depth,
                false => -self.moved * dot(relative, normal),
            },
        };
        let stretch = known.then(|| placed.carried(before.stretch, self.moved));
        let with = placed.id as u32;
        let (force, grip) = contact.press(with, (account, stretch), (relative, self.moved));
        for a in 0..3 {
            out.force[a] += force[a];
        }
        let impulse = force.map(|f| kick * f);
        let received = Received::at(self.x, normal, kick * grip.pressure, impulse);
        match &out.received {
            None => out.received = Some((placed.id, received)),
            Some(_) => out.more.push((placed.id, received)),
        }
        Some(grip)
    }

    /// How far it is from all colliders [m]; adds what they do to it, but where it neither touches nor touched any.
    pub fn meet(
        &self,
        point: usize,
        colliders: &[Placed<'_>],
        (before, met): (Grip, &mut Vec<Pressed>),
        kick: f64,
    ) -> f64 {
        let mut clear = f64::INFINITY;
        let mut out = Pressed::none(point);
        // One holds it at a time: two would share its memory.
        let holder = |placed: &Placed<'_>| before.with == placed.id as u32 && binds(placed);
        let is_held = before.is_on_region() || colliders.iter().any(holder);
        let (mut pressed, mut deepest, mut energy) = (Grip::NONE, 0.0, 0.0);
        let mut parted = Grip::NONE;
        for placed in colliders {
            let known = before.with == placed.id as u32;
            let binds = binds(placed);
            if binds && !known && (is_held || out.hold.is_some()) {
                continue;
            }
            let (found, side) = match binds {
                true => (placed.distance(self.x), [0.0; 3]),
                false => self.separation(placed, known.then_some(&before)),
            };
            let stretch = known.then_some(before.stretch);
            if binds {
                out.hold = self.hold(point, placed, &found, stretch);
                if let Some(hold) = &out.hold {
                    out.grip = hold.grip(found.normal);
                }
            }
            // What a flat wall holds need not be looked at for that.
            if !(binds && matches!(out.hold, Some(Hold::Flat(_)))) {
                clear = clear.min(found.value);
            }
            if binds {
                continue;
            }
            let put_in = self.overlaps.depth(point, placed.id as u32);
            let depth = -found.value - put_in;
            let (at, of_point) = ((depth, found.normal), (&before, put_in));
            let mut grip = match self.press(placed, at, of_point, kick, &mut out) {
                Some(grip) if grip.with != NOTHING => grip,
                ended => {
                    parted = ended.unwrap_or(parted);
                    continue;
                }
            };
            grip.side = side;
            energy += grip.energy.max(0.0);
            if pressed.with == NOTHING || depth > deepest {
                (pressed, deepest) = (grip, depth);
            }
        }
        let presses = pressed.with != NOTHING;
        let touches = presses || out.hold.is_some();
        if presses || matches!(out.hold, Some(Hold::Point(_))) {
            clear = 0.0;
        }
        // What holds is remembered, whatever presses besides.
        if out.hold.is_none() {
            out.grip = match (before.is_on_region(), presses) {
                (true, _) => before,
                (false, true) => pressed,
                (false, false) => parted,
            };
        }
        // By its own account what presses gives back no more than it took.
        if out.hold.is_some() {
            out.grip.energy = energy;
        }
        if touches || before.with < OBJECTS {
            met.push(out);
        }
        clear
    }
}

/// The normal of a face of a collider as the collider has turned since it was looked at, `moved` [s] ago.
fn turned_side(placed: &Placed<'_>, side: [f32; 3], moved: f64) -> [f32; 3] {
    placed.carried(side.map(f64::from), moved).map(|n| n as f32)
}
