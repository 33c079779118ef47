//! Which bodies may meet in a step, and the points where they touch.

use super::{
    actor::{Actor, Drive, SLOP, Setting, TOUCH},
    edges::only_outside,
    feature::{Feature, Solid, Spot, spot},
    overlap::only_facing,
    rims::choose,
    seams::only_open,
    solve::Point,
    touch::{near, reduce},
    vector::{Vec3, add, length, sub},
};
use crate::{
    colliders::Placed,
    mat3::{cross, dot},
    scene::Surface,
};

/// Gap at which an impact happens [cells].
pub(super) const CLOSE: f64 = 1e-12;

/// Two that may meet in a step.
pub(super) struct Pair {
    pub a: usize,
    pub b: usize,
    /// Bound of how fast their distance changes [m/s].
    pub speed: f64,
    /// The part of it that is the wall's own.
    pub wall_speed: f64,
    pub near: Vec<(Feature, f64)>,
}

/// A point of contact of a pair.
pub(super) struct Contact {
    pub pair: [u32; 2],
    pub spot: Spot,
    pub point: Point,
}

/// Whether impulses move it.
pub(super) fn is_free(actor: &Actor<'_>) -> bool {
    matches!(actor.drive, Drive::Free { .. })
}

fn solid<'a>(actors: &[Actor<'a>], walls: &'a [Placed<'a>], n: usize) -> Solid<'a> {
    match actors.get(n) {
        Some(actor) => Solid::Body(actor.shape, actor.body),
        None => Solid::Wall(&walls[n - actors.len()]),
    }
}

/// Pairs that may touch within `left` [s], in their order, with the points that may.
pub(super) fn pairs<'a>(
    actors: &[Actor<'a>],
    walls: &'a [Placed<'a>],
    setting: &Setting<'_>,
    left: f64,
) -> Vec<Pair> {
    let touch = TOUCH * setting.dx;
    let fall = length(setting.gravity) * left;
    // How fast the surface of each may move, and how far it may be from where it is.
    let fastest: Vec<f64> = actors
        .iter()
        .map(|actor| {
            let push = match actor.drive {
                Drive::Free { force, .. } => length(force) * left / actor.shape.inertia.mass,
                Drive::Kinematic { .. } => 0.0,
            };
            let spin = length(actor.body.spin(&actor.shape.inertia));
            1.1 * (length(actor.body.velocity) + fall + push + spin * actor.shape.radius)
        })
        .collect();
    let reach = |n: usize| actors[n].shape.radius + fastest[n] * left + touch;
    let mut order: Vec<(f64, usize)> = (0..actors.len())
        .map(|n| (actors[n].body.com[0] - reach(n), n))
        .collect();
    order.sort_by(|p, q| p.0.total_cmp(&q.0).then(p.1.cmp(&q.1)));
    let mut found: Vec<(usize, usize, f64, f64)> = Vec::new();
    for (at, &(_, n)) in order.iter().enumerate() {
        let end = actors[n].body.com[0] + reach(n);
        for &(begin, m) in &order[at + 1..] {
            if begin > end {
                break;
            }
            let apart = length(sub(actors[n].body.com, actors[m].body.com));
            let either = is_free(&actors[n]) || is_free(&actors[m]);
            if either && apart <= reach(n) + reach(m) {
                found.push((n.min(m), n.max(m), fastest[n] + fastest[m], 0.0));
            }
        }
    }
    for (n, actor) in actors.iter().enumerate().filter(|(_, a)| is_free(a)) {
        for (w, wall) in walls.iter().enumerate() {
            let far = reach(n);
            let wall_speed = wall.speed(far, f64::INFINITY);
            let speed = fastest[n] + wall_speed;
            let far = far + speed * left;
            let (min, max) = (
                actor.body.com.map(|x| x - far),
                actor.body.com.map(|x| x + far),
            );
            if wall.is_near(min, max, touch) {
                found.push((n, actors.len() + w, speed, wall_speed));
            }
        }
    }
    found.sort_by_key(|f| (f.0, f.1));
    let with_points = found.into_iter().map(|(a, b, speed, wall_speed)| {
        let (one, two) = (solid(actors, walls, a), solid(actors, walls, b));
        let near = near(&one, &two, touch + speed * left);
        Pair {
            a,
            b,
            speed,
            wall_speed,
            near,
        }
    });
    with_points.filter(|pair| !pair.near.is_empty()).collect()
}

