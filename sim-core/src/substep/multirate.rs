//! Which objects take coarse substeps: where something stiff asks for short ones, automatic objects that may take longer
//! ones do.
//!
//! Coarse objects take one substep while the others take [`Rates::per_coarse`]. An isolated one takes it as any substep. Of a
//! coupled one velocities stay on the grid meanwhile, where forces change them little by little, and contact, boundaries and
//! rigid bodies as in every substep: so momentum is exchanged as always, and what rests on each other is in balance at any
//! time. Its particles move by where those velocities end, as in any substep, and are left alone until then.

use super::{
    limit::{PLANNED_TRAVEL, limit_of},
    rates::{Rate, Rates},
    schedule::SEGMENT,
};
use crate::{
    bodies::body::Body,
    grid::{Grid, NONE, Shared},
    model::Model,
    state::{Given, Matter, State},
};

/// Most fine substeps to a coarse one. Fewer than those without an impulse after which a pair may count as parted: two
/// objects that are apart from others meet once in them.
const MAX_PER_COARSE: u32 = 7;
/// Cost of a particle's coarse substep where forces are worked out apart, in fine ones.
const COUPLED_COST: f64 = 1.5;
/// Share of particles in the cost of a coupled substep, where contact and boundaries are worked out as often as before
/// (measured in heaps: 0.3 to 0.4).
const PARTICLE_SHARE: f64 = 0.35;
/// How far out of a block of particles their nodes may be: particles drift, and reach beyond [cells].
const NODE_REACH: f64 = 3.0;
/// Offset 0 of the 27 around a block.
const OWN_BLOCK: usize = 13;
/// Least share of the cost of substeps that must be saved.
const MIN_SAVING: f64 = 0.1;

/// The rates of a segment with so much left of the frame [s]: those that save most. `max_speed` bounds the speed of any
/// point of an object [m/s].
pub(crate) fn choose_rates(
    model: &Model,
    state: &State,
    grid: &Grid,
    max_speed: &dyn Fn(usize) -> f64,
    remaining: f64,
) -> Rates {
    let given = &Given::new(model, state);
    let objects = model.scene.objects.len();
    if !(0..objects).any(|id| given.is_automatic(id)) {
        return Rates::fine();
    }
    let Demand {
        mut own_dt,
        counts,
        shortest,
    } = Demand::of_objects(given, &state.matter);
    let total: f64 = counts.iter().sum();
    for (object, own) in own_dt.iter_mut().enumerate() {
        let is_free = || given.is_automatic(object) && !given.is_ruled(object);
        if *own < 2.0 * shortest || counts[object] == 0.0 || !is_free() {
            *own = 0.0;
        }
    }
    // Upper bound of a coarse substep; usually no object qualifies.
    let longest = own_dt.iter().copied().fold(0.0, f64::max);
    let longest = longest
        .min(remaining)
        .min(PLANNED_TRAVEL / state.motion.max_speed);
    if longest < 2.0 * shortest {
        return Rates::fine();
    }
    // Twice, as objects may become faster meanwhile.
    let time = remaining.min(SEGMENT as f64 * shortest);
    let meets_body = near_bodies(model, state, max_speed, 2.0 * time);
    let mut best = (MIN_SAVING * total, Rates::fine());
    for per_coarse in
        (2..=MAX_PER_COARSE).take_while(|&count| f64::from(count) * shortest <= longest)
    {
        let coarse = own_dt
            .iter()
            .map(|&own| own >= f64::from(per_coarse) * shortest);
        let rates = rates_of(given, grid, &coarse.collect::<Vec<_>>(), &meets_body);
        let saved: f64 = rates
            .iter()
            .zip(&counts)
            .map(|(rate, count)| saving(*rate, *count, per_coarse))
            .sum();
        if saved > best.0 {
            best = (saved, Rates::new(per_coarse, rates));
        }
    }
    best.1
}

/// What objects ask for.
struct Demand {
    /// Per object its largest substep [s]; infinite without particles that move.
    own_dt: Vec<f64>,
    /// Per object its particles.
    counts: Vec<f64>,
    /// The smallest of all substeps [s].
    shortest: f64,
}

