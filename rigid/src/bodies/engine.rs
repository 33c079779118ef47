//! Bodies through time: impacts that give back at their moment, and in between the steps of rapier.

use super::{
    actor::{Actor, Drive, Setting},
    candidates::{Moment, flown},
    hooks::Surroundings,
    impacts::{Impacts, TOUCH},
    pairs::ExchangedImpulse,
    vector::{Vec3, length, scaled, sub},
    warm_start::CachedImpulse,
    world::World,
};
use crate::mat3::cross;

/// Longest step [s].
const LONGEST: f64 = 1.0 / 960.0;
/// Impacts that a step is cut at, at most: later ones in it are felt at the start of the next.
const MOST_IMPACTS: usize = 4;
/// Speed of approach below which nothing bounces, at least [m/s].
const SLOWEST_BOUNCE: f64 = 1e-6;
/// Time that is too short for forces to do anything [s].
const MOMENT: f64 = 1e-9;

/// Who touches whom in a step, and what it took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Impulses exchanged, in the order they happened.
    pub touches: Vec<ExchangedImpulse>,
}

/// Moves all bodies by `dt` [s]. What it does depends on nothing but what it is given: world and manifolds of rapier are made anew.
/// Where it is interrupted, bodies are amid the step.
pub fn step(
    actors: &mut [Actor<'_>],
    warm_start: &mut Vec<CachedImpulse>,
    setting: &Setting<'_>,
    dt: f64,
) -> Outcome {
    let mut outcome = Outcome::default();
    let pieces = (dt / LONGEST - 1e-9).ceil().max(1.0);
    let h = dt / pieces;
    let mut world = World::new(actors, setting, std::mem::take(warm_start));
    for n in 0..pieces as u32 {
        if setting.interruption.is_due() {
            break;
        }
        piece(
            actors,
            &mut world,
            setting,
            f64::from(n) * h,
            h,
            &mut outcome,
        );
    }
    *warm_start = world.borne();
    outcome
}

fn piece(
    actors: &mut [Actor<'_>],
    world: &mut World,
    setting: &Setting<'_>,
    start: f64,
    h: f64,
    outcome: &mut Outcome,
) {
    let bounce = (2.0 * length(setting.gravity) * h).max(SLOWEST_BOUNCE);
    let mut left = h;
    for n in 0..=MOST_IMPACTS {
        for actor in actors.iter_mut() {
            if let Drive::Kinematic { velocity, spin } = actor.drive {
                actor.body.velocity = velocity;
                actor.body.set_spin(&actor.shape.inertia, spin);
            }
        }
        let walls = (setting.walls)(start + h - left, left);
        let moment = Moment::new(actors, walls, setting, left, TOUCH);
        let impacts = Impacts {
            moment: &moment,
            setting,
            bounce,
        };
        let (given, coming) = impacts.resolve(actors);
        outcome.touches.extend(given);
        let until = match n < MOST_IMPACTS {
            true => impacts.next(actors, left),
            false => left,
        };
        let places: Vec<Vec3> = actors.iter().map(|actor| actor.body.com).collect();
        if until < MOMENT {
            for actor in actors.iter_mut() {
                actor.body = flown(actor, setting, until);
            }
        } else {
            let surroundings = Surroundings {
                moment: &moment,
                setting,
                coming: &coming,
            };
            world.advance(actors, &surroundings, until, &mut outcome.touches);
        }
        for (actor, place) in actors.iter_mut().zip(places) {
            if let Drive::Free { force, torque } = &mut actor.drive {
                // About where it is now; what pushes stays where it was.
                *torque = sub(*torque, cross(sub(actor.body.com, place), *force));
            }
        }
        left -= until;
        if left <= 0.0 {
            break;
        }
    }
    let keep = (-setting.damping * h).exp();
    for actor in actors.iter_mut() {
        actor.body.velocity = scaled(actor.body.velocity, keep);
        actor.body.angular_momentum = scaled(actor.body.angular_momentum, keep);
    }
}
