//! Impacts that give back, each at its moment and by our own law: rapier's comes a step late, and tells a flat face that it tumbles.

use super::{
    actor::{Actor, Setting},
    candidates::{Moment, Solid, is_free},
    manifolds::manifolds,
    pairs::{ExchangedImpulse, partner, surface_of},
    seams::is_at_seam,
    solve::{Mover, Point, impact, settle_energy, sweep, sweeps},
    vector::{Vec3, add, along, sub},
};
use crate::{
    ledger::Received,
    mat3::{Mat3, cross, dot},
};

/// Gap up to which points take part in an impact [m].
pub(super) const TOUCH: f64 = 5e-5;
/// Gap at which an impact happens [m], and what its moment is looked for within.
const CLOSE: f64 = 1e-9;
const CLOSER: f64 = 1e-11;
/// Most steps of the root finder.
const STEPS: usize = 60;

/// A point of contact of a pair.
#[derive(Clone, Copy)]
struct Contact {
    pair: [u32; 2],
    gap: f64,
    /// Halfway between the two surfaces [m].
    x: Vec3,
    point: Point,
}

/// Bodies, what they meet, and how fast they must come to bounce [m/s].
pub(super) struct Impacts<'a, 'b> {
    pub moment: &'a Moment<'b>,
    pub setting: &'a Setting<'b>,
    pub bounce: f64,
}

fn mover(actor: &Actor<'_>) -> Mover {
    let inertia = &actor.shape.inertia;
    let free = is_free(actor);
    Mover {
        inverse_mass: if free { 1.0 / inertia.mass } else { 0.0 },
        inverse_inertia: match free {
            true => actor.body.inverse_inertia(inertia),
            false => Mat3::diagonal([0.0; 3]),
        },
        velocity: actor.body.velocity,
        spin: actor.body.spin(inertia),
    }
}