impl Demand {
    fn of_objects(given: &Given<'_>, matter: &Matter) -> Self {
        let objects = given.model.scene.objects.len();
        let mut own_dt = vec![f64::INFINITY; objects];
        let mut counts = vec![0.0; objects];
        for (id, part) in given.model.parts.iter().enumerate() {
            if given.is_simulated(id) {
                let own = limit_of(given, id, &matter.extremes[id]).dt;
                own_dt[part.object] = own_dt[part.object].min(own);
                counts[part.object] += given.model.particle_counts[id] as f64;
            }
        }
        Self {
            shortest: own_dt.iter().copied().fold(f64::INFINITY, f64::min),
            own_dt,
            counts,
        }
    }
}

/// What an object of `count` particles saves with a rate, in fine substeps of a particle per coarse one.
fn saving(rate: Rate, count: f64, per_coarse: u32) -> f64 {
    match rate {
        Rate::Fine => 0.0,
        Rate::Isolated => count * (1.0 - f64::from(per_coarse).recip()),
        Rate::Coupled => count * PARTICLE_SHARE * (1.0 - COUPLED_COST / f64::from(per_coarse)),
    }
}

/// Per object, whether a rigid body may come to its matter within some time [s]: bodies meet nodes in every fine substep.
fn near_bodies(
    model: &Model,
    state: &State,
    max_speed: &dyn Fn(usize) -> f64,
    time: f64,
) -> Vec<bool> {
    let dx = model.scene.dx;
    let objects = 0..model.scene.objects.len();
    let bodies: Vec<(usize, &Body, f64)> = objects
        .clone()
        .filter_map(|id| {
            let (rigid, shape) = state.bodies.get(id)?;
            Some((id, &rigid.body, shape.radius))
        })
        .collect();
    let is_near = |object: usize| {
        let near = |(id, body, radius): &(usize, &Body, f64)| {
            let reach = radius + time * (max_speed(*id) + max_speed(object));
            let com = body.com.map(|x| x / dx);
            let mut blocks = state.blocks_of_particles(object).iter();
            blocks.any(|block| block.distance(com, NODE_REACH) <= reach / dx)
        };
        bodies.iter().any(near)
    };
    objects.map(is_near).collect()
}

/// The rates of objects of which some could be coarse, and some may meet rigid bodies.
fn rates_of(given: &Given<'_>, grid: &Grid, coarse: &[bool], meets_body: &[bool]) -> Vec<Rate> {
    let coupled = coarse.iter().zip(meets_body);
    let coupled = coupled.map(|(coarse, meets)| !coarse || *meets).collect();
    let coupled = spread_coupling(grid, coupled);
    // Sand yields to stress anew whenever it is asked for it.
    let parts = || given.model.parts.iter().zip(&given.commanded.materials);
    let lasts = |object: usize| {
        let mut own = parts().filter(|(part, _)| part.object == object);
        own.all(|(_, material)| material.law.is_solid() || material.law.is_fluid())
    };
    let objects = coarse.iter().zip(coupled).enumerate();
    objects
        .map(|(object, (&coarse, coupled))| match (coarse, coupled) {
            (true, false) => Rate::Isolated,
            (true, true) if lasts(object) => Rate::Coupled,
            _ => Rate::Fine,
        })
        .collect()
}

/// Couples what may share nodes with a coupled field, and what may with that: particles reach nodes of their block and of
/// those around it.
fn spread_coupling(grid: &Grid, mut coupled: Vec<bool>) -> Vec<bool> {
    let sharers = |place: &Shared| {
        let sharers = grid.sharers[place.nodes.clone()].iter();
        sharers.map(|&node| &grid.nodes[node as usize])
    };
    let is_met = |place: &&Shared| sharers(place).any(|node| node.tiles[OWN_BLOCK] != NONE);
    let met: Vec<&Shared> = grid.shared.iter().filter(is_met).collect();
    loop {
        let mut grows = false;
        for place in &met {
            if sharers(place).any(|node| coupled[node.field as usize]) {
                for node in sharers(place) {
                    grows |= !std::mem::replace(&mut coupled[node.field as usize], true);
                }
            }
        }
        if !grows {
            return coupled;
        }
    }
}
