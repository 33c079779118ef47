//! Solids that are put where something is already: depth that no motion came to holds no energy.
//!
//! What a point is in when its solid is put there presses on it from that depth on, as if its surface lay there. That depth gets less as
//! the point comes out, and at a limited speed besides, so that what overlaps is led apart.

use super::{
    advance::Solid,
    bonds::{TOUCH, binds},
    contact::ContactSurface,
    grip::Grip,
    overlaps::Overlap,
};
use crate::{bodies::actor::Actor, colliders::Placed};

/// Rate of the way back, which is that of a pendulum with critical damping let go [1/s]: what follows is not hit, and does not jump where
/// things weigh, as it slows down by less than gravity would up to two decimetres.
const RATE: f64 = 8.0;
/// Largest speed of it, over that of sound: what follows is strained by as much.
const FASTEST: f64 = 0.01;
/// Depth from which on it goes on at one speed, so that it ends [cells].
const LAST: f64 = 0.1;
/// Depth beyond it from which on it stays as it is: what cannot get out is not pressed harder and harder. In a body the nearest surface may
/// change, and what it is pressed with then turns: with 0.25 a block came out of another of its width at 0.5 m/s [cells].
const HARD: f64 = 0.02;

/// What points of a solid may be in.
pub(crate) struct Others<'a> {
    pub colliders: &'a [Placed<'a>],
    pub bodies: &'a [Actor<'a>],
    /// Numbers of the bodies in the scene.
    pub objects: &'a [usize],
}

impl Others<'_> {
    /// All that presses on points, as grips name it, ascending; what binds holds them where they are.
    fn partners(&self) -> Vec<u32> {
        let walls = self.colliders.iter().filter(|placed| !binds(placed));
        let walls = walls.map(|placed| placed.id as u32);
        let objects = self.objects.iter().map(|&object| Grip::on_object(object));
        let mut all: Vec<u32> = walls.chain(objects).collect();
        all.sort_unstable();
        all
    }

    /// How deep a place is in one of them [m], < 0 outside.
    fn depth(&self, x: [f64; 3], with: u32) -> f64 {
        let mut walls = self.colliders.iter();
        if let Some(wall) = walls.find(|placed| placed.id as u32 == with) {
            return wall.skin() - wall.distance(x).value;
        }
        let mut bodies = self.bodies.iter().zip(self.objects);
        let body = bodies.find(|(_, object)| Grip::on_object(**object) == with);
        body.map_or(f64::NEG_INFINITY, |(actor, _)| actor.depth(x))
    }
}

impl Solid<'_> {
    /// Looks for overlaps where the solid was put; lets those that are known go back as they do in `moved` [s].
    pub(crate) fn relax_overlaps(
        &mut self,
        surface: &ContactSurface,
        others: &Others<'_>,
        moved: f64,
    ) {
        let mut overlaps = std::mem::take(&mut self.state.overlaps);
        if std::mem::take(&mut overlaps.are_due) {
            overlaps.all = self.find_overlaps(surface, others);
        }
        let (dx, fastest) = (self.model.dx, FASTEST * self.sound_at_rest());
        overlaps.all.retain_mut(|one| {
            let now = others.depth(self.place(surface, one.point as usize), one.with);
            let pull = RATE * (RATE * one.depth.max(LAST * dx) - 2.0 * one.speed);
            one.speed = match now - one.depth > HARD * dx {
                true => 0.0,
                false => (one.speed + moved * pull).clamp(0.0, fastest),
            };
            // What comes out faster is not pushed besides.
            one.depth = match now < one.depth {
                true => now,
                false => one.depth - moved * one.speed,
            };
            one.depth > 0.0
        });
        self.state.overlaps = overlaps;
    }

    fn find_overlaps(&self, surface: &ContactSurface, others: &Others<'_>) -> Vec<Overlap> {
        let (partners, mut found) = (others.partners(), vec![]);
        let clusters = surface.clusters.iter();
        for point in clusters.flat_map(|cluster| cluster.points.clone()) {
            let x = self.place(surface, point);
            let overlaps = partners.iter().map(|&with| Overlap {
                point: point as u32,
                with,
                depth: others.depth(x, with),
                speed: 0.0,
            });
            found.extend(overlaps.filter(|one| one.depth > TOUCH * self.model.dx));
        }
        found
    }
}
