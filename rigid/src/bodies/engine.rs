//! Bodies through time: impacts at their moment, forces that hold bodies apart in between, flight.

use std::{cell::Cell, collections::HashMap};

use serde::{Deserialize, Serialize};

use super::{
    actor::{Actor, Drive, Load, SLOP, Setting},
    body::{Body, Inertia},
    feature::{Feature, Solid, gap},
    impact_time::{SearchEffort, first_contact},
    meet::{CLOSE, Contact, Pair, contacts, is_free, pairs},
    passing::{follow_turns, transport_contact_points},
    solve::{Mover, Point, SWEEPS, impact, settle_energy, sweep, sweeps},
    vector::{Vec3, add, along, length, scaled, sub},
};
use crate::{
    colliders::Placed,
    ledger::Received,
    mat3::{Mat3, cross, dot},
};

/// Longest step [s]: the time in which forces between bodies are constant.
const LONGEST: f64 = 1.0 / 240.0;
/// Impacts that a step is cut at, at most: later ones in it are felt at the start of the next.
const MOST_IMPACTS: usize = 64;
/// Steps of a turn above which attitudes are kept for the other points of the search.
const KEPT_TURN_STEPS: f64 = 8.0;
/// Speed of approach below which nothing bounces, at least [m/s].
const SLOWEST_BOUNCE: f64 = 1e-6;
/// Share of the slowest bounce below which an approach is left to the forces of contact.
const RESTING_SHARE: f64 = 1e-4;
/// Share of a depth that is undone per step, and the most of it [cells].
const RECOVERY: f64 = 0.2;
const MOST_RECOVERY: f64 = 0.05;

/// Force at a point of contact, where the next step begins its search.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CachedImpulse {
    /// The two: bodies first, then colliders.
    pub pair: [u32; 2],
    /// Whether it is a point of the second, and which.
    pub feature: (bool, u32),
    /// Along the normal [N].
    pub normal_impulse: f64,
    /// Across it [N].
    pub friction_impulse: Vec3,
}

/// Who touches whom after a step, and what it took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Points of contact that were solved for.
    pub points: u64,
    /// Impulses exchanged at them, in the order they happened.
    pub touches: Vec<ExchangedImpulse>,
}

/// The impulse that a body received at a point of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExchangedImpulse {
    /// The body.
    pub body: usize,
    /// The other side.
    pub other: Partner,
    /// Point, normal and impulse.
    pub received: Received,
}

/// The other side of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Partner {
    /// Another body.
    Body(usize),
    /// A collider, by its number in the scene.
    Wall(usize),
}

