//! Velocity of a grid node that obeys the colliders near it.

use super::{
    Placed,
    approach::{GapSample, Reaction},
    contact::tangential,
};
use crate::{mat3::dot, scene::Surface};

/// What a collider made of the velocity of a node, or of a particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VelocityChange {
    /// Number of the collider.
    pub collider: usize,
    /// Nearest point of its surface [units].
    pub point: [f64; 3],
    /// Its outward normal.
    pub normal: [f64; 3],
    /// What it added to the velocity [units/s].
    pub change: [f64; 3],
}

/// Rounds of projection before a node that several colliders squeeze moves with the last of them.
const ROUNDS: usize = 8;

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// Velocity that a node at `x` may have near some bodies during `dt`, each with the matter near it; `cell` is the cell
/// size. `record` is told which collider changed it by how much: the changes add up to the whole.
pub fn constrain<'a>(
    acting: impl Iterator<Item = (&'a Placed<'a>, &'a GapSample)> + Clone,
    x: [f64; 3],
    mut v: [f64; 3],
    dt: f64,
    cell: f64,
    record: &mut impl FnMut(VelocityChange),
) -> [f64; 3] {
    let mut record = |body: &Placed<'_>, reaction: &Reaction, before: [f64; 3], after| {
        if before != after {
            record(VelocityChange {
                collider: body.id,
                point: reaction.point,
                normal: reaction.normal,
                change: minus(after, before),
            });
        }
    };
    let mut touched = 0;
    for (body, nearest) in acting.clone() {
        let Some(reaction) = body.reaction(x, nearest, cell) else {
            continue;
        };
        let u = body.velocity(x);
        let max_closing_speed = reaction.clearance / dt;
        let allowed = reaction
            .contact
            .resolve_at(minus(v, u), reaction.normal, max_closing_speed);
        let before = std::mem::replace(&mut v, plus(u, allowed));
        record(body, &reaction, before, v);
        touched += 1;
    }
    if touched < 2 {
        return v;
    }
    let slack = 1e-6 * dot(v, v).sqrt();
    let mut last = None;
    for _ in 0..ROUNDS {
        let mut obeyed = true;
        for (body, nearest) in acting.clone() {
            let Some(reaction) = body.reaction(x, nearest, cell) else {
                continue;
            };
            let Reaction {
                contact,
                normal,
                clearance,
                ..
            } = reaction;
            let u = body.velocity(x);
            let relative = minus(v, u);
            if contact.surface == Surface::Sticky {
                let held = plus(u, contact.resolve_at(relative, normal, clearance / dt));
                record(body, &reaction, v, held);
                return held;
            }
            let v_n = dot(relative, normal);
            if !contact.allows(v_n, clearance / dt, slack) {
                let kept = v_n.clamp(-clearance / dt, 0.0);
                let before = v;
                v = plus(u, tangential(relative, normal, v_n - kept));
                record(body, &reaction, before, v);
                obeyed = false;
            }
            last = Some((body, reaction, u));
        }
        if obeyed {
            return v;
        }
    }
    let Some((body, reaction, u)) = last else {
        return v;
    };
    record(body, &reaction, v, u);
    u
}