impl Impacts<'_, '_> {
    /// Pairs that give back.
    fn bouncing(&self, actors: &[Actor<'_>]) -> Vec<[u32; 2]> {
        let bounces = |pair: &&[u32; 2]| {
            let surface = surface_of(actors.len(), &self.moment.walls, **pair, self.setting);
            surface.restitution > 0.0
        };
        self.moment.pairs.iter().filter(bounces).copied().collect()
    }

    /// Velocity of a solid at a place.
    fn velocity(&self, movers: &[Mover], actors: &[Actor<'_>], n: u32, x: Vec3) -> Vec3 {
        match actors.get(n as usize) {
            Some(actor) => {
                let mover = &movers[n as usize];
                add(mover.velocity, cross(mover.spin, sub(x, actor.body.com)))
            }
            None => self.moment.walls[n as usize - self.moment.bodies].velocity_now(x),
        }
    }

    /// Points of a pair that are nearer than [`TOUCH`].
    fn points(&self, actors: &[Actor<'_>], movers: &[Mover], pair: [u32; 2]) -> Vec<Contact> {
        let [a, b] = pair.map(|n| n as usize);
        let solids = [a, b].map(|n| &self.moment.solids[n]);
        let surface = surface_of(actors.len(), &self.moment.walls, pair, self.setting);
        let mut found = vec![];
        let skin = solids[0].skin + solids[1].skin;
        let pos12 = solids[0].pose.inv_mul(&solids[1].pose);
        let all = manifolds(&pos12, &*solids[0].shape, &*solids[1].shape, TOUCH + skin);
        for manifold in all {
            let out = solids[0].pose.rotation * manifold.local_n1;
            let normal = Vec3::from(-out);
            for point in &manifold.points {
                let gap = point.dist - skin;
                if gap > TOUCH {
                    continue;
                }
                let [p, q] = [
                    solids[0].pose.transform_point(point.local_p1),
                    solids[1].pose.transform_point(point.local_p2),
                ];
                let x = Vec3::from((p + q) * 0.5);
                let at = (x, normal);
                if is_at_seam(self.moment, pair, at, self.setting.dx) {
                    continue;
                }
                let second = actors.get(b).map(|actor| actor.body.com);
                let [u, v] = pair.map(|n| self.velocity(movers, actors, n, x));
                found.push(Contact {
                    pair,
                    gap,
                    x,
                    point: Point {
                        a,
                        b: second.map(|_| b),
                        normal,
                        arms: [
                            sub(x, actors[a].body.com),
                            second.map_or([0.0; 3], |com| sub(x, com)),
                        ],
                        wall: if second.is_some() { [0.0; 3] } else { v },
                        friction: surface.friction,
                        restitution: surface.restitution,
                        target: 0.0,
                        holds: false,
                        sticks: false,
                        normal_impulse: 0.0,
                        friction_impulse: [0.0; 3],
                        before: sub(u, v),
                    },
                });
            }
        }
        found
    }

    /// Whether a point of a pair that gives back comes fast.
    fn comes(&self, contact: &Contact) -> bool {
        dot(contact.point.before, contact.point.normal) < -self.bounce
    }

    /// Impulses of what has arrived: all at once within an island, with restitution where it is fast. Returns what bodies received, and
    /// pairs that come and have not arrived.
    pub fn resolve(&self, actors: &mut [Actor<'_>]) -> (Vec<ExchangedImpulse>, Vec<[u32; 2]>) {
        let bouncing = self.bouncing(actors);
        if bouncing.is_empty() {
            return (vec![], vec![]);
        }
        let mut movers: Vec<Mover> = actors.iter().map(mover).collect();
        let (mut arrived, mut coming) = (false, vec![]);
        for pair in &bouncing {
            let points = self.points(actors, &movers, *pair);
            if points.iter().any(|one| self.comes(one)) {
                match points.iter().any(|one| one.gap <= CLOSE) {
                    true => arrived = true,
                    false => coming.push(*pair),
                }
            }
        }
        if !arrived {
            return (vec![], coming);
        }
        let met = self
            .moment
            .pairs
            .iter()
            .filter(|pair| !coming.contains(pair));
        let contacts: Vec<Contact> = met
            .flat_map(|pair| self.points(actors, &movers, *pair))
            .collect();
        let root = islands(actors, &contacts);
        let island = |contact: &Contact| match contact.point.b {
            Some(b) if !is_free(&actors[contact.point.a]) => root[b],
            _ => root[contact.point.a],
        };
        let mut named: Vec<(usize, usize)> = (contacts.iter().map(island)).zip(0..).collect();
        named.sort_unstable();
        let mut given = vec![];
        for members in named.chunk_by(|p, q| p.0 == q.0) {
            let mut points: Vec<Point> = vec![];
            let mut is_hit = false;
            for &(_, n) in members {
                let mut point = contacts[n].point;
                match self.comes(&contacts[n]) && point.restitution > 0.0 {
                    true => is_hit = true,
                    false => point.restitution = 0.0,
                }
                let speed = dot(point.before, point.normal);
                point.target = (-point.restitution * speed).max(0.0);
                points.push(point);
            }
            if !is_hit {
                continue;
            }
            match &mut points[..] {
                [one] => impact(one, &mut movers),
                several => {
                    sweep(several, &mut movers, sweeps(several.len()));
                    settle_energy(several, &mut movers);
                }
            }
            for (&(_, n), point) in members.iter().zip(&points) {
                give(actors, point);
                let contact = &contacts[n];
                let impulse = point.impulse();
                given.push(ExchangedImpulse {
                    body: point.a,
                    other: partner(actors.len(), &self.moment.walls, contact.pair[1]),
                    received: Received::at(contact.x, point.normal, point.normal_impulse, impulse),
                });
            }
        }
        (given, coming)
    }

    /// When the first impact of a pair that gives back happens within `left` [s] of flight; `left` if none does.
    pub fn next(&self, actors: &[Actor<'_>], left: f64) -> f64 {
        let mut until = left;
        for pair in self.bouncing(actors) {
            let [a, b] = pair.map(|n| n as usize);
            let mut gap = |t: f64| {
                let [a, b] = [a, b].map(|n| self.moment.later(actors, self.setting, n, t));
                gap_of(&a, &b)
            };
            let (now, then) = (gap(0.0), gap(until));
            // What comes slowly is left to the forces of rest.
            if now <= CLOSE || then > 0.0 || now - then < 0.5 * self.bounce * until {
                continue;
            }
            until = root(&mut gap, [0.0, until], [now, then]);
        }
        until
    }
}

/// How near two solids are [m]; infinite where they are far from each other.
fn gap_of(a: &Solid, b: &Solid) -> f64 {
    let pos12 = a.pose.inv_mul(&b.pose);
    let skin = a.skin + b.skin;
    let far = a
        .shape
        .compute_local_bounding_sphere()
        .radius
        .min(b.shape.compute_local_bounding_sphere().radius);
    let found = manifolds(&pos12, &*a.shape, &*b.shape, skin + far);
    let gaps = found
        .iter()
        .flat_map(|manifold| manifold.points.iter().map(|point| point.dist));
    gaps.fold(f64::INFINITY, f64::min) - skin
}

/// Numbers that join what is connected by points: of every body the smallest body it hangs together with.
fn islands(actors: &[Actor<'_>], contacts: &[Contact]) -> Vec<usize> {
    let mut root: Vec<usize> = (0..actors.len()).collect();
    let links = contacts
        .iter()
        .filter_map(|c| Some((c.point.a, c.point.b?)));
    let links: Vec<(usize, usize)> = links
        .filter(|&(a, b)| is_free(&actors[a]) && is_free(&actors[b]))
        .collect();
    loop {
        let mut changed = false;
        for &(a, b) in &links {
            let least = root[a].min(root[b]);
            changed |= root[a] != least || root[b] != least;
            (root[a], root[b]) = (least, least);
        }
        if !changed {
            return root;
        }
    }
}

/// Books the impulse of a point with its bodies.
fn give(actors: &mut [Actor<'_>], point: &Point) {
    let both = [
        (Some(point.a), point.arms[0], 1.0),
        (point.b, point.arms[1], -1.0),
    ];
    for (n, r, sign) in both {
        let Some(actor) = n.map(|n| &mut actors[n]).filter(|actor| is_free(actor)) else {
            continue;
        };
        let (body, j) = (&mut actor.body, point.impulse());
        body.velocity = along(body.velocity, sign / actor.shape.inertia.mass, j);
        body.angular_momentum = along(body.angular_momentum, sign, cross(r, j));
    }
}

/// Root between a positive and a negative value: false position that halves the weight of an end that stays (Illinois), from outside as
/// far as it goes.
fn root(
    gap: &mut dyn FnMut(f64) -> f64,
    [mut t0, mut t1]: [f64; 2],
    [mut g0, mut g1]: [f64; 2],
) -> f64 {
    let mut side = 0;
    for _ in 0..STEPS {
        if g0 <= CLOSER || t1 - t0 <= 1e-16 * t1 {
            break;
        }
        // What is far is as far as it says by no number.
        let part = if g0.is_finite() { g0 / (g0 - g1) } else { 0.5 };
        let t = (t0 + (t1 - t0) * part).clamp(t0, t1);
        let g = gap(t);
        if g.abs() <= CLOSER {
            return t;
        }
        if g > 0.0 {
            (t0, g0) = (t, g);
            if side == 1 {
                g1 *= 0.5;
            }
            side = 1;
        } else {
            (t1, g1) = (t, g);
            if side == -1 {
                g0 *= 0.5;
            }
            side = -1;
        }
    }
    t0
}
