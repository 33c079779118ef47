//! What moves past each other within a step: points of contact follow it.

use super::{
    actor::{Actor, Drive, Load},
    meet::{Contact, is_free},
    vector::{Vec3, add, along, scaled, sub},
};
use crate::{
    colliders::Placed,
    mat3::{cross, dot},
};

/// Makes what points of contact meet that of the end of the coming `left` [s], across the normal: the point moves with the solid whose it
/// is, and meanwhile the other turns. Forces give velocities of the end, and the way of a body has the mean of both: with velocities of the
/// start what sticks to a turntable would move outwards.
pub(super) fn follow_turns(
    actors: &[Actor<'_>],
    walls: &[Placed<'_>],
    contacts: &mut [Contact],
    left: f64,
) {
    let spin = |n: usize| actors[n].body.spin(&actors[n].shape.inertia);
    for Contact { pair, spot, point } in contacts {
        let a = actors[point.a].body.velocity;
        let change = match point.b.map(|b| (b, actors[b].body.velocity)) {
            None => {
                let wall = &walls[pair[1] as usize - actors.len()];
                let at = |t: f64| wall.later(t).velocity_now(along(spot.x, t, a));
                sub(at(left), at(0.0))
            }
            Some((b, velocity)) => {
                let turning = if spot.feature.second { point.a } else { b };
                cross(spin(turning), scaled(sub(a, velocity), left))
            }
        };
        let change = along(change, -dot(change, point.normal), point.normal);
        point.wall = add(point.wall, change);
    }
}

/// Lets the points of contact follow their bodies during `until` [s]: forces between two bodies that pass each other
/// would otherwise turn the pair.
pub(super) fn transport_contact_points(
    actors: &[Actor<'_>],
    origins: &[Vec3],
    contacts: &[Contact],
    loads: &mut [Load],
    left: f64,
    until: f64,
) {
    // Mean way of a centre of mass.
    let ways: Vec<Vec3> = actors
        .iter()
        .zip(loads.iter())
        .map(|(actor, load)| {
            let half = scaled(actor.body.velocity, 0.5 * until);
            along(half, until * until / 6.0, load.acceleration)
        })
        .collect();
    for (n, actor) in actors.iter().enumerate() {
        if let Drive::Free { force, .. } = actor.drive {
            let way = add(sub(actor.body.com, origins[n]), ways[n]);
            loads[n].torque = sub(loads[n].torque, cross(way, force));
        }
    }
    for Contact { point, .. } in contacts {
        let Some(b) = point.b else { continue };
        if !is_free(&actors[point.a]) || !is_free(&actors[b]) {
            continue;
        }
        let shift = scaled(sub(ways[b], ways[point.a]), 0.5);
        let torque = cross(shift, scaled(point.impulse(), 1.0 / left));
        loads[point.a].torque = add(loads[point.a].torque, torque);
        loads[b].torque = add(loads[b].torque, torque);
    }
}
