//! Impulses at the nodes that objects share, and what boundaries make of the nodes that they changed.

use rayon::prelude::*;

use super::{
    impulse::{AccumulatedImpulse, accumulate},
    sites::{ContactBlock, ContactBlocks, Node, read},
};
use crate::{
    colliders::{Attached, VelocityChange},
    episodes::PairExchange,
    grid::{
        Grid, Velocities,
        approach::{BlockConstraints, BoundaryConditions},
    },
    ledger::{ColliderImpulses, Received},
    mat3::dot,
};

/// Sweeps where more than two objects, or boundaries, act on the same nodes.
const SWEEPS: usize = 4;

/// What the nodes of a site exchanged [mass units, cells, s].
fn exchange_of(site: &ContactBlock, nodes: &[Node], held: &[AccumulatedImpulse]) -> Received {
    let mut sum = Received::default();
    for (node, held) in nodes
        .iter()
        .zip(held)
        .filter(|(_, held)| held.normal_impulse > 0.0)
    {
        let x = site.position(node.at);
        let normal_impulse = dot(held.impulse, node.normal);
        sum.weight += normal_impulse;
        for i in 0..3 {
            sum.impulse[i] += held.impulse[i];
            sum.normal_impulse[i] += normal_impulse * node.normal[i];
            sum.moment[i] += normal_impulse * x[i];
        }
    }
    sum
}

/// Exchanges per pair of fields, by fields.
pub(super) fn by_pair(sites: &[ContactBlock], solved: &[Solved]) -> Vec<PairExchange> {
    let exchanged = solved.iter().flat_map(|place| &place.exchanged);
    let mut found: Vec<PairExchange> = sites
        .iter()
        .zip(exchanged)
        .filter(|(_, exchange)| exchange.weight > 0.0)
        .map(|(site, exchange)| (site.fields, *exchange))
        .collect();
    // Stable: sums run in the order of places.
    found.sort_by_key(|(fields, _)| *fields);
    found.dedup_by(|next, sum| {
        let same = next.0 == sum.0;
        if same {
            sum.1.add(&next.1, 1.0);
        }
        same
    });
    found
}

/// The answer at one place.
pub(super) struct Solved {
    /// New velocities of node blocks.
    pub blocks: Vec<(usize, Velocities)>,
    /// Per site of the place.
    pub exchanged: Vec<Received>,
    /// What colliders gave, like `blocks` [mass units, cells, s].
    pub given: Vec<ColliderImpulses>,
}

/// Solves all places; the grid stays as it is. `friction` is per site.
pub(super) fn solve(
    grid: &Grid,
    sites: &ContactBlocks,
    friction: &[f64],
    acting: &BoundaryConditions<'_>,
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
                acting,
            )
        })
        .collect()
}

fn solve_place(
    grid: &Grid,
    sites: &[ContactBlock],
    nodes: &[Node],
    friction: &[f64],
    acting: &BoundaryConditions<'_>,
) -> Solved {
    // Most nodes at most places do not press on each other.
    let presses = sites.iter().any(|site| {
        let mut nodes = nodes[site.range()].iter();
        nodes.any(|node| {
            let [(a, _), (b, _)] = site.blocks.map(|n| read(&grid.velocities[n], node.at));
            let u: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
            dot(u, node.normal) > 0.0
        })
    });
    if !presses {
        return Solved {
            blocks: vec![],
            given: vec![],
            exchanged: vec![Received::default(); sites.len()],
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
    let conditions: Vec<Option<BlockConstraints<'_>>> = blocks
        .iter()
        .map(|(n, _)| acting.on(&grid.nodes[*n]))
        .collect();
    let sweeps = match sites.len() > 1 || conditions.iter().any(Option::is_some) {
        true => SWEEPS,
        false => 1,
    };
    let mut held: Vec<Vec<AccumulatedImpulse>> = sites
        .iter()
        .map(|site| vec![AccumulatedImpulse::default(); site.range().len()])
        .collect();
    let mut given = vec![ColliderImpulses::default(); blocks.len()];
    for _ in 0..sweeps {
        let mut touched = 0_u64;
        for ((site, friction), held) in sites.iter().zip(friction).zip(&mut held) {
            let nodes = &nodes[site.range()];
            touched |= press(site, nodes, *friction, &mut blocks, held);
        }
        for (((n, block), conditions), given) in blocks.iter_mut().zip(&conditions).zip(&mut given)
        {
            let Some(conditions) = conditions else {
                continue;
            };
            for at in (0..64).filter(|at| touched >> at & 1 == 1) {
                let (_, mass) = read(block, at);
                let anchors = acting.anchors;
                let mass = anchors.matter(*n, &grid.nodes[*n], at, mass);
                constrain(block, at, conditions, acting.frame_velocity, |change| {
                    given.add(mass, &change);
                });
            }
        }
        if touched == 0 {
            break;
        }
    }
    let exchanged = sites.iter().zip(&held);
    let exchanged = exchanged.map(|(site, held)| exchange_of(site, &nodes[site.range()], held));
    Solved {
        exchanged: exchanged.collect(),
        blocks,
        given,
    }
}

/// One sweep over the nodes of a site; returns those whose impulse changed.
fn press(
    site: &ContactBlock,
    nodes: &[Node],
    friction: f64,
    blocks: &mut [(usize, Velocities)],
    held: &mut [AccumulatedImpulse],
) -> u64 {
    let mut touched = 0;
    let [a, b] = site
        .blocks
        .map(|n| blocks.iter().position(|(m, _)| *m == n));
    let (Some(a), Some(b)) = (a, b) else {
        return touched;
    };
    for (node, held) in nodes.iter().zip(held) {
        let [(v_a, _), (v_b, _)] = [a, b].map(|n| read(&blocks[n].1, node.at));
        let u: [f64; 3] = std::array::from_fn(|i| v_a[i] - v_b[i]);
        let k = 1.0 / node.mass[0] + 1.0 / node.mass[1];
        let Some(impulse) = accumulate(held, u, node.normal, k, friction) else {
            continue;
        };
        touched |= 1 << node.at;
        push(&mut blocks[a].1, node.at, impulse, -1.0 / node.mass[0]);
        push(&mut blocks[b].1, node.at, impulse, 1.0 / node.mass[1]);
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

/// Gives a node a velocity that boundaries allow; `record` is told what colliders change.
fn constrain(
    block: &mut Velocities,
    at: usize,
    conditions: &BlockConstraints<'_>,
    frame_velocity: [f64; 3],
    mut record: impl FnMut(VelocityChange),
) {
    let (v, _) = read(block, at);
    let v = std::array::from_fn(|a| v[a] + frame_velocity[a]);
    let v = conditions.constrain(at, &Attached::free(v), &mut record);
    let node = &mut block.0[at / 4].0[4 * (at % 4)..][..3];
    for a in 0..3 {
        node[a] = (v[a] - frame_velocity[a]) as f32;
    }
}
