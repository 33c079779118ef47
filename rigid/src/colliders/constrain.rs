//! Velocity of a grid node that obeys the colliders near it.

use super::{
    Placed,
    approach::{GapSample, Reaction},
    contact::tangential,
};
use crate::{mat3::dot, scene::Surface};

/// Rounds of projection before a node that several colliders squeeze moves with the last of them.
const ROUNDS: usize = 8;

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn plus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

/// Velocity that a node at `x` may have near some bodies during `dt`, each with the matter near it; `cell` is the cell
/// size.
pub fn constrain<'a>(
    acting: impl Iterator<Item = (&'a Placed<'a>, &'a GapSample)> + Clone,
    x: [f64; 3],
    mut v: [f64; 3],
    dt: f64,
    cell: f64,
) -> [f64; 3] {
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
        v = plus(u, allowed);
        touched += 1;
    }
    if touched < 2 {
        return v;
    }
    let slack = 1e-6 * dot(v, v).sqrt();
    let mut last = v;
    for _ in 0..ROUNDS {
        let mut obeyed = true;
        for (body, nearest) in acting.clone() {
            let Some(Reaction {
                contact,
                normal,
                clearance,
            }) = body.reaction(x, nearest, cell)
            else {
                continue;
            };
            let u = body.velocity(x);
            let relative = minus(v, u);
            if contact.surface == Surface::Sticky {
                return plus(u, contact.resolve_at(relative, normal, clearance / dt));
            }
            let v_n = dot(relative, normal);
            if !contact.allows(v_n, clearance / dt, slack) {
                let kept = v_n.clamp(-clearance / dt, 0.0);
                v = plus(u, tangential(relative, normal, v_n - kept));
                obeyed = false;
            }
            last = u;
        }
        if obeyed {
            return v;
        }
    }
    last
}
