//! What colliders do to a point of a solid's surface where it is: they hold it, or press on it.

use super::{
    bonds::{Bond, Bound, Hold, binds},
    grip::{Grip, NOTHING, OBJECTS},
    overlaps::Overlaps,
    penalty::Spring,
};
use crate::{
    colliders::{Placed, primitives::Distance, shape::Shape},
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

    /// The spring of a collider that presses on it at a depth [m], or that it slips on with friction.
    fn spring(
        &self,
        placed: &Placed<'_>,
        (depth, normal): (f64, [f64; 3]),
        known: bool,
    ) -> Option<Spring> {
        let contact = placed.contact();
        let leaves = contact.surface == Surface::Separate;
        if depth <= 0.0 && (leaves || !known) {
            return None;
        }
        let pressure = self.stiffness * depth;
        Some(Spring {
            stiffness: self.stiffness,
            depth,
            pressure,
            normal,
            most: contact.friction * pressure.max(0.0) / self.stiffness,
        })
    }

    /// Adds what a collider presses on it with to what others do; returns its spring.
    fn press(
        &self,
        placed: &Placed<'_>,
        (depth, normal): (f64, [f64; 3]),
        stretch: Option<[f64; 3]>,
        kick: f64,
        out: &mut Pressed,
    ) -> Option<Grip> {
        let mut spring = self.spring(placed, (depth, normal), stretch.is_some())?;
        let u = placed.past_velocity(self.x);
        let relative = std::array::from_fn(|a| self.v[a] - u[a]);
        let stretch = stretch.map(|stretch| placed.carried(stretch, self.moved));
        let (force, stretch) = spring.pull(stretch, relative, self.moved);
        for a in 0..3 {
            out.force[a] += force[a];
        }
        let impulse = force.map(|f| kick * f);
        let received = Received::at(self.x, normal, kick * spring.pressure, impulse);
        match &out.received {
            None => out.received = Some((placed.id, received)),
            Some(_) => out.more.push((placed.id, received)),
        }
        Some(Grip {
            with: placed.id as u32,
            stretch,
            energy: spring.energy(stretch),
            pressure: spring.pressure,
        })
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
        let mut out = Pressed {
            point,
            grip: Grip::NONE,
            force: [0.0; 3],
            received: None,
            more: vec![],
            hold: None,
        };
        // One holds it at a time: two would share its memory.
        let holder = |placed: &Placed<'_>| before.with == placed.id as u32 && binds(placed);
        let is_held = before.is_on_region() || colliders.iter().any(holder);
        let (mut pressed, mut deepest, mut energy) = (Grip::NONE, 0.0, 0.0);
        for placed in colliders {
            let known = before.with == placed.id as u32;
            let binds = binds(placed);
            if binds && !known && (is_held || out.hold.is_some()) {
                continue;
            }
            let found = placed.distance(self.x);
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
            let depth = -found.value - self.overlaps.depth(point, placed.id as u32);
            let at = (depth, found.normal);
            let Some(grip) = self.press(placed, at, stretch, kick, &mut out) else {
                continue;
            };
            energy += grip.energy;
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
            out.grip = if before.is_on_region() {
                before
            } else {
                pressed
            };
        }
        if touches {
            out.grip.energy = energy;
        }
        if touches || before.with < OBJECTS {
            met.push(out);
        }
        clear
    }
}