/// What a body may touch besides `but`, by its number.
fn partners_of(pairs: &[Pair], body: usize, but: usize) -> impl Iterator<Item = usize> {
    let partners = pairs.iter().filter_map(move |pair| match body {
        _ if pair.a == body => Some(pair.b),
        _ if pair.b == body => Some(pair.a),
        _ => None,
    });
    partners.filter(move |partner| *partner != but)
}

/// Velocity of `a` relative to `b` at `x`.
fn closing_velocity(
    actors: &[Actor<'_>],
    walls: &[Placed<'_>],
    a: usize,
    b: usize,
    x: Vec3,
) -> Vec3 {
    let of = |n: usize| match actors.get(n) {
        Some(actor) => {
            let spin = actor.body.spin(&actor.shape.inertia);
            add(actor.body.velocity, cross(spin, sub(x, actor.body.com)))
        }
        None => walls[n - actors.len()].velocity_now(x),
    };
    sub(of(a), of(b))
}

/// Restitution and friction of a pair, whether it holds what would leave, and whether it sticks.
fn surface(
    actors: &[Actor<'_>],
    walls: &[Placed<'_>],
    pair: &Pair,
    setting: &Setting<'_>,
) -> (f64, f64, bool, bool) {
    if pair.b < actors.len() {
        let (restitution, friction) = (setting.surface)(pair.a, pair.b);
        return (restitution, friction, false, false);
    }
    let wall = walls[pair.b - actors.len()];
    let contact = wall.against((setting.friction)(pair.a)).contact();
    let sticks = contact.surface == Surface::Sticky;
    let holds = contact.surface != Surface::Separate;
    let restitution = if sticks { 0.0 } else { contact.restitution };
    (restitution, contact.friction, holds, sticks)
}

/// Points that touch, but for those that come faster than `bounce` of pairs that are not there yet.
pub(super) fn contacts<'a>(
    actors: &[Actor<'a>],
    walls: &'a [Placed<'a>],
    pairs: &[Pair],
    setting: &Setting<'_>,
    bounce: f64,
) -> Vec<Contact> {
    let (touch, close) = (TOUCH * setting.dx, CLOSE * setting.dx);
    let mut found = Vec::new();
    for pair in pairs {
        let (a, b) = (solid(actors, walls, pair.a), solid(actors, walls, pair.b));
        // Where one point has arrived, those that touch take part in the impact: faces are never quite flat.
        let arrived = pair.near.iter().any(|(_, gap)| *gap <= 10.0 * close);
        let mut spots: Vec<Spot> = Vec::new();
        for &(feature, _) in pair.near.iter().filter(|(_, gap)| *gap <= touch) {
            let spot = spot(&a, &b, feature);
            let u = closing_velocity(actors, walls, pair.a, pair.b, spot.x);
            if arrived || dot(u, spot.normal) > -bounce {
                spots.push(spot);
            }
        }
        only_outside(&a, &b, &mut spots, setting.dx);
        choose(&a, &b, &mut spots);
        only_facing(&a, &b, &pair.near, &mut spots, setting.dx);
        if !spots.is_empty() {
            let supports = [(pair.a, pair.b), (pair.b, pair.a)].map(|(of, but)| {
                // A collider is on nothing.
                let partners = partners_of(pairs, of, but).filter(|_| of < actors.len());
                let near = partners.map(|n| solid(actors, walls, n));
                near.collect::<Vec<_>>()
            });
            let supports = [&supports[0][..], &supports[1][..]];
            only_open([&a, &b], supports, &mut spots, setting.dx);
        }
        let (restitution, friction, holds, sticks) = surface(actors, walls, pair, setting);
        for spot in reduce(&a, &b, spots, -SLOP * setting.dx) {
            let second = actors.get(pair.b).map(|actor| actor.body.com);
            let wall = match second {
                Some(_) => [0.0; 3],
                None => walls[pair.b - actors.len()].velocity_now(spot.x),
            };
            let point = Point {
                a: pair.a,
                b: second.map(|_| pair.b),
                normal: spot.normal,
                arms: [
                    sub(spot.x, actors[pair.a].body.com),
                    second.map_or([0.0; 3], |com| sub(spot.x, com)),
                ],
                wall,
                friction,
                restitution,
                target: 0.0,
                holds,
                sticks,
                normal_impulse: 0.0,
                friction_impulse: [0.0; 3],
                before: closing_velocity(actors, walls, pair.a, pair.b, spot.x),
            };
            found.push(Contact {
                pair: [pair.a as u32, pair.b as u32],
                spot,
                point,
            });
        }
    }
    found
}