/// Notes `part` of the impulse at a point of contact.
fn note(
    touches: &mut Vec<ExchangedImpulse>,
    actors: &[Actor<'_>],
    walls: &[Placed<'_>],
    pair: [u32; 2],
    point: &Point,
    part: f64,
) {
    let second = pair[1] as usize;
    let other = match second.checked_sub(actors.len()) {
        None => Partner::Body(second),
        Some(wall) => Partner::Wall(walls[wall].id),
    };
    let place = add(actors[point.a].body.com, point.arms[0]);
    let impulse = scaled(point.impulse(), part);
    touches.push(ExchangedImpulse {
        body: point.a,
        other,
        received: Received::at(place, point.normal, part * point.normal_impulse, impulse),
    });
}

/// Moves all bodies by `dt` [s]. Momentum only changes by gravity, drives and walls; kinetic and potential energy
/// never grow by contact, but for what lifts bodies out of each other that overlap by more than the slop. Where it is interrupted, bodies
/// are amid the step.
pub fn step(
    actors: &mut [Actor<'_>],
    memory: &mut Vec<CachedImpulse>,
    setting: &Setting<'_>,
    dt: f64,
) -> Outcome {
    let mut outcome = Outcome::default();
    let pieces = (dt / LONGEST - 1e-9).ceil().max(1.0);
    let h = dt / pieces;
    let origins: Vec<Vec3> = actors.iter().map(|actor| actor.body.com).collect();
    for n in 0..pieces as u32 {
        if setting.interruption.is_due() {
            break;
        }
        let from = f64::from(n) * h;
        outcome = piece(actors, memory, setting, &origins, from, h, outcome);
    }
    outcome
}

fn piece(
    actors: &mut [Actor<'_>],
    memory: &mut Vec<CachedImpulse>,
    setting: &Setting<'_>,
    origins: &[Vec3],
    start: f64,
    h: f64,
    before: Outcome,
) -> Outcome {
    let bounce = (2.0 * length(setting.gravity) * h).max(SLOWEST_BOUNCE);
    let mut outcome = before;
    let mut left = h;
    for n in 0..=MOST_IMPACTS {
        for actor in actors.iter_mut() {
            if let Drive::Kinematic { velocity, spin } = actor.drive {
                actor.body.velocity = velocity;
                actor.body.set_spin(&actor.shape.inertia, spin);
            }
        }
        let walls = (setting.walls)(start + h - left, left);
        let pairs = pairs(actors, &walls, setting, left);
        let mut contacts = contacts(actors, &walls, &pairs, setting, bounce);
        for (pair, point) in resolve_impacts(actors, &mut contacts, bounce) {
            note(&mut outcome.touches, actors, &walls, pair, &point, 1.0);
        }
        follow_turns(actors, &walls, &mut contacts, left);
        let mut loads = solve_contact_forces(actors, &mut contacts, memory, setting, left);
        let until = match n < MOST_IMPACTS {
            true => next_impact(actors, &walls, &pairs, &loads, setting, bounce, left),
            false => left,
        };
        for Contact { pair, point, .. } in &contacts {
            note(
                &mut outcome.touches,
                actors,
                &walls,
                *pair,
                point,
                until / left,
            );
        }
        transport_contact_points(actors, origins, &contacts, &mut loads, left, until);
        for (actor, load) in actors.iter_mut().zip(&loads) {
            let inertia = &actor.shape.inertia;
            actor.body = actor
                .body
                .after(inertia, load.acceleration, load.torque, until);
        }
        outcome.points += contacts.len() as u64;
        left -= until;
        if left <= 0.0 {
            part(actors, &contacts, setting.dx, bounce);
            break;
        }
    }
    let keep = (-setting.damping * h).exp();
    for actor in actors.iter_mut() {
        actor.body.velocity = scaled(actor.body.velocity, keep);
        actor.body.angular_momentum = scaled(actor.body.angular_momentum, keep);
    }
    outcome
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

/// Impulses of what approaches: all at once within an island, with restitution where it is fast. Returns them with their
/// pairs.
fn resolve_impacts(
    actors: &mut [Actor<'_>],
    contacts: &mut [Contact],
    bounce: f64,
) -> Vec<([u32; 2], Point)> {
    let mut given = Vec::new();
    let speed = |c: &Contact| dot(c.point.before, c.point.normal);
    let meets = |c: &Contact| match c.point.holds {
        true => length(c.point.before) > RESTING_SHARE * bounce,
        false => speed(c) < -RESTING_SHARE * bounce,
    };
    if !contacts.iter().any(meets) {
        return given;
    }
    let root = islands(actors, contacts);
    let island = |c: &Contact| match c.point.b {
        Some(b) if !is_free(&actors[c.point.a]) => root[b],
        _ => root[c.point.a],
    };
    let mut named: Vec<(usize, usize)> = contacts
        .iter()
        .enumerate()
        .map(|(n, c)| (island(c), n))
        .collect();
    named.sort_unstable();
    let mut movers: Vec<Mover> = actors.iter().map(mover).collect();
    for members in named.chunk_by(|p, q| p.0 == q.0) {
        let members: Vec<usize> = members.iter().map(|m| m.1).collect();
        if !members.iter().any(|&n| meets(&contacts[n])) {
            continue;
        }
        let mut points: Vec<Point> = members
            .iter()
            .map(|&n| {
                let mut point = contacts[n].point;
                let speed = speed(&contacts[n]);
                if speed > -bounce {
                    point.restitution = 0.0;
                }
                point.target = (-point.restitution * speed).max(0.0);
                point
            })
            .collect();
        match &mut points[..] {
            [one] => impact(one, &mut movers),
            several => {
                sweep(several, &mut movers, sweeps(several.len()));
                settle_energy(several, &mut movers);
            }
        }
        for (&n, point) in members.iter().zip(&points) {
            give(actors, point, 1.0);
            given.push((contacts[n].pair, *point));
        }
    }
    for contact in contacts.iter_mut() {
        contact.point.before = contact.point.relative(&movers);
    }
    given
}

/// Books the impulse of a point, times `part`, with its bodies.
fn give(actors: &mut [Actor<'_>], point: &Point, part: f64) {
    let j = scaled(point.impulse(), part);
    for (n, r, sign) in [
        (Some(point.a), point.arms[0], 1.0),
        (point.b, point.arms[1], -1.0),
    ] {
        let Some(actor) = n.map(|n| &mut actors[n]).filter(|actor| is_free(actor)) else {
            continue;
        };
        let body = &mut actor.body;
        body.velocity = along(body.velocity, sign / actor.shape.inertia.mass, j);
        body.angular_momentum = along(body.angular_momentum, sign, cross(r, j));
    }
}

/// Forces during the coming `left` [s] that keep what touches from approaching; what acts on each body then.
fn solve_contact_forces(
    actors: &[Actor<'_>],
    contacts: &mut [Contact],
    memory: &mut Vec<CachedImpulse>,
    setting: &Setting<'_>,
    left: f64,
) -> Vec<Load> {
    let mut loads: Vec<Load> = actors
        .iter()
        .map(|actor| match actor.drive {
            Drive::Free { force, torque } => Load {
                acceleration: along(setting.gravity, 1.0 / actor.shape.inertia.mass, force),
                torque,
            },
            Drive::Kinematic { .. } => Load {
                acceleration: [0.0; 3],
                torque: [0.0; 3],
            },
        })
        .collect();
    let mut movers: Vec<Mover> = actors.iter().map(mover).collect();
    for (mover, load) in movers.iter_mut().zip(&loads) {
        mover.velocity = along(mover.velocity, left, load.acceleration);
        let turn = mover.inverse_inertia.mul_vec(load.torque);
        mover.spin = along(mover.spin, left, turn);
    }
    let mut points: Vec<Point> = contacts
        .iter()
        .map(|contact| {
            let Feature { second, point } = contact.spot.feature;
            let known = memory.binary_search_by_key(&(contact.pair, (second, point)), |known| {
                (known.pair, known.feature)
            });
            let mut point = contact.point;
            // What leaves may come back as fast: a force that does no work. The next step begins by stopping it.
            point.target = match point.holds {
                true => 0.0,
                false => (-dot(point.before, point.normal)).min(0.0),
            };
            if let Ok(at) = known {
                point.normal_impulse = left * memory[at].normal_impulse;
                let friction_impulse = scaled(memory[at].friction_impulse, left);
                point.friction_impulse = along(
                    friction_impulse,
                    -dot(friction_impulse, point.normal),
                    point.normal,
                );
            }
            point
        })
        .collect();
    let most = sweeps(points.len());
    sweep(&mut points, &mut movers, most);
    memory.clear();
    for (contact, point) in contacts.iter_mut().zip(points) {
        let force = scaled(point.impulse(), 1.0 / left);
        for (n, r, sign) in [
            (Some(point.a), point.arms[0], 1.0),
            (point.b, point.arms[1], -1.0),
        ] {
            let Some(n) = n.filter(|&n| is_free(&actors[n])) else {
                continue;
            };
            let per_mass = sign / actors[n].shape.inertia.mass;
            loads[n].acceleration = along(loads[n].acceleration, per_mass, force);
            loads[n].torque = along(loads[n].torque, sign, cross(r, force));
        }
        let Feature { second, point: at } = contact.spot.feature;
        memory.push(CachedImpulse {
            pair: contact.pair,
            feature: (second, at),
            normal_impulse: point.normal_impulse / left,
            friction_impulse: scaled(point.friction_impulse, 1.0 / left),
        });
        contact.point = point;
    }
    memory.sort_by_key(|known| (known.pair, known.feature));
    loads
}

/// Bound of how fast the distance of a pair changes within `left` [s] under these loads [m/s]. That of the pair does
/// not know that what rests is held: with it, every point of a face that lies on another would be looked for again.
fn closing_speed(actors: &[Actor<'_>], pair: &Pair, loads: &[Load], left: f64) -> f64 {
    let spin = |n: usize| {
        let Inertia { moments, .. } = actors[n].shape.inertia;
        let momentum = length(actors[n].body.angular_momentum) + left * length(loads[n].torque);
        let least = moments.into_iter().fold(f64::INFINITY, f64::min);
        momentum / least * actors[n].shape.radius
    };
    let (a, b) = (pair.a, pair.b);
    let (mut velocity, mut acceleration) = (actors[a].body.velocity, loads[a].acceleration);
    let mut turning = spin(a);
    if let Some(actor) = actors.get(b) {
        velocity = sub(velocity, actor.body.velocity);
        acceleration = sub(acceleration, loads[b].acceleration);
        turning += spin(b);
    }
    // Linear in time, so that it is largest at an end.
    let linear = length(velocity).max(length(along(velocity, left, acceleration)));
    (1.1 * (linear + 2.0 * turning) + pair.wall_speed).min(pair.speed)
}

/// Changes what is known of the search's effort.
fn note_effort<T>(effort: &Cell<SearchEffort>, note: impl FnOnce(&mut SearchEffort) -> T) -> T {
    let mut now = effort.get();
    let noted = note(&mut now);
    effort.set(now);
    noted
}

/// How fast a gap, `now` at 0, closes at `t` [m/s] within a step of which so much is `left` [s].
fn closing(gap: &mut dyn FnMut(f64) -> f64, now: f64, t: f64, left: f64) -> f64 {
    let before = (t - 1e-3 * left).max(0.0);
    if before < t {
        (gap(before) - gap(t)) / (t - before)
    } else {
        now / t.max(f64::MIN_POSITIVE)
    }
}

/// When the first impact within `left` [s] happens under these loads; `left` if none does, or where the search ends before.
fn next_impact<'a>(
    actors: &[Actor<'a>],
    walls: &'a [Placed<'a>],
    pairs: &[Pair],
    loads: &[Load],
    setting: &Setting<'_>,
    bounce: f64,
    left: f64,
) -> f64 {
    let close = CLOSE * setting.dx;
    let mut until = left;
    let turn_steps = |n: usize| {
        let actor = actors.get(n);
        actor.map_or(0.0, |actor| actor.turn_steps(loads[n].torque, left))
    };
    // Points of a pair are searched for at the same times. What is cheap is not kept.
    let mut known: HashMap<(usize, u64), Body> = HashMap::new();
    let mut body_at = |n: usize, t: f64| {
        let (actor, load) = (&actors[n], &loads[n]);
        let inertia = &actor.shape.inertia;
        let steps = turn_steps(n);
        let place = || {
            note_effort(setting.effort, |effort| effort.place(steps));
            actor.body.after(inertia, load.acceleration, load.torque, t)
        };
        match steps > KEPT_TURN_STEPS {
            true => *known.entry((n, t.to_bits())).or_insert_with(place),
            false => place(),
        }
    };
    for pair in pairs {
        if note_effort(setting.effort, SearchEffort::ends) {
            return until;
        }
        let turn_steps = turn_steps(pair.a).max(turn_steps(pair.b));
        let a_end = Solid::Body(actors[pair.a].shape, body_at(pair.a, until));
        let wall_end;
        let b_end = match actors.get(pair.b) {
            Some(actor) => Solid::Body(actor.shape, body_at(pair.b, until)),
            None => {
                wall_end = walls[pair.b - actors.len()].later(until);
                Solid::Wall(&wall_end)
            }
        };
        let end = until;
        let speed = closing_speed(actors, pair, loads, left);
        for &(feature, now) in &pair.near {
            if now <= 10.0 * close || now > speed * until {
                continue;
            }
            let then = gap(&a_end, &b_end, feature);
            let far = now + then >= speed * end;
            let slow = 2.0 * (now - then) < bounce * end;
            if then > 0.0 && far || then <= 0.0 && slow {
                continue;
            }
            if note_effort(setting.effort, SearchEffort::ends) {
                return until;
            }
            let mut at = |t: f64| {
                let a = Solid::Body(actors[pair.a].shape, body_at(pair.a, t));
                match actors.get(pair.b) {
                    Some(actor) => gap(&a, &Solid::Body(actor.shape, body_at(pair.b, t)), feature),
                    None => {
                        let wall = walls[pair.b - actors.len()].later(t);
                        gap(&a, &Solid::Wall(&wall), feature)
                    }
                }
            };
            let Some(t) = first_contact(&mut at, now, until, speed, close, turn_steps) else {
                continue;
            };
            // Those that come slowly rest: the start of the next step takes care of them.
            if t > 0.0 && closing(&mut at, now, t, left) > 0.5 * bounce {
                until = t;
            }
        }
    }
    until
}

/// Moves apart what overlaps by more than the slop, a part of it, without a change of velocity; not what leaves by
/// itself, as moving it would turn the pair.
fn part(actors: &mut [Actor<'_>], contacts: &[Contact], dx: f64, bounce: f64) {
    let rests = |c: &Contact| dot(c.point.before, c.point.normal).abs() < bounce;
    let deep = |c: &&Contact| c.spot.gap < -SLOP * dx && rests(c);
    let deep: Vec<&Contact> = contacts.iter().filter(deep).collect();
    if deep.is_empty() {
        return;
    }
    // Displacements obey the same law as velocities.
    let mut movers: Vec<Mover> = actors
        .iter()
        .map(|actor| Mover {
            velocity: [0.0; 3],
            spin: [0.0; 3],
            ..mover(actor)
        })
        .collect();
    let mut points: Vec<Point> = deep
        .iter()
        .map(|contact| {
            let way = (RECOVERY * (-contact.spot.gap - SLOP * dx)).min(MOST_RECOVERY * dx);
            Point {
                friction: 0.0,
                target: way,
                holds: false,
                sticks: false,
                normal_impulse: 0.0,
                friction_impulse: [0.0; 3],
                wall: [0.0; 3],
                ..contact.point
            }
        })
        .collect();
    sweep(&mut points, &mut movers, SWEEPS);
    for (actor, mover) in actors.iter_mut().zip(&movers).filter(|(a, _)| is_free(a)) {
        actor.body.nudge(mover.velocity, mover.spin);
    }
}
