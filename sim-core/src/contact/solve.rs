//! Impulses at the nodes that objects share, and what boundaries make of the nodes that they changed.

use rayon::prelude::*;

use super::{
    impulse::{Compliance, contact_impulse},
    sites::{Node, Site, Sites, read},
};
use crate::{
    grid::{
        Grid, Velocities,
        approach::{Acting, Allowed},
    },
    mat3::dot,
};

/// Sweeps where more than two objects, or boundaries, act on the same nodes.
const SWEEPS: usize = 4;

/// What a pair exchanged at some nodes [mass units, cells, s].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Exchange {
    /// Impulse that `b` received.
    pub impulse: [f64; 3],
    /// Part of it along the normals.
    pub pressed: [f64; 3],
    /// Sum of the sizes of the normal impulses.
    pub weight: f64,
    /// Sum of positions, with those as weights.
    pub moment: [f64; 3],
    /// Sum of velocities relative to the carrier, likewise.
    pub drift: [f64; 3],
}

impl Exchange {
    /// Adds another.
    pub fn add(&mut self, other: &Self) {
        for a in 0..3 {
            self.impulse[a] += other.impulse[a];
            self.pressed[a] += other.pressed[a];
            self.moment[a] += other.moment[a];
            self.drift[a] += other.drift[a];
        }
        self.weight += other.weight;
    }
}

/// The answer at one place.
pub(super) struct Solved {
    /// New velocities of node blocks.
    pub blocks: Vec<(usize, Velocities)>,
    /// Per site of the place.
    pub exchanged: Vec<Exchange>,
}

/// What acts besides contact.
pub(super) struct Surroundings<'a> {
    /// Colliders and regions.
    pub acting: Acting<'a>,
    /// Velocity that those of nodes are relative to [cells/s].
    pub carrier: [f64; 3],
}

/// Solves all places; the grid stays as it is. `friction` is per site.
pub(super) fn solve(
    grid: &Grid,
    sites: &Sites,
    friction: &[f64],
    around: &Surroundings<'_>,
) -> Vec<Solved> {
    let mut places = vec![];
    let mut start = 0;
    for group in sites.sites.chunk_by(|a, b| a.shared == b.shared) {
        places.push(start..start + group.len());
        start += group.len();
    }
    places
        .into_par_iter()
        .map(|range| {
            solve_place(
                grid,
                &sites.sites[range.clone()],
                &sites.nodes,
                &friction[range],
                around,
            )
        })
        .collect()
}

fn solve_place(
    grid: &Grid,
    sites: &[Site],
    nodes: &[Node],
    friction: &[f64],
    around: &Surroundings<'_>,
) -> Solved {
    let mut exchanged = vec![Exchange::default(); sites.len()];
    // Most nodes at most places do not press on each other.
    let presses = sites.iter().any(|site| {
        let mut nodes = nodes[site.range()].iter();
        nodes.any(|node| {
            let [(a, _), (b, _)] = site.blocks.map(|n| read(&grid.velocities[n], node.at));
            let u: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
            dot(u, node.normal) > allowed(node, around.acting.dt)
        })
    });
    if !presses {
        return Solved {
            blocks: vec![],
            exchanged,
        };
    }
    let mut blocks: Vec<(usize, Velocities)> = Vec::with_capacity(sites.len() + 1);
    for site in sites {
        for n in site.blocks {
            if blocks.iter().all(|(known, _)| *known != n) {
                blocks.push((n, grid.velocities[n]));
            }
        }
    }
    let conditions: Vec<Option<Allowed<'_>>> = blocks
        .iter()
        .map(|(n, _)| around.acting.on(&grid.nodes[*n]))
        .collect();
    let sweeps = match sites.len() > 1 || conditions.iter().any(Option::is_some) {
        true => SWEEPS,
        false => 1,
    };
    for _ in 0..sweeps {
        let mut touched = 0_u64;
        for ((site, friction), exchanged) in sites.iter().zip(friction).zip(&mut exchanged) {
            touched |= press(
                site,
                nodes,
                *friction,
                around.acting.dt,
                &mut blocks,
                exchanged,
            );
        }
        for ((_, block), conditions) in blocks.iter_mut().zip(&conditions) {
            if let Some(conditions) = conditions {
                for at in (0..64).filter(|at| touched >> at & 1 == 1) {
                    constrain(block, at, conditions, around.carrier);
                }
            }
        }
        if touched == 0 {
            break;
        }
    }
    Solved { blocks, exchanged }
}

/// Approach that needs no impulse [cells/s].
fn allowed(node: &Node, dt: f64) -> f64 {
    node.gap.max(0.0) / dt
}

/// One sweep over the nodes of a site; returns those that were pressed.
fn press(
    site: &Site,
    nodes: &[Node],
    friction: f64,
    dt: f64,
    blocks: &mut [(usize, Velocities)],
    exchanged: &mut Exchange,
) -> u64 {
    let mut touched = 0;
    let [a, b] = site
        .blocks
        .map(|n| blocks.iter().position(|(m, _)| *m == n));
    let (Some(a), Some(b)) = (a, b) else {
        return touched;
    };
    for node in &nodes[site.range()] {
        let [(v_a, _), (v_b, _)] = [a, b].map(|n| read(&blocks[n].1, node.at));
        let u: [f64; 3] = std::array::from_fn(|i| v_a[i] - v_b[i]);
        let k = 1.0 / node.mass[0] + 1.0 / node.mass[1];
        let Some(impulse) = contact_impulse(
            u,
            node.normal,
            &Compliance::Points(k),
            friction,
            allowed(node, dt),
        ) else {
            continue;
        };
        touched |= 1 << node.at;
        push(&mut blocks[a].1, node.at, impulse, -1.0 / node.mass[0]);
        push(&mut blocks[b].1, node.at, impulse, 1.0 / node.mass[1]);
        let pressed = dot(impulse, node.normal);
        let x = site.position(node.at);
        exchanged.weight += pressed;
        for i in 0..3 {
            exchanged.impulse[i] += impulse[i];
            exchanged.pressed[i] += pressed * node.normal[i];
            exchanged.moment[i] += pressed * x[i];
            exchanged.drift[i] += pressed * 0.5 * (v_a[i] + v_b[i]);
        }
    }
    touched
}

/// Adds an impulse to a node.
fn push(block: &mut Velocities, at: usize, impulse: [f64; 3], per_mass: f64) {
    let node = &mut block.0[at / 4].0[4 * (at % 4)..][..3];
    for (v, j) in node.iter_mut().zip(impulse) {
        *v = (f64::from(*v) + per_mass * j) as f32;
    }
}

/// Gives a node a velocity that boundaries allow.
fn constrain(block: &mut Velocities, at: usize, conditions: &Allowed<'_>, carrier: [f64; 3]) {
    let (v, _) = read(block, at);
    let v = conditions.constrain(at, std::array::from_fn(|a| v[a] + carrier[a]));
    let node = &mut block.0[at / 4].0[4 * (at % 4)..][..3];
    for a in 0..3 {
        node[a] = (v[a] - carrier[a]) as f32;
    }
}
